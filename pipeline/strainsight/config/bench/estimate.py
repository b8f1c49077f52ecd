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
        description="Noise standard deviation of one sample [strain, m, m/s, m/s² or rad]: one value for all components, or "
        "a list with one value for each component. A sensor of type `relative` needs a list of five values: three in m, then "
        "two in rad."
    )
    bias: Annotated[NotNegative | tuple[NotNegative, ...], NOISE] = expert(
        0.0,
        description="Standard deviation of a constant zero offset of every sensor component [unit of `noise`]. The filter "
        "estimates the zero offset. 0: no zero offset. Simulated measurements have a new random zero offset for every seed.",
    )
    drift: Annotated[NotNegative | tuple[NotNegative, ...], NOISE] = expert(
        0.0,
        description="Standard deviation of the change of the zero offset in one second, modelled as a random walk [unit of "
        "`noise` per √s]; 0: constant zero offset.",
    )
    layout: Literal["place", "random"] | None = expert(
        None,
        description="For a candidate sensor under `place.sensors`: components that the filter uses. With `place`: the "
        "components in the optimised layout. With `random`: the components in the first random layout. Null: all "
        "components.",
    )


class UnknownInput(InputNoise):
    """An unknown force or moment of the bench, and its model in time."""

    guess: Annotated[float | None, DRIVEN] = expert(
        None,
        description="Initial estimate of the load [N or N m]. Null: the first value of the signal under `forces`; with "
        "`estimate.measured`, the load whose static readings of the bench fit the first sample best.",
    )
    std: Annotated[Positive, DRIVEN] = Field(
        description="Standard deviation of the initial estimate of the load [N or N m]."
    )
    increment: Annotated[Positive | None, DRIVEN] = Field(
        None,
        description="With `model: random_walk`: standard deviation of the load change in one time step or one second, see "
        "`estimate.increments` [N or N m]. Null: computed from `amplitude`, `frequency` and `kappa`.",
    )
    amplitude: Annotated[Positive | None, DRIVEN] = expert(
        None,
        description="Typical amplitude of the load [N or N m]. Null: amplitude of a sine signal of the load under `forces`.",
    )


class EstimatedParameter(Section):
    """A parameter that the filter estimates, or that differs between filter and simulated test. It is either a
    Young's modulus, named as in `bodies.*.moduli`, or a property of a bearing, with a name of your choice."""

    bearing: BearingName | None = Field(
        None,
        description="Name of the bearing with this parameter. Null: the parameter is the Young's modulus of the same "
        "name in `bodies.*.moduli`.",
    )
    property: BearingParameter | None = Field(
        None, description="Property of the bearing that is the parameter; null for a modulus."
    )
    guess: Annotated[float | None, PARAMETER] = Field(
        None,
        description="Initial value of the parameter in the filter [m or Pa]; null: the value in `bearings` or `bodies`.",
    )
    std: ParameterValue | None = Field(
        None,
        description="Standard deviation of the initial value [m or Pa]. Null: the filter does not estimate the parameter, "
        "but keeps the initial value.",
    )
    increment: Annotated[NotNegative, PARAMETER] = Field(
        0.0,
        description="Standard deviation of the change of the parameter in one time step or one second, see "
        "`estimate.increments` [m or Pa].",
    )
    starts: Annotated[tuple[float, ...], PARAMETER] = Field(
        (),
        description="Additional initial values of the parameter [m or Pa]. The filter runs once with each value, to check "
        "that all runs converge to the same result.",
    )

    def guesses(self) -> list[tuple[str, float]]:
        """Every initial value with its key."""
        entries = (("guess", self.guess), *(("starts", start) for start in self.starts))
        return [(key, value) for key, value in entries if value is not None]

    def problems(self) -> Iterator[Problem]:
        if (self.bearing is None) != (self.property is None):
            what = "only one of the keys 'bearing' and 'property' is set"
            yield Problem("", what, "set both keys for a bearing; remove both keys for a modulus", at_key=True)
        if self.starts and self.std is None:
            what = "has no effect: without 'std', the parameter is not estimated"
            yield Problem("starts", what, "set std, or remove this key")
        if self.std is None and self.guess is None:
            what = "the entry has no effect: neither 'guess' nor 'std' is set"
            yield Problem("", what, "set guess or std, or remove the entry", at_key=True)
        for key, value in self.guesses():
            if self.property != "preload" and not value > 0:
                yield Problem(
                    key, f"the initial value {value:g} of the parameter is not positive", "use a positive value"
                )


