"""Measurements of a test: assignment of channels to gauges and loads, file formats, and fatigue damage."""

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
    """S-N curve N = cycles · (stress/Δσ)^slope: straight lines of ln N over ln Δσ."""

    slope: Annotated[float, Field(ge=1, le=30)] = Field(description="Slope m of the line through `stress` [-].")
    stress: Stress = Field(description="Stress range or amplitude with a life of `cycles` cycles [Pa].")
    of: Literal["range", "amplitude"] = expert(
        "range", description="Kind of `stress`: a range Δσ, from valley to peak, or an amplitude σ_a = Δσ/2."
    )
    cycles: Cycles = Field(2e6, description="Number of cycles to failure at `stress` [-].")
    knee: Cycles | None = Field(None, description="Number of cycles at the knee point [-]; null: no knee point.")
    second_slope: Annotated[float, Field(ge=1, le=60)] | None = Field(
        None, description="Slope m₂ beyond the knee point [-]; null: ranges below the knee point cause no damage."
    )
    cut_off: Cycles | None = Field(
        None, description="Number of cycles at the cut-off limit [-]: smaller ranges cause no damage. Null: none."
    )


class MeanStressSection(Section):
    """Mean stress correction: range with the same damage at zero mean stress. The S-N curve then has to be for zero mean stress
    (R = −1)."""

    rule: Literal["none", "goodman", "fkm"] = expert(
        "none",
        description="Rule. With `none`: no correction. With `goodman`: Δσ/(1 − σ_m/R_m) for tensile mean stress. With `fkm`: "
        "mean stress sensitivity M of the FKM guideline.",
    )
    tensile_strength: Stress | None = expert(None, description="Tensile strength R_m for goodman [Pa].")
    sensitivity: Annotated[float, Field(ge=0, le=1)] | None = expert(
        None, description="Mean stress sensitivity M for fkm [-]."
    )


class DamageSettings(Section):
    """Fatigue damage of the record at every surface point and every virtual gauge, with its uncertainty interval."""

    curve: SNCurve = Field(description="The S-N curve of the material.")
    mean_stress: MeanStressSection = expert(default_factory=MeanStressSection, description="Mean stress correction.")
    stress: Literal["signed_von_mises", "principal"] = expert(
        "signed_von_mises",
        description="Stress at the surface: von Mises stress with the sign of the principal stress of largest "
        "magnitude, or this principal stress. For a virtual gauge, the stress is E ε along the gauge.",
    )
    draws: Annotated[int, Field(ge=40, le=10_000)] = Field(
        200, description="Number of stress histories sampled from the posterior of the smoother [-]."
    )
    points: Annotated[Annotated[int, Field(ge=1)] | None, Plausible(1, 1e6)] = Field(
        None,
        description="Number of surface points with an uncertainty interval, those with the largest damage first [-]; null: all.",
    )
    equivalent_cycles: Cycles = expert(
        1e6, description="Reference number of cycles N_eq of the damage-equivalent range [-]."
    )
    repetitions: Annotated[Positive, Plausible(1e-6, 1e12)] = Field(
        1.0, description="Number of repetitions of the record [-]; the damage is that of all repetitions."
    )
    hot_spots: Annotated[int, Field(ge=1, le=1000)] = expert(10, description="Number of hot spots in the table [-].")

    def problems(self) -> Iterator[Problem]:
        curve, mean = self.curve, self.mean_stress
        if curve.second_slope is not None and curve.knee is None:
            remedy = "set estimate.damage.curve.knee, or remove this key"
            yield Problem("curve.second_slope", "the curve has no knee point", remedy, at_key=True)
        if curve.cut_off is not None and curve.knee is not None and curve.cut_off <= curve.knee:
            what = f"a cut-off at {curve.cut_off:g} cycles is not beyond the knee point at {curve.knee:g} cycles"
            yield Problem("curve.cut_off", what, "increase the number of cycles, or remove the key")
        if curve.cut_off is not None and curve.knee is not None and curve.second_slope is None:
            what = "has no effect: without second_slope, ranges below the knee point cause no damage"
            yield Problem("curve.cut_off", what, "set second_slope, or remove this key", at_key=True)
        for rule, name in (("goodman", "tensile_strength"), ("fkm", "sensitivity")):
            is_set = getattr(mean, name) is not None
            if mean.rule == rule and not is_set:
                yield Problem("mean_stress", f"{rule} needs {name}", f"set estimate.damage.mean_stress.{name}")
            if mean.rule != rule and is_set:
                remedy = f"remove the key, or set rule: {rule}"
                yield Problem(f"mean_stress.{name}", f"has no effect with the rule {mean.rule}", remedy, at_key=True)


