"""Artefacts of benches made by hand: what simulate and estimate would write, with numbers that a test can tell."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from strainsight.records.bench_estimated import (
    BallsThen,
    BenchEstimated,
    LoadHistory,
    ParameterHistory,
    ParameterRuns,
    RingEstimate,
    SensorMatch,
)
from strainsight.records.record import written as datasets_of
from strainsight.records.simulated import RingMotion, Simulated, Violation, WorstInstant
from strainsight.workflow.artefact import Artefact, Header
from strainsight.workflow.output import Output, Table
from strainsight.workflow.store import write_artefact

STEPS = 60
UNITS = {
    "input Fz": "N", "parameter ball": "m", "sensor relative": "m or rad", "sensor tip": "m", "sensor gauges": "strain",
    "the channel": "strain", "the intensity": "strain^2 s",
}  # fmt: skip
SENSORS = {name: {"type": kind} for name, kind in (("relative", "relative"), ("tip", "motion"), ("gauges", "strain"))}


def written(folder: Path, stage: str, record, summary, tables=()) -> Artefact:
    header = Header(stage, 1, f"key-{folder.name}-{stage}", {"sensors": SENSORS}, {}, {})
    output = Output(datasets_of(record, UNITS), summary, stage, tables=tables)
    return write_artefact(folder / f"{stage}.h5", output, header)


def simulated(folder: Path) -> Artefact:
    """A blade on a bearing that one force pulls."""
    time = np.linspace(0.0, 3.0, STEPS + 1)
    load = 5e4 * np.sin(2 * time)
    five, still = np.outer(load, [1e-10, 2e-9, 3e-9, 4e-9, 5e-9]), np.zeros(len(time))
    worst = WorstInstant(time=0.8, force=np.ones((1, 4)), contact_angle=np.ones((1, 4)), pressure=np.ones((1, 4)))
    ring = RingMotion(displacement=five, load=1e9 * five, pressure=1e9 + np.abs(load) * 1e4, worst=worst)
    record = Simulated(
        time=time,
        q=five,
        v=five,
        violation=Violation(position=still, velocity=still),
        frequency=np.array([4.2]),
        coordinates={"blade": np.array([0, 5])},
        inputs={"Fz": load},
        sensors={"relative": five, "tip": five[:, :3]},
        bearings={"pitch": ring},
        drives={},
    )
    summary = {"steps": STEPS, "coordinates": 28, "constraints": 7, "violation": 2e-16, "first_frequency": 4.2}
    return written(folder, "simulate", record, summary)


def estimated(folder: Path, error=0.01, there=None, truth=True, parameter=True, lost=0, seed=0) -> Artefact:
    """A force and a ball diameter, off by `error` of the largest force; there: the factor on another bench's load."""
    time = np.linspace(0.0, 3.0, STEPS + 1)
    true = 5e4 * np.sin(2 * time)
    wrong = 5e4 * error * np.random.default_rng(seed).standard_normal(len(time))
    load = LoadHistory(
        estimate=true + wrong,
        std=np.full(len(time), 5e4 * max(error, 1e-12)),
        smoothed=true + 0.5 * wrong,
        smoothed_std=np.full(len(time), 5e4 * max(error, 1e-12) / 2),
        true=true if truth else None,
        there=None if there is None else true / there,
    )
    summary = {"channels": 9, "unknowns": 2, "nis": 1.0, "expected_nis": 8 / 9, "violation": 1e-16, "lost": lost,
               "method": "iterated <with the step>", "truth": "own step", "std.Fz": error}  # fmt: skip
    if truth:
        summary |= {"error.Fz": error, "slope.Fz": 1.001, "offset.Fz": 12.5, "largest_error.Fz": 3 * error}
    if there is not None:
        summary |= {"ratio_slope.Fz": there, "ratio_offset.Fz": 3.0, "ratio_mean.Fz": there}
        summary |= {"ratio_low.Fz": 0.9 * there, "ratio_high.Fz": 1.1 * there}
    parameters, runs = {}, {}
    if parameter:
        diameter = 0.06 * (1 + 0.01 * np.exp(-5 * time) + error * 1e-3)
        parameters["ball"] = ParameterHistory(estimate=diameter, std=6e-4 * np.exp(-5 * time) + 1e-8, true=0.06)
        off = 1e-7 * np.array([1.0, -2.0, 1.5])
        runs["ball"] = ParameterRuns(
            start=np.array([0.0606, 0.0594, 0.06]), estimate=0.06 + off, std=np.full(3, 1.2e-7), error=off
        )
        summary |= {"error.ball": 1e-6, "std.ball": 2e-6, "ratio.ball": 1.1, "identified.ball": True}
    sensors = {}
    for name, scale, width in (("relative", 1e-9, 5), ("gauges", 1e-10, 4)):
        measured = np.outer(true[1:], scale * np.arange(1, width + 1))
        sensors[name] = SensorMatch(
            used=name == "gauges", expected=measured + scale * wrong[1:, None], measured=measured
        )
        summary |= {f"mismatch.{name}": error} | {f"mismatch.{name}.{i}": error for i in range(1, width + 1)}
    record = BenchEstimated(
        time=time,
        q=np.zeros((len(time), 5)),
        violation=np.full(len(time), 1e-16),
        nis=1 + 0.3 * np.cos(9 * time[1:]),
        lost=np.array([-1]),
        inputs={"Fz": load},
        parameters=parameters,
        sensors=sensors,
        input_runs={},
        parameter_runs=runs,
        seeds={},
        bearings={"bearing": _ring(time)},
    )
    warnings = Table("warnings", ("",), (("a noise of 0 is <floored>",),))
    return written(folder, "estimate", record, summary, (warnings,))


def _ring(time: np.ndarray) -> RingEstimate:
    """Twelve balls, the third of which carries 40 ± 0.3 kN on one diagonal at 2 ± 0.01 GPa."""
    z = np.arange(12)
    force = 4e4 * np.maximum(np.cos(2 * np.pi * (z - 2) / 12), 0)[:, None] * [1.0, 0.5, 1.0, 0.5]
    balls = BallsThen(
        time=1.5, station=2 * np.pi * z / 12, force=force, force_std=7.5e-3 * force / 2, pressure=5e4 * force,
        pressure_std=500 * force,
    )  # fmt: skip
    return RingEstimate(
        displacement=np.zeros((len(time), 5)), std=np.full((len(time), 5), 1e-7), instants=time[::10],
        pressure=2e9 - 1e8 * (time[::10] - 1.5) ** 2, pressure_std=np.full(len(time[::10]), 5e6), worst=balls,
    )  # fmt: skip
