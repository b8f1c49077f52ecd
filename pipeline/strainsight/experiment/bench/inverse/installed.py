"""Gauges of a bench that are not quite where and what they are taken for: what that adds to σ, drawn by a truth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.bench.bench import BenchConfig, StrainSensor
from strainsight.errors import blame
from strainsight.estimation.filter import FilterRun
from strainsight.experiment.bench.bench import Bench
from strainsight.experiment.bench.inverse.unknowns import asked
from strainsight.experiment.bench.sensors import Sensors, gauges_of
from strainsight.mesh.facets import Facets
from strainsight.mesh.model import Mesh
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


def std_of(config: BenchConfig) -> InstallationStd:
    """σ of place [m], angle [rad], gain and transverse sensitivity."""
    stated = asked(config).tolerances
    if stated is None:
        return InstallationStd()
    return InstallationStd(stated.position, float(np.deg2rad(stated.angle)), stated.gain, stated.transverse)


def toleranced(bench: Bench, used: Sensors) -> tuple[Toleranced, ...]:
    """Of every strain sensor of the filter the errors that `estimate.tolerances` leaves open, to first order: place and turn of a
    gauge, all grids of which move as one, gain and transverse sensitivity of each grid."""
    std = std_of(bench.config)
    sigma = {name: value for name, value in std.by_name.items() if value > 0 and name not in SECOND}
    found = []
    for name in used.channels if sigma else ():
        entry = bench.config.sensors[name]
        if not isinstance(entry, StrainSensor):
            continue
        mesh, basis = bench.meshes[entry.body], bench.reduced[entry.body].basis
        gauges, facets, _ = gauges_of(bench, name, entry)
        with blame(f"sensors.{name}.gauges"):
            felt = sensitivity_rows(mesh.position, gauges, basis, std.position, facets=facets)
        slope: list[np.ndarray] = []
        for key, value in sigma.items():
            rows, owner = value * getattr(felt, key), gauges.gauge if key in COMMON else np.arange(len(gauges))
            slope += [np.where((owner == each)[:, None], rows, 0.0) for each in np.unique(owner)]
        felt_at_all = [rows for rows in slope if rows.any()]
        whole = np.stack(felt_at_all, axis=1) if felt_at_all else np.zeros((len(gauges), 0, basis.shape[1]))
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


def misread(bench: Bench, used: Sensors, errors: tuple[Toleranced, ...], q: np.ndarray, runs: int) -> np.ndarray:
    """What gauges as they are installed read beside what they are taken for (T, runs, m), drawn anew for every run; q
    (T + 1, 1 or runs, n): the true motion. Exact in the errors, to which the filter is linear."""
    std = std_of(bench.config)
    added = np.zeros((len(q) - 1, runs, len(used.zeroed)))
    for run in range(runs):
        draw = np.random.default_rng((bench.config.seed, run, DRAWN))
        for error in errors:
            free = replace(error.gauges, bonded=np.zeros(len(error.gauges), dtype=bool))
            eta = q[:, min(run, q.shape[1] - 1), bench.system.modal(error.body)]
            rows, plain = (
                installed_rows(error.mesh.position, free, error.basis, installation, facets=error.facets)[0]
                for installation in (
                    drawn_installation(free, std, draw),
                    drawn_installation(free, InstallationStd(), draw),
                )
            )
            added[:, run, used.channels[error.name]] += (eta - eta[0] * error.zeroed)[1:] @ (rows - plain).T
    return added
