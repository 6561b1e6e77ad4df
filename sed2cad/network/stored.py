"""Weights on disk: safetensors (never pickle), with the network's shape in the metadata."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open

from sed2cad.errors import WeightsError
from sed2cad.network.architecture import Architecture, SplineShape

SHIPPED = Path(__file__).with_name("sednet.safetensors")
FORMAT = "sed2cad-sednet-1"
SHIPPED_SPLINENET = Path(__file__).with_name("splinenet.safetensors")
SPLINE_FORMAT = "sed2cad-splinenet-1"

Arrays = dict[str, NDArray[np.float32]]


@dataclass(frozen=True)
class Stored:
    """What a file holds."""

    path: Path
    shape: Any  # as the file says; a dict if it is right
    arrays: Arrays

    @property
    def misfit(self) -> WeightsError:
        """What to say where the weights do not fit the shape."""
        return WeightsError(f"The weights file {self.path} does not fit the network it names.")

    def architecture(self) -> Architecture:
        """Of SED-Net. Raises WeightsError."""
        try:
            return Architecture(**{**self.shape, "widths": tuple(self.shape["widths"])})
        except (KeyError, TypeError) as error:
            raise self.misfit from error

    def spline_shape(self) -> SplineShape:
        """Of SplineNet. Raises WeightsError."""
        try:
            return SplineShape(**self.shape)
        except TypeError as error:
            raise self.misfit from error


def stored_weights(path: Path, kind: str) -> Stored:
    """The weights in a file of this kind, in 32 bits. Raises WeightsError."""
    if not path.is_file():
        raise WeightsError(f"There is no weights file {path}.")
    try:
        with safe_open(path, "np") as file:
            metadata = file.metadata() or {}
            arrays = {name: file.get_tensor(name).astype(np.float32) for name in file.keys()}
    except (SafetensorError, OSError) as error:
        raise WeightsError(f"The weights file {path} is damaged or not in safetensors format.") from error
    if metadata.get("format") != kind:
        raise WeightsError(f"The weights file {path} holds another network.")
    try:
        shape = json.loads(metadata["architecture"])
    except (KeyError, ValueError) as error:
        raise Stored(path, None, {}).misfit from error
    if not all(np.isfinite(array).all() for array in arrays.values()):
        raise WeightsError(f"The weights file {path} holds values that are not finite.")
    return Stored(path, shape, arrays)
