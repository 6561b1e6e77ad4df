"""Train SED-Net on packed parts, within a time budget, resumable, in one process or under torchrun."""

from __future__ import annotations

import json
import math
import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file, save_file

from sed2cad.evaluation.segmentation import score_network
from sed2cad.network.affinity import PairNet
from sed2cad.network.sednet import SedNet
from sed2cad.network.weights import labeller_of, load_weights, save_weights
from sed2cad.training.affinity import WIDTH, train_affinity
from sed2cad.training.dataset import packed_parts
from sed2cad.training.losses import losses
from sed2cad.training.parallel import Team
from sed2cad.training.pretrain import pretrain_local
from sed2cad.training.settings import TrainSettings
from sed2cad.training.stream import Stream, make_batch

AFFINITY = "affinity.safetensors"
"""File of the pair network in the folder of a run."""
Report = Callable[[dict[str, float]], None]
"""Called with every line of the log."""
LOGGED = ("loss", "type_loss", "edge_loss", "pull", "push", "train_type_accuracy")


def train(settings: TrainSettings, data: Path | Sequence[Path], out: Path, report: Report | None = None) -> Path:
    """Train on the packed parts in `data`, or go on from `out`'s checkpoint; returns the best weights.

    Of several folders the first holds real parts, some of which are held out for validation; the parts of the
    others (synthetic ones) are all trained on.
    """
    torch.set_num_threads(settings.threads)
    torch.manual_seed(settings.seed)
    out.mkdir(parents=True, exist_ok=True)
    folders = [data] if isinstance(data, Path) else list(data)
    team = Team.join(settings.device)
    best = _Run(settings, folders, out, team, report).run()
    team.leave()
    return best


