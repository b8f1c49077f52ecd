"""Standard deviation that a filter will claim along a known motion, without measurements, and its contributions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve
from scipy.linalg.lapack import dtpmqrt, dtpqrt, dtrtrs

from strainsight.estimation.conditional import MASS, ConsideredParameters, considers, inertia_std
from strainsight.estimation.error_steps import states_at, steps_along
from strainsight.estimation.model import FilterModel
from strainsight.estimation.record import Settled, start_errors
from strainsight.estimation.update import gain, joseph_update, predict, schmidt_gain, standard_deviation, transpose

NOISE, PROCESS, START = "noise", "process noise", "start"
"""Sources of uncertainty modelled by the filter; considered parameters have their own sources."""
WHITE = (NOISE, PROCESS, START)


@dataclass(frozen=True)
class ClaimedStd:
    """std (T + 1, B, n*) of x* for B sets of sensors; budget: source → its part (T + 1, n*) of the variance of the first set."""

    std: np.ndarray
    budget: Mapping[str, np.ndarray]

    def changed_by_mass(self, change: np.ndarray) -> ClaimedStd:
        """The claim with a change (k,) of the parameters, which x* ends with, by one σ of the masses that the model lacks."""
        std = np.zeros((len(self.std), self.std.shape[-1]))
        std[:, -len(change) :] = change
        return self.with_masses(std)

    def with_masses(self, std: np.ndarray) -> ClaimedStd:
        """The claim with σ (T + 1, n*) of x* by masses that the model lacks."""
        budget = {**self.budget, MASS: self.budget.get(MASS, 0.0) + std**2}
        return ClaimedStd(np.hypot(self.std, std[:, None]), budget)


def covariance_recursion(
    model: FilterModel,
    trajectory: np.ndarray,
    u: np.ndarray,
    covariance: np.ndarray,
    considered: ConsideredParameters | None = None,
    first: int = 0,
) -> ClaimedStd:
    """Standard deviation of x* that the extended filter will claim along a given motion, for B sets of sensors.

    The covariance recursion of `run_filter`, which needs no measurement, with A* and the rows along the motion at θ = guess
    (p = 0). With the same gains, the error per unit ν, as `parallel_filters.advance`, and the parts of P by source:

        V⁻ = A* V − (A_ν x + G_ν w),   V = V⁻ + K(D x + E w₁ + o − H* V⁻),   σ² = diag P + Σₖ Vₖ²
        P = P_R + P_Q + P_0,           P_s⁺ = (I − KH)(A* P_s A*ᵀ + Q_s)(I − KH)ᵀ + K R_s Kᵀ

    trajectory (T + 1, 2n) [q, q̇]; u (T, HOLD, n_u): hold coefficients of all inputs [N], unknown ones too; covariance (n*,
    n*) or (B, n*, n*) of x* at t = 0; considered parameters require sets that differ by their noise only: a missing channel
    has infinite noise; first: instant from which the claim is returned. Sources: Schmidt, Advances in Control Systems 3
    (1966); JCGM 100:2008 (GUM), section 5.1 (parts of a variance)."""
    source = () if considered is None else considered.sources(model.model.size)
    P, parts, Q = starts(model, covariance)
    errors = _Errors(P, np.zeros((len(P), len(source), model.size)), parts)
    variance, part = np.empty((len(u) + 1, *P.shape[:2])), np.empty((len(u) + 1, *parts.shape[:2]))
    shift = np.zeros((len(u) + 1, len(source), model.size))
    variance[0], part[0] = standard_deviation(P) ** 2, standard_deviation(parts) ** 2
    for k, step in enumerate(steps_along(model, trajectory, u, considered, len(P)), start=1):
        errors.predict(step.A, model.process, Q, step.pushed)
        if step.sampled:
            H, R = (step.H, step.variance) if source else few(step.H, step.variance)
            K, _ = gain(errors.P, H, R, step.instant)
            errors.update(K, H, R, step.read[:, : H.shape[-2]])
        variance[k] = standard_deviation(errors.P) ** 2 + np.sum(errors.V**2, axis=1)
        part[k], shift[k] = standard_deviation(errors.parts) ** 2, errors.V[0]
    budget = {name: part[first:, i] for i, name in enumerate(WHITE)}
    return ClaimedStd(np.sqrt(variance[first:]), budget | by_source(source, shift[first:]))


def starts(model: FilterModel, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P (B, n*, n*) at t = 0; its parts (3, n*, n*) by source in the first set, and their increments per step."""
    b = max(model.sets, len(covariance) if covariance.ndim == 3 else 1)
    P = np.broadcast_to(covariance, (b, model.size, model.size)).astype(float)
    parts, Q = np.zeros((2, len(WHITE), model.size, model.size))
    parts[WHITE.index(START)] = P[0]
    Q[WHITE.index(PROCESS)] = model.process if model.process.ndim == 2 else model.process[0]
    return P, parts, Q


