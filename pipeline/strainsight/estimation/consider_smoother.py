"""Smoother for filters with Schmidt-Kalman gains, with the actual variance of its estimate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from strainsight.estimation.parallel_filters import (
    KEPT,
    Data,
    Filters,
    LinearModels,
    States,
    advance,
    build_filters,
    concatenate,
)
from strainsight.estimation.update import covariance_factor, schmidt_gain, square_factor, symmetric, transpose

Start = tuple[np.ndarray, np.ndarray, np.ndarray]
"""x (B, n), P (n, n) and V (B, d, n) at t = 0."""
NEGLIGIBLE = 1e-8


def consider_smoothed(models: LinearModels, start: Start, data: Data) -> States:
    """x (B, T + 1, n) by all samples, P of what no constant explains of its error and V what one of each adds to it; without ν.

    The filter's error is w + V ν with gains K of Schmidt (`advance`), P the covariance of w, and its innovations are
    e = −H w⁻ + ε ν + noise, of covariance S. Going back from λ = 0, as Bierman does with gains of Kalman, for which C = P:

        x̂ˢ = x̂ + C λ,     λ⁻ = Jᵀλ + HᵀS⁻¹e,   J = I − K H,     λ ← Aᵀλ⁻

    λ is L w + N ν + u, u of the noises beyond, independent of w and of covariance U, and so

        L⁻ = JᵀL J − HᵀS⁻¹H,     N⁻ = JᵀN + HᵀS⁻¹ε,     U⁻ = JᵀU J + L⁻Q L⁻ᵀ + (JᵀL K + HᵀS⁻¹) R (…)ᵀ
        L ← AᵀL⁻A,   N ← AᵀN⁻,   U ← AᵀU⁻A,     Pˢ = (I + C L) P (I + C L)ᵀ + C U Cᵀ,   Vˢ = V + C N

    whatever the gains are. C = −(P Lᵀ + V Nᵀ)(L P Lᵀ + N Nᵀ + U)⁻¹ is the one of least variance with ν at its σ.
    start: x (B, n), P (n, n), V (B, d, n) at t = 0; the noise of the data has their discrepancy in it.
    Source: Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18 (1973)."""
    return concatenate([states for _, states, _ in smoothed_pieces(models, start, data)][::-1], axis=1)


def consider_errors(models: LinearModels, start: Start, data: Data, count: int, rng: np.random.Generator) -> np.ndarray:
    """Draws (B, count, T + 1, n) of −w of `consider_smoothed`, what no constant explains of x − x̂ˢ, as whole histories.

    Start, process and noise are drawn and taken through the gains of filter and smoother, whatever these are; of mean zero and
    of covariance P at every instant, and of that between instants which the smoother's errors have. Arguments as there.
    Source: Durbin and Koopman, Biometrika 89 (2002)."""
    pieces = [error for _, _, error in smoothed_pieces(models, start, data, count, rng)]
    return np.moveaxis(np.concatenate(pieces[::-1]), 0, 2)


def smoothed_pieces(
    models: LinearModels, start: Start, data: Data, count: int = 0, rng: np.random.Generator | None = None
) -> Iterator[tuple[slice, States, np.ndarray]]:
    """`consider_smoothed` piece by piece, the last first: the instants of a piece, the states there, and `count` draws
    (L, B, count, n) of their errors.

    Memory does not hold every covariance of a long record. The filters go through it once, and through each piece again, from
    where they stood when it began. Only the recursions of λ, N, L and U go step by step:

        [λ, N] ← [λ, N] J A + [e, ε] S⁻¹H A,     X = (J A)ᵀL,     L ← X J A − AᵀHᵀS⁻¹H A
        U ← (J A)ᵀU J A + M Mᵀ,     M = [X J Q^½ − AᵀHᵀS⁻¹H Q^½, (X K + AᵀHᵀS⁻¹) R^½]"""
    # filters move what they begin with
    filters = build_filters(models, start[0].copy(), start[1], start[2].copy(), consider=True)
    steps, (B, d, n) = len(data.samples), start[2].shape
    at_once = max(1, KEPT // models.kept_a_step)
    spans = [slice(t, min(t + at_once, steps)) for t in range(0, max(steps, 1), at_once)]

    def advanced(filters: Filters, span: slice) -> States:
        """Current states of the filters, and those after each step of a span, without ν."""
        parts = filters.copy().states, advance(models, filters, data.of(span), keep=True).states
        return concatenate([replace(part, nu=part.nu[..., :0], left=part.left[..., :0, :0]) for part in parts], axis=1)

    error = np.empty((steps + 1, B, count, n))
    innovation = np.zeros((B, steps, count, data.samples.shape[1]))
    before = []
    for span in spans:
        before.append(filters.copy())
        if rng is not None:
            _filter_errors(models, advanced(filters, span), span, data, error, innovation, rng)
        elif span.stop < steps:
            advance(models, filters, data.of(span), keep=False)
    adjoint, L, U = np.zeros((B, 1 + d + count, n)), np.zeros((B, n, n)), np.zeros((B, n, n))
    for span, begin in zip(spans[::-1], before[::-1], strict=True):
        states = advanced(begin, span)
        update, length = _updates(models, states, data.of(span)), span.stop - span.start
        JA, products, less, rows = _recursion(models, update)
        sources = [update.innovation[:, :, None], transpose(update.slope), innovation[:, span]]
        driven = np.concatenate(sources, axis=2) @ rows
        adjoints, Ls, Us = (np.empty((B, length, *each.shape[1:])) for each in (adjoint, L, U))
        for i in range(length - 1, -1, -1):
            adjoint = adjoint @ JA[:, i] + driven[:, i]
            back = transpose(JA[:, i])
            forward = back @ L @ products[:, i] - less[:, i]
            L, M = forward[..., :n], forward[..., n:]
            U = back @ U @ JA[:, i] + M @ transpose(M)
            adjoints[:, i], Ls[:, i], Us[:, i] = adjoint, L, U
        P, V = states.P[:, :length], states.V[:, :length]
        C = _gain(P, V, Ls, adjoints[:, :, 1 : 1 + d], Us)
        moved, left = adjoints @ transpose(C), np.eye(n) + C @ Ls
        states.x[:, :length] += moved[:, :, 0]
        V += moved[:, :, 1 : 1 + d]
        P[:] = symmetric(left @ P @ transpose(left) + C @ Us @ transpose(C))
        error[span] -= np.moveaxis(moved[:, :, 1 + d :], 0, 1)
        # the end of a piece is the beginning of the next one, but for the last
        instants = slice(span.start, span.stop + (span.stop == steps))
        yield instants, states.first(instants.stop - instants.start), error[instants]


def _filter_errors(
    models: LinearModels,
    states: States,
    span: slice,
    data: Data,
    error: np.ndarray,
    innovation: np.ndarray,
    rng: np.random.Generator,
) -> None:
    """Draws of x − x̂ of the filter with the constants as they are, into error (T + 1, B, count, n) and innovation (B, T, count,
    m) of a span; states: of the filter at its beginning and behind its steps."""
    B, count = error.shape[1:3]

    def sample(factors: list[np.ndarray]) -> np.ndarray:
        return np.stack([rng.standard_normal((count, factor.shape[1])) @ factor.T for factor in factors])

    walk = [covariance_factor(Q) for Q in models.Q]
    if span.start == 0:
        error[0] = sample([covariance_factor(P) for P in states.P[:, 0]])
    update = _updates(models, states, data.of(span))
    for i, t in enumerate(range(span.start, span.stop)):
        measured = np.isfinite(data.samples[t])
        ahead = error[t] @ transpose(models.A) + sample(walk)
        noise = rng.standard_normal((B, count, measured.sum())) * np.sqrt(data.noise[t, measured])
        innovation[:, t] = ahead @ transpose(update.H[:, i])
        innovation[:, t][..., measured] += noise
        error[t + 1] = ahead - innovation[:, t] @ transpose(update.K[:, i])


def _gain(P: np.ndarray, V: np.ndarray, L: np.ndarray, N: np.ndarray, U: np.ndarray) -> np.ndarray:
    """C (B, T, n, n), by way of Fᵀλ with F Fᵀ = P + V Vᵀ: its covariance is the share of the variance that the samples ahead
    explain in each direction, and less than NEGLIGIBLE of it is nothing. Any F gives the same C. P where there is no constant."""
    if V.shape[2] == 0:
        return P
    whole = P + transpose(V) @ V
    std = np.sqrt(np.maximum(np.diagonal(whole, axis1=2, axis2=3), 0.0))
    std = np.where(std > 0, std, 1.0)
    F = std[..., None] * _factor(whole / (std[..., None] * std[..., None, :]))
    information = transpose(F) @ (L @ P @ transpose(L) + transpose(N) @ N + U) @ F + NEGLIGIBLE * np.eye(P.shape[2])
    cross = (P @ transpose(L) + transpose(V) @ N) @ F
    return -transpose(np.linalg.solve(symmetric(information), transpose(cross))) @ transpose(F)


def _factor(P: np.ndarray) -> np.ndarray:
    """F with F Fᵀ = P (..., n, n) to rounding, P semidefinite with a diagonal of ones or zeros."""
    n = P.shape[-1]
    try:
        return np.linalg.cholesky(P + n * np.finfo(float).eps * np.eye(n))
    except np.linalg.LinAlgError:
        share, axes = np.linalg.eigh(P)
        return np.asarray(axes * np.sqrt(np.maximum(share, 0.0))[..., None, :])


@dataclass(frozen=True)
class _Updates:
    """Updates at the ends of T steps: K (B, T, n, m) as in `advance`, H (B, T, m, n), R (T, m), innovation (B, T, m), its slope ε
    (B, T, m, d) in ν, and rows S⁻¹H (B, T, m, n). A channel without a sample has zeros, and R = 1."""

    K: np.ndarray
    H: np.ndarray
    R: np.ndarray
    innovation: np.ndarray
    slope: np.ndarray
    rows: np.ndarray


def _updates(models: LinearModels, states: States, data: Data) -> _Updates:
    """Updates at the ends of T steps, from the filter states at their starts, the first T instants."""
    T, m = data.samples.shape
    x, P, V, e = states.x[:, :T], states.P[:, :T], states.V[:, :T], models.moving
    B, d, n, A, AT = models.count, models.considered_count, x.shape[2], models.A[:, None], transpose(models.A)
    ahead = x @ AT + data.known @ transpose(models.G)
    P, V = A @ P @ transpose(A) + models.Q[:, None], V @ transpose(A)
    A_nu, G_nu = models.A_nu.reshape(B, e * n, n), models.G_nu.reshape(B, e * n, data.known.shape[1])
    pushed = x @ transpose(A_nu) + data.known @ transpose(G_nu)
    V[:, :, :e] -= pushed.reshape(B, T, e, n)
    at = np.isfinite(data.samples)
    H, R = np.where(at[..., None], models.H[:, None], 0.0), np.where(at, data.noise, 1.0)
    sensed = ahead @ models.D.reshape(d * m, n).T + data.known_end @ models.E.reshape(d * m, data.known_end.shape[1]).T
    sensed = np.where(at[:, None], sensed.reshape(B, T, d, m) + models.offset, 0.0)
    slope = transpose(sensed - V @ transpose(H))
    S = H @ P @ transpose(H) + slope @ transpose(slope) + R[..., None] * np.eye(m)
    innovation = data.samples - (H @ ahead[..., None])[..., 0] - data.known_end @ transpose(models.F)
    K, rows = schmidt_gain(P, H, R, V, slope), np.linalg.solve(S, H)
    return _Updates(K, H, R, np.where(at, innovation, 0.0), slope, rows)


def _recursion(models: LinearModels, update: _Updates) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """J A (B, T, n, n) of T steps, [J A, J Q^½, K R^½] and what is subtracted from X times it, and S⁻¹H A (B, T, m, n)."""
    A, K, H = models.A[:, None], update.K, update.H
    Q, std = square_factor(models.Q), np.sqrt(update.R)[:, None]
    Q = Q[:, None][..., np.any(Q, axis=(0, 1))]
    J, rows = np.eye(A.shape[-1]) - K @ H, update.rows @ A
    JA, back = J @ A, transpose(rows)
    products = np.concatenate([JA, J @ Q, K * std], axis=3)
    return JA, products, np.concatenate([back @ (H @ A), back @ (H @ Q), -back * std], axis=3), rows
