"""The results of `sed2cad evaluate fitting` as text and as JSON, and which targets hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np

from sed2cad.evaluation.choice import DISTINGUISHABLE, ChoiceScores
from sed2cad.evaluation.fitting import CellScores, FittingResult
from sed2cad.evaluation.relations import relations_text
from sed2cad.evaluation.spline_patches import CLOSE, spline_patches_text
from sed2cad.evaluation.tables import aligned, to_json
from sed2cad.primitives.registry import ANALYTIC_KINDS

_PART_SECONDS = 2.0
_SPLINE_RESIDUAL = 0.3  # of the noise, at so many points:
_SPLINE_POINTS = 5000
_RIGHT = 0.98
_KEPT, _MADE_UP = 0.95, 0.005  # of pairs of faces
_LIMITS = ((0.0, 1.2, 2.0), (0.2, 1.5, 3.0))  # outliers, median, 95th percentile
_BINS = (5.0, 7.0, 10.0, 20.0, float("inf"))  # sigma


@dataclass(frozen=True)
class Target:
    """A figure to be reached."""

    name: str
    value: float
    limit: float
    at_least: bool = False

    @property
    def held(self) -> bool:
        return self.value >= self.limit if self.at_least else self.value <= self.limit


def fitting_text(result: FittingResult) -> str:
    """The tables: parameters, choices, B-splines, worst cells, targets."""
    parts = [_parameters(result.cells), _choices(result.choices), _near(result.ladder), _splines(result)]
    parts += [[spline_patches_text(result.spline_patches)]] if result.spline_patches else []
    parts += [[relations_text(result.relations)]] if result.relations else []
    parts += [_worst(result.cells), _targets(result)]
    seeds = f"{result.settings.seeds} seeds a cell, {result.settings.few_seeds} of choices and B-splines"
    return "\n\n".join("\n".join(lines) for lines in parts) + f"\n\n{seeds}; {result.seconds:.0f} s"


def fitting_json(result: FittingResult) -> str:
    """Settings, targets and every row; what there is no number for is null."""
    content = asdict(result)
    content["targets"] = [{**asdict(target), "held": target.held} for target in targets(result)]
    return to_json(content)


def targets(result: FittingResult) -> list[Target]:
    """What the fits must reach, for each kind."""
    found = []
    for kind in ANALYTIC_KINDS:
        for outliers, median, high in _LIMITS:
            ratios = _ratios([row for row in result.cells if row.cell.shape == kind and row.cell.outliers == outliers])
            if ratios.size:
                name = f"{kind}, {100 * outliers:.0f} % outliers: error / bound, "
                found.append(Target(name + "median", float(np.median(ratios)), median))
                found.append(Target(name + "95 %", float(np.quantile(ratios, 0.95)), high))
    for name, choices in (("", result.choices), (" near the limit", result.ladder)):
        found.append(Target("kinds chosen right" + name, _share(_distinct(choices)), _RIGHT, at_least=True))
    clean = [row for row in result.splines if row.cell.count >= _SPLINE_POINTS and row.cell.outliers == 0]
    worst = max((row.residual for row in clean), default=float("nan"))
    found.append(Target("B-spline: residual / noise at 5,000 points, worst cell", worst, _SPLINE_RESIDUAL))
    near = [row.rms for row in result.spline_patches]
    median, high = np.quantile(near, (0.5, 0.95), method="higher") if near else (np.nan, np.nan)
    found.append(Target("B-spline patches of parts without noise: rms / size, median", float(median), CLOSE))
    found.append(Target("B-spline patches of parts without noise: rms / size, 95 %", float(high), CLOSE))
    for row in (row for row in result.relations if row.true):
        name = f"{row.relation}, faces of {row.points}+ points: "
        found.append(Target(name + "true pairs made exactly so", row.found / row.true, _KEPT, at_least=True))
        found.append(Target(name + "other pairs made so", row.false / max(row.others, 1), _MADE_UP))
    found.append(Target("seconds for a part of 40 faces", result.part_seconds, _PART_SECONDS))
    return [target for target in found if target.value == target.value]


def _parameters(cells: Sequence[CellScores]) -> list[str]:
    """Errors over the bound, over the cells and chart parameters of a kind; attainable: of maximum likelihood."""
    header = ["kind", "outliers", "cells", "median", "95 %", "worst", "attainable", "95 %"]
    rows = [[*header, "honesty", "95 %", "inside 95 %", "ms"]]
    for kind, outliers in dict.fromkeys((row.cell.shape, row.cell.outliers) for row in cells):
        some = [row for row in cells if (row.cell.shape, row.cell.outliers) == (kind, outliers)]
        ratios, honesty = _ratios(some), [row.honesty for row in some]
        best = np.array([ratio for row in some for ratio in row.attainable])
        figures = [np.median(ratios), np.quantile(ratios, 0.95), ratios.max(), np.median(best), np.quantile(best, 0.95)]
        figures += [np.median(honesty), np.quantile(honesty, 0.95), np.mean([row.inside for row in some])]
        seconds = np.mean([row.seconds for row in some])
        rows.append([kind, f"{100 * outliers:.0f} %", str(len(some)), *map(_short, figures), f"{1000 * seconds:.1f}"])
    return aligned(rows)


def _choices(choices: Sequence[ChoiceScores]) -> list[str]:
    """The choice between all kinds over the same cells without outliers."""
    rows = [["chosen", "told apart", "right", "share", "else"]]
    for kind in dict.fromkeys(row.kind for row in choices):
        some = _distinct([row for row in choices if row.kind == kind])
        right, total = sum(row.right for row in some), sum(row.total for row in some)
        rows.append([kind, str(total), str(right), _percent(_share(some)), _instead(some)])
    return aligned(rows)


def _near(ladder: Sequence[ChoiceScores]) -> list[str]:
    """Share of right choices by the sigma that distinguish the kind from a simpler one."""
    rows = [["near the limit", *(f"{low:g}-{high:g} sigma" for low, high in pairwise(_BINS))]]
    for kind, case in dict.fromkeys((row.kind, row.case) for row in ladder):
        for count in dict.fromkeys(row.count for row in ladder):
            same = [row for row in ladder if (row.kind, row.case, row.count) == (kind, case, count)]
            bins = [[row for row in same if low <= row.strength < high] for low, high in pairwise(_BINS)]
            rows.append([f"{kind}, {case}, {count} points", *(_percent(_share(found)) for found in bins)])
    return aligned(rows)


def _splines(result: FittingResult) -> list[str]:
    rows = [["B-spline", "noise", "points", "outliers", "residual / noise", "worst seed", "ms"]]
    for row in result.splines:
        cell = row.cell
        place = [cell.shape, f"{100 * cell.noise:g} %", str(cell.count), f"{100 * cell.outliers:.0f} %"]
        rows.append([*place, _short(row.residual), _short(row.worst), f"{1000 * row.seconds:.0f}"])
    return aligned(rows)


def _worst(cells: Sequence[CellScores]) -> list[str]:
    """The cells farthest from the bound."""
    rows = [["worst cells", "noise", "points", "degrees", "outliers", "error / bound", "attainable"]]
    for row in sorted(cells, key=lambda row: -max(row.ratios))[:8]:
        cell = row.cell
        place = [cell.shape, f"{100 * cell.noise:g} %", str(cell.count), f"{cell.coverage:g}"]
        rows.append([*place, f"{100 * cell.outliers:.0f} %", _short(max(row.ratios)), _short(max(row.attainable))])
    return aligned(rows)


def _targets(result: FittingResult) -> list[str]:
    rows = [["target", "value", "limit", ""]]
    for target in targets(result):
        limit = f"{'>=' if target.at_least else '<='} {target.limit:g}"
        value = f"{target.value:.3f}" if target.limit > 0.01 else f"{target.value:.1e}"
        rows.append([target.name, value, limit, "held" if target.held else "MISSED"])
    return aligned(rows)


def _ratios(rows: Sequence[CellScores]) -> np.ndarray:
    return np.array([ratio for row in rows for ratio in row.ratios])


def _distinct(rows: Sequence[ChoiceScores]) -> list[ChoiceScores]:
    return [row for row in rows if row.strength > DISTINGUISHABLE]


def _share(rows: Sequence[ChoiceScores]) -> float:
    total = sum(row.total for row in rows)
    return sum(row.right for row in rows) / total if total else float("nan")


def _instead(rows: Sequence[ChoiceScores]) -> str:
    wrong = [kind for row in rows for kind in row.instead]
    return ", ".join(f"{wrong.count(kind)} {kind}" for kind in sorted(set(wrong))) or "-"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %" if share == share else "-"


def _short(value: float) -> str:
    return f"{value:.2f}" if value < 1000 else f"{value:.0e}"
