"""Linear Kalman filters side by side, each of a model of its own, on one measurement: the inner loop of the bank."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields

import numpy as np

from strainsight.estimation.filter_loops import take_steps

KEPT = 4_000_000
"""Numbers that are kept of the filters at a time."""


@dataclass(frozen=True)
class LinearModels:
    """B models  x⁺ = A x + G w + Σₖ νₖ(Aₖx + Gₖw) + noise,   y = H x + F w₁ + Σₖ νₖ(Dₖx + Eₖw₁ + oₖ + Bₖz) + noise

    of one size. ν are d constants that no filter estimates, of mean zero and variance one; the first e of them change the motion.
    A (B, n, n); G (B, n, p) of what is known, w (T, p) in a step; Q (B, n, n) covariance of a step; H (B, m, n); F (B, m, p₁) of
    what is known at its end, w₁ (T, p₁); A_ν (B, e, n, n), G_ν (B, e, n, p); D (d, m, n), E (d, m, p₁), o (d, m). B (d, m, f) on
    zⱼ = νⱼ(Uⱼx + Wⱼw₁) of the last f of those that change the motion, U (f, n), W (f, p₁).
    about (d,): ν is counted from there, so that its mean is −about; where that is not zero slopes are those there.
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
    B: np.ndarray
    U: np.ndarray
    W: np.ndarray
    about: np.ndarray

    def __post_init__(self) -> None:
        (B, m, n), p, p1, e = self.H.shape, self.G.shape[-1], self.F.shape[-1], self.A_nu.shape[1]
        d, f = len(self.D), len(self.U)
        agree(
            (self.A, (B, n, n)),
            (self.G, (B, n, p)),
            (self.Q, (B, n, n)),
            (self.F, (B, m, p1)),
            (self.A_nu, (B, e, n, n)),
            (self.G_nu, (B, e, n, p)),
            (self.D, (d, m, n)),
            (self.E, (d, m, p1)),
            (self.offset, (d, m)),
            (self.B, (d, m, f)),
            (self.U, (f, n)),
            (self.W, (f, p1)),
            (self.about, (d,)),
        )

    @property
    def count(self) -> int:
        return len(self.A)

    @property
    def nuisances(self) -> int:
        return len(self.D)

    @property
    def kept_a_step(self) -> int:
        """How many numbers the states of the filters are at one instant."""
        n, d = self.A.shape[1], self.nuisances
        return self.count * (n * (n + 1 + d) + d**2)


def agree(*sized: tuple[np.ndarray, tuple[int, ...]]) -> None:
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

    def copy(self) -> Filters:
        """The same, for others to move."""
        return Filters(*(getattr(self, entry.name).copy() for entry in fields(self)))


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
        np.tile(-models.about, (B, 1)),
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
    discrepancy (m,) on top of them, which S of what is kept is without; keep: whether states are returned. Changes `filters`
    in place.
    Sources: Friedland, IEEE Trans. Automatic Control 14 (1969); Schmidt, Advances in Control Systems 3 (1966).
    """
    B, m, n = models.H.shape
    L, d, kept = len(measurement), models.nuisances, len(measurement) if keep else 0
    second = len(filters.x_c)
    agree(
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
        take_steps(
            span,
            (AT, models.G, models.Q, models.H, models.F, models.A_nu, models.G_nu, models.D, models.E, models.offset),
            (models.B, models.U, models.W, models.about),
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
