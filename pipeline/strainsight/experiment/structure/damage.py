"""Fatigue damage in a test, by draws of what the smoother leaves open, with the random walk of its unknown loads that the samples
favour."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from strainsight.config.estimate import DamageSettings
from strainsight.config.placement import PlacementConfig
from strainsight.damage import (
    FKM,
    GOODMAN,
    NONE,
    Curve,
    MeanStress,
    damage_of,
    equivalent_range,
    interval_of,
    one_number,
)
from strainsight.errors import NumericalError, UserError
from strainsight.estimation.grid_filter import GridRun
from strainsight.estimation.grid_filter_smoother import AT_ONCE, Paths, sample_paths
from strainsight.estimation.model import FilterModel
from strainsight.estimation.reduced import driven_with_offsets
from strainsight.estimation.smoother import Smoothed, smoother_errors
from strainsight.experiment.structure.record_filter import FilteredRecord, RecordFilter, filter_records_on_grid
from strainsight.experiment.structure.surface import Skin, Virtual
from strainsight.fem.affine import AffineOperator
from strainsight.fem.recovery import SurfaceModel
from strainsight.records.estimated import DamageAt, Damaged
from strainsight.sensors.surface import facet_centres

APART = 0.05
"""Of the surface's largest extent: no two hot spots that are listed are nearer than this."""
SHOWN, SHOWN_DECIDED = 0.5, 0.1
"""Of the largest equivalent range of the surface, from which a place is given an interval: where the samples do not tell how the
unknown loads walk, and where they do. Below the first the truth was outside too often, below the second it was not looked at
(docs/measured.md, Damage)."""
ALIKE = 1e-6
"""Relative: damages that differ by less are one, and the earlier place comes first."""
IN_CACHE = 400_000
"""Numbers of stress that are held at a time: they stay in the processor's cache."""
OTHER = {"random_walk": "integrated_random_walk", "integrated_random_walk": "random_walk"}
DECISIVE = 10.0
"""Of ln evidence, odds of 2·10⁴: by less the samples do not tell one walk from the other."""

T = TypeVar("T")


def damage_of_test(
    config: PlacementConfig,
    skin: Skin,
    virtual: Virtual | None,
    filters: Sequence[RecordFilter],
    results: Sequence[FilteredRecord],
    withheld: str,
    filters_of: Callable[[PlacementConfig], list[RecordFilter]],
    progress: Callable[[float], None],
) -> tuple[Damaged, tuple[str, ...]]:
    """Damage of all records, without its interval where σ is withheld, and notes on it.

    filters_of: the filters by a config in which loads walk otherwise.
    """
    assert config.estimate is not None
    settings = config.estimate.damage
    assert settings is not None
    stated = _Walked(config, filters, [result.grid_run for result in results])
    drawn, changed, undecided = _walks(stated, None if withheld else filters_of)
    shown = SHOWN if undecided else SHOWN_DECIDED
    records = [
        Recorded(
            record.model,
            result.smoothed,
            skin.field.states(result.smoothed.mean),
            None if withheld else histories(by, replace(result, grid_run=grid_run), settings.draws, config.seed),
        )
        for record, result, by, grid_run in zip(filters, results, drawn.filters, drawn.grid_runs, strict=True)
    ]
    damage = damage_in_test(settings, damage_places(skin, virtual), records, progress, shown)
    return damage, damage_notes(settings, withheld, shown, walks_in_words(drawn.config, changed))


def damage_places(skin: Skin, virtual: Virtual | None) -> dict[str, Places]:
    """The surface, and virtual gauges. Raises UserError for one of these on a laminate or an anisotropic solid."""
    mesh, facets = skin.mesh, skin.facets
    surface = surface_places(skin.model, facet_centres(mesh.position, facets.kind, facets.nodes)[0], facets.element_id)
    if virtual is None:
        return {"surface": surface}
    pool = virtual.pool
    number = {place: i for i, place in enumerate(zip(facets.element_id.tolist(), facets.facet.tolist(), strict=True))}
    below = np.array([number[place] for place in zip(pool.element.tolist(), pool.facet.tolist(), strict=True)])
    if skin.model.laws is not None and (on := np.isin(below, skin.model.laws.facet)).any():
        raise UserError(
            f"{int(on.sum())} grids lie on a laminate or an anisotropic solid, where no modulus makes a stress along "
            f"the grid of its strain (the first on element {pool.element[int(np.argmax(on))]})",
            key="estimate.virtual",
            remedy="leave them out where estimate.damage is asked for: that of the surface is of the stress there",
        )
    strain = replace(virtual.change.of_terms(lambda X: X[:, None]), constant=virtual.rows[:, None])
    gauges = Places(pool.position, pool.element, strain, surface.take(below).modulus)
    return {"surface": surface, "virtual": gauges}


