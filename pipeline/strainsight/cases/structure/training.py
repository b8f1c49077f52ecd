"""The training run: the reduced model under its loads, read by every candidate; and which candidates go on (5.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from strainsight.cases.layout.zones import zone_of
from strainsight.cases.resources import Resources
from strainsight.cases.structure.candidates import OnSurface, candidates_on_surface
from strainsight.cases.structure.channels import readings
from strainsight.cases.structure.clearance import bent_gauges, clearance_of
from strainsight.cases.structure.given_gauges import read_given
from strainsight.cases.structure.load_cases import Run, run_as_stated, runs_of
from strainsight.cases.structure.scales import refuse_noise, refuse_readings, refuse_times
from strainsight.cases.structure.settings import families
from strainsight.cases.structure.start import motion_of
from strainsight.config.gauges import AbsoluteNoise, RelativeNoise
from strainsight.config.placement import PlacementConfig, Screen
from strainsight.decks.matrices.files import read_numbering
from strainsight.errors import ConfigError, blame
from strainsight.fem.memory import require_memory
from strainsight.gauges.candidates import Candidates
from strainsight.gauges.given import without
from strainsight.gauges.rows import channel_rows
from strainsight.gauges.screening import BEND, CLEARANCE, Screening, screen
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.units import length_factor
from strainsight.records.reduced import Reduced
from strainsight.records.training import CaseMotion, Screened, Training, with_missed
from strainsight.signals.histories import instant_values

AT_A_TIME = 1000
"""Arms of bridges whose readings in time are held in memory."""
FEWER = "a shorter training run, a longer time step, or fewer candidates: gauges.include, gauges.exclude, fewer angles"


@dataclass(frozen=True)
class Trained:
    """The training run; surface: how its candidates were found on the mesh, None where their strain rows were given."""

    training: Training
    surface: OnSurface | None


def trained(config: PlacementConfig, mesh: Mesh, reduced: Reduced, using: Resources) -> Trained:
    """Simulate the reduced model at the guess, under the loads as stated and in every load case, and read every candidate."""
    model = reduced.model
    stated, *cases = (
        _Moved(run, *_motion(run, reduced))
        for run in (run_as_stated(config, model.inputs, using.files), *runs_of(config, model.inputs, using.files))
    )
    x, u, n, steps = stated.x, stated.u, model.size, len(stated.x) - 1
    using.progress("candidates", 0.3)
    surface, given = None, None
    names: tuple[str, ...] = ()
    if config.gauges.given is None:
        with np.errstate(over="ignore", invalid="ignore"):  # readings beyond all bounds are refused below
            moments = [own.x[:, :n].T @ own.x[:, :n] / len(own.x) for own in cases or [stated]]
        surface = candidates_on_surface(mesh, config, using.files, reduced.basis, np.mean(moments, axis=0))
        pool, names = surface.candidates, surface.names
        both = channel_rows(
            mesh.position, pool, with_missed(reduced.basis, reduced.misaligned.missed), facets=exterior_facets(mesh)
        )
    else:
        pool, given = _given(config, mesh, using)
        names = tuple(str(number) for number in pool.element)
        assert reduced.matrices is not None  # the config asks for matrices beside given gauges
        both = given @ with_missed(reduced.matrices.basis, reduced.matrices.missed)
    rows, missed = both[:, :n], both[:, n:].reshape(-1, *reduced.misaligned.missed.shape[1:])
    reading = _read(stated, reduced, rows, pool)
    found = {}
    for own in cases:
        using.progress(f"readings of {own.run.name}", 0.5)
        there = _read(own, reduced, rows, pool)
        found[own.run.name] = CaseMotion(
            time=own.run.time_step * np.arange(len(own.x)),
            load=own.u,
            coordinate=own.x[:, :n],
            velocity=own.x[:, n:],
            rms=np.sqrt(np.mean(there**2, axis=0)),
            peak=np.abs(there).max(axis=0),
        )
    training = Training(
        candidates=pool,
        name=names + ("",) * (pool.gauges - len(names)),
        rows=rows,
        missed=missed,
        given=given,
        moved=surface.moved if surface is not None and len(surface.moved) else None,
        time=stated.run.time_step * np.arange(steps + 1),
        load=u,
        coordinate=x[:, :n],
        velocity=x[:, n:],
        reading=reading,
        cases=found,
    )
    if pool.arms is not None:
        training = replace(training, arm_peak=_arm_peak(mesh, training, cases or [stated], reduced.basis))
    return Trained(training, surface)


@dataclass(frozen=True)
class _Moved:
    """A run with its motion x (steps + 1, 2n) and loads u (steps + 1, n_u) [N] at its instants."""

    run: Run
    x: np.ndarray
    u: np.ndarray


def _motion(run: Run, reduced: Reduced) -> tuple[np.ndarray, np.ndarray]:
    refuse_times(reduced.frequency, run.duration, run.time_step, run.key)
    with blame(run.key):
        loading = run.loading()
    return motion_of(reduced.model, reduced.model.reference, loading), instant_values(loading.held)


def _read(own: _Moved, reduced: Reduced, rows: np.ndarray, pool: Candidates) -> np.ndarray:
    """Readings of all candidates (steps + 1, m) in a run."""
    steps, model = len(own.x) - 1, reduced.model
    with blame(own.run.key):
        # the readings and their squares
        require_memory(16.0 * (steps + 1) * len(rows), f"readings of {len(rows)} channels in {steps} steps", FEWER)
    found = readings(model, model.reference, rows, pool.quantity, own.x, own.u)
    refuse_readings(found)
    return found


def _arm_peak(mesh: Mesh, training: Training, runs: Sequence[_Moved], basis: np.ndarray) -> np.ndarray:
    """The largest reading of any grid of every channel (m,); of arms of bridges by rows of their own."""
    pool, n = training.candidates, basis.shape[1]
    found, grids, channel = training.peak.copy(), pool.grids, pool.channel_of_grid
    found[pool.bridged] = 0.0
    facets = exterior_facets(mesh)
    for part in np.array_split(np.flatnonzero(pool.bridged[channel]), len(grids) // AT_A_TIME + 1):
        rows = channel_rows(mesh.position, grids.take(part), basis, facets=facets)
        for own in runs:
            np.maximum.at(found, channel[part], np.abs(own.x[:, :n] @ rows.T).max(axis=0, initial=0.0))
    return found


def _given(config: PlacementConfig, mesh: Mesh, using: Resources) -> tuple[Candidates, sparse.csr_array]:
    """Gauges by their strain rows, without those in excluded zones."""
    gauges = config.gauges
    if gauges.surface != "all":
        raise ConfigError(
            "given gauges lie on no surface of the mesh", key="gauges.surface", remedy="remove the key, or gauges.given"
        )
    _, components = read_numbering(using.files["mesh.matrices.numbering"])
    with blame("gauges.given"):
        given = read_given(
            using.files["gauges.given.rows"],
            using.files["gauges.given.table"],
            components,
            length_factor(config.mesh.length_unit),
        )
    with blame("gauges.exclude"):
        facets = exterior_facets(mesh) if mesh.blocks else None
        given = without(given, mesh, facets, [zone_of(entry) for entry in gauges.exclude])
    return given.pool, given.rows


def screened_of(config: PlacementConfig, mesh: Mesh, training: Training) -> Screened:
    """Leave out what is too near to edges, supports and loads, settle the noise of every channel, drop the overloaded and what
    is weak in every load case, thin the clusters."""
    pool, in_cases, strained = training.candidates, training.rms_in_cases, training.strained
    rms = in_cases.max(axis=0)
    noise_std, limit = np.empty(len(rms)), np.full(len(rms), np.inf)
    bent = bent_gauges(config, mesh, training) & ~pool.bonded[pool.first]
    clearance, near = clearance_of(config, mesh, training)
    near |= bent
    clear = ~near[pool.gauge]
    best = {}
    for i, (key, family) in enumerate(families(config).items()):
        own = pool.array == i
        # Of candidates: one bonded in a loud place, or a corner of no finite strain, must not make all others noisier.
        free = own & ~pool.bonded & clear if (own & ~pool.bonded).any() else own
        noise_std[own] = _noise_std(family.noise_std, rms[free], f"{key}.noise_std")
        if own.any():
            best[key] = float(rms[own].max()), float(noise_std[own][0])
        if family.range is not None:
            limit[own] = family.range
    refuse_noise(best)
    with blame("screen.keep"):
        result = _screened(config.screen, pool, near, in_cases, strained, noise_std, limit)
    return Screened(
        kept=result.kept,
        snr=result.snr,
        reason=np.where(bent, BEND, np.asarray(result.reason, dtype=np.str_)),
        clearance=clearance,
        noise_std=noise_std,
        range=limit,
        family=tuple(key.removeprefix("motion_sensors.") for key in families(config)),
    )


def _screened(
    settings: Screen,
    pool: Candidates,
    near: np.ndarray,
    rms: np.ndarray,
    strained: np.ndarray,
    noise_std: np.ndarray,
    limit: np.ndarray,
) -> Screening:
    """Every kind of sensor by itself: the best accelerometers would else leave no room for a gauge. rms (cases, m); near
    (gauges,): too near to something for the clearance; strained (m,): largest reading of any grid of a channel."""
    keep = None if settings.keep == "all" else settings.keep
    kinds = pool.array[pool.first]
    kept, reason = [], np.full(pool.gauges, CLEARANCE, dtype="<U9")
    snr = np.max([np.sqrt(np.bincount(pool.gauge, (own / noise_std) ** 2, pool.gauges)) for own in rms], axis=0)
    for kind in np.unique(kinds):
        gauges = np.flatnonzero((kinds == kind) & ~near)
        own = np.flatnonzero((pool.array == kind) & ~near[pool.gauge])
        part = pool.take(own)
        further = None if part.arms is None else (part.arms.grid.position, part.gauge[part.arms.channel])
        found = screen(
            rms[:, own],
            noise_std[own],
            pool.position[own],
            keep,
            settings.minimum_spacing,
            gauge=np.searchsorted(gauges, pool.gauge[own]),
            bonded=pool.bonded[own],
            largest=strained[own],
            limit=limit[own],
            also_at=further,
        )
        kept.append(gauges[found.kept])
        snr[gauges], reason[gauges] = found.snr, found.reason
    return Screening(np.sort(np.concatenate(kept)), snr, reason)


def _noise_std(stated: AbsoluteNoise | RelativeNoise, rms: np.ndarray, key: str) -> float:
    """σ of a family of sensors: as stated, or a share of its strongest candidate."""
    if isinstance(stated, AbsoluteNoise):
        return stated.value
    strongest = float(rms.max())
    if strongest <= 0:
        raise ConfigError(
            "no candidate reads anything in the training run, of which the noise would be a share",
            key=key,
            remedy="give {value: …}, or load the structure",
        )
    return stated.relative_to_strongest * strongest
