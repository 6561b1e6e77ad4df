"""Networks to and from the files of `stored`."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TypeVar

import torch
from safetensors.torch import save_file

from sed2cad.network.labeller import Labeller
from sed2cad.network.layers import Layers
from sed2cad.network.sednet import SedNet
from sed2cad.network.splinenet import SplineNet
from sed2cad.network.stored import FORMAT, SHIPPED, SHIPPED_SPLINENET, SPLINE_FORMAT, Stored, stored_weights

Network = TypeVar("Network", SedNet, SplineNet)


def save_weights(network: SedNet, path: Path, half: bool = False) -> None:
    """Write the weights, with `half` in 16 bits: half the size, the same labels."""
    _save(network, path, half, FORMAT)


def save_splinenet(network: SplineNet, path: Path, half: bool = False) -> None:
    """The same for SplineNet."""
    _save(network, path, half, SPLINE_FORMAT)


def _save(network: SedNet | SplineNet, path: Path, half: bool, kind: str) -> None:
    tensors = {name: tensor.contiguous() for name, tensor in network.state_dict().items()}
    if half:
        tensors = {
            name: tensor.half() if tensor.is_floating_point() else tensor for name, tensor in tensors.items()
        }
    metadata = {"format": kind, "architecture": json.dumps(asdict(network.shape))}
    save_file(tensors, path, metadata)
    path.chmod(0o644)  # safetensors leaves it to the owner alone, and it goes into the wheel


def load_weights(path: Path | None = None) -> SedNet:
    """The network in a file, ready to predict; without a path the shipped one. Raises WeightsError."""
    stored = stored_weights(path or SHIPPED, FORMAT)
    return _filled(lambda: SedNet(stored.architecture()), stored)


def load_splinenet(path: Path | None = None) -> SplineNet:
    """The same for SplineNet. Raises WeightsError."""
    stored = stored_weights(path or SHIPPED_SPLINENET, SPLINE_FORMAT)
    return _filled(lambda: SplineNet(stored.spline_shape()), stored)


def _filled(make: Callable[[], Network], stored: Stored) -> Network:
    try:
        network = make()
        network.load_state_dict({name: torch.from_numpy(array) for name, array in stored.arrays.items()})
    except (TypeError, ValueError, RuntimeError) as error:
        raise stored.misfit from error
    return network.eval()


def labeller_of(network: SedNet) -> Labeller:
    """The same network, ready to label scans."""
    return Labeller(network.shape, layers_of(network))


def layers_of(network: SedNet | SplineNet) -> Layers:
    """The weights of a network."""
    return Layers({name: tensor.detach().cpu().float().numpy() for name, tensor in network.state_dict().items()})
