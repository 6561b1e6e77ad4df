"""Points added inside a polygon's triangles where its cloud bulges out from them."""

from __future__ import annotations

import numpy as np

from sed2cad.geometry.curves import Array
from sed2cad.geometry.polygons import Cloud, Polygon, price
from sed2cad.geometry.triangles import point_triangle

_FAR = 0.006  # unit frame: the cloud stays this near to the triangles
_MOST_ADDED = 40
_PROBES = 400  # cloud points looked at
_INSIDE = 0.08  # share of a triangle's height that an added point keeps from its sides

Triangle = tuple[int, int, int]


def bulged(polygon: Polygon, cloud: Cloud) -> None:
    """Add the farthest cloud points to the triangles, one after another, and turn sides that then lie badly."""
    step = max(1, len(cloud.points) // _PROBES)
    probes = cloud.points[::step]
    ignored = np.zeros(len(probes), dtype=bool)
    for _ in range(3 * _MOST_ADDED):
        if len(polygon.points) - len(polygon.corners) >= _MOST_ADDED:
            break
        a, b, c = _corners(polygon, polygon.triangles)
        off = point_triangle(probes[:, None], a[None], b[None], c[None])
        near = np.where(ignored, 0.0, off.min(axis=1))
        worst = int(near.argmax())
        if near[worst] < _FAR:
            break
        ignored[worst] = True
        if _inserted(polygon, int(off[worst].argmin()), probes[worst]):
            _turn_sides(polygon, cloud)


def _corners(polygon: Polygon, triangles: list[Triangle]) -> tuple[Array, Array, Array]:
    """The corners (n, 3) of triangles."""
    points = np.array(polygon.points)[np.array(triangles)]
    return points[:, 0], points[:, 1], points[:, 2]


def _inserted(polygon: Polygon, number: int, point: Array) -> bool:
    """Put a point into a triangle; not where it lies over one of its sides."""
    a, b, c = (polygon.points[k] for k in polygon.triangles[number])
    across = np.cross(b - a, c - a)
    whole = float(across @ across)
    shares = [float(np.cross(q - p, point - p) @ across) / max(whole, 1e-300) for p, q in ((a, b), (b, c), (c, a))]
    if min(shares) < _INSIDE:
        return False
    new = len(polygon.points)
    polygon.points.append(point)
    i, j, k = polygon.triangles.pop(number)
    polygon.triangles += [(i, j, new), (j, k, new), (k, i, new)]
    return True


def _turn_sides(polygon: Polygon, cloud: Cloud) -> None:
    """Turn sides between two triangles while that makes them cheaper."""
    for _ in range(len(polygon.triangles)):
        gain, change = max((_turn(polygon, m, n, cloud) for m, n in _pairs(polygon)), default=(0.0, None))
        if change is None or gain <= 1e-9:
            return
        m, n, one, other = change
        polygon.triangles[m], polygon.triangles[n] = one, other


def _pairs(polygon: Polygon) -> list[tuple[int, int]]:
    """Numbers of triangles with a common side, one of them at the point added last."""
    last = len(polygon.points) - 1
    side: dict[tuple[int, int], int] = {}
    for number, (a, b, c) in enumerate(polygon.triangles):
        side.update({(a, b): number, (b, c): number, (c, a): number})
    at_last = [n for n, t in enumerate(polygon.triangles) if last in t]
    found = []
    for m in at_last:
        a, b = _opposite(polygon.triangles[m], last)
        if (b, a) in side:
            found.append((m, side[b, a]))
    return found


def _opposite(triangle: Triangle, corner: int) -> tuple[int, int]:
    """The side of a triangle across from one of its corners."""
    at = triangle.index(corner)
    return triangle[(at + 1) % 3], triangle[(at + 2) % 3]


def _turn(
    polygon: Polygon, m: int, n: int, cloud: Cloud
) -> tuple[float, tuple[int, int, Triangle, Triangle] | None]:
    """What turning the common side of two triangles gains, and the change."""
    last = len(polygon.points) - 1
    a, b = _opposite(polygon.triangles[m], last)
    far = next(k for k in polygon.triangles[n] if k not in (a, b))
    old = [polygon.triangles[m], polygon.triangles[n]]
    new: list[Triangle] = [(last, a, far), (last, far, b)]
    cost = price(*_corners(polygon, old + new), cloud)
    return float(cost[:2].sum() - cost[2:].sum()), (m, n, new[0], new[1])
