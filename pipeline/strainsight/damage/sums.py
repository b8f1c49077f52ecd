"""Damage by Miner's rule and the equivalent range of many histories."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.damage import loops


@dataclass(frozen=True)
class Curve:
    """N = N_ref (Δσ_ref/Δσ)^m down to the knee, N = N_k (Δσ_k/Δσ)^m₂ below it, and no damage at all below the cut-off.

    reference: Δσ_ref [Pa], a range (twice the amplitude), at N_ref = cycles; slope m [-]; knee N_k cycles, infinite for one
    line; second m₂ [-], infinite for none of the damage below the knee; cut_off N cycles, infinite for none.
    Two slopes and a cut-off are the curves of EN 1993-1-9 (3, 5; knee at 5e6, cut-off at 1e8).
    """

    reference: float
    cycles: float
    slope: float
    knee: float = np.inf
    second: float = np.inf
    cut_off: float = np.inf

    @property
    def knee_range(self) -> float:
        """Δσ_k [Pa], zero for one line."""
        return 0.0 if np.isinf(self.knee) else self.reference * float((self.cycles / self.knee) ** (1 / self.slope))

    @property
    def cut_off_range(self) -> float:
        """Δσ [Pa] below which nothing does damage."""
        if np.isinf(self.second) and np.isfinite(self.knee):
            # the range of the knee itself does damage
            return float(np.nextafter(self.knee_range, 0.0))
        if np.isinf(self.cut_off):
            return 0.0
        if self.cut_off <= self.knee:
            return self.reference * float((self.cycles / self.cut_off) ** (1 / self.slope))
        return self.knee_range * float((self.knee / self.cut_off) ** (1 / self.second))

    @property
    def numbers(self) -> tuple[float, ...]:
        """As the compiled loops take it."""
        second = self.slope if np.isinf(self.second) else self.second
        return (self.reference, self.cycles, self.slope, self.knee_range, second, self.cut_off_range)

    def damage(self, range_: np.ndarray) -> np.ndarray:
        """1/N [-] of one cycle of each range [Pa]."""
        return np.array([loops.cycle_damage(float(own), self.numbers) for own in np.ravel(range_)]).reshape(
            np.shape(range_)
        )


@dataclass(frozen=True)
class MeanStress:
    """Which range at mean zero does the damage of Δσ = 2σ_a about σ_m.

    none      Δσ
    goodman   Δσ/(1 − σ_m/R_m), R_m the tensile strength; Δσ where σ_m < 0, infinite from R_m on
    fkm       2(σ_a + M σ_m) for |σ_m| ≤ σ_a;   2σ_a (1 − M) below;   2(1 + M)(σ_a + M σ_m/3)/(1 + M/3) up to σ_m = 3σ_a;
              2σ_a (1 + M)²/(1 + M/3) beyond, with the mean stress sensitivity M

    rule; constant: R_m [Pa], or M [-]. The S-N curve is then that of mean zero.
    Sources: Goodman (1899); FKM guideline, 6th edition (2012), 4.4.2.
    """

    rule: int = loops.NONE
    constant: float = 0.0

    def equivalent(self, range_: np.ndarray, mean: np.ndarray) -> np.ndarray:
        """Ranges [Pa] of cycles (c,) by their ranges and means [Pa]."""
        return np.array([loops.corrected(r, m, self.rule, self.constant) for r, m in zip(range_, mean, strict=True)])


KINDS = {"signed_von_mises": loops.SIGNED_VON_MISES, "principal": loops.PRINCIPAL}


@dataclass(frozen=True)
class Damage:
    """miner (p,) [-]; moment (p,): Σ nᵢ (Δσᵢ/Δσ_ref)^m [-], of which the equivalent range is made."""

    miner: np.ndarray
    moment: np.ndarray


def damage_of(signals: np.ndarray, curve: Curve, mean: MeanStress | None = None) -> Damage:
    """Of histories of stress (p, T) [Pa]:

        D = Σᵢ nᵢ/Nᵢ

    over the cycles of each by rainflow. NaN of a history with NaN in it. Sources: Palmgren (1924); Miner, J. Applied Mechanics 12
    (1945).
    """
    own, rule = np.ascontiguousarray(signals, dtype=float), MeanStress() if mean is None else mean
    out, whole = np.empty((len(own), 2)), np.isfinite(own).all(axis=1)
    if not whole.all():
        own = np.where(whole[:, None], own, 0.0)
    loops.sums(own, curve.numbers, rule.rule, rule.constant, out)
    out[~whole] = np.nan
    return Damage(out[:, 0], out[:, 1])


def equivalent_range(moment: np.ndarray, curve: Curve, cycles: float) -> np.ndarray:
    """Δσ_eq [Pa] of which N_eq = cycles do the same damage on a line of slope m without knee or cut-off:

    Δσ_eq = (Σ nᵢ Δσᵢ^m / N_eq)^(1/m)
    """
    return np.asarray(curve.reference * (moment / cycles) ** (1 / curve.slope))


def one_number(stress: np.ndarray, kind: str) -> np.ndarray:
    """Of stress (p, 6, T) [Pa], [xx yy zz xy yz zx], one history (p, T) each:

    principal          the principal stress of the largest size
    signed_von_mises   von Mises' stress with the sign of that

    In pure shear the principal stresses of the largest size are two of opposite sign, and either is taken.
    """
    own = np.ascontiguousarray(stress, dtype=float)
    out = np.empty((own.shape[0], own.shape[2]))
    loops.one_number(own, KINDS[kind], out)
    return out


FEWEST = 40
"""Draws of which an interval of 95 % lies within the smallest and the largest."""


@dataclass(frozen=True)
class Interval:
    """median, low, high (...): 50, 2.5 and 97.5 % of draws."""

    median: np.ndarray
    low: np.ndarray
    high: np.ndarray


def interval_of(draws: np.ndarray) -> Interval:
    """Of draws (N, ...), N ≥ FEWEST, by the order statistics of place q (N + 1).

    Where the draws and the truth come from one distribution the truth lies below the k-th smallest of N draws with probability
    k/(N + 1), whatever that is: the interval is exact for any N. Infinite draws are the largest there are; NaN stays NaN.
    Raises ValueError for fewer draws. Source: Weibull (1939); Hyndman and Fan, The American Statistician 50 (1996), type 6.
    """
    if len(draws) < FEWEST:
        raise ValueError(f"{len(draws)} draws for an interval of 95 %, fewer than {FEWEST}")
    ordered = np.sort(draws, axis=0)
    return Interval(*(_between(ordered, q) for q in (0.5, 0.025, 0.975)))


def _between(ordered: np.ndarray, q: float) -> np.ndarray:
    place = q * (len(ordered) + 1) - 1
    below = min(max(int(np.floor(place)), 0), len(ordered) - 2)
    low, high = ordered[below], ordered[below + 1]
    share = place - below
    # an infinite draw above makes it infinite, and two make no difference of infinities
    apart = np.isfinite(high) & np.isfinite(low)
    step = np.where(apart, high, 0.0) - np.where(apart, low, 0.0)
    return np.asarray(np.where(apart, low + share * step, high if share > 0 else low))
