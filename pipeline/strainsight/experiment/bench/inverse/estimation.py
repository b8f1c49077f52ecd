"""Loads and parameters of a bench from its sensors, by Kalman filters on the implicit step (thesis 2-4)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from strainsight.config.bench.bench import AccelerationSensor, BenchConfig, MotionSensor, RelativeSensor, Sensor
from strainsight.config.bench.estimate import FromFile
from strainsight.config.estimate import Channel
from strainsight.errors import ConfigError
from strainsight.experiment.bench.bench import Bench, bench_of
from strainsight.experiment.bench.inverse.balls import ring_watch, rings_estimated
from strainsight.experiment.bench.inverse.filtering import Filtered, SmoothedLoads, by_bank, by_extended
from strainsight.experiment.bench.inverse.hold_out import HeldOut, held_out, undistinguished, unfollowed
from strainsight.experiment.bench.inverse.installed import Observed, misread, observed, toleranced
from strainsight.experiment.bench.inverse.rest import free_zero, zero_of
from strainsight.experiment.bench.inverse.trial import Trial, trial_of
from strainsight.experiment.bench.inverse.truth import (
    Reality,
    drawn,
    from_run,
    like_those,
    measurements,
    reality_of,
    simulated,
)
from strainsight.experiment.bench.inverse.unknowns import Unknowns, asked, free_properties, has_bank, unknowns_of
from strainsight.experiment.bench.loads import drives_of, load_units, loads_of
from strainsight.experiment.bench.sensors import Sensors, sensors_of, some_of
from strainsight.experiment.bench.simulation import refuse_spun
from strainsight.experiment.recorded import signals_of
from strainsight.experiment.resources import Resources
from strainsight.mesh.model import Mesh
from strainsight.ordering import first_of_largest
from strainsight.records.bench import BenchPlaced, BenchTruths, ReducedBody, RingEstimate, Simulated
from strainsight.records.estimated import Compared

SECTION = "estimate.measured"
QUANTITY = {"position": "displacement", "velocity": "velocity"}
"""Of a motion; of the direction of an axis a ratio."""


@dataclass(frozen=True)
class Estimated:
    """What a filter made of a reality.

    measured (T, B, m); time (T + 1,) [s]; mean, std (T + 1, B, size) of x, then offsets, NaN in diverged runs;
    xi_covariance (T + 1, b, p, p);
    nis (T, B) over the number of channels; lost (B,): the step that lost each run, −1 for none; reading
    (T + 1, seeds, all channels) of every sensor at the estimate of a seed's first start; smoothed: loads of the first run by all
    samples, of an extended filter; elsewhere: loads of the other bench (T + 1,) by input; rings: what every bearing does, by the
    first run of an extended filter; compared: the parameters of the first run by bank and extended filter, where a bank has
    filtered; without: every channel by the others, where that was asked for; done: what was done to measurements from a file;
    notes: doubts. Sentences.
    """

    bench: Bench
    unknowns: Unknowns
    trial: Trial
    sensors: Sensors
    used: Sensors
    reality: Reality
    measured: np.ndarray
    time: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    xi_covariance: np.ndarray
    nis: np.ndarray
    lost: np.ndarray
    reading: np.ndarray
    smoothed: SmoothedLoads | None
    elsewhere: Mapping[str, np.ndarray]
    rings: dict[str, RingEstimate]
    compared: Compared | None
    without: HeldOut | None
    done: tuple[str, ...]
    notes: tuple[str, ...]


def estimated(
    config: BenchConfig,
    reduced: Mapping[str, ReducedBody],
    meshes: Mapping[str, Mesh],
    placed: BenchPlaced | None,
    there: Simulated | None,
    truths: BenchTruths | None,
    using: Resources,
) -> Estimated:
    """Simulate or take the measurements, run the filter on them; there: the other bench of `estimate.measured`; truths: by
    another integrator, where these stand for reality."""
    estimate = asked(config)
    bench = bench_of(config, reduced, meshes, free_properties(estimate))
    sensors = sensors_of(config, bench, reduced, meshes, placed)
    used = some_of(bench, sensors, list(estimate.sensors))
    errors = toleranced(config, reduced, meshes, placed, used)
    seen, eta = observed(bench, sensors, errors), dict[str, np.ndarray]()
    h = estimate.time_step or config.simulate.time_step
    steps = round((estimate.duration or config.simulate.duration) / h)
    time = h * np.arange(steps + 1)
    unknowns = unknowns_of(config, bench, h)
    loads = loads_of(config, bench, using.files)
    drives = drives_of(config, bench, using.files)
    known, second = loads(time), drives(time)[:, 2].T
    refuse_spun(config, bench, known, "estimate")
    zeroing = known[0].copy()
    heaviest = known[first_of_largest(np.linalg.norm(known / np.maximum(np.abs(known).max(axis=0), 1e-300), axis=1))]
    for column, name in zip(unknowns.inputs, estimate.inputs, strict=True):
        guess = estimate.inputs[name].guess
        known[:, column] = known[0, column] if guess is None else guess

    def progress_of(share: float) -> None:
        using.progress("truth", 0.3 * share)

    reality: Reality | None = None
    elsewhere: dict[str, np.ndarray] = {}
    first: np.ndarray | None = None
    done: tuple[str, ...] = ()
    if estimate.measured is not None:
        own = {name: (config.sensors[name], part.stop - part.start) for name, part in used.channels.items()}
        if isinstance(estimate.measured, FromFile):
            read, done = from_file(using.files["estimate.measured.file"], estimate.measured, own, h, steps)
        else:
            assert there is not None
            units = load_units(config, estimate.inputs)
            others = {
                name: (config.sensors[name], part.stop - part.start)
                for name, part in sensors.channels.items()
                if name not in own
            }
            beside = like_those(there, estimate.measured, others)
            read, elsewhere = from_run(there, estimate.measured, own | beside, units, h, steps)
        readings = np.full((steps, 1, len(sensors.zeroed)), np.nan)
        for name, values in read.items():
            readings[:, 0, sensors.channels[name]] = values[1:]
        first = np.concatenate([read[name][0] for name in used.channels])
        nowhere = np.full((steps + 1, 1, len(bench.system.inputs)), np.nan)
        reality = Reality(nowhere, np.full((1, len(bench.theta)), np.nan), readings)
    elif truths is not None:
        reality = reality_of(truths, bench, seen.readings, seen.zeroed, h, steps, estimate.runs)
        reality, eta = _apart(reality, seen)
    elif estimate.truth.model != "walk":
        substeps = estimate.truth.substeps if estimate.truth.model == "fine" else 1
        reality = simulated(
            bench, seen.readings, seen.zeroed, config.simulate, loads, drives, h, steps, substeps, progress_of
        )
        reality, eta = _apart(reality, seen)
    among = np.concatenate([np.arange(len(sensors.zeroed))[sensors.channels[name]] for name in used.channels])
    runs, starts = estimate.runs, len(unknowns.starts)
    largest = np.zeros(len(among))
    if reality is not None:
        largest = np.nan_to_num(np.abs(reality.readings[:, :, among])).max(axis=(0, 1))
    given = _given(config, used, placed)
    if reality is not None:
        given &= np.isfinite(reality.readings[:, :, among]).any(axis=(0, 1))

    def trial_with(there: np.ndarray) -> Trial:
        begun = None if first is None else np.where(there, first, np.nan)
        return trial_of(
            config, bench, used, unknowns, known, second, largest, heaviest, zeroing, begun, there, errors, h
        )

    trial = trial_with(given)
    if reality is None:
        reality = _walked(trial, used, sensors, known, runs, config.seed)
    simulated_noise = estimate.truth.noise and not isinstance(estimate.measured, FromFile)
    y = measurements(reality.readings[:, :, among], trial.noise, runs, starts, config.seed, simulated_noise)
    if simulated_noise and estimate.measured is None:
        too_much = trial.offsets.drawn(steps, runs, len(among), config.seed)
        if eta:
            too_much = too_much + misread(config, used, errors, eta, runs)
        y += np.repeat(too_much, starts, axis=1)
    y[:, :, ~given] = np.nan

    until = 1.0 if estimate.hold_out is None else 1 / (1 + given.sum())

    def filtering(share: float) -> None:
        using.progress("filter", 0.3 + 0.7 * until * share)

    def leaving(what: str, share: float) -> None:
        using.progress(what, 0.3 + 0.7 * (until + (1 - until) * share))

    watch = ring_watch(config, bench, trial.model, steps)
    found = (
        by_bank(estimate.method, trial, unknowns, y, filtering)
        if has_bank(config)
        else by_extended(estimate.method, trial, y, filtering, watch)
    )
    doubts = (
        *undistinguished(config, trial, given, unknowns, found.mean[:, 0]),
        *unfollowed(config, bench, trial, reality, found.mean[:, 0], found.std[:, 0]),
    )
    without = None
    if estimate.hold_out is not None:

        def tells(by: Trial, there: np.ndarray) -> None:
            list(undistinguished(config, by, there, unknowns, found.mean[:, 0]))

        without = held_out(config, estimate.method, used, given, y, trial_with, tells, starts, leaving)
    reading = _expected(config, bench, sensors, unknowns, trial, found, among, zeroing)
    nis = found.nis / np.maximum(np.isfinite(y).sum(axis=2), 1)
    return Estimated(
        bench, unknowns, trial, sensors, used, reality, y, time, found.mean, found.std,
        found.joint[:, :, len(unknowns.inputs) :, len(unknowns.inputs) :], nis, found.lost, reading,
        found.smoothed, elsewhere, rings_estimated(config, bench, watch), found.compared, without, done,
        (*doubts, *trial.notes, *found.notes),
    )  # fmt: skip


def _apart(reality: Reality, seen: Observed) -> tuple[Reality, dict[str, np.ndarray]]:
    """What sensors read there, and the coordinates of the bodies under gauges that have tolerances, by their sensor."""
    eta = {name: reality.readings[:, :, columns] for name, columns in seen.eta.items()}
    return replace(reality, readings=reality.readings[:, :, seen.own]), eta


def _given(config: BenchConfig, used: Sensors, placed: BenchPlaced | None) -> np.ndarray:
    """Which channels (m,) of its sensors the filter has: of those that take a layout the components that are in it."""
    found = np.ones(len(used.zeroed), dtype=bool)
    for name, entry in asked(config).sensors.items():
        if entry.layout is not None:
            assert placed is not None
            there, own = placed.layout(entry.layout).sensor, used.channels[name]
            found[own] = False
            found[own.start : own.start + 3] = [f"{name}.{axis}" in there for axis in "xyz"]
    return found


def _expected(
    config: BenchConfig,
    bench: Bench,
    sensors: Sensors,
    unknowns: Unknowns,
    trial: Trial,
    found: Filtered,
    among: np.ndarray,
    zeroing: np.ndarray,
) -> np.ndarray:
    """What all sensors read by the estimate of the first start of every seed (T + 1, seeds, channels), zeroed ones less
    their zero by the parameters of that instant, those of the filter (`among` all) with their offsets; NaN where the run
    diverges."""
    model, zero = trial.model, free_zero(config, bench, sensors, unknowns, zeroing)
    constant = zero_of(config, bench, sensors, unknowns, unknowns.starts[0], zeroing) if zero is None else 0.0
    first = found.mean[:, :: len(unknowns.starts)]
    reading = np.full((*first.shape[:2], len(sensors.zeroed)), np.nan)
    for at in np.ndindex(first.shape[:2]):
        if np.isfinite(x := first[at]).all():
            taken_off = constant if zero is None else zero(x[model.xi])[0]
            reading[at] = model.read(sensors.readings, x, at[0])[0] - taken_off
            reading[at][among[trial.offsets.at]] += x[model.size :]
    return reading


def _walked(trial: Trial, used: Sensors, sensors: Sensors, known: np.ndarray, runs: int, seed: int) -> Reality:
    """Drawn truths; sensors that the filter has not are not read."""
    found = drawn(trial.model, trial.start[:runs], trial.covariance[:runs], known, runs, seed)
    readings = np.full((len(known) - 1, runs, len(sensors.zeroed)), np.nan)
    for name, own in used.channels.items():
        readings[:, :, sensors.channels[name]] = found.readings[:, :, own]
    return Reality(found.inputs, found.theta, readings)


def from_file(
    path: Path, settings: FromFile, own: Mapping[str, tuple[Sensor, int]], h: float, steps: int
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Readings at 0, h, … (T + 1, components) of every sensor, NaN where nothing was measured, and what was done to them.

    own: sensors of the filter with their number of components; the first sample of the file is the start. Raises ConfigError for
    a channel of another quantity, a sensor with another number of components, and a file that ends before the estimate.
    """
    wanted: dict[str, Channel] = {}
    for name, (_, count) in own.items():
        entries, key = settings.channels[name], f"{SECTION}.channels.{name}"
        if len(entries) != count:  # of a placed layout nobody knew before
            raise ConfigError(
                f"{len(entries)} channels for {count} components",
                key=key,
                remedy="give a channel for each, in their order; null where one was not measured",
            )
        wanted |= {f"{key}.{i}": entry for i, entry in enumerate(entries) if entry is not None}
    signals = signals_of(settings, SECTION, path, wanted, step=h)
    if len(signals.time) <= steps:
        end = signals.time[-1] - signals.time[0]
        raise ConfigError(
            f"the file ends after {end:.6g} s, the estimate after {h * steps:.6g} s",
            key=f"{SECTION}.file",
            remedy=f"set estimate.duration to at most {end:.6g}",
        )
    read = {name: np.full((steps + 1, count), np.nan) for name, (_, count) in own.items()}
    for (key, entry), found, values in zip(wanted.items(), signals.quantities, signals.values.T, strict=True):
        name, component = key.removeprefix(f"{SECTION}.channels.").rsplit(".", 1)
        if found != (should := _quantity(own[name][0], int(component))):
            raise ConfigError(
                f"the channel is in {entry.unit}, {found}, but component {int(component) + 1} of {name} is of the kind {should}",
                key=f"{key}.unit",
                remedy="check the unit, and the order of the components",
            )
        read[name][:, int(component)] = values[: steps + 1]
    more = len(signals.time) - 1 - steps
    notes = [f"{more} samples of the file behind the end of the estimate were left out"] if more else []
    return read, (*signals.notes, *notes)


def _quantity(sensor: Sensor, component: int) -> str:
    """What a component is."""
    if isinstance(sensor, RelativeSensor):
        return "displacement" if component < 3 else "angle"
    if isinstance(sensor, AccelerationSensor):
        return "acceleration"
    return QUANTITY.get(sensor.quantity, "ratio") if isinstance(sensor, MotionSensor) else "strain"
