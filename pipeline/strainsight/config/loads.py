"""Loads: where they act, what they look like in the training run, and how an unknown one is modelled."""

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
    """What goes up and down about zero."""

    amplitude: Amplitude = Field(
        description="Amplitude a [N, of a moment N m, of a pressure Pa, of gravity m/s²]; of a multisine that of the one sine "
        "that has the power of all of them together."
    )


class SineSection(Oscillation):
    """u(t) = a sin(2πft + φ)."""

    type: Literal["sine"] = Field(description="Kind of signal.")
    frequency: Frequency = Field(description="Frequency f [Hz].")
    phase: Annotated[float, TURN] = expert(0.0, description="Phase φ [rad].")


class SweepSection(Oscillation):
    """A sine whose frequency runs linearly from one value to another, and then stays there."""

    type: Literal["sweep"] = Field(description="Kind of signal.")
    start_frequency: Annotated[NotNegative, FREQUENCY] = Field(description="Frequency at t = 0 [Hz].")
    end_frequency: Frequency = Field(description="Frequency at the end of the sweep [Hz].")
    duration: Duration = Field(description="Length of the sweep [s].")


class MultiSineSection(Oscillation):
    """Sines of equal amplitude, evenly spaced in frequency, with seeded phases."""

    type: Literal["multisine"] = Field(description="Kind of signal.")
    lowest: Frequency = Field(description="Lowest frequency [Hz].")
    highest: Frequency = Field(description="Highest frequency [Hz].")
    count: Count = Field(ge=1, description="Number of sines [-].")
    seed: Seed = Field(0, description="Seed of the phases [-].")

    def problems(self) -> Iterator[Problem]:
        if self.lowest > self.highest:
            yield Problem("lowest", f"{self.lowest:g} Hz is above the highest, {self.highest:g} Hz", "swap them")


class RecordedSection(Section):
    """A measured history, with straight lines between its samples."""

    type: Literal["csv"] = Field(description="Kind of signal.")
    file: Text = Field(
        description="CSV file: a line of column names, then numbers; columns separated by commas, semicolons or tabs, decimals "
        "by points or, where no commas separate the columns, by commas. The path starts from the config's folder."
    )
    time_column: Text = Field(
        description="Name of the column with the time [s, or the unit behind the name: `t [ms]`]."
    )
    value_column: Text = Field(
        description="Name of the column with the load [N, N m or Pa, or the unit behind the name: `F [kN]`]."
    )


LoadSignal = Annotated[SineSection | SweepSection | MultiSineSection | RecordedSection, Field(discriminator="type")]
"""What a load looks like in time."""

Settle = Positive | Literal["auto", "none"]
"""How a motion under loads begins: from rest so long before t = 0 [s], periodic where it can be, from rest."""


class TypicalMotion(Section):
    """How fast and how large an unknown load typically is."""

    frequency: Frequency | None = Field(
        None,
        description="Typical frequency of the load [Hz], ω = 2π frequency, bandwidth of matern; null: that of its signal, in a "
        "load case before that the one of its process_noise.",
    )
    amplitude: Amplitude | None = expert(
        None,
        description="Typical amplitude of the load [its unit], which its σ and initial_std count in; null: as for the frequency.",
    )


class InputNoise(TypicalMotion):
    """How an unknown load is modelled in time, by placement and filter alike."""

    model: Literal["random_walk", "integrated_random_walk", "matern", "oscillator"] = Field(
        "random_walk",
        description="random_walk: any load, and noisy (the thesis); integrated_random_walk: a smooth one; matern: one with a "
        "bandwidth; oscillator: one about a known frequency.",
    )
    kappa: Annotated[Positive | None, Plausible(1e-6, 1e4)] = expert(
        None,
        description="Factor κ of the intensity κω of both walks [-]; null: 1/(2π), by which the load, or its rate, moves by an "
        "amplitude in a period.",
    )
    smoothness: Literal["1/2", "3/2", "5/2"] = expert("3/2", description="ν of matern [-]: ν − ½ derivatives exist.")
    damping: Annotated[Positive, Plausible(1e-3, 1.0)] = expert(
        0.05, description="ζ of oscillator [-]: its power lies within 2ζ of the frequency."
    )


class Rotation(Section):
    """A steady rotation of the structure; stiffening by the forces that it causes is left out."""

    axis: DirectionVector = Field(description="Axis [-]; neither its length nor its sign matters.")
    point: Point = Field((0.0, 0.0, 0.0), description="A point on it [m].")


