"""Linear Kalman filters side by side, each of a model of its own, on one measurement: the inner loop of the bank."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields

import numpy as np

from strainsight.estimation.linear import LinearModels, agree, compilable
from strainsight.parallel import threads

KEPT = 4_000_000
"""Numbers that are kept of the filters at a time."""
APART = 2000
"""Steps of a filter from which another thread pays: it takes as long to start as some hundred of them, microseconds each."""


@dataclass(frozen=True)
class Filters:
    """Where B filters stand, in the coordinates z of `linear.Motion`; `advance` moves them: x (B, n), P (B, n, n); V (B, d, n)
    what one of ν adds to the error x̂ − x;
    gain (B, m, n), variance (B, m) of every channel in the last step, one channel after the other, and S (B, m, m) of all of
    them before it; calm (B,) steady steps; nu (B, d) and left (B, d, d): mean and covariance of ν by the samples so far;
    x_c, P_c, V_c: as x, P, V, by the gains that consider ν, of no entry where none are asked for; basis T (B, n, n)."""

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
    basis: np.ndarray

    @property
    def states(self) -> States:
        """As they are, at one instant; by the gains that consider ν, where there are some."""
        own = (self.x_c, self.P_c, self.V_c) if self.x_c.size else (self.x, self.P, self.V)
        x, P, V = _of_states(self.basis, *(each[:, None] for each in own))
        return States(x, P, V, self.nu[:, None].copy(), self.left[:, None].copy())

    def copy(self) -> Filters:
        """The same, for others to move."""
        return Filters(*(getattr(self, entry.name).copy() for entry in fields(self)))


def joined_filters(parts: Sequence[Filters]) -> Filters:
    """Filters of the same ν, one behind the other."""
    return Filters(*(np.concatenate([getattr(one, entry.name) for one in parts]) for entry in fields(Filters)))


def _of_states(
    basis: np.ndarray, x: np.ndarray, P: np.ndarray, V: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x = T z (B, L, n), P (B, L, n, n) and V (B, L, d, n) of the states, of those in the coordinates of the modes."""
    B, L, d, n = V.shape
    T = np.swapaxes(basis, 1, 2)
    half = (P.reshape(B, L * n, n) @ T).reshape(P.shape)
    P = basis[:, None] @ half
    return x @ T, 0.5 * (P + np.swapaxes(P, 2, 3)), (V.reshape(B, L * d, n) @ T).reshape(V.shape)


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


def one_passage(parts: Sequence[States]) -> States:
    """Parts of one record, one behind the other."""
    return States(*(np.concatenate([getattr(own, entry.name) for own in parts], axis=1) for entry in fields(States)))


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
    (B, m, n), second = models.H.shape, models.count if consider else 0
    inverse = models.motion.inverse
    T = np.swapaxes(inverse, 1, 2)
    x, P, V = (x[:, None] @ T)[:, 0], inverse @ covariance @ T, V @ T
    return Filters(
        x,
        P,
        V,
        np.zeros((B, m, n)),
        np.zeros((B, m)),
        np.zeros((B, m, m)),
        np.zeros(B, dtype=np.int64),
        -models.about - models.shift,
        np.tile(np.eye(models.nuisances), (B, 1, 1)),
        x[:second].copy(),
        P[:second].copy(),
        V[:second].copy(),
        models.motion.basis,
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
    states: bool = True,
    less: np.ndarray | None = None,
) -> Passage:
    """Take the filters L steps on, each a prediction and an update by every channel that measured (1.57-1.60):

        V⁻ = A V − (A_ν x̃ + G_ν w),   ε = D x̃⁻ + E w₁ + o + B z̃ − H V⁻,   V = V⁻ + K ε,   x̃ = x̂ − V ν̂

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
    discrepancy (m,) on top of them, which S of what is kept is without; keep: whether states are returned; states: and not mean
    and covariance of ν alone; less (L, d): information on ν that is taken off in every step (`noise_alone`). Changes `filters`
    in place.
    Sources: Friedland, IEEE Trans. Automatic Control 14 (1969); Schmidt, Advances in Control Systems 3 (1966).
    """
    B, m, n = models.H.shape
    less = np.zeros((0, models.nuisances)) if less is None else less
    L, d, second = len(measurement), models.nuisances, len(filters.x_c)
    kept, whole = L if keep else 0, L if keep and states else 0
    agree(
        (filters.x, (B, n)),
        (filters.P, (B, n, n)),
        (filters.V, (B, d, n)),
        (filters.x_c, (B if second else 0, n)),
        (filters.P_c, (second, n, n)),
        (filters.V_c, (second, d, n)),
        (known, (L, models.motion.fed.shape[-1])),
        (known_end, (L, models.F.shape[-1])),
        (measurement, (L, m)),
        (noise, (L, m)),
        (discrepancy, (m,)),
        (less, (L if len(less) else 0, d)),
    )
    x, P, V = np.zeros((B, whole, n)), np.zeros((B, whole, n, n)), np.zeros((B, whole, d, n))
    nu, left, fit = np.zeros((B, kept, d)), np.zeros((B, kept, d, d)), np.zeros((B, L))
    ahead = np.zeros((B, whole, m)), np.zeros((B, whole, m, m)), np.zeros((B, whole, m, d))
    own, (motion, reading, beyond) = filters, models.compiled
    data = compilable(known, known_end, measurement, noise, discrepancy, less)
    from strainsight.estimation.compiled.filters import take_steps  # not before: numba takes a second to import

    def part(span: np.ndarray) -> None:
        take_steps(  # type: ignore[no-untyped-call]
            span,
            motion,
            reading,
            beyond,
            (own.x, own.P, own.V, own.gain, own.variance, own.S, own.calm, own.nu, own.left),
            (own.x_c, own.P_c, own.V_c),
            data,
            (kept > 0, whole > 0),
            (fit, nu, left, x, P, V),
            ahead,
        )

    count = min(threads(), max(1, B * L // APART))
    spans = [span for span in np.array_split(np.arange(B), count) if len(span)]
    if len(spans) == 1:
        part(spans[0])
    else:
        with ThreadPoolExecutor(len(spans)) as pool:
            list(pool.map(part, spans))
    if whole:
        x, P, V = _of_states(models.motion.basis, x, P, V)
    return Passage(fit, States(x, P, V, nu, left), *ahead)