@dataclass(frozen=True)
class Recorded:
    """A record: model, smoothed; states (n + f,): where q and z stand in it; draws of them (N, T + 1, n + f) with p, None where
    σ is withheld."""

    model: FilterModel
    smoothed: Smoothed
    states: np.ndarray
    draws: Iterable[Paths] | None


def damage_in_test(
    settings: DamageSettings,
    places: Mapping[str, Places],
    records: Sequence[Recorded],
    progress: Callable[[float], None],
    shown: float = SHOWN,
) -> Damaged:
    """Damage of the smoothed histories, and its interval over draws where the equivalent range is `shown` of the largest or more.

        D = Σᵣ Dᵣ,     over records, of one draw of the constants each (Palmgren and Miner)

    places "surface", "virtual" or both. Where σ is withheld the interval is, too.
    """
    of_mean = {name: _of_mean(part, records, settings) for name, part in places.items()}
    # of ranges to the power of the slope
    largest = max(moment.max(initial=0.0) for _, moment in of_mean.values())
    least = shown**settings.curve.slope * largest * (1 - ALIKE)
    which = {name: np.flatnonzero(moment >= least) for name, (_, moment) in of_mean.items()}
    if settings.points is not None and "surface" in places:
        most = _ordered(of_mean["surface"][1])[: settings.points]
        which["surface"] = np.intersect1d(which["surface"], most)
    drawn: dict[str, list[np.ndarray]] = {name: [] for name in which}
    parts = {name: part.take(which[name]) for name, part in places.items()}
    for draws in _drawn(records):
        for name, part in parts.items():
            each = [damage_at(part, q, theta_at(record.model, p), settings) for record, p, q in draws]
            drawn[name].append(np.sum(each, axis=0))
        progress(len(drawn[name]) / settings.draws)
    damage = {name: _damage(part, settings, of_mean[name], which[name], drawn[name]) for name, part in places.items()}
    surface = damage.get("surface")
    return Damaged(
        surface=surface,
        virtual=damage.get("virtual"),
        hot_spot=None if surface is None else hot_spots(surface, settings.hot_spots),
        hours=float(settings.repetitions * sum(record.smoothed.time[-1] for record in records) / 3600),
    )


def _of_mean(places: Places, records: Sequence[Recorded], settings: DamageSettings) -> tuple[np.ndarray, np.ndarray]:
    """Damage and moment (p,) of the smoothed histories."""
    each = []
    for record in records:
        mean, model = record.smoothed.mean[:, 0], record.model
        theta = theta_at(model, mean[:, model.parameter_states].mean(axis=0))
        each.append(damage_at(places, mean[:, record.states], theta, settings))
    miner, moment = np.sum(each, axis=0)
    return miner, moment


def _drawn(records: Sequence[Recorded]) -> Iterator[tuple[tuple[Recorded, np.ndarray, np.ndarray], ...]]:
    """Draw by draw: p (k,) and q (T + 1, n) of every record; draws of one number have their constants in common."""

    def one(record: Recorded) -> Iterator[tuple[Recorded, np.ndarray, np.ndarray]]:
        for part in record.draws or ():
            for p, q in zip(part.parameter, part.state, strict=True):
                yield record, p, q

    return zip(*(one(record) for record in records), strict=True)


def theta_at(model: FilterModel, p: np.ndarray) -> dict[str, float]:
    """All parameters [SI] at p (k,) = ln(θ/guess) of those that are estimated."""
    unknowns = model.unknowns
    return dict(model.fixed) | {
        name: float(unknowns.guess[name] * np.exp(value)) for name, value in zip(unknowns.parameters, p, strict=True)
    }


def hot_spots(damage: DamageAt, count: int) -> np.ndarray:
    """The most damaged places of a surface, none within APART of one before; those without any damage are none."""
    level = np.where(np.isnan(damage.damage), damage.of_mean, damage.damage)
    near = APART * float(np.ptp(damage.position, axis=0).max())
    chosen: list[int] = []
    for i in _ordered(np.nan_to_num(level, nan=0.0, posinf=np.inf)).tolist():
        if len(chosen) == count or not level[i] > 0:
            break
        apart = np.linalg.norm(damage.position[chosen] - damage.position[i], axis=1)
        if not len(chosen) or apart.min() > near:
            chosen.append(i)
    return np.array(chosen, dtype=np.int64)


def _ordered(level: np.ndarray) -> np.ndarray:
    """Numbers of places, the largest level first; of levels that are alike the earlier place."""
    with np.errstate(divide="ignore"):
        rounded = np.round(np.log(level) / ALIKE)
    return np.lexsort((np.arange(len(level)), -rounded))


