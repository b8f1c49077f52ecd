"""Wheatstone bridges: from the output over the excitation to the strain, without linearising."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.errors import UserError, did_you_mean

ARRANGEMENTS: Mapping[str, Callable[[float], tuple[float, float, float, float]]] = {
    "quarter": lambda nu: (1.0, 0.0, 0.0, 0.0),
    "half": lambda nu: (1.0, -1.0, 0.0, 0.0),
    "half-opposite": lambda nu: (1.0, 0.0, 1.0, 0.0),
    "half-poisson": lambda nu: (1.0, -nu, 0.0, 0.0),
    "full": lambda nu: (1.0, -1.0, 1.0, -1.0),
    "full-bending-poisson": lambda nu: (1.0, -1.0, nu, -nu),
    "full-poisson": lambda nu: (1.0, -nu, 1.0, -nu),
    "sum": lambda nu: (0.25, -0.25, 0.25, -0.25),
}
"""Arrangement → ν → strains of arms 1 to 4 in parts of the strain under gauge 1."""
SUM = "sum"
"""The arrangement of a bridge that is one measurement (`Candidates.arms`); all others are of one gauge."""
NEEDS_RATIO = ("half-poisson", "full-bending-poisson", "full-poisson")


@dataclass(frozen=True)
class Bridge:
    """How the gauges of one channel sit in its bridge; gauge factor GF > 0; Poisson's ratio ν where gauges lie across.

    Strains of arms 1 to 4 in parts of ε, the strain under gauge 1; arms 1 and 3 raise the output, 2 and 4 lower it:

        quarter                1   0   0   0     one gauge
        half                   1  −1   0   0     tension and compression side of a beam: bending
        half-opposite          1   0   1   0     both sides of a beam: axial
        half-poisson           1  −ν   0   0     one along, one across
        full                   1  −1   1  −1     bending, or torsion at ±45°
        full-bending-poisson   1  −1   ν  −ν     both sides, along and across: bending
        full-poisson           1  −ν   1  −ν     both sides, along and across: axial
        sum                    ¼  −¼   ¼  −¼     ε is the signed sum of the arms, wherever they sit

    sum: ε_B = ε₁ − ε₂ + ε₃ − ε₄ = 4 r/GF, linear in r, which alone does not say what each arm reads. Of any arms it is

        r = (x₁ − x₂)/(2(2 + x₁ + x₂)) + (x₃ − x₄)/(2(2 + x₃ + x₄)),     x = GF ε

    so that it is exact where the strains of the arms of either leg, 1 and 2, 3 and 4, add up to zero. Otherwise each leg's share
    of ε_B comes out (x₁ + x₂)/2 and (x₃ + x₄)/2 of itself too small, to first order.
    """

    arrangement: str
    gauge_factor: float
    poisson_ratio: float | None = None

    def __post_init__(self) -> None:
        if self.arrangement not in ARRANGEMENTS:
            raise UserError(
                f"unknown bridge {self.arrangement!r}",
                remedy=did_you_mean(self.arrangement, ARRANGEMENTS, f"known bridges: {', '.join(ARRANGEMENTS)}"),
            )
        if not 0 < self.gauge_factor < np.inf:
            raise UserError(
                f"a gauge factor of {self.gauge_factor:g}", remedy="give the one of the gauge's data sheet, about 2"
            )
        needed = self.arrangement in NEEDS_RATIO
        if needed and self.poisson_ratio is None:
            raise UserError(
                f"the bridge {self.arrangement!r} has gauges across and no Poisson's ratio",
                remedy="give Poisson's ratio of the part",
            )
        if not needed and self.poisson_ratio is not None:
            raise UserError(
                f"the bridge {self.arrangement!r} has no gauge across, but Poisson's ratio is given",
                remedy=f"drop it, or take one of {', '.join(NEEDS_RATIO)}",
            )
        if self.poisson_ratio is not None and not -1 < self.poisson_ratio < 0.5:
            raise UserError(
                f"Poisson's ratio is {self.poisson_ratio:g}, outside -1 to 0.5",
                remedy="give Poisson's ratio of the part",
            )


def strain_of(bridge: Bridge, r: np.ndarray) -> np.ndarray:
    """Strain ε under gauge 1 from the output over the excitation r (T,) [V/V] of a bridge that was balanced at ε = 0:

        r = [(1+a₁x)(1+a₃x) − (1+a₂x)(1+a₄x)] / [(2+(a₁+a₂)x)(2+(a₃+a₄)x)],   x = GF ε
        ε = 4 r / (GF (N − 2 c r))        small r: ε = 4 r / (GF N)

    exactly, with N = a₁ − a₂ + a₃ − a₄ and c = a₁ + a₂ of every arrangement here; quarter bridge: ε = 4r/(GF (1 − 2r)).
    Tension under gauge 1 gives r > 0. Vishay Tech Note TN-507 has the same r(ε); NI writes these formulas for the opposite
    sign of r, −4V_r/(GF(1 + 2V_r)): an instrument wired that way has sign −1. NaN stays NaN, and so becomes what such a
    bridge cannot give: a gauge without resistance, or with an endless one.
    """
    arms = ARRANGEMENTS[bridge.arrangement](bridge.poisson_ratio or 0.0)
    N, c = arms[0] - arms[1] + arms[2] - arms[3], arms[0] + arms[1]
    below = N - 2.0 * c * r
    x = 4.0 * r / np.where(below > 0, below, np.nan)
    possible = np.all([1.0 + arm * x > 0 for arm in arms], axis=0)
    return np.where(possible, x, np.nan) / bridge.gauge_factor