BridgeKind = Literal[
    "quarter", "half", "half-opposite", "half-poisson", "full", "full-bending-poisson", "full-poisson", "sum"
]


class BridgeSection(Section):
    """Wheatstone bridge of a channel in mV/V."""

    arrangement: BridgeKind = Field(
        description="Bridge circuit, see docs/estimation.md; `sum`: a bridge of gauges.fixed."
    )
    gauge_factor: Annotated[Positive, GAUGE_FACTOR] = Field(description="Gauge factor [-].")
    poisson_ratio: float | None = expert(
        None, gt=-1, lt=0.5, description="Poisson's ratio of the part, for circuits with transverse gauges [-]."
    )


class DelayInSamples(Section):
    """A delay in sampling intervals of the file."""

    samples: Annotated[int, Plausible(0, 1e6)] = expert(
        description="Delay of the channel in whole samples; negative: advance [-]."
    )


class DelayInSeconds(Section):
    """A delay in seconds."""

    seconds: Annotated[float, Plausible(0.0, 1e4, "s")] = expert(
        description="Delay of the channel, a whole number of sampling intervals; negative: advance [s]."
    )


Delay = Annotated[
    Annotated[DelayInSamples, Tag("samples")] | Annotated[DelayInSeconds, Tag("seconds")], key_of("samples", "seconds")
]


class Channel(Section):
    """A channel of the file and its corrections. Unit and bridge are never guessed."""

    channel: Text = Field(
        description="Name of the channel: column, dataset, channel or variable (a.b for a struct of a MAT file). For UFF: "
        "node:direction or id line of the function. For MDF4 and TDMS: channel or group/channel."
    )
    unit: Text = Field(
        description="Unit of the readings: um/m, mV/V, m/s2, g, mm, kN, …; it has to agree with the unit in the file."
    )
    override: bool = expert(
        False,
        description="`true`: accept this channel although its unit differs from the file, its readings are implausibly "
        "small, or it repeats values like a slower channel.",
    )
    bridge: BridgeSection | None = Field(
        None, description="Wheatstone bridge; required for mV/V and V/V, not permitted otherwise."
    )
    sign: Literal[1, -1] = expert(1, description="Polarity [-]; −1: reversed wiring.")
    scale: Annotated[Positive, Plausible(1e-6, 1e6)] = expert(1.0, description="Factor on the calibrated signal [-].")
    offset: Annotated[float, READING] = expert(0.0, description="Offset, subtracted from the readings [unit].")
    drift: Annotated[float, READING] = expert(
        0.0,
        description="Drift rate; its product with the time since the start is subtracted from the readings [unit/s].",
    )
    zero: Annotated[tuple[float, float] | None, INSTANT] = Field(
        None, description="Zero interval [from, to] [s]; the mean of its readings is subtracted."
    )
    missing: Annotated[tuple[tuple[float, float], ...], INSTANT] = Field(
        (),
        description="Intervals [[from, to], …] of missing samples, such as spikes, in the time of the file [s].",
    )
    delay: Delay | None = expert(
        None,
        description="Delay of the channel to correct, {samples: n} or {seconds: s}; null: none.",
    )