def _damage(
    places: Places,
    settings: DamageSettings,
    of_mean: tuple[np.ndarray, np.ndarray],
    which: np.ndarray,
    drawn: list[np.ndarray],
) -> DamageAt:
    curve, _ = curve_of(settings)
    damage, moment = np.full((2, 3, len(places)), np.nan)
    if drawn:
        # one after the other, so that no more than one of both is sorted at a time
        values = np.stack(drawn)
        for rows, draws in ((damage, values[:, 0]), (moment, values[:, 1])):
            interval = interval_of(draws)
            rows[:, which] = interval.median, interval.low, interval.high

    def equivalent(moment: np.ndarray) -> np.ndarray:
        return equivalent_range(settings.repetitions * moment, curve, settings.equivalent_cycles)

    repeated = settings.repetitions * damage
    return DamageAt(
        position=places.position,
        element=places.element,
        of_mean=settings.repetitions * of_mean[0],
        damage=repeated[0],
        low=repeated[1],
        high=repeated[2],
        range_of_mean=equivalent(of_mean[1]),
        range=equivalent(moment[0]),
        range_low=equivalent(moment[1]),
        range_high=equivalent(moment[2]),
    )


def damage_notes(settings: DamageSettings, withheld: str, shown: float, by: str) -> tuple[str, ...]:
    """Notes on damage, in sentences; by: how loads walk in the draws, empty where as stated."""
    if withheld:
        return (
            "σ is withheld, and the interval of damage with it: what is given is damage of the smoothed history, which is "
            "too small where that is smoother than the truth",
        )
    few = ""
    if settings.points is not None:
        few = f", of the surface at the {settings.points} points most damaged by the smoothed history"
    why = "it was not looked at" if shown == SHOWN_DECIDED else "it was measured not to hold the truth"
    return (
        *((by,) if by else ()),
        f"damage is the median of {settings.draws} draws with the interval of 95 %{few}; where the equivalent range is below "
        f"{shown:g} of the largest the interval is withheld, because {why}, and damage is that of the smoothed history",
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
        rows, modulus = (operator.of_all(lambda X: X[which]) for operator in (self.rows, self.modulus))
        return replace(self, position=self.position[which], element=self.element[which], rows=rows, modulus=modulus)


def surface_places(surface: SurfaceModel, position: np.ndarray, element: np.ndarray) -> Places:
    """Every point of a surface. Raises UserError where a modulus of plies and a thickness are free: their product is."""
    law, change = AffineOperator(None, {}) if surface.laws is None else surface.laws.stiffness, surface.change
    if law.terms and change.terms:
        plies, thick = (", ".join(operator.parameters) for operator in (law, change))
        raise UserError(
            f"{plies} and {thick} are both free, and stress on the faces goes with their product",
            key="estimate.damage",
            remedy="free a modulus of plies or a thickness, or leave damage out",
        )
    terms = {label: surface.law_stress(surface.strain, X) for label, X in law.terms.items()}
    terms |= {label: surface.unit_stress(X, law.constant) for label, X in change.terms.items()}
    rows = AffineOperator(
        surface.unit_stress(surface.strain, law.constant), terms, {**law.coefficients, **change.coefficients}
    )
    return Places(position, element, rows, surface.modulus)


def curve_of(settings: DamageSettings) -> tuple[Curve, MeanStress]:
    """As the kernel takes them."""
    stated, mean = settings.curve, settings.mean_stress
    ends = (stated.knee, stated.second_slope, stated.cut_off)
    curve = Curve(
        stated.stress * (2.0 if stated.of == "amplitude" else 1.0),
        stated.cycles,
        stated.slope,
        *(np.inf if value is None else value for value in ends),
    )
    constant = mean.tensile_strength if mean.rule == "goodman" else mean.sensitivity
    return curve, MeanStress({"none": NONE, "goodman": GOODMAN, "fkm": FKM}[mean.rule], constant or 0.0)


def damage_at(
    places: Places, q: np.ndarray, theta: Mapping[str, float], settings: DamageSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Miner's sum (p,) of one record and its moment (p,), as of `damage_of`, of a motion q (T + 1, r) at parameters [SI]."""
    curve, mean = curve_of(settings)
    rows = places.rows.at(theta)
    count, components, r = rows.shape
    E, motion = np.asarray(places.modulus.at(theta)), np.ascontiguousarray(q.T)
    part = max(1, IN_CACHE // (components * len(q)))
    miner, moment = np.empty(count), np.empty(count)
    for start in range(0, count, part):
        here = slice(start, start + part)
        stress = (rows[here].reshape(-1, r) @ motion).reshape(-1, components, len(q))
        one = stress[:, 0] if components == 1 else one_number(stress, settings.stress)
        sums = damage_of(E[here, None] * one, curve, mean)
        miner[here], moment[here] = sums.miner, sums.moment
    return miner, moment


@dataclass(frozen=True)
class _Walked:
    """Filters by one choice of walks; grid_runs None of another filter."""

    config: PlacementConfig
    filters: Sequence[RecordFilter]
    grid_runs: Sequence[GridRun | None]


def _walks(
    stated: _Walked, filters_of: Callable[[PlacementConfig], list[RecordFilter]] | None
) -> tuple[_Walked, Sequence[str], Sequence[str]]:
    """How unknown loads walk by the samples of all records, for histories that are drawn; filters_of: None where none are."""
    unknown = stated.filters[0].problem.unknowns.inputs
    if filters_of is None or not may_walk_otherwise(stated.config, unknown):
        return stated, (), unknown or ("motion",)

    def other(so_far: _Walked, name: str) -> _Walked | None:
        changed = walking(so_far.config, name)
        try:
            filters = filters_of(changed)
            return _Walked(changed, filters, filter_records_on_grid(filters))
        except (NumericalError, np.linalg.LinAlgError):
            return None

    def evidence(walked: _Walked) -> float:
        return float(sum(grid_run.run.log_likelihood[0] for grid_run in walked.grid_runs if grid_run is not None))

    return walks(stated, unknown, other, evidence)


def histories(record: RecordFilter, result: FilteredRecord, count: int, seed: int) -> Iterator[Paths]:
    """`count` draws of q (N, T + 1, n) with the parameters of each, in parts; by the grid filter where there is one, with z
    behind it, which may be that of other walks of the loads than those of the test's results.

    A parameter that a filter lets drift is its mean over the record.
    """
    model, test, q = record.model, record.test, slice(0, record.model.model.size)
    if result.grid_run is not None:
        yield from sample_paths(record.grid_record, result.grid_run, count, seed, q, record.record)
        return
    core, rng = driven_with_offsets(model, test.known, record.biased), np.random.default_rng(seed)
    part = max(1, AT_ONCE // ((len(test.known) + 1) * core.size))
    for first in range(0, count, part):
        error = smoother_errors(core, result.run, min(part, count - first), rng)
        error += result.smoothed.mean[None, :, 0]
        yield Paths(error[:, :, model.parameter_states].mean(axis=1), error[:, :, q])


def walks(
    stated: T, loads: Sequence[str], other: Callable[[T, str], T | None], evidence: Callable[[T], float]
) -> tuple[T, Sequence[str], Sequence[str]]:
    """Load by load the walk of the larger evidence, by DECISIVE or more:

        ln p(y | other walk) − ln p(y | walk so far)

    everything else integrated out of both. other: the same with the other walk of one load, None where no filter follows the
    samples; evidence: ln p(y). Returns the best, the loads that walk otherwise in it than stated, and those of which the samples
    do not tell one walk from the other.
    """
    best, level = stated, evidence(stated)
    changed, undecided = [], []
    for name in loads:
        tried = other(best, name)
        tried_level = -np.inf if tried is None else evidence(tried)
        if tried is not None and tried_level >= level + DECISIVE:
            best, level = tried, tried_level
            changed.append(name)
        elif tried_level > level - DECISIVE:
            undecided.append(name)
    return best, changed, undecided


def walking(config: PlacementConfig, name: str) -> PlacementConfig:
    """The config with the other walk of one load, κ as stated."""
    load = config.loads[name]
    noise = load.process_noise.model_copy(update={"model": OTHER[load.process_noise.model]})
    return config.model_copy(update={"loads": {**config.loads, name: load.model_copy(update={"process_noise": noise})}})


def may_walk_otherwise(config: PlacementConfig, unknown: Sequence[str]) -> bool:
    """Whether the walks of all unknown loads can be compared: all are one, with intensities that do not depend on the step, and a
    grid filter filters them, with evidence that has everything integrated out."""
    stated = all(config.loads[name].process_noise.model in OTHER for name in unknown)
    return stated and config.filter.method == "bank" and config.process_noise.rule == "continuous"


def walks_in_words(config: PlacementConfig, changed: Sequence[str]) -> str:
    """How loads walk in the draws; config: of the draws; empty where as stated."""
    if not changed:
        return ""
    each = [(f"loads.{name}.process_noise.model", config.loads[name].process_noise.model) for name in changed]
    keys = ", ".join(f"{key}: {model}" for key, model in each)
    return (
        f"the samples speak for another walk of {', '.join(changed)} than is stated, and damage is drawn by it; loads, strains "
        f"and their σ are by that which is stated: {keys} has all by the other"
    )
