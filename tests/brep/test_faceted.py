"""A closed mesh is always a closed solid."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh

from sed2cad.brep.attempt import FacetedAttempt, Options
from sed2cad.brep.build import assemble_faceted
from sed2cad.brep.kernel import edges, faces, from_bytes, is_closed, is_valid, solids
from sed2cad.errors import AssemblyError
from sed2cad.scan.scan import Frame, Mesh


def attempt(mesh: Any, merge: bool = True) -> FacetedAttempt:
    """The mesh in its unit frame."""
    low, high = mesh.bounds
    frame = Frame((low + high) / 2, float(np.linalg.norm(high - low)))
    unit = Mesh(frame.to_unit(np.asarray(mesh.vertices)), np.asarray(mesh.faces, np.int64))
    return FacetedAttempt(unit, frame, unit.vertices, Options(merge_facets=merge))


def test_a_box_of_triangles_becomes_six_faces() -> None:
    result = assemble_faceted(attempt(trimesh.creation.box((30.0, 20.0, 10.0))))
    assert result.gate.passed
    assert result.gate.volume == pytest.approx(6000)
    assert [face.rung for face in result.faces] == ["facets"] * 6
    assert len(edges(from_bytes(result.brep))) == 12


def test_triangles_share_their_edges() -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=5.0)
    result = assemble_faceted(attempt(ball, merge=False))
    solid = from_bytes(result.brep)
    assert result.gate.passed and is_valid(solid) and is_closed(solid)
    assert result.gate.volume == pytest.approx(ball.volume, rel=1e-9)
    assert (len(faces(solid)), len(edges(solid))) == (320, 480)


def test_a_cavity_stays_a_cavity() -> None:
    outer, inner = trimesh.creation.box((10.0, 10.0, 10.0)), trimesh.creation.box((4.0, 4.0, 4.0))
    inner.invert()
    result = assemble_faceted(attempt(trimesh.util.concatenate([outer, inner])))
    assert result.gate.passed
    assert result.gate.volume == pytest.approx(1000 - 64)
    assert len(solids(from_bytes(result.brep))) == 1


def test_bodies_apart_stay_apart() -> None:
    left, right = trimesh.creation.box((1.0, 1.0, 1.0)), trimesh.creation.box((1.0, 1.0, 1.0))
    right.apply_translation((3.0, 0.0, 0.0))
    result = assemble_faceted(attempt(trimesh.util.concatenate([left, right])))
    assert result.gate.passed and result.gate.solids == 2


def test_an_open_mesh_is_an_error() -> None:
    mesh = trimesh.creation.box((1.0, 1.0, 1.0))
    mesh.update_faces(np.arange(len(mesh.faces)) > 0)
    with pytest.raises(AssemblyError, match="not closed"):
        assemble_faceted(attempt(mesh))