def by_sensors(noise: np.ndarray) -> np.ndarray:
    """Variances (3, m) of the samples by source, of the first of (b, m)."""
    return noise[0] * np.eye(len(WHITE))[:, [WHITE.index(NOISE)]]


def by_source(source: tuple[str, ...], shift: np.ndarray) -> dict[str, np.ndarray]:
    """Variance (T, n*) of the considered parameters of each source; source (d,), shift (T, d, n*) per unit ν."""
    named = np.array(source)
    return {name: np.sum(shift[:, named == name] ** 2, axis=1) for name in dict.fromkeys(source)}


def few(H: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As many rows of unit noise as states with the same HᵀR⁻¹H = CᵀC, if there are more channels. H (m, n) or (b, m, n); R
    (b, m). Without measurements only that product matters."""
    if H.shape[-2] <= 2 * H.shape[-1]:
        return H, R
    whitened = H / np.sqrt(R)[..., None]
    C = np.asarray(np.linalg.qr(whitened, mode="r"))
    return C, np.ones(C.shape[:-1])


BLOCK = 16
"""Reflections per block."""


def predict_grid_std(
    model: FilterModel,
    trajectory: np.ndarray,
    u: np.ndarray,
    covariance: np.ndarray,
    considered: ConsideredParameters,
    settled: Settled | None = None,
    first: int = 0,
    by_mass: np.ndarray | None = None,
) -> ClaimedStd:
    """Standard deviation of x* = [s, p] that the grid filter will claim along a given motion, for B sets of sensors.

    Laplace's approximation of its posterior at the guess: of constants c = [ν, p] jointly with a Kalman filter of s = [q, q̇,
    ζ] with known constants. Errors are w + V c, and innovations e = ε c + white noise:

        V⁻ = A V − B,   ε = D − H V⁻,   V = V⁻ + K ε,        B = [A_ν x + G_ν w, ∂x⁺/∂p],   D = [D x + E w₁ + o, ∂y/∂p]
        Λ⁻¹ = RᵀR = Λ₀⁻¹ + Σ εᵀS⁻¹ε,                         ĉ = Λ Σ εᵀS⁻¹e = R⁻¹z

    σ_p² = Λ_pp, with unknown loads by free ones (`with_free_loads`). Then, or if gains consider ν, P and V of the states are
    those of a second filter with the configured loads. Motion and loads follow p̂, and ν̂ if it is `learned`:

        σ_s² = diag(P + V C Vᵀ),     C = Λ where ν is learned,   C = [[1, Λ_νp], [Λ_pν, Λ_pp]] otherwise

    Arguments and parts as in `covariance_recursion`, settled as in `filter_on_grid`. p is not correlated with s at t = 0.
    by_mass: change (T, m) of the readings by one σ of masses that the model lacks, if they change p: by Λ_pc Σ εᵀS⁻¹e, e the
    innovations of this change in the first set.
    Raises NumericalError if an innovation covariance is not positive definite. R and z use orthogonal factors: sums would
    lose the directions of confounded constants at small noise. Source: Friedland, IEEE Trans. Automatic Control 14 (1969);
    `parallel_filters.advance` and `Mixture` take the same steps."""
    source = considered.sources(model.model.size)
    covariance, V0 = start_errors(model, considered, covariance, settled)
    whole, parts, Q = starts(model, covariance)
    B, d, n = len(whole), len(source), model.parameter_states.start
    c = d + model.size - n
    prior = np.ones((B, c))
    prior[:, d:] = np.diagonal(whole, axis1=1, axis2=2)[:, n:]
    Q = Q[:, :n, :n]
    errors = _Errors(whole[:, :n, :n], np.tile(V0, (B, 1, 1)), parts[:, :n, :n])
    followed = _Followed(prior, 0 if considered.learned else d, n)
    free_loads = model.has_free_loads
    configured = model.process[:n, :n], Q
    if free_loads:
        free = model.with_free_loads(len(u))
        noise = free.process[:n, :n], starts(free, covariance)[2][:, :n, :n]
    else:
        noise = configured
    ahead = considers(model, considered)
    state_errors = _Errors(errors.P, errors.V, errors.parts) if ahead or free_loads else None
    # no filter for constants that the samples do not estimate
    estimates = followed.any or state_errors is None
    claimed = _Claimed(model.size, len(u) + 1 - first, source, followed)
    if first == 0:
        claimed.after(0, errors)
    off, on_constants = np.zeros(n), np.zeros(c)
    for k, step in enumerate(steps_along(model, trajectory, u, considered, B), start=1):
        A, pushed = step.A[:n, :n], np.concatenate([step.pushed[:, :n], step.A[:n, n:].T])
        if estimates:
            errors.predict(A, *noise, pushed)
            followed.predict(A)
            off = A @ off
        if state_errors is not None:
            state_errors.predict(A, *configured, pushed)
        if step.sampled:
            H, R = step.H[..., :n], step.variance
            read = np.broadcast_to(transpose(step.H[..., n:]), (B, c - d, H.shape[-2]))
            read = np.concatenate([np.broadcast_to(step.read, (B, *step.read.shape)), read], axis=1)
            if estimates:
                K, L = gain(errors.P, H, R, step.instant)
                slope = errors.slope(H, read)
                followed.update(errors.parts, K[0], L, H[0], by_sensors(R), slope)
                if by_mass is not None:
                    e = by_mass[k - 1] - H[0] @ off
                    on_constants += slope[0] @ cho_solve((L[0], True), e)
                    off = off + K[0] @ e
                errors.update(K, H, R, read)
            if state_errors is not None:
                gaining = slice(d if ahead else 0)
                slope = transpose(state_errors.slope(H, read)[:, gaining])
                state_errors.update(schmidt_gain(state_errors.P, H, R, state_errors.V[:, gaining], slope), H, R, read)
        if k >= first:
            claimed.after(k - first, errors if state_errors is None else state_errors, state_errors is not None)
    claim = _with_inertia(claimed.claim(), model, considered, trajectory, u, first)
    return claim if by_mass is None else claim.changed_by_mass(followed.covariance()[0][0, :, d - c :].T @ on_constants)


class _Errors:
    """Errors w + V c of a filter. P (B, n, n): covariance of w; parts (3, n, n) by source in the first set; V (B, c, n)."""

    def __init__(self, P: np.ndarray, V: np.ndarray, parts: np.ndarray):
        self.P, self.V, self.parts = P, V, parts

    def predict(self, A: np.ndarray, process: np.ndarray, Q: np.ndarray, pushed: np.ndarray) -> None:
        """process: increment of P per step, Q (3, n, n) of its parts."""
        self.P, self.parts, self.V = predict(self.P, A, process), predict(self.parts, A, Q), self.V @ A.T - pushed

    def slope(self, H: np.ndarray, read: np.ndarray) -> np.ndarray:
        """Slope ε (B, c, m) of an innovation in c; read: of the readings."""
        return np.asarray(read - self.V @ transpose(H))

    def update(self, K: np.ndarray, H: np.ndarray, R: np.ndarray, read: np.ndarray) -> None:
        """Update with any gain K (B, n, m)."""
        self.V = self.V + self.slope(H, read) @ transpose(K)
        self.P = joseph_update(self.P, K, H, R)
        self.parts = joseph_update(self.parts, K[:1], H[:1], by_sensors(R))


class _Followed:
    """Information of the samples on c constants, of which those from `first` on are estimated. root R (B, c, c); z (3, c, c):
    covariance of z at c = 0 by source in the first set; across (3, n, c): its covariance with w."""

    def __init__(self, prior: np.ndarray, first: int, n: int):
        self.prior, self.first, c = prior, first, prior.shape[1]
        self.root = np.eye(c) / np.sqrt(prior[:, None])
        self.z, self.across = np.zeros((len(WHITE), c, c)), np.zeros((len(WHITE), n, c))

    @property
    def any(self) -> bool:
        return self.first < len(self.root[0])

    def predict(self, A: np.ndarray) -> None:
        if self.any:
            self.across = A @ self.across

    def update(
        self, parts: np.ndarray, K: np.ndarray, L: np.ndarray, H: np.ndarray, R: np.ndarray, slope: np.ndarray
    ) -> None:
        """[R; L⁻¹ε] = Q [R⁺; 0],   [z⁺; ·] = Qᵀ[z; L⁻¹(v − H w)]: its covariance, and that with w⁺ = (1 − K H) w + K v. parts
        (3, n, n) before the update, K (n, m), H (m, n), R (3, m) variance of v by source, slope ε (B, c, m)."""
        if not self.any:
            return
        whitened = np.linalg.solve(L, transpose(slope))
        factors = [
            dtpqrt(0, min(BLOCK, root.shape[1]), root, rows)[:3] for root, rows in zip(self.root, whitened, strict=True)
        ]
        self.root, c = np.stack([root for root, _, _ in factors]), whitened.shape[2]
        reflections, blocks = factors[0][1:]

        def turn(X: np.ndarray) -> np.ndarray:
            """The first c rows of Qᵀ X of every source, X (3, c + m, k), Q of the first set."""
            columns = X.transpose(1, 0, 2).reshape(X.shape[1], -1)
            turned = dtpmqrt(0, reflections, blocks, columns[:c], columns[c:], side="L", trans="T")[0]
            return np.asarray(turned.reshape(c, *X.shape[::2]).transpose(1, 0, 2))

        w, left, noise = parts @ H.T, np.eye(len(K)) - K @ H, R[:, :, None] * np.eye(R.shape[1])
        white = np.linalg.inv(L[0])
        z_e = -transpose(white @ (H @ self.across))
        e = white @ (H @ w + noise) @ white.T
        whole = np.concatenate(
            [np.concatenate([self.z, z_e], axis=2), np.concatenate([transpose(z_e), e], axis=2)], axis=1
        )
        w_e = (K @ noise - left @ w) @ white.T
        self.z = turn(transpose(turn(whole)))
        self.across = transpose(turn(transpose(np.concatenate([left @ self.across, w_e], axis=2))))

    def covariance(self) -> tuple[np.ndarray, np.ndarray]:
        """Λ (B, c, f) of all constants with the estimated ones, and T (B, f, f): ĉ = T z of these. R is triangular."""
        ends = np.eye(len(self.root[0]))[:, self.first :]
        columns = (
            np.stack([dtrtrs(root, ends)[0] for root in self.root])
            if self.any
            else np.tile(ends, (len(self.root), 1, 1))
        )
        tail = columns[:, self.first :]
        return columns @ transpose(tail), tail


class _Claimed:
    """Variances of x* and their parts in the first set at each instant."""

    def __init__(self, size: int, instants: int, source: tuple[str, ...], followed: _Followed):
        sets, constants = followed.prior.shape
        self.source, self.followed = source, followed
        self.std = np.empty((instants, sets, size))
        self.white = np.empty((instants, len(WHITE), size))
        self.constant = np.empty((instants, constants, size))

    def after(self, k: int, errors: _Errors, separate: bool = False) -> None:
        """Add instant k; separate: whether the states come from a second filter, whose correlation with z the grid filter
        neglects."""
        P, V, followed = errors.P, errors.V, self.followed
        n, d, first = P.shape[-1], len(self.source), followed.first
        at, prior = slice(first, None), np.sqrt(followed.prior[0])
        between, tail = followed.covariance()
        # V C Vᵀ: what is not followed has a C of ones
        free, along = V[:, :first], V[:, at]
        shared = 2 * transpose(between[:, :first]) @ free + between[:, at] @ along
        variance = np.diagonal(P, axis1=1, axis2=2) + np.sum(free**2, axis=1) + np.sum(shared * along, axis=1)
        self.std[k, :, :n] = np.sqrt(np.maximum(variance, 0.0))
        p = slice(tail.shape[1] - (V.shape[1] - d), None)
        self.std[k, :, n:] = standard_deviation(between[:, at])[:, p]
        # what the estimate of c makes of z, and of c itself; ν that is not learned is taken to be nothing
        on_z, z = along[0].T @ tail[0], followed.z[:, at, at]
        white = np.diagonal(errors.parts, axis1=1, axis2=2) + np.sum((on_z @ z) * on_z, axis=-1)
        if not separate:
            white = white - 2 * np.sum(followed.across[:, :, at] * on_z, axis=-1)
        self.white[k, :, :n] = np.maximum(white, 0.0)
        self.white[k, :, n:] = np.maximum(np.sum((tail[0, p] @ z) * tail[0, p], axis=-1), 0.0)
        scaled = between[0] / prior[:, None]
        self.constant[k, :, :n] = scaled @ along[0]
        self.constant[k, :first, :n] += free[0]
        self.constant[k, :, n:] = scaled[:, p]

    def claim(self) -> ClaimedStd:
        d = len(self.source)
        budget = {name: self.white[:, i] for i, name in enumerate(WHITE)}
        budget[START] = budget[START] + np.sum(self.constant[:, d:] ** 2, axis=1)
        return ClaimedStd(self.std, budget | by_source(self.source, self.constant[:, :d]))


def _with_inertia(
    claim: ClaimedStd, model: FilterModel, considered: ConsideredParameters, x: np.ndarray, u: np.ndarray, first: int
) -> ClaimedStd:
    """The claim with the inertia at unknown loads; x (T + 1, 2n), u (T, HOLD, n_u) and first as in `predict_grid_std`."""
    loads = np.concatenate([u[:1, 0], u.sum(axis=1)])
    mean = np.zeros((len(x), model.size))
    mean[:, : model.parameter_states.start] = states_at(model, x, loads)
    inertia = inertia_std(model, considered, mean, loads[:, model.columns[1]])[first:]
    return claim.with_masses(inertia) if inertia.any() else claim
