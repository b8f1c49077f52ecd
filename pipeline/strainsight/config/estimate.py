"""Measurements of a test: assignment of channels to gauges and loads, and file formats."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, Tag, model_validator

from strainsight.config.base import (
    GAUGE_FACTOR,
    INSTANT,
    NOISE,
    READING,
    RELATIVE_STD,
    Count,
    Id,
    Name,
    Plausible,
    Positive,
    RunName,
    Section,
    Text,
    TimeStep,
    expert,
    with_defaults,
)
from strainsight.config.damage import DamageSettings
from strainsight.config.gauges import NamedGauge
from strainsight.config.layout import key_of

BridgeKind = Literal[
    "quarter", "half", "half-opposite", "half-poisson", "full", "full-bending-poisson", "full-poisson", "sum"
]


class BridgeSection(Section):
    """Wheatstone bridge of a channel in mV/V or V/V."""

    arrangement: BridgeKind = Field(
        description="Bridge circuit; docs/estimation.md lists the circuits. With `sum`: arms as defined in gauges.fixed "
        "or gauges.bridge; the strain of the channel is the signed sum of the arm strains."
    )
    gauge_factor: Annotated[Positive, GAUGE_FACTOR] = Field(description="Gauge factor of the gauges in the bridge [-].")
    poisson_ratio: float | None = expert(
        None, gt=-1, lt=0.5, description="Poisson's ratio of the part, for circuits with transverse gauges [-]."
    )


class DelayInSamples(Section):
    """Delay of a channel, as a number of sampling intervals of the file."""

    samples: Annotated[int, Plausible(0, 1e6)] = expert(
        description="Delay of the channel relative to the other channels, in samples [-]: positive if the channel is late, "
        "negative if the channel is early."
    )


class DelayInSeconds(Section):
    """Delay of a channel in seconds."""

    seconds: Annotated[float, Plausible(0.0, 1e4, "s")] = expert(
        description="Delay of the channel relative to the other channels, a multiple of the sampling interval [s]: positive "
        "if the channel is late, negative if the channel is early."
    )


Delay = Annotated[
    Annotated[DelayInSamples, Tag("samples")] | Annotated[DelayInSeconds, Tag("seconds")], key_of("samples", "seconds")
]


class Channel(Section):
    """A channel of the measurement file, and the corrections of its readings. Unit and bridge are not detected: set both keys."""

    channel: Text = Field(
        description="Name of the channel in the file: column, dataset, channel or variable (a.b for the field b of a struct a "
        "in a MAT file). For UFF: node:direction or id line of the function. For MDF4 and TDMS: channel or group/channel."
    )
    unit: Text = Field(
        description="Unit of the readings: um/m, mV/V, m/s2, g, mm, kN, …; this unit has to agree with the unit in the file."
    )
    override: bool = expert(
        False,
        description="`true`: accept this channel although the unit differs from the unit in the file, readings are implausibly "
        "small, or repeated values indicate that the channel was sampled at a lower rate.",
    )
    bridge: BridgeSection | None = Field(
        None,
        description="Wheatstone bridge of the channel; required for the units mV/V and V/V, not permitted for other units.",
    )
    sign: Literal[1, -1] = expert(
        1, description="Polarity of the channel, a factor on the readings [-]; −1 for reversed wiring."
    )
    scale: Annotated[Positive, Plausible(1e-6, 1e6)] = expert(
        1.0, description="Factor on the signal after all other corrections [-]."
    )
    offset: Annotated[float, READING] = expert(
        0.0, description="Offset that is subtracted from the readings [unit of the readings]."
    )
    drift: Annotated[float, READING] = expert(
        0.0,
        description="Drift rate of the readings [unit of the readings per s]; drift rate times time since the start of the "
        "record is subtracted from the readings.",
    )
    zero: Annotated[tuple[float, float] | None, INSTANT] = Field(
        None,
        description="Time interval [from, to] of the zero readings, such as before loading, in the time of the file "
        "[s]; the mean of these readings is subtracted from all readings.",
    )
    missing: Annotated[tuple[tuple[float, float], ...], INSTANT] = Field(
        (),
        description="Time intervals [[from, to], …] with invalid samples, such as spikes, in the time of the file [s]; the "
        "filter skips these samples.",
    )
    delay: Delay | None = expert(
        None,
        description="Delay of the channel, which is corrected by a shift: {samples: n} or {seconds: s}; null: no delay.",
    )


class GaugeChannel(Channel):
    """A channel with the readings of a gauge."""

    gauge: Text | Id = Field(
        description="Name of the gauge in gauges.fixed, number of the gauge in the table of gauges.strain_operator, or label "
        "of the gauge in the layout, such as G1 in gauges.csv."
    )
    grid: Annotated[int, Plausible(1, 3)] = expert(
        1, ge=1, description="Number of the measuring grid of a rosette, or of the axis of a motion sensor, from 1 [-]."
    )
    noise_std: Annotated[Positive | None, NOISE] = expert(
        None,
        description="Noise standard deviation of one sample of the file [strain, m/s² or m]; null: noise_std of the section "
        "`gauges` or `motion_sensors`, converted to the sampling rate of the file.",
    )
    bias: Annotated[Positive | None, Plausible(1e-12, 1e3, "strain, m/s² or m")] = expert(
        None,
        description="Standard deviation of a constant offset of the readings [strain, m/s² or m]; the filter "
        "estimates the offset. Null: no offset.",
    )


RATES = {"Hz": 1.0, "kHz": 1e3}
"""Units of a sampling rate, as a factor to Hz."""


class ClockSection(Section):
    """Time of the samples: a channel of the file, or a sampling rate. UFF functions always contain the time; MDF4 and TDMS
    channels usually contain the time."""

    channel: Text | None = Field(
        None,
        description="Name of the column, dataset, channel or variable with the time. In a MAT file, the variable may also "
        "contain the sampling interval, or with `unit: Hz` the sampling rate.",
    )
    unit: Text = expert("s", description="Unit of the time: s, ms, us or min. For a sampling rate: Hz or kHz.")
    rate: Annotated[Positive | None, Plausible(1e-3, 1e7, "Hz or kHz")] = expert(
        None, description="Sampling rate of a file without a time channel, instead of `channel`: {rate: 100, unit: Hz}."
    )

    @model_validator(mode="after")
    def _one_clock(self) -> ClockSection:
        if self.rate is None:
            return self
        if self.channel is not None:
            raise ValueError("`channel` and `rate` are both set; remove `channel` or `rate`")
        if "unit" in self.model_fields_set and self.unit not in RATES:
            raise ValueError(f"{self.unit} is not a unit of a sampling rate; set `unit` to one of {', '.join(RATES)}")
        return self

    @property
    def hertz(self) -> float | None:
        """Sampling rate in Hz."""
        return None if self.rate is None else self.rate * RATES.get(self.unit, 1.0)


class TextForm(Section):
    """Format of a CSV measurement file."""

    delimiter: Literal[",", ";", "\t"] | None = expert(
        None, description="Column separator; null: detected from the first line."
    )
    decimal: Literal[".", ","] = expert(".", description="Decimal mark of the numbers.")
    comment: str = expert("#", description="First characters of comment lines; empty: no comments.")
    header_line: Count | None = expert(
        None,
        description="Line number of the column names, from 1 [-]. Required if lines without a comment character precede "
        "the column names.",
    )
    missing: tuple[Text, ...] = expert(
        (), description="Words or numbers that mark a missing sample, in addition to an empty cell and NaN."
    )


class Field3D(Section):
    """Strain and stress of the whole surface over time."""

    every: Annotated[Positive | None, Plausible(1e-6, 1e5, "s")] = Field(
        None,
        description="Time between two stored instants of the surface strain [s]; null: 100 instants in the record.",
    )


class Tune(Section):
    """Maximum-likelihood tuning of noise levels from the measurements."""

    parts: tuple[Literal["process", "inputs", "model_error", "parameters", "noise"], ...] = expert(
        (),
        description="Noise variances to tune, each by one factor; empty: no tuning. With `noise`: measurement noise. With "
        "`process`: all process noise. With `inputs`: process noise of the loads. With `model_error`: process noise of the "
        "velocities. With `parameters`: process noise of the parameters.",
    )


FileFormat = Literal["auto", "csv", "hdf5", "uff58", "mdf", "tdms", "mat"]


class RecordedFile(Section):
    """Format of a measurement file."""

    format: FileFormat = expert(
        "auto",
        description="File format; `auto`: by the file extension. `mdf` and `tdms` need extra packages: `pip install "
        "strainsight[daq]`.",
    )
    text: TextForm = expert(default_factory=TextForm, description="Format of a CSV measurement file.")
    time: ClockSection = with_defaults(ClockSection, "Time of the samples: a channel of the file, or a sampling rate.")


class RecordOfTest(Section):
    """One of several records of a test: its file, and keys that differ from the section `estimate`."""

    name: RunName = Field(description="Name of the record in tables, pages and file names: letters, digits, - and _.")
    file: Text = Field(description="Measurement file of this record, in one of the formats of estimate.file.")
    date: Text | None = Field(None, description="Date of the test; null: estimate.date.")
    format: FileFormat | None = Field(None, description="File format; null: estimate.format.")
    text: TextForm | None = expert(None, description="Format of a CSV file; null: estimate.text.")
    time: ClockSection | None = Field(None, description="Time of the samples of this record; null: estimate.time.")
    channels: Annotated[tuple[GaugeChannel, ...], Field(min_length=1)] | None = expert(
        None,
        description="Channels of this record, with the gauges, measuring grids and biases of estimate.channels in the same "
        "order; null: estimate.channels.",
    )
    inputs: dict[Name, Channel] | None = Field(None, description="Channels of the known loads; null: estimate.inputs.")


class EstimateOptions(Section):
    """Options of the estimate of a structure or a bench."""

    hold_out: Literal["each"] | None = expert(
        None,
        description="`each`: omit every gauge in turn, and compare the readings of this gauge with the readings predicted "
        "from all remaining sensors. A bench also omits every component of every sensor that is not a gauge. Every omitted "
        "gauge or component needs one more filter run, and for a structure also one more smoother run. Null: no comparison.",
    )
    accept_inconsistent: bool = expert(
        False,
        description="`true`: report uncertainties even if the measurements are inconsistent with the model. The option "
        "`--accept` of `strainsight estimate` has the same effect for one run.",
    )
    allow_unobservable: bool = expert(
        False,
        description="`true`: continue although the sensors cannot distinguish all unknowns. A bench checks several instants of "
        "the run, and stops only if the unknowns are indistinguishable at all these instants.",
    )


class Estimate(RecordedFile, EstimateOptions):
    """Estimation from the measurements of a test."""

    file: Text | None = Field(
        None,
        description="Measurement file in CSV, HDF5, UFF58, MDF4, TDMS or MAT format, relative to the folder of the config. The "
        "option `--measurements FILE` of `strainsight estimate` overrides this key.",
    )
    records: tuple[RecordOfTest, ...] = Field(
        (),
        description="Several records of one test for one estimate, instead of `file`, with entries such as {name: low, file: "
        "low.csv}. Common to all records: parameters, and installation and gain errors of gauges. Separate: loads, motion "
        "and offsets of the readings (docs/estimation.md).",
    )
    date: Text | None = expert(None, description="Date of the test, printed on the results page.")
    time_step: TimeStep | None = expert(
        None,
        description="Time step of the filter [s], an integer fraction of the sampling interval. Null: the sampling interval; "
        "for known loads with high frequencies, a half or a third of the sampling interval.",
    )
    channels: Annotated[tuple[GaugeChannel, ...], Field(min_length=1)] = Field(
        description="Channels of the gauges, one entry for each channel, such as {gauge: G1, channel: NAME, unit: um/m}; see "
        "docs/estimation.md."
    )
    gauges_file: Text | None = Field(
        None,
        description="Copy of gauges.csv with the locations where the gauges of the layout were bonded. Required if a channel "
        "has the label of a gauge of the layout as `gauge`, such as G1.",
    )
    as_placed: bool = expert(
        False,
        description="`true`: use the locations of the current layout instead of `gauges_file`. It is not checked whether the "
        "gauges were bonded at these locations.",
    )
    inputs: dict[Name, Channel] = Field({}, description="Channels of the known loads, by load name.")
    start: Literal["rest", "moving", "settled"] = Field(
        "moving",
        description="Initial motion. With `rest`: the structure is at rest at the start of the record. With `settled`: periodic "
        "motion under known loads. Every load has to be a sine or a multisine in `loads`; amplitudes and phases are taken "
        "from the record. With `moving`: unknown motion.",
    )
    initial_std: Annotated[dict[Name, Positive], RELATIVE_STD] = expert(
        {},
        description="Initial standard deviation of each unknown, by name, relative to the guess of the parameter or to the "
        "amplitude of the load [-]; default: validate.initial_std.",
    )
    virtual: tuple[NamedGauge, ...] = Field(
        (), description="Virtual gauges: locations without a sensor where the strain is estimated."
    )
    field: Field3D | None = Field(None, description="Strain and stress of the surface over time; null: not computed.")
    damage: DamageSettings | None = Field(
        None,
        description="Fatigue damage at the surface and at virtual gauges, with uncertainty intervals; null: not computed.",
    )
    tune: Tune = expert(default_factory=Tune, description="Tuning of noise levels from the measurements.")
    loads_follow_model: bool = expert(
        False,
        description="With `true`: every unknown load follows its model in loads.NAME.process_noise exactly. With `false`: "
        "unknown loads are arbitrary. Then parameters are estimated only from strains that no unknown load can cause, and "
        "σ of the parameters is omitted if no load is known. The stages `place` and `validate` always assume arbitrary loads.",
    )
