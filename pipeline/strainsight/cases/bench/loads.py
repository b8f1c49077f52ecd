"""The loads of a bench in time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np

from strainsight.cases.bench.bench import Bench
from strainsight.cases.histories import signal_of
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.connections import PointForce, PointMoment
from strainsight.errors import ConfigError, blame
from strainsight.signals.histories import evaluate

LARGEST = 1e50
"""[N, N m] Its fourth power is still a number."""


def load_units(config: BenchConfig, names: Iterable[str]) -> dict[str, str]:
    """Unit of each of these loads."""
    return {name: "N" if isinstance(config.forces[name], PointForce) else "N m" for name in names}


def loads_of(config: BenchConfig, bench: Bench, files: Mapping[str, Path]) -> Callable[[np.ndarray], np.ndarray]:
    """Time (k,) [s] → inputs (k, nu) [N, N m] in the order of the system."""
    signals = {}
    for name in bench.system.inputs:
        entry = config.forces[name]
        assert isinstance(entry, PointForce | PointMoment)
        with blame(f"forces.{name}.signal"):
            signals[name] = signal_of(name, entry.signal, files, "forces")

    def at(time: np.ndarray) -> np.ndarray:
        columns = []
        for name, signal in signals.items():
            with blame(f"forces.{name}.signal"):
                columns.append(evaluate(signal, time))
                largest = float(np.abs(columns[-1]).max(initial=0.0))
                if not largest <= LARGEST:
                    raise ConfigError(f"{largest:.2g} N or N m, more than {LARGEST:g}", remedy="check its unit")
        return np.column_stack(columns) if columns else np.zeros((len(time), 0))

    return at