class LoadSection(Section):
    """A force at a node or spread over a set or face, a moment, what presses on a face, or what pulls at all mass."""

    node: Id | None = Field(
        None, ge=1, description="Id of the node in the deck [-]; an RBE2/RBE3 reference node will do."
    )
    set: Text | None = Field(None, description="Name of a node set or a face instead of a node.")
    deck_load: Text | None = Field(
        None,
        description="Name of a load of the deck instead of a node and direction: FORCE-7 of a set 7 of FORCE cards alone, LOAD-7 "
        "of any other, CLOAD-1, DLOAD-1, DSLOAD-1 in Abaqus. Its shape is that of the deck, its resultant the signal [N].",
    )
    factor: Literal[True] | None = Field(
        None,
        description="true: the signal is how often the load of the deck acts [1], and not its resultant: for one that balances, "
        "for moments, or to keep the numbers of the deck.",
    )
    direction: DirectionVector | None = Field(
        None,
        description="Direction in global coordinates [-]; its length does not matter. On a face the force is spread evenly "
        "over its area. Left out with deck_load, moment, bearing, pressure, gravity or rotation.",
    )
    moment: DirectionVector | None = Field(
        None,
        description="Axis of a moment [-] instead of a direction: the load is in N m then. It acts on the rotations of an "
        "RBE2/RBE3 reference node, else as a couple of forces on the nodes of the set, or on those around the node.",
    )
    bearing: DirectionVector | None = Field(
        None,
        description="Vector [-] along which a pin presses on the bore that `set` names, a face of `mesh.faces`, from the pin "
        "into the material, instead of a direction: the pressure goes with the cosine to it, on the half turned against it.",
    )
    pressure: Literal[True] | None = Field(
        None,
        description="true: a pressure on the face that `set` names instead of a direction; the load is in Pa then.",
    )
    gravity: DirectionVector | None = Field(
        None,
        description="Vector [-] along which all mass is pulled, instead of a place and a direction; the load is the acceleration "
        "[m/s²], as of weight, or of a shaken foundation against its motion. No density may be a parameter beside it.",
    )
    rotation: Rotation | None = Field(
        None,
        description="The centrifugal forces of a rotation on all mass, instead of a place and a direction; the load is Ω² "
        "[rad²/s²]. No density may be a parameter beside it.",
    )
    known: bool = Field(description="true: measured by other means; false: to be estimated.")
    signal: LoadSignal = Field(description="What the load looks like in training and validation.")
    process_noise: InputNoise = with_defaults(InputNoise, "How an unknown load is modelled in the filter.")

    def problems(self) -> Iterator[Problem]:
        places = {"node": self.node, "set": self.set, "deck_load": self.deck_load}
        if self.gravity is not None or self.rotation is not None:
            yield from self._on_all_mass(places)
        else:
            yield from exactly_one("", places)
            yield from self._in_one_place()
        if not self.known:
            yield from _untypical("process_noise.frequency", self.signal, self.process_noise.frequency)

    def _on_all_mass(self, places: Iterable[str]) -> Iterator[Problem]:
        """Gravity or a rotation, which acts everywhere."""
        kind, *others = [name for name in ("gravity", "rotation") if getattr(self, name) is not None]
        rest = (*places, "direction", "moment", "bearing", "pressure", "factor")
        for name in (*others, *(name for name in rest if getattr(self, name) is not None)):
            yield Problem(name, f"a load with '{kind}', too", "remove one of the two keys", at_key=True)

    def _in_one_place(self) -> Iterator[Problem]:
        """A direction, or what stands instead of one."""
        if self.factor and self.deck_load is None:
            yield Problem("factor", "is of a load of the deck", "remove the key, or name a deck_load", at_key=True)
        kind, *others = [name for name in ("moment", "bearing", "pressure") if getattr(self, name) is not None] or [""]
        if others:
            yield Problem(others[0], f"a load with '{kind}', too", "remove one of the two keys", at_key=True)
        if not kind and self.direction is None and self.deck_load is None:
            yield Problem("direction", "missing", "give a vector such as [0, 0, 1]", at_key=True)
        elif not kind and self.direction is not None and self.deck_load is not None:
            yield Problem("direction", "a load of the deck has its own direction", "remove the key", at_key=True)
        elif kind and self.deck_load is not None:
            what = "a load of the deck is no moment" if kind == "moment" else "a load of the deck has its own forces"
            yield Problem(kind, what, "remove the key", at_key=True)
        elif kind and self.direction is not None:
            subjects = {"moment": "a moment has an axis", "bearing": "a bearing load has a vector of its own"}
            what = f"{subjects.get(kind, 'a pressure acts inward')} and no direction"
            yield Problem("direction", what, "remove one of the two keys", at_key=True)
        if kind in ("bearing", "pressure") and self.set is None:
            yield Problem(kind, "acts on a face", "give `set` the name of one of mesh.faces", at_key=True)

    @property
    def unit(self) -> str:
        """Of its signal and of all that is estimated of it."""
        return unit_of({key: getattr(self, key) for key in UNITS})


