"""validate.h5: the filter on simulated measurements."""

from __future__ import annotations

import numpy as np

from strainsight.records.estimated import UnknownHistories
from strainsight.records.record import dataset, group, record


@record
class SimulatedChannels:
    """Channels of the layout."""

    time: np.ndarray = dataset("s", "/time", "sampling times of the gauges")
    measured: np.ndarray = dataset("unit of the channel", "/time × channel", "simulated readings, with noise")
    true: np.ndarray = dataset("unit of the channel", "/time × channel", "simulated readings, without noise")
    estimated: np.ndarray = dataset("unit of the channel", "/time × channel", "estimated reading of every channel")
    std: np.ndarray = dataset("unit of the channel", "/time × channel", "standard deviation of every estimated reading")


@record
class Consistency:
    nees: np.ndarray = dataset(
        "1", "/gauge/time", "normalised estimation error squared (NEES), divided by the number of unknowns"
    )
    nis: np.ndarray = dataset(
        "1", "/gauge/time", "normalised innovation squared (NIS), divided by the number of gauges"
    )
    band: np.ndarray = dataset(
        "1",
        "2 × 2",
        "99.73 % limits [low, high] of the NEES at one instant (first row) and of the NIS averaged over the run (second row). "
        "Limits closer to 1 than 1/1.21 and 1.21 (a σ error of 10 %) are widened to these values",
    )


@record
class Field:
    """Every candidate at the instant of the largest true strain."""

    instant: float = dataset("s", "", "time of the largest true strain of all candidates")
    true: np.ndarray = dataset(
        "unit of the candidate",
        "candidate",
        "true strain (or displacement) of every candidate at /field/instant; NaN: accelerometer",
    )
    strain: np.ndarray = dataset(
        "unit of the candidate", "candidate", "estimated strain (or displacement) of every candidate at /field/instant"
    )
    std: np.ndarray = dataset(
        "unit of the candidate",
        "candidate",
        "standard deviation of the estimated strain (or displacement) of every candidate at /field/instant",
    )


@record
class Errors:
    """Results of many runs, one for every `<what>`."""

    error: dict[str, np.ndarray] = dataset(
        "1", "run", "relative error of <name> (parameter: final; load: RMS) for every <what>"
    )
    std: dict[str, np.ndarray] = dataset("1", "run", "estimated relative σ of <name> for every <what>")


@record
class NoiseStudy(Errors):
    factor: np.ndarray = dataset(
        "1", "run", "noise standard deviation of the gauges in every run, relative to the configured noise"
    )


@record
class Starts(Errors):
    start: dict[str, np.ndarray] = dataset(
        "1", "run", "initial value of <name> for every <what>: load/amplitude, or ln(parameter/guess)"
    )


@record
class RandomSetErrors(Errors):
    candidate: np.ndarray = dataset("1", "run × channel", "rows of train.h5 of every <what>; −1: none")
    estimate: dict[str, np.ndarray] = dataset("unit of <name>", "/time × run", "estimate of <name> with every <what>")


@record
class SweepTable:
    key: tuple[str, ...] = dataset(
        "1",
        "/key",
        "quantity changed in every filter run: time_step, process_noise, or the name of a parameter that is deliberately "
        "set to a wrong value",
    )
    value: np.ndarray = dataset(
        "1", "/key", "changed time step [s], or factor on the process noise or on the parameter"
    )
    error: dict[str, np.ndarray] = dataset("1", "/key", "relative error of <name> (parameter: final; load: RMS)")
    std: dict[str, np.ndarray] = dataset("1", "/key", "estimated relative σ of <name>")


@record
class Validated(UnknownHistories):
    """validate.h5."""

    time: np.ndarray = dataset("s", "/time", "times of the estimates in the simulated test")
    truth: dict[str, np.ndarray] = dataset("unit of <name>", "/time", "true time history of <name>")
    gauge: SimulatedChannels = group()
    consistency: Consistency = group()
    field: Field = group()
    noise: NoiseStudy = group(what="noise level")
    repeats: Starts = group(what="repeated filter run with other noise and initial values")
    screened: RandomSetErrors = group(
        path="/random_sets/screened", what="random gauge set from the candidates that remain after the stage `screen`"
    )
    all: RandomSetErrors = group(path="/random_sets/all", what="random gauge set from all candidates")
    sweep: SweepTable | None = group(default=None)
