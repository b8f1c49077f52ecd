"""The smoother of filters whose gains consider constants that nobody estimates, with the variance that it really has."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from strainsight.estimation.parallel_filters import (
    KEPT,
    Filters,
    LinearModels,
    States,
    advance,
    agree,
    filters_of,
    one_passage,
)
from strainsight.estimation.update import covariance_factor, symmetric, transposed

SAID = 1e-8


def consider_smoothed(
    models: LinearModels,
    start: tuple[np.ndarray, np.ndarray, np.ndarray],
    known: np.ndarray,
    known_end: np.ndarray,
    measurement: np.ndarray,
    noise: np.ndarray,
) -> States:
    """x (B, T + 1, n) by all samples, P of what no constant explains of its error and V what one of each adds to it.

    The filter's error is w + V ν with gains K of Schmidt (`advance`), P the covariance of w, and its innovations are
    e = −H w⁻ + ε ν + noise, of covariance S. Going back from λ = 0, as Bierman does with gains of Kalman, for which C = P:

        x̂ˢ = x̂ + C λ,     λ⁻ = Jᵀλ + HᵀS⁻¹e,   J = I − K H,     λ ← Aᵀλ⁻

    λ is L w + N ν + u, u of the noises beyond, independent of w and of covariance U, and so

        L⁻ = JᵀL J − HᵀS⁻¹H,     N⁻ = JᵀN + HᵀS⁻¹ε,     U⁻ = JᵀU J + L⁻Q L⁻ᵀ + (JᵀL K + HᵀS⁻¹) R (…)ᵀ
        L ← AᵀL⁻A,   N ← AᵀN⁻,   U ← AᵀU⁻A,     Pˢ = (I + C L) P (I + C L)ᵀ + C U Cᵀ,   Vˢ = V + C N

    whatever the gains are. C = −(P Lᵀ + V Nᵀ)(L P Lᵀ + N Nᵀ + U)⁻¹ is the one of least variance with ν at its σ.
    start: x (B, n), P (n, n), V (B, d, n) at t = 0; known (T, p), known_end (T, p₁), measurement (T, m) NaN where missing, noise
    (T, m) variances.
    Source: Bierman, Fixed interval smoothing with discrete measurements, Int. J. Control 18 (1973).
    """
    pieces = [own for _, own in smoothed_pieces(models, start, known, known_end, measurement, noise)]
    return one_passage(pieces[::-1])


def smoothed_pieces(
    models: LinearModels,
    start: tuple[np.ndarray, np.ndarray, np.ndarray],
    known: np.ndarray,
    known_end: np.ndarray,
    measurement: np.ndarray,
    noise: np.ndarray,
) -> Iterator[tuple[slice, States]]:
    """`consider_smoothed` piece by piece, the last first: the instants of a piece, and the states there.

    Memory does not hold every covariance of a long record. The filters go through it once, and through each piece again, from
    where they stood when it began. Arguments as there.
    """
    for instants, own, _ in _smoothed(models, start, known, known_end, measurement, noise, None):
        yield instants, own


def consider_errors(
    models: LinearModels,
    start: tuple[np.ndarray, np.ndarray, np.ndarray],
    known: np.ndarray,
    known_end: np.ndarray,
    measurement: np.ndarray,
    noise: np.ndarray,
    count: int,
    rng: np.random.Generator,
) -> np.ndarray:
    """Draws (B, count, T + 1, n) of −w of `consider_smoothed`, what no constant explains of x − x̂ˢ, as whole histories.

    Start, process and noise are drawn and taken through the gains of filter and smoother, whatever these are; of mean zero and
    of covariance P at every instant, and of that between instants which the smoother's errors have. Arguments as there.
    Source: Durbin and Koopman, Biometrika 89 (2002).
    """
    pieces = _smoothed(models, start, known, known_end, measurement, noise, (count, rng))
    found = np.concatenate([error for _, _, error in pieces][::-1])
    return np.moveaxis(found, 0, 2)


def _smoothed(
    models: LinearModels,
    start: tuple[np.ndarray, np.ndarray, np.ndarray],
    known: np.ndarray,
    known_end: np.ndarray,
    measurement: np.ndarray,
    noise: np.ndarray,
    drawing: tuple[int, np.random.Generator] | None,
) -> Iterator[tuple[slice, States, np.ndarray]]:
    """Pieces from the last to the first: instants, the smoother there, and draws (L, B, count, n) of its errors, of which there
    are none where none are drawn."""
    # filters move what they begin with
    filters = filters_of(models, start[0].copy(), start[1], start[2].copy(), consider=True)
    steps, more = len(known), np.zeros(measurement.shape[1])
    agree((known_end, (steps, *known_end.shape[1:])), (measurement, noise.shape), (noise, (steps, *noise.shape[1:])))
    at_once = max(1, KEPT // models.kept_a_step)
    spans = [slice(t, min(t + at_once, steps)) for t in range(0, max(steps, 1), at_once)]
    AT, (B, d, n) = transposed(models.A), start[2].shape

    def advanced(filters: Filters, span: slice, keep: bool) -> States:
        """From where the filters stand, through the steps of a span; kept: what they are at its beginning, too."""
        data = known[span], known_end[span], measurement[span], noise[span]
        first = [filters.copy().states] if keep else []
        return one_passage([*first, advance(models, filters, *data, more, keep).states])

    def update_at(t: int, own: States, i: int) -> _Update:
        """At the end of step t, from where the filters stand at its beginning."""
        return _update_at(
            models, own.x[:, i], own.P[:, i], own.V[:, i], known[t], known_end[t], measurement[t], noise[t]
        )

    count, rng = (0, np.random.default_rng(0)) if drawing is None else drawing
    error = np.empty((steps + 1, B, count, n))
    innovation = np.zeros((steps if count else 1, B, count, measurement.shape[1]))
    before = []
    for span in spans:
        before.append(filters.copy())
        if count:
            own = advanced(filters, span, keep=True)
            updates = (update_at(t, own, t - span.start) for t in range(span.start, span.stop))
            _filter_errors(models, own.P[:, 0], span, updates, measurement, error, innovation, rng)
        elif span.stop < steps:
            advanced(filters, span, keep=False)
    by_draws = np.zeros((B, count, n))
    adjoint, N, L, U = np.zeros((B, n)), np.zeros((B, d, n)), np.zeros((B, n, n)), np.zeros((B, n, n))
    for span, there in zip(spans[::-1], before[::-1], strict=True):
        own = advanced(there, span, keep=True)
        x, P, V = own.x, own.P, own.V
        for t in range(span.stop - 1, span.start - 1, -1):
            i = t - span.start
            spread, slope, update = P[:, i], V[:, i], update_at(t, own, i)
            K, H, rows = update.K, update.H, update.rows
            J = np.eye(n) - K @ H
            by_noise = transposed(J) @ L @ K + rows
            L = transposed(J) @ L @ J - rows @ H
            U = transposed(J) @ U @ J + L @ models.Q @ transposed(L) + (by_noise * update.R) @ transposed(by_noise)
            N = (N @ J + transposed(rows @ update.slope)) @ models.A
            adjoint = ((adjoint[:, None] @ J + transposed(rows @ update.innovation[..., None])) @ models.A)[:, 0]
            if count:
                seen = innovation[t][..., np.isfinite(measurement[t])]
                by_draws = (by_draws @ J + seen @ transposed(rows)) @ models.A
            L, U = AT @ L @ models.A, AT @ U @ models.A
            C = _gain(spread, slope, L, N, U)
            error[t] -= by_draws @ transposed(C)
            x[:, i] += (C @ adjoint[..., None])[..., 0]
            V[:, i] += N @ transposed(C)
            left = np.eye(n) + C @ L
            P[:, i] = symmetric(left @ spread @ transposed(left) + C @ U @ transposed(C))
        # the end of a piece is the beginning of the next one, but for the last
        instants = slice(span.start, span.stop + (span.stop == steps))
        yield instants, own.first(instants.stop - instants.start), error[instants]


def _filter_errors(
    models: LinearModels,
    first: np.ndarray,
    span: slice,
    updates: Iterable[_Update],
    measurement: np.ndarray,
    error: np.ndarray,
    innovation: np.ndarray,
    rng: np.random.Generator,
) -> None:
    """Draws of x − x̂ of the filter with the constants as they are, into error (T + 1, B, count, n) and innovation (T, B, count,
    m) of a span; at t = 0 from first (B, n, n)."""
    B, count = error.shape[1:3]

    def drawn(factors: list[np.ndarray]) -> np.ndarray:
        return np.stack([rng.standard_normal((count, own.shape[1])) @ own.T for own in factors])

    walk = [covariance_factor(own) for own in models.Q]
    if span.start == 0:
        error[0] = drawn([covariance_factor(own) for own in first])
    for t, update in zip(range(span.start, span.stop), updates, strict=True):
        there = np.isfinite(measurement[t])
        ahead = error[t] @ transposed(models.A) + drawn(walk)
        seen = ahead @ transposed(update.H) + rng.standard_normal((B, count, there.sum())) * np.sqrt(update.R)
        innovation[t][..., there] = seen
        error[t + 1] = ahead - seen @ transposed(update.K)


def _gain(P: np.ndarray, V: np.ndarray, L: np.ndarray, N: np.ndarray, U: np.ndarray) -> np.ndarray:
    """C (B, n, n), by way of Fᵀλ with F Fᵀ = P + V Vᵀ: its covariance is the share of the variance that the samples ahead explain
    in each direction, and less than SAID of it is nothing. P where there is no constant."""
    if V.shape[1] == 0:
        return P
    whole = P + transposed(V) @ V
    std = np.sqrt(np.maximum(np.diagonal(whole, axis1=1, axis2=2), 0.0))
    std = np.where(std > 0, std, 1.0)
    share, axes = np.linalg.eigh(whole / (std[:, :, None] * std[:, None]))
    F = std[:, :, None] * axes * np.sqrt(np.maximum(share, 0.0))[:, None]
    said = transposed(F) @ (L @ P @ transposed(L) + transposed(N) @ N + U) @ F + SAID * np.eye(P.shape[1])
    cross = (P @ transposed(L) + transposed(V) @ N) @ F
    return -transposed(np.linalg.solve(symmetric(said), transposed(cross))) @ transposed(F)


@dataclass(frozen=True)
class _Update:
    """By the k channels that measured: K (B, n, k) as `advance` takes it, rows H (B, k, n), R (k,), innovation (B, k), slope ε
    (B, k, d) of it in ν, and rows HᵀS⁻¹ (B, n, k)."""

    K: np.ndarray
    H: np.ndarray
    R: np.ndarray
    innovation: np.ndarray
    slope: np.ndarray
    rows: np.ndarray


def _update_at(
    models: LinearModels,
    own: np.ndarray,
    spread: np.ndarray,
    slope: np.ndarray,
    known: np.ndarray,
    known_end: np.ndarray,
    y: np.ndarray,
    R: np.ndarray,
) -> _Update:
    """At the end of a step from x (B, n), P and V of the filter."""
    AT, e = transposed(models.A), models.moving
    ahead = (models.A @ own[..., None])[..., 0] + models.G @ known
    slope_ahead = slope @ AT
    slope_ahead[:, :e] -= (models.A_nu @ own[:, None, :, None])[..., 0] + models.G_nu @ known
    return _update(models, ahead, models.A @ spread @ AT + models.Q, slope_ahead, known_end, y, R)


def _update(
    models: LinearModels, x: np.ndarray, P: np.ndarray, V: np.ndarray, known: np.ndarray, y: np.ndarray, R: np.ndarray
) -> _Update:
    """x (B, n), P and V as predicted."""
    there = np.isfinite(y)
    H = models.H[:, there]
    sensed = (models.D[:, there] @ x[:, None, :, None])[..., 0] + models.E[:, there] @ known + models.offset[:, there]
    slope = transposed(sensed - V @ transposed(H))
    S = H @ P @ transposed(H) + slope @ transposed(slope) + np.diag(R[there])
    K = transposed(np.linalg.solve(S, H @ P - slope @ V))
    innovation = y[there] - (H @ x[..., None])[..., 0] - models.F[:, there] @ known
    return _Update(K, H, R[there], innovation, slope, transposed(np.linalg.solve(S, H)))
