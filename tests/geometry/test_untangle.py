"""Corners that a coarse mesh shows wrongly are split or turned over."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from sed2cad.geometry.contact import Side
from sed2cad.geometry.realise import realise
from sed2cad.geometry.untangle import untangled
from sed2cad.geometry.web import Web
from sed2cad.topology.model import Topology
from tests.geometry import parts

RIDGE = 0.6  # of a roof of 35 diagonal: 1.7 %


def roof() -> tuple[parts.Part, int]:
    """A roof with a short ridge, and the chain that the ridge is."""
    part = parts.hip_roof(RIDGE)
    return part, len(part.topology.chains) - 1


def mended(part: parts.Part, topology: Topology) -> Topology:
    return untangled(topology, [Side.of(f) for f in part.fitted], ["crossing"] * len(topology.chains))


def ridge_regions(topology: Topology) -> set[int]:
    """The faces on both sides of the shortest chain."""
    sizes = [np.linalg.norm(c.points[-1] - c.points[0]) for c in topology.chains]
    chain = topology.chains[int(np.argmin(sizes))]
    return {chain.left, chain.right}


def test_the_turn_of_a_corner_is_its_faces_in_order() -> None:
    part = parts.pyramid()
    turn = Web(part.topology).turn(len(part.topology.corners) - 1)
    assert sorted(region for _, region in turn) == [1, 2, 3, 4]
    following = [region for _, region in turn]
    assert all((b - a) % 4 in (1, 3) for a, b in pairwise(following))


def test_splitting_and_contracting_are_inverse() -> None:
    part = parts.pyramid()
    peak = len(part.topology.corners) - 1
    web = Web(part.topology)
    split = web.split(peak, 0, 2, np.zeros(3), np.ones(3))
    assert [len(split.turn(c)) for c in (peak, peak + 1)] == [3, 3]
    back = split.contracted(len(split.chains) - 1)
    assert [region for _, region in back.turn(peak)] == [region for _, region in web.turn(peak)]
    assert [r.loops for r in back.topology().regions] == [r.loops for r in part.topology.regions]


def test_a_corner_of_four_faces_that_do_not_meet_gets_its_ridge() -> None:
    part, ridge = roof()
    merged = Web(part.topology).contracted(ridge).topology()
    found = mended(part, merged)
    assert len(found.chains) == len(part.topology.chains)
    assert ridge_regions(found) == ridge_regions(part.topology)


def test_a_ridge_between_the_wrong_faces_is_turned_over() -> None:
    part, ridge = roof()
    merged = Web(part.topology).contracted(ridge)
    corner = part.topology.chains[ridge].start
    first = [region for _, region in merged.turn(corner)]
    wrong = 0 if {first[0], first[2]} != ridge_regions(part.topology) else 1
    middle = merged.corners[corner]
    apart = merged.direction(merged.turn(corner)[(wrong + 3) % 4][0]) - merged.direction(
        merged.turn(corner)[wrong + 1][0]
    )
    apart = 0.004 * apart / np.linalg.norm(apart)
    crossed = merged.split(corner, wrong, wrong + 2, middle - apart, middle + apart).topology()
    assert ridge_regions(crossed) != ridge_regions(part.topology)
    assert ridge_regions(mended(part, crossed)) == ridge_regions(part.topology)


def test_faces_in_touch_that_leave_no_place_for_their_corners_are_parted() -> None:
    """Two sides under 10 degrees do not meet where the wall between them is narrower than the mesh shows."""
    part = parts.wedge(0.1)
    number = 7  # of the chain between the narrow wall and the top
    chain, sides = part.topology.chains[number], {0, 2}
    merged = Web(part.topology).contracted(number)
    turn = [region for _, region in merged.turn(chain.start)]
    first = next(k for k in (0, 1) if {turn[k], turn[k + 2]} == sides)
    apart = np.array([0.003, 0.0, -0.003]) * (1 if turn[(first + 1) % 4] == 3 else -1)
    middle = merged.corners[chain.start]
    crossed = merged.split(chain.start, first, first + 2, middle - apart, middle + apart).topology()
    assert {crossed.chains[-1].left, crossed.chains[-1].right} == sides
    realised = realise(mended(part, crossed), part.fitted)
    assert (realised.corner_residuals < 1e-9).all()
    assert all(edge is not None and edge.residual < 1e-9 for edge in realised.edges)
    assert {chain.left, chain.right} in [{c.left, c.right} for c in realised.topology.chains]


def test_a_fillet_that_runs_out_early_goes_on_to_the_face_at_its_end() -> None:
    part = parts.filleted_box(1.0)
    front, right, top, fillet = 0, 2, 4, 6
    number = next(k for k, c in enumerate(part.topology.chains) if {c.left, c.right} == {front, fillet})
    merged = Web(part.topology).contracted(number)
    corner = part.topology.chains[number].start
    turn = [region for _, region in merged.turn(corner)]
    first, second = sorted((turn.index(right), turn.index(top)))
    inwards = np.array([0.0, 0.01, 0.0])
    here, there = (inwards, 0 * inwards) if turn[(first + 1) % 4] == fillet else (0 * inwards, inwards)
    middle = merged.corners[corner]
    early = merged.split(corner, first, second, middle + here, middle + there).topology()
    assert {right, top} == {early.chains[-1].left, early.chains[-1].right}
    realised = realise(early, part.fitted)
    assert {front, fillet} in [{c.left, c.right} for c in realised.topology.chains]
    assert {right, top} not in [{c.left, c.right} for c in realised.topology.chains]
    assert (realised.corner_residuals < 1e-9).all()
    assert all(edge is not None and edge.residual < 1e-9 for edge in realised.edges)


def test_what_fits_stays() -> None:
    for part in (parts.pyramid(), parts.box(), parts.hip_roof()):
        assert mended(part, part.topology).chains == part.topology.chains


@pytest.mark.parametrize("wrong", [False, True])
def test_the_solid_of_a_mended_roof_is_exact(wrong: bool) -> None:
    part, ridge = roof()
    merged = Web(part.topology).contracted(ridge).topology()
    realised = realise(merged if wrong else part.topology, part.fitted)
    assert all(edge is not None and edge.residual < 1e-9 for edge in realised.edges)
