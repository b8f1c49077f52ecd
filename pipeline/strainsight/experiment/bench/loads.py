"""Load histories of a bench, and motion of its driven joints."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.connections import Driven, DrivenDistance, GravitySection, Load
from strainsight.errors import ConfigError, blame
from strainsight.experiment.bench.bench import Bench
from strainsight.experiment.recorded import LOADS, signal_at
from strainsight.loads.histories import FromSamples, evaluate, gap, motion, swing
from strainsight.multibody.laws import SHORTEST, TurningGravity

LARGEST = 1e50
"""Largest load or displacement [N, N m, m, rad], with a finite fourth power."""
SPUN = 1.0
"""Largest driven rotation per step [rad]."""
SWING = 0.05
"""Largest overshoot of the spline, relative to the range of a drive's samples."""
GAP = 10.0
"""Longest gap between samples, relative to the median interval."""
MOTIONS = {
    (True, "position"): ("angle",),
    (True, "rate"): ("angular velocity",),
    (False, "position"): ("displacement",),
    (False, "rate"): ("velocity",),
}
"""Quantities allowed in the file of a drive, by whether it rotates and its kind of history."""


def load_units(config: BenchConfig, names: Iterable[str]) -> dict[str, str]:
    """Units of loads by name."""
    units = {"force": "N", "actuator": "N", "moment": "N m", "torque": "N m", "gravity": "rad"}
    return {name: units[config.forces[name].type] for name in names}


def loads_of(bench: Bench, files: Mapping[str, Path]) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function: time (k,) [s] → u (k, width), inputs [N, N m] in the order of the system, then p and ṗ of driven
    joints."""
    config, signals, keys = bench.config, {}, {}
    for name in bench.system.inputs:
        entry = config.forces[name]
        assert isinstance(entry, Load | GravitySection)
        history = entry.turns if isinstance(entry, GravitySection) else entry
        assert history is not None  # constant gravity is not an input
        turns = isinstance(entry, GravitySection)
        key = keys[name] = f"forces.{name}.{'turns.' * turns}signal"
        with blame(key):
            signals[name] = signal_at(key, history.signal, files, ("angle",) if turns else LOADS)
    drives = drives_of(bench, files)

    def at(time: np.ndarray) -> np.ndarray:
        columns = []
        for name, signal in signals.items():
            with blame(keys[name]):
                columns.append(evaluate(signal, time))
                _refuse_huge(columns[-1], "N, N m or rad")
        moved = drives(time)
        return (
            np.column_stack([*columns, *moved[:, 0], *moved[:, 1]])
            if bench.system.drives.width
            else np.zeros((len(time), 0))
        )

    return at


def drives_of(bench: Bench, files: Mapping[str, Path]) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function: time (k,) [s] → p, ṗ, p̈ of every driven joint (nd, 3, k) [m or rad]."""
    config, motions = bench.config, {}
    for name in bench.system.drives.names:
        entry = config.joints[name]
        assert isinstance(entry, Driven)
        key, drive = f"joints.{name}.drive.signal", entry.drive
        kinds = MOTIONS[entry.type == "driven_angle", drive.of]
        with blame(key):
            motions[name] = motion(signal_at(key, drive.signal, files, kinds), drive.of, drive.start)

    def at(time: np.ndarray) -> np.ndarray:
        moved = np.zeros((len(motions), 3, len(time)))
        for row, (name, history) in zip(moved, motions.items(), strict=True):
            with blame(f"joints.{name}.drive.signal"):
                row[:] = history(time)
                _refuse_huge(row[:2], "m or rad")
                if isinstance(config.joints[name], DrivenDistance) and not row[0].min(initial=np.inf) > SHORTEST:
                    first = time[np.argmin(row[0])]
                    raise ConfigError(
                        f"the drive sets a distance of {row[0].min():.4g} m between the frames at t = {first:.4g} s; the "
                        f"distance must exceed {SHORTEST:g} m",
                        remedy="Change the signal so that the distance is always positive.",
                    )
        return moved

    return at


def refuse_spun(bench: Bench, u: np.ndarray, section: str) -> None:
    """Raises ConfigError if a driven angle or the direction of gravity rotates by more than SPUN per step; u (T + 1, width);
    section: of the time step in the config."""
    drives = bench.system.drives
    turned = [
        (f"joints.{drives.names[k]}.drive", drives.at + int(k)) for k in np.unique(drives.which[drives.power == 0])
    ]
    laws = ((element.force, element.inputs) for element in bench.system.elements)
    turned += [
        (f"forces.{force.name}.turns", int(at[0])) for force, at in laws if isinstance(force.law, TurningGravity)
    ]
    recorded = {
        f"joints.{name}.drive"
        for name, joint in bench.config.joints.items()
        if isinstance(joint, Driven) and joint.drive.signal.type == "csv"
    }
    for key, column in turned:
        moved = np.abs(np.diff(u[:, column]))
        if moved.max(initial=0.0) > SPUN:
            smooth = ", or smooth a jump in the recorded signal" if key in recorded else ""
            raise ConfigError(
                f"the driven angle or the direction of gravity changes by {moved.max():.3g} rad in a time step; the limit is "
                f"{SPUN:g} rad",
                key=key,
                remedy=f"Reduce {section}.time_step{smooth}.",
            )


def doubtful_drives(config: BenchConfig, files: Mapping[str, Path]) -> list[str]:
    """Warnings about splines of drives from files that overshoot or bridge a gap."""
    doubts = []
    for name, entry in config.joints.items():
        if not isinstance(entry, Driven) or entry.drive.signal.type != "csv":
            continue
        kinds = MOTIONS[entry.type == "driven_angle", entry.drive.of]
        signal = signal_at(f"joints.{name}.drive.signal", entry.drive.signal, files, kinds)
        if not isinstance(signal, FromSamples):
            continue
        share, at = swing(signal)
        if share > SWING:
            doubts.append(
                f"the spline through the driven motion of joints.{name} overshoots the samples by {100 * share:.2g} % of their "
                f"range at {at:.4g} s, because of a jump or too few samples. Smooth the signal, or increase its sampling rate"
            )
        times, begin, end = gap(signal)
        if times > GAP:
            doubts.append(
                f"the driven motion of joints.{name} has no samples from {begin:.4g} to {end:.4g} s; a spline fills this gap"
            )
    return doubts


def _refuse_huge(values: np.ndarray, unit: str) -> None:
    largest = float(np.abs(values).max(initial=0.0))
    if not largest <= LARGEST:
        raise ConfigError(
            f"the signal reaches {largest:.2g} {unit}, which exceeds the limit of {LARGEST:g}",
            remedy="Check the unit of the signal.",
        )
