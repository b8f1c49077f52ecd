"""A steel cantilever in bending about both axes (Hermite elements, modes and tip statics) and its pool of gauges."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations

import mpmath
import numpy as np
import pytest
from scipy.linalg import eigh, matrix_balance, solve_continuous_lyapunov

from strainsight.fem.affine import AffineOperator
from strainsight.loads.input_models import Unknowns
from strainsight.loads.linearisation import gauge_intensity, linearise, process_intensity
from strainsight.placement.scenario import Scenario, solve_pool
from strainsight.rom.model import Damping, ReducedModel

from ..structures import beam_curvature, beam_matrices, clamped_beam
from .whole_pools import augment_rows, whole_pool_weight

E0, RHO0, LENGTH, WIDTH, HEIGHT = 2.0e11, 7850.0, 2.0, 0.10, 0.20


@dataclass(frozen=True, eq=False)
class Beam:
    model: ReducedModel
    rows: np.ndarray
    x: np.ndarray
    u: np.ndarray
    theta: dict[str, float]


@cache
def beam_of(
    gauges: int,
    modes: int = 10,
    *,
    frequency: float = 20.0,
    seed: int = 0,
    ratio: float = 0.01,
    foundation: float = 0.0,
) -> Beam:
    """`gauges` on the top and bottom faces; tip loads Fz (sine at `frequency`, 1e4 N) and Fy (40 Hz, 1e3 N)."""
    elements = 24
    inertia = WIDTH * HEIGHT**3 / 12, HEIGHT * WIDTH**3 / 12
    (Kz, Mz), (Ky, My) = (map(clamped_beam, beam_matrices(elements, LENGTH, own, WIDTH * HEIGHT)) for own in inertia)
    o = np.zeros_like(Kz)
    K, M = np.block([[Kz, o], [o, Ky]]), np.block([[Mz, o], [o, My]])
    spring = foundation * np.eye(len(K))
    S = np.zeros((len(K), 2))
    S[2 * elements - 2, 0] = S[len(Kz) + 2 * elements - 2, 1] = 1.0
    Kr, Mr = E0 * K + spring, RHO0 * M
    _, shapes = eigh(Kr, Mr, subset_by_index=(0, modes - 1))
    Psi = np.hstack([shapes, np.linalg.solve(Kr, S[:, :1])])
    Psi /= np.sqrt(np.sum(Psi * (Kr @ Psi), axis=0))
    lam, V = eigh(Psi.T @ Kr @ Psi, Psi.T @ Mr @ Psi)
    Psi = Psi @ V
    model = ReducedModel(
        mass=AffineOperator(0 * M, {"rho": M}).project(Psi),
        stiffness=AffineOperator(spring, {"E": K}).project(Psi),
        input_shape=Psi.T @ S,
        inputs=("Fz", "Fy"),
        reference={"E": E0, "rho": RHO0},
        damping=Damping("modal", ratio=ratio),
    )
    rng = np.random.default_rng(seed)
    place = rng.uniform(0.02, 1.95, gauges)
    z, y = rng.choice([-1, 1], gauges) * HEIGHT / 2, rng.uniform(-1, 1, gauges) * WIDTH / 2
    bend = beam_curvature(place, elements, LENGTH)
    rows = np.hstack([-z[:, None] * bend, -y[:, None] * bend]) @ Psi
    t = np.linspace(0, 1, 2001)
    omega = 2 * np.pi * np.array([frequency, 40.0])
    x = np.zeros((len(t), 2 * model.size))
    for j, force in enumerate((1e4, 1e3)):
        gain = model.input_shape[:, j] * force / (lam - omega[j] ** 2 + 2j * ratio * omega[j] * np.sqrt(lam))
        wave = gain * np.exp(1j * omega[j] * t)[:, None]
        x += np.hstack([wave.imag, (1j * omega[j] * wave).imag])
    u = np.column_stack([1e4 * np.sin(omega[0] * t), 1e3 * np.sin(omega[1] * t)])
    for shared in (rows, x, u):
        shared.flags.writeable = False
    return Beam(model, rows, x, u, {"E": E0, "rho": RHO0})


@cache
def scenarios_of(
    beam: Beam,
    inputs: tuple[str, ...],
    parameters: tuple[str, ...],
    *,
    instants: tuple[int, ...] = (63,),
    noise: float = 1e-6,
    h: float = 5e-4,
) -> tuple[Scenario, ...]:
    unknowns = Unknowns(inputs, parameters, {"Fz": 1e4, "Fy": 1e3}, beam.theta)
    F = linearise(beam.model, unknowns, beam.theta, beam.x[list(instants)], beam.u[list(instants)])
    Q = process_intensity(beam.model.size, unknowns, {"Fz": 20.0, "Fy": 40.0}, {"E": 0.05, "rho": 0.05}, kappa=0.1)
    H = augment_rows(beam.rows, unknowns)
    r = gauge_intensity(np.full(len(H), noise), h)
    weight = whole_pool_weight([Scenario(f, Q, H, r, np.zeros(len(Q))) for f in F], last(len(Q), unknowns.count))
    return tuple(Scenario(f, Q, H, r, weight) for f in F)


def blind_sideways(beam: Beam, scenario: Scenario, gauges: np.ndarray) -> Scenario:
    """Those gauges read nothing of the motion that Fy drives."""
    H, shape = scenario.H.copy(), np.abs(beam.model.input_shape)
    H[np.ix_(gauges, np.flatnonzero(shape[:, 1] > 1e-6 * shape.max()))] = 0.0
    return replace(scenario, H=H)


COMBINED = {"mean": np.mean, "worst": np.max}


def pools_of(H, levels, weight):
    """Unknowns that wander, ẋ = w and y = H x + v, a pool a scenario: H (scenarios, pool, unknowns) at unit noise, q of each
    scenario, W (unknowns,). P = √q G^(−1/2) for Q = q I and G = Hᵀ R⁻¹ H."""
    n = H.shape[2]
    return [
        solve_pool(Scenario(np.zeros((n, n)), q * np.eye(n), h, np.ones(len(h)), weight))
        for h, q in zip(H, levels, strict=True)
    ]


def costs_of(H, levels, weight, v):
    """tr(W P) of every scenario with gauge weights v (pool,); inf where G is singular."""
    found = []
    for h, q in zip(H, levels, strict=True):
        lam, U = np.linalg.eigh((h.T * v) @ h)
        told = lam[0] > 1e-9 * lam[-1]
        found.append(np.sqrt(q) * weight @ (U**2 / np.sqrt(lam)).sum(axis=1) if told else np.inf)
    return np.array(found)


def last(size: int, count: int) -> np.ndarray:
    """Indices of the last states, where the unknowns are."""
    return np.arange(size - count, size)


def with_accelerometers(scenario: Scenario, modes: int, precision: float) -> Scenario:
    """Two accelerometers beside the strain gauges, their noise so many times what one unit of the unknowns makes them read."""
    H = np.random.default_rng(3).normal(size=(2, modes)) @ scenario.F[modes : 2 * modes]
    r = (precision * np.linalg.norm(H[:, 2 * modes :], axis=1)) ** 2 * 5e-4
    return replace(scenario, H=np.vstack([scenario.H, H]), r=np.concatenate([scenario.r, r]))


def residual(scenario: Scenario, P: np.ndarray) -> float:
    """The relative residual of (5.14), gauge by gauge."""
    F, Q = scenario.F, scenario.Q
    PGP = sum(np.outer(P @ h, P @ h) / r for h, r in zip(scenario.H, scenario.r, strict=True))
    defect = F @ P + P @ F.T + Q - PGP
    return np.linalg.norm(defect) / (2 * np.linalg.norm(F @ P) + np.linalg.norm(Q) + np.linalg.norm(PGP))


LOST = 1e100


def oracle(scenario: Scenario, gauges: list[int]) -> np.ndarray:
    """P by the matrix sign function of the Hamiltonian, sharpened by two Kleinman steps with SciPy's Lyapunov solver.

    Source: Roberts (1980), scaled as in Byers (1987). SciPy's own Riccati solver gives up on some of these systems. Of gauges
    that detect an unknown next to not at all the sign is all rounding, and its filter not stable: they are worth `LOST`.
    """
    F, Q = scenario.F, scenario.Q
    H, r = scenario.H[gauges].reshape(-1, len(F)), scenario.r[gauges].ravel()
    n, G = len(F), (H.T / r) @ H
    s = np.sqrt(np.linalg.norm(G) / np.linalg.norm(Q))
    Z = np.block([[F.T, -G / s], [-s * Q, -F]])
    for _ in range(60):
        inverse = np.linalg.inv(Z)
        c = np.sqrt(np.linalg.norm(inverse) / np.linalg.norm(Z))
        new = 0.5 * (c * Z + inverse / c)
        change, Z = np.linalg.norm(new - Z), new
        if change < 1e-12 * np.linalg.norm(Z):
            break
    left = np.vstack([Z[:n, n:], Z[n:, n:] + np.eye(n)])
    right = -np.vstack([Z[:n, :n] + np.eye(n), Z[n:, :n]])
    P = np.linalg.lstsq(left, right, rcond=None)[0] / s
    for _ in range(2):
        gain = P @ (H.T / r)
        if np.linalg.eigvals(F - gain @ H).real.max() >= 0:
            return LOST * np.eye(n)
        P = solve_continuous_lyapunov(F - gain @ H, -Q - (gain * r) @ gain.T)
        P = 0.5 * (P + P.T)
    return P


exact = np.vectorize(mpmath.mpf, otypes=[object])


def covariance_in_digits(F, Q, H, r, start) -> np.ndarray:
    """P with the residual of (5.14) in multiple precision, brought to nothing by corrections in double precision, to 1e-45.

        A Δ + Δ Aᵀ = −(F P + P Fᵀ + Q − P G P),   A = F − P G stable,   P ← P + Δ

    start: a covariance in double precision, in whose coordinates of unit diagonal this is done; the floor is for motions
    that no process noise reaches.
    """
    _, (unit, _) = matrix_balance(F, permute=False, separate=True)
    variance = np.diag(start) / unit**2
    d = exact(unit * np.sqrt(np.maximum(variance, 1e-16 * variance.max())))
    F, Q, H, r = exact(F) / d[:, None] * d, exact(Q) / d[:, None] / d, exact(H) * d, exact(r)
    P = exact(start) / d[:, None] / d
    f, g = F.astype(float), (H.T.dot(H / r[:, None])).astype(float)
    for _ in range(40):
        PH, FP = P.dot(H.T), F.dot(P)
        residual = FP + FP.T + Q - (PH / r).dot(PH.T)
        size = np.abs(residual).max()
        step = solve_continuous_lyapunov(f - P.astype(float) @ g, -(residual / size).astype(float))
        P = P + exact(0.5 * (step + step.T)) * size
        change = float(np.abs(step).max()) * size
        if change < mpmath.mpf("1e-45"):
            break
    else:
        raise AssertionError(f"fifty digits were not reached: {mpmath.nstr(change, 3)}")
    assert np.linalg.eigvals(f - P.astype(float) @ g).real.max() < 0
    return P * d[:, None] * d


@cache
def traces(digest: bytes) -> dict[tuple[int, ...], float]:
    """tr(W P) of sets of gauges of one scenario, as far as they have been asked for."""
    return {}


def every_set(pools, keep: int, aggregate: str = "mean") -> dict[tuple[int, ...], float]:
    """{gauges: tr(W P)} of all sets of so many gauges, by the oracle; each is computed once a session."""
    every, each = list(combinations(range(len(pools[0].rows)), keep)), []
    for s in (pool.scenario for pool in pools):
        known = traces(b"".join(X.tobytes() for X in (s.F, s.Q, s.H, s.r, s.weight)))
        known |= {g: s.weight @ np.diag(oracle(s, list(g))) for g in every if g not in known}
        each.append(known)
    return {gauges: float(COMBINED[aggregate]([known[gauges] for known in each])) for gauges in every}


@pytest.fixture
def six_loads():
    """Six oscillators with a load each; rosettes 1 and 2 read all six, but badly, 0, 3 and 4 two or three of them well."""
    modes = 6
    size, stiffness = 3 * modes, np.arange(1, modes + 1) ** 2.0
    F = np.zeros((size, size))
    F[:modes, modes : 2 * modes] = np.eye(modes)
    F[modes : 2 * modes] = np.hstack([-np.diag(stiffness), -0.2 * np.eye(modes), np.diag(stiffness)])
    H = np.eye(size)[[(0, 1, 3), (0, 1, 2), (3, 4, 5), (2, 4, 0), (5, 1, 2)]]
    r = np.repeat([[1e-3], [1.0], [1.0], [1e-3], [1e-3]], 3, axis=1)
    return Scenario(F, np.diag(np.repeat([0, 0.01, 0.1], modes)), H, r, np.repeat([0.0, 0, 1], modes))
