"""Train from the shell.

python -m sed2cad.training run DATA [SYNTHETIC ...] RUN [--preset paper] [--minutes 125] [--init WEIGHTS]
torchrun --nproc_per_node 2 -m sed2cad.training run DATA RUN          the same, data-parallel
python -m sed2cad.training splinenet DATA [SYNTHETIC ...] -o RUN [--minutes 25]      control nets of freeform patches
python -m sed2cad.training export RUN OUT.safetensors      the best weights so far, also while it runs
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from sed2cad.network.weights import load_splinenet, save_splinenet
from sed2cad.training.settings import PRESETS
from sed2cad.training.splinenet import HALF, WEIGHTS, SplineSettings, train_splinenet
from sed2cad.training.train import export, train

OVERRIDES = ("minutes", "epochs", "threads", "device", "batch", "rows", "learning_rate", "init", "max_steps", "seed")
"""Options that replace a setting of the preset."""


def main(arguments: Sequence[str] | None = None) -> None:
    """The commands of this module."""
    given = _parser().parse_args(arguments)
    if given.command == "export":
        return export(given.run, given.out)
    if given.command == "splinenet":
        settings = SplineSettings(given.minutes, max_steps=given.steps, parts=given.parts)
        train_splinenet(settings, given.data, given.out, lambda line: print(json.dumps(line), flush=True))
        return save_splinenet(load_splinenet(given.out / WEIGHTS), given.out / HALF, half=True)
    chosen = {name: getattr(given, name) for name in OVERRIDES if getattr(given, name) is not None}
    run = replace(PRESETS[given.preset](), wall=given.wall, **chosen)
    train(run, given.data, given.out, lambda line: print(json.dumps(line), flush=True))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run")
    run.add_argument("data", type=Path, nargs="+", help="folders of parts; the first holds the real ones")
    run.add_argument("out", type=Path)
    run.add_argument("--preset", choices=PRESETS, default="default")
    run.add_argument("--wall", action="store_true", help="minutes of the clock, not of the processor")
    run.add_argument("--init", type=Path, help="weights to start from")
    run.add_argument("--device", choices=("auto", "cpu", "cuda"))
    for name in ("minutes", "epochs", "learning_rate"):
        run.add_argument("--" + name.replace("_", "-"), type=float)
    for name in ("threads", "batch", "rows", "seed"):
        run.add_argument("--" + name, type=int)
    run.add_argument("--steps", type=int, dest="max_steps")
    spline = commands.add_parser("splinenet")
    spline.add_argument("data", type=Path, nargs="+", help="folders of packed parts")
    spline.add_argument("-o", "--out", type=Path, required=True)
    spline.add_argument("--minutes", type=float, default=SplineSettings.minutes)
    spline.add_argument("--steps", type=int)
    spline.add_argument("--parts", type=int, help="only the first of each folder")
    export_ = commands.add_parser("export")
    export_.add_argument("run", type=Path)
    export_.add_argument("out", type=Path)
    return parser


if __name__ == "__main__":
    main()
