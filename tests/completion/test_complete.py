"""Gaps are found, and closed by what the faces around them say."""

from __future__ import annotations

import numpy as np
import pytest

from sed2cad.completion.caps import flat_caps
from sed2cad.completion.complete import Completed, complete
from sed2cad.completion.extensions import is_sure, samples_in_ball
from sed2cad.completion.gaps import Gap, find_gaps, joined
from sed2cad.primitives.base import FittedPatch, Patch, Primitive
from sed2cad.primitives.bspline_fit import fit_over_plane
from sed2cad.primitives.cylinder import Cylinder
from sed2cad.primitives.plane import Plane
from sed2cad.primitives.refine import uncertainty
from sed2cad.primitives.sphere import Sphere
from sed2cad.primitives.vectors import unit
from sed2cad.scan.scan import Frame, Mesh, Scan
from sed2cad.topology.proxy import divided, proxy_mesh, welded
from tests.completion.scans import on_a_table, seen
from tests.topology.scans import Piece, box, box_mesh, box_with_hole, ring, scan_of, sphere, stacked_cylinder, wall

Z = np.array([0.0, 0.0, 1.0])
ROUND = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]


def cap_of(found: Completed) -> Plane:
    """The plane of the only cap."""
    (index,) = found.caps
    plane = found.fitted[index].primitive
    assert isinstance(plane, Plane)
    return plane


def gaps_of(scan: Scan, mesh: Mesh) -> list[Gap]:
    return joined(find_gaps(scan, mesh))


def added(found: Completed) -> np.ndarray:
    return found.scan.points[len(found.measured) :]


@pytest.mark.parametrize("surface", [Plane(Z, 0.1), Sphere(np.zeros(3), 0.3), Cylinder(Z, np.zeros(3), 0.2)])
def test_samples_cover_the_surface_in_the_ball(surface: Primitive) -> None:
    centre, radius, spacing = np.array([0.1, 0.2, 0.05]), 0.35, 0.02
    points = samples_in_ball(surface, centre, radius, spacing)
    assert np.abs(surface.distance(points)).max() < 1e-9
    assert np.linalg.norm(points - centre, axis=1).max() <= radius
    anywhere = centre + radius * np.random.default_rng(0).uniform(-1, 1, (2000, 3))
    feet = surface.project(anywhere)
    feet = feet[np.linalg.norm(feet - centre, axis=1) < radius - spacing]
    nearest = np.linalg.norm(feet[:, None] - points[None], axis=2).min(axis=1)
    assert nearest.max() < 1.5 * spacing


@pytest.mark.parametrize("pieces", [box(), box_with_hole(), stacked_cylinder(), sphere()])
def test_a_scan_that_shows_all_is_left_alone(pieces: list) -> None:
    scan, fitted = scan_of(pieces)
    found = complete(scan, fitted)
    assert found.scan is scan and not found.caps and not found.added and found.proxy is not None
    assert str(found) == "the scan shows all of the part"


def test_a_closed_mesh_has_no_gaps() -> None:
    scan, fitted = scan_of(box(), count=600)
    mesh = box_mesh((0.7, 0.5, 0.4))
    found = complete(type(scan)(scan.points, scan.normals, mesh, scan.frame, 0.0, scan.spacing), fitted)
    assert found.proxy is not None and not found.added


def test_a_proxy_coarser_than_the_points_does_not_make_all_of_it_a_gap() -> None:
    scan, fitted = scan_of(box(), 40_000)
    scan, fitted = seen(scan, fitted, np.linalg.norm(scan.points - [0.0, 0.0, 0.2], axis=1) > 0.17)
    (gap,) = gaps_of(scan, divided(welded(box_mesh((0.7, 0.5, 0.4))), 0.03))
    assert gap.centre == pytest.approx([0.0, 0.0, 0.2], abs=0.03) and 0.15 < gap.radius < 0.2


@pytest.mark.parametrize("turn", [np.eye(3), ROUND])
def test_a_part_on_a_table_has_one_gap_and_one_cap(turn: np.ndarray) -> None:
    scan, fitted = on_a_table(*scan_of(box()))
    scan = type(scan)(scan.points @ turn.T, scan.normals @ turn.T, None, scan.frame, 0.0, scan.spacing)
    fitted = [
        type(patch)(patch.patch, Plane(turn @ patch.primitive.normal_vector, patch.primitive.offset), 1, 0.0,
                    patch.covariance)
        for patch in fitted
    ]
    (gap,) = gaps_of(scan, proxy_mesh(scan, fitted))
    assert gap.centre == pytest.approx(turn @ [0, 0, -0.2], abs=0.02)
    assert gap.radius == pytest.approx(np.hypot(0.35, 0.25), abs=0.03)
    assert gap.outwards == pytest.approx(turn @ -Z, abs=0.05)
    found = complete(scan, fitted)
    assert cap_of(found).normal_vector == pytest.approx(turn @ -Z, abs=1e-6)
    assert cap_of(found).offset == pytest.approx(0.2, abs=0.01)
    own = added(found)[found.fitted[found.caps[0]].patch.indices - len(found.measured)] @ turn
    assert (np.abs(own) - [0.35, 0.25, 0.2]).max() < 1.5 * gap.spacing
    assert (found.measured == scan.points).all()
    assert str(found) == "faces were extended and 1 flat cap was added"