class BenchTruth(Section):
    """Simulation of the measurements, with the values under `bodies` and `bearings` as true parameters."""

    model: Literal["fine", "independent", "filter_step", "sampled"] = Field(
        "fine",
        description="Model of the simulated measurements. With `fine`: the bench, integrated with smaller steps "
        "(`substeps`). With `independent`: the bench, integrated with an independent method of fifth order (Radau). "
        "With `filter_step`: the bench, integrated with the step of the filter. With `sampled`: as `filter_step`, with "
        "random loads, parameters and disturbance from the model of the filter.",
    )
    substeps: int = expert(
        20, ge=1, le=10_000, description="With `model: fine`: number of simulation steps per filter step [-]."
    )
    noise: bool = Field(
        True, description="`false`: the simulated readings have no noise; the noise assumed by the filter is unchanged."
    )
    step: TimeStep = Field(
        0.01,
        description="With `model: independent`: time step of the simulation [s]; loads vary linearly within each step.",
    )
    duration: Duration | None = Field(
        None,
        description="With `model: independent`: duration of the simulation [s]; null: duration of the estimate. Configs with the "
        "same duration share one simulation, even if their estimates are shorter.",
    )
    histories: int = Field(
        1,
        ge=1,
        le=10_000,
        description="With `model: independent`: number of load histories, one for each run in `estimate.runs` [-]. 1: the same "
        "history for all runs.",
    )
    within: Annotated[NotNegative, INSTANT] = Field(
        0.0,
        description="With `model: independent`: latest start of the further load histories [s]. Each further history is a part "
        "of the configured history from a random instant before `within`. A constant is added to obtain the same initial loads.",
    )


class FromRun(Section):
    """Measurements from the simulation of another bench, as in chapter 4 of the thesis (Cottone 2022)."""

    run: Text = Field(
        alias="from",
        description="Name of the run whose simulated readings are the measurements (results/NAME/simulate.h5), or path of a "
        "file simulate.h5, relative to the folder of the config.",
    )
    sensors: dict[Name, Text] = expert(
        {},
        description="Mapping: name of a sensor of this bench → name of the sensor in `measured.from`. A sensor that is not "
        "listed has the same name in both benches.",
    )
    inputs: dict[Name, Text] = expert(
        {},
        description="Mapping: name of an unknown load of this bench → name of the load in `measured.from` with which the "
        "estimate is compared. A load that is not listed has the same name in both benches.",
    )
    scale: Annotated[Positive, Plausible(1e-3, 1e3)] = Field(
        1.0,
        description="Scale factor on lengths [-]: readings in m, m/s and m/s² of the bench in `measured.from` are multiplied by "
        "this factor.",
    )


