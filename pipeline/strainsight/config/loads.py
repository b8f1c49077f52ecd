"""Loads: where they act, what they look like in the training run, and how an unknown one is modelled."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from strainsight.config.base import NotNegative, Positive, Section, Seed, Text, Vector, with_defaults
from strainsight.config.problem import Problem


class Sine(Section):
    """u(t) = a sin(2πft + φ)."""

    type: Literal["sine"] = Field(description="Kind of signal.")
    frequency: Positive = Field(description="Frequency f [Hz].")
    amplitude: Positive = Field(description="Amplitude a [N, of a moment N m, of a pressure Pa].")
    phase: float = Field(0.0, description="Phase φ [rad].")


class Sweep(Section):
    """A sine whose frequency runs linearly from one value to another, and then stays there."""

    type: Literal["sweep"] = Field(description="Kind of signal.")
    start_frequency: NotNegative = Field(description="Frequency at t = 0 [Hz].")
    end_frequency: Positive = Field(description="Frequency at the end of the sweep [Hz].")
    duration: Positive = Field(description="Length of the sweep [s].")
    amplitude: Positive = Field(description="Amplitude [N, of a moment N m, of a pressure Pa].")


class MultiSine(Section):
    """Sines of equal amplitude, evenly spaced in frequency, with seeded phases."""

    type: Literal["multisine"] = Field(description="Kind of signal.")
    lowest: Positive = Field(description="Lowest frequency [Hz].")
    highest: Positive = Field(description="Highest frequency [Hz].")
    count: int = Field(ge=1, description="Number of sines [-].")
    amplitude: Positive = Field(
        description="Amplitude [N, of a moment N m, of a pressure Pa] of the one sine that has the power of all of them together."
    )
    seed: Seed = Field(0, description="Seed of the phases [-].")


class Recorded(Section):
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


LoadSignal = Annotated[Sine | Sweep | MultiSine | Recorded, Field(discriminator="type")]
"""What a load looks like in time."""

Settle = Positive | Literal["auto", "none"]
"""How a motion under loads begins: from rest so long before t = 0 [s], periodic where it can be, from rest."""


class InputNoise(Section):
    """How an unknown load is modelled in time, by placement and filter alike."""

    model: Literal["random_walk", "integrated_random_walk", "matern", "oscillator"] = Field(
        "random_walk",
        description="random_walk: any load, and noisy (the thesis); integrated_random_walk: a smooth one; matern: one with a "
        "bandwidth; oscillator: one about a known frequency.",
    )
    kappa: Positive | None = Field(
        None,
        description="Factor κ of the intensity κω of both walks [-]; null: 1/(2π), by which the load, or its rate, moves by an "
        "amplitude in a period.",
    )
    frequency: Positive | None = Field(
        None,
        description="Typical frequency of the load [Hz], ω = 2π frequency, bandwidth of matern; null: that of its signal.",
    )
    amplitude: Positive | None = Field(
        None,
        description="Typical amplitude of the load [N, of a moment N m, of a pressure Pa]; initial_std is relative to it; null: "
        "that of its signal.",
    )
    smoothness: Literal["1/2", "3/2", "5/2"] = Field("3/2", description="ν of matern [-]: ν − ½ derivatives exist.")
    damping: Positive = Field(0.05, description="ζ of oscillator [-]: its power lies within 2ζ of the frequency.")


class Load(Section):
    """A force at a node or spread over a set or face, a moment, or what presses on a face."""

    node: int | None = Field(
        None, ge=1, description="Id of the node in the deck [-]; an RBE2/RBE3 reference node will do."
    )
    set: Text | None = Field(None, description="Name of a node set or a face instead of a node.")
    deck_load: Text | None = Field(
        None,
        description="Name of a load of the deck (FORCE-7: the FORCE cards of set 7) instead of a node and direction.",
    )
    direction: Vector | None = Field(
        None,
        description="Direction in global coordinates [-]; its length does not matter. On a face the force is spread evenly "
        "over its area. Left out only with deck_load, moment, bearing or pressure.",
    )
    moment: Vector | None = Field(
        None,
        description="Axis of a moment [-] instead of a direction: the load is in N m then. It acts on the rotations of an "
        "RBE2/RBE3 reference node, else as a couple of forces on the nodes of the set, or on those around the node.",
    )
    bearing: Vector | None = Field(
        None,
        description="Vector [-] along which a pin presses on the bore that `set` names, a face of `mesh.faces`, from the pin "
        "into the material, instead of a direction: the pressure goes with the cosine to it, on the half turned against it.",
    )
    pressure: Literal[True] | None = Field(
        None,
        description="true: a pressure on the face that `set` names instead of a direction; the load is in Pa then.",
    )
    known: bool = Field(description="true: measured by other means; false: to be estimated.")
    signal: LoadSignal = Field(description="What the load looks like in training and validation.")
    process_noise: InputNoise = with_defaults(InputNoise, "How an unknown load is modelled in the filter.")

    @property
    def unit(self) -> str:
        """Of its signal and of all that is estimated of it."""
        return unit_of(self.moment, self.pressure)


def unit_of(moment: object, pressure: object) -> str:
    """Of a load with these keys."""
    return "N m" if moment is not None else "Pa" if pressure else "N"


def signal_problems(key: str, signal: LoadSignal) -> Iterator[Problem]:
    """Contradictions within a signal."""
    if isinstance(signal, MultiSine) and signal.lowest > signal.highest:
        yield Problem(f"{key}.lowest", f"{signal.lowest:g} Hz is above the highest, {signal.highest:g} Hz", "swap them")
