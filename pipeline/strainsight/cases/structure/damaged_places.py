"""Where damage is asked for: the stress that a motion of the model makes there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.damage import DamageSettings
from strainsight.damage.curve import Curve, MeanStress
from strainsight.damage.loops import FKM, GOODMAN, NONE
from strainsight.damage.sums import damage_of, one_number
from strainsight.errors import UserError
from strainsight.fem.affine import AffineOperator
from strainsight.fem.stress import SurfaceModel

AT_ONCE = 400_000
"""Numbers of stress that are held at a time: they stay in the processor's cache."""


@dataclass(frozen=True)
class Places:
    """position (p, 3) [m], element (p,) ids; rows (p, c, r): stress of unit modulus per coordinate, c = 1 of one stress, 6 of a
    state [xx yy zz xy yz zx], in the free moduli of plies; modulus (p,) [Pa] affine in the parameters."""

    position: np.ndarray
    element: np.ndarray
    rows: AffineOperator
    modulus: AffineOperator

    def __len__(self) -> int:
        return len(self.position)

    def take(self, which: np.ndarray) -> Places:
        """Some of them, by their numbers."""
        rows, modulus = (X.of_all(lambda own: own[which]) for X in (self.rows, self.modulus))
        return replace(self, position=self.position[which], element=self.element[which], rows=rows, modulus=modulus)


def surface_places(surface: SurfaceModel, position: np.ndarray, element: np.ndarray) -> Places:
    """Every point of a surface. Raises UserError where a modulus of plies and a thickness are free: their product is."""
    law, change = AffineOperator(None, {}) if surface.laws is None else surface.laws.stiffness, surface.change
    if law.terms and change.terms:
        plies, thick = (", ".join(own.parameters) for own in (law, change))
        raise UserError(
            f"{plies} and {thick} are both free, and stress on the faces goes with their product",
            key="estimate.damage",
            remedy="free a modulus of plies or a thickness, or leave damage out",
        )
    terms = {label: surface.law_stress(surface.strain, own) for label, own in law.terms.items()}
    terms |= {label: surface.unit_stress(own, law.constant) for label, own in change.terms.items()}
    rows = AffineOperator(
        surface.unit_stress(surface.strain, law.constant), terms, {**law.coefficients, **change.coefficients}
    )
    return Places(position, element, rows, surface.modulus)


def curve_of(own: DamageSettings) -> tuple[Curve, MeanStress]:
    """As the kernel takes them."""
    stated, mean = own.curve, own.mean_stress

    def or_infinite(value: float | None) -> float:
        return np.inf if value is None else value

    curve = Curve(
        stated.stress * (2.0 if stated.of == "amplitude" else 1.0),
        stated.cycles,
        stated.slope,
        or_infinite(stated.knee),
        or_infinite(stated.second_slope),
        or_infinite(stated.cut_off),
    )
    constant = mean.tensile_strength if mean.rule == "goodman" else mean.sensitivity
    return curve, MeanStress({"none": NONE, "goodman": GOODMAN, "fkm": FKM}[mean.rule], constant or 0.0)


def damage_at(
    places: Places, q: np.ndarray, theta: Mapping[str, float], own: DamageSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Miner's sum (p,) of one record and its moment (p,), as of `damage_of`, of a motion q (T + 1, r) at parameters [SI]."""
    curve, mean = curve_of(own)
    rows = places.rows.at(theta)
    count, components, r = rows.shape
    E, motion = np.asarray(places.modulus.at(theta)), np.ascontiguousarray(q.T)
    part = max(1, AT_ONCE // (components * len(q)))
    miner, moment = np.empty(count), np.empty(count)
    for start in range(0, count, part):
        here = slice(start, start + part)
        stress = (rows[here].reshape(-1, r) @ motion).reshape(-1, components, len(q))
        one = stress[:, 0] if components == 1 else one_number(stress, own.stress)
        found = damage_of(E[here, None] * one, curve, mean)
        miner[here], moment[here] = found.miner, found.moment
    return miner, moment
