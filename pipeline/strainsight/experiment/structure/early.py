"""What the files of a config contradict, before anything runs: load histories, and channels and gauges of a test."""

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
"""[bytes] of a record that is read before the first stage; a larger one takes seconds, and the estimate reads it in any case."""
STILL = 0.1
"""Share of samples between the limits that are as the one before: amplifiers that are clipped have none."""


def check_files(config: PlacementConfig, base: Path) -> None:
    """base: the folder that paths start from.

    Raises UserError, with key and file: for a history that is missing, cannot be read or ends before the run; for a channel of a
    gauge that no layout can have, and a record that lacks a channel or has it in another unit.
    """
    for key, unit, signal, runs in _histories(config):
        path = _existing(f"{key}.file", signal.file, base)
        time = recorded(key, signal, path, (QUANTITY[unit],)).time
        first, last = float(time[0]), float(time[-1])
        slack = TIME_SLACK * (last - first)
        for duration, of in runs.items():
            if first > slack or last < of - slack:
                raise ConfigError(
                    f"{signal.file} covers {first:g} to {last:g} s, {duration} asks for 0 to {of:g} s",
                    key=f"{key}.file",
                    remedy=f"a record begins at 0: shift its time; give {duration} at most {last:g} s, or record longer",
                )
    if config.estimate is not None:
        _check_gauges(config, base)
        _check_records(config, base)


def _existing(key: str, file: str, base: Path) -> Path:
    path = base / file
    if not path.is_file():
        raise ConfigError(f"no such file: {path}", key=key, remedy="paths start from the folder of the config file")
    return path


def _histories(config: PlacementConfig) -> Iterator[tuple[str, str, RecordedSection, dict[str, float]]]:
    """Key of every recorded signal, the unit of its load, the signal, and the runs that it has to cover: key of the duration →
    [s]."""
    as_stated = {"train.duration": config.train.duration, "validate.duration": config.validation.duration}
    for name, load in config.loads.items():
        if isinstance(load.signal, RecordedSection):
            yield f"loads.{name}.signal", load.unit, load.signal, as_stated
    for case, stated in (config.place.load_cases or {}).items():
        section = f"place.load_cases.{case}"
        of, duration = f"{section}.duration", stated.duration
        if duration is None:
            of, duration = "train.duration", config.train.duration
        for name, entry in stated.loads.items():
            if isinstance(entry, CaseLoad) and isinstance(entry.signal, RecordedSection):
                yield f"{section}.loads.{name}.signal", config.loads[name].unit, entry.signal, {of: duration}


def _check_gauges(config: PlacementConfig, base: Path) -> None:
    """Names of the channels among those of bonded gauges and the G1 … of as many as are kept; given gauges have the numbers of
    their table for names. A file that says where those of the layout were bonded comes after the layout: only `estimate` needs
    it."""
    from strainsight.experiment.structure.bonded_gauges import KEY, given_table, placed_channels, read_bonded

    settings, gauges, keep = config.estimate, config.gauges, config.place.keep
    assert settings is not None
    named, labels, places = [str(entry.name) for entry in gauges.fixed if entry.name], list[str](), None
    if gauges.given is not None:
        table = _existing("gauges.given.table", gauges.given.table, base)
        with blame("gauges.given"):
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
    """Channels and units of every record that is there; which sensor is which is known without motion sensors alone."""
    from strainsight.experiment.structure.measured import check_quantities, in_record, records_of, wanted_of

    settings, gauges = config.estimate, config.gauges
    assert settings is not None
    known = [name for name, load in config.loads.items() if load.known]
    units = {name: load.unit for name, load in config.loads.items()}
    stated = gauges.noise_std.value if isinstance(gauges.noise_std, AbsoluteNoise) else None
    for record in records_of(settings):
        path, channels = base / str(record.settings.file), record.settings.channels
        if not path.is_file() or path.stat().st_size > LARGEST:
            continue
        with in_record(record.name):
            wanted = wanted_of(record, known, units)
            signals = signals_of(record.settings, record.key, path, wanted)
            noise = [entry.noise_std or (None if config.motion_sensors else stated) for entry in channels]
            for text in odd_channels(config, signals, list(wanted), noise):
                warnings.warn(f"{text}.", stacklevel=2)
            if not config.motion_sensors and gauges.given is None:
                check_quantities(wanted, signals, ["strain"] * len(channels), known, units)


def odd_channels(
    config: PlacementConfig, signals: Signals, keys: Sequence[str], noise: Sequence[float | None] = ()
) -> tuple[str, ...]:
    """Of the channels (c,) of a record, by their keys in the config: gauges that read one value, or less than their noise [unit
    of the reading], channels that stand at a limit, and a clock that is too slow for the loads that the config states."""
    words = []
    gauges = len(keys) - sum(".inputs." in key for key in keys)
    for i, (name, key) in enumerate(zip(signals.names, keys, strict=True)):
        values = signals.values[:, i]
        known, std = values[np.isfinite(values)], noise[i] if i < len(noise) else None
        if i < gauges and len(known) > 1 and known.min() == known.max():
            words.append(
                f"{name} reads one value in all of its {len(known)} samples: it is not connected, or dead ({key})"
            )
        elif i < gauges and (count := int(at_limit(values).sum())) and not _in_steps(known):
            words.append(
                f"{name} is clipped: {count} of {len(values)} samples stand in rows at its largest or least value, where the "
                f"range of the amplifier may end ({key})"
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
                f"the record has a sample every {step:.4g} s and holds nothing above {0.5 / step:.4g} Hz, and loads.{name} is "
                f"stated with {fastest:.4g} Hz, which folds back: record faster, or check estimate.time.unit"
            )
    return tuple(words)


def _in_steps(known: np.ndarray) -> bool:
    """Whether a channel stands still elsewhere than at its largest and least value, too: a test in steps, or coarse digits."""
    inside = (known[1:] > known.min()) & (known[1:] < known.max())
    return bool(inside.any()) and float(np.mean(np.diff(known)[inside] == 0)) > STILL


def _fastest(signal: object) -> float:
    """The highest frequency of a stated signal [Hz], 0 where none is stated."""
    if isinstance(signal, SineSection):
        return signal.frequency
    if isinstance(signal, SweepSection):
        return max(signal.start_frequency, signal.end_frequency)
    return signal.highest if isinstance(signal, MultiSineSection) else 0.0
