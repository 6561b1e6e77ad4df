"""The same for every part, with one process or several."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TypeVar

Row = TypeVar("Row")


def of_each(score: Callable[[Path], Row], files: Sequence[Path], workers: int) -> list[Row]:
    """score(file) for each file, in their order; with several workers it has to be a function that can be pickled."""
    if workers == 1 or not files:
        return [score(file) for file in files]
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn")) as pool:
        return list(pool.map(score, files))
