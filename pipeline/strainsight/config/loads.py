"""Loads: location, signal in the training simulation, and model of an unknown load."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from strainsight.config.base import (
    DURATION,
    FREQUENCY,
    TURN,
    Amplitude,
    Count,
    DirectionVector,
    Duration,
    Frequency,
    Id,
    Name,
    NotNegative,
    Plausible,
    Point,
    Positive,
    Problem,
    Section,
    Seed,
    Text,
    TimeStep,
    exactly_one,
    expert,
    known,
    with_defaults,
)


class Oscillation(Section):
    """A signal that oscillates about zero."""

    amplitude: Amplitude = Field(
        description="Amplitude of the signal in the unit of the load [N; N m for a moment, Pa for a pressure, m/s² for "
        "gravity]. For a multisine: amplitude of a single sine with the same RMS value."
    )


class SineSection(Oscillation):
    """A sine: u(t) = a sin(2πft + φ) with a = `amplitude`, f = `frequency` and φ = `phase`."""

    type: Literal["sine"] = Field(description="Kind of signal: a sine.")
    frequency: Frequency = Field(description="Frequency of the sine [Hz].")
    phase: Annotated[float, TURN] = expert(0.0, description="Phase of the sine at t = 0 [rad].")


class SweepSection(Oscillation):
    """A sine sweep: the frequency changes linearly from start_frequency to end_frequency, and is constant after the sweep."""

    type: Literal["sweep"] = Field(description="Kind of signal: a sine sweep.")
    start_frequency: Annotated[NotNegative, FREQUENCY] = Field(description="Frequency at t = 0 [Hz].")
    end_frequency: Frequency = Field(description="Frequency at the end of the sweep [Hz].")
    duration: Duration = Field(description="Duration of the sweep [s].")


class MultiSineSection(Oscillation):
    """Sines of equal amplitude, evenly spaced in frequency, with random phases."""

    type: Literal["multisine"] = Field(description="Kind of signal: a sum of sines.")
    lowest: Frequency = Field(description="Lowest frequency [Hz].")
    highest: Frequency = Field(description="Highest frequency [Hz].")
    count: Count = Field(ge=1, description="Number of sines [-].")
    seed: Seed = Field(0, description="Seed of the random phases [-].")

    def problems(self) -> Iterator[Problem]:
        if self.lowest > self.highest:
            what = f"{self.lowest:g} Hz is above the highest frequency, {self.highest:g} Hz"
            yield Problem("lowest", what, "exchange the values of `lowest` and `highest`")


class RecordedSection(Section):
    """A measured time history, interpolated linearly."""

    type: Literal["csv"] = Field(description="Kind of signal: a measured time history.")
    file: Text = Field(
        description="CSV file with a header line of column names. Columns are separated by commas, semicolons or tabs. The "
        "decimal mark is a point, or a comma if the separator is not a comma. The path is relative to the folder of the config."
    )
    time_column: Text = Field(
        description="Name of the time column. The time is in s, or in the unit after the name, as in `t [ms]`."
    )
    value_column: Text = Field(
        description="Name of the load column. The values are in the unit of the load, or in the unit after the name, as in `F "
        "[kN]`."
    )


LoadSignal = Annotated[SineSection | SweepSection | MultiSineSection | RecordedSection, Field(discriminator="type")]
"""Time history of a load."""

Settle = Positive | Literal["auto", "none"]
"""Start of a motion: from rest this long before t = 0 [s]; `auto`, periodic if possible; `none`, from rest."""


class TypicalMotion(Section):
    """Typical frequency and amplitude of an unknown load."""

    frequency: Frequency | None = Field(
        None,
        description="Typical frequency of the load [Hz], used for the process noise. For `model: matern`: bandwidth of "
        "the load. In a load case, null: loads.NAME.process_noise.frequency, if set. Otherwise, null: frequency of the signal.",
    )
    amplitude: Amplitude | None = expert(
        None,
        description="Typical amplitude of the load [unit of the load]. The relative σ of the load and `initial_std` are "
        "relative to this amplitude. In a load case, null: loads.NAME.process_noise.amplitude, if "
        "set. Otherwise, null: amplitude of the signal.",
    )


class InputNoise(TypicalMotion):
    """Model of an unknown load in time, for placement and filter."""

    model: Literal["random_walk", "integrated_random_walk", "matern", "oscillator"] = Field(
        "random_walk",
        description="Model of the load in time. With `random_walk`: for arbitrary loads, as in the thesis of Cottone (2022); the "
        "estimated load is noisy. With `integrated_random_walk`: for smooth loads. With `matern`: for stationary loads with a "
        "limited bandwidth. With `oscillator`: for loads close to a known frequency.",
    )
    kappa: Annotated[Positive | None, Plausible(1e-6, 1e4)] = expert(
        None,
        description="Factor κ of the noise intensity [-], with the typical amplitude a and ω = 2πf. With `random_walk`: "
        "κωa² on the load. With `integrated_random_walk`: κω(ωa)² on the rate of the load. Null: 1/(2π); then the σ of the "
        "change in one period is a for the load, or ωa for its rate.",
    )
    smoothness: Literal["1/2", "3/2", "5/2"] = expert(
        "3/2", description="Smoothness ν of the Matérn model [-]: the load has ν − ½ continuous derivatives."
    )
    damping: Annotated[Positive, Plausible(1e-3, 1.0)] = expert(
        0.05,
        description="Damping ratio ζ of `oscillator` [-]: the half-power bandwidth of the load is 2ζ times the frequency.",
    )


class Rotation(Section):
    """A steady rotation of the structure; the centrifugal stiffening is neglected."""

    axis: DirectionVector = Field(description="Axis of rotation [-]; its length and sign are not used.")
    point: Point = Field((0.0, 0.0, 0.0), description="A point on the axis of rotation [m].")


class LoadSection(Section):
    """A force at a node or distributed over a set or face, a moment, a pressure on a face, or a uniform
    acceleration or rotation of the whole structure."""

    node: Id | None = Field(
        None,
        ge=1,
        description="Id of the loaded node in the deck [-]; it may be the reference node of an RBE2 or RBE3.",
    )
    set: Text | None = Field(None, description="Name of the loaded node set or face, instead of `node`.")
    deck_load: Text | None = Field(
        None,
        description="Name of a load of the deck, instead of `node` or `set` and `direction`. Nastran: FORCE-7 for load set 7 "
        "with FORCE cards only, LOAD-7 for load set 7 with other cards. Abaqus: CLOAD-1, DLOAD-1, DSLOAD-1, numbered in the "
        "order of the file. The deck defines the distribution of the load; the signal is the resultant [N].",
    )
    factor: Literal[True] | None = Field(
        None,
        description="`true`: the signal is a factor [-] on the load of the deck (`deck_load`), not the resultant. Use "
        "`factor` for loads with zero resultant, for moments, or to keep the load values of the deck.",
    )
    direction: DirectionVector | None = Field(
        None,
        description="Direction of the force in global coordinates [-]; the length of the vector is not used. On a face, the "
        "force is distributed evenly over the area. Omit `direction` with deck_load, moment, bearing, pressure, gravity or "
        "rotation.",
    )
    moment: DirectionVector | None = Field(
        None,
        description="Axis of a moment [-], instead of `direction`; the unit of the load is N m. On the reference node of an "
        "RBE2 or RBE3, the moment acts on the rotations. Otherwise, it acts as force couples on the nodes of `set`, or on "
        "the nodes around `node`.",
    )
    bearing: DirectionVector | None = Field(
        None,
        description="Direction of the force of a pin on a bore [-], from the pin into the material, instead of `direction`. "
        "`set` has to be the name of a bore in mesh.faces. The pressure acts on the loaded half of the bore, proportional "
        "to the cosine of the angle from this direction.",
    )
    pressure: Literal[True] | None = Field(
        None,
        description="`true`: a pressure on the face `set`, instead of `direction`; the unit of the load is Pa.",
    )
    gravity: DirectionVector | None = Field(
        None,
        description="Direction of a uniform acceleration of the whole structure [-]: gravity, or base excitation with "
        "opposite sign. `gravity` replaces `node`, `set`, `deck_load` and `direction`. The unit of the load is m/s². "
        "The forces are proportional to the density, also to an estimated density.",
    )
    rotation: Rotation | None = Field(
        None,
        description="Rotation of the whole structure; the load is the centrifugal forces. `rotation` replaces `node`, "
        "`set`, `deck_load` and `direction`. The signal is the square of the angular velocity, Ω² [rad²/s²]. The forces are "
        "proportional to the density, also to an estimated density.",
    )
    known: bool = Field(
        description="`true`: the load is measured by a load cell. `false`: the load is an unknown, which the "
        "filter estimates."
    )
    signal: LoadSignal = Field(description="Time history of the load in the stages `train` and `validate`.")
    process_noise: InputNoise = with_defaults(InputNoise, "Model of an unknown load in the filter.")

    def problems(self) -> Iterator[Problem]:
        places = {"node": self.node, "set": self.set, "deck_load": self.deck_load}
        if self.gravity is not None or self.rotation is not None:
            yield from self._on_all_mass(places)
        else:
            yield from exactly_one(places)
            yield from self._in_one_place()
        if not self.known:
            yield from _untypical("process_noise.frequency", self.signal, self.process_noise.frequency)

    def _on_all_mass(self, places: Iterable[str]) -> Iterator[Problem]:
        """Check a gravity load or a rotation."""
        kind, *others = [name for name in ("gravity", "rotation") if getattr(self, name) is not None]
        rest = (*places, "direction", "moment", "bearing", "pressure", "factor")
        for name in (*others, *(name for name in rest if getattr(self, name) is not None)):
            yield Problem(
                name, f"`{name}` cannot be combined with `{kind}`", f"remove `{name}` or `{kind}`", at_key=True
            )

    def _in_one_place(self) -> Iterator[Problem]:
        """Check the direction of a force, or the key that replaces it."""
        if self.factor and self.deck_load is None:
            yield Problem(
                "factor",
                "`factor` applies to a load of the deck only",
                "remove `factor`, or set `deck_load`",
                at_key=True,
            )
        kind, *others = [name for name in ("moment", "bearing", "pressure") if getattr(self, name) is not None] or [""]
        if others:
            remedy = f"remove `{others[0]}` or `{kind}`"
            yield Problem(others[0], f"`{others[0]}` cannot be combined with `{kind}`", remedy, at_key=True)
        if not kind and self.direction is None and self.deck_load is None:
            yield Problem("direction", "missing", "set the direction of the force, such as [0, 0, 1]", at_key=True)
        elif not kind and self.direction is not None and self.deck_load is not None:
            what = "a load of the deck (`deck_load`) already has a direction"
            yield Problem("direction", what, "remove `direction`", at_key=True)
        elif kind and self.deck_load is not None:
            what = (
                "a load of the deck cannot be a moment"
                if kind == "moment"
                else "a load of the deck already defines its forces"
            )
            yield Problem(kind, what, f"remove `{kind}` or `deck_load`", at_key=True)
        elif kind and self.direction is not None:
            subjects = {
                "moment": "`moment` already defines the axis",
                "bearing": "`bearing` already defines the direction",
            }
            what = f"{subjects.get(kind, 'a pressure acts normal to the face')}, so `direction` is not permitted"
            yield Problem(
                "direction", what, f"remove `direction`, or remove `{kind}` if the load is a force", at_key=True
            )
        if kind in ("bearing", "pressure") and self.set is None:
            yield Problem(
                kind,
                f"`{kind}` acts on a face, but `set` is missing",
                "set `set` to the name of a face in mesh.faces",
                at_key=True,
            )

    @property
    def unit(self) -> str:
        """Unit of the signal and of the estimate."""
        return unit_of({key: getattr(self, key) for key in UNITS})


UNITS = {"moment": "N m", "pressure": "Pa", "factor": "1", "gravity": "m/s²", "rotation": "rad²/s²"}
"""Unit of a load with this key; otherwise N."""


def unit_of(load: Mapping[str, object]) -> str:
    """Unit of a load, from its keys."""
    return next((unit for key, unit in UNITS.items() if load[key] is not None), "N")


class CaseLoad(TypicalMotion):
    """Signal of a load in one load case."""

    signal: LoadSignal = Field(description="Time history of the load in this load case.")


CaseEntry = Annotated[
    Annotated[CaseLoad, Tag("load")] | Annotated[Literal["none"], Tag("silent")],
    Discriminator(lambda value: "silent" if isinstance(value, str) else "load"),
]


class TrainingCase(Section):
    """One load case for which the layout is placed. Omitted keys are as in the sections `loads` and `train`."""

    weight: Annotated[Positive, Plausible(1e-6, 1e6)] = Field(
        1.0,
        description="Weight of this load case in the criterion [-], a factor on the variances of the unknowns in this load case. "
        "A weight of 4 has the same effect as twice the σ of the unknowns.",
    )
    loads: dict[Name, CaseEntry] = Field(
        {},
        description="Loads with another signal than in the section `loads`, by name; `none` for a load that does not act in "
        "this load case. All other loads are as in the section `loads`. An unknown load with `none` remains an unknown of the "
        "filter, but the criterion of this load case excludes the load.",
    )
    duration: Duration | None = Field(
        None, description="Duration of the simulation of this load case [s]; null: train.duration."
    )
    time_step: TimeStep | None = expert(
        None,
        description="Time step of this load case [s]; null: train.time_step. `gauges.noise_std` applies to train.time_step in "
        "every load case; it is converted to this time step with the same noise intensity.",
    )
    settle: Annotated[Settle | None, DURATION] = expert(
        None,
        description="Start of the motion in this load case; the values are explained under train.settle. Null: train.settle.",
    )


def silent_in(case: TrainingCase) -> frozenset[str]:
    """Loads that do not act in a case."""
    return frozenset(name for name, entry in case.loads.items() if not isinstance(entry, CaseLoad))


def load_case_problems(
    cases: Mapping[str, TrainingCase], loads: Mapping[str, LoadSection], estimate: Sequence[str], over: Sequence[str]
) -> Iterator[Problem]:
    """Yield the inconsistencies between load cases and loads; `estimate`: the unknowns; over: unknowns of the criterion."""
    for name, case in cases.items():
        key, silent = f"place.load_cases.{name}", silent_in(case)
        for load, entry in case.loads.items():
            yield from known(f"{key}.loads.{load}", load, loads, "load")
            if load in loads and isinstance(entry, CaseLoad) and not loads[load].known:
                frequency = entry.frequency or loads[load].process_noise.frequency
                yield from _untypical(f"{key}.loads.{load}.frequency", entry.signal, frequency)
        if silent >= set(loads):
            yield Problem(
                f"{key}.loads", "no load acts in this load case", "add a signal to one load, or remove the load case"
            )
        elif silent >= set(over):
            listed = ", ".join(over)
            yield Problem(
                f"{key}.loads",
                f"the unknown load{'s' * (len(over) > 1)} {listed} {'does' if len(over) == 1 else 'do'} not act in this load "
                "case, so its criterion contains no unknown",
                f"add a signal to {' or '.join(over)}, or remove the load case",
            )
    for unknown in estimate:
        if unknown in loads and all(unknown in silent_in(case) for case in cases.values()):
            what = f"the unknown load '{unknown}' does not act in any load case"
            yield Problem("place.load_cases", what, f"set `loads: {{{unknown}: {{signal: …}}}}` in one load case")


def _untypical(key: str, signal: LoadSignal, frequency: float | None) -> Iterator[Problem]:
    """Yield a problem if an unknown load has no typical frequency."""
    if isinstance(signal, RecordedSection) and frequency is None:
        what = "an unknown load with a signal of type csv needs a typical frequency"
        yield Problem(key, what, f"set {key} [Hz]", at_key=True)
