"""Measurements of a test: which channel of its files is which gauge or load, how they are read, and fatigue damage."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, Tag, model_validator

from strainsight.config.base import (
    GAUGE_FACTOR,
    INSTANT,
    NOISE,
    READING,
    RELATIVE_STD,
    Count,
    Cycles,
    Id,
    Name,
    Plausible,
    Positive,
    Problem,
    RunName,
    Section,
    Stress,
    Text,
    TimeStep,
    expert,
    with_defaults,
)
from strainsight.config.gauges import NamedGauge
from strainsight.config.layout import key_of


class SNCurve(Section):
    """N = cycles · (stress/Δσ)^slope: straight lines of ln N over ln Δσ."""

    slope: Annotated[float, Field(ge=1, le=30)] = Field(description="m of the line through `stress` [-].")
    stress: Stress = Field(description="Of which the material bears `cycles` cycles [Pa], a range or an amplitude.")
    of: Literal["range", "amplitude"] = expert(
        "range", description="What `stress` is: a range Δσ, from valley to peak, or an amplitude σ_a = Δσ/2."
    )
    cycles: Cycles = Field(2e6, description="At `stress` [-].")
    knee: Cycles | None = Field(
        None, description="Cycles at which the line ends [-]; null: it goes on to any number of them."
    )
    second_slope: Annotated[float, Field(ge=1, le=60)] | None = Field(
        None, description="m₂ beyond the knee [-]; null: ranges below that of the knee do no damage."
    )
    cut_off: Cycles | None = Field(
        None, description="Cycles on the curve whose range and all below do no damage [-]; null: none."
    )


class MeanStressSection(Section):
    """Which range about no mean does the same damage; the S-N curve is then one of mean zero (R = −1)."""

    rule: Literal["none", "goodman", "fkm"] = expert(
        "none",
        description="none: ranges as they are. goodman: Δσ/(1 − σ_m/R_m) under tension. fkm: by the mean stress sensitivity "
        "M, as the FKM guideline has it.",
    )
    tensile_strength: Stress | None = expert(None, description="R_m of goodman [Pa].")
    sensitivity: Annotated[float, Field(ge=0, le=1)] | None = expert(None, description="M of fkm [-].")


class DamageSettings(Section):
    """Damage of the record at every point of the surface and every virtual gauge, with its interval."""

    curve: SNCurve = Field(description="The S-N curve of the material.")
    mean_stress: MeanStressSection = expert(default_factory=MeanStressSection, description="What a mean stress does.")
    stress: Literal["signed_von_mises", "principal"] = expert(
        "signed_von_mises",
        description="Of the surface: von Mises' stress with the sign of the principal stress of the largest size, or that "
        "principal stress. Of a virtual gauge it is E ε along the gauge.",
    )
    draws: Annotated[int, Field(ge=40, le=10_000)] = Field(
        200, description="Histories drawn from what the smoother leaves open [-]."
    )
    points: Annotated[Annotated[int, Field(ge=1)] | None, Plausible(1, 1e6)] = Field(
        None,
        description="Interval at so many points of the surface, those most damaged by the smoothed mean [-]; null: at all.",
    )
    equivalent_cycles: Cycles = expert(1e6, description="N_eq of the damage-equivalent range [-].")
    repetitions: Annotated[Positive, Plausible(1e-6, 1e12)] = Field(
        1.0, description="How often the record is repeated [-]; damage is that of all."
    )
    hot_spots: Annotated[int, Field(ge=1, le=1000)] = expert(10, description="Places listed [-].")

    def problems(self) -> Iterator[Problem]:
        curve, mean = self.curve, self.mean_stress
        if curve.second_slope is not None and curve.knee is None:
            remedy = "state estimate.damage.curve.knee, or leave it out"
            yield Problem("curve.second_slope", "there is no knee", remedy, at_key=True)
        if curve.cut_off is not None and curve.knee is not None and curve.cut_off <= curve.knee:
            what = f"{curve.cut_off:g} cycles are not beyond the knee, {curve.knee:g}"
            yield Problem("curve.cut_off", what, "state more, or leave it out")
        if curve.cut_off is not None and curve.knee is not None and curve.second_slope is None:
            what = "nothing below the knee does damage"
            yield Problem("curve.cut_off", what, "state second_slope, or leave it out", at_key=True)
        for rule, name in (("goodman", "tensile_strength"), ("fkm", "sensitivity")):
            stated = getattr(mean, name) is not None
            if mean.rule == rule and not stated:
                yield Problem("mean_stress", f"{rule} needs {name}", f"state estimate.damage.mean_stress.{name}")
            if mean.rule != rule and stated:
                remedy = f"leave it out, or set rule: {rule}"
                yield Problem(f"mean_stress.{name}", f"the rule is {mean.rule}", remedy, at_key=True)


BridgeKind = Literal[
    "quarter", "half", "half-opposite", "half-poisson", "full", "full-bending-poisson", "full-poisson", "sum"
]


class BridgeSection(Section):
    """How gauges sit in a Wheatstone bridge, for channels in mV/V."""

    arrangement: BridgeKind = Field(
        description="Arms with gauges, see docs/estimation.md; sum: a bridge of gauges.fixed."
    )
    gauge_factor: Annotated[Positive, GAUGE_FACTOR] = Field(description="Gauge factor [-].")
    poisson_ratio: float | None = expert(None, gt=-1, lt=0.5, description="Of the part, where gauges lie across [-].")


class DelayInSamples(Section):
    """A delay in samples of the file."""

    samples: Annotated[int, Plausible(0, 1e6)] = expert(
        description="Whole samples that the channel is late by; negative: early [-]."
    )


class DelayInSeconds(Section):
    """A delay in seconds."""

    seconds: Annotated[float, Plausible(0.0, 1e4, "s")] = expert(
        description="What the channel is late by, a whole number of sampling intervals; negative: early [s]."
    )


Delay = Annotated[
    Annotated[DelayInSamples, Tag("samples")] | Annotated[DelayInSeconds, Tag("seconds")], key_of("samples", "seconds")
]


class Channel(Section):
    """A channel of the file, and what is done to it. Nothing is guessed: unit and bridge are stated."""

    channel: Text = Field(
        description="Column, dataset, node:direction or id line of a UFF function, channel or group/channel of MDF4 and TDMS, "
        "variable of a MAT file (a.b of a struct)."
    )
    unit: Text = Field(
        description="Unit of the readings: um/m, mV/V, m/s2, g, mm, kN, …; has to agree with the file's."
    )
    override: bool = expert(
        False,
        description="true: the unit in the file is wrong, or readings are meant that look like a wrong unit, being so small, or "
        "like the last value of a slower channel, repeated.",
    )
    bridge: BridgeSection | None = Field(None, description="For mV/V and V/V, and only there.")
    sign: Literal[1, -1] = expert(1, description="-1: wired the other way round.")
    scale: Annotated[Positive, Plausible(1e-6, 1e6)] = expert(1.0, description="Factor on the calibrated signal [-].")
    offset: Annotated[float, READING] = expert(0.0, description="Subtracted from the readings [unit].")
    drift: Annotated[float, READING] = expert(
        0.0, description="Subtracted from the readings, times the time since the start [unit/s]."
    )
    zero: Annotated[tuple[float, float] | None, INSTANT] = Field(
        None, description="[from, to] [s]: the mean of the readings there is subtracted."
    )
    missing: Annotated[tuple[tuple[float, float], ...], INSTANT] = Field(
        (),
        description="[[from, to], …] [s]: samples between these times of the file count as missing, as spikes have to.",
    )
    delay: Delay | None = expert(
        None,
        description="What the channel is written late by, {samples: n} or {seconds: s}: it is put at its own time. null: none.",
    )


class GaugeChannel(Channel):
    """A channel of a gauge."""

    gauge: Text | Id = Field(
        description="Name of the gauge: of gauges.fixed, number in the table of gauges.given, or label in the layout (G1, as "
        "gauges.csv has it)."
    )
    grid: Annotated[int, Plausible(1, 3)] = expert(
        1, ge=1, description="Which grid of a rosette or axis of a sensor, from 1."
    )
    noise_std: Annotated[Positive | None, NOISE] = expert(
        None,
        description="Noise of one sample [strain, m/s² or m]; null: that of the config, at the sampling of the file.",
    )
    bias: Annotated[Positive | None, Plausible(1e-12, 1e3, "strain, m/s² or m")] = expert(
        None, description="σ of an unknown constant offset, which is estimated too [strain, m/s² or m]; null: none."
    )


RATES = {"Hz": 1.0, "kHz": 1e3}
"""Units of a sampling rate → Hz."""


class ClockSection(Section):
    """The time of the file; a UFF function carries its own, channels of MDF4 and TDMS mostly."""

    channel: Text | None = Field(
        None,
        description="Column, dataset, channel or variable of the time; of a MAT file also the one interval between samples, or "
        "with unit Hz their rate.",
    )
    unit: Text = expert("s", description="Its unit: s, ms, us, min; Hz of a rate.")
    rate: Annotated[Positive | None, Plausible(1e-3, 1e7, "Hz or kHz")] = expert(
        None, description="Samples per second, where the file has no time: {rate: 100, unit: Hz}, in place of channel."
    )

    @model_validator(mode="after")
    def _one_clock(self) -> ClockSection:
        if self.rate is None:
            return self
        if self.channel is not None:
            raise ValueError("either `channel` or `rate`; remove one of them")
        if "unit" in self.model_fields_set and self.unit not in RATES:
            raise ValueError(f"a rate in {self.unit}; set `unit` to one of {', '.join(RATES)}")
        return self

    @property
    def hertz(self) -> float | None:
        """The rate in Hz."""
        return None if self.rate is None else self.rate * RATES.get(self.unit, 1.0)


class TextForm(Section):
    """How a text table is written."""

    delimiter: Literal[",", ";", "\t"] | None = expert(
        None, description="Between cells; null: as the first line shows."
    )
    decimal: Literal[".", ","] = expert(".", description="Decimal mark.")
    comment: str = expert("#", description="What lines to pass over begin with; empty: none.")
    header_line: Count | None = expert(
        None, description="Line of the names, where others without a comment sign stand above it [-]."
    )
    missing: tuple[Text, ...] = expert((), description="Words that stand for no sample, beside an empty cell and NaN.")


class Field3D(Section):
    """The strain and stress of the whole surface in time."""

    every: Annotated[Positive | None, Plausible(1e-6, 1e5, "s")] = Field(
        None, description="Time between pictures [s]; null: a hundred of them."
    )


class Tune(Section):
    """Noise levels from the measurements themselves, by maximum likelihood."""

    parts: tuple[Literal["process", "inputs", "model_error", "parameters", "noise"], ...] = expert(
        (), description="Which noises get a factor; none: all as stated."
    )


FileFormat = Literal["auto", "csv", "hdf5", "uff58", "mdf", "tdms", "mat"]


class RecordedFile(Section):
    """How the file of a test is read."""

    format: FileFormat = expert(
        "auto", description="Which reader; auto: by the ending; mdf and tdms need the extra daq."
    )
    text: TextForm = expert(default_factory=TextForm, description="How a CSV file is written.")
    time: ClockSection = with_defaults(ClockSection, "The time of the file.")


class RecordOfTest(Section):
    """A record of a campaign: its file, and where it is written in another way than the others."""

    name: RunName = Field(
        description="Of the record, as tables and pages have it; part of file names: letters, digits, - and _."
    )
    file: Text = Field(description="As estimate.file.")
    date: Text | None = Field(None, description="As estimate.date; null: that one.")
    format: FileFormat | None = Field(None, description="As estimate.format; null: that one.")
    text: TextForm | None = expert(None, description="As estimate.text; null: that one.")
    time: ClockSection | None = Field(None, description="As estimate.time; null: that one.")
    channels: Annotated[tuple[GaugeChannel, ...], Field(min_length=1)] | None = expert(
        None, description="As estimate.channels, of the same gauges, grids and biases in the same order; null: those."
    )
    inputs: dict[Name, Channel] | None = Field(None, description="As estimate.inputs; null: those.")


class EstimateOptions(Section):
    """What the estimates of a structure and of a bench both have."""

    hold_out: Literal["each"] | None = expert(
        None,
        description="each: leave every gauge, of a bench also every component of another sensor, out in turn, and compare what "
        "it read with what the others say; a filter, of a structure also a smoother, more for each.",
    )
    accept: bool = expert(
        False,
        description="true: σ is given although the record of a test contradicts the model; `estimate --accept` is the same for "
        "one run.",
    )
    allow_unobservable: bool = expert(
        False,
        description="true: go on where the sensors cannot tell all unknowns, of a bench at any instant of the run.",
    )


class Estimate(RecordedFile, EstimateOptions):
    """The filter on measurements of a test."""

    file: Text | None = Field(
        None,
        description="CSV, HDF5, UFF58, MDF4, TDMS or MAT file, from the config's folder; `estimate --measurements FILE` gives "
        "another.",
    )
    records: tuple[RecordOfTest, ...] = Field(
        (),
        description="In place of file: several records of one test, {name: low, file: low.csv}, in one estimate. Parameters and "
        "what is bonded are the same in all; loads, motion and zeros are each record's own (docs/estimation.md).",
    )
    date: Text | None = expert(None, description="When it was measured, as the page of the test is to say it.")
    time_step: TimeStep | None = expert(
        None,
        description="Time step of the filter [s], a whole part of the sampling interval; null: that interval, or a half or a "
        "third of it for known loads that are fast.",
    )
    channels: Annotated[tuple[GaugeChannel, ...], Field(min_length=1)] = Field(
        description="Channels of gauges, an entry each: {gauge: G1, channel: NAME, unit: um/m}, as in docs/estimation.md."
    )
    gauges_file: Text | None = Field(
        None,
        description="Where the gauges of the layout were bonded: a copy of its gauges.csv. Needed where a channel is of a "
        "gauge without a name of its own (G1).",
    )
    as_placed: bool = expert(
        False, description="true: in place of gauges_file; G1 is where the layout has it now, which nothing checks."
    )
    inputs: dict[Name, Channel] = Field({}, description="Channels of the known loads, by the names of these.")
    start: Literal["rest", "moving", "settled"] = Field(
        "moving",
        description="rest: the structure stands still when the record begins; settled: it moves periodically under its loads, "
        "all known and sums of sines as in `loads`, amplitudes and phases of the record; moving: nothing is known of it.",
    )
    initial_std: Annotated[dict[Name, Positive], RELATIVE_STD] = expert(
        {}, description="Initial σ of unknowns, relative to guess or amplitude [-]; default: those of validate."
    )
    virtual: tuple[NamedGauge, ...] = Field((), description="Gauges that were never bonded, whose strain is wanted.")
    field: Field3D | None = Field(None, description="Strain and stress of the surface in time; null: none.")
    damage: DamageSettings | None = Field(
        None, description="Fatigue damage at the surface and at virtual gauges, with its interval; null: none."
    )
    tune: Tune = expert(default_factory=Tune, description="Noise levels from the measurements.")
    loads_as_stated: bool = expert(
        False,
        description="true: the unknown loads are taken to move as process_noise states; false: parameters are judged by what "
        "no unknown load could cause, and σ is withheld where no load is known. place and validate judge by free loads all the "
        "same.",
    )
