"""How exactly gauges are installed, loads are applied and the model is known; what a validation tries."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from strainsight.config.base import (
    GAIN,
    MISALIGNED,
    MISPLACED,
    RELATIVE_STD,
    STRAIN,
    Count,
    Name,
    NotNegative,
    ParameterValue,
    Plausible,
    Positive,
    Section,
    TimeSpan,
    TimeStep,
    expert,
    with_defaults,
)


class GaugeTolerances(Section):
    """σ of how gauges are installed; 0 for what is exact."""

    position: Annotated[NotNegative, MISPLACED] = Field(
        0.002,
        description="σ of a gauge's place along each of two directions [m]; 2 mm for a place that was marked out.",
    )
    angle: Annotated[float, MISALIGNED] = expert(
        2.0, ge=0, le=45, description="σ of a gauge's direction, of an accelerometer's about every axis [deg]."
    )
    gain: Annotated[float, GAIN] = expert(
        0.01,
        ge=0,
        le=0.5,
        description="σ of the factor on a reading: gauge factor and lead wires, sensitivity of an accelerometer [-]. Of a "
        "structure with gauges.type, and no motion_sensors: √(t² + (1 Ω/R)²) of the tolerance t of its gauge factor and its "
        "resistance R.",
    )
    transverse: Annotated[float, GAIN] = expert(
        0.005, ge=0, le=0.5, description="σ of the transverse sensitivity K_t of a strain gauge [-]."
    )


class Tolerances(GaugeTolerances):
    """Standard deviations of how gauges are installed, how loads act and of what the model leaves open; 0 for what is exact.
    Every truth `rich` draws its own from them."""

    offset: Annotated[NotNegative, STRAIN] = expert(
        0.0, description="σ of a constant offset of every channel of strain [strain]."
    )
    drift: Annotated[NotNegative, STRAIN] = expert(
        0.0,
        description="σ of how far the zero of a channel of strain has drifted by the end of the record, in proportion to time "
        "[strain]; 0 for records that are short beside the warming up of an amplifier.",
    )
    temperature: Annotated[NotNegative, Plausible(0.001, 500.0, "K")] = expert(
        0.0,
        description="σ of how much warmer the part is at the end of the record, in proportion to time [K]: one history for all "
        "gauges, which read `thermal_output` of it.",
    )
    thermal_output: Annotated[NotNegative, Plausible(1e-9, 1e-4, "strain/K")] = expert(
        1e-6,
        description="What every strain gauge reads of a kelvin, alike [strain/K]; 1e-6 for foil gauges that are compensated for "
        "the material, near room temperature. The thermal output that the maker states may be subtracted before.",
    )
    thermal_spread: Annotated[NotNegative, Plausible(1e-9, 1e-4, "strain/K")] = expert(
        1.4e-7,
        description="σ of what a strain gauge reads of a kelvin beside the others [strain/K]; gauges of one lot.",
    )
    load_angle: Annotated[float, MISALIGNED] = Field(
        1.0,
        ge=0,
        le=45,
        description="σ of the direction of a load about each of two axes across it [deg]; 1° for a rod or an actuator that was "
        "aligned by eye and spirit level.",
    )
    load_position: Annotated[NotNegative, MISPLACED] = Field(
        0.002,
        description="σ of the point of action of a load along each of two directions across its line of action [m], which adds "
        "the couple of the shift; 2 mm for a place that was marked out.",
    )
    load_gain: Annotated[float, GAIN] = expert(
        0.005,
        ge=0,
        le=0.5,
        description="σ of the factor on a known load: load cell and amplifier [-]. ISO 7500-1 allows ±1 % of a force that is "
        "measured in class 1, ±0.5 % in class 0.5.",
    )
    damping: Annotated[float, Plausible(1.0, 10.0)] = Field(
        1.5, ge=1, le=100, description="Factor, the logarithm of which is the σ of ln ζ of every mode [-]; 1: exact."
    )
    frequency: Annotated[float, Plausible(0.0, 0.05)] = expert(
        0.01,
        ge=0,
        le=0.2,
        description="σ of the logarithm of the natural frequencies, all by one factor [-]; each that the gauges read by another "
        "factor of half that σ. Static responses stay: the masses are uncertain. 1 %: a density that is 1 % off moves "
        "frequencies by 0.5 %, 20 g on the tip of a bracket of 2.5 kg by 1.8 %. 0: exact, of a model whose frequencies were "
        "measured.",
    )
    model: Annotated[float, GAIN] = expert(
        0.0,
        ge=0,
        le=0.5,
        description="σ of the logarithm of one scale of the whole stiffness, where no modulus is estimated [-].",
    )
    discrepancy: Annotated[float, GAIN] = expert(
        0.02,
        ge=0,
        le=0.5,
        description="σ of what else a reading is off by at every sample, over the RMS of its channel [-]: second order of all "
        "of these, and what the reduced model leaves out. Under known loads a bank estimates parameters as if by gauges of that "
        "noise beside their own; not where a load is unknown, which has to follow the readings.",
    )
    treat: Literal["consider", "estimate"] = expert(
        "consider",
        description="Of motion and loads; parameters are estimated with all tolerances integrated out. consider: gains of "
        "unknown loads know of them and learn nothing, and σ covers them; estimate: corrected by what the samples say of them, "
        "which readings that the model cannot explain otherwise mislead.",
    )


StatedTolerances = Annotated[
    Annotated[Tolerances, Tag("tolerances")] | Annotated[Literal["none"], Tag("none")],
    Discriminator(lambda value: "tolerances" if isinstance(value, dict | Tolerances) else "none"),
]

NONE = Tolerances.model_validate(dict.fromkeys(Tolerances.model_fields, 0) | {"damping": 1, "treat": "consider"})
"""Everything exact."""


def tolerances_of(stated: Tolerances | Literal["none"]) -> Tolerances:
    """Of a config: those that it states, or everything exact."""
    return NONE if stated == "none" else stated


class TruthSection(Section):
    """What stands for reality in the validation."""

    model: Literal["full", "modes", "rich", "rom"] = Field(
        "rich",
        description="full: the whole finite-element model in time; modes: many modes and static terms; rich: that, with "
        "damping and gauges that are off by what `tolerances` say, drawn by the seed; rom: the filter's own model.",
    )
    modes: Count = Field(60, ge=1, description="Modes of the truth model [-].")
    parameters: dict[Name, ParameterValue] = Field(
        {}, description="True values [Pa, kg/m³, or 1 for a factor]; a parameter left out is at its guess."
    )
    damping_factor: Annotated[NotNegative | None, Plausible(0.01, 100.0)] = expert(
        None, description="rich: true damping over the filter's [-], the same in every mode; null: by `tolerances`."
    )
    gauge_offset: Annotated[NotNegative | None, MISPLACED] = expert(
        None, description="rich: how far every gauge is misplaced [m], always alike; null: by `tolerances`."
    )
    gauge_rotation: Annotated[NotNegative | None, Plausible(0.01, 45.0, "deg")] = expert(
        None, description="rich: how far every gauge is turned [deg], always alike; null: by `tolerances`."
    )


class Sweeps(Section):
    """Studies of one change at a time, each a run of the layout's filter on the layout's own measurement."""

    time_steps: tuple[TimeStep, ...] = expert((), description="Other time steps of filter and samples [s].")
    process_noise: Annotated[tuple[Positive, ...], Plausible(1e-9, 1e9)] = expert(
        (), description="Factors on all process noise of the filter [-]."
    )
    wrong_parameters: Annotated[
        dict[Name, Annotated[tuple[Positive, ...], Field(min_length=1)]], Plausible(0.1, 10.0)
    ] = expert(
        {}, description="Factors on a parameter that the filter takes as known: 0.9 is ten per cent too low [-]."
    )


class Validate(TimeSpan):
    """The filter on simulated measurements."""

    truth: TruthSection = with_defaults(TruthSection, "What stands for reality.")
    initial_std: Annotated[dict[Name, Positive], RELATIVE_STD] = Field(
        description="Initial σ of every unknown, relative to its guess or amplitude [-]."
    )
    random_sets: Annotated[int, Plausible(0, 1000)] = Field(
        10, ge=0, description="Random gauge sets to compare with, from all candidates and from the pool [-]."
    )
    noise_factors: Annotated[tuple[Positive, ...], Plausible(1e-6, 1e6)] = Field(
        (0.1, 5.0), description="Other noise levels to try, relative to the stated one [-]."
    )
    repeats: Count = Field(20, ge=1, description="Seeds and starting values to repeat with [-].")
    sweeps: Sweeps = expert(default_factory=Sweeps, description="Changes of the filter, one at a time.")
