"""How to train: the default for two cores, and the paper's way."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from sed2cad.network.architecture import Architecture
from sed2cad.network.graph import MAX_POINTS
from sed2cad.training.losses import EDGE_WEIGHT


@dataclass(frozen=True)
class TrainSettings:
    """Times are minutes. The learning rate falls to nothing over the minutes, epochs or steps, what ends first."""

    architecture: Architecture = field(default_factory=Architecture)
    minutes: float = 125.0
    wall: bool = False  # minutes of the clock, not of the processor
    epochs: float = math.inf  # of all parts
    threads: int = 1
    device: str = "auto"  # "cpu", "cuda"
    batch: int = 4  # clouds a step and process
    points: int = MAX_POINTS  # of each cloud that the network sees, at most
    rows: int = 2_048  # of these, in the loss
    clean: float = 0.5  # share of clouds without noise, gaps and the like
    reuse: int = 2  # steps that a fresh cloud is used in, each time in another position
    learning_rate: float = 2e-3
    init: Path | None = None  # weights to start from instead of at random; their architecture counts
    warm_up: int = 100  # steps
    weight_decay: float = 1e-2
    clip: float = 2.0  # norm of the gradient
    push_power: float = 0.5  # see losses.embedding_loss
    edge_weight: float = EDGE_WEIGHT  # lambda
    pretrain_steps: int = 2_500
    pretrain_parts: int = 1_000
    pair_network: bool = True  # also train the pair network, which `export` needs
    parts: int | None = None  # trained on, those of the first folder first; None: all but those held out
    log_steps: int = 50
    validate_minutes: float = 12.0
    held_out: int = 60  # parts of the first folder that are not trained on
    validation_parts: int = 20  # of those, scored during training
    max_steps: int | None = None
    seed: int = 0


def default() -> TrainSettings:
    """What two cores can run in two hours."""
    return TrainSettings()


def paper() -> TrainSettings:
    """As the paper trains: plain inputs, its classes and graphs, all points, equation 6 as written; needs a GPU."""
    return TrainSettings(
        Architecture(local_width=0, transformer_layers=0, torus=False, dynamic=64),
        minutes=math.inf,
        epochs=100,
        batch=8,
        rows=MAX_POINTS,
        clean=1.0,
        reuse=1,
        learning_rate=1e-3,
        push_power=1.0,
        validate_minutes=60.0,
    )


PRESETS: dict[str, Callable[[], TrainSettings]] = {"default": default, "paper": paper}
