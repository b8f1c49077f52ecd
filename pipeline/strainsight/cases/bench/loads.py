"""The loads of a bench in time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from strainsight.cases.bench.bench import Bench
from strainsight.cases.structure.settings import signal_of
from strainsight.errors import ConfigError, blame
from strainsight.signals.histories import evaluate
from strainsight.workflow.stage import Context

LARGEST = 1e50
"""[N, N m] Its fourth power is still a number."""


def loads_of(context: Context, bench: Bench) -> Callable[[np.ndarray], np.ndarray]:
    """Time (k,) [s] → inputs (k, nu) [N, N m] in the order of the system."""
    signals = {}
    for name in bench.system.inputs:
        with blame(f"forces.{name}.signal"):
            signals[name] = signal_of(name, context.config.forces[name].signal, context.files, "forces")

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
