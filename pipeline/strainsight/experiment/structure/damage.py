"""Fatigue damage in a test, by draws of what the smoother leaves open."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.estimate import DamageSettings
from strainsight.config.gauges import Gauges, NamedGauge
from strainsight.damage import (
    FKM,
    GOODMAN,
    NONE,
    Curve,
    Interval,
    MeanStress,
    damage_of,
    equivalent_range,
    interval_of,
    one_number,
)
from strainsight.errors import UserError
from strainsight.estimation.bank_smoother import Paths
from strainsight.estimation.model import FilterModel
from strainsight.estimation.smoother import Smoothed
from strainsight.experiment.structure.candidates import rows_along
from strainsight.experiment.structure.surface import Skin, virtual_pool
from strainsight.fem.affine import AffineOperator
from strainsight.fem.recovery import SurfaceModel
from strainsight.records.estimated import DamageAt, Damaged
from strainsight.sensors.rows import channel_rows
from strainsight.sensors.surface import facet_centres

APART = 0.05
"""Of the surface's largest extent: no two hot spots that are listed are nearer than this."""
SHOWN, SHOWN_DECIDED = 0.5, 0.1
"""Of the largest equivalent range of the surface, from which a place is given an interval: where the samples do not tell how the
unknown loads walk, and where they do. Below the first the truth was outside too often, below the second it was not looked at
(docs/measured.md, Damage)."""
ALIKE = 1e-6
"""Relative: damages that differ by less are one, and the earlier place comes first."""
AT_ONCE = 400_000
"""Numbers of stress that are held at a time: they stay in the processor's cache."""


@dataclass(frozen=True)
class Asked:
    """surface: its places, None where there is no surface; virtual: those of the virtual gauges, None without one."""

    surface: Places | None
    virtual: Places | None


def asked_places(skin: Skin, entries: Sequence[NamedGauge], gauges: Gauges) -> Asked:
    """On the surface; entries of `estimate.virtual`. Raises UserError for one of these on a laminate or an anisotropic solid."""
    mesh, facets = skin.mesh, skin.facets
    every = surface_places(skin.model, facet_centres(mesh.position, facets.kind, facets.nodes)[0], facets.element_id)
    if not entries:
        return Asked(every, None)
    pool = virtual_pool(mesh, facets, entries, gauges)
    number = {own: i for i, own in enumerate(zip(facets.element_id.tolist(), facets.facet.tolist(), strict=True))}
    below = np.array([number[own] for own in zip(pool.element.tolist(), pool.facet.tolist(), strict=True)])
    if skin.model.laws is not None and (on := np.isin(below, skin.model.laws.facet)).any():
        raise UserError(
            f"{int(on.sum())} grids lie on a laminate or an anisotropic solid, where no modulus makes a stress along "
            f"the grid of its strain (the first on element {pool.element[int(np.argmax(on))]})",
            key="estimate.virtual",
            remedy="leave them out where estimate.damage is asked for: that of the surface is of the stress there",
        )
    rows, change = rows_along(
        mesh, skin.free, lambda at: channel_rows(mesh.position, pool, skin.field.basis, facets=facets, thickness=at)
    )
    strain = replace(change.of_terms(lambda own: own[:, None]), constant=rows[:, None])
    return Asked(every, Places(pool.position, pool.element, strain, every.take(below).modulus))


@dataclass(frozen=True)
class Recorded:
    """A record: model, smoothed; states (n + f,): where q and z stand in it; draws of them (N, T + 1, n + f) with p, None where
    σ is withheld."""

    model: FilterModel
    smoothed: Smoothed
    states: np.ndarray
    draws: Iterable[Paths] | None


def damage_in_test(
    own: DamageSettings,
    asked: Asked,
    records: Sequence[Recorded],
    progress: Callable[[float], None],
    shown: float = SHOWN,
) -> Damaged:
    """Damage of the smoothed histories, and its interval over draws where the equivalent range is `shown` of the largest or more.

        D = Σᵣ Dᵣ,     over records, of one draw of the constants each (Palmgren and Miner)

    Where σ is withheld the interval is, too.
    """
    of_mean = {name: _of_mean(places, records, own) for name, places in _named(asked)}
    # of ranges to the power of the slope
    least = shown**own.curve.slope * max(moment.max(initial=0.0) for _, moment in of_mean.values()) * (1 - ALIKE)
    which = {name: np.flatnonzero(moment >= least) for name, (_, moment) in of_mean.items()}
    if own.points is not None and asked.surface is not None:
        most = _ordered(of_mean["surface"][1])[: own.points]
        which["surface"] = np.intersect1d(which["surface"], most)
    drawn: dict[str, list[np.ndarray]] = {name: [] for name in which}
    parts = {name: places.take(which[name]) for name, places in _named(asked)}
    for draws in _drawn(records):
        for name, places in parts.items():
            each = [damage_at(places, q, theta_at(record.model, at), own) for record, at, q in draws]
            drawn[name].append(np.sum(each, axis=0))
        progress(len(drawn[name]) / own.draws)
    found = {name: _damage(places, own, of_mean[name], which[name], drawn[name]) for name, places in _named(asked)}
    surface = found.get("surface")
    return Damaged(
        surface=surface,
        virtual=found.get("virtual"),
        hot_spot=None if surface is None else hot_spots(surface, own.hot_spots),
        hours=float(own.repetitions * sum(record.smoothed.time[-1] for record in records) / 3600),
    )


