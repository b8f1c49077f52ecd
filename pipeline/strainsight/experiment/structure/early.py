"""Checks of input files before the first stage: load histories, and channels and gauges of a test."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from strainsight.config.gauges import AbsoluteNoise
from strainsight.config.loads import CaseLoad, MultiSineSection, RecordedSection, SineSection, SweepSection
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, blame
from strainsight.estimation.faults import at_limit
from strainsight.experiment.recorded import QUANTITY, recorded, signals_of
from strainsight.loads.histories import TIME_SLACK
from strainsight.measurements.assemble import Signals

LARGEST = 50_000_000
"""Largest record [bytes] that is read before the first stage."""
STILL = 0.1
"""Share of unchanged samples between the limits from which a channel is stepped rather than clipped."""


def check_files(config: PlacementConfig, base: Path) -> None:
    """Check the files of a config; base: folder for relative paths.

    Raises UserError, with key and file, for a load history that is missing, unreadable or too short, for a channel of an unknown
    gauge, and for a record without a channel or with another unit."""
    for key, unit, signal, runs in _histories(config):
        path = _existing(f"{key}.file", signal.file, base)
        time = recorded(key, signal, path, (QUANTITY[unit],)).time
        first, last = float(time[0]), float(time[-1])
        slack = TIME_SLACK * (last - first)
        for duration, of in runs.items():
            if first > slack or last < of - slack:
                raise ConfigError(
                    f"{signal.file} covers {first:g} to {last:g} s, but {duration} requires 0 to {of:g} s",
                    key=f"{key}.file",
                    remedy=f"Shift the record to begin at 0 s and set {duration} to at most {last:g} s, or use a longer record.",
                )
    if config.estimate is not None and config.place is not None:
        _check_gauges(config, base)
        _check_records(config, base)


def _existing(key: str, file: str, base: Path) -> Path:
    path = base / file
    if not path.is_file():
        raise ConfigError(f"file not found: {path}", key=key, remedy="Paths are relative to the config file.")
    return path


def _histories(config: PlacementConfig) -> Iterator[tuple[str, str, RecordedSection, dict[str, float]]]:
    """Key, load unit, signal and required durations (key → [s]) of every recorded signal."""
    sections = {"train.duration": config.train, "validate.duration": config.validation}
    as_stated = {key: section.duration for key, section in sections.items() if section is not None}
    for name, load in config.loads.items():
        if isinstance(load.signal, RecordedSection):
            yield f"loads.{name}.signal", load.unit, load.signal, as_stated
    for case, settings in ((config.place and config.place.load_cases) or {}).items():
        section = f"place.load_cases.{case}"
        of, duration = f"{section}.duration", settings.duration
        if duration is None:
            of, duration = "train.duration", config.train.duration
        for name, entry in settings.loads.items():
            if isinstance(entry, CaseLoad) and isinstance(entry.signal, RecordedSection):
                yield f"{section}.loads.{name}.signal", config.loads[name].unit, entry.signal, {of: duration}


def _check_gauges(config: PlacementConfig, base: Path) -> None:
    """Check the gauge names of the channels: bonded gauges, G1 … of the layout, or numbers of imported gauges. A missing
    `estimate.gauges_file` is accepted, as it may be written after the layout."""
    from strainsight.experiment.structure.bonded_gauges import KEY, given_table, placed_channels, read_bonded

    settings, gauges, keep = config.estimate, config.gauges, config.place.keep
    assert settings is not None
    named, labels, places = [str(entry.name) for entry in gauges.fixed if entry.name], list[str](), None
    if gauges.strain_operator is not None:
        table = _existing("gauges.strain_operator.table", gauges.strain_operator.table, base)
        with blame("gauges.strain_operator"):
            named = [str(number) for number in given_table(table)[0]]
    else:
        if gauges.fixed_file is not None:
            with blame("gauges.fixed_file"):
                named += read_bonded(_existing("gauges.fixed_file", gauges.fixed_file, base))
        labels = [f"G{i}" for i in range(1, keep + len(named) + 1) if f"G{i}" not in named][: keep - len(named)]
        if settings.gauges_file is not None and (base / settings.gauges_file).is_file():
            with blame(KEY):
                places = read_bonded(base / settings.gauges_file)
    list(placed_channels(settings, named, labels, places))


def _check_records(config: PlacementConfig, base: Path) -> None:
    """Check channels and units of every existing record; quantities only without motion sensors."""
    from strainsight.experiment.structure.measured import check_quantities, in_record, records_of, wanted_of

    settings, gauges = config.estimate, config.gauges
    assert settings is not None
    known = [name for name, load in config.loads.items() if load.known]
    units = {name: load.unit for name, load in config.loads.items()}
    noise_std = gauges.noise_std.value if isinstance(gauges.noise_std, AbsoluteNoise) else None
    for record in records_of(settings):
        path, channels = base / str(record.settings.file), record.settings.channels
        if not path.is_file() or path.stat().st_size > LARGEST:
            continue
        with in_record(record.name):
            wanted = wanted_of(record, known, units)
            signals = signals_of(record.settings, record.key, path, wanted)
            noise = [entry.noise_std or (None if config.motion_sensors else noise_std) for entry in channels]
            for text in odd_channels(config, signals, list(wanted), noise):
                warnings.warn(f"{text}.", stacklevel=2)
            if not config.motion_sensors and gauges.strain_operator is None:
                check_quantities(wanted, signals, ["strain"] * len(channels), known, units)


def odd_channels(
    config: PlacementConfig, signals: Signals, keys: Sequence[str], noise: Sequence[float | None] = ()
) -> tuple[str, ...]:
    """Warnings on channels (c,) of a record: constant, clipped, below their noise [unit of the reading], or sampled too slowly
    for the configured loads."""
    words = []
    gauges = len(keys) - sum(".inputs." in key for key in keys)
    for i, (name, key) in enumerate(zip(signals.names, keys, strict=True)):
        values = signals.values[:, i]
        known, std = values[np.isfinite(values)], noise[i] if i < len(noise) else None
        if i < gauges and len(known) > 1 and known.min() == known.max():
            words.append(
                f"{name} is constant in all {len(known)} samples: the gauge is broken or not connected ({key})"
            )
        elif i < gauges and (count := int(at_limit(values).sum())) and not _in_steps(known):
            words.append(
                f"{name} is clipped, because {count} of {len(values)} samples repeat its largest or smallest value, probably the "
                f"limit of the amplifier ({key})"
            )
        if std and len(known) and std > (largest := float(np.abs(known).max())):
            words.append(
                f"the noise of {name}, {std:.3g}, exceeds its largest reading, {largest:.3g} ({key}.noise_std)"
            )
    step = float(signals.time[1] - signals.time[0])
    for name, load in config.loads.items():
        fastest = _fastest(load.signal)
        if fastest >= 0.5 / step:
            words.append(
                f"the Nyquist frequency of the record is {0.5 / step:.4g} Hz (sampling interval {step:.4g} s), but loads.{name} "
                f"has frequencies up to {fastest:.4g} Hz. Increase the sampling rate, or check estimate.time.unit"
            )
    return tuple(words)


def _in_steps(known: np.ndarray) -> bool:
    """Whether a channel is constant over intervals away from its limits: a stepped test, or coarse resolution."""
    inside = (known[1:] > known.min()) & (known[1:] < known.max())
    return bool(inside.any()) and float(np.mean(np.diff(known)[inside] == 0)) > STILL


def _fastest(signal: object) -> float:
    """Highest frequency of a configured signal [Hz], 0 without one."""
    if isinstance(signal, SineSection):
        return signal.frequency
    if isinstance(signal, SweepSection):
        return max(signal.start_frequency, signal.end_frequency)
    return signal.highest if isinstance(signal, MultiSineSection) else 0.0
