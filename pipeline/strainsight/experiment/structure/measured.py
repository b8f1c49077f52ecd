"""Read and check the measurements of a test, and resample known loads for the filter."""

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
    """Settings of one record.

    name: empty if the test is one file; label: for messages, empty if there is one record; settings: as for a test of this file
    only; key: of the section with the file; section: of corrections for this record; channels, inputs: keys of the channels."""

    name: str
    label: str
    settings: Estimate
    key: str
    section: str
    channels: str
    inputs: str

    @property
    def file(self) -> str:
        """Config key of the file."""
        return f"{self.key}.file"


def records_of(settings: Estimate) -> tuple[RecordSettings, ...]:
    """Records of `estimate.file` or `estimate.records`, empty without either; unset keys have the common values."""
    if settings.file is not None:
        return (RecordSettings("", "", settings, "estimate", "estimate", "estimate.channels", "estimate.inputs"),)
    records, several = [], len(settings.records) > 1
    for i, entry in enumerate(settings.records):
        key = f"estimate.records.{i}"
        overrides = {name: value for name in STATED if (value := getattr(entry, name)) is not None}
        # with one record, corrections belong to the common section
        section = key if several or "channels" in overrides else "estimate"
        channels, inputs = (f"{key if name in overrides else 'estimate'}.{name}" for name in ("channels", "inputs"))
        alone = settings.model_copy(update={**overrides, "records": ()})
        records.append(RecordSettings(entry.name, entry.name * several, alone, key, section, channels, inputs))
    return tuple(records)


@contextmanager
def in_record(name: str) -> Iterator[None]:
    """Add the record name to an error, unless empty."""
    try:
        yield
    except StrainsightError as error:
        if name:
            error.what = f"record '{name}': {error.what}"
        raise


MISSED = 0.05
"""Largest relative RMS residual of a load from its sines for a periodic motion."""
LARGEST_STRAIN = 0.1
"""Largest plausible strain [m/m]; foil gauges end at a few per cent."""
FEW = 0.01
"""Largest share of implausible samples that counts as spikes rather than a wrong unit."""
LEAST_STRAIN = 1e-8
"""Smallest plausible strain [m/m], a tenth of an amplifier's resolution."""
STATED = ("file", "date", "format", "text", "time", "channels", "inputs")
"""Keys that a record may override."""
QUANTITY = ("strain", "acceleration", "displacement")
LONGEST_GAP = 10
"""Longest gap of a known load in samples, or twice the usual gap in a table of two rates."""
BAND = 0.3
"""Fraction of the sampling rate up to which a load can be interpolated to 2e-3."""
HOLD_BAND, FINEST = 0.1, 3
"""Fraction of the filter rate up to which the hold polynomial is accurate to 2e-3, and most filter steps per sample."""
SLIGHT, LARGEST = 0.05, 0.25
"""Relative RMS of a load above BAND or HOLD_BAND from which it is noted, and refused."""


@dataclass(frozen=True)
class Measured:
    """Measurements of one record.

    time (T + 1,) [s] of the samples, the first starts the filter; h [s]: filter step; every: steps per sample; known
    (T·every, HOLD, 2 n_known) [N]: loads and their interpolation errors (`hold_known_loads`); values (T, m): samples after the
    first [strain, m/s² or m], NaN if missing; channels (m,): rows of train.h5; std (m,): noise of a sample, NaN for the default;
    bias (m,): σ of an unknown offset, 0 for none; notes: sentences; record: settings."""

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
        """Sampling interval [s]."""
        return self.h * self.every

    def of_channels(self, which: np.ndarray) -> Measured:
        """Select channels (k,)."""
        labels = tuple(self.labels[i] for i in which)
        part = {name: getattr(self, name)[which] for name in ("channels", "std", "bias")}
        return replace(self, values=self.values[:, which], labels=labels, **part)

    def first(self, count: int) -> Measured:
        """Select the first `count` samples."""
        return replace(
            self, time=self.time[: count + 1], known=self.known[: count * self.every], values=self.values[:count]
        )