def test_a_bore_that_the_scan_shows_goes_through_the_cap() -> None:
    scan, fitted = on_a_table(*scan_of(box_with_hole(), 8000))
    found = complete(scan, fitted)
    own = added(found)[found.fitted[found.caps[0]].patch.indices - len(found.measured)]
    assert np.linalg.norm(own[:, :2], axis=1).min() > 0.11


def test_a_pocket_ends_at_the_last_points_of_its_wall() -> None:
    """The floor looks up, and the wall is above it."""
    pieces = [*box()[:-1], wall(0.12, -0.05, 0.2, -1), ring(0.12, 0.2, 0.2, 1)]
    scan, fitted = scan_of(pieces, 8000)
    top = fitted[-1].primitive
    around = np.random.default_rng(0).uniform(-0.5, 0.5, (1500, 2)) * [0.7, 0.5]
    around = around[np.linalg.norm(around, axis=1) > 0.2]
    assert isinstance(top, Plane)
    more = np.column_stack([around, np.full(len(around), 0.2)])
    points = np.vstack([scan.points, more])
    normals = np.vstack([scan.normals, np.broadcast_to(Z, more.shape)])
    rim = fitted[-1].patch
    indices = np.concatenate([rim.indices, len(scan.points) + np.arange(len(more))])
    fitted[-1] = type(fitted[-1])(
        type(rim)(indices, "plane", np.ones(len(indices), bool)), top, 1, 0.0, fitted[-1].covariance
    )
    scan = type(scan)(points, normals, None, scan.frame, 0.0, scan.spacing)
    found = complete(scan, fitted)
    assert cap_of(found).normal_vector == pytest.approx(Z, abs=1e-6)
    assert cap_of(found).offset == pytest.approx(-0.05, abs=0.01)


def test_planes_go_on_to_their_common_corner() -> None:
    scan, fitted = scan_of(box(), 8000)
    corner = np.array([0.35, 0.25, 0.2])
    scan, fitted = seen(scan, fitted, np.linalg.norm(scan.points - corner, axis=1) > 0.15)
    found = complete(scan, fitted)
    assert not found.caps and str(found) == "faces were extended"
    assert np.linalg.norm(added(found) - corner, axis=1).min() < 0.03
    outside = (np.abs(added(found)) - [0.35, 0.25, 0.2]).max(axis=1)
    assert outside.min() == pytest.approx(0, abs=1e-9)  # all are on planes of the box
    assert outside.max() < 0.012  # and none a sample beyond their edges


def test_half_a_cylinder_is_turned_about_its_axis_not_cut_flat() -> None:
    scan, fitted = scan_of(stacked_cylinder(), 8000)
    high = scan.points[:, 2] > 0.02
    side = high & (scan.points[:, 0] < 0) & (np.abs(scan.normals[:, 2]) < 0.5)
    scan, fitted = seen(scan, fitted, ~side)
    found = complete(scan, fitted)
    assert not found.caps
    more = added(found)
    behind = more[(more[:, 0] < -0.1) & (more[:, 2] > 0.05) & (more[:, 2] < 0.28)]
    assert len(behind) > 50
    assert np.linalg.norm(behind[:, :2], axis=1) == pytest.approx(0.2, abs=1e-6)


def test_a_tangent_plane_of_the_rim_of_a_ball_is_no_cap() -> None:
    """A sphere seen from above closes itself: nothing flat is needed."""
    scan, fitted = scan_of(sphere(), 6000)
    scan, fitted = seen(scan, fitted, scan.points[:, 2] > -0.15)
    found = complete(scan, fitted)
    assert not found.caps
    assert added(found)[:, 2].min() < -0.28


def test_caps_hold_the_rim_on_the_side_of_the_scan() -> None:
    scan, fitted = on_a_table(*scan_of(box()))
    (gap,) = gaps_of(scan, proxy_mesh(scan, fitted))
    (cap,) = flat_caps(scan, gap, fitted)
    assert cap.side == -1
    assert cap.is_within(scan.points, 1e-3).mean() > 0.99
    assert not cap.is_within(np.array([[0.0, 0.0, -0.3]]), 1e-3).any()


def test_a_disc_is_capped_where_its_wall_ends() -> None:
    """A wall that goes on needs a bottom too: chords across it are on no surface."""
    scan, fitted = on_a_table(*scan_of([ring(0, 0.35, -0.1, -1), wall(0.35, -0.1, 0.1), ring(0, 0.35, 0.1, 1)], 8000))
    found = complete(scan, fitted)
    assert cap_of(found).offset == pytest.approx(0.1, abs=0.01)
    assert added(found)[:, 2].min() > -0.11


