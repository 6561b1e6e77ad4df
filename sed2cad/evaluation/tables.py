"""Results as aligned text and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sed2cad.evaluation.methods import NEED_NETWORK
from sed2cad.evaluation.scores import MethodScores
from sed2cad.evaluation.segmentation import SegmentationResult
from sed2cad.network.types import PATCH_TYPES

HEADER = (
    "method", "P-mIoU", "strict", "strict 30+", "T-mIoU", "type acc", "edge P", "edge R", "edge F1",
    "scan s", "network s", "patches s", "peak MB",
)  # fmt: skip


def segmentation_text(result: SegmentationResult) -> str:
    """The table of methods and the table of types."""
    lines = [*aligned([HEADER, *(_row(scores) for scores in result.methods)]), "", *_types(result.methods)]
    lines += [
        f"{scores.method}: failed on {scores.failed} of {scores.parts} parts, which count as unlabelled"
        for scores in result.methods
        if scores.failed
    ]
    return "\n".join(lines)


def segmentation_json(result: SegmentationResult) -> str:
    """Settings, rows of the methods and rows of the parts; what there is no number for is null."""
    return to_json(
        {
            "settings": asdict(result.settings),
            "types": PATCH_TYPES,
            "methods": [asdict(scores) for scores in result.methods],
            "parts": [asdict(scores) for scores in result.parts],
        }
    )


def to_json(content: Any) -> str:
    """JSON with paths as text, 6 digits after the point, and null for what is not finite."""
    return json.dumps(_plain(content), indent=1, allow_nan=False) + "\n"


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Columns of equal width, the first flush left."""
    widths = [max(map(len, column)) for column in zip(*rows)]
    return [
        "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:]))]).rstrip()
        for row in rows
    ]


def share(value: float) -> str:
    """A ratio with three digits; a dash for NaN."""
    return f"{value:.3f}" if value == value else "-"


def _row(scores: MethodScores) -> tuple[str, ...]:
    seconds = scores.seconds
    return (
        scores.method,
        *map(share, (scores.p_miou, scores.p_miou_strict, scores.p_miou_large, scores.t_miou)),
        *map(share, (scores.type_accuracy, scores.edge_precision, scores.edge_recall, scores.edge_f1)),
        *(f"{value:.2f}" for value in (seconds.scan, seconds.network, seconds.patches)),
        f"{scores.peak_mb:.0f}",
    )


def _types(methods: Sequence[MethodScores]) -> list[str]:
    """A line for each type: type accuracy over its points, strict P-mIoU over its true patches."""
    header = ["type", "points", "patches"]
    typed = [scores for scores in methods if scores.method in NEED_NETWORK]
    header += [f"{scores.method} acc" for scores in typed] + [f"{scores.method} strict" for scores in methods]
    rows = [header]
    for index, name in enumerate(PATCH_TYPES):
        counts = methods[0].classes[index]
        accuracy = [share(scores.classes[index].type_accuracy) for scores in typed]
        strict = [share(scores.classes[index].p_miou_strict) for scores in methods]
        rows.append([name, str(counts.points), str(counts.patches), *accuracy, *strict])
    return aligned(rows)


def _plain(value: Any) -> Any:
    match value:
        case dict():
            return {str(key): _plain(item) for key, item in value.items()}
        case list() | tuple():
            return [_plain(item) for item in value]
        case float():
            return round(value, 6) if math.isfinite(value) else None
        case Path():
            return str(value)
    return value
