"""Segmentation against clouds whose patches are known."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import sed2cad.segmentation.segment
from sed2cad.primitives.base import Patch
from sed2cad.scan.prepare import prepare
from sed2cad.scan.raw import RawScan
from sed2cad.scan.scan import Frame, Scan
from sed2cad.segmentation.choose import Case, choose
from sed2cad.segmentation.energy import Tolerances, mean_field
from sed2cad.segmentation.graph import neighbour_graph
from sed2cad.segmentation.refine import Refiner, State
from sed2cad.segmentation.segment import UNEVEN, falls_to_pieces, segment
from tests.segmentation.shapes import box, drum, extruded, filleted_drum

Array = NDArray[np.float64]


def scan_of(points: Array, normals: Array, noise: float = 0.0) -> Scan:
    """A scan whose points are in the unit frame already, or nearly."""
    spacing = float(np.sqrt(4.0 / len(points)) / 2)
    return Scan(points, normals, None, Frame(np.zeros(3), 1.0), noise, spacing)


def labels_of(patches: list[Patch], count: int) -> NDArray[np.int64]:
    labels = np.full(count, -1)
    for k, patch in enumerate(patches):
        labels[patch.indices] = k
    return labels


def agreement(found: NDArray[np.int64], true: NDArray[np.int64]) -> float:
    """Mean over the true patches of the best intersection over union."""
    ious = []
    for t in np.unique(true):
        inside = true == t
        ious.append(max((inside & (found == f)).sum() / (inside | (found == f)).sum() for f in np.unique(found)))
    return float(np.mean(ious))


def test_box_has_six_planes() -> None:
    points, normals, face = box((0.7, 0.5, 0.3), 3000)
    patches = segment(scan_of(points, normals), None).patches
    assert [p.kind for p in patches] == ["plane"] * 6
    assert agreement(labels_of(patches, 3000), face) > 0.99


def test_steps_of_a_mesh_lower_than_the_tolerance_are_kept() -> None:
    """A block whose top has a step of a thousandth: the step itself is one of its eight planes."""
    profile = [(0, 0), (1, 0), (1, 0.5), (0.5, 0.5), (0.5, 0.501), (0, 0.501)]
    mesh = extruded(profile, 0.4, [(0, 1, 3), (1, 2, 3), (0, 3, 5), (3, 4, 5)])
    scan = prepare(RawScan(mesh.vertices, None, mesh), 0)
    patches = segment(scan, None).patches
    assert [p.kind for p in patches] == ["plane"] * 8
    sides = {tuple(np.abs(scan.normals[p.indices].mean(axis=0)).round(6)) for p in patches}
    assert sides == {(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)}
    for patch in patches:
        assert len(np.unique(scan.part[patch.indices])) == 1


def test_a_strip_under_a_few_degrees_is_a_face() -> None:
    """Exact normals tell it from the plane beside it; a tolerance that is meant for rough ones does not."""
    drop = 0.04 * np.tan(np.radians(6))
    mesh = extruded([(-0.3, 0), (0.3, 0), (0.3, 0.2 - drop), (0.26, 0.2), (-0.3, 0.2)], 0.3)
    normals, areas = mesh.face_normals()
    rng = np.random.default_rng(0)
    triangle = rng.choice(len(areas), 1200, p=areas / areas.sum())
    points = np.einsum("nk,nkx->nx", rng.dirichlet((1, 1, 1), 1200), mesh.vertices[mesh.faces[triangle]])
    patches = segment(scan_of(points, normals[triangle]), None).patches
    assert [p.kind for p in patches] == ["plane"] * 7


def test_drum_is_a_cylinder_and_two_planes() -> None:
    points, normals, face = drum(0.25, 0.6, 3000)
    patches = segment(scan_of(points, normals), None).patches
    assert sorted(p.kind for p in patches) == ["cylinder", "plane", "plane"]
    assert agreement(labels_of(patches, 3000), face) > 0.99


def test_rim_of_a_thin_plate_is_found() -> None:
    """The four narrow sides of a plate thinner than the distance between its points."""
    points, normals, face = box((0.7, 0.7, 0.012), 4000)
    patches = segment(scan_of(points, normals), None).patches
    assert len(patches) == 6
    assert agreement(labels_of(patches, 4000), face) > 0.95


@pytest.mark.parametrize("seed", [1, 2])
def test_rotation_and_order_do_not_matter(seed: int) -> None:
    points, normals, face = drum(0.25, 0.6, 2000)
    turn = Rotation.random(random_state=seed).as_matrix()
    order = np.random.default_rng(seed).permutation(len(points))
    patches = segment(scan_of(points[order] @ turn.T, normals[order] @ turn.T), None).patches
    assert agreement(labels_of(patches, 2000), face[order]) > 0.99


def test_noise_is_tolerated() -> None:
    points, normals, face = box((0.7, 0.5, 0.3), 4000)
    rng = np.random.default_rng(0)
    noisy = points + normals * rng.normal(0, 3e-3, (len(points), 1))
    patches = segment(scan_of(noisy, normals, noise=3e-3), None).patches
    assert len(patches) == 6
    assert agreement(labels_of(patches, 4000), face) > 0.95


def test_a_fillet_of_a_dense_scan_is_one_face(monkeypatch: pytest.MonkeyPatch) -> None:
    """One point wide for the network, where pieces of it look like planes; four points wide on all points."""
    monkeypatch.setattr(sed2cad.segmentation.segment, "COARSE", 1000)
    points, normals, face = filleted_drum(0.3, 0.3, 0.016, 20_000)
    rng = np.random.default_rng(0)
    noisy = points + normals * rng.normal(0, 1e-3, (len(points), 1))
    turned = normals + rng.normal(0, 0.06, normals.shape)
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    patches = segment(scan_of(noisy, turned, noise=1e-3), None).patches
    assert Counter(patch.kind for patch in patches) == {"plane": 2, "cylinder": 1, "torus": 1}
    assert agreement(labels_of(patches, len(points)), face) > 0.9


def test_a_low_step_separates_parallel_planes() -> None:
    """A small plateau, one and a half spacings high, on a large plane."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.4, 0.4, (4000, 2)), np.zeros(4000)])
    plateau = (np.abs(points[:, :2] - 0.2) < 0.03).all(axis=1)
    points[plateau, 2] = 0.012
    patches = segment(scan_of(points, np.tile([0.0, 0.0, 1.0], (4000, 1))), None).patches
    assert len(patches) == 2
    assert agreement(labels_of(patches, 4000), plateau.astype(np.int64)) > 0.99


