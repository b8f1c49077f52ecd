"""Estimation on a bench: sensors, unknowns, filter, and simulated or imported measurements."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, Tag

from strainsight.config.base import (
    DRIVEN,
    INSTANT,
    NOISE,
    PARAMETER,
    BearingName,
    Duration,
    Name,
    NotNegative,
    ParameterValue,
    Plausible,
    Positive,
    Problem,
    Section,
    Text,
    TimeStep,
    expert,
    with_defaults,
)
from strainsight.config.estimate import Channel, EstimateOptions, RecordedFile
from strainsight.config.layout import key_of
from strainsight.config.loads import InputNoise
from strainsight.config.tolerances import GaugeTolerances

BearingParameter = Literal[
    "ball_diameter", "radius_inner_left", "radius_inner_right", "radius_outer_left", "radius_outer_right", "preload"
]


class MeasuredSensor(Section):
    """A sensor that the filter uses."""

    noise: Annotated[NotNegative | tuple[NotNegative, ...], NOISE] = Field(
        description="Noise standard deviation of one sample [strain, m, m/s, m/s², rad], one value for all components or one "
        "for each. A relative motion has components in m and rad: list all five values."
    )
    bias: Annotated[NotNegative | tuple[NotNegative, ...], NOISE] = expert(
        0.0,
        description="Standard deviation of a constant offset of every component [unit of `noise`]; the filter "
        "estimates the offset. 0: no offset. Simulated measurements sample the offset for every seed.",
    )
    drift: Annotated[NotNegative | tuple[NotNegative, ...], NOISE] = expert(
        0.0,
        description="Standard deviation of the change of the offset in one second, as a random walk [unit of noise per √s]; "
        "0: constant offset.",
    )
    layout: Literal["place", "random"] | None = expert(
        None,
        description="Components that the filter uses of a candidate under `place.sensors`: components in the placed "
        "layout, or in the first random layout. Null: all components.",
    )


class UnknownInput(InputNoise):
    """An unknown force or moment of the bench, and its model in time."""

    guess: Annotated[float | None, DRIVEN] = expert(
        None,
        description="Initial estimate of the load [N or N m]. Null: the first value of its history; with `measured`, "
        "the load that fits the first sample if the bench is at rest.",
    )
    std: Annotated[Positive, DRIVEN] = Field(description="Standard deviation of the initial load [N or N m].")
    increment: Annotated[Positive | None, DRIVEN] = Field(
        None,
        description="`random_walk`: standard deviation of the load change in one step or second (see `increments`) "
        "[N or N m]. Null: from amplitude, frequency and kappa.",
    )
    amplitude: Annotated[Positive | None, DRIVEN] = expert(
        None, description="Typical amplitude of the load [N or N m]; null: amplitude of its history, a sine."
    )


class EstimatedParameter(Section):
    """A parameter that differs between filter and simulated test, and may be estimated.

    It is a Young's modulus under its name in `bodies.*.moduli`, or a property of a bearing under any name."""

    bearing: BearingName | None = Field(
        None, description="Name of the bearing; null: the parameter is the modulus with the same name."
    )
    property: BearingParameter | None = Field(None, description="Bearing property that is the parameter.")
    guess: Annotated[float | None, PARAMETER] = Field(
        None, description="Initial value of the parameter in the filter [m or Pa]; null: the value in the bench."
    )
    std: ParameterValue | None = Field(
        None,
        description="Standard deviation of the initial value [m or Pa]; null: the parameter is assumed known and not estimated.",
    )
    increment: Annotated[NotNegative, PARAMETER] = Field(
        0.0, description="Standard deviation of the change in one step or second (see `increments`) [m or Pa]."
    )
    starts: Annotated[tuple[float, ...], PARAMETER] = Field(
        (),
        description="Additional initial values [m or Pa], each with one run, to check convergence to the same result.",
    )

    def guesses(self) -> list[tuple[str, float]]:
        """Every initial value with its key."""
        entries = (("guess", self.guess), *(("starts", start) for start in self.starts))
        return [(key, value) for key, value in entries if value is not None]

    def problems(self) -> Iterator[Problem]:
        if (self.bearing is None) != (self.property is None):
            yield Problem("", "only bearing or property is set", "set both keys, or neither for a modulus", at_key=True)
        if self.starts and self.std is None:
            yield Problem("starts", "the parameter is not estimated", "set std, or remove starts")
        if self.std is None and self.guess is None:
            what = "neither guess nor std is set, so the entry has no effect"
            yield Problem("", what, "set guess or std, or remove the entry", at_key=True)
        for key, value in self.guesses():
            if self.property != "preload" and not value > 0:
                yield Problem(key, f"{value:g} is not positive", "use a positive value")


class BenchTruth(Section):
    """Simulation of the measurements, with the parameter values of the config."""

    model: Literal["fine", "independent", "filter_step", "sampled"] = Field(
        "fine",
        description="Simulation of the measurements. With `fine`: integration with a smaller step. With `independent`: "
        "independent integrator of fifth order (Radau). With `filter_step`: integration with the step of the filter. With "
        "`sampled`: as `filter_step`, with inputs, parameters and disturbance sampled from the model of the filter.",
    )
    substeps: int = expert(20, ge=1, le=10_000, description="`fine`: number of simulation steps per filter step [-].")
    noise: bool = Field(
        True, description="`false`: simulated readings without noise; the noise in the filter is unchanged."
    )
    step: TimeStep = Field(
        0.01, description="`independent`: time step of the simulation [s]; loads are linear in each step."
    )
    duration: Duration | None = Field(
        None,
        description="`independent`: duration of the simulation [s]; null: duration of the estimate. With a common "
        "duration, runs with shorter estimates share one simulation.",
    )
    histories: int = Field(
        1,
        ge=1,
        le=10_000,
        description="`independent`: number of load histories, one for each seed (`runs`); 1: the same history for all seeds [-].",
    )
    within: Annotated[NotNegative, INSTANT] = Field(
        0.0,
        description="`independent`: largest start of further load histories [s]. Each further history is a part of the "
        "configured history from a random instant, shifted to the same initial loads.",
    )