class GaugeChannel(Channel):
    """A channel of a gauge."""

    gauge: Text | Id = Field(
        description="Name of the gauge in gauges.fixed, its number in the table of gauges.strain_operator, or its label in the "
        "layout (G1, as in gauges.csv)."
    )
    grid: Annotated[int, Plausible(1, 3)] = expert(
        1, ge=1, description="Number of the grid of a rosette or of the axis of a sensor, from 1 [-]."
    )
    noise_std: Annotated[Positive | None, NOISE] = expert(
        None,
        description="Noise standard deviation of one sample [strain, m/s² or m]; null: that of the config, at the sampling "
        "rate of the file.",
    )
    bias: Annotated[Positive | None, Plausible(1e-12, 1e3, "strain, m/s² or m")] = expert(
        None,
        description="Standard deviation of a constant offset of the readings [strain, m/s² or m]; the filter "
        "estimates the offset. Null: no offset.",
    )


RATES = {"Hz": 1.0, "kHz": 1e3}
"""Units of a sampling rate, as a factor to Hz."""


class ClockSection(Section):
    """Time of the samples. UFF functions contain it; MDF4 and TDMS channels usually do."""

    channel: Text | None = Field(
        None,
        description="Column, dataset, channel or variable with the time. In a MAT file, it may be the sampling interval, or "
        "with unit Hz the sampling rate.",
    )
    unit: Text = expert("s", description="Unit of the time: s, ms, us, min; Hz for a rate.")
    rate: Annotated[Positive | None, Plausible(1e-3, 1e7, "Hz or kHz")] = expert(
        None, description="Sampling rate of a file without time, instead of channel: {rate: 100, unit: Hz}."
    )

    @model_validator(mode="after")
    def _one_clock(self) -> ClockSection:
        if self.rate is None:
            return self
        if self.channel is not None:
            raise ValueError("`channel` and `rate` are both set; remove one of them")
        if "unit" in self.model_fields_set and self.unit not in RATES:
            raise ValueError(f"{self.unit} is not a unit of a sampling rate; set `unit` to one of {', '.join(RATES)}")
        return self

    @property
    def hertz(self) -> float | None:
        """Sampling rate in Hz."""
        return None if self.rate is None else self.rate * RATES.get(self.unit, 1.0)


class TextForm(Section):
    """Format of a text table."""

    delimiter: Literal[",", ";", "\t"] | None = expert(
        None, description="Column separator; null: detected from the first line."
    )
    decimal: Literal[".", ","] = expert(".", description="Decimal mark.")
    comment: str = expert("#", description="First characters of comment lines; empty: no comments.")
    header_line: Count | None = expert(
        None, description="Number of the header line, if other lines precede it without a comment character [-]."
    )
    missing: tuple[Text, ...] = expert(
        (), description="Words for a missing sample, in addition to an empty cell and NaN."
    )


class Field3D(Section):
    """Strain and stress of the whole surface over time."""

    every: Annotated[Positive | None, Plausible(1e-6, 1e5, "s")] = Field(
        None, description="Time between frames [s]; null: 100 frames."
    )


class Tune(Section):
    """Maximum-likelihood tuning of noise levels from the measurements."""

    parts: tuple[Literal["process", "inputs", "model_error", "parameters", "noise"], ...] = expert(
        (), description="Noise levels to tune, each by one factor; empty: no tuning."
    )


FileFormat = Literal["auto", "csv", "hdf5", "uff58", "mdf", "tdms", "mat"]


class RecordedFile(Section):
    """File format of a test."""

    format: FileFormat = expert(
        "auto",
        description="File format; `auto`: by the file extension. mdf and tdms need the optional dependencies `daq`.",
    )
    text: TextForm = expert(default_factory=TextForm, description="Format of a CSV file.")
    time: ClockSection = with_defaults(ClockSection, "Time of the samples.")


class RecordOfTest(Section):
    """One record of a campaign: its file, and keys that differ from the other records."""

    name: RunName = Field(description="Name of the record in tables, pages and file names: letters, digits, - and _.")
    file: Text = Field(description="Measurement file, as estimate.file.")
    date: Text | None = Field(None, description="Date of the test; null: estimate.date.")
    format: FileFormat | None = Field(None, description="File format; null: estimate.format.")
    text: TextForm | None = expert(None, description="Format of a CSV file; null: estimate.text.")
    time: ClockSection | None = Field(None, description="Time of the samples; null: estimate.time.")
    channels: Annotated[tuple[GaugeChannel, ...], Field(min_length=1)] | None = expert(
        None, description="Channels of the same gauges, grids and biases in the same order; null: estimate.channels."
    )
    inputs: dict[Name, Channel] | None = Field(None, description="Channels of the known loads; null: estimate.inputs.")