def _of_mean(places: Places, records: Sequence[Recorded], own: DamageSettings) -> tuple[np.ndarray, np.ndarray]:
    """Damage and moment (p,) of the smoothed histories."""
    each = []
    for record in records:
        mean, model = record.smoothed.mean[:, 0], record.model
        theta = theta_at(model, mean[:, model.parameter_states].mean(axis=0))
        each.append(damage_at(places, mean[:, record.states], theta, own))
    miner, moment = np.sum(each, axis=0)
    return miner, moment


def _drawn(records: Sequence[Recorded]) -> Iterator[list[tuple[Recorded, np.ndarray, np.ndarray]]]:
    """Draw by draw: p (k,) and q (T + 1, n) of every record; draws of one number have their constants in common."""

    def one(record: Recorded) -> Iterator[tuple[Recorded, np.ndarray, np.ndarray]]:
        for part in record.draws or ():
            for at, q in zip(part.parameter, part.state, strict=True):
                yield record, at, q

    for draws in zip(*(one(record) for record in records), strict=True):
        yield list(draws)


def theta_at(model: FilterModel, p: np.ndarray) -> dict[str, float]:
    """All parameters [SI] at p (k,) = ln(θ/guess) of those that are estimated."""
    unknowns = model.unknowns
    return dict(model.fixed) | {
        name: float(unknowns.guess[name] * np.exp(value)) for name, value in zip(unknowns.parameters, p, strict=True)
    }


def hot_spots(found: DamageAt, count: int) -> np.ndarray:
    """The most damaged places of a surface, none within APART of one before; those without any damage are none."""
    level = np.where(np.isnan(found.damage), found.of_mean, found.damage)
    near = APART * float(np.ptp(found.position, axis=0).max())
    chosen: list[int] = []
    for i in _ordered(np.nan_to_num(level, nan=0.0, posinf=np.inf)).tolist():
        if len(chosen) == count or not level[i] > 0:
            break
        apart = np.linalg.norm(found.position[chosen] - found.position[i], axis=1)
        if not len(chosen) or apart.min() > near:
            chosen.append(i)
    return np.array(chosen, dtype=np.int64)


def _ordered(level: np.ndarray) -> np.ndarray:
    """Numbers of places, the largest level first; of levels that are alike the earlier place."""
    with np.errstate(divide="ignore"):
        rounded = np.round(np.log(level) / ALIKE)
    return np.lexsort((np.arange(len(level)), -rounded))


def _named(asked: Asked) -> list[tuple[str, Places]]:
    both = (("surface", asked.surface), ("virtual", asked.virtual))
    return [(name, own) for name, own in both if own is not None]


def _damage(
    places: Places,
    own: DamageSettings,
    of_mean: tuple[np.ndarray, np.ndarray],
    which: np.ndarray,
    drawn: list[np.ndarray],
) -> DamageAt:
    curve, _ = curve_of(own)
    none = np.full((3, len(places)), np.nan)
    damage, ranges = none, none.copy()
    if drawn:
        # one after the other, so that no more than one of both is sorted at a time
        values = np.stack(drawn)
        damage[:, which] = _rows(interval_of(values[:, 0]))
        ranges[:, which] = _rows(interval_of(values[:, 1]))

    def equivalent(moment: np.ndarray) -> np.ndarray:
        return equivalent_range(own.repetitions * moment, curve, own.equivalent_cycles)

    repeated = own.repetitions * damage
    return DamageAt(
        position=places.position,
        element=places.element,
        of_mean=own.repetitions * of_mean[0],
        damage=repeated[0],
        low=repeated[1],
        high=repeated[2],
        range_of_mean=equivalent(of_mean[1]),
        range=equivalent(ranges[0]),
        range_low=equivalent(ranges[1]),
        range_high=equivalent(ranges[2]),
    )


def _rows(found: Interval) -> np.ndarray:
    return np.stack([found.median, found.low, found.high])


def damage_notes(own: DamageSettings, withheld: str, shown: float, by: str) -> tuple[str, ...]:
    """What a reader of damage has to know, in sentences; by: how loads walk in the draws, empty where as stated."""
    if withheld:
        return (
            "σ is withheld, and the interval of damage with it: what is given is damage of the smoothed history, which is "
            "too small where that is smoother than the truth",
        )
    few = (
        ""
        if own.points is None
        else f", of the surface at the {own.points} points most damaged by the smoothed history"
    )
    why = (
        "because below that it was not looked at"
        if shown == SHOWN_DECIDED
        else "because it was measured not to hold the truth"
    )
    return (
        *((by,) if by else ()),
        f"damage is the median of {own.draws} draws with the interval of 95 %{few}; where the equivalent range is below "
        f"{shown:g} of the largest the interval is withheld, {why}, and damage is that of the smoothed history",
    )


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