class FromRun(Section):
    """Measurements from the simulation of another bench (thesis 4)."""

    run: Text = Field(
        alias="from",
        description="Name of the run with the measurements (results/NAME/simulate.h5), or path of such a file "
        "relative to the folder of the config.",
    )
    sensors: dict[Name, Text] = expert(
        {}, description="Sensor of this bench → sensor of the other bench; default: the same name."
    )
    inputs: dict[Name, Text] = expert(
        {},
        description="Input of this bench → input of the other bench, to compare the estimates; default: the same name.",
    )
    scale: Annotated[Positive, Plausible(1e-3, 1e3)] = Field(
        1.0, description="Factor on lengths of the other bench [-]."
    )


class FromFile(RecordedFile):
    """Measurements from a test of this bench; the first sample is the start."""

    file: Text = Field(
        description="Measurement file in CSV, HDF5, UFF58, MDF4, TDMS or MAT format, relative to the folder of the config."
    )
    channels: Annotated[dict[Name, tuple[Channel | None, ...]], Field(min_length=1)] = Field(
        description="Sensor → list of channels, one for each component in order: {channel: NAME, unit: um/m}, or null for a "
        "component that is not measured."
    )


Measured = Annotated[Annotated[FromRun, Tag("from")] | Annotated[FromFile, Tag("file")], key_of("from", "file")]


class Method(Section):
    """Options of the filter."""

    update: Literal["iterated", "one_shot", "undamped", "as_printed"] = Field(
        "iterated",
        description="Measurement update. With `iterated`: damped Gauss-Newton iterations for the most probable state. With "
        "`one_shot`: extended Kalman filter, projected onto the constraints. With `undamped`: iterations without damping. "
        "With `as_printed`: one update at the prediction, (1.58) to (1.60) of the thesis, which violates the constraints "
        "until the next step.",
    )
    noise: Literal["before_step", "as_printed"] = Field(
        "before_step",
        description="Process noise. With `before_step`: added to loads, parameters and disturbance at the start of a step, "
        "so the constraints remain satisfied. With `as_printed`: Q* of the thesis, (1.45) and (1.57): diagonal blocks added "
        "after the step, with `disturbance` on every velocity, independent of the joints. The σ of a load is then at least "
        "its increment.",
    )
    iterations: int = expert(10, ge=1, le=100, description="Largest number of iterations per step [-].")
    parameters: Literal["extended", "grid"] = Field(
        "extended",
        description="Treatment of parameters. With `extended`: parameters are states of the filter, as in the thesis. With "
        "`grid`: grid filter for up to three constant parameters; its σ assumes correct increments of the unknown loads, "
        "and its run time is 15 to 30 times longer.",
    )
    step_error: Literal["estimated", "ignored"] | None = expert(
        None,
        description="Discretisation error of a step. With `estimated`: included as noise of the motion, estimated from the "
        "linearised bench and the load history in the step. With `ignored`: each step is assumed exact, with linear loads. Null: "
        "estimated, except with `simulate.method: thesis`, `noise: as_printed`, measurements simulated with the step of the "
        "filter, or driven joints.",
    )


class BenchEstimateSection(EstimateOptions):
    """Estimation of loads and parameters of the bench from its sensors (thesis 2 to 4)."""

    time_step: TimeStep | None = Field(
        None, description="Time step of filter and samples [s]; null: simulate.time_step."
    )
    duration: Duration | None = Field(None, description="Duration of the estimate [s]; null: simulate.duration.")
    sensors: Annotated[dict[Name, MeasuredSensor], Field(min_length=1)] = Field(
        description="Sensors that the filter uses; all other sensors are compared with the estimate."
    )
    inputs: dict[Name, UnknownInput] = Field(
        {}, description="Unknown forces and moments, by their names under `forces`."
    )
    parameters: dict[Name, EstimatedParameter] = Field(
        {}, description="Parameters that differ between filter and simulated test, by name."
    )
    increments: Literal["step", "second"] = Field(
        "step",
        description="Time that `increment` refers to: one step of any length, or one second (Q ∝ h²).",
    )
    tolerances: GaugeTolerances | None = expert(
        None,
        description="Tolerances of gauge installation. They increase σ (to first order) but are not estimated; simulated "
        "measurements sample them for every seed. {}: the default tolerances of a structure. Null: exact gauges.",
    )
    disturbance: Annotated[NotNegative, Plausible(1e-9, 1e4, "m/s²")] = Field(
        0.0,
        description="Model error: standard deviation of a white acceleration of every body, constant in each step [m/s²].",
    )
    truth: BenchTruth = with_defaults(BenchTruth, "Simulation of the measurements.")
    measured: Measured | None = Field(
        None, description="Imported measurements: of another bench (from), or of a test (file)."
    )
    method: Method = with_defaults(Method, "Options of the filter.")
    runs: int = Field(1, ge=1, le=10_000, description="Number of runs, each with another noise seed [-].")
    allow_unresolved_steps: bool = Field(
        False,
        description="`true`: continue although the time step does not resolve the effect of the loads; σ does not include this "
        "error.",
    )