def test_every_point_is_in_at_most_one_patch() -> None:
    points, normals, _ = drum(0.25, 0.6, 1500)
    patches = segment(scan_of(points, normals), None).patches
    together = np.concatenate([p.indices for p in patches])
    assert len(np.unique(together)) == len(together)


def test_interior_points_keep_off_the_edges() -> None:
    points, normals, _ = box((0.7, 0.5, 0.3), 3000)
    for patch in segment(scan_of(points, normals), None).patches:
        inner = points[patch.indices[patch.interior]]
        assert 0 < len(inner) < len(patch.indices)


def test_interior_points_of_a_thin_wall_are_no_biased_sample() -> None:
    """Noise takes points of one side nearer to the other side's: they still are inner ones."""
    points, normals, _ = box((0.7, 0.7, 0.02), 6000)
    off = 0.004 * np.random.default_rng(2).standard_normal(len(points))
    patches = segment(scan_of(points + off[:, None] * normals, normals, 0.004), None).patches
    sides = [patch for patch in patches if len(patch.indices) > 2000]
    assert len(sides) == 2
    for side in sides:
        inner = side.indices[side.interior]
        assert abs(off[inner].mean()) < 4 * 0.004 / np.sqrt(len(inner))


def test_mean_field_finds_the_least_energy_of_a_line() -> None:
    """Twelve points on a line, one with a wrong opinion: the neighbours overrule it, the border stays."""
    points = np.column_stack([np.arange(12.0), np.zeros(12), np.zeros(12)])
    graph = neighbour_graph(points, np.tile([0.0, 0.0, 1.0], (12, 1)), spacing=1.0, tolerance=0.1, k=2)
    cost = np.zeros((12, 2))
    cost[:6, 1] = cost[6:, 0] = 1.0
    cost[3] = [0.5, 0.0]
    labels = mean_field(cost, graph.adjacency(), smoothness=0.6)
    assert labels.tolist() == [0] * 6 + [1] * 6


def test_patches_become_freeform_only_where_that_pays_for_its_numbers() -> None:
    """A monkey saddle in two halves is one face, unless the numbers of one that follows it were too dear."""
    rng = np.random.default_rng(0)
    flat = rng.uniform(-0.2, 0.2, (400, 2))
    x, y = flat.T
    saddle = np.column_stack([flat, 8 * (x**3 - 3 * x * y**2)])
    across = np.column_stack([-24 * (x**2 - y**2), 48 * x * y, np.ones(400)])
    across /= np.linalg.norm(across, axis=1)[:, None]
    freeform = choose(Case.of(saddle, across, Tolerances(3e-4), freeform=1.0))
    flat, up = saddle * [1, 1, 0], np.tile([0.0, 0.0, 1.0], (400, 1))
    simple = choose(Case.of(flat, up, Tolerances(3e-4), freeform=1.0))
    assert freeform is not None and freeform.primitive.kind == "bspline"
    assert simple is not None and simple.primitive.kind == "plane"
    assert freeform.price > 3 * simple.price
    graph = neighbour_graph(saddle, across, 0.02, 3e-4)
    refiner = Refiner(saddle, across, graph, Tolerances(3e-4), np.ones(400))
    labels = (flat[:, 0] > 0).astype(np.int64)
    halves = tuple(replace(freeform, price=freeform.price / 2) for _ in range(2))
    assert len(refiner.merge(State(labels, halves)).primitives) == 1
    refiner.apart.clear()
    dear = {key: found and replace(found, price=1e6) for key, found in refiner.chosen.items()}
    refiner.chosen.update(dear)
    assert len(refiner.merge(State(labels, halves)).primitives) == 2


