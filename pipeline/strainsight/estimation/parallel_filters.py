"""Linear Kalman filters side by side, each of a model of its own, on one measurement: the inner loop of the bank.

Plain loops that numba compiles: they take the same steps on every processor, and a step of twenty-odd states in microseconds.
One file, because the compiled code that numba keeps on disk does not notice a change in another file.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numba import njit

UNMOVED, CALM = 1e-13, 20
"""A covariance is steady after CALM steps in which no entry moved by more than UNMOVED of its standard deviations."""


@dataclass(frozen=True)
class LinearModels:
    """B models  x⁺ = A x + G w + Σₖ νₖ(Aₖx + Gₖw) + noise,   y = H x + F w₁ + Σₖ νₖ(Dₖx + Eₖw₁ + oₖ) + noise

    of one size. ν are d constants that no filter estimates, of mean zero and variance one; the first e of them change the motion.
    A (B, n, n); G (B, n, p) of what is known, w (T, p) in a step; Q (B, n, n) covariance of a step; H (B, m, n); F (B, m, p₁) of
    what is known at its end, w₁ (T, p₁); A_ν (B, e, n, n), G_ν (B, e, n, p); D (d, m, n), E (d, m, p₁), o (d, m).
    """

    A: np.ndarray
    G: np.ndarray
    Q: np.ndarray
    H: np.ndarray
    F: np.ndarray
    A_nu: np.ndarray
    G_nu: np.ndarray
    D: np.ndarray
    E: np.ndarray
    offset: np.ndarray

    def __post_init__(self) -> None:
        (B, m, n), p, p1, e = self.H.shape, self.G.shape[-1], self.F.shape[-1], self.A_nu.shape[1]
        d = len(self.D)
        _agree(
            (self.A, (B, n, n)),
            (self.G, (B, n, p)),
            (self.Q, (B, n, n)),
            (self.F, (B, m, p1)),
            (self.A_nu, (B, e, n, n)),
            (self.G_nu, (B, e, n, p)),
            (self.D, (d, m, n)),
            (self.E, (d, m, p1)),
            (self.offset, (d, m)),
        )

    @property
    def count(self) -> int:
        return len(self.A)

    @property
    def nuisances(self) -> int:
        return len(self.D)


def _agree(*sized: tuple[np.ndarray, tuple[int, ...]]) -> None:
    """Raises ValueError where an array has not the shape that it should have: compiled loops do not look where they write."""
    wrong = [f"{array.shape} in place of {shape}" for array, shape in sized if array.shape != shape]
    if wrong:
        raise ValueError(f"arrays of filters side by side do not fit: {', '.join(wrong)}")


@dataclass(frozen=True)
class Filters:
    """Where B filters stand; `advance` moves them: x (B, n), P (B, n, n); V (B, d, n) what one of ν adds to the error x̂ − x;
    gain (B, m, n), variance (B, m) of every channel in the last step, one channel after the other, and S (B, m, m) of all of
    them before it; calm (B,) steady steps; nu (B, d) and left (B, d, d): mean and covariance of ν by the samples so far;
    x_c, P_c, V_c: as x, P, V, by the gains that consider ν, of no entry where none are asked for."""

    x: np.ndarray
    P: np.ndarray
    V: np.ndarray
    gain: np.ndarray
    variance: np.ndarray
    S: np.ndarray
    calm: np.ndarray
    nu: np.ndarray
    left: np.ndarray
    x_c: np.ndarray
    P_c: np.ndarray
    V_c: np.ndarray

    @property
    def states(self) -> States:
        """As they are, at one instant; by the gains that consider ν, where there are some."""
        own = (self.x_c, self.P_c, self.V_c) if self.x_c.size else (self.x, self.P, self.V)
        return States(*(each[:, None] for each in (*own, self.nu, self.left)))


@dataclass(frozen=True)
class States:
    """B filters at L instants: x (B, L, n), P (B, L, n, n), V (B, L, d, n), nu (B, L, d), left (B, L, d, d), each as in
    `Filters`."""

    x: np.ndarray
    P: np.ndarray
    V: np.ndarray
    nu: np.ndarray
    left: np.ndarray

    def first(self, count: int) -> States:
        """At the first instants."""
        return States(*(own[:, :count] for own in (self.x, self.P, self.V, self.nu, self.left)))


@dataclass(frozen=True)
class Passage:
    """What B filters found in L steps. fit (B, L): log-likelihood of each step's samples, with ν integrated out; where kept, else
    of length 0 in L: states after each update; before it, expected (B, L, m) and S (B, L, m, m) of the samples at ν = 0, and
    slope (B, L, m, d) of their innovations in ν."""

    fit: np.ndarray
    states: States
    expected: np.ndarray
    S: np.ndarray
    slope: np.ndarray


def filters_of(
    models: LinearModels, x: np.ndarray, covariance: np.ndarray, V: np.ndarray, consider: bool = False
) -> Filters:
    """B filters that begin with x (B, n), V (B, d, n) and one covariance (n, n); consider: with gains that do, as well."""
    B, m, n = models.H.shape
    P, second = np.tile(covariance, (B, 1, 1)), B if consider else 0
    return Filters(
        x,
        P,
        V,
        np.zeros((B, m, n)),
        np.zeros((B, m)),
        np.zeros((B, m, m)),
        np.zeros(B, dtype=np.int64),
        np.zeros((B, models.nuisances)),
        np.tile(np.eye(models.nuisances), (B, 1, 1)),
        x[:second].copy(),
        P[:second].copy(),
        V[:second].copy(),
    )


def advance(
    models: LinearModels,
    filters: Filters,
    known: np.ndarray,
    known_end: np.ndarray,
    measurement: np.ndarray,
    noise: np.ndarray,
    discrepancy: np.ndarray,
    keep: bool,
    threads: int = 1,
) -> Passage:
    """Take the filters L steps on, each a prediction and an update by every channel that measured (1.57-1.60):

        V⁻ = A V − (A_ν x̃ + G_ν w),   ε = D x̃⁻ + E w₁ + o − H V⁻,   V = V⁻ + K ε,   x̃ = x̂ − V ν̂

    the error that constants ν make in a filter that does not know of them. Its innovations are e = ε ν + white noise, and least
    squares on them give mean ν̂ and covariance of ν (Friedland's separate filter of a bias), and the likelihood of the samples
    with ν integrated out. Linear in ν about the motion that is predicted: an innovation is independent of that, so that noise
    makes no bias.
    The states that are kept are of a second filter where `filters` has one, with the gains of Schmidt, of least variance among
    those that do not learn ν:

        K = (P⁻Hᵀ − V⁻εᵀ)(H P⁻Hᵀ + ε εᵀ + R)⁻¹,   P = (I − K H)P⁻(I − K H)ᵀ + K R Kᵀ

    where a filter that takes its readings for exact would follow what gauges make of their tolerances the more, the quieter
    they are.
    known (L, p), known_end (L, p₁), measurement (L, m) with NaN where missing, noise (L, m) variances of the samples, with
    discrepancy (m,) on top of them, which S of what is kept is without; keep: whether states are returned. Changes `filters`
    in place.
    Sources: Friedland, IEEE Trans. Automatic Control 14 (1969); Schmidt, Advances in Control Systems 3 (1966).
    """
    B, m, n = models.H.shape
    L, d, kept = len(measurement), models.nuisances, len(measurement) if keep else 0
    second = len(filters.x_c)
    _agree(
        (filters.x, (B, n)),
        (filters.P, (B, n, n)),
        (filters.V, (B, d, n)),
        (filters.x_c, (B if second else 0, n)),
        (filters.P_c, (second, n, n)),
        (filters.V_c, (second, d, n)),
        (known, (L, models.G.shape[-1])),
        (known_end, (L, models.F.shape[-1])),
        (measurement, (L, m)),
        (noise, (L, m)),
        (discrepancy, (m,)),
    )
    states = States(
        np.zeros((B, kept, n)),
        np.zeros((B, kept, n, n)),
        np.zeros((B, kept, d, n)),
        np.zeros((B, kept, d)),
        np.zeros((B, kept, d, d)),
    )
    found = Passage(
        np.zeros((B, L)), states, np.zeros((B, kept, m)), np.zeros((B, kept, m, m)), np.zeros((B, kept, m, d))
    )
    AT = np.ascontiguousarray(np.swapaxes(models.A, 1, 2))

    def part(span: np.ndarray) -> None:
        _advance(
            span,
            (AT, models.G, models.Q, models.H, models.F, models.A_nu, models.G_nu, models.D, models.E, models.offset),
            (
                filters.x,
                filters.P,
                filters.V,
                filters.gain,
                filters.variance,
                filters.S,
                filters.calm,
                filters.nu,
                filters.left,
            ),
            (filters.x_c, filters.P_c, filters.V_c),
            (known, known_end, measurement, noise, discrepancy),
            keep,
            (found.fit, states.nu, states.left, states.x, states.P, states.V),
            (found.expected, found.S, found.slope),
        )

    spans = [span for span in np.array_split(np.arange(B), threads) if len(span)]
    if len(spans) == 1:
        part(spans[0])
    else:
        with ThreadPoolExecutor(len(spans)) as pool:
            list(pool.map(part, spans))
    return found


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _advance(span, system, state, considering, data, keep, out, ahead):  # type: ignore[no-untyped-def]
    AT, G, Q, H, F, A_nu, G_nu, D, E, offset = system
    xs, Ps, Vs, gains, variances, Ss, calms, nus, lefts = state
    xcs, Pcs, Vcs = considering
    known, known_end, y, R, more = data
    fits, nu_kept, left_kept, x_kept, P_kept, V_kept = out
    y_kept, S_kept, slope_kept = ahead
    m, n, d = H.shape[1], H.shape[2], D.shape[0]
    before, work, row, row2 = np.empty((n, n)), np.empty((n, n)), np.empty(n), np.empty(n)
    moved, whitened = np.empty((d, n)), np.empty(m)
    sensed, slope, gain_nu, likely = np.empty((m, d)), np.empty(d), np.empty(d), np.empty(n)
    for i in span:
        x, P, V, K, S = xs[i], Ps[i], Vs[i], gains[i], variances[i]
        for t in range(len(y)):
            complete = not np.isnan(y[t]).any()
            if not complete or (t > 0 and (R[t] != R[t - 1]).any()):
                calms[i] = 0
            steady = calms[i] >= CALM
            _corrected(x, V, nus[i], likely)
            _moved_nuisances(likely, V, AT[i], A_nu[i], G_nu[i], known[t], moved)
            _moved_mean(x, AT[i], G[i], known[t], row)
            if not steady:
                before[:] = P
                _predicted(P, AT[i], Q[i], work)
            _corrected(x, V, nus[i], likely)
            _sensed(likely, D, E, offset, known_end[t], sensed)
            if keep:
                if not steady:
                    _innovation_covariance(P, H[i], R[t], row, Ss[i])
                S_kept[i, t] = Ss[i]
                for c in range(m):
                    y_kept[i, t, c] = _dot(H[i, c], x) + _dot(F[i, c], known_end[t])
                    for k in range(d):
                        slope_kept[i, t, c, k] = sensed[c, k] - _dot(H[i, c], V[k])
            for c in range(m):
                whitened[c] = 0.0
                if np.isnan(y[t, c]):
                    continue
                if not steady:
                    S[c] = _updated(P, H[i, c], R[t, c] + more[c], K[c], row, row2, work)
                innovation = y[t, c] - _dot(F[i, c], known_end[t]) - _dot(H[i, c], x)
                for a in range(n):
                    x[a] += K[c, a] * innovation
                whitened[c] = innovation / np.sqrt(S[c])
                fits[i, t] -= 0.5 * np.log(2 * np.pi * S[c])
            fits[i, t] += _updated_nuisances(V, H[i], sensed, K, S, y[t], whitened, slope, gain_nu, nus[i], lefts[i])
            if not steady:
                calms[i] = calms[i] + 1 if complete and _unmoved(P, before) else 0
            if len(xcs):
                _moved_nuisances(xcs[i], Vcs[i], AT[i], A_nu[i], G_nu[i], known[t], moved)
                _moved_mean(xcs[i], AT[i], G[i], known[t], row)
                _predicted(Pcs[i], AT[i], Q[i], work)
                _sensed(xcs[i], D, E, offset, known_end[t], sensed)
                _considered(xcs[i], Pcs[i], Vcs[i], H[i], F[i], known_end[t], y[t], R[t], sensed)
            if keep:
                if len(xcs):
                    x_kept[i, t], P_kept[i, t], V_kept[i, t] = xcs[i], Pcs[i], Vcs[i]
                else:
                    x_kept[i, t], P_kept[i, t], V_kept[i, t] = x, P, V
                nu_kept[i, t], left_kept[i, t] = nus[i], lefts[i]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _dot(a, b):  # type: ignore[no-untyped-def]
    value = 0.0
    for j in range(len(a)):
        value += a[j] * b[j]
    return value


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _moved_mean(x, AT, G, w, ahead):  # type: ignore[no-untyped-def]
    """x ← A x + G w."""
    n = len(x)
    for a in range(n):
        ahead[a] = _dot(G[a], w)
    for b in range(n):
        for a in range(n):
            ahead[a] += x[b] * AT[b, a]
    for a in range(n):
        x[a] = ahead[a]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _moved_nuisances(x, V, AT, A_nu, G_nu, w, moved):  # type: ignore[no-untyped-def]
    """V ← A V − (A_ν x + G_ν w), x before it has moved."""
    d, n = V.shape
    for k in range(d):
        for a in range(n):
            moved[k, a] = 0.0
        for b in range(n):
            for a in range(n):
                moved[k, a] += V[k, b] * AT[b, a]
        if k < len(A_nu):
            for a in range(n):
                moved[k, a] -= _dot(A_nu[k, a], x) + _dot(G_nu[k, a], w)
        for a in range(n):
            V[k, a] = moved[k, a]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _predicted(P, AT, Q, half):  # type: ignore[no-untyped-def]
    """P ← A P Aᵀ + Q, symmetric; half: P Aᵀ."""
    n = len(P)
    for a in range(n):
        for b in range(n):
            half[a, b] = 0.0
        for c in range(n):
            for b in range(n):
                half[a, b] += P[a, c] * AT[c, b]
    for a in range(n):
        for b in range(n):
            P[a, b] = Q[a, b]
    for c in range(n):
        for a in range(n):
            for b in range(n):
                P[a, b] += AT[c, a] * half[c, b]
    for a in range(n):
        for b in range(a):
            P[a, b] = P[b, a] = 0.5 * (P[a, b] + P[b, a])


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _innovation_covariance(P, H, R, Ph, S):  # type: ignore[no-untyped-def]
    """S ← H P Hᵀ + R."""
    m = len(H)
    for c in range(m):
        _product(P, H[c], Ph)
        for g in range(m):
            S[g, c] = _dot(H[g], Ph)
        S[c, c] += R[c]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _product(P, h, out):  # type: ignore[no-untyped-def]
    """out ← P h, P symmetric."""
    n = len(h)
    for a in range(n):
        out[a] = 0.0
    for b in range(n):
        for a in range(n):
            out[a] += h[b] * P[b, a]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _updated(P, h, r, k, Ph, Th, T):  # type: ignore[no-untyped-def]
    """P ← (I − k hᵀ) P (I − h kᵀ) + k r kᵀ, Joseph's form, with k ← P h/s; returns s = hᵀP h + r."""
    n = len(h)
    _product(P, h, Ph)
    s = r + _dot(h, Ph)
    for a in range(n):
        k[a] = Ph[a] / s
    for a in range(n):
        for b in range(n):
            T[a, b] = P[a, b] - k[a] * Ph[b]
        Th[a] = _dot(T[a], h)
    for a in range(n):
        for b in range(a + 1):
            P[a, b] = P[b, a] = T[a, b] - Th[a] * k[b] + r * k[a] * k[b]
    return s


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _sensed(x, D, E, offset, w, out):  # type: ignore[no-untyped-def]
    """What one of every ν adds to the readings of the predicted motion."""
    for k in range(len(D)):
        for c in range(D.shape[1]):
            out[c, k] = offset[k, c] + _dot(D[k, c], x) + _dot(E[k, c], w)


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _corrected(x, V, nu, out):  # type: ignore[no-untyped-def]
    """x less what ν makes of it."""
    for a in range(len(x)):
        out[a] = x[a]
    for k in range(len(nu)):
        for a in range(len(x)):
            out[a] -= V[k, a] * nu[k]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _updated_nuisances(V, H, sensed, K, S, y, whitened, slope, gain_nu, nu, left):  # type: ignore[no-untyped-def]
    """V ← V + K ε, and ν by least squares on the innovations; returns what the squares add to the log-likelihood."""
    d, n = V.shape
    fit = 0.0
    for c in range(len(H)):
        if np.isnan(y[c]):
            continue
        for k in range(d):
            change = sensed[c, k] - _dot(H[c], V[k])
            for a in range(n):
                V[k, a] += K[c, a] * change
            slope[k] = change / np.sqrt(S[c])
        for k in range(d):
            gain_nu[k] = _dot(left[k], slope)
        size, rest = 1.0 + _dot(gain_nu, slope), whitened[c] - _dot(nu, slope)
        for k in range(d):
            nu[k] += gain_nu[k] * rest / size
            for j in range(d):
                left[k, j] -= gain_nu[k] * gain_nu[j] / size
        fit -= 0.5 * (rest * rest / size + np.log(size))
    return fit


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _unmoved(P, before):  # type: ignore[no-untyped-def]
    for a in range(len(P)):
        for b in range(len(P)):
            if abs(P[a, b] - before[a, b]) > UNMOVED * np.sqrt(before[a, a] * before[b, b]):
                return False
    return True


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _considered(x, P, V, H, F, w, y, R, sensed):  # type: ignore[no-untyped-def]
    """Update by all channels that measured, with the gain of Schmidt."""
    d, n = V.shape
    there = np.flatnonzero(~np.isnan(y))
    m = len(there)
    Ph, slope, S, K = np.empty((m, n)), np.empty((m, d)), np.empty((m, m)), np.empty((m, n))
    innovation = np.empty(m)
    for c in range(m):
        h = H[there[c]]
        _product(P, h, Ph[c])
        innovation[c] = y[there[c]] - _dot(F[there[c]], w) - _dot(h, x)
        K[c] = Ph[c]
        for k in range(d):
            slope[c, k] = sensed[there[c], k] - _dot(h, V[k])
            for a in range(n):
                K[c, a] -= V[k, a] * slope[c, k]
        for g in range(c + 1):
            S[c, g] = _dot(H[there[g]], Ph[c]) + _dot(slope[c], slope[g])
        S[c, c] += R[there[c]]
    _solved(S, K)
    for c in range(m):
        for a in range(n):
            x[a] += K[c, a] * innovation[c]
        for k in range(d):
            for a in range(n):
                V[k, a] += K[c, a] * slope[c, k]
        for a in range(n):
            for b in range(n):
                P[a, b] -= K[c, a] * Ph[c, b]
    # rows of P Hᵀ after the first factor of Joseph's form
    for c in range(m):
        for a in range(n):
            Ph[c, a] = _dot(P[a], H[there[c]]) - R[there[c]] * K[c, a]
    for c in range(m):
        for a in range(n):
            for b in range(n):
                P[a, b] -= Ph[c, a] * K[c, b]
    for a in range(n):
        for b in range(a):
            P[a, b] = P[b, a] = 0.5 * (P[a, b] + P[b, a])


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc"})
def _solved(S, B):  # type: ignore[no-untyped-def]
    """B ← S⁻¹ B by Cholesky's factors, of the lower half of S, which they replace."""
    m = len(S)
    for c in range(m):
        for g in range(c + 1):
            value = S[c, g]
            for j in range(g):
                value -= S[c, j] * S[g, j]
            S[c, g] = np.sqrt(value) if c == g else value / S[g, g]
    for c in range(m):
        for j in range(c):
            for a in range(B.shape[1]):
                B[c, a] -= S[c, j] * B[j, a]
        for a in range(B.shape[1]):
            B[c, a] /= S[c, c]
    for c in range(m - 1, -1, -1):
        for j in range(c + 1, m):
            for a in range(B.shape[1]):
                B[c, a] -= S[j, c] * B[j, a]
        for a in range(B.shape[1]):
            B[c, a] /= S[c, c]
