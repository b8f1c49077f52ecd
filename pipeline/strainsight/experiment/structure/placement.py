"""The placement on a structure: the training run linearised, its gauges as a pool, what the layout is to know, and what is
written of it (5.3)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from strainsight.config.placement import Place, PlacementConfig, Symmetry
from strainsight.errors import ConfigError, InfeasibleError, blame
from strainsight.experiment.layout.advice import Expectation, budget_table
from strainsight.experiment.layout.output import layout_output, layout_record
from strainsight.experiment.layout.placement import Placed, placed
from strainsight.experiment.layout.task import LoadCases, PoolRows, Readings, Task, Unknowns, layout_limits
from strainsight.experiment.resources import Resources
from strainsight.experiment.structure.candidates import Channels, largest_of_quantity, listed_gauges, units_in_words
from strainsight.experiment.structure.clearance import (
    advice_at_gauges,
    at_gauges,
    hot_spot_advice,
    hot_spot_table,
    notes_at_gauges,
    tested_hot_spots,
)
from strainsight.experiment.structure.cost import of_pool_in_words
from strainsight.experiment.structure.expectation import (
    alike_gauges,
    case_table,
    cases_in_words,
    cases_of,
    expectation,
    unresolved_gauges,
    worst_case,
)
from strainsight.experiment.structure.nuisances import not_held_in_words, tolerated
from strainsight.experiment.structure.problem import (
    Problem,
    placed_instants,
    problem_in,
    rests_on_loads_in_words,
    scenarios_of,
)
from strainsight.experiment.structure.references import families
from strainsight.experiment.structure.screening import COHERENCE, avoids_errors
from strainsight.experiment.structure.start import ringing_in_words
from strainsight.experiment.structure.training import Run, run_as_stated, runs_of
from strainsight.loads.histories import instant_values
from strainsight.loads.linearisation import linearise, measurement_rows
from strainsight.loads.observability import Observability, observability
from strainsight.mesh.model import Mesh
from strainsight.placement.scenario import Scenario, solve_pool, solved
from strainsight.records.placed import AtGauges, ByCase, HotSpots, PbhNumbers, budget_of_shares
from strainsight.records.placed import Placed as PlacedRecord
from strainsight.records.record import record_from
from strainsight.records.reduced import Reduced
from strainsight.records.training import Screened, Training
from strainsight.rom.model import modal_basis
from strainsight.runner.output import Output, Scalar, Table
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.symmetry import mirror_partners


@dataclass(frozen=True)
class Placement(Placed):
    """All that a placement has found, with the problem that it is of; σ is relative to the scale of an unknown.

    condition: whether the pool can tell the unknowns, in the load case where it can least; hot_spots: whether the strain at its
    gauges is that of the part, None where the model is not that of a mesh; at_gauges: what their places ask of those who bond,
    None where they are given without a surface; by_case: the load cases, None where there are none.
    """

    problem: Problem
    condition: Observability
    hot_spots: HotSpots | None
    at_gauges: AtGauges | None
    by_case: ByCase | None


def placement_of(
    config: PlacementConfig,
    mesh: Mesh,
    reduced: Reduced,
    problem: Problem,
    training: Training,
    screened: Screened,
    using: Resources,
) -> Placement:
    """Linearise along the training runs, eliminate, exchange, certify, and say what the layout is expected to know.

    Raises InfeasibleError where no layout within the limits detects every unknown.
    """
    settings, candidates = config.place, training.candidates
    posed = _posed(config, reduced, problem, training, screened, using)
    unknowns = problem.unknowns
    pool = pool_of(screened.kept, problem.channels, candidates, settings.symmetry)
    if costs := of_pool_in_words(config, len(pool.gauges), 2 * problem.model.size + len(unknowns.state_names)):
        using.notice(costs)
    price = prices(config, pool, candidates)
    with blame("place.keep"):
        limits = layout_limits(settings, pool, mesh, candidates, price)
    ranges = {name: entry.range for name, entry in config.parameters.items()}

    covariance = _covariance(posed)
    variance = _avoided(config, screened, len(posed))
    avoided = bool(variance.any())

    def scenarios(channels: np.ndarray, share: float) -> list[tuple[Scenario, ...]]:
        return [
            scenarios_of(
                own.problem,
                channels,
                settings,
                ranges,
                config.seed,
                share * own.run.duration * v if share else None,
            )
            for own, v in zip(posed, variance, strict=True)
        ]

    def task(share: float) -> Task:
        found = scenarios(pool.channels, share)
        with blame("place.estimate"):
            pools = using.sweep(solved, tuple(chain(*found)), unknowns.state_names)
        cases = _cases(posed, [len(own) for own in found])
        return Task(
            Unknowns(
                unknowns.names,
                unknowns.state_names,
                np.asarray(unknowns.position(problem.model)),
                unknowns.scale if cases is None else cases.amplitude(),
                np.ones(len(unknowns.names)),
            ),
            tuple(pools),
            candidates,
            pool,
            price,
            limits,
            settings,
            _readings(problem, pool.channels, covariance),
            config.seed,
            settings.aggregate,
            settings.weights,
            coherence=share * config.train.duration,
            cases=cases,
        )

    def expected(gauges: np.ndarray) -> list[Expectation]:
        own = tolerated(config, mesh, reduced, training, problem.channels.of(gauges))
        return [expectation(each.problem, gauges, own) for each in posed]

    found = placed(
        [task(share) for share in ((0.0, COHERENCE) if avoided else (0.0,))],
        lambda gauges: worst_case(expected(gauges), [own.acts for own in posed]),
        lambda gauges: listed_gauges(gauges, training, screened),
        using.progress,
        alike=lambda gauges: alike_gauges(problem, gauges, covariance),
        alone=lambda gauges, coherence: [
            solve_pool(own) for own in chain(*scenarios(problem.channels.of(gauges), COHERENCE if coherence else 0.0))
        ],
    )
    using.progress("hot spots", 0.9)
    hot = tested_hot_spots(config, mesh, reduced, training, found.gauges)
    ringing = [_ringing(own, settings, config.seed) for own in posed]
    first = *ringing, *not_held_in_words(config, reduced, training)
    listed = found.listed
    there = at_gauges(config, mesh, reduced, training, found.gauges)
    spots = hot_spot_advice(hot, listed.labels, listed.bonded.tolist())
    places = advice_at_gauges(there, listed.labels, listed.bonded.tolist())
    listed = replace(listed, notes=notes_at_gauges(there, len(listed.labels)))
    by_case = None if found.task.cases is None else cases_of(found, expected(found.gauges))
    words = () if by_case is None else cases_in_words(by_case, settings.aggregate)
    found = replace(
        found,
        advice=(*filter(None, first), *unresolved_gauges(listed), *spots, *places, *words, *found.advice),
        listed=listed,
    )
    return Placement(
        **vars(found),
        problem=problem,
        condition=_worst_observability(found, posed, pool),
        hot_spots=hot,
        at_gauges=there,
        by_case=by_case,
    )


def _avoided(config: PlacementConfig, screened: Screened, cases: int) -> np.ndarray:
    """`screened.installation` (cases, m), zero where errors of installation are not to be avoided."""
    if not avoids_errors(config):
        return np.zeros((cases, len(screened.noise_std)))
    if screened.installation is None:
        raise ConfigError(
            "the candidates were screened without their errors of installation",
            key="place.installation",
            remedy="screen them with this config",
        )
    return screened.installation


@dataclass(frozen=True)
class Posed:
    """A training run with its estimation problem: x of it, amplitudes and process noise; peak (m,): largest reading of every
    channel."""

    run: Run
    problem: Problem
    peak: np.ndarray

    @property
    def acts(self) -> np.ndarray:
        """Which unknowns act in it (u,) bool: all but the silent loads."""
        return np.array([name not in self.run.silent for name in self.problem.unknowns.names])


def _posed(
    config: PlacementConfig,
    reduced: Reduced,
    problem: Problem,
    training: Training,
    screened: Screened,
    using: Resources,
) -> tuple[Posed, ...]:
    """The load cases, or the loads as stated where there are none."""
    runs = runs_of(config, reduced.model.inputs, using.files)
    if not runs:
        return (Posed(run_as_stated(config, reduced.model.inputs, using.files), problem, training.peak),)
    return tuple(
        Posed(run, problem_in(run, config, using.files, reduced, training, screened), training.cases[run.name].peak)
        for run in runs
    )


def _cases(posed: Sequence[Posed], count: Sequence[int]) -> LoadCases | None:
    """The load cases with so many scenarios each; None of the loads as stated."""
    if not posed[0].run.name:
        return None
    return LoadCases(
        tuple(own.run.name for own in posed),
        np.array([own.run.weight for own in posed]),
        np.repeat(np.arange(len(posed)), count),
        np.array([own.acts for own in posed]),
        np.array([own.problem.unknowns.scale for own in posed]),
    )


def _covariance(posed: Sequence[Posed]) -> np.ndarray:
    """Of the coordinates in training (n, n), the weighed mean over load cases."""
    found = [np.cov(own.problem.x[:, : own.problem.model.size], rowvar=False) for own in posed]
    if len(found) == 1:
        return found[0]
    return np.asarray(np.average(found, axis=0, weights=[own.run.weight for own in posed]))


def _readings(problem: Problem, channels: np.ndarray, covariance: np.ndarray) -> Readings:
    """Rows per reduced coordinate, of accelerometers at the guess; channels (pool, c): rows of train.h5, −1 for none."""
    p, there = problem, channels >= 0
    F = linearise(p.model, p.unknowns, p.model.reference, p.x[:1], instant_values(p.u)[:1])[0]
    every = measurement_rows(p.channels.rows, p.channels.quantity, F)[:, : p.model.size]
    rows = np.where(there[..., None], every[channels], 0.0)
    return Readings(rows, p.channels.noise_std[channels] ** 2, covariance)


def _ringing(posed: Posed, settings: Place, seed: int) -> str:
    """What to know of instants at which a start from rest still rings; without a parameter the instant does not matter."""
    p, case = posed.problem, posed.run.name
    if not p.unknowns.parameters:
        return ""
    instants = placed_instants(p, p.model.reference, p.x, settings, seed)
    said = ringing_in_words(p.settle, p.loading, p.model, instants)
    return f"Load case {case}: {said}" if case and said else said


def _worst_observability(found: Placed, posed: Sequence[Posed], pool: PoolRows) -> Observability:
    """Of the first instant of every load case, that of the largest condition."""
    task = found.task
    first = [0] if task.cases is None else [int(np.flatnonzero(task.cases.of == case)[0]) for case in range(len(posed))]
    every = [
        _observability(own, task.pools[at].scenario.scaled(1 / task.pools[at].scale), pool)
        for own, at in zip(posed, first, strict=True)
    ]
    return max(every, key=lambda own: own.condition)


def _observability(posed: Posed, scenario: Scenario, pool: PoolRows) -> Observability:
    """Of x* as it is, not in the coordinates of a solved pool."""
    p, n = posed.problem, posed.problem.model.size
    frequency = np.sqrt(modal_basis(p.model, p.model.reference)[0])
    amplitude = float(np.sqrt(np.sum((p.x[:, :n] * frequency) ** 2 + p.x[:, n:] ** 2, axis=1)).max())
    there = pool.channels >= 0
    used = pool.channels[there]
    H = scenario.H[there] if scenario.H.ndim == 3 else scenario.H
    return observability(
        scenario.F,
        H / largest_of_quantity(posed.peak[used], p.channels.quantity[used])[:, None],
        names=p.unknowns.state_names,
        frequency=frequency,
        state_amplitude=amplitude,
        largest_strain=1.0,
        raw_scale=p.unknowns.state_scale,
        raw_rows=H,
    )


def pool_of(kept: np.ndarray, channels: Channels, candidates: Candidates, symmetry: Symmetry | None) -> PoolRows:
    """The kept gauges as pool rows: each alone, or with a plane of symmetry in mirrored pairs.

    kept (k,) gauge numbers. Those on the plane that are their own mirror image are alone, as are bonded ones; others without
    a mirror image in the pool are left out. Raises InfeasibleError where nothing is left.
    """
    if symmetry is None:
        return PoolRows(kept[:, None], channels.of(kept), 0)
    with blame("place.symmetry"):
        partner = mirror_partners(candidates, symmetry.point, symmetry.normal)
    bonded = np.zeros(channels.gauges, dtype=bool)
    bonded[candidates.gauge[candidates.bonded]] = True
    there = np.zeros(channels.gauges, dtype=bool)
    there[kept] = True
    pairs = []
    for gauge in kept:
        other = int(partner[gauge])
        if bonded[gauge] or other == gauge:
            pairs.append((int(gauge), -1))
        elif other > gauge and there[other] and not bonded[other]:
            pairs.append((int(gauge), other))
    if not pairs:
        raise InfeasibleError(
            f"none of the {len(kept)} gauges of the pool has a mirror image in it",
            key="place.symmetry",
            remedy="check the plane, keep more candidates (screen.keep: all), or mirror the mesh",
        )
    gauges = np.array(pairs)
    first, second = channels.of(gauges[:, 0]), channels.of(np.maximum(gauges[:, 1], 0))
    second[gauges[:, 1] < 0] = -1
    return PoolRows(gauges, _left_aligned(np.hstack([first, second])), len(kept) - int((gauges >= 0).sum()))


def prices(config: PlacementConfig, pool: PoolRows, candidates: Candidates) -> np.ndarray:
    """Price of every pool row (p,); gauges already bonded cost nothing."""
    family = np.array([float(entry.price) for entry in families(config).values()])
    first = candidates.first[pool.flat[0]]
    return pool.summed(np.where(candidates.bonded[first], 0.0, family[candidates.array[first]]))


def _left_aligned(channels: np.ndarray) -> np.ndarray:
    """The channels of every row in front, −1 behind them, without columns that no row needs."""
    order = np.argsort(channels < 0, axis=1, kind="stable")
    moved = np.take_along_axis(channels, order, axis=1)
    return moved[:, (moved >= 0).any(axis=0)]


def placement_output(found: Placement, mesh: Mesh, length_unit: str) -> Output:
    """Datasets, numbers, tables and files; length_unit of the deck."""
    condition, lost, unknowns = found.condition, found.condition.null_direction, found.task.unknowns
    scale = dict(zip(unknowns.names, unknowns.scale.tolist(), strict=True))
    by_case = found.by_case
    if by_case is not None:
        scale = {name: float(by_case.scale[name][by_case.name.index(by_case.worst[name])]) for name in unknowns.names}
    budget = found.expected.budget
    record = PlacedRecord(
        **vars(layout_record(found)),
        expected_std={name: std * scale[name] for name, std in found.expected.std.items()},
        without=found.expected.without,
        budget=budget_of_shares(budget),
        observability=record_from(PbhNumbers, condition),
        hot_spots=found.hot_spots,
        at_gauges=found.at_gauges,
        by_case=by_case,
    )
    numbers: dict[str, Scalar] = {"condition": condition.condition} | ({"null_direction": lost} if lost else {})
    rests = rests_on_loads_in_words(found.problem)
    numbers |= {"rests_on_loads": rests} if rests else {}
    hot = found.hot_spots
    cases = () if by_case is None else (case_table(by_case, found.task.criterion.symbol),)
    tables: tuple[Table, ...] = (*cases, budget_table(budget))
    if hot is not None:
        numbers |= {"hot_spots": int(hot.hot.sum())}
        tables += (hot_spot_table(hot, found.listed.labels),)
    attributes = {f"/expected_std/{name}": {"scale": size} for name, size in scale.items()}
    unit = units_in_words(found.problem.channels.quantity)
    output = layout_output(found, record, mesh, length_unit, numbers, attributes, tables, unit)
    message = f"{output.message}, hardly observable: {lost}" if lost else output.message
    return replace(output, message=f"{message}; {rests}" if rests else message)
