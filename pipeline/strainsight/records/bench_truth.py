"""truth.h5: how a bench moves under its loads as seen from several instants on, by an integrator that no filter has."""

from __future__ import annotations

import numpy as np

from strainsight.records.record import dataset, record


@record
class BenchTruths:
    """Every history begins in the state of the config at the start, with its loads."""

    time: np.ndarray = dataset("s", "/time", "time, the start first")
    begin: np.ndarray = dataset("s", "history", "instant of the load histories at which each begins")
    q: np.ndarray = dataset("SI", "/time × history × coordinate", "coordinates")
    v: np.ndarray = dataset("SI", "/time × history × coordinate", "their rates")
    inputs: dict[str, np.ndarray] = dataset("unit of input <name>", "/time × history", "load <name>")
