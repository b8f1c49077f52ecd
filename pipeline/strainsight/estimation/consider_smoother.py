"""Smoother for filters with Schmidt-Kalman gains, with the actual variance of its estimate."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

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
from strainsight.estimation.update import covariance_factor, schmidt_gain, symmetric, transpose

Start = tuple[np.ndarray, np.ndarray, np.ndarray]
"""x (B, n), P (n, n) and V (B, d, n) at t = 0."""
NEGLIGIBLE = 1e-8


def consider_smoothed(models: LinearModels, start: Start, data: Data) -> States:
    """x (B, T + 1, n) by all samples, P of what no constant explains of its error and V what one of each adds to it.

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
    where they stood when it began."""
    # filters move what they begin with
    filters = build_filters(models, start[0].copy(), start[1], start[2].copy(), consider=True)
    steps, m = data.samples.shape
    at_once = max(1, KEPT // models.kept_a_step)
    spans = [slice(t, min(t + at_once, steps)) for t in range(0, max(steps, 1), at_once)]
    AT, (B, d, n) = transpose(models.A), start[2].shape

    def advanced(filters: Filters, span: slice) -> States:
        """Current states of the filters, and those after each step of a span."""
        first = filters.copy().states
        return concatenate([first, advance(models, filters, data.of(span), keep=True).states], axis=1)

    error = np.empty((steps + 1, B, count, n))
    innovation = np.zeros((steps if count else 1, B, count, m))
    before = []
    for span in spans:
        before.append(filters.copy())
        if rng is not None:
            _filter_errors(models, advanced(filters, span), span, data, error, innovation, rng)
        elif span.stop < steps:
            advance(models, filters, data.of(span), keep=False)
    by_draws = np.zeros((B, count, n))
    adjoint, N, L, U = np.zeros((B, n)), np.zeros((B, d, n)), np.zeros((B, n, n)), np.zeros((B, n, n))
    for span, begin in zip(spans[::-1], before[::-1], strict=True):
        states = advanced(begin, span)
        x, P, V = states.x, states.P, states.V
        for t in range(span.stop - 1, span.start - 1, -1):
            i = t - span.start
            spread, slope, update = P[:, i], V[:, i], _update_at(models, states, i, data, t)
            K, H, rows = update.K, update.H, update.rows
            J = np.eye(n) - K @ H
            by_noise = transpose(J) @ L @ K + rows
            L = transpose(J) @ L @ J - rows @ H
            U = transpose(J) @ U @ J + L @ models.Q @ transpose(L) + (by_noise * update.R) @ transpose(by_noise)
            N = (N @ J + transpose(rows @ update.slope)) @ models.A
            adjoint = ((adjoint[:, None] @ J + transpose(rows @ update.innovation[..., None])) @ models.A)[:, 0]
            if count:
                sampled = innovation[t][..., np.isfinite(data.samples[t])]
                by_draws = (by_draws @ J + sampled @ transpose(rows)) @ models.A
            L, U = AT @ L @ models.A, AT @ U @ models.A
            C = _gain(spread, slope, L, N, U)
            error[t] -= by_draws @ transpose(C)
            x[:, i] += (C @ adjoint[..., None])[..., 0]
            V[:, i] += N @ transpose(C)
            left = np.eye(n) + C @ L
            P[:, i] = symmetric(left @ spread @ transpose(left) + C @ U @ transpose(C))
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
    """Draws of x − x̂ of the filter with the constants as they are, into error (T + 1, B, count, n) and innovation (T, B, count,
    m) of a span; states: of the filter at its beginning and behind its steps."""
    B, count = error.shape[1:3]

    def sample(factors: list[np.ndarray]) -> np.ndarray:
        return np.stack([rng.standard_normal((count, factor.shape[1])) @ factor.T for factor in factors])

    walk = [covariance_factor(Q) for Q in models.Q]
    if span.start == 0:
        error[0] = sample([covariance_factor(P) for P in states.P[:, 0]])
    for t in range(span.start, span.stop):
        update, measured = _update_at(models, states, t - span.start, data, t), np.isfinite(data.samples[t])
        ahead = error[t] @ transpose(models.A) + sample(walk)
        noise = rng.standard_normal((B, count, measured.sum())) * np.sqrt(update.R)
        innovation[t][..., measured] = ahead @ transpose(update.H) + noise
        error[t + 1] = ahead - innovation[t][..., measured] @ transpose(update.K)


def _gain(P: np.ndarray, V: np.ndarray, L: np.ndarray, N: np.ndarray, U: np.ndarray) -> np.ndarray:
    """C (B, n, n), by way of Fᵀλ with F Fᵀ = P + V Vᵀ: its covariance is the share of the variance that the samples ahead explain
    in each direction, and less than NEGLIGIBLE of it is nothing. P where there is no constant."""
    if V.shape[1] == 0:
        return P
    whole = P + transpose(V) @ V
    std = np.sqrt(np.maximum(np.diagonal(whole, axis1=1, axis2=2), 0.0))
    std = np.where(std > 0, std, 1.0)
    share, axes = np.linalg.eigh(whole / (std[:, :, None] * std[:, None]))
    F = std[:, :, None] * axes * np.sqrt(np.maximum(share, 0.0))[:, None]
    information = transpose(F) @ (L @ P @ transpose(L) + transpose(N) @ N + U) @ F + NEGLIGIBLE * np.eye(P.shape[1])
    cross = (P @ transpose(L) + transpose(V) @ N) @ F
    return -transpose(np.linalg.solve(symmetric(information), transpose(cross))) @ transpose(F)


@dataclass(frozen=True)
class _Update:
    """Update by the k channels with a sample: K (B, n, k) as in `advance`, rows H (B, k, n), R (k,), innovation (B, k), its
    slope ε (B, k, d) in ν, and rows HᵀS⁻¹ (B, n, k)."""

    K: np.ndarray
    H: np.ndarray
    R: np.ndarray
    innovation: np.ndarray
    slope: np.ndarray
    rows: np.ndarray


def _update_at(models: LinearModels, states: States, i: int, data: Data, t: int) -> _Update:
    """Update at the end of step t, from the filter states at its start, entry i."""
    x, AT, e = states.x[:, i], transpose(models.A), models.moving
    known, known_end, y = data.known[t], data.known_end[t], data.samples[t]
    ahead = (models.A @ x[..., None])[..., 0] + models.G @ known
    P, V = models.A @ states.P[:, i] @ AT + models.Q, states.V[:, i] @ AT
    V[:, :e] -= (models.A_nu @ x[:, None, :, None])[..., 0] + models.G_nu @ known
    at = np.isfinite(y)
    H, R = models.H[:, at], data.noise[t, at]
    sensed = (models.D[:, at] @ ahead[:, None, :, None])[..., 0] + models.E[:, at] @ known_end + models.offset[:, at]
    slope = transpose(sensed - V @ transpose(H))
    K = schmidt_gain(P, H, R, V, slope)
    S = H @ P @ transpose(H) + slope @ transpose(slope) + np.diag(R)
    innovation = y[at] - (H @ ahead[..., None])[..., 0] - models.F[:, at] @ known_end
    return _Update(K, H, R, innovation, slope, transpose(np.linalg.solve(S, H)))
