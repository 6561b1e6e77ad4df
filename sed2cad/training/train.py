"""Train SED-Net on packed parts, within a time budget, resumable.

python -m sed2cad.training.train run DATA RUN [--minutes 125] [--wall] [--threads 1]
python -m sed2cad.training.train export RUN OUT.safetensors      the best weights so far, also while it runs
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file, save_file

from sed2cad.evaluation.segmentation import score_network
from sed2cad.network.affinity import PairNet
from sed2cad.network.batch import Batch, Cloud, stack
from sed2cad.network.graph import neighbour_graph
from sed2cad.network.sednet import Architecture, SedNet
from sed2cad.network.weights import load_weights, save_weights
from sed2cad.training.affinity import WIDTH, train_affinity
from sed2cad.training.augment import random_motion
from sed2cad.training.dataset import packed_clouds
from sed2cad.training.losses import EDGE_WEIGHT, Target, losses
from sed2cad.training.pretrain import pretrain_local
from sed2cad.training.samples import VARIANTS, Sample, load_sample

AFFINITY = "affinity.safetensors"
"""File of the pair network in the folder of a run."""
Report = Callable[[dict[str, float]], None]
"""Called with every line of the log."""


@dataclass(frozen=True)
class TrainSettings:
    """How to train; times are minutes."""

    architecture: Architecture = field(default_factory=Architecture)
    minutes: float = 125.0  # the learning rate falls to nothing over this time
    wall: bool = False  # minutes of the clock, not of the processor
    threads: int = 1
    batch: int = 4  # clouds a step
    rows: int = 2_048  # points a cloud in the loss
    learning_rate: float = 2e-3
    warm_up: int = 100  # steps
    weight_decay: float = 1e-2
    clip: float = 2.0  # norm of the gradient
    push_power: float = 0.5  # see losses.embedding_loss
    edge_weight: float = EDGE_WEIGHT  # lambda
    pretrain_steps: int = 2_500
    pair_network: bool = True  # also train the pair network, which `export` needs
    points: int | None = None  # of each cloud that the network sees; None: all
    parts: int | None = None  # trained on; None: all but those held out
    log_steps: int = 50
    validate_minutes: float = 12.0
    held_out: int = 60  # parts that are not trained on
    validation_parts: int = 20  # of those, scored during training
    max_steps: int | None = None
    seed: int = 0


def train(settings: TrainSettings, data: Path, out: Path, report: Report | None = None) -> Path:
    """Train on the packed parts in `data`, or go on from `out`'s checkpoint; returns the best weights."""
    torch.set_num_threads(settings.threads)
    torch.manual_seed(settings.seed)
    out.mkdir(parents=True, exist_ok=True)
    return _Run(settings, data, out, report).run()