def bore(count: int, centre: tuple[float, float]) -> tuple[Array, Array]:
    """Points in the wall of a narrow bore and their normals, well apart."""
    turn, height = np.linspace(0, 4 * np.pi, count, endpoint=False), np.linspace(-0.01, 0.01, count)
    out = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(count)])
    return np.array([*centre, 0.0]) + 0.007 * out + height[:, None] * np.array([0.0, 0, 1]), -out


def test_the_few_points_of_a_narrow_bore_are_found_across_their_creases() -> None:
    points, normals = bore(8, (0.0, 0.0))
    graph = neighbour_graph(points, normals, 0.004, 3e-4, k=5)
    refiner = Refiner(points, normals, graph, Tolerances(3e-4))
    found = refiner.propose_unexplained(State(np.full(8, -1), ()))
    assert [choice.primitive.kind for choice in found.primitives] == ["cylinder"]
    assert abs(found.primitives[0].primitive.radius - 0.007) < 1e-6  # type: ignore[attr-defined]
    assert (found.labels == 0).all()


def test_points_that_nothing_explains_do_not_join_a_patch_far_away() -> None:
    """Two bores are each other's neighbours where there is nothing else; one of them is known."""
    (first, inward), (second, other) = bore(20, (0.0, 0.0)), bore(6, (0.03, 0.0))
    points, normals = np.vstack([first, second]), np.vstack([inward, other])
    graph = neighbour_graph(points, normals, 0.004, 3e-4, k=18)
    refiner = Refiner(points, normals, graph, Tolerances(3e-4))
    known = choose(Case.of(first, inward, Tolerances(3e-4)))
    assert known is not None
    labels = refiner.relabel(State(np.repeat([0, -1], [20, 6]), (known,)), final=True).labels
    assert (labels[:20] == 0).all() and (labels[20:] == -1).all()


def test_graph_does_not_cross_a_thin_wall() -> None:
    points, normals, _ = box((0.7, 0.7, 0.005), 2000)
    graph = neighbour_graph(points, normals, spacing=0.01, tolerance=3e-4)
    i, j = graph.pairs.T
    assert (np.einsum("ij,ij->i", normals[i], normals[j]) > -0.5).all()


def test_a_surface_more_uneven_than_its_noise_gets_the_faces_that_are_meant(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sed2cad.segmentation.segment, "MANY", 40)  # of few points
    points, normals, face = box((0.6, 0.5, 0.4), 1500)
    waves = np.sin(points @ np.array([[40.0, 25, 11], [14, 45, 26], [33, -29, 37]]).T)
    lumpy = points + 4e-3 * waves.sum(axis=1)[:, None] * normals
    assert segment(scan_of(lumpy, normals), None).scan.noise == 0  # made by a computer: every lump is meant
    found = segment(scan_of(lumpy, normals, 1e-4), None)
    assert found.scan.noise == UNEVEN
    large = [patch for patch in found.patches if len(patch.indices) > 60]
    assert len(large) == 6
    assert all(np.mean(face[patch.indices] == np.bincount(face[patch.indices]).argmax()) > 0.95 for patch in large)


def test_a_few_uneven_plates_are_as_many_planes() -> None:
    """No edge parts the pieces that each falls to."""
    rng = np.random.default_rng(0)
    low = np.array([[0.0, 0, 0.3], [-0.4, 0, 0], [0.5, 0, 0]])
    plate = np.repeat([0, 1, 2], [1500, 900, 600])
    points = low[plate] + rng.random((3000, 3)) * np.array([[0.4, 0.4, 0], [0.3, 0.4, 0], [0.2, 0.4, 0]])[plate]
    waves = np.sin(points[:, :2] @ np.array([[19.0, 5], [7, 16]]))
    points[:, 2] += 2e-3 * waves.sum(axis=1) + 4e-4 * rng.standard_normal(3000)
    scan = prepare(RawScan(points, name="plates"), 0)
    found = segment(scan, None)
    assert found.scan.noise == UNEVEN
    assert sorted(len(patch.indices) for patch in found.patches) == [600, 900, 1500]
    assert len(segment(scan, None, most=scan.noise).patches) > 6


def test_many_machined_faces_are_no_unevenness() -> None:
    assert not falls_to_pieces(["plane"] * 160 + ["cylinder"] * 70 + ["torus"] * 40)
    assert not falls_to_pieces(["bspline"] * 40)
    assert falls_to_pieces(["plane"] * 100 + ["cone", "torus", "sphere"] * 30)
