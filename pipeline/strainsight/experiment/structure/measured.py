"""A test as the filter needs it: what its channels measured, on the clock of the filter, and which gauges they are."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from strainsight.config.estimate import Channel, Estimate, GaugeChannel
from strainsight.errors import ConfigError, StrainsightError
from strainsight.estimation.record import Settled
from strainsight.experiment.recorded import delay_in_seconds, signals_of
from strainsight.experiment.structure.problem import Problem, settled_at
from strainsight.experiment.structure.start import tones_in
from strainsight.loads.histories import fill_gaps, interpolate, join_by_lines, quadratic_hold, share_above, tones_of
from strainsight.measurements.assemble import Signals
from strainsight.measurements.calibration import SUM
from strainsight.measurements.reader import format_of
from strainsight.measurements.records import SI
from strainsight.records.estimated import TestSource
from strainsight.runner.artefact import sha256_of


@dataclass(frozen=True)
class RecordSettings:
    """name: empty of a test that is one file; label: the same, empty of a test that is one record; settings: as of a test of this
    file alone; key below which its file is stated; section: where what is put right for this record alone is; channels, inputs:
    keys of the channels."""

    name: str
    label: str
    settings: Estimate
    key: str
    section: str
    channels: str
    inputs: str

    @property
    def file(self) -> str:
        """Key of the file."""
        return f"{self.key}.file"


def records_of(settings: Estimate) -> tuple[RecordSettings, ...]:
    """Of `estimate.file` or `estimate.records`; none where neither is stated. What a record does not state is that of all."""
    if settings.file is not None:
        return (RecordSettings("", "", settings, "estimate", "estimate", "estimate.channels", "estimate.inputs"),)
    records, several = [], len(settings.records) > 1
    for i, entry in enumerate(settings.records):
        key = f"estimate.records.{i}"
        stated = {name: value for name in STATED if (value := getattr(entry, name)) is not None}
        # what one channel of the one record needs is stated with all others
        section = key if several or "channels" in stated else "estimate"
        channels, inputs = (f"{key if name in stated else 'estimate'}.{name}" for name in ("channels", "inputs"))
        alone = settings.model_copy(update={**stated, "records": ()})
        records.append(RecordSettings(entry.name, entry.name * several, alone, key, section, channels, inputs))
    return tuple(records)


@contextmanager
def in_record(name: str) -> Iterator[None]:
    """Name the record in an error; nothing where the name is empty."""
    try:
        yield
    except StrainsightError as error:
        if name:
            error.what = f"record '{name}': {error.what}"
        raise


MISSED = 0.05
"""RMS of what a record has beside its tones, over its own, up to which its motion counts as periodic."""
LARGEST_STRAIN = 0.1
"""[m/m] Foil gauges end at a few per cent."""
FEW = 0.01
"""Share of samples beyond that, up to which they are spikes and no other unit."""
LEAST_STRAIN = 1e-8
"""[m/m] A tenth of what amplifiers resolve."""
STATED = ("file", "date", "format", "text", "time", "channels", "inputs")
"""What a record may state in place of what holds for all."""
QUANTITY = ("strain", "acceleration", "displacement")
LONGEST_GAP = 10
"""Samples of a known load that may be missing in a row, or twice as many as are missing as a rule, as in a table of two rates."""
BAND = 0.3
"""Of the sampling rate of a load: up to there the samples determine what is between them to 2e-3."""
HELD, FINEST = 0.1, 3
"""Of the rate of the filter's steps: up to there the polynomial that holds a load within a step is off by 2e-3 of it at most,
and what modes near that rate make of it does not matter. And the most steps a sample for it, which BAND asks for."""
SLIGHT, LARGEST = 0.05, 0.25
"""RMS of a load beyond BAND or HELD, over all of it, from which it matters, and is refused."""


@dataclass(frozen=True)
class Measured:
    """time (T + 1,) [s] of the samples, the first of which starts the filter; h [s] of the filter, a sample every `every`-th
    step; known (T·every, HOLD, 2 n_known) [N] loads and, behind them,
    their interpolation errors (`hold_known_loads`); values (T, m) of the samples after the first [strain, m/s² or m], NaN where
    missing; channels (m,) rows of train.h5; labels (m,); std (m,) of a sample, NaN where that of the config holds; bias (m,)
    σ of an unknown offset, 0 for none; notes: sentences; record: what the config states of it."""

    time: np.ndarray
    h: float
    every: int
    known: np.ndarray
    values: np.ndarray
    channels: np.ndarray
    labels: tuple[str, ...]
    std: np.ndarray
    bias: np.ndarray
    notes: tuple[str, ...]
    record: RecordSettings

    @property
    def step(self) -> float:
        """Between samples [s]."""
        return self.h * self.every

    def of_channels(self, which: np.ndarray) -> Measured:
        """Some of the channels (k,)."""
        labels = tuple(self.labels[i] for i in which)
        part = {name: getattr(self, name)[which] for name in ("channels", "std", "bias")}
        return replace(self, values=self.values[:, which], labels=labels, **part)

    def first(self, count: int) -> Measured:
        """The first samples."""
        return replace(
            self, time=self.time[: count + 1], known=self.known[: count * self.every], values=self.values[:count]
        )


def measured_of(
    record: RecordSettings, path: Path, problem: Problem, gauges: Mapping[str, int], units: Mapping[str, str]
) -> Measured:
    """Read and calibrate the channels that `estimate` of a config names for a record.

    gauges: number of every gauge by its name (`bonded_gauges`); units of the loads.

    Raises ConfigError for a gauge that is not there, a channel of another quantity, a known load without a channel or with
    a gap, and UserError for what the file contradicts.
    """
    settings, entries, m = record.settings, record.settings.channels, len(record.settings.channels)
    channels = np.array([_channel(f"{record.channels}.{i}", entry, problem, gauges) for i, entry in enumerate(entries)])
    if len(np.unique(channels)) < m:
        raise ConfigError(
            "two channels are one grid of a gauge", key=record.channels, remedy="check `gauge` and `grid` of each"
        )
    _check_bridges(record.channels, entries, problem.channels.bridged[channels])
    wanted = wanted_of(record, problem.known, units)
    signals = signals_of(settings, record.key, path, wanted)
    sensors = [QUANTITY[int(problem.channels.quantity[c])] for c in channels]
    check_quantities(wanted, signals, sensors, problem.known, units)
    signals = common_part(signals, m, [entry.delay is not None for entry in list(wanted.values())[m:]], settings.start)
    loads, dt = signals.values[:, m:], float(signals.time[1] - signals.time[0])
    every = steps_a_sample(loads) if settings.time_step is None else round(dt / settings.time_step)
    if settings.time_step is not None and (every < 1 or abs(every * settings.time_step / dt - 1) > 1e-6):
        raise ConfigError(
            f"{settings.time_step:g} s is no whole part of the sampling interval, {dt:.9g} s",
            key="estimate.time_step",
            remedy=f"leave it out, or give {dt / max(every, 1):.9g} s",
        )
    known, notes = hold_known_loads(signals, loads, problem.known, record.inputs, every)
    return Measured(
        time=signals.time,
        h=dt / every,
        every=every,
        known=known,
        values=signals.values[1:, :m],
        channels=channels,
        labels=tuple(f"{entry.gauge}{f'.{entry.grid}' if entry.grid > 1 else ''}" for entry in entries),
        std=np.array([np.nan if entry.noise_std is None else entry.noise_std for entry in entries]),
        bias=np.array([entry.bias or 0.0 for entry in entries]),
        notes=(*signals.notes, *notes),
        record=record,
    )


def source_of(test: Measured, path: Path, known: tuple[str, ...]) -> TestSource:
    """The file of a record, and what was done to every channel of it; known: loads whose channels were used."""
    settings = test.record.settings
    entries: list[Channel] = [*settings.channels, *(settings.inputs[name] for name in known)]
    nothing = (np.nan, np.nan)
    return TestSource(
        file=path.name,
        sha256=sha256_of(path),
        bytes=path.stat().st_size,
        format=format_of(path) if settings.format == "auto" else settings.format,
        date=settings.date or "",
        channel=tuple(entry.channel for entry in entries),
        measures=(*test.labels, *known),
        unit=tuple(entry.unit for entry in entries),
        bridge=tuple("" if entry.bridge is None else entry.bridge.arrangement for entry in entries),
        gauge_factor=np.array([np.nan if e.bridge is None else e.bridge.gauge_factor for e in entries]),
        poisson_ratio=np.array([e.bridge.poisson_ratio if e.bridge else None for e in entries], dtype=float),
        delay=np.array([delay_in_seconds(entry.delay, test.step) for entry in entries]),
        zero=np.array([nothing if entry.zero is None else entry.zero for entry in entries], dtype=float).reshape(-1, 2),
        **{
            name: np.array([getattr(entry, name) for entry in entries]) for name in ("sign", "scale", "offset", "drift")
        },
    )


def settled_in(problem: Problem, test: Measured) -> Settled:
    """The periodic motion under the loads of a record, with the frequencies that the config gives them, and amplitudes and
    phases by least squares. Raises ConfigError where that cannot be, or is not what the record holds."""
    unknown, tones = problem.unknowns.inputs, tones_of(list(problem.run.signals.values()))
    duration, wrong = len(test.known) * test.h, ""
    slowest = np.zeros(0) if tones is None else tones.frequency[tones.frequency > 0]
    if problem.method != "bank":
        wrong = f"filter.method: {problem.method} cannot begin in a settled motion"
    elif unknown:
        wrong = f"a motion under an unknown load, {unknown[0]}, cannot be known to have settled"
    elif tones is None:
        wrong = "a load of the config is no sum of sines, and has no settled motion"
    elif len(slowest) and duration * slowest[0] < 2 * np.pi:
        wrong = f"the record, {duration:g} s, is shorter than a period of its loads, {2 * np.pi / slowest[0]:g} s"
    else:
        held, missed = tones_in(test.known, test.h, tones.frequency)
        for name, share in zip(problem.known, missed, strict=False):
            if share > MISSED:
                wrong = (
                    f"{100 * share:.0f} % of the record of '{name}' is not of the frequencies that the config states"
                )
                break
        else:
            return settled_at(problem, tones.frequency, held)
    raise ConfigError(wrong, key="estimate.start", remedy="take moving, or rest where the structure stood still")


def _channel(key: str, entry: GaugeChannel, problem: Problem, gauges: Mapping[str, int]) -> int:
    """The row of train.h5 that a channel of the file measures."""
    grids = problem.channels.of(np.array([gauges[str(entry.gauge)]]))[0]
    grids = grids[grids >= 0]
    if entry.grid > len(grids):
        raise ConfigError(
            f"grid {entry.grid} of a gauge that has {len(grids)}", key=f"{key}.grid", remedy=f"give 1 to {len(grids)}"
        )
    return int(grids[entry.grid - 1])


def _check_bridges(key: str, entries: Sequence[GaugeChannel], bridged: np.ndarray) -> None:
    """Raises ConfigError where the bridge formula of a channel is not that of its gauge."""
    for i, (entry, several) in enumerate(zip(entries, bridged, strict=True)):
        if entry.bridge is None or (entry.bridge.arrangement == SUM) == several:
            continue
        what, remedy = "one gauge", "take quarter, or how its bridge is completed"
        if several:
            what = "a bridge, which reads the sum of its arms"
            remedy = f"take {SUM}: of any other arrangement ε is that of one arm"
        raise ConfigError(
            f"the arrangement '{entry.bridge.arrangement}' of {entry.gauge}, which is {what}",
            key=f"{key}.{i}.bridge.arrangement",
            remedy=remedy,
        )


def wanted_of(record: RecordSettings, known: Sequence[str], units: Mapping[str, str]) -> dict[str, Channel]:
    """Key → channel of the gauges, then of the known loads. Raises ConfigError for one of these that has none."""
    inputs = record.settings.inputs
    for name in known:
        if name not in inputs:
            raise ConfigError(
                f"the known load '{name}' has no channel",
                key=record.inputs,
                remedy=f"give inputs: {{{name}: {{channel: …, unit: {units[name]}}}}}, or set loads.{name}.known: false and "
                "estimate it",
            )
    wanted: dict[str, Channel] = {f"{record.channels}.{i}": entry for i, entry in enumerate(record.settings.channels)}
    return wanted | {f"{record.inputs}.{name}": inputs[name] for name in known}


def check_quantities(
    wanted: Mapping[str, Channel],
    signals: Signals,
    sensors: Sequence[str],
    known: Sequence[str],
    units: Mapping[str, str],
) -> None:
    """sensors: what the channels of gauges are to be. Raises ConfigError for another quantity, and for a strain that no metal
    has, or no amplifier shows: its unit is another one."""
    of_unit = {unit: quantity for quantity, unit in SI.items()}
    expected = [*sensors, *(of_unit[units[name]] for name in known)]
    columns = zip(wanted.items(), signals.quantities, expected, signals.values.T, strict=True)
    for (key, entry), quantity, should, values in columns:
        if quantity != should:
            raise ConfigError(
                f"the channel is in {entry.unit}, {quantity}, but it is to be a {should}",
                key=f"{key}.unit",
                remedy="check the unit, and which gauge or load the channel is",
            )
        if quantity == "strain":
            _check_strain(key, entry, signals.time, values)


def _check_strain(key: str, entry: Channel, time: np.ndarray, values: np.ndarray) -> None:
    largest, beyond = float(np.nanmax(np.abs(values), initial=0.0)), np.flatnonzero(np.abs(values) > LARGEST_STRAIN)
    what = f"{entry.channel} reads up to {largest:.3g} m/m, which is {100 * largest:.0f} %"
    if 0 < len(beyond) <= FEW * np.isfinite(values).sum():
        times = ", ".join(f"{t:.9g}" for t in time[beyond[:10]])
        raise ConfigError(
            f"{what}, in {len(beyond)} of {len(time)} samples: at {times} s{' …' * (len(beyond) > 10)}",
            key=f"{key}.missing",
            remedy="mark these samples as missing, [[from, to], …]",
        )
    if len(beyond):
        raise ConfigError(
            what,
            key=f"{key}.unit",
            remedy=f"check the unit, {entry.unit}: are the readings in um/m? Or subtract what the amplifier shows without "
            "load, with `zero` or `offset`",
        )
    if 0 < largest < LEAST_STRAIN and not entry.override:
        raise ConfigError(
            f"{entry.channel} reads at most {largest:.3g} m/m, and no amplifier shows less than {1e6 * LEAST_STRAIN:g} um/m",
            key=f"{key}.unit",
            remedy=f"check the unit, {entry.unit}: are the readings in m/m (strain)? `override: true` where not",
        )


def common_part(signals: Signals, first: int, moved: Sequence[bool], start: str) -> Signals:
    """The record from the first to the last instant at which all known loads, its columns from `first` on, have a sample, where
    they lack a few at its ends, as in a table of two rates, or were moved in time. start: of the config.

    Raises ConfigError where a structure at rest does not begin so.
    """
    count, begin, end = len(signals.time), 0, len(signals.time)
    for values, delayed in zip(signals.values[:, first:].T, moved, strict=True):
        known = np.flatnonzero(np.isfinite(values))
        if len(known) < 2:
            return signals
        if delayed or max(known[0], count - 1 - known[-1]) <= LONGEST_GAP:
            begin, end = max(begin, int(known[0])), min(end, int(known[-1]) + 1)
    if end - begin in (count, 0, 1):
        return signals
    if start == "rest" and begin:
        raise ConfigError(
            f"the first {signals.time[begin] - signals.time[0]:g} s are cut off, where a known load has no sample, and what is "
            "left does not begin at rest",
            key="estimate.start",
            remedy="take moving",
        )
    note = f"{count - (end - begin)} samples were cut off at the ends, where a known load has none"
    return replace(
        signals, time=signals.time[begin:end], values=signals.values[begin:end], notes=(*signals.notes, note)
    )


def steps_a_sample(loads: np.ndarray) -> int:
    """Steps of the filter that hold loads (T + 1, n), NaN where missing, well enough: 1 to FINEST a sample."""
    filled = [fill_gaps(load) for load in loads.T]
    enough = (k for k in range(1, FINEST) if all(share_above(load, k * HELD) <= SLIGHT for load in filled))
    return next(enough, FINEST)


def hold_known_loads(
    signals: Signals, loads: np.ndarray, known: Sequence[str], key: str, every: int
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Hold coefficients (T·every, HOLD, 2n) of n loads (T + 1, n), NaN where missing, with those of their interpolation errors
    behind them; and what was done, a sentence each.

    Between samples a load is the spline through them. Its error is unknown; as large as the difference of that spline from
    straight lines, and of its shape, it is a constant that the filter considers (`tolerated_loads.BETWEEN`).

    Raises ConfigError, below `key`, where a load has a long gap, or moves too fast for its samples.
    """
    curves, lines, notes = [], [], []
    for name, values in zip(known, loads.T, strict=True):
        filled = fill_gaps(values) if (spacing := _spacing(signals, name, values, f"{key}.{name}")) > 1 else values
        rate = 1 / (spacing * (signals.time[1] - signals.time[0]))
        missing = int(np.isnan(values).sum())
        if missing:
            notes.append(f"{name}: {missing} missing samples were interpolated, by a spline through the others")
        share = share_above(filled, BAND / spacing)
        fast = (
            f"{100 * share:.2g} % of the RMS of '{name}' is beyond {BAND * rate:.4g} Hz, {BAND:g} of its sampling rate"
        )
        if share > LARGEST:
            raise ConfigError(
                f"{fast}: its samples do not determine it in between",
                key=f"{key}.{name}",
                remedy="record it at a higher rate, behind a filter that takes away what is faster, or estimate this load",
            )
        if share > SLIGHT:
            notes.append(f"{fast}: record it at a higher rate, the estimate depends on what is between its samples")
        curves.append(interpolate(filled, 2 * every))
        lines.append(join_by_lines(values, 2 * every))
    size = 2 * every * (len(loads) - 1) + 1
    curve, line = (np.column_stack(one) if one else np.zeros((size, 0)) for one in (curves, lines))
    return quadratic_hold(np.hstack([curve, line - curve])), tuple(notes)


def _spacing(signals: Signals, name: str, values: np.ndarray, key: str) -> int:
    """The longest interval between samples of a load (T + 1,), in samples of the record. Raises ConfigError for one that is too
    long."""
    known = np.flatnonzero(np.isfinite(values))
    apart = np.diff(known)
    at_ends = not len(known) or known[0] > 0 or known[-1] < len(values) - 1
    if at_ends or not len(apart) or apart.max() - 1 > max(LONGEST_GAP, 2 * (np.median(apart) - 1)):
        longest = int(np.argmax(apart)) if len(apart) else 0
        where = "at an end of the record"
        if not at_ends:
            where = f"{apart[longest] - 1} in a row, the first at {signals.time[known[longest] + 1]:g} s"
        raise ConfigError(
            f"the known load '{name}' lacks {np.isnan(values).sum()} samples, {where}",
            key=key,
            remedy="cut the record, or estimate this load",
        )
    return int(apart.max())
