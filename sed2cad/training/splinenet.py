"""Train SplineNet on the freeform patches of parts and on made ones, within a time budget, resumable."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from sed2cad.network.spline_frame import POINTS, patch_frame, spline_basis
from sed2cad.network.splinenet import SplineNet
from sed2cad.network.types import BSPLINE
from sed2cad.network.weights import load_splinenet, save_splinenet
from sed2cad.primitives.unroll import unrolled
from sed2cad.training.dataset import load_part, packed_parts
from sed2cad.training.labelled_part import LabelledPart
from sed2cad.training.made_sheets import Sheet, made_sheet

WEIGHTS = "splinenet.safetensors"
HALF = "splinenet16.safetensors"
"""Files in the folder of a run; the second in 16 bits, to be shipped."""
Report = Callable[[dict[str, float]], None]

_STORED = 1_500  # points of a patch of a part
_TORN = 0.2  # of a sheet that was not laid flat
_LONGEST = 12.0  # widths of a patch that a net of 12 by 12 can follow
_ROWS = 48  # points that tell which way round a net is
_SHIFTS = 12


@dataclass(frozen=True)
class SplineSettings:
    """Times are minutes of the processor."""

    minutes: float = 25.0
    batch: int = 16
    learning_rate: float = 1e-3
    clip: float = 1.0
    made: float = 0.5  # share of made patches
    noisy: float = 0.3  # share of patches with noise
    patches_of_a_part: int = 4
    parts: int | None = None  # read, of each folder
    log_steps: int = 50
    max_steps: int | None = None
    seed: int = 0


def train_splinenet(settings: SplineSettings, data: Sequence[Path], out: Path, report: Report | None = None) -> Path:
    """Train on folders of packed parts, or go on from `out`'s checkpoint; returns the weights."""
    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    out.mkdir(parents=True, exist_ok=True)
    sheets = [sheet for folder in data for sheet in _sheets_of(folder, settings)]
    weights, state_file = out / WEIGHTS, out / "splinenet.pt"
    network = load_splinenet(weights) if state_file.exists() else SplineNet()
    network.train()
    optimizer = torch.optim.AdamW(network.parameters(), settings.learning_rate)
    step, spent = 0, 0.0
    if state_file.exists():
        state = torch.load(state_file, weights_only=True)
        optimizer.load_state_dict(state["optimizer"])
        step, spent = int(state["step"]), float(state["spent"])
    start, running = time.process_time() - spent, [[0.0, 0.0]]
    while (elapsed := time.process_time() - start) < 60 * settings.minutes and step < (settings.max_steps or math.inf):
        share = max(elapsed / 60 / settings.minutes, step / (settings.max_steps or math.inf))
        rate = settings.learning_rate * min(1.0, (step + 1) / 100) * 0.5 * (1 + math.cos(math.pi * share))
        for group in optimizer.param_groups:
            group["lr"] = max(rate, settings.learning_rate / 200)
        running.append(_step(network, optimizer, sheets, settings, step))
        step += 1
        if step % settings.log_steps == 0:
            open_loss, closed_loss = np.mean(running[-settings.log_steps :], axis=0)
            line = {"step": step, "minutes": elapsed / 60, "patches": len(sheets)}
            _log(out, {**line, "open": float(open_loss), "closed": float(closed_loss)}, report)
            save_splinenet(network, weights)
            torch.save({"optimizer": optimizer.state_dict(), "step": step, "spent": elapsed}, state_file)
    save_splinenet(network, weights)
    return weights


def _step(
    network: SplineNet, optimizer: torch.optim.Optimizer, sheets: list[Sheet], settings: SplineSettings, step: int
) -> list[float]:
    """One step on open and on closed patches; rms distance of points from where their parameters are, of each."""
    rng = np.random.default_rng([settings.seed, step])
    losses = []
    for closed in (False, True):
        own = [sheet for sheet in sheets if sheet.closed == closed]
        made = settings.batch if not own else round(settings.made * settings.batch)
        drawn = [made_sheet(rng, POINTS, closed) for _ in range(made)]
        drawn += [own[rng.integers(len(own))] for _ in range(settings.batch - made)]
        points, u, v = _batch([_varied(sheet, rng, settings.noisy) for sheet in drawn])
        losses.append(_loss(network(points, closed), points[:, :, :3], u, v, closed))
    optimizer.zero_grad()
    (losses[0] + losses[1]).backward()
    torch.nn.utils.clip_grad_norm_(network.parameters(), settings.clip)
    optimizer.step()
    return [float(loss.detach()) for loss in losses]


