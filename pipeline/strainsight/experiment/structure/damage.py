"""Fatigue damage in a test from samples of the smoothed posterior, with the random-walk model that the measurements favour."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from strainsight.config.damage import DamageSettings
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
    scalar_stress,
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
"""Smallest distance between listed hot spots, relative to the largest extent of the surface."""
SHOWN, SHOWN_DECIDED = 0.5, 0.1
"""Smallest equivalent range, relative to the largest of the surface, for which an interval is reported: if the samples do not
determine the random-walk model, and if they do. Below the first the coverage was too low, below the second it is not
validated (docs/measured.md, Damage)."""
EQUAL = 1e-6
"""Relative difference below which damages are equal, so that the earlier place comes first."""
IN_CACHE = 400_000
"""Largest number of stresses at a time, to fit the processor's cache."""
OTHER = {"random_walk": "integrated_random_walk", "integrated_random_walk": "random_walk"}
DECISIVE = 10.0
"""Decisive difference of ln evidence between two random-walk models (odds of 2·10⁴)."""

T = TypeVar("T")


def damage_of_test(
    config: PlacementConfig,
    skin: Skin,
    virtual: Virtual | None,
    filters: Sequence[RecordFilter],
    results: Sequence[FilteredRecord],
    withheld: str,
    factor: float,
    filters_of: Callable[[PlacementConfig], list[RecordFilter]],
    progress: Callable[[float], None],
) -> tuple[Damaged, tuple[str, ...]]:
    """Damage of all records, without interval if σ is withheld, and notes.

    factor: on σ at positions without gauges, NaN if it is withheld; filters_of: filters for a config with other random-walk
    models of the loads."""
    assert config.estimate is not None
    settings = config.estimate.damage
    assert settings is not None
    withheld = withheld or "σ at positions without gauges is withheld" * bool(np.isnan(factor))
    configured = _Walked(config, filters, [result.grid_run for result in results])
    sampled, changed, undecided = _walks(configured, None if withheld else filters_of)
    shown = SHOWN if undecided else SHOWN_DECIDED
    records = [
        Recorded(
            record.model,
            result.smoothed,
            skin.field.states(result.smoothed.mean),
            None if withheld else histories(by, replace(result, grid_run=grid_run), settings.draws, config.seed),
        )
        for record, result, by, grid_run in zip(filters, results, sampled.filters, sampled.grid_runs, strict=True)
    ]
    damage = damage_in_test(settings, damage_places(skin, virtual), records, progress, shown, factor)
    return damage, damage_notes(settings, withheld, shown, walks_in_words(sampled.config, changed))


def damage_places(skin: Skin, virtual: Virtual | None) -> dict[str, Places]:
    """Places on the surface, and virtual gauges. Raises UserError for a virtual gauge on a laminate or an anisotropic solid."""
    mesh, facets = skin.mesh, skin.facets
    surface = surface_places(skin.model, facet_centres(mesh.position, facets.kind, facets.nodes)[0], facets.element_id)
    if virtual is None:
        return {"surface": surface}
    pool = virtual.pool
    number = {place: i for i, place in enumerate(zip(facets.element_id.tolist(), facets.facet.tolist(), strict=True))}
    below = np.array([number[place] for place in zip(pool.element.tolist(), pool.facet.tolist(), strict=True)])
    if skin.model.laws is not None and (on := np.isin(below, skin.model.laws.facet)).any():
        raise UserError(
            f"on a laminate or anisotropic solid, stress is not proportional to the strain of one measuring grid; "
            f"virtual gauges on such elements: "
            f"{int(on.sum())} (the first on element {pool.element[int(np.argmax(on))]})",
            key="estimate.virtual",
            remedy="Remove these virtual gauges from estimate.virtual; the damage on the surface includes these locations.",
        )
    strain = replace(virtual.change.of_terms(lambda X: X[:, None]), constant=virtual.rows[:, None])
    gauges = Places(pool.position, pool.element, strain, surface.take(below).modulus)
    return {"surface": surface, "virtual": gauges}


