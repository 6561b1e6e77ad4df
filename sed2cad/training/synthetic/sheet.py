"""Thin parts: bent sheet metal with holes and cut-outs, trays, square tubes."""

from __future__ import annotations

from itertools import pairwise
from math import atan2, cos, pi, sin, tan

import numpy as np
from build123d import Axis, Plane, Solid

from sed2cad.training.synthetic.dice import Dice
from sed2cad.training.synthetic.edges import dress, sharp_edges
from sed2cad.training.synthetic.features import Features, add_holes, bore, decorate
from sed2cad.training.synthetic.shapes import (
    Corner,
    Seat,
    cut,
    is_sound,
    largest,
    outline,
    prism,
    rectangle,
    slot,
)


def bent_sheet(dice: Dice) -> Solid:
    """A strip of sheet with one to five bends of one radius, holes in its legs, rounded corners."""
    thick, half = dice.spread(0.6, 2.5), dice.between(8, 45)
    radius = thick * dice.between(0.3, 2.0)
    points, bends = [np.zeros(2)], dice.whole(1, 5)
    kind = dice.pick(["u", "z", "free"])
    angle, turn = 0.0, dice.pick([-1, 1])
    for k in range(bends + 1):
        points.append(points[-1] + dice.between(12, 40) * np.array([cos(angle), sin(angle)]))
        turn = {"u": turn, "z": -turn, "free": dice.pick([-1, 1])}[kind]
        if k > 2 and kind == "u":
            break
        angle += turn * (pi / 2 if dice.chance(0.8) else dice.between(0.4, 1.4))
    part = prism(outline(_strip(points, thick, radius)), 2 * half, -half)
    features = Features()
    for a, b in pairwise(points):
        along, length = (b - a) / np.linalg.norm(b - a), float(np.linalg.norm(b - a))
        up = np.array([-along[1], along[0]])
        origin = 0.5 * (a + b) + 0.5 * thick * up
        plane = Plane((*origin.tolist(), 0), x_dir=(*along.tolist(), 0), z_dir=(*up.tolist(), 0))
        room = 0.5 * length - 1.5 * radius - 2 * thick
        if room > 2:
            _perforate(dice, features, Seat(plane, room, 0.9 * half, thick))
    return _round_corners(dice, features.on(part), thick)


def _strip(points: list[np.ndarray], thick: float, radius: float) -> list[Corner]:
    """The section of a sheet along a line of points, with concentric bends."""
    sides: list[list[Corner]] = []
    for side in (1.0, -1.0):
        row = []
        for k, point in enumerate(points):
            before = points[k] - points[k - 1] if k else points[1] - points[0]
            after = points[k + 1] - points[k] if k + 1 < len(points) else before
            first, second = before / np.linalg.norm(before), after / np.linalg.norm(after)
            middle = first + second
            normal = np.array([-middle[1], middle[0]]) / (1 + first @ second)
            turn = atan2(first[0] * second[1] - first[1] * second[0], first @ second)
            bend = radius + (thick if turn * side < 0 else 0)
            x, y = point + 0.5 * thick * side * normal
            row.append(Corner(float(x), float(y), abs(bend * tan(turn / 2))))
        sides.append(row)
    return sides[0] + sides[1][::-1]


def _perforate(dice: Dice, features: Features, seat: Seat) -> None:
    """Holes, slots, windows or vents through a leg."""
    kind = dice.pick(["none", "holes", "slots", "windows", "notch"], [1.5, 2.5, 1, 2.5, 2])
    small = min(seat.x, seat.y)
    if kind == "holes":
        for _ in range(dice.whole(1, 2)):
            add_holes(dice, features, seat)
    elif kind == "slots":
        count, radius = dice.whole(1, 6), small * dice.between(0.05, 0.12)
        face = slot(0.7 * seat.x, radius)
        rows = [-seat.y + (k + 0.5) * 2 * seat.y / count for k in range(count)]
        features.remove += [prism(face, 4 * seat.depth, -2 * seat.depth).moved(seat.at(0, y)) for y in rows]
    elif kind == "windows":
        face = outline(rectangle(0.6 * seat.x, 0.5 * seat.y, 0.2 * small * dice.whole(0, 1)))
        features.remove.append(prism(face, 4 * seat.depth, -2 * seat.depth).moved(seat.at(0, 0)))
    elif kind == "notch":
        size = small * dice.between(0.2, 0.5)
        tool = prism(outline(rectangle(size, size)), 4 * seat.depth, -2 * seat.depth)
        features.remove += [tool.moved(seat.at(0, s * 1.1 * seat.y)) for s in dice.some([-1, 1], 2)]


