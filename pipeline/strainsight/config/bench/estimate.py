"""What a bench's filter estimates, from which sensors, and what stands for reality."""

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
    """A sensor that the filter is given."""

    noise: Annotated[NotNegative | tuple[NotNegative, ...], NOISE] = Field(
        description="σ of a sample [strain, m, m/s, m/s², rad], one for all components or one each; of a relative motion the "
        "second half of a pair in m and rad is written out: five numbers."
    )
    bias: Annotated[NotNegative | tuple[NotNegative, ...], NOISE] = expert(
        0.0,
        description="σ of an unknown constant offset of every component, which is estimated, too [as noise]; 0: none. A "
        "simulated truth draws it for every seed.",
    )
    drift: Annotated[NotNegative | tuple[NotNegative, ...], NOISE] = expert(
        0.0,
        description="σ of what that offset changes by in a second, as a random walk, √t times that in t [as noise per √s]; 0: it "
        "stays.",
    )
    layout: Literal["place", "random"] | None = expert(
        None,
        description="Of a sensor under `place.sensors`: the filter is given the components that are in the layout that was "
        "placed, or in the first one drawn at random; null: all.",
    )


class UnknownInput(InputNoise):
    """A force or moment of the bench that the filter does not know, and how it moves in time."""

    guess: Annotated[float | None, DRIVEN] = expert(
        None,
        description="First estimate [N or N m]; null: its history's first value, as where a test begins under known loads; with "
        "`measured` the load that explains the first sample at rest.",
    )
    std: Annotated[Positive, DRIVEN] = Field(description="σ of the first estimate [N or N m].")
    increment: Annotated[Positive | None, DRIVEN] = Field(
        None,
        description="Of a random walk: σ of its change in a step, or in a second (see `increments`) [N or N m]; null: that of "
        "its amplitude, frequency and kappa.",
    )
    amplitude: Annotated[Positive | None, DRIVEN] = expert(
        None, description="Typical amplitude of the load [N or N m]; null: that of the sine that its history is."
    )


class EstimatedParameter(Section):
    """A parameter that the filter's model has wrong, and may estimate.

    A Young's modulus under its name in `bodies.*.moduli`, or a property of a bearing under any name.
    """

    bearing: BearingName | None = Field(None, description="Name of the bearing; null: a modulus of that name.")
    property: BearingParameter | None = Field(None, description="Which property of the bearing.")
    guess: Annotated[float | None, PARAMETER] = Field(
        None, description="What the filter starts from [m or Pa]; null: the bench's own value."
    )
    std: ParameterValue | None = Field(
        None, description="σ of the guess [m or Pa]; null: the guess is taken for the truth and not estimated."
    )
    increment: Annotated[NotNegative, PARAMETER] = Field(
        0.0, description="σ of its change in a step, or in a second [m or Pa]."
    )
    starts: Annotated[tuple[float, ...], PARAMETER] = Field(
        (), description="Further guesses, a run each: do all end alike? [m or Pa]."
    )

    def guesses(self) -> list[tuple[str, float]]:
        """Every value that a filter starts from, with its key."""
        stated = (("guess", self.guess), *(("starts", start) for start in self.starts))
        return [(key, value) for key, value in stated if value is not None]

    def problems(self) -> Iterator[Problem]:
        if (self.bearing is None) != (self.property is None):
            yield Problem(
                "", "bearing and property belong together", "give both, or neither for a modulus", at_key=True
            )
        if self.starts and self.std is None:
            yield Problem("starts", "it is not estimated", "give std, or leave starts out")
        if self.std is None and self.guess is None:
            yield Problem(
                "", "neither guess nor std: nothing is wrong with it", "give one, or leave it out", at_key=True
            )
        for key, value in self.guesses():
            if self.property != "preload" and not value > 0:
                yield Problem(key, f"{value:g} is not positive", "give a positive value")


class BenchTruth(Section):
    """What stands for reality: the bench with the values of the config."""

    model: Literal["fine", "other", "own", "walk"] = Field(
        "fine",
        description="fine: integrated with a finer step; other: by another integrator, of fifth order (Radau), which shares no "
        "step with the filter; own: with the filter's step; walk: that, with inputs, parameters and disturbance drawn from the "
        "filter's own model.",
    )
    substeps: int = expert(20, ge=1, le=10_000, description="fine: steps of the truth in a step of the filter [-].")
    noise: bool = Field(True, description="false: the sensors read exactly, whatever noise the filter believes.")
    step: TimeStep = Field(0.01, description="other: its step, within which loads are straight [s].")
    duration: Duration | None = Field(
        None,
        description="other: its length, which runs that estimate less of it can share [s]; null: that of the estimate.",
    )
    histories: int = Field(
        1, ge=1, le=10_000, description="other: load histories, one a seed (`runs`); 1: the same one for all [-]."
    )
    within: Annotated[NotNegative, INSTANT] = Field(
        0.0,
        description="other: every further history is the stated one from an instant on that is drawn up to this one, shifted so "
        "that it begins with the same loads [s].",
    )