class FromFile(RecordedFile):
    """Measurements from a test of this bench; the estimate starts at the first sample."""

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
        description="Measurement update of the filter. With `iterated`: damped Gauss-Newton iterations for the most probable "
        "state. With `one_shot`: one update at the predicted state (extended Kalman filter), then projection of the "
        "state onto the joint constraints. With `undamped`: Gauss-Newton iterations without damping. With `as_printed`: one "
        "update at the predicted state, equations (1.58) to (1.60) of the thesis (Cottone 2022); the updated state violates "
        "the joint constraints until the next step.",
    )
    noise: Literal["before_step", "as_printed"] = Field(
        "before_step",
        description="Process noise of the filter. With `before_step`: added to loads, parameters and disturbance at the "
        "start of a step; the joint constraints remain satisfied. With `as_printed`: block-diagonal "
        "matrix Q* of the thesis (Cottone 2022), equations (1.45) and (1.57), added after the step. `disturbance` then acts "
        "on every velocity, and the velocities can violate the joint constraints. The standard deviation of a load is "
        "then at least the `increment` of the load.",
    )
    iterations: int = expert(
        10, ge=1, le=100, description="Largest number of iterations of the measurement update in each step [-]."
    )
    parameters: Literal["extended", "grid"] = Field(
        "extended",
        description="Treatment of the estimated parameters. With `extended`: parameters are states of the filter, as in the "
        "thesis (Cottone 2022). With `grid`: grid filter for up to three constant parameters. The standard deviations "
        "of this filter are valid only for correct increments of the unknown loads. The run time is 15 to 30 times longer.",
    )
    step_error: Literal["estimated", "ignored"] | None = expert(
        None,
        description="Discretisation error of a time step. With `estimated`: estimated from the linearised bench and the load "
        "history in the step, and included in the process noise of the motion. With `ignored`: each step is assumed exact, "
        "with loads that vary linearly. Null: `ignored` for `simulate.method: thesis`, `noise: as_printed`, simulated "
        "measurements with `truth.model: filter_step`, or driven joints; otherwise `estimated`.",
    )


class BenchEstimateSection(EstimateOptions):
    """Estimation of loads and parameters of the bench from its sensors (thesis of Cottone 2022, chapters 2 to 4)."""

    time_step: TimeStep | None = Field(
        None, description="Time step of the filter and of the samples [s]; null: `simulate.time_step`."
    )
    duration: Duration | None = Field(None, description="Duration of the estimate [s]; null: `simulate.duration`.")
    sensors: Annotated[dict[Name, MeasuredSensor], Field(min_length=1)] = Field(
        description="Sensors that the filter uses. For every other sensor, the estimated reading is compared with the simulated "
        "reading."
    )
    inputs: dict[Name, UnknownInput] = Field(
        {}, description="Unknown forces and moments, by their names under `forces`."
    )
    parameters: dict[Name, EstimatedParameter] = Field(
        {},
        description="Parameters that the filter estimates, or that differ between filter and simulated test, by name.",
    )
    increments: Literal["step", "second"] = Field(
        "step",
        description="Time interval for the keys `increment` of loads and parameters: one time step of any length (`step`), "
        "or one second (`second`). With `second`, the variance of the change in a time step is proportional to "
        "the square of the time step.",
    )
    tolerances: GaugeTolerances | None = expert(
        None,
        description="Tolerances of the gauge installation. The filter does not estimate installation errors, but the "
        "tolerances increase the standard deviations of the estimates (to first order). Simulated measurements have "
        "new random installation errors for every seed. {}: default values of all tolerances. Null: exact gauges.",
    )
    disturbance: Annotated[NotNegative, Plausible(1e-9, 1e4, "m/s²")] = Field(
        0.0,
        description="Model error: standard deviation of a random acceleration of every body (white noise, constant in each "
        "time step) [m/s²].",
    )
    truth: BenchTruth = with_defaults(BenchTruth, "Simulation of the measurements.")
    measured: Measured | None = Field(
        None,
        description="Imported measurements: from the simulation of another bench (`from`), or from a test (`file`).",
    )
    method: Method = with_defaults(Method, "Options of the filter.")
    runs: int = Field(
        1,
        ge=1,
        le=10_000,
        description="Number of runs of the filter, each with another seed of the measurement noise [-].",
    )
    allow_unresolved_steps: bool = Field(
        False,
        description="`true`: continue even if the time step is too long to resolve the load histories. The standard "
        "deviations of the estimates do not include the resulting error.",
    )
