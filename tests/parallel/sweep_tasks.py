"""Tasks that other processes import: this folder is on the path of the workers that the tests start."""

from __future__ import annotations

import os
import signal
import time
import warnings
from pathlib import Path

import numpy as np


def product(shared: np.ndarray, seed: int) -> np.ndarray:
    """Something whose last bits would show another order of summation."""
    return shared @ np.random.default_rng([7, seed]).standard_normal(shared.shape[1])


def slow_product(shared: np.ndarray, seed: int) -> np.ndarray:
    time.sleep(0.15)
    return product(shared, seed)


def warned(shared: str, point: int) -> int:
    if point == 2:
        warnings.warn(f"{shared} {point}", UserWarning, stacklevel=1)
    return point


def refused(_shared: None, point: int) -> int:
    from strainsight.errors import ConfigError

    if point == 3:
        raise ConfigError("three is too many", key="validate.repeats", remedy="take two")
    return point


def killed_once(marker: str, point: int) -> int:
    """The process that meets point 3 first is gone, as by a machine that runs out of memory."""
    if point == 3 and not Path(marker).exists():
        Path(marker).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return point**2


def deadly(here: int, _point: int) -> None:
    """Ends every process but the test's own."""
    if os.getpid() != here:
        os.kill(os.getpid(), signal.SIGKILL)


def process(_shared: None, _point: int) -> int:
    time.sleep(0.1)
    return os.getpid()


def longer(_shared: None, seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def slow(_shared: None, point: int) -> int:
    time.sleep(0.3)
    return point
