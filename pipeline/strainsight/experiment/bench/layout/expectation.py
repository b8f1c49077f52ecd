"""Linearised bench at rest: scenarios that rank gauges on a body, and the expected σ of a filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import block_diag

from strainsight.config.bench.bench import BenchConfig, BenchPlace, StrainSensorSection
from strainsight.errors import InfeasibleError, NumericalError, blame
from strainsight.experiment.bench.bench import Bench, start_of
from strainsight.experiment.bench.inverse.problem import BenchUnknowns, corrects_in_a_test
from strainsight.experiment.bench.loads import loads_of
from strainsight.mesh.model import Mesh
from strainsight.multibody.initial import static_equilibrium
from strainsight.multibody.inverse.linear import LinearBench, build_continuous_model, build_discrete_model, linear_bench
from strainsight.placement.riccati import factor_after, steady_factor
from strainsight.placement.scenario import Scenario

Pose = tuple[np.ndarray, np.ndarray]
"""Coordinates q and inputs u of the system at rest."""
DISTURBED = 1e-3
"""Smallest white acceleration [m/s²] of every body for the ranking, as undamped motions have no steady covariance without it."""


@dataclass(frozen=True)
class PlacedBody:
    """Bench with the body on which gauges are placed, at the parameter guess.

    files: of the config; unknowns: of the filter; mesh: of the body; basis (3 nodes, r): displacement per coordinate."""

    config: BenchConfig
    place: BenchPlace
    files: Mapping[str, Path]
    bench: Bench
    unknowns: BenchUnknowns
    mesh: Mesh
    basis: np.ndarray

    @property
    def loads(self) -> tuple[str, ...]:
        """Unknown loads in the order of the system."""
        return tuple(name for name in self.bench.system.inputs if name in self.config.estimator.inputs)

    @property
    def inputs(self) -> tuple[str, ...]:
        """All unknowns, loads before parameters."""
        return (*self.loads, *self.unknowns.free)

    @property
    def acceleration(self) -> float:
        """White acceleration of the filter [m/s²]."""
        return float(self.config.estimator.disturbance)

    @property
    def modal(self) -> slice:
        """Modal coordinates of the body among those of the system."""
        return self.bench.system.modal(self.place.body)

    @property
    def columns(self) -> tuple[list[int], np.ndarray]:
        """Indices of the loads in the system's inputs, and ∂θ/∂ξ (nθ, p)."""
        coordinates, inputs = self.unknowns.coordinates, self.bench.system.inputs
        by_xi = coordinates.theta(coordinates.xi(self.bench.theta))[1]
        return [inputs.index(name) for name in self.loads], by_xi

    def linear(self, pose: Pose, increment: np.ndarray) -> LinearBench:
        """Linearise about a pose; increment (unknowns,): σ per step."""
        config, (places, by_xi) = self.config, self.columns
        corrected, method = corrects_in_a_test(config), config.simulate.method
        printed, (q, u) = config.estimator.method.noise == "as_printed", pose
        theta, h = self.bench.theta, config.filter_step
        return linear_bench(self.bench.system, q, u, theta, places, increment, h, method, corrected, printed, by_xi)


def poses_of(body: PlacedBody, instants: Sequence[float]) -> list[Pose]:
    """Static equilibrium at each instant [s] with its loads and drives at rest, each starting from the previous one."""
    bench = body.bench
    u = loads_of(bench, body.files)(np.array(instants))
    u[:, bench.system.drives.rates] = 0.0
    with blame("simulate"):
        q = start_of(bench.simulated(start="equilibrium"), u[0])[0]
    poses = [(q, u[0])]
    for instant, inputs in zip(instants[1:], u[1:], strict=True):
        try:
            q = static_equilibrium(bench.system, q, inputs, bench.theta)[0]
        except (InfeasibleError, NumericalError) as error:
            raise type(error)(
                f"at t = {instant:.4g} s, {error.what}", key="place.poses", remedy=error.remedy
            ) from error
        poses.append((q, inputs))
    return poses


@dataclass(frozen=True)
class Known:
    """Prior of a placement with parameters: start (unknowns, unknowns): covariance factor of loads and ξ; increment (unknowns,):
    σ per step; slopes (p, p): ∂θ/∂ξ; steps (poses,): duration in each pose."""

    start: np.ndarray
    increment: np.ndarray
    slopes: np.ndarray
    steps: tuple[int, ...]


def known_of(body: PlacedBody, time: np.ndarray) -> tuple[Known | None, np.ndarray]:
    """Prior with parameters, None without parameters; and increments (unknowns,) for the ranking, loads before ξ, where a
    constant parameter gets the increment that accumulates to σ of its guess over the run.

    The run stays in each pose until half-way to the next; time (poses,) [s]."""
    unknowns, theta = body.unknowns, body.bench.theta
    order = [list(body.config.estimator.inputs).index(name) for name in body.loads]
    of_loads = unknowns.increment_u[order]
    if not unknowns.free:
        return None, of_loads
    coordinates = unknowns.coordinates
    between = np.concatenate([[0.0], 0.5 * (time[1:] + time[:-1]), [body.config.filter_duration]])
    steps = np.maximum(1, np.diff(np.round(between / body.config.filter_step).astype(int)))
    covariance = coordinates.covariance(theta, unknowns.std)
    moved = np.sqrt(np.diag(coordinates.covariance(theta, unknowns.increment)))
    known = Known(
        block_diag(np.diag(unknowns.std_u[order]), np.linalg.cholesky(covariance)),
        np.concatenate([of_loads, moved]),
        body.columns[1][coordinates.free],
        tuple(int(count) for count in steps),
    )
    equivalent = np.sqrt(np.diag(covariance) / steps.sum())
    return known, np.concatenate([of_loads, np.where(moved > 0, moved, equivalent)])


