"""Reconstructed parts as aligned text and as JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict

import numpy as np

from sed2cad.evaluation.assembly import AssemblySettings, PartRow
from sed2cad.evaluation.tables import aligned, to_json


def assembly_text(rows: Sequence[PartRow]) -> str:
    """The table, why parts failed, and where on the ladder the solids were found."""
    return "\n\n".join("\n".join(lines) for lines in (_summary(rows), _causes(rows), _rungs(rows)) if lines)


def assembly_json(settings: AssemblySettings, rows: Sequence[PartRow]) -> str:
    """Settings and rows; what there is no number for is null."""
    judged = [
        asdict(row) | {"closed": row.closed, "solved": row.solved, "exact": row.exact, "causes": row.causes}
        for row in rows
    ]
    return to_json({"settings": asdict(settings), "parts": judged})


def _summary(rows: Sequence[PartRow]) -> list[str]:
    """One line; D_h and off_rms are medians of the closed parts, in radii."""
    header = ["parts", "closed", "solved", "exact", "median s", "95 % s", "largest s", "peak MB", "D_h", "off_rms"]
    closed, solved, exact = (sum(held) for held in zip(*((row.closed, row.solved, row.exact) for row in rows)))
    seconds = _known(row.seconds for row in rows)
    scores = [row.score for row in rows if row.score is not None and row.score.closed]
    off = _known(score.hausdorff for score in scores), _known(score.off_rms for score in scores)
    line = [str(len(rows)), *(f"{100 * held / len(rows):.0f} %" for held in (closed, solved, exact))]
    line += [f"{np.quantile(seconds, q):.1f}" for q in (0.5, 0.95, 1.0)]
    line += [f"{_known(row.peak_mb for row in rows).max():.0f}", *(f"{np.median(values):.2e}" for values in off)]
    return aligned([header, line])


def _causes(rows: Sequence[PartRow]) -> list[str]:
    """What parts that are not solved, or solved but not exact, have in common; a part may have several causes."""
    named = [(cause, row.part) for row in rows if not row.solved for cause in row.causes]
    lines = ["not solved", *_counted(named)] if named else []
    typed = [(cause, row.part) for row in rows if row.solved for cause in row.causes]
    lines += ["solved, not exact", *_counted(typed)] if typed else []
    unmerged = [row.part for row in rows if row.score is not None and not row.score.merged]
    lines += [f"scored without merging faces, which the kernel did not survive: {' '.join(unmerged)}"] * bool(unmerged)
    return lines + [f"{row.part}: {row.detail}" for row in rows if row.detail]


def _rungs(rows: Sequence[PartRow]) -> list[str]:
    """How many solids each rung of the ladder gave."""
    found = Counter(row.rung for row in rows if row.rung)
    return ["found as", *(f"{count:4}  {rung}" for rung, count in found.most_common())] if found else []


def _counted(named: Sequence[tuple[str, str]]) -> list[str]:
    """"  2  timeout: part_a part_b", the most frequent first."""
    parts: dict[str, list[str]] = {}
    for name, part in named:
        parts.setdefault(name, []).append(part)
    order = sorted(parts.items(), key=lambda item: (-len(item[1]), item[0]))
    return [f"{len(found):4}  {name}: {' '.join(found)}" for name, found in order]


def _known(values: Iterable[float]) -> np.ndarray:
    """Those that are not NaN; a NaN where none is."""
    some = [value for value in values if value == value]
    return np.array(some or [np.nan])
