"""Arrays row by row: some rows at a time stay in the cache, and threads share them out."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

CHUNK = 4_096


def by_rows(function: Callable[..., Any], *arrays: NDArray) -> Any:
    """function(*arrays), some rows at a time in threads; an array, or a tuple of arrays, of as many rows."""
    starts = range(0, max(len(arrays[0]), 1), CHUNK)
    with ThreadPoolExecutor(os.cpu_count()) as pool:  # numpy lets other threads work meanwhile
        parts = list(pool.map(lambda at: function(*(array[at : at + CHUNK] for array in arrays)), starts))
    if isinstance(parts[0], tuple):
        return tuple(np.concatenate(column) for column in zip(*parts))
    return np.concatenate(parts)
