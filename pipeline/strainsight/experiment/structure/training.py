"""Training simulation: simulate the reduced model under its loads and read every candidate (5.2)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import sparse

from strainsight.config.loads import CaseLoad, Settle, TrainingCase, silent_in
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError, InfeasibleError, at_least, at_most, blame
from strainsight.experiment.layout.gauge_list import zone_of
from strainsight.experiment.recorded import signal_of
from strainsight.experiment.structure.bonded_gauges import read_given
from strainsight.experiment.structure.candidates import (
    OnSurface,
    candidates_on_surface,
    free_thicknesses,
    reading_sizes,
    rows_along,
    thickness_at,
)
from strainsight.experiment.structure.references import characteristic
from strainsight.experiment.structure.start import Loading, loading_of, motion_of
from strainsight.experiment.system import Resources
from strainsight.fem.affine import NO_CHANGE
from strainsight.foreign.matrices.files import read_numbering
from strainsight.loads.histories import Constant, Signal, instant_values
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import Thickness
from strainsight.mesh.units import length_factor
from strainsight.records.reduced import Reduced
from strainsight.records.training import CaseMotion, Training, with_missed
from strainsight.rom.model import Damping, accelerations
from strainsight.sensors.bonded import without
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.strain_operator import channel_rows
from strainsight.sensors.surface_paths import skin_of


@dataclass(frozen=True)
class TrainingRun:
    """One training simulation.

    name: of its load case, "" for the configured loads; key: config section; weight [-]: of the case; duration, time_step [s];
    settle: start of the motion; signals: by load; silent: loads that do not act."""

    name: str
    key: str
    weight: float
    duration: float
    time_step: float
    settle: Settle
    signals: Mapping[str, Signal]
    silent: frozenset[str]

    def loading(self) -> Loading:
        """Loads from t = 0, and before for settling."""
        steps = round(self.duration / self.time_step)
        with blame(self.key):
            return loading_of(self.settle, list(self.signals.values()), self.time_step, steps)


def run_as_stated(config: PlacementConfig, inputs: Sequence[str], files: Mapping[str, Path]) -> TrainingRun:
    """Run under the configured loads; inputs: in the order of the model."""
    return _run(config, "", TrainingCase.model_validate({}), inputs, files)


def runs_of(config: PlacementConfig, inputs: Sequence[str], files: Mapping[str, Path]) -> tuple[TrainingRun, ...]:
    """Runs for a placement: load cases sorted by name, else the run under the configured loads."""
    cases = config.place.load_cases or {}
    return tuple(_run(config, name, cases[name], inputs, files) for name in sorted(cases)) or (
        run_as_stated(config, inputs, files),
    )


def _run(
    config: PlacementConfig, name: str, case: TrainingCase, inputs: Sequence[str], files: Mapping[str, Path]
) -> TrainingRun:
    train, silent = config.train, silent_in(case)
    key = f"place.load_cases.{name}" if name else "train"
    signals: dict[str, Signal] = {}
    with blame(key):
        for load in inputs:
            entry = case.loads.get(load)
            if load in silent:
                signals[load] = Constant(0.0)
            elif isinstance(entry, CaseLoad):
                signals[load] = signal_of(load, entry.signal, files, f"{key}.loads")
            else:
                signals[load] = signal_of(load, config.loads[load].signal, files)
    return TrainingRun(
        name,
        key,
        case.weight,
        train.duration if case.duration is None else case.duration,
        train.time_step if case.time_step is None else case.time_step,
        train.settle if case.settle is None else case.settle,
        signals,
        silent,
    )


def typical_of(
    config: PlacementConfig, run: TrainingRun, names: Sequence[str], files: Mapping[str, Path]
) -> dict[str, tuple[float, float]]:
    """Frequency [Hz] and amplitude of unknown loads in a run, from its load case, process_noise or the signal; an inactive load
    keeps the configured values, as its filter does not assume that it is inactive."""
    case_loads = config.place.load_cases[run.name].loads if run.name and config.place.load_cases else {}
    typical = {}
    for name in names:
        load, entry = config.loads[name], case_loads.get(name)
        if name in run.silent:
            typical[name] = characteristic(load, signal_of(name, load.signal, files), config.train.duration)
            continue
        frequency, amplitude = characteristic(load, run.signals[name], run.duration)
        if isinstance(entry, CaseLoad):
            frequency = frequency if entry.frequency is None else entry.frequency
            amplitude = amplitude if entry.amplitude is None else entry.amplitude
        if run.name and amplitude == 0:
            raise ConfigError(
                f"load '{name}' is zero at all times of this load case",
                key=f"{run.key}.loads.{name}",
                remedy=f"Set {run.key}.loads.{name}: none.",
            )
        typical[name] = frequency, amplitude
    return typical


AT_A_TIME = 1000
"""Bridge arms whose readings in time are in memory at a time."""
LEAST_PERIODS = 1e-3
"""Fewest periods of the last mode in a training simulation. In shorter runs stiffness has no visible effect, and the
Riccati equation exceeds double precision at 4e-5 periods."""
MOST_PERIODS = 1e6
"""Most periods of the first mode in a time step; beyond, the motion is static to all digits."""
READINGS = (1e-50, 1e50)
"""Range of the largest reading of a training simulation [strain, m/s², m], so that its fourth power is finite."""
MOST_DAMPED = 1e4
"""Largest damping ratio of the least damped mode."""
SIGNAL_TO_NOISE = (1e-4, 1e9)
"""Range of RMS reading/σ of the best sensor: below there is no information, above rounding errors exceed σ, and from 1e11 the
Riccati equation exceeds double precision."""


def trained(
    config: PlacementConfig, mesh: Mesh, reduced: Reduced, using: Resources
) -> tuple[Training, OnSurface | None]:
    """Simulate the configured loads and every load case at the guess, and read every candidate; also returns the candidates on
    the surface, None for an imported strain operator."""
    model = reduced.model
    of_cases = [run for run in runs_of(config, model.inputs, using.files) if run.name]
    nominal, *cases = (_moved(run, reduced) for run in (run_as_stated(config, model.inputs, using.files), *of_cases))
    n = model.size
    using.progress("candidates", 0.3)
    surface, given_rows, change, free = None, None, NO_CHANGE, free_thicknesses(config, mesh, model.reference)
    names: tuple[str, ...] = ()
    if config.gauges.strain_operator is None:
        with np.errstate(over="ignore", invalid="ignore"):  # infinite readings are refused below
            moments = [moved.x[:, :n].T @ moved.x[:, :n] / len(moved.x) for moved in cases or [nominal]]
        surface = candidates_on_surface(mesh, config, using.files, reduced.basis, np.mean(moments, axis=0))
        pool, names = surface.candidates, surface.names
        field, skin = (
            with_missed(reduced.basis, reduced.misaligned.missed),
            skin_of(mesh.position, exterior_facets(mesh)),
        )
        both, change = rows_along(
            mesh, free, lambda thickness: channel_rows(mesh.position, pool, field, facets=skin, thickness=thickness)
        )
    else:
        pool, given_rows = _imported_gauges(config, mesh, using)
        names = tuple(str(number) for number in pool.element)
        assert reduced.matrices is not None  # required by the config with imported gauges
        both = given_rows @ with_missed(reduced.matrices.basis, reduced.matrices.missed)
    rows, missed = both[:, :n], both[:, n:].reshape(-1, *reduced.misaligned.missed.shape[1:])
    motions = {}
    for moved in (nominal, *cases):
        if moved.run.name:
            using.progress(f"readings of {moved.run.name}", 0.5)
        motions[moved.run.name] = _read(moved, reduced, rows, pool)
    as_stated = motions.pop("")
    training = Training(
        candidates=pool,
        name=names + ("",) * (pool.gauges - len(names)),
        rows=rows,
        row_change=change.of_terms(lambda X: X[:, :n]) if change.terms else None,
        missed=missed,
        strain_operator=given_rows,
        moved=surface.moved if surface is not None and len(surface.moved) else None,
        time=as_stated.time,
        load=as_stated.load,
        coordinate=as_stated.coordinate,
        velocity=as_stated.velocity,
        acceleration=accelerations(model, model.reference, nominal.x, nominal.u),
        rms_as_stated=as_stated.rms,
        peak_as_stated=as_stated.peak,
        cases=motions,
    )
    if pool.arms is not None:
        thickness = thickness_at(mesh, free, model.reference)
        most = _arm_peak(mesh, training, cases or [nominal], reduced.basis, thickness)
        training = replace(training, arm_peak=most)
    return training, surface


@dataclass(frozen=True)
class _Moved:
    """A run with motion x (steps + 1, 2n) and loads u (steps + 1, n_u) [N]."""

    run: TrainingRun
    x: np.ndarray
    u: np.ndarray


def _moved(run: TrainingRun, reduced: Reduced) -> _Moved:
    refuse_times(reduced.frequency, run.duration, run.time_step, run.key)
    loading = run.loading()
    return _Moved(run, motion_of(reduced.model, reduced.model.reference, loading), instant_values(loading.coefficients))


def _read(moved: _Moved, reduced: Reduced, rows: np.ndarray, pool: Candidates) -> CaseMotion:
    n = reduced.model.size
    with np.errstate(over="ignore", invalid="ignore"):  # refused below
        rms, peak = reading_sizes(reduced.model, rows, pool.quantity, moved.x, moved.u)
    with blame(moved.run.key):
        refuse_readings(peak)
    time = moved.run.time_step * np.arange(len(moved.x))
    return CaseMotion(time=time, load=moved.u, coordinate=moved.x[:, :n], velocity=moved.x[:, n:], rms=rms, peak=peak)


def _arm_peak(
    mesh: Mesh, training: Training, runs: Sequence[_Moved], basis: np.ndarray, thickness: Thickness | None
) -> np.ndarray:
    """Largest reading of any grid of every channel (m,), for bridges of any arm."""
    pool, n = training.candidates, basis.shape[1]
    peak, grids, channel = training.peak.copy(), pool.grids, pool.channel_of_grid
    peak[pool.bridged] = 0.0
    facets = exterior_facets(mesh)
    for part in np.array_split(np.flatnonzero(pool.bridged[channel]), len(grids) // AT_A_TIME + 1):
        rows = channel_rows(mesh.position, grids.take(part), basis, facets=facets, thickness=thickness)
        for moved in runs:
            np.maximum.at(peak, channel[part], np.abs(moved.x[:, :n] @ rows.T).max(axis=0, initial=0.0))
    return peak


def _imported_gauges(config: PlacementConfig, mesh: Mesh, using: Resources) -> tuple[Candidates, sparse.csr_array]:
    """Imported gauges and strain operator, without gauges in excluded zones."""
    gauges = config.gauges
    if gauges.surface != "all":
        raise ConfigError(
            "imported gauges do not use a surface of the mesh",
            key="gauges.surface",
            remedy="Remove this key or gauges.strain_operator.",
        )
    _, components = read_numbering(using.files["mesh.matrices.numbering"])
    with blame("gauges.strain_operator"):
        gauges_of_file = read_given(
            using.files["gauges.strain_operator.rows"],
            using.files["gauges.strain_operator.table"],
            components,
            length_factor(config.mesh.length_unit),
        )
    with blame("gauges.exclude"):
        facets = exterior_facets(mesh) if mesh.has_surface else None
        gauges_of_file = without(gauges_of_file, mesh, facets, [zone_of(entry) for entry in gauges.exclude])
    return gauges_of_file.pool, gauges_of_file.rows


def hertz(frequency: float, decimals: int) -> str:
    """Format a frequency [Hz] with fixed decimals, or with four digits if it is very small or large."""
    return f"{frequency:.{decimals}f}" if 1 <= frequency < 1e6 else f"{frequency:.4g}"


def refuse_damping(damping: Damping, frequency: np.ndarray) -> None:
    """Raises InfeasibleError if every mode has a damping ratio above MOST_DAMPED; frequency (modes,) [Hz]."""
    omega = 2 * np.pi * frequency
    ratio = damping.viscous(omega**2)[0] / (2 * omega)
    if ratio.min() > MOST_DAMPED:
        least = int(np.argmin(ratio))
        raise InfeasibleError(
            f"the smallest damping ratio of all modes is {ratio[least]:.2g} (at {frequency[least]:.4g} Hz), above the limit of "
            f"{MOST_DAMPED:g}",
            key="damping",
            remedy="Check alpha [1/s] and beta [s]: ζ = (α/ω + βω)/2 with ω = 2πf.",
        )


def refuse_times(frequency: np.ndarray, duration: float, step: float, section: str = "train") -> None:
    """Raises InfeasibleError if a training simulation is too short or its time step too long for all modes.

    frequency (modes,) [Hz], ascending; duration, step [s]: of the config `section`."""
    first, last = float(frequency[0]), float(frequency[-1])
    units = "Check mesh.length_unit, mesh.mass_unit, modulus and density"
    if last * duration < LEAST_PERIODS:
        raise InfeasibleError(
            f"the duration of {duration:g} s is only {last * duration:.2g} periods of the highest mode ({last:.4g} Hz), "
            "too short for the stiffness to affect the readings",
            key=f"{section}.duration",
            remedy=f"{units}, or set at least {at_least(LEAST_PERIODS / last)} s, better a few periods of the first mode.",
        )
    if first * step > MOST_PERIODS:
        raise InfeasibleError(
            f"the time step of {step:g} s is {first * step:.2g} periods of the first mode ({first:.4g} Hz), so the response is "
            "static",
            key=f"{section}.time_step",
            remedy=f"{units}, or set at most {at_most(MOST_PERIODS / first)} s.",
        )


def refuse_readings(readings: np.ndarray) -> None:
    """Raises InfeasibleError if the largest of readings (channels,) [strain, m/s², m] is outside READINGS."""
    largest, (low, high) = float(np.abs(readings).max(initial=0.0)), READINGS
    if largest == 0 or low <= largest <= high:
        return
    side, limit = ("above", high) if not largest <= high else ("below", low)
    raise InfeasibleError(
        f"the largest reading of the training simulation (stage `train`) is {largest:.2g} (strain, m/s² or m), {side} the "
        f"limit of {limit:g}",
        key="loads",
        remedy="Check the amplitude of the loads [N] and the modulus [Pa].",
    )


def refuse_noise(best: Mapping[str, tuple[float, float]]) -> None:
    """Raises InfeasibleError if the noise exceeds all readings, or is negligibly small.

    best: config key of a kind of sensors → its largest RMS reading and σ of its noise [strain, m/s², m]."""
    low, high = SIGNAL_TO_NOISE
    key, (signal, noise) = max(best.items(), key=lambda item: item[1][0] / item[1][1] if item[1][1] else np.inf)
    if signal > high * noise:
        why, limit = "the noise is below the rounding error of the model", f"at least {at_least(signal / high)}"
    elif 0 < signal < low * noise:
        why, limit = "the noise is too large for any estimate", f"at most {at_most(signal / low)}"
    else:
        return
    raise InfeasibleError(
        f"{why}: {noise:.3g}, {noise / signal:.1g} times the largest RMS reading ({signal:.3g})",
        key=f"{key}.noise_std",
        remedy=f"Set {limit}, in the unit of the reading: strain (1 µm/m is 1e-6), m/s² or m.",
    )