def zeroed(config: BenchConfig) -> bool:
    """Whether the layout's sensor is zeroed at rest, so that it does not measure the initial deformation."""
    sensors = (config.sensors[name] for name in config.estimator.sensors)
    takes = any(
        isinstance(sensor, StrainSensorSection) and sensor.layout == "place" and sensor.zeroed for sensor in sensors
    )
    return takes and config.simulate.start == "equilibrium"


def scenario_of(
    bench: LinearBench, H: np.ndarray, noise: np.ndarray | float, acceleration: float, white: np.ndarray | float = 0.0
) -> Scenario:
    """Continuous-time scenario with reading intensity σ²h, without weights.

    H (k, n*): readings of (η, η̇, unknowns); noise (k,) or scalar: σ of a sample at step h; acceleration [m/s²]: of the white
    force, at least `DISTURBED`; white (k,): variance of a reading for 1 m/s², added as independent noise."""
    acceleration = max(acceleration, DISTURBED)
    F, Q = build_continuous_model(bench, acceleration)
    variance = np.broadcast_to(np.asarray(noise) ** 2 + acceleration**2 * np.asarray(white), len(H))
    return Scenario(F, Q, H, variance * bench.h, np.zeros(len(F)))


def expected_std(
    bench: LinearBench, H: np.ndarray, noise: np.ndarray | float, acceleration: float, off: np.ndarray | float = 0.0
) -> np.ndarray:
    """Steady-state σ (nu,) [N, N m] of the inputs after an update; off (k,): σ of a considered constant reading error (Schmidt):

        S = (1 − K H) A S + K diag(off),     K = P Hᵀ R⁻¹,     σ² = diag(P + S Sᵀ)

    H (k, n*), noise, acceleration: see `scenario_of`; inf if the gauges do not detect all inputs. Raises InfeasibleError and
    NumericalError as `steady_factor`."""
    A, N, scale = build_discrete_model(bench, acceleration)
    L = steady_factor(A, H * scale / _column(noise), N)
    unknown = slice(len(A) - len(bench.increment), len(A))
    if L is None:
        return np.full(len(bench.increment), np.inf)
    G = np.broadcast_to(np.asarray(off) / noise, len(H))
    if G.any():
        scaled = H * scale / _column(noise)
        K = L @ (scaled @ L).T
        L = np.hstack([L, np.linalg.solve(np.eye(len(A)) - A + K @ (scaled @ A), K * G)])
    return np.asarray(np.linalg.norm(L[unknown], axis=1) * bench.increment)


def factors_along(
    benches: Sequence[LinearBench],
    readings: Sequence[np.ndarray],
    noise: np.ndarray | float,
    acceleration: float,
    increment: np.ndarray,
    start: np.ndarray,
    steps: Sequence[int],
) -> list[np.ndarray]:
    """Covariance factors L (unknowns, any) of the unknowns c at the end of each pose of a run that starts at rest:

        L₀ = (S; 0; 1) start,     η = S c at rest,     from pose to pose   η ← S' c + Π (η − S c),   η̇ ← Π η̇

    Π maps body motion from the modes of one pose to those of the next, so that the change of pose causes no motion. benches,
    steps: per pose; readings: H of each; increment (unknowns,): σ per step, 0 for a constant; start (unknowns, any): initial
    factor of c; others: see `scenario_of`."""
    factors: list[np.ndarray] = []
    L = np.zeros((0, 0))
    for k, (bench, count) in enumerate(zip(benches, steps, strict=True)):
        r, rest = len(bench.stiffness), bench.B / bench.stiffness[:, None]
        if k == 0:
            L = np.vstack([rest @ start, np.zeros((r, start.shape[1])), start])
        else:
            before, felt = benches[k - 1], np.sqrt(bench.force)[:, None]
            over, c = np.linalg.lstsq(felt * bench.T, felt * before.T, rcond=None)[0], L[2 * len(before.stiffness) :]
            eta, rate = L[: len(before.stiffness)], L[len(before.stiffness) : 2 * len(before.stiffness)]
            swung = eta - before.B / before.stiffness[:, None] @ c
            L = np.vstack([rest @ c + over @ swung, over @ rate, c])
        A, N, scale = build_discrete_model(bench, acceleration, increment)
        H = readings[k] * scale / _column(noise)
        L = scale[:, None] * factor_after(A, H, N, L / scale[:, None], count)
        factors.append(L[2 * r :])
    return factors


def _column(noise: np.ndarray | float) -> np.ndarray:
    return np.atleast_1d(np.asarray(noise, dtype=float))[:, None]
