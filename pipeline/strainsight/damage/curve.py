"""S-N curves: how many cycles of a stress range a material bears, and what a mean stress does to it."""

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