def measured_of(
    record: RecordSettings, path: Path, problem: Problem, gauges: Mapping[str, int], units: Mapping[str, str]
) -> Measured:
    """Read and calibrate the channels of a record.

    gauges: number of every gauge by name (`bonded_gauges`); units: of the loads. Raises ConfigError for a channel of another
    quantity and a known load without a channel or with a gap, and UserError for a file that does not match the config."""
    settings, entries, m = record.settings, record.settings.channels, len(record.settings.channels)
    channels = np.array([_channel(f"{record.channels}.{i}", entry, problem, gauges) for i, entry in enumerate(entries)])
    if len(np.unique(channels)) < m:
        raise ConfigError(
            "two channels refer to the same measuring grid of a gauge",
            key=record.channels,
            remedy="Check `gauge` and `grid` of each channel.",
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
            f"the time step of {settings.time_step:g} s does not divide the sampling interval of {dt:.9g} s",
            key="estimate.time_step",
            remedy=f"Remove the key, or set it to {dt / max(every, 1):.9g} s.",
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
    """File of a record and the calibration of every channel; known: loads with channels."""
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
    """Periodic motion under the loads of a record: configured frequencies, amplitudes and phases by least squares. Raises
    ConfigError if the record does not allow it."""
    unknown, tones = problem.unknowns.inputs, tones_of(list(problem.run.signals.values()))
    duration, wrong = len(test.known) * test.h, ""
    slowest = np.zeros(0) if tones is None else tones.frequency[tones.frequency > 0]
    if problem.method != "grid":
        wrong = f"a periodic initial motion (settled) is not available with filter.method: {problem.method}"
    elif unknown:
        wrong = f"a periodic initial motion (settled) is not available with an unknown load ({unknown[0]})"
    elif tones is None:
        wrong = "a periodic initial motion (settled) requires configured loads that are sums of sines"
    elif len(slowest) and duration * slowest[0] < 2 * np.pi:
        wrong = f"the record ({duration:g} s) is shorter than a period of its loads ({2 * np.pi / slowest[0]:g} s)"
    else:
        amplitude, missed = tones_in(test.known, test.h, tones.frequency)
        for name, share in zip(problem.known, missed, strict=False):
            if share > MISSED:
                wrong = f"{100 * share:.0f} % of the recorded load '{name}' is outside the configured frequencies"
                break
        else:
            return settled_at(problem, tones.frequency, amplitude)
    raise ConfigError(
        wrong,
        key="estimate.start",
        remedy="Set estimate.start: moving, or estimate.start: rest if the structure was at rest.",
    )


def _channel(key: str, entry: GaugeChannel, problem: Problem, gauges: Mapping[str, int]) -> int:
    """Row of train.h5 of a channel of the file."""
    grids = problem.channels.of(np.array([gauges[str(entry.gauge)]]))[0]
    grids = grids[grids >= 0]
    if entry.grid > len(grids):
        raise ConfigError(
            f"the gauge has no measuring grid {entry.grid} (number of measuring grids: {len(grids)})",
            key=f"{key}.grid",
            remedy=f"Set a grid number of at most {len(grids)}.",
        )
    return int(grids[entry.grid - 1])


def _check_bridges(key: str, entries: Sequence[GaugeChannel], bridged: np.ndarray) -> None:
    """Raises ConfigError if the bridge arrangement of a channel does not match its gauge."""
    for i, (entry, several) in enumerate(zip(entries, bridged, strict=True)):
        if entry.bridge is None or (entry.bridge.arrangement == SUM) == several:
            continue
        what, remedy = "a single gauge", "Set quarter, or the arrangement of the half or full bridge of this gauge."
        if several:
            what = "a bridge that reads the sum of its arms"
            remedy = f"Set {SUM}; other arrangements return the strain of one arm."
        raise ConfigError(
            f"the arrangement '{entry.bridge.arrangement}' does not match {entry.gauge}, {what}",
            key=f"{key}.{i}.bridge.arrangement",
            remedy=remedy,
        )


def wanted_of(record: RecordSettings, known: Sequence[str], units: Mapping[str, str]) -> dict[str, Channel]:
    """Key → channel of the gauges, then of the known loads. Raises ConfigError for a known load without a channel."""
    inputs = record.settings.inputs
    for name in known:
        if name not in inputs:
            raise ConfigError(
                f"the known load '{name}' has no channel",
                key=record.inputs,
                remedy=f"Set {record.inputs}: {{{name}: {{channel: …, unit: {units[name]}}}}}, or set loads.{name}.known: false "
                "to estimate the load.",
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
    """Raises ConfigError for a channel of another quantity, and for implausible strain (wrong unit); sensors: expected quantities
    of the gauge channels."""
    of_unit = {unit: quantity for quantity, unit in SI.items()}
    expected = [*sensors, *(of_unit[units[name]] for name in known)]
    columns = zip(wanted.items(), signals.quantities, expected, signals.values.T, strict=True)
    for (key, entry), quantity, should, values in columns:
        if quantity != should:
            raise ConfigError(
                f"the channel has the unit {entry.unit} ({quantity}), expected {should}",
                key=f"{key}.unit",
                remedy="Check the unit and the assigned gauge or load.",
            )
        if quantity == "strain":
            _check_strain(key, entry, signals.time, values)


def _check_strain(key: str, entry: Channel, time: np.ndarray, values: np.ndarray) -> None:
    largest, implausible = (
        float(np.nanmax(np.abs(values), initial=0.0)),
        np.flatnonzero(np.abs(values) > LARGEST_STRAIN),
    )
    what = f"the strain of {entry.channel} reaches {largest:.3g} m/m ({100 * largest:.0f} %)"
    if 0 < len(implausible) <= FEW * np.isfinite(values).sum():
        times = ", ".join(f"{t:.9g}" for t in time[implausible[:10]])
        raise ConfigError(
            f"{what}, in {len(implausible)} of {len(time)} samples: at {times} s{' …' * (len(implausible) > 10)}",
            key=f"{key}.missing",
            remedy="Set the intervals of these samples as missing: [[from, to], …] [s].",
        )
    if len(implausible):
        raise ConfigError(
            what,
            key=f"{key}.unit",
            remedy=f"Check the unit ({entry.unit}), which may be um/m, or subtract the reading without load by {key}.zero or "
            f"{key}.offset.",
        )
    if 0 < largest < LEAST_STRAIN and not entry.override:
        raise ConfigError(
            f"the largest strain of {entry.channel} is {largest:.3g} m/m, below the amplifier resolution of "
            f"{1e6 * LEAST_STRAIN:g} um/m",
            key=f"{key}.unit",
            remedy=f"Check the unit ({entry.unit}), which may be m/m (strain), or set {key}.override: true.",
        )


def common_part(signals: Signals, first: int, moved: Sequence[bool], start: str) -> Signals:
    """Cut a record to the interval in which all known loads (columns from `first`) have samples; start: of the config.

    Raises ConfigError if a structure that starts at rest would not do so."""
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
            f"a known load has no samples in the first {signals.time[begin] - signals.time[0]:g} s, so the record would "
            "not start at rest",
            key="estimate.start",
            remedy="Set estimate.start: moving.",
        )
    note = (
        f"samples at the ends of the record that were removed because a known load is missing: {count - (end - begin)}"
    )
    return replace(
        signals, time=signals.time[begin:end], values=signals.values[begin:end], notes=(*signals.notes, note)
    )


def steps_a_sample(loads: np.ndarray) -> int:
    """Filter steps per sample, 1 to FINEST, that resolve loads (T + 1, n) with NaN for missing samples."""
    filled = [fill_gaps(load) for load in loads.T]
    enough = (k for k in range(1, FINEST) if all(share_above(load, k * HOLD_BAND) <= SLIGHT for load in filled))
    return next(enough, FINEST)


def hold_known_loads(
    signals: Signals, loads: np.ndarray, known: Sequence[str], key: str, every: int
) -> tuple[np.ndarray, tuple[str, ...]]:
    """Hold coefficients (T·every, HOLD, 2n) of n loads (T + 1, n) and of their interpolation errors, and notes.

    Loads are interpolated by a spline. The interpolation error has the shape of the difference between spline and straight lines,
    with a constant factor that the filter considers (`tolerated_loads.BETWEEN`). NaN marks missing samples. Raises ConfigError,
    below `key`, for a long gap or a load too fast for its samples."""
    curves, lines, notes = [], [], []
    for name, values in zip(known, loads.T, strict=True):
        filled = fill_gaps(values) if (spacing := _spacing(signals, name, values, f"{key}.{name}")) > 1 else values
        rate = 1 / (spacing * (signals.time[1] - signals.time[0]))
        missing = int(np.isnan(values).sum())
        if missing:
            notes.append(f"missing samples of the load {name} were interpolated by a spline ({missing} in total)")
        share = share_above(filled, BAND / spacing)
        fast = (
            f"{100 * share:.2g} % of the RMS of the load '{name}' is due to frequencies above {BAND * rate:.4g} Hz "
            f"({BAND:g} times its sampling rate)"
        )
        if share > LARGEST:
            raise ConfigError(
                f"{fast}, so this load cannot be interpolated between samples",
                key=f"{key}.{name}",
                remedy=f"Record the load at a higher rate with an anti-aliasing filter, or set loads.{name}.known: false.",
            )
        if share > SLIGHT:
            notes.append(f"{fast}, which affects the estimate. Record the load at a higher rate")
        curves.append(interpolate(filled, 2 * every))
        lines.append(join_by_lines(values, 2 * every))
    size = 2 * every * (len(loads) - 1) + 1
    curve, line = (np.column_stack(one) if one else np.zeros((size, 0)) for one in (curves, lines))
    return quadratic_hold(np.hstack([curve, line - curve])), tuple(notes)


def _spacing(signals: Signals, name: str, values: np.ndarray, key: str) -> int:
    """Longest interval between samples of a load (T + 1,), in samples of the record. Raises ConfigError if it is too long."""
    known = np.flatnonzero(np.isfinite(values))
    spacing = np.diff(known)
    at_ends = not len(known) or known[0] > 0 or known[-1] < len(values) - 1
    if at_ends or not len(spacing) or spacing.max() - 1 > max(LONGEST_GAP, 2 * (np.median(spacing) - 1)):
        longest = int(np.argmax(spacing)) if len(spacing) else 0
        where = "at an end of the record"
        if not at_ends:
            where = f"{spacing[longest] - 1} in a row, the first at {signals.time[known[longest] + 1]:g} s"
        raise ConfigError(
            f"the known load '{name}' has missing samples: {np.isnan(values).sum()} in total, {where}",
            key=key,
            remedy=f"Delete the lines before or after the missing samples from the file, or set loads.{name}.known: false to "
            "estimate the load.",
        )
    return int(spacing.max())
