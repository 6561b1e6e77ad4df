"""Weights on disk: safetensors (never pickle), with the network's architecture in the metadata."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any, TypeVar

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from sed2cad.errors import WeightsError
from sed2cad.network.sednet import Architecture, SedNet
from sed2cad.network.splinenet import SplineNet, SplineShape

SHIPPED = Path(__file__).with_name("sednet.safetensors")
FORMAT = "sed2cad-sednet-1"
SHIPPED_SPLINENET = Path(__file__).with_name("splinenet.safetensors")
SPLINE_FORMAT = "sed2cad-splinenet-1"

Network = TypeVar("Network", SedNet, SplineNet)


def save_weights(network: SedNet, path: Path, half: bool = False) -> None:
    """Write the weights, with `half` in 16 bits: half the size, the same labels."""
    _save(network, path, half, FORMAT)


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

    def made(shape: dict[str, Any]) -> SedNet:
        return SedNet(Architecture(**{**shape, "widths": tuple(shape["widths"])}))

    return _loaded(Path(path or SHIPPED), FORMAT, made)


def save_splinenet(network: SplineNet, path: Path, half: bool = False) -> None:
    """The same for SplineNet."""
    _save(network, path, half, SPLINE_FORMAT)


def load_splinenet(path: Path | None = None) -> SplineNet:
    """The same for SplineNet. Raises WeightsError."""
    return _loaded(Path(path or SHIPPED_SPLINENET), SPLINE_FORMAT, lambda shape: SplineNet(SplineShape(**shape)))


def _loaded(path: Path, kind: str, make: Callable[[dict[str, Any]], Network]) -> Network:
    if not path.is_file():
        raise WeightsError(f"There is no weights file {path}.")
    try:
        with safe_open(path, "pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name).float() for name in file.keys()}
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"The weights file {path} is damaged or not in safetensors format.") from error
    if metadata.get("format") != kind:
        raise WeightsError(f"The weights file {path} holds another network.")
    try:
        network = make(json.loads(metadata["architecture"]))
        network.load_state_dict(tensors)
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise WeightsError(f"The weights file {path} does not fit the network it names.") from error
    if not all(torch.isfinite(tensor).all() for tensor in tensors.values()):
        raise WeightsError(f"The weights file {path} holds values that are not finite.")
    return network.eval()