def _loss(nets: Tensor, points: Tensor, u: Tensor, v: Tensor, closed: bool) -> Tensor:
    """Mean distance of points (b, n, 3) from the nets (b, 12, 12, 3) at their parameters, the nets turned to fit.

    u and v (b, n, 12): basis functions. A net may run either way and along either side, a closed one start anywhere.
    """
    ways = _ways(nets, closed)  # (w, b, 12, 12, 3)
    with torch.no_grad():
        some = slice(0, _ROWS)
        gap = _evaluated(ways, u[:, some], v[:, some]) - points[:, some]
        best = gap.square().sum(-1).mean(-1).argmin(0)  # (b,)
    chosen = ways[best, torch.arange(len(nets))]
    gap = _evaluated(chosen[None], u, v)[0] - points
    rough = sum(chosen.diff(n=2, dim=dim).square().sum(-1).mean() for dim in (1, 2))
    return (gap.square().sum(-1) + 1e-6).sqrt().mean() + 0.02 * rough


def _ways(nets: Tensor, closed: bool) -> Tensor:
    """The nets (b, 12, 12, 3) in all directions that mean the same surface: (w, b, 12, 12, 3)."""
    turned = [nets] if closed else [nets, nets.transpose(1, 2)]
    turned = [way.flip(dims) for way in turned for dims in ([], [1], [2], [1, 2])]
    if closed:
        turned = [way.roll(shift, 1) for way in turned for shift in range(_SHIFTS)]
    return torch.stack(turned)


def _evaluated(nets: Tensor, u: Tensor, v: Tensor) -> Tensor:
    """Points (w, b, n, 3) of nets (w, b, 12, 12, 3) at basis functions (b, n, 12)."""
    return torch.einsum("bnu,bnv,wbuvk->wbnk", u, v, nets)


def _varied(sheet: Sheet, rng: np.random.Generator, noisy: float) -> Sheet:
    """Some of its points, mirrored at random and maybe with noise."""
    some = rng.choice(len(sheet.points), POINTS, replace=len(sheet.points) < POINTS)
    points, normals = sheet.points[some].astype(np.float64), sheet.normals[some].astype(np.float64)
    if rng.random() < noisy:
        size = float(np.ptp(points, axis=0).max())
        points = points + 0.01 * size * rng.random() * rng.normal(size=(POINTS, 1)) * normals
    signs = rng.choice([-1.0, 1.0], 3)
    mirrored = (points * signs).astype(np.float32), (normals * signs).astype(np.float32)
    return Sheet(*mirrored, sheet.uv[some], sheet.closed)


def _batch(sheets: list[Sheet]) -> tuple[Tensor, Tensor, Tensor]:
    """Points with normals in their patch's frame (b, n, 6), and basis functions (b, n, 12) of u and v."""
    rows, u, v = [], [], []
    for sheet in sheets:
        centre, axes, half = patch_frame(sheet.points.astype(np.float64))
        rows.append(np.hstack([(sheet.points - centre) @ axes.T / half, sheet.normals @ axes.T]).astype(np.float32))
        u.append(spline_basis(sheet.uv[:, 0].astype(np.float64), sheet.closed))
        v.append(spline_basis(sheet.uv[:, 1].astype(np.float64), False))
    return torch.from_numpy(np.stack(rows)), torch.from_numpy(np.stack(u)), torch.from_numpy(np.stack(v))


def _sheets_of(folder: Path, settings: SplineSettings) -> list[Sheet]:
    """The freeform patches of packed parts, laid flat; without those that cannot be, or are too long."""
    found = []
    for file in packed_parts(folder)[: settings.parts]:
        part = load_part(file)
        free = np.unique(part.patch[(part.type == BSPLINE) & (part.patch >= 0)])
        rng = np.random.default_rng(len(part.nodes))
        for number in rng.permutation(free)[: settings.patches_of_a_part].tolist():
            sheet = _sheet(part, np.flatnonzero(part.patch[part.face] == number), rng)
            found += [] if sheet is None else [sheet]
    return found


def _sheet(part: LabelledPart, triangles: NDArray[np.int64], rng: np.random.Generator) -> Sheet | None:
    """A patch with the parameters that unrolling gives its points."""
    some = replace(part, triangles=part.triangles[triangles], face=part.face[triangles])
    cloud = some.sample(rng, _STORED, 0)
    ways = unrolled(cloud.points.astype(np.float64), cloud.normals.astype(np.float64))
    if not ways or ways[0].torn > _TORN:
        return None
    uv, closed = ways[0].uv, ways[0].period > 0
    extent = np.ptp(uv, axis=0)
    if extent.max() > _LONGEST * extent.min():
        return None
    uv = (uv - uv.min(axis=0)) / np.where([closed, False], ways[0].period, extent)
    return Sheet(cloud.points, cloud.normals, np.clip(uv, 0, 1).astype(np.float32), closed)


def _log(out: Path, values: dict[str, float], report: Report | None) -> None:
    line = {name: round(value, 5) for name, value in values.items()}
    with (out / "log.jsonl").open("a") as log:
        log.write(json.dumps(line) + "\n")
    if report:
        report(line)