UNITS = {"moment": "N m", "pressure": "Pa", "factor": "1", "gravity": "m/s²", "rotation": "rad²/s²"}
"""Of a load that has the key; of any other N."""


def unit_of(load: Mapping[str, object]) -> str:
    """Of a load by its keys."""
    return next((unit for key, unit in UNITS.items() if load[key] is not None), "N")


class CaseLoad(TypicalMotion):
    """What a load looks like in one load case."""

    signal: LoadSignal = Field(description="What it looks like in that case.")


CaseEntry = Annotated[
    Annotated[CaseLoad, Tag("load")] | Annotated[Literal["none"], Tag("silent")],
    Discriminator(lambda value: "silent" if isinstance(value, str) else "load"),
]


class TrainingCase(Section):
    """One of the trainings that a layout has to serve. What it does not state is as in `loads` and `train`."""

    weight: Annotated[Positive, Plausible(1e-6, 1e6)] = Field(
        1.0,
        description="What the case counts [-], beside the weights of the others: its share of the mean, or its factor in the "
        "worst; of variances, so that 4 stands for half the σ.",
    )
    loads: dict[Name, CaseEntry] = Field(
        {},
        description="Loads that are other than stated, by name, or none: silent. Others act as stated. A silent load stays an "
        "unknown of the filter, with the process noise that it has as stated, and is left out of the criterion in that case.",
    )
    duration: Duration | None = Field(None, description="Length of this training [s]; null: train.duration.")
    time_step: TimeStep | None = expert(
        None,
        description="Its time step [s]; null: train.time_step, at which noise_std is that of a sample in every case.",
    )
    settle: Annotated[Settle | None, DURATION] = expert(None, description="How its motion begins; null: train.settle.")


def silent_in(case: TrainingCase) -> frozenset[str]:
    """The loads that do not act in a case."""
    return frozenset(name for name, entry in case.loads.items() if not isinstance(entry, CaseLoad))


def load_case_problems(
    cases: Mapping[str, TrainingCase], loads: Mapping[str, LoadSection], estimate: Sequence[str], over: Sequence[str]
) -> Iterator[Problem]:
    """Contradictions between load cases and loads; estimate: the unknowns, over: those that the criterion covers."""
    for name, case in cases.items():
        key, silent = f"place.load_cases.{name}", silent_in(case)
        for load, entry in case.loads.items():
            yield from known(f"{key}.loads.{load}", load, loads, "load")
            if load in loads and isinstance(entry, CaseLoad) and not loads[load].known:
                frequency = entry.frequency or loads[load].process_noise.frequency
                yield from _untypical(f"{key}.loads.{load}.frequency", entry.signal, frequency)
        if silent >= set(loads):
            yield Problem(f"{key}.loads", "no load acts in this case", "let one act, or remove the case")
        elif silent >= set(over):
            listed = ", ".join(over)
            yield Problem(
                f"{key}.loads",
                f"{listed} {'is' if len(over) == 1 else 'are'} silent, and the criterion covers nothing else in this case",
                "let one of them act, or remove the case",
            )
    for unknown in estimate:
        if unknown in loads and all(unknown in silent_in(case) for case in cases.values()):
            yield Problem(
                "place.load_cases",
                f"the unknown load '{unknown}' is silent in every case",
                f"let {unknown} act in one of them",
            )


def _untypical(key: str, signal: LoadSignal, frequency: float | None) -> Iterator[Problem]:
    """A problem where nothing says how fast an unknown load typically is."""
    if isinstance(signal, RecordedSection) and frequency is None:
        what = "an unknown load from a recorded signal needs a typical frequency"
        yield Problem(key, what, f"give {key} [Hz]", at_key=True)