class FromRun(Section):
    """Measurements from another bench: what its sensors read there, the filter's bench must read here (thesis 4)."""

    run: Text = Field(
        alias="from",
        description="Name of the run (results/NAME/simulate.h5), or the path of such a file from the config's folder.",
    )
    sensors: dict[Name, Text] = expert({}, description="Own sensor → sensor there; left out: the one of the same name.")
    inputs: dict[Name, Text] = expert(
        {}, description="Own input → input there, to divide one by the other; default as above."
    )
    scale: Annotated[Positive, Plausible(1e-3, 1e3)] = Field(1.0, description="Factor on lengths of the other run [-].")


class FromFile(RecordedFile):
    """Measurements of a test of this bench, from a file whose first sample is the start."""

    file: Text = expert(description="CSV, HDF5, UFF58, MDF4, TDMS or MAT file, from the config's folder.")
    channels: Annotated[dict[Name, tuple[Channel | None, ...]], Field(min_length=1)] = expert(
        description="Sensor → a channel of the file for each of its components, in their order: {channel: NAME, unit: um/m}; "
        "null: not measured."
    )


Measured = Annotated[
    Annotated[FromRun, Tag("from")] | Annotated[FromFile, Tag("file")],
    key_of("from", "file"),
]


class Method(Section):
    """How a measurement corrects the estimate."""

    update: Literal["iterated", "one_shot", "undamped", "as_printed"] = Field(
        "iterated",
        description="iterated: damped Gauss-Newton on the most probable state with the step inside; one_shot: the extended "
        "Kalman filter, put back onto the constraints; undamped: iterated without its damping; as_printed: the thesis's (1.58) "
        "to (1.60), one update at the first guess, the prediction, whose outcome is on no constraint until the next step.",
    )
    noise: Literal["before_step", "as_printed"] = Field(
        "before_step",
        description="before_step: loads, parameters and disturbance change as the step begins, which moves the bench, so that "
        "its constraints hold; as_printed: the thesis's Q* of (1.45) and (1.57), in diagonal blocks added after the step, that "
        "of the motion by `disturbance` on every velocity, whatever the joints: σ of a load is at least its increment.",
    )
    iterations: int = expert(10, ge=1, le=100, description="Most iterations of a step [-].")
    parameters: Literal["extended", "bank"] = Field(
        "extended",
        description="extended: parameters are states of the filter beside motion and loads, as in the thesis; bank: they are "
        "constants, up to three, and iterated filters of motion and loads at many of their values give their distribution. A "
        "bank takes increments of unknown loads for true, and 15 to 30 times as long.",
    )
    step_error: Literal["estimated", "ignored"] | None = expert(
        None,
        description="estimated: the filter adds what its step leaves out, by the bench linearised along the step, and takes the "
        "path of the loads within the step and what is left for noise of the motion; ignored: the step, with straight loads, is "
        "taken for true; null: ignored with `simulate.method: thesis` or `noise: as_printed`, where the truth is made by the "
        "filter's own step, and beside driven joints.",
    )


class BenchEstimateSection(EstimateOptions):
    """Loads and parameters of the bench from its sensors (thesis 2 to 4)."""

    time_step: TimeStep | None = Field(
        None, description="Time step of filter and samples [s]; null: simulate.time_step."
    )
    duration: Duration | None = Field(None, description="Length of the estimate [s]; null: simulate.duration.")
    sensors: Annotated[dict[Name, MeasuredSensor], Field(min_length=1)] = Field(
        description="The sensors that the filter is given; all others are compared with it."
    )
    inputs: dict[Name, UnknownInput] = Field(
        {}, description="Unknown forces and moments, by their names under `forces`."
    )
    parameters: dict[Name, EstimatedParameter] = Field({}, description="Parameters that the filter has wrong, by name.")
    increments: Literal["step", "second"] = Field(
        "step",
        description="Whether `increment` is σ of the change in a step, whatever its length, or in a second (Q ∝ h²).",
    )
    tolerances: GaugeTolerances | None = expert(
        None,
        description="How gauges are installed: constants of which the filter learns nothing, and which its σ covers, to first "
        "order; a simulated truth draws them for every seed; {}: σ as a structure has them. null: gauges are exact.",
    )
    disturbance: Annotated[NotNegative, Plausible(1e-9, 1e4, "m/s²")] = Field(
        0.0, description="σ of a white acceleration on every body, drawn anew in every step: model error [m/s²]."
    )
    truth: BenchTruth = with_defaults(BenchTruth, "What stands for reality.")
    measured: Measured | None = Field(
        None, description="Measurements instead: of another bench (from), or of a test (file)."
    )
    method: Method = with_defaults(Method, "How a measurement corrects the estimate.")
    runs: int = Field(1, ge=1, le=10_000, description="Seeds of the noise, a run each [-].")
    allow_unfollowed: bool = Field(
        False, description="true: go on where the step does not follow what the loads move: σ does not allow for that."
    )
