"""Gauges of a bench that are not quite where and what they are taken for: what that adds to σ, drawn by a truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.bench.bench import BenchConfig, StrainSensorSection
from strainsight.errors import blame
from strainsight.estimation.run import FilterRun
from strainsight.experiment.bench.bench import Bench
from strainsight.experiment.bench.inverse.unknowns import asked
from strainsight.experiment.bench.sensors import Sensors, gauges_of
from strainsight.mesh.facets import Facets
from strainsight.mesh.model import Mesh
from strainsight.multibody.sensors import CompiledSensors, readings
from strainsight.multibody.sensors import StrainSensor as StrainRows
from strainsight.records.bench import BenchPlaced, ReducedBody
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.installation import (
    COMMON,
    SECOND,
    InstallationStd,
    drawn_installation,
    installed_rows,
    sensitivity_rows,
)

DRAWN = 5
"""Last word of the seed by which a seed's gauges are installed."""


@dataclass(frozen=True)
class Toleranced:
    """A strain sensor of the filter: its name and body, gauges, mesh and facets of that, basis (3 nodes, r); slope
    (channels, k, r): σ times what each of k errors adds to its rows; zeroed."""

    name: str
    body: str
    gauges: Candidates
    mesh: Mesh
    facets: Facets
    basis: np.ndarray
    slope: np.ndarray
    zeroed: bool


@dataclass(frozen=True)
class Observed:
    """What a truth reads: all sensors (columns own) and the coordinates of the bodies under gauges that have tolerances, by the
    sensor, less what they are at the start where it is zeroed."""

    readings: CompiledSensors
    zeroed: np.ndarray
    own: np.ndarray
    eta: Mapping[str, np.ndarray]


def std_of(config: BenchConfig) -> InstallationStd:
    """σ of place [m], angle [rad], gain and transverse sensitivity."""
    stated = asked(config).tolerances
    if stated is None:
        return InstallationStd()
    return InstallationStd(stated.position, float(np.deg2rad(stated.angle)), stated.gain, stated.transverse)


def toleranced(
    config: BenchConfig,
    reduced: Mapping[str, ReducedBody],
    meshes: Mapping[str, Mesh],
    placed: BenchPlaced | None,
    used: Sensors,
) -> tuple[Toleranced, ...]:
    """Of every strain sensor of the filter the errors that `estimate.tolerances` leaves open, to first order: place and turn of a
    gauge, all grids of which move as one, gain and transverse sensitivity of each grid."""
    std = std_of(config)
    sigma = {name: value for name, value in std.by_name.items() if value > 0 and name not in SECOND}
    found = []
    for name in used.channels if sigma else ():
        entry = config.sensors[name]
        if not isinstance(entry, StrainSensorSection):
            continue
        mesh, basis = meshes[entry.body], reduced[entry.body].basis
        gauges, facets, _ = gauges_of(name, entry, mesh, placed)
        with blame(f"sensors.{name}.gauges"):
            felt = sensitivity_rows(mesh.position, gauges, basis, std.position, facets=facets)
        slope: list[np.ndarray] = []
        for key, value in sigma.items():
            rows, owner = value * getattr(felt, key), gauges.gauge if key in COMMON else np.arange(len(gauges))
            slope += [np.where((owner == each)[:, None], rows, 0.0) for each in np.unique(owner)]
        kept = [own for own in slope if own.any()]
        whole = np.stack(kept, axis=1) if kept else np.zeros((len(gauges), 0, basis.shape[1]))
        found.append(Toleranced(name, entry.body, gauges, mesh, facets, basis, whole, entry.zeroed))
    return tuple(found)