class EstimateOptions(Section):
    """Options of the estimate of a structure or a bench."""

    hold_out: Literal["each"] | None = expert(
        None,
        description="`each`: leave out every gauge in turn (in a bench also every component of other sensors), and compare its "
        "readings with the prediction from the others. This costs one more filter run per gauge, and for a structure a "
        "smoother run.",
    )
    accept_inconsistent: bool = expert(
        False,
        description="`true`: report uncertainties even if the measurements are inconsistent with the model. `estimate "
        "--accept` has the same effect for one run.",
    )
    allow_unobservable: bool = expert(
        False,
        description="`true`: continue although the sensors cannot distinguish all unknowns (in a bench, at any instant of the "
        "run).",
    )


class Estimate(RecordedFile, EstimateOptions):
    """Estimation from the measurements of a test."""

    file: Text | None = Field(
        None,
        description="Measurement file in CSV, HDF5, UFF58, MDF4, TDMS or MAT format, relative to the folder of the config. "
        "`estimate --measurements FILE` overrides it.",
    )
    records: tuple[RecordOfTest, ...] = Field(
        (),
        description="Several records of one test in one estimate, instead of file: {name: low, file: low.csv}. Parameters "
        "and gauge errors are common to all records; loads, motion and zero offsets differ (docs/estimation.md).",
    )
    date: Text | None = expert(None, description="Date of the test, as printed on its page.")
    time_step: TimeStep | None = expert(
        None,
        description="Time step of the filter [s], an integer fraction of the sampling interval. Null: the sampling interval, "
        "or a half or a third of it for known loads with high frequencies.",
    )
    channels: Annotated[tuple[GaugeChannel, ...], Field(min_length=1)] = Field(
        description="Channels of gauges, with one entry each: {gauge: G1, channel: NAME, unit: um/m}; see docs/estimation.md."
    )
    gauges_file: Text | None = Field(
        None,
        description="Copy of gauges.csv with the locations where the gauges were bonded. Required for channels of "
        "layout gauges without a name, such as G1.",
    )
    as_placed: bool = expert(
        False,
        description="`true`: use the locations of the current layout instead of gauges_file; this is not checked.",
    )
    inputs: dict[Name, Channel] = Field({}, description="Channels of the known loads, by load name.")
    start: Literal["rest", "moving", "settled"] = Field(
        "moving",
        description="Initial motion. With `rest`: the structure is at rest when the record begins. With `settled`: periodic "
        "motion; all loads have to be known sums of sines as in `loads`, with amplitudes and phases of the record. With "
        "`moving`: unknown motion.",
    )
    initial_std: Annotated[dict[Name, Positive], RELATIVE_STD] = expert(
        {},
        description="Initial standard deviation of the unknowns, relative to guess or amplitude [-]; default: that of validate.",
    )
    virtual: tuple[NamedGauge, ...] = Field(
        (), description="Virtual gauges: locations without a sensor where the strain is estimated."
    )
    field: Field3D | None = Field(None, description="Strain and stress of the surface over time; null: none.")
    damage: DamageSettings | None = Field(
        None,
        description="Fatigue damage at the surface and at virtual gauges, with its uncertainty interval; null: none.",
    )
    tune: Tune = expert(default_factory=Tune, description="Tuning of noise levels from the measurements.")
    loads_follow_model: bool = expert(
        False,
        description="`true`: the unknown loads follow the model of process_noise. With `false`: the unknown loads "
        "are arbitrary. Then only strains that no unknown load can cause carry information on parameters, and σ is "
        "omitted if no load is known. place and validate always assume arbitrary loads.",
    )
