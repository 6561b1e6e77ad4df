"""What the surfaces of a part are called."""

from __future__ import annotations

from collections.abc import Sequence

from sed2cad.primitives.base import FittedPatch


def primitive_names(fitted: Sequence[FittedPatch]) -> tuple[str, ...]:
    """plane_1, plane_2, cylinder_1, ...: numbered in order within each kind."""
    count: dict[str, int] = {}
    names = []
    for patch in fitted:
        kind = patch.primitive.kind
        count[kind] = count.get(kind, 0) + 1
        names.append(f"{kind}_{count[kind]}")
    return tuple(names)