def _round_corners(dice: Dice, part: Solid, thick: float) -> Solid:
    """Round or bevel edges as long as the sheet is thick."""
    if dice.chance(0.35):
        return part
    corners = [s.edge for s in sharp_edges(part) if abs(s.edge.length - thick) < 1e-4]
    chosen = dice.some(corners, 24) if corners else []
    size = thick * dice.between(0.5, 3)
    try:
        made = part.fillet(size, chosen) if dice.chance(0.45) else part.chamfer(size, None, chosen)
        solid = largest(made.wrapped)
    except Exception:  # the kernel raises its own errors of many kinds: go on without
        return part
    return solid if is_sound(solid) else part


def flat_sheet(dice: Dice) -> Solid:
    """A flat cut sheet with many holes and windows."""
    x, y, thick = dice.between(20, 70), dice.between(15, 60), dice.spread(0.6, 3)
    trim = min(x, y) * dice.between(0.03, 0.4) if dice.chance(0.7) else 0
    features = Features()
    nx, ny = dice.whole(1, 4), dice.whole(1, 4)
    for i in range(nx):
        for j in range(ny):
            centre = (-x + (2 * i + 1) * x / nx, -y + (2 * j + 1) * y / ny, thick)
            _perforate(dice, features, Seat(Plane(centre), 0.8 * x / nx, 0.8 * y / ny, thick))
    return _round_corners(dice, features.on(prism(outline(rectangle(x, y, trim, dice.chance(0.7))), thick)), thick)


def tray(dice: Dice) -> Solid:
    """A thin open tray with rounded or conical walls, ribs and holes in its floor."""
    x, y, z = dice.between(15, 50), dice.between(12, 40), dice.between(4, 30)
    wall, trim = dice.spread(0.6, 2.0), dice.between(2, 10)
    part = prism(outline(rectangle(x, y, trim)), z)
    hollow = prism(outline(rectangle(x - wall, y - wall, max(trim - wall, 0.3))), z, wall)
    features = Features()
    decorate(dice, features, Seat(Plane((0, 0, wall)), 0.75 * x, 0.75 * y, wall), 3)
    outside, floor = dice.chance(0.35), dice.between(1.2, 2.5) * wall
    if outside and floor < trim and floor < 0.9 * z:
        edges = [s.edge for s in sharp_edges(part) if abs(s.edge.center().Z) < 1e-6]
        part = largest(part.fillet(floor, edges).wrapped)
        edges = [s.edge for s in sharp_edges(hollow) if abs(s.edge.center().Z - wall) < 1e-6]
        hollow = largest(hollow.fillet(floor - wall, edges).wrapped)
    return dress(dice, features.on(cut(part, [hollow])), dice.whole(0, 1), 0.5, (0.002, 0.008))


def square_tube(dice: Dice) -> Solid:
    """A long tube of rectangular or hexagonal section with holes and notches in its walls."""
    x, y, length = dice.between(6, 20), dice.between(6, 20), dice.between(30, 140)
    wall = min(x, y) * dice.spread(0.06, 0.25)
    trim = wall * dice.between(1.1, 2.5) if dice.chance(0.7) else 0
    part = prism(outline(rectangle(x, y, trim)), length)
    tools = [prism(outline(rectangle(x - wall, y - wall, max(trim - wall, 0))), 2 * length, -0.5 * length)]
    for _ in range(dice.whole(1, 3)):
        radius, count = min(x, y) * dice.between(0.15, 0.5), dice.whole(1, 4)
        both, turn = dice.chance(0.5), dice.pick([0, 90, 180, 270])
        hole = bore(dice, radius, wall * 1.5 if not both else 3 * (x + y), True).rotate(Axis.Y, 90)
        reach = x if turn in (0, 180) else y
        start, pitch = dice.between(0.1, 0.5) * length, 3 * radius
        tools += [
            hole.translate((reach, 0, start + k * pitch)).rotate(Axis.Z, turn)
            for k in range(count)
            if start + k * pitch < length - 1.5 * radius
        ]
    if dice.chance(0.3):
        mitre = prism(outline(rectangle(3 * x, 3 * y)), length).rotate(Axis.X, dice.between(15, 45))
        tools.append(mitre.translate((0, 0, 0.9 * length)))
    return cut(part, tools)