def rows_of(
    bench: Bench, used: Sensors, sensors: tuple[Toleranced, ...], zero: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """D (m, k, n), o (m, k): what the k errors of all sensors add to every channel, in σ of them, (D q + o) ν; zero (n,): q where
    zeroed sensors were zeroed."""
    m, n = len(used.zeroed), bench.system.size
    D, o = [np.zeros((m, 0, n))], [np.zeros((m, 0))]
    for own in sensors:
        rows = np.zeros((m, own.slope.shape[1], n))
        rows[used.channels[own.name], :, bench.system.modal(own.body)] = own.slope
        D.append(rows)
        o.append(-rows @ zero if own.zeroed else np.zeros(rows.shape[:2]))
    return np.concatenate(D, axis=1), np.concatenate(o, axis=1)


def considered(run: FilterRun, y: np.ndarray, R: np.ndarray, D: np.ndarray, o: np.ndarray) -> np.ndarray:
    """S (T + 1, B, N, k): what σ of every constant error of the readings, (D x + o) ν, leaves the estimate off by, where the gain
    knows nothing of it:

        Sₖ₊₁ = (1 − K H) A Sₖ + K (D x̂ + o),     K = P Hᵀ R⁻¹,     σ² = diag(P + S Sᵀ)

    run: kept for all runs; y (T, B, m) with NaN where missing, R (m,); D (m, k, n) on the first n states, o (m, k).
    Source: Schmidt; Gelb, Applied Optimal Estimation (1974), section 7.2.
    """
    assert run.covariance is not None
    assert run.jacobian is not None
    assert run.rows is not None
    steps, runs, size = len(y), y.shape[1], run.mean.shape[2]
    S = np.zeros((steps + 1, runs, size, D.shape[1]))
    for t in range(steps):
        H = np.where(np.isfinite(y[t])[..., None], run.rows[t], 0.0)
        G = np.einsum("mkn,bn->bmk", D, np.nan_to_num(run.mean[t + 1, :, : D.shape[2]])) + o
        G = np.where(np.isfinite(y[t])[..., None], G, 0.0)
        K = run.covariance[t + 1] @ np.swapaxes(H, 1, 2) / R
        ahead = run.jacobian[t] @ S[t]
        S[t + 1] = ahead - K @ (H @ ahead) + K @ G
    return S


def observed(bench: Bench, sensors: Sensors, errors: tuple[Toleranced, ...]) -> Observed:
    """All sensors, and the coordinates under those with errors as strains of unit rows behind the strains."""
    if not errors:
        return Observed(sensors.readings, sensors.zeroed, np.arange(len(sensors.zeroed)), {})
    strains = [own for own in sensors.readings.sensors if isinstance(own, StrainRows)]
    others = [own for own in sensors.readings.sensors if not isinstance(own, StrainRows)]
    modal = [StrainRows(f"coordinates under {own.name}", own.body, np.eye(own.basis.shape[1])) for own in errors]
    first, zeroed, eta = sum(len(own.rows) for own in strains), [], {}
    at = first
    for own, rows in zip(errors, modal, strict=True):
        eta[own.name] = np.arange(at, at + len(rows.rows))
        zeroed += [own.zeroed] * len(rows.rows)
        at += len(rows.rows)
    own_columns = np.arange(len(sensors.zeroed))
    own_columns[first:] += at - first
    whole = np.insert(sensors.zeroed, np.full(len(zeroed), first), zeroed)
    return Observed(readings(bench.system, [*strains, *modal, *others]), whole, own_columns, eta)


def misread(
    config: BenchConfig, used: Sensors, errors: tuple[Toleranced, ...], eta: Mapping[str, np.ndarray], runs: int
) -> np.ndarray:
    """What gauges as they are installed read beside what they are taken for (T, runs, m), drawn anew for every run; eta: sensor →
    (T, 1 or runs, r) true coordinates. Exact in the errors, to which the filter is linear."""
    std, m = std_of(config), len(used.zeroed)
    steps = next(iter(eta.values())).shape[0] if eta else 0
    found = np.zeros((steps, runs, m))
    for run in range(runs):
        draw = np.random.default_rng((config.seed, run, DRAWN))
        for own in errors:
            free = replace(own.gauges, bonded=np.zeros(len(own.gauges), dtype=bool))
            installation = drawn_installation(free, std, draw)
            rows, _ = installed_rows(own.mesh.position, free, own.basis, installation, facets=own.facets)
            plain, _ = installed_rows(
                own.mesh.position, free, own.basis, drawn_installation(free, InstallationStd(), draw), facets=own.facets
            )
            true = eta[own.name]
            found[:, run, used.channels[own.name]] += true[:, min(run, true.shape[1] - 1)] @ (rows - plain).T
    return found
