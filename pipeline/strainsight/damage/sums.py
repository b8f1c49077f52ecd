"""Damage by Miner's rule and the equivalent range of many histories."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.damage import loops
from strainsight.damage.curve import Curve, MeanStress

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