@pytest.mark.parametrize("holes", [1, 6])
def test_the_cap_of_a_large_gap_is_whole(holes: int) -> None:
    """A coarse cut among many surfaces says only where finer ones look."""
    at = 0.22 * np.column_stack([np.cos(np.arange(holes)), np.sin(np.arange(holes))])
    low, high = ring(0, 0.35, -0.1, -1), ring(0, 0.35, 0.1, 1)
    bores = [_moved(wall(0.06, -0.1, 0.1, -1), x, y) for x, y in at]
    scan, fitted = scan_of([low, wall(0.35, -0.1, 0.1), high, *bores], 12_000)
    far = (np.linalg.norm(scan.points[:, None, :2] - at, axis=2) > 0.06 - 1e-9).all(axis=1)
    scan, fitted = on_a_table(*seen(scan, fitted, far))
    found = complete(scan, fitted)
    own = added(found)[found.fitted[found.caps[0]].patch.indices - len(found.measured)]
    ways = np.random.default_rng(0).uniform(-0.33, 0.33, (4000, 2))
    ways = ways[np.linalg.norm(ways, axis=1) < 0.33]
    ways = ways[(np.linalg.norm(ways[:, None] - at, axis=2) > 0.08).all(axis=1)]
    off = np.linalg.norm(ways[:, None] - own[None, :, :2], axis=2).min(axis=1)
    assert off.max() < 0.03
    assert np.linalg.norm(own[:, None, :2] - at, axis=2).min() > 0.05


def test_a_screw_seen_from_above_gets_the_underside_of_its_head() -> None:
    """The plane there ends the head, not the shank."""
    shank = [wall(0.15, -0.3, 0.1), ring(0, 0.15, -0.3, -1)]
    head = [ring(0.15, 0.35, 0.1, -1), wall(0.35, 0.1, 0.25), ring(0, 0.35, 0.25, 1)]
    scan, fitted = scan_of([*shank, *head], 10_000)
    hidden = (scan.normals[:, 2] < -0.9) | ((scan.points[:, 2] < 0.1) & (scan.points[:, 2] > 0.02))
    found = complete(*seen(scan, fitted, ~hidden))
    offsets = [found.fitted[k].primitive.parameters()["offset"] for k in found.caps]
    assert sorted(offsets) == pytest.approx([-0.1, 0.3], abs=0.01)
    distance = np.abs(np.stack([patch.primitive.distance(added(found)) for patch in found.fitted])).min(axis=0)
    assert distance.max() < 1e-9


def test_the_unseen_side_of_a_plate_is_a_gap_though_the_other_is_near() -> None:
    scan, fitted = on_a_table(*scan_of(box((0.7, 0.5, 0.02)), 5000))
    assert cap_of(complete(scan, fitted)).offset == pytest.approx(0.01, abs=0.003)


def _moved(piece: Piece, x: float, y: float) -> Piece:
    """A wall around another axis."""
    surface, sign, area, sampler = piece
    assert isinstance(surface, Cylinder)
    moved = Cylinder(Z, np.array([x, y, 0.0]), surface.radius)
    return moved, sign, area, lambda rng, count: np.add(sampler(rng, count), [x, y, 0.0])


def test_a_surface_is_sure_where_its_points_tell_it() -> None:
    """From a strip a plane is sure along it, and unsure far across it."""
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (400, 3)) * [0.6, 0.02, 0.0]
    fitted = scan_of([(Plane(Z, 0.0), 1, 1.0, lambda rng, count: points)])[1][0]
    told = uncertainty(Plane(Z, 0.0), points, 1e-4).covariance
    patch = type(fitted)(fitted.patch, fitted.primitive, 1, 0.0, told)
    probes = np.array([[0.0, 0.0, 0.0], [0.6, 0.0, 0.0], [0.0, 0.05, 0.0], [0.0, 0.3, 0.0]])
    assert is_sure(patch, probes, points).tolist() == [True, True, True, False]


def test_a_gap_that_nothing_closes_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """No freeform face goes on."""
    monkeypatch.setattr("sed2cad.completion.complete.flat_caps", lambda *scan_gap_and_patches: [])
    rng = np.random.default_rng(0)
    flat = rng.uniform(-0.35, 0.35, (6000, 2))
    height = 0.08 * np.sin(9 * flat[:, 0]) * np.cos(7 * flat[:, 1])
    slopes = 0.08 * np.column_stack(
        [9 * np.cos(9 * flat[:, 0]) * np.cos(7 * flat[:, 1]), -7 * np.sin(9 * flat[:, 0]) * np.sin(7 * flat[:, 1])]
    )
    points, normals = np.column_stack([flat, height]), unit(np.column_stack([-slopes, np.ones(len(flat))]))
    scan = Scan(points, normals, None, Frame(np.zeros(3), 1.0), 0.0, 0.005)
    surface = fit_over_plane(points, normals, 0.0)
    assert surface is not None
    patch = FittedPatch(Patch(np.arange(6000), "bspline", np.ones(6000, bool)), surface, 1, 0.0, np.zeros((0, 0)))
    found = complete(scan, [patch])
    assert found.unclosed == 1 and not found.added and "1 gap was only bridged" in str(found)