@dataclass(frozen=True)
class Recorded:
    """A smoothed record; states (n + f,): indices of q and z; draws (N, T + 1, n + f): posterior samples of these with p, None if
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
    factor: float = 1.0,
) -> Damaged:
    """Damage of the smoothed histories, and its interval if the equivalent range exceeds `shown` times the largest.

        D = Σᵣ Dᵣ,     over records, of one draw of the constants each (Palmgren and Miner)

    places: "surface", "virtual" or both; factor: on the width of intervals, in logarithms. If σ is withheld, the interval is,
    too."""
    of_mean = {name: _of_mean(part, records, settings) for name, part in places.items()}
    # of ranges to the power of the slope
    largest = max(moment.max(initial=0.0) for _, moment in of_mean.values())
    least = shown**settings.curve.slope * largest * (1 - EQUAL)
    which = {name: np.flatnonzero(moment >= least) for name, (_, moment) in of_mean.items()}
    if settings.points is not None and "surface" in places:
        most = _ordered(of_mean["surface"][1])[: settings.points]
        which["surface"] = np.intersect1d(which["surface"], most)
    sampled: dict[str, list[np.ndarray]] = {name: [] for name in which}
    parts = {name: part.take(which[name]) for name, part in places.items()}
    for draws in _joint_samples(records):
        for name, part in parts.items():
            each = [damage_at(part, q, theta_at(record.model, p), settings) for record, p, q in draws]
            sampled[name].append(np.sum(each, axis=0))
        progress(len(sampled[name]) / settings.draws)
    damage = {
        name: _damage(part, settings, of_mean[name], which[name], sampled[name], factor)
        for name, part in places.items()
    }
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


def _joint_samples(records: Sequence[Recorded]) -> Iterator[tuple[tuple[Recorded, np.ndarray, np.ndarray], ...]]:
    """Yield p (k,) and q (T + 1, n) of every record, sample by sample; one sample has the same constants in all records."""

    def one(record: Recorded) -> Iterator[tuple[Recorded, np.ndarray, np.ndarray]]:
        for part in record.draws or ():
            for p, q in zip(part.parameter, part.state, strict=True):
                yield record, p, q

    return zip(*(one(record) for record in records), strict=True)


def theta_at(model: FilterModel, p: np.ndarray) -> dict[str, float]:
    """All parameters [SI] at p (k,) = ln(θ/guess) of the estimated ones."""
    unknowns = model.unknowns
    return dict(model.fixed) | {
        name: float(unknowns.guess[name] * np.exp(value)) for name, value in zip(unknowns.parameters, p, strict=True)
    }


def hot_spots(damage: DamageAt, count: int) -> np.ndarray:
    """Most damaged places of a surface with a distance of at least APART; places without damage are omitted."""
    level = np.where(np.isnan(damage.damage), damage.of_mean, damage.damage)
    near = APART * float(np.ptp(damage.position, axis=0).max())
    chosen: list[int] = []
    for i in _ordered(np.nan_to_num(level, nan=0.0, posinf=np.inf)).tolist():
        if len(chosen) == count or not level[i] > 0:
            break
        distance = np.linalg.norm(damage.position[chosen] - damage.position[i], axis=1)
        if not len(chosen) or distance.min() > near:
            chosen.append(i)
    return np.array(chosen, dtype=np.int64)


def _ordered(level: np.ndarray) -> np.ndarray:
    """Indices of places by descending level, of equal levels by index."""
    with np.errstate(divide="ignore"):
        rounded = np.round(np.log(level) / EQUAL)
    return np.lexsort((np.arange(len(level)), -rounded))


def _damage(
    places: Places,
    settings: DamageSettings,
    of_mean: tuple[np.ndarray, np.ndarray],
    which: np.ndarray,
    sampled: list[np.ndarray],
    factor: float,
) -> DamageAt:
    curve, _ = curve_of(settings)
    damage, moment = np.full((2, 3, len(places)), np.nan)
    if sampled:
        # one after the other to save memory
        values = np.stack(sampled)
        for rows, draws in ((damage, values[:, 0]), (moment, values[:, 1])):
            interval = interval_of(draws).widened(factor)
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
    """Notes on damage; by: random-walk models of the samples, empty if as configured."""
    if withheld:
        return (
            "σ at positions without gauges is withheld, so damage has no interval. The damage of the smoothed strain history is "
            "shown; the true damage may be higher",
        )
    few = ""
    if settings.points is not None:
        few = f", on the surface at the {settings.points} most damaged points"
    why = "not validated" if shown == SHOWN_DECIDED else "unreliable"
    return (
        *((by,) if by else ()),
        f"damage is the median of {settings.draws} random samples with its 95 % interval{few}. Where the damage-equivalent "
        f"stress range is below {shown:g} of the largest one, the interval is {why}, so only the damage of the smoothed strain "
        "history is reported",
    )


@dataclass(frozen=True)
class Places:
    """Places where damage is computed.

    position (p, 3) [m]; element (p,): ids; rows (p, c, r): stress at unit modulus per coordinate, c = 1 (uniaxial) or 6
    [xx yy zz xy yz zx], affine in estimated ply moduli; modulus (p,) [Pa], affine in the parameters."""

    position: np.ndarray
    element: np.ndarray
    rows: AffineOperator
    modulus: AffineOperator

    def __len__(self) -> int:
        return len(self.position)

    def take(self, which: np.ndarray) -> Places:
        """Select places by index."""
        rows, modulus = (operator.of_all(lambda X: X[which]) for operator in (self.rows, self.modulus))
        return replace(self, position=self.position[which], element=self.element[which], rows=rows, modulus=modulus)


def surface_places(surface: SurfaceModel, position: np.ndarray, element: np.ndarray) -> Places:
    """All points of a surface. Raises UserError if a ply modulus and a thickness are both estimated."""
    law, change = AffineOperator(None, {}) if surface.laws is None else surface.laws.stiffness, surface.change
    if law.terms and change.terms:
        plies, thick = (", ".join(operator.parameters) for operator in (law, change))
        raise UserError(
            f"{plies} and {thick} are both estimated, and surface stress depends on their product",
            key="estimate.damage",
            remedy="Remove one of these parameters from place.estimate, or remove estimate.damage.",
        )
    terms = {label: surface.law_stress(surface.strain, X) for label, X in law.terms.items()}
    terms |= {label: surface.unit_stress(X, law.constant) for label, X in change.terms.items()}
    rows = AffineOperator(
        surface.unit_stress(surface.strain, law.constant), terms, {**law.coefficients, **change.coefficients}
    )
    return Places(position, element, rows, surface.modulus)


def curve_of(settings: DamageSettings) -> tuple[Curve, MeanStress]:
    """S-N curve and mean-stress correction for the damage kernel."""
    configured, mean = settings.curve, settings.mean_stress
    ends = (configured.knee, configured.second_slope, configured.cut_off)
    curve = Curve(
        configured.stress * (2.0 if configured.of == "amplitude" else 1.0),
        configured.cycles,
        configured.slope,
        *(np.inf if value is None else value for value in ends),
    )
    constant = mean.tensile_strength if mean.rule == "goodman" else mean.sensitivity
    return curve, MeanStress({"none": NONE, "goodman": GOODMAN, "fkm": FKM}[mean.rule], constant or 0.0)


def damage_at(
    places: Places, q: np.ndarray, theta: Mapping[str, float], settings: DamageSettings
) -> tuple[np.ndarray, np.ndarray]:
    """Miner's sum and moment (p,) by `damage_of` for a motion q (T + 1, r) at parameters [SI]."""
    curve, mean = curve_of(settings)
    rows = places.rows.at(theta)
    count, components, r = rows.shape
    E, motion = np.asarray(places.modulus.at(theta)), np.ascontiguousarray(q.T)
    part = max(1, IN_CACHE // (components * len(q)))
    miner, moment = np.empty(count), np.empty(count)
    for start in range(0, count, part):
        here = slice(start, start + part)
        stress = (rows[here].reshape(-1, r) @ motion).reshape(-1, components, len(q))
        one = stress[:, 0] if components == 1 else scalar_stress(stress, settings.stress)
        sums = damage_of(E[here, None] * one, curve, mean)
        miner[here], moment[here] = sums.miner, sums.moment
    return miner, moment


@dataclass(frozen=True)
class _Walked:
    """Filters with one choice of random-walk models; grid_runs: None for other filter methods."""

    config: PlacementConfig
    filters: Sequence[RecordFilter]
    grid_runs: Sequence[GridRun | None]


def _walks(
    configured: _Walked, filters_of: Callable[[PlacementConfig], list[RecordFilter]] | None
) -> tuple[_Walked, Sequence[str], Sequence[str]]:
    """Choose the random-walk models of the unknown loads from the evidence of all records; filters_of: None without sampling."""
    unknown = configured.filters[0].problem.unknowns.inputs
    if filters_of is None or not may_walk_otherwise(configured.config, unknown):
        return configured, (), unknown or ("motion",)

    def other(so_far: _Walked, name: str) -> _Walked | None:
        changed = walking(so_far.config, name)
        try:
            filters = filters_of(changed)
            return _Walked(changed, filters, filter_records_on_grid(filters))
        except (NumericalError, np.linalg.LinAlgError):
            return None

    def evidence(walked: _Walked) -> float:
        return float(sum(grid_run.run.log_likelihood[0] for grid_run in walked.grid_runs if grid_run is not None))

    return walks(configured, unknown, other, evidence)


def histories(record: RecordFilter, result: FilteredRecord, count: int, seed: int) -> Iterator[Paths]:
    """Yield `count` posterior samples of q (N, T + 1, n) with their parameters, in parts, by the parameter grid filter if it ran.

    A drifting parameter is replaced by its mean over the record."""
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
    configured: T, loads: Sequence[str], other: Callable[[T, str], T | None], evidence: Callable[[T], float]
) -> tuple[T, Sequence[str], Sequence[str]]:
    """Choose the random-walk model of each load in turn; the other model needs DECISIVE more evidence:

        ln p(y | other walk) − ln p(y | walk so far)

    with everything else integrated out. other: the same with the other model of one load, None if the filter diverges;
    evidence: ln p(y). Returns the best choice, the loads with a changed model, and the undecided loads."""
    best, level = configured, evidence(configured)
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
    """Config with the other random-walk model of one load and the same κ."""
    load = config.loads[name]
    noise = load.process_noise.model_copy(update={"model": OTHER[load.process_noise.model]})
    return config.model_copy(update={"loads": {**config.loads, name: load.model_copy(update={"process_noise": noise})}})


def may_walk_otherwise(config: PlacementConfig, unknown: Sequence[str]) -> bool:
    """Whether random-walk models can be compared: all unknown loads have one, with intensities independent of the time step, and
    the parameter grid filter provides the evidence."""
    configured = all(config.loads[name].process_noise.model in OTHER for name in unknown)
    return configured and config.filter.method == "grid" and config.process_noise.rule == "continuous"


def walks_in_words(config: PlacementConfig, changed: Sequence[str]) -> str:
    """Describe changed random-walk models; empty without any."""
    if not changed:
        return ""
    each = [(f"loads.{name}.process_noise.model", config.loads[name].process_noise.model) for name in changed]
    keys = ", ".join(f"{key}: {model}" for key, model in each)
    return (
        f"the measurements favour another random-walk model of {', '.join(changed)} than the configured one. Damage uses the "
        f"favoured model; loads, strains and their σ use the configured one. For all results by the favoured model, set {keys}"
    )
