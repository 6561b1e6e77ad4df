"""The model as JSON, in world coordinates: report and editable document in one."""

from __future__ import annotations

import base64
import json
import math
import zlib
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sed2cad.errors import UsageError
from sed2cad.files import write_text
from sed2cad.model import CadModel
from sed2cad.primitives.base import FittedPatch, Patch
from sed2cad.primitives.names import primitive_names
from sed2cad.primitives.registry import read_primitive
from sed2cad.report.report import Boundary, ConstraintSummary, Deviation, FaceSummary, Report
from sed2cad.scan.scan import Frame
from sed2cad.topology.model import Chain, Region, Topology

FORMAT = "sed2cad-model"
VERSION = 1


def save_model(model: CadModel, path: Path) -> None:
    """Write `model` to `path`; numbers round-trip exactly."""
    write_text(path, json.dumps(_plain(_document(model)), indent=1, allow_nan=False) + "\n")


def load_model(path: Path) -> CadModel:
    """Read what `save_model` wrote. UsageError where the file cannot be read or is something else."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise UsageError(f"{path}: is not a sed2cad model (no JSON)") from error
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise UsageError(f"{path}: is not a sed2cad model; write one with --report")
    if document.get("version") != VERSION:
        raise UsageError(f"{path}: model version {document.get('version')}, this sed2cad reads {VERSION}")
    try:
        return _model(document)
    except (KeyError, TypeError, ValueError, IndexError, zlib.error) as error:
        raise UsageError(f"{path}: the model is damaged ({type(error).__name__}: {error})") from error


def _document(model: CadModel) -> dict[str, Any]:
    world = model.frame.to_world
    primitives = model.primitives
    return {
        "format": FORMAT,
        "version": VERSION,
        "name": model.name,
        "unit": model.unit,
        "frame": {"origin": model.frame.origin, "scale": model.frame.scale},
        "primitives": {
            name: {
                "kind": primitives[name].kind,
                "parameters": primitives[name].parameters(),
                "sign": patch.sign,
                "points": len(patch.patch.indices),
                "rms": patch.rms * model.frame.scale,
                "covariance": patch.covariance,
            }
            for name, patch in zip(model.names, model.fitted)
        },
        "topology": {
            "volume": model.topology.volume * model.frame.scale**3,
            "corners": world(model.topology.corners),
            "chains": [
                {"left": c.left, "right": c.right, "start": c.start, "end": c.end, "points": world(c.points)}
                for c in model.topology.chains
            ],
            "regions": [
                {
                    "primitive": model.names[r.primitive], "loops": r.loops, "body": r.body,
                    "area": r.area * model.frame.scale**2, "points": world(r.points),
                }
                for r in model.topology.regions
            ],
        },
        "open_at": [model.names[k] for k in model.open_at],
        "face_names": model.face_names,
        "report": asdict(model.report),
        "brep": base64.b64encode(zlib.compress(model.brep, 9)).decode("ascii"),
    }


def _model(document: dict[str, Any]) -> CadModel:
    frame = Frame(np.array(document["frame"]["origin"], float), float(document["frame"]["scale"]))
    fitted = tuple(_fitted(entry, frame) for entry in document["primitives"].values())
    names = primitive_names(fitted)
    return CadModel(
        name=document["name"],
        unit=document["unit"],
        frame=frame,
        fitted=fitted,
        topology=_topology(document["topology"], frame, names),
        brep=zlib.decompress(base64.b64decode(document["brep"])),
        face_names=tuple(document["face_names"]),
        report=_report(document["report"]),
        open_at=tuple(names.index(name) for name in document["open_at"]),
    )


def _fitted(entry: dict[str, Any], frame: Frame) -> FittedPatch:
    primitive = read_primitive(entry["kind"], entry["parameters"])
    nothing = Patch(np.zeros(0, np.int64), entry["kind"], np.zeros(0, bool))
    covariance = np.array(entry["covariance"], float).reshape(primitive.freedom, primitive.freedom)
    unit = primitive.scaled(1 / frame.scale, -frame.origin / frame.scale)
    return FittedPatch(nothing, unit, int(entry["sign"]), float(entry["rms"]) / frame.scale, covariance)


def _topology(entry: dict[str, Any], frame: Frame, names: tuple[str, ...]) -> Topology:
    def unit(points: list[list[float]]) -> NDArray[np.float64]:
        return frame.to_unit(np.array(points, float).reshape(-1, 3))

    chains = tuple(
        Chain(unit(c["points"]), int(c["left"]), int(c["right"]), int(c["start"]), int(c["end"]))
        for c in entry["chains"]
    )
    regions = tuple(
        Region(
            names.index(r["primitive"]),
            tuple(tuple((int(k), int(s)) for k, s in loop) for loop in r["loops"]),
            unit(r["points"]), float(r["area"]) / frame.scale**2, int(r["body"]),
        )
        for r in entry["regions"]
    )
    return Topology(regions, chains, unit(entry["corners"]), float(entry["volume"]) / frame.scale**3)


def _report(entry: dict[str, Any]) -> Report:
    deviation = Deviation(*(math.nan if entry["deviation"][k] is None else float(entry["deviation"][k])
                            for k in ("rms", "p95", "max")))
    return Report(
        **{k: entry[k] for k in ("closed", "rung", "reason", "faces", "exact_faces")},
        volume=math.nan if entry["volume"] is None else float(entry["volume"]),
        deviation=deviation,
        face_list=tuple(FaceSummary(**face) for face in entry["face_list"]),
        constraints=tuple(_constraint(constraint) for constraint in entry["constraints"]),
        seconds=tuple((str(stage), float(t)) for stage, t in entry["seconds"]),
        warnings=tuple(entry["warnings"]),
        boundaries=tuple(_boundary(boundary) for boundary in entry["boundaries"]),
    )


def _boundary(entry: dict[str, Any]) -> Boundary:
    x, y, z = map(float, entry["centre"])
    return Boundary(tuple(entry["faces"]), float(entry["length"]), (x, y, z))


def _constraint(entry: dict[str, Any]) -> ConstraintSummary:
    return ConstraintSummary(**{**entry, "faces": tuple(entry["faces"])})


def _plain(value: Any) -> Any:
    """numpy and tuples to what JSON knows; NaN to null."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
