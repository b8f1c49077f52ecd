"""validate.h5: the filter on a simulated truth."""

from __future__ import annotations

import numpy as np

from strainsight.records.estimated import UnknownHistories
from strainsight.records.record import dataset, group, record


@record
class SimulatedChannels:
    """The channels of the layout."""

    time: np.ndarray = dataset("s", "/time", "sampling times of the gauges")
    measured: np.ndarray = dataset("unit of the channel", "/time × channel", "measured by every channel, with noise")
    true: np.ndarray = dataset("unit of the channel", "/time × channel", "the same without noise")
    estimated: np.ndarray = dataset("unit of the channel", "/time × channel", "its estimate")
    std: np.ndarray = dataset("unit of the channel", "/time × channel", "its claimed standard deviation")


@record
class Consistency:
    nees: np.ndarray = dataset(
        "1", "/gauge/time", "normalised estimation error squared of the unknowns over their number"
    )
    nis: np.ndarray = dataset("1", "/gauge/time", "normalised innovation squared over the number of gauges")
    band: np.ndarray = dataset(
        "1", "2 × 2", "99.73 % bands, at least 1 / 1.21 to 1.21 (one instant of NEES, mean NIS of the run × low, high)"
    )


@record
class Field:
    """Every candidate at the instant of the largest true strain."""

    instant: float = dataset("s", "", "instant of the largest true strain")
    true: np.ndarray = dataset(
        "unit of the candidate", "candidate", "true strain, or displacement, at that instant; NaN of an accelerometer"
    )
    strain: np.ndarray = dataset("unit of the candidate", "candidate", "the same as estimated")
    std: np.ndarray = dataset("unit of the candidate", "candidate", "its claimed standard deviation")


@record
class Errors:
    """Of many runs, one for every `<what>`."""

    error: dict[str, np.ndarray] = dataset("1", "run", "real error of <name> for every <what>")
    std: dict[str, np.ndarray] = dataset("1", "run", "claimed error of <name> for every <what>")


@record
class NoiseStudy(Errors):
    factor: np.ndarray = dataset("1", "run", "noise over the configured noise")


@record
class Starts(Errors):
    start: dict[str, np.ndarray] = dataset(
        "1", "run", "start of <name> for every <what>, relative to its scale (parameters: logarithm)"
    )


@record
class RandomSetErrors(Errors):
    candidate: np.ndarray = dataset("1", "run × channel", "rows of train.h5 of every <what>, −1 for none")
    estimate: dict[str, np.ndarray] = dataset("unit of <name>", "/time × run", "estimate of <name> by every <what>")


@record
class SweepTable:
    key: tuple[str, ...] = dataset("1", "/key", "time_step, process_noise, or a wrong parameter")
    value: np.ndarray = dataset("1", "/key", "the time step [s], or the factor")
    error: dict[str, np.ndarray] = dataset("1", "/key", "real error of <name>")
    std: dict[str, np.ndarray] = dataset("1", "/key", "claimed error of <name>")


@record
class Validated(UnknownHistories):
    """validate.h5."""

    time: np.ndarray = dataset("s", "/time", "time of the validation run")
    truth: dict[str, np.ndarray] = dataset("unit of <name>", "/time", "true history of <name>")
    gauge: SimulatedChannels = group()
    consistency: Consistency = group()
    field: Field = group()
    noise: NoiseStudy = group(what="noise level")
    repeats: Starts = group(what="seed and start")
    screened: RandomSetErrors = group(path="/random_sets/screened", what="random set of the screened pool")
    all: RandomSetErrors = group(path="/random_sets/all", what="random set of all candidates")
    sweep: SweepTable | None = group(default=None)