class _Run:
    """One training run: the network, its optimizer, the clock and the log."""

    def __init__(self, settings: TrainSettings, data: Path, out: Path, report: Report | None) -> None:
        self.settings, self.out, self.report = settings, out, report
        parts = packed_clouds(data)
        order = np.random.default_rng(settings.seed).permutation(len(parts))
        held_out = min(settings.held_out, len(parts) // 5)
        self.held_out = [parts[i] for i in order[:held_out]]
        self.parts = [parts[i] for i in order[held_out:]][: settings.parts]
        self.step, self.spent, self.best = 0, 0.0, -1.0
        resume = (out / "state.pt").exists()
        self.network = load_weights(out / "last.safetensors") if resume else SedNet(settings.architecture)
        trained = [parameter for parameter in self.network.parameters() if parameter.requires_grad]
        self.optimizer = torch.optim.AdamW(
            trained, settings.learning_rate, betas=(0.9, 0.98), weight_decay=settings.weight_decay
        )
        if resume:
            state = torch.load(out / "state.pt", weights_only=True)
            self.optimizer.load_state_dict(state["optimizer"])
            self.step, self.spent, self.best = state["step"], state["spent"], state["best"]

    def run(self) -> Path:
        """Steps until the time or the steps are used up, with a validation now and then and at the end."""
        settings, budget = self.settings, self.settings.minutes * 60
        self.tick = self._clock()
        if self.step == 0:
            self._pretrain()
        self.network.train()
        running: list[list[float]] = []
        validated = self.spent
        while self._elapsed() < budget and self.step < (settings.max_steps or math.inf):
            used = self.step / settings.max_steps if settings.max_steps else 0.0
            running.append(self._one_step(max(self.spent / budget, used)))
            self.step += 1
            if self.step % settings.log_steps == 0:
                self._log(dict(zip(LOGGED, np.mean(running, axis=0).tolist())))
                running.clear()
            if self._elapsed() - validated > settings.validate_minutes * 60:
                self._validate()
                validated = self._elapsed()
        self._validate()
        return self.out / "best.safetensors"

    def _pretrain(self) -> None:
        """The two point-wise networks, each in a minute: on local features, and on pairs."""
        steps = self.settings.pretrain_steps
        if self.network.local is not None:
            rng = np.random.default_rng(self.settings.seed)
            self._log({"pretrain_type_accuracy": pretrain_local(self.network.local, self.parts, steps, rng)})
        if self.settings.pair_network:
            save_file(train_affinity(self.parts, steps, self.settings.seed).state_dict(), self.out / AFFINITY)

    def _one_step(self, progress: float) -> list[float]:
        settings = self.settings
        rate = settings.learning_rate * min(1.0, (self.step + 1) / settings.warm_up)
        for group in self.optimizer.param_groups:
            group["lr"] = max(rate * 0.5 * (1 + math.cos(math.pi * progress)), 1e-5)
        batch, target = make_batch(
            self._samples(), settings.rows, np.random.default_rng([settings.seed, self.step])
        )
        output = self.network(batch)
        terms = losses(
            output.type, output.edge, output.descriptor, target, settings.push_power, settings.edge_weight
        )
        self.optimizer.zero_grad()
        terms.total().backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), settings.clip)
        self.optimizer.step()
        right = (output.type.argmax(1) == target.type).float().mean()
        return [float(value.detach()) for value in (terms.total(), *terms, right)]

    def _samples(self) -> list[Sample]:
        """The clouds of this step: each epoch takes every part once in one of its variants."""
        samples = []
        for position in range(self.step * self.settings.batch, (self.step + 1) * self.settings.batch):
            epoch, index = divmod(position, len(self.parts))
            order = np.random.default_rng([self.settings.seed, epoch]).permutation(len(self.parts))
            sample = load_sample(self.parts[order[index]], (epoch + int(order[index])) % VARIANTS)
            samples.append(shorten(sample, self.settings.points) if self.settings.points else sample)
        return samples

    def _validate(self) -> None:
        """Score the held-out parts, keep the best weights, and write the checkpoint."""
        save_weights(self.network, self.out / "last.safetensors")
        scores = score_network(self.held_out[: self.settings.validation_parts], self.network.eval())
        self.network.train()
        value = scores.type_accuracy + scores.p_miou_strict + scores.p_miou_large
        if value > self.best:
            self.best = value
            save_weights(self.network, self.out / "best.safetensors")
        state = {"optimizer": self.optimizer.state_dict(), "step": self.step, "spent": self._elapsed()}
        torch.save({**state, "best": self.best}, self.out / "state.pt")
        self._log(scores.ratios())

    def _clock(self) -> float:
        return time.monotonic() if self.settings.wall else time.process_time()

    def _elapsed(self) -> float:
        """Seconds spent so far, those before a resume included."""
        now = self._clock()
        self.spent += now - self.tick
        self.tick = now
        return self.spent

    def _log(self, values: dict[str, float]) -> None:
        line = {
            "step": self.step,
            "minutes": self._elapsed() / 60,
            "cpu_minutes": time.process_time() / 60,
            **values,
        }
        line = {name: round(value, 4) for name, value in line.items()}
        with (self.out / "log.jsonl").open("a") as log:
            log.write(json.dumps(line) + "\n")
        if self.report:
            self.report(line)


LOGGED = ("loss", "type_loss", "edge_loss", "pull", "push", "train_type_accuracy")


def shorten(sample: Sample, points: int) -> Sample:
    """The first points of a sample, which come in random order, and their neighbours among them."""
    arrays = {name: getattr(sample, name)[:points] for name in Sample.__dataclass_fields__}
    return Sample(**{**arrays, "neighbours": neighbour_graph(arrays["points"])})


def make_batch(samples: Sequence[Sample], rows: int, rng: np.random.Generator) -> tuple[Batch, Target]:
    """Move each sample at random and stack them; the target of their first `rows` points."""
    clouds, patches, owners, count = [], [], [], 0
    for index, sample in enumerate(samples):
        motion = random_motion(rng)
        normals = sample.normals @ motion.T
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
        clouds.append(Cloud(sample.points @ motion.T, normals, sample.neighbours))
        names, patch = np.unique(sample.patch[:rows], return_inverse=True)
        patches.append(patch + count)
        owners.append(np.full(len(names), index))
        count += len(names)
    target = Target(
        _long([sample.type[:rows] for sample in samples]),
        _long([sample.edge[:rows] for sample in samples]),
        _long(patches),
        _long(owners),
    )
    return stack(clouds, rows), target


def _long(arrays: Sequence[np.ndarray]) -> torch.Tensor:
    return torch.from_numpy(np.concatenate(arrays).astype(np.int64))


def export(run: Path, out: Path) -> None:
    """Write the best weights of a run, with its pair network, in 16 bits to `out`."""
    network = load_weights(run / "best.safetensors")
    pairs = PairNet(WIDTH)
    pairs.load_state_dict(load_file(run / AFFINITY))
    network.attach(pairs, WIDTH)
    save_weights(network, out, half=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """The two commands of this module."""
    import argparse

    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run")
    run.add_argument("data", type=Path)
    run.add_argument("out", type=Path)
    run.add_argument("--minutes", type=float, default=TrainSettings.minutes)
    run.add_argument("--threads", type=int, default=TrainSettings.threads)
    run.add_argument("--wall", action="store_true", help="minutes of the clock, not of the processor")
    run.add_argument("--steps", type=int, default=None)
    export_ = commands.add_parser("export")
    export_.add_argument("run", type=Path)
    export_.add_argument("out", type=Path)
    given = parser.parse_args(arguments)
    if given.command == "export":
        return export(given.run, given.out)
    settings = TrainSettings(
        minutes=given.minutes, threads=given.threads, wall=given.wall, max_steps=given.steps
    )
    train(settings, given.data, given.out, lambda line: print(json.dumps(line), flush=True))


if __name__ == "__main__":
    main()
