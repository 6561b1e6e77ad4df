from dataclasses import fields

import numpy as np
import pytest

from sed2cad.network.types import BSPLINE, CONE, CYLINDER, PLANE, SPHERE, TORUS
from sed2cad.training.cad import label_part
from sed2cad.training.labelled_part import LabelledPart
from tests.training.cadparts import as_splines, write


def solid(name):
    """A part of 10 units about the origin whose curved faces are of the named type."""
    from build123d import Box, Cone, Cylinder, Sphere, Torus

    return {
        "box": lambda: Box(10, 10, 10),
        "cylinder": lambda: Cylinder(5, 10),
        "cone": lambda: Cone(5, 2, 10),
        "sphere": lambda: Sphere(5),
        "torus": lambda: Torus(4, 1),
    }[name]()


def errors(name, points, normals):
    """Distance (n,) and turn (n,) from the truth of the curved points of `solid`, unit frame."""
    x, y, z = points.T.astype(float)
    rho = np.hypot(x, y)
    radial = np.column_stack([x / rho, y / rho, 0 * x])
    up = np.array([0.0, 0, 1])
    if name == "cylinder":
        off, true = rho - 0.5, radial
    elif name == "cone":  # radius 0.5 at z = -0.5, 0.2 at 0.5
        across = np.array([1.0, 0.3]) / np.hypot(1, 0.3)
        off, true = (rho - (0.35 - 0.3 * z)) * across[0], across[0] * radial + across[1] * up
    elif name == "sphere":
        size = np.linalg.norm(points.astype(float), axis=1)
        off, true = size - 0.5, points / size[:, None]
    else:
        tube = np.column_stack([rho - 0.4, z])
        size = np.linalg.norm(tube, axis=1)
        off, true = size - 0.1, (tube[:, :1] * radial + tube[:, 1:] * up) / size[:, None]
    return abs(off), np.linalg.norm(normals - true, axis=1)


CURVED = {"cylinder": CYLINDER, "cone": CONE, "sphere": SPHERE, "torus": TORUS}


@pytest.mark.parametrize("name", CURVED)
@pytest.mark.parametrize("spline", [False, True])
def test_points_are_exact_and_disguised_surfaces_are_recognised(tmp_path, name, spline):
    shape = as_splines(solid(name)) if spline else solid(name)
    part = label_part(write(shape, tmp_path / "part.brep"))
    cloud = part.sample(np.random.default_rng(0), 3_000)
    curved = cloud.type != PLANE
    assert set(cloud.type[curved]) == {CURVED[name]}
    assert part.disguised.all() == spline
    # The unit frame is that of the mesh, which is a little smaller than the part.
    main = part.type.tolist().index(CURVED[name])
    scale = {"sphere": 0.5, "torus": 0.4}.get(name, part.radii[main, 0]) / part.radii[main, 0]
    centre = part.origin[main] * ([1, 1, 1] if name in ("sphere", "torus") else [1, 1, 0])
    assert scale == pytest.approx(1, abs=2e-3)
    assert abs(centre).max() < 1e-3
    points = (cloud.points[curved] - centre) * scale
    off, turn = errors(name, points, cloud.normals[curved])
    assert off.max() < 1e-6
    assert turn.max() < 1e-5
    flat = cloud.points[~curved]
    np.testing.assert_allclose(abs(flat[:, 2]), 0.5, atol=1e-6)
    np.testing.assert_allclose(cloud.normals[~curved], np.sign(flat[:, 2:]) * [0, 0, 1], atol=1e-6)
    assert np.einsum("ij,ij->i", cloud.facet_normals, cloud.normals).min() > 0.9


def test_box(tmp_path):
    cloud = label_part(write(solid("box"), tmp_path / "box.step")).sample(np.random.default_rng(0), 2_000)
    assert set(cloud.patch) == set(range(6))
    side = abs(cloud.points).argmax(1)
    rows = np.arange(2_000)
    np.testing.assert_allclose(abs(cloud.points[rows, side]), 0.5, atol=1e-7)
    np.testing.assert_allclose(cloud.normals[rows, side], np.sign(cloud.points[rows, side]), atol=1e-7)


def test_freeform_points_are_near_the_true_surface(tmp_path):
    """A loft between a circle and an ellipse is a closed B-spline; elliptic sections between."""
    from build123d import Circle, Ellipse, Plane, loft

    shape = loft([Circle(5).face(), (Plane.XY.offset(10) * Ellipse(5, 2.5)).face()])
    part = label_part(write(shape, tmp_path / "loft.brep"))
    cloud = part.sample(np.random.default_rng(0), 3_000)
    x, y, z = cloud.points.T
    wall = cloud.type == BSPLINE
    half = 0.5 - 0.25 * (z + 0.5)
    ratio = np.sqrt((x / 0.5) ** 2 + (y / half) ** 2)[wall]
    assert wall.mean() > 0.5
    assert cloud.closed[wall].all()
    assert not cloud.closed[~wall].any()
    assert abs(ratio - 1).max() * 0.5 < 2e-4
    outward = np.column_stack([x / 0.25, y / half**2])[wall]
    assert np.einsum("ij,ij->i", outward, cloud.normals[wall, :2]).min() > 0


def test_faces_of_one_surface_are_one_patch(tmp_path):
    """Every face of a rod cut in two halves lies on one of three surfaces, also when the file has B-splines."""
    from build123d import Align, Box, Compound, Cylinder, Solid
    from OCP.BOPAlgo import BOPAlgo_Builder

    builder = BOPAlgo_Builder()
    for side in (Align.MIN, Align.MAX):
        half = Cylinder(5, 10) & Box(20, 20, 20, align=(side, Align.CENTER, Align.CENTER))
        builder.AddArgument(Solid(half.solid().wrapped).wrapped)
    builder.Perform()
    for shape in (Compound(builder.Shape()), as_splines(Compound(builder.Shape()))):
        part = label_part(write(shape, tmp_path / "halves.brep"))
        assert len(part.type) > 6
        assert len(set(part.patch[part.type == CYLINDER])) == 1
        assert len(set(part.patch)) < len(part.type) - 2
        assert set(part.type) == {PLANE, CYLINDER}


def test_round_trip_and_size(tmp_path):
    part = label_part(write(solid("torus"), tmp_path / "torus.brep"))
    part.save(tmp_path / "torus.npz")
    assert (tmp_path / "torus.npz").stat().st_size < 80_000
    loaded = LabelledPart.load(tmp_path / "torus.npz")
    for field in fields(part):
        np.testing.assert_array_equal(getattr(part, field.name), getattr(loaded, field.name))
    a, b = (p.sample(np.random.default_rng(3), 500) for p in (part, loaded))
    np.testing.assert_array_equal(a.points, b.points)


def test_only_the_labelled_points_get_their_distance(tmp_path):
    part = label_part(write(solid("box"), tmp_path / "box.brep"))
    some, whole = (part.sample(np.random.default_rng(0), 600, labelled) for labelled in (200, None))
    np.testing.assert_array_equal(some.edge_distance[:200], whole.edge_distance[:200])
    assert (some.edge_distance[200:] > 0.099).all()
