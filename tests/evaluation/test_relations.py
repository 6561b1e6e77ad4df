"""Relations between the faces of a part that is known exactly."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sed2cad.evaluation.relations import (
    RELATIONS,
    TRUE,
    Axes,
    RelationCounts,
    count,
    evaluate_relations,
    relations_text,
    score_relations,
    total,
)
from sed2cad.training.cad import label_part
from tests.training.cadparts import plate_with_holes, write

NAN = np.full(3, np.nan)


def test_pairs_are_told_by_their_numbers() -> None:
    """Two coaxial cylinders of one radius, a third beside them that is larger, a plane across, a sphere."""
    x, y = np.eye(3)[:2]
    axes = Axes(
        np.array([x, -x, x, y, NAN]),
        np.array([0 * x, 5 * x, y, NAN, y]),
        np.array([1.0, 1.0, 2.0, np.nan, 1.0]),
    )
    held = {name: [tuple(pair) for pair in np.argwhere(so)] for name, (_, so) in axes.pairs(TRUE).items()}
    assert held == {
        "parallel": [(0, 1), (0, 2), (1, 2)],
        "perpendicular": [(0, 3), (1, 3), (2, 3)],
        "coaxial": [(0, 1)],
        "equal radius": [(0, 1), (0, 4), (1, 4)],
    }
    able = {name: int(pairs.sum()) for name, (pairs, _) in axes.pairs(TRUE).items()}
    assert able == {"parallel": 6, "perpendicular": 6, "coaxial": 3, "equal radius": 6}


def test_what_is_found_and_what_is_made_up_are_counted() -> None:
    able = np.triu(np.ones((3, 3), bool), 1)
    true, made = np.zeros((3, 3), bool), np.zeros((3, 3), bool)
    true[0, 1] = true[0, 2] = made[0, 1] = made[1, 2] = True
    row = count("parallel", 1, able, true, made)
    assert row == RelationCounts("parallel", 1, true=2, found=1, false=1, others=1)
    assert total([[row], [row]]) == [RelationCounts("parallel", 1, 4, 2, 2, 2)]
    assert relations_text([row]).splitlines()[1].split()[-4:] == ["1", "1", "100.00", "%"]


@pytest.fixture(scope="module")
def part(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("relations")
    label_part(write(plate_with_holes(), folder / "plate.step")).save(folder / "plate.npz")
    return folder / "plate.npz"


def test_a_noisy_plate_comes_out_square(part: Path) -> None:
    rows = score_relations(part)
    assert [row.relation for row in rows] == 2 * list(RELATIONS)
    assert all(row.found == row.true > 0 for row in rows if row.relation in ("parallel", "perpendicular"))
    assert sum(row.false for row in rows) == 0
    assert evaluate_relations([part]) == rows