def split_parts(settings: TrainSettings, folders: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """Parts to train on and held-out parts; the latter depend on the seed and the first folder's file names."""
    real, *others = (packed_parts(folder) for folder in folders)
    order = np.random.default_rng(settings.seed).permutation(len(real))
    held_out = min(settings.held_out, len(real) // 5)
    added = [path for parts in others for path in parts]
    trained = [real[i] for i in order[held_out:]] + added
    return trained[: settings.parts], [real[i] for i in order[:held_out]]


class _Run:
    """One training run: the network, its optimizer, the clock and the log."""

    def __init__(
        self, settings: TrainSettings, folders: Sequence[Path], out: Path, team: Team, report: Report | None
    ) -> None:
        self.settings, self.out, self.team, self.report = settings, out, team, report
        self.parts, self.held_out = split_parts(settings, folders)
        self.step, self.spent, self.best = 0, 0.0, -1.0
        self.resumes = (out / "state.pt").exists()
        start = out / "last.safetensors" if self.resumes else settings.init
        self.network = load_weights(start) if start else SedNet(settings.architecture)
        self.network.to(team.device)
        self.trained = [parameter for parameter in self.network.parameters() if parameter.requires_grad]
        self.optimizer = torch.optim.AdamW(
            self.trained, settings.learning_rate, betas=(0.9, 0.98), weight_decay=settings.weight_decay
        )
        if self.resumes:
            state = torch.load(out / "state.pt", weights_only=True, map_location=team.device)
            self.optimizer.load_state_dict(state["optimizer"])
            self.step, self.spent, self.best = state["step"], state["spent"], state["best"]
        self.stream = Stream(self.parts, settings, team.rank, team.size)

    def run(self) -> Path:
        """Steps until the time or the steps are used up, with a validation now and then and at the end."""
        settings = self.settings
        self.tick = self._clock()
        if not self.resumes and self.team.leads:
            self._pretrain()
        self.team.share_weights(self.network)
        self.network.train()
        running: list[list[float]] = []
        validated = self.team.agree(self._elapsed())
        while (elapsed := self.team.agree(self._elapsed())) / 60 < settings.minutes and self.step < self._steps():
            if elapsed - validated > settings.validate_minutes * 60:
                self._validate()
                validated = self.team.agree(self._elapsed())
            running.append(self._one_step(max(elapsed / 60 / settings.minutes, self.step / self._steps())))
            self.step += 1
            if self.step % settings.log_steps == 0:
                self._log(dict(zip(LOGGED, np.mean(running, axis=0).tolist())))
                running.clear()
        self._validate()
        return self.out / "best.safetensors"

    def _steps(self) -> float:
        """How many steps the epochs take; at most `max_steps`."""
        each = self.settings.batch * self.team.size / self.settings.reuse
        return min(self.settings.epochs * len(self.parts) / each, self.settings.max_steps or math.inf)

    def _pretrain(self) -> None:
        """The two point-wise networks, each in a minute: on local features, and on pairs. Given ones are kept."""
        settings, parts = self.settings, self.parts[: self.settings.pretrain_parts]
        if self.network.local is not None and settings.init is None:
            rng = np.random.default_rng(settings.seed)
            local = self.network.local.cpu()
            self._log({"pretrain_type_accuracy": pretrain_local(local, parts, settings.pretrain_steps, rng)})
            self.network.to(self.team.device)
        given = settings.init.with_name(AFFINITY) if settings.init else None
        if self.network.affinity is not None:
            save_file(self.network.affinity.state_dict(), self.out / AFFINITY)
        elif given and given.exists():
            shutil.copyfile(given, self.out / AFFINITY)
        elif settings.pair_network:
            pairs = train_affinity(parts, settings.pretrain_steps, settings.seed)
            save_file(pairs.state_dict(), self.out / AFFINITY)

    def _one_step(self, progress: float) -> list[float]:
        settings, device = self.settings, self.team.device
        rate = settings.learning_rate * min(1.0, (self.step + 1) / settings.warm_up)
        for group in self.optimizer.param_groups:
            group["lr"] = max(rate * 0.5 * (1 + math.cos(math.pi * progress)), settings.learning_rate / 200)
        rng = np.random.default_rng([settings.seed, self.step, self.team.rank])
        samples = self.stream.samples(self.step, settings.batch)
        batch, target = make_batch(samples, settings.rows, rng, self.network.shape.torus)
        target = target.to(device)
        with torch.autocast(device.type, torch.bfloat16, enabled=device.type == "cuda"):
            output = self.network(batch.to(device))
        type_, edge, descriptor = (part.float() for part in output)
        terms = losses(type_, edge, descriptor, target, settings.push_power, settings.edge_weight)
        self.optimizer.zero_grad()
        terms.total().backward()
        self.team.average_gradients(self.trained)
        torch.nn.utils.clip_grad_norm_(self.trained, settings.clip)
        self.optimizer.step()
        right = (type_.argmax(1) == target.type).float().mean()
        return [float(value.detach()) for value in (terms.total(), *terms, right)]

    def _validate(self) -> None:
        """Score the held-out parts, keep the best weights, and write the checkpoint."""
        if not self.team.leads:
            return
        save_weights(self.network, self.out / "last.safetensors")
        scores = score_network(self.held_out[: self.settings.validation_parts], labeller_of(self.network))
        self.network.to(self.team.device).train()
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
        if not self.team.leads:
            return
        times = {"step": self.step, "minutes": self._elapsed() / 60, "cpu_minutes": time.process_time() / 60}
        line = {name: round(value, 4) for name, value in {**times, **values}.items()}
        with (self.out / "log.jsonl").open("a") as log:
            log.write(json.dumps(line) + "\n")
        if self.report:
            self.report(line)


def export(run: Path, out: Path) -> None:
    """Write the best weights of a run, with its pair network, in 16 bits to `out`."""
    network = load_weights(run / "best.safetensors")
    pairs = PairNet(WIDTH)
    pairs.load_state_dict(load_file(run / AFFINITY))
    network.attach(pairs, WIDTH)
    save_weights(network, out, half=True)
