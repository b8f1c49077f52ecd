"""Placement on a body of a bench: linearised bench, pool of the strongest gauges, random layouts for comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.bench.bench import BenchConfig, BenchPlace
from strainsight.errors import InfeasibleError, NumericalError, blame
from strainsight.experiment.bench.bench import bench_of
from strainsight.experiment.bench.inverse.problem import free_properties, parameter_units, unknowns_of
from strainsight.experiment.bench.layout.expectation import (
    Known,
    PlacedBody,
    expected_std,
    factors_along,
    known_of,
    poses_of,
    scenario_of,
    zeroed,
)
from strainsight.experiment.bench.layout.pool import CandidatePool, gauge_pool, motion_pool
from strainsight.experiment.bench.loads import load_units
from strainsight.experiment.layout.advice import Expectation
from strainsight.experiment.layout.gauge_list import GaugeList, gauge_list
from strainsight.experiment.layout.output import layout_output, layout_record
from strainsight.experiment.layout.placement import Placement, Subject, place
from strainsight.experiment.layout.task import PoolReadings, PoolRows, Task, UnknownStates, Whole, layout_limits
from strainsight.experiment.system import Resources
from strainsight.mesh.model import Mesh
from strainsight.multibody.inverse.linear import LinearBench
from strainsight.placement.baselines import random_sets
from strainsight.placement.criteria import Metric
from strainsight.placement.limits import Limits
from strainsight.placement.scenario import Pool, Scenario, solve_pool
from strainsight.records.bench import ReducedBody
from strainsight.records.bench_placed import PLACED, BenchCandidates, BenchLayout, BenchPlaced
from strainsight.records.record import record_from
from strainsight.runner.output import Output, Scalar, Table

EXACT = (
    "The expected σ neglects gauge errors, because parameters are estimated. The ranking of the gauges and σ of the stage "
    "`estimate` include estimate.tolerances."
)
UNIDENTIFIED = 0.9
"""Ratio of σ to that of the guess above which gauges do not identify a parameter."""


def placement_output(
    config: BenchConfig, meshes: Mapping[str, Mesh], reduced: Mapping[str, ReducedBody], using: Resources
) -> Output:
    """Linearise about the static equilibria, screen, eliminate, exchange, prove, and sample layouts for comparison.

    σ is in the unit of each unknown, inputs before parameters; gauges.csv has σ without each gauge, and the strain at the start
    as peak. Raises InfeasibleError if no layout within the limits detects every unknown in every pose."""
    subject = _subject(config, meshes, reduced, using)
    body, pool, inputs = subject.body, subject.pool, subject.body.inputs
    placement = place(subject, using.progress)
    advice = placement.advice
    if len(unidentified := subject.unidentified(np.array(list(placement.expected.std.values())))):
        names = " and ".join(body.unknowns.free[i] for i in unidentified)
        sentence = f"The gauges do not identify {names}: σ never falls below {100 * UNIDENTIFIED:g} % of the initial σ."
        advice = (sentence, *advice)
    if subject.known is not None and pool.off.any():
        advice = (EXACT, *advice)
    placement = replace(placement, advice=advice)
    layouts, in_poses = _layouts(placement, subject), subject.in_poses(placement.gauges)
    units = load_units(config, body.loads) | parameter_units(config, body.unknowns.free)
    record = layout_record(
        BenchPlaced,
        placement,
        inputs=inputs,
        units=tuple(units.values()),
        candidates=record_from(BenchCandidates, pool.candidates, response=pool.response[0] / subject.scale),
        layouts=layouts,
    )
    numbers: dict[str, Scalar] = {"candidates": len(pool.candidates)}
    if len(layouts) > 1:
        numbers |= _named("random", inputs, np.median(record.random_std, axis=0))
    heads = [f"σ({name})" for name in inputs]
    rows = [(name, *(f"{x:.4g}" for x in (layout.metric, *layout.std))) for name, layout in layouts.items()]
    tables = [Table("layouts", ("layout", placement.task.criterion.symbol, *heads), tuple(rows))]
    if len(in_poses) > 1:
        poses = zip(body.place.poses, in_poses, strict=True)
        rows = [(f"{t:.4g} s", *(f"{x:.4g}" for x in std)) for t, std in poses]
        tables.append(Table("poses", ("pose", *heads), tuple(rows)))
        numbers |= _named("best_pose", inputs, in_poses.min(axis=0))
        numbers |= _named("worst_pose", inputs, in_poses.max(axis=0))
        numbers["poses"] = len(in_poses)
    length_unit = config.flexible[body.place.body].mesh.length_unit
    output = layout_output(placement, record, body.mesh, length_unit, numbers, {}, units, tuple(tables))
    return replace(output, message=f"{len(pool.candidates)} → {output.message}")


def _named(what: str, names: Sequence[str], values: np.ndarray) -> dict[str, float]:
    return {f"{what}.{name}": value for name, value in zip(names, values.tolist(), strict=True)}


def _subject(
    config: BenchConfig, meshes: Mapping[str, Mesh], reduced: Mapping[str, ReducedBody], using: Resources
) -> _Body:
    settings = config.place
    assert settings is not None
    bench = bench_of(config, reduced, meshes, free=free_properties(config.estimator))
    unknowns, mesh, basis = unknowns_of(bench, config.filter_step), meshes[settings.body], reduced[settings.body].basis
    # at the initial parameters of the filter
    bench = replace(bench, theta=unknowns.starts[0])
    body = PlacedBody(config, settings, using.files, bench, unknowns, mesh, basis)
    time, poses = np.array(settings.poses), poses_of(body, settings.poses)
    known, increment = known_of(body, time)
    benches = tuple(body.linear(pose, increment) for pose in poses)
    modal, loads = body.modal, len(body.loads)
    using.progress("candidates", 0.1)
    zero_slope = np.zeros((len(benches[0].static[modal]), len(body.inputs)))
    zero = np.zeros(len(zero_slope))
    if (unknowns.free or config.estimator.tolerances is not None) and zeroed(config):
        at_zero = poses[0] if time[0] == 0 else poses_of(body, (0.0,))[0]
        zero = at_zero[0][modal]
        zero_slope[:, loads:] = body.linear(at_zero, increment).static[modal, loads:]
    pool = gauge_pool(body, time, poses, benches, zero, zero_slope).with_more(motion_pool(body, poses, benches))
    subject = _Body(body, benches, pool, known)
    return replace(subject, every=subject.all_candidates()) if settings.search == "all" else subject


@dataclass(frozen=True)
class _Body(Subject):
    """Body as subject of a placement; benches: linearised in every pose; pool: candidates, with installation errors as noise for
    the ranking; known: prior of parameters, None without; every: all candidates in every pose and their limits, None unless the
    bound covers them."""

    body: PlacedBody
    benches: tuple[LinearBench, ...]
    pool: CandidatePool
    known: Known | None = None
    every: tuple[tuple[Pool, ...], Limits] | None = None

    def tasks(self) -> list[Task]:
        return [self.task_of(self.pool.selected)]

    def task_of(self, gauges: np.ndarray) -> Task:
        """Task with a pool of gauges; unknowns are scaled by their increments."""
        linear, inputs, candidates = self.benches[0], self.body.inputs, self.pool.candidates
        solved, limits = self._solved(gauges, self.body.place)
        modes = len(linear.stiffness)
        moved = linear.B / linear.stiffness[:, None] * linear.increment
        whole = None
        if self.every is not None and len(gauges) < len(candidates):
            whole = Whole(*self.every, gauges, self.task_of)
        at = np.arange(-len(inputs), 0)
        return Task(
            UnknownStates(inputs, inputs, at, self.scale, linear.increment),
            solved,
            candidates,
            PoolRows(gauges[:, None], gauges[:, None]),
            self.pool.price[gauges],
            limits,
            self.body.place,
            # rules based on readings use the first pose
            PoolReadings(
                self.pool.readings[0][gauges][:, None, :modes], self.pool.noise[gauges, None] ** 2, moved @ moved.T
            ),
            self.body.config.seed,
            aggregate=self.body.place.aggregate,
            relative=False,
            whole=whole,
        )

    def all_candidates(self) -> tuple[tuple[Pool, ...], Limits]:
        """Every pose with all candidates, and the limits without spacing, as a bound without spacing remains valid."""
        without_spacing = self.body.place.model_copy(update={"minimum_spacing": 0.0})
        return self._solved(np.arange(len(self.pool.candidates)), without_spacing)

    @blame("place.keep")
    def _solved(self, gauges: np.ndarray, settings: BenchPlace) -> tuple[tuple[Pool, ...], Limits]:
        """Every pose with these gauges as pool, and the limits of a layout."""
        rows, price, candidates = PoolRows(gauges[:, None], gauges[:, None]), self.pool.price, self.pool.candidates
        limits = layout_limits(settings, rows, self.body.mesh, candidates, price[gauges], "place.fixed")
        increment, scenarios = self.benches[0].increment, self.scenarios(gauges)
        return tuple(solve_pool(scenario, self.body.inputs, increment) for scenario in scenarios), limits

    def expectation(self, gauges: np.ndarray) -> Expectation:
        """σ of every unknown (`summed_up`). Raises InfeasibleError if one is not detected, NumericalError if not solved."""
        inputs = self.body.inputs
        with blame("estimate"):
            std = self.summed_up(self.in_poses(gauges))
        if not np.isfinite(std).all():
            raise InfeasibleError(
                f"a filter with the {len(gauges)} selected gauges cannot observe every unknown",
                key="place.keep",
                remedy="Increase place.keep, or estimate fewer unknowns.",
            )
        without = self.without_each(gauges)
        return Expectation(dict(zip(inputs, std.tolist(), strict=True)), dict(zip(inputs, without.T, strict=True)))

    def listed(self, gauges: np.ndarray) -> GaugeList:
        pool, unlimited = self.pool, np.full(len(self.pool.candidates), np.inf)
        return gauge_list(pool.candidates, pool.names, gauges, ("gauges",), pool.peak, unlimited)

    @property
    def scale(self) -> np.ndarray:
        """Scale of each unknown (unknowns,): 1 for a load, ∂θ/∂ξ for a parameter."""
        scale = np.ones(len(self.benches[0].increment))
        if self.known is not None:
            scale[len(scale) - len(self.known.slopes) :] = np.abs(np.diag(self.known.slopes))
        return scale

    def in_poses(self, gauges: np.ndarray) -> np.ndarray:
        """Expected σ (poses, unknowns) [N, N m, Pa, m]: steady-state with loads only, inf if unobservable; with parameters at
        the end of each pose of the run."""
        rows, noise, known = [H[gauges] for H in self.pool.readings], self.pool.noise[gauges], self.known
        if known is None:
            triples = zip(self.benches, rows, self.pool.off[:, gauges], strict=True)
            return np.array([expected_std(bench, H, noise, self.body.acceleration, off) for bench, H, off in triples])
        factors = factors_along(
            self.benches, rows, noise, self.body.acceleration, known.increment, known.start, known.steps
        )
        loads = len(known.increment) - len(known.slopes)
        of_theta = [np.vstack([L[:loads], known.slopes @ L[loads:]]) for L in factors]
        return np.array([np.linalg.norm(L, axis=1) for L in of_theta])

    def summed_up(self, std: np.ndarray) -> np.ndarray:
        """From σ in every pose (poses, unknowns): the largest of each load, the last of each parameter."""
        worst = std.max(axis=0)
        if self.known is not None:
            loads = len(worst) - len(self.known.slopes)
            worst[loads:] = std[-1, loads:]
        return np.asarray(worst)

    def unidentified(self, std: np.ndarray) -> np.ndarray:
        """Indices of parameters whose σ (of unknowns,) is hardly below that of the guess."""
        if self.known is None:
            return np.zeros(0, dtype=int)
        loads = len(std) - len(self.known.slopes)
        guess = np.linalg.norm(self.known.slopes @ self.known.start[loads:], axis=1)
        return np.flatnonzero(std[loads:] > UNIDENTIFIED * guess)

    def claimed(self, gauges: np.ndarray) -> np.ndarray:
        """Expected σ over all poses (unknowns,), NaN if not solved."""
        try:
            return self.summed_up(self.in_poses(gauges))
        except NumericalError:
            return np.full(len(self.benches[0].increment), np.nan)

    def without_each(self, gauges: np.ndarray) -> np.ndarray:
        """Expected σ without each gauge (k, unknowns)."""
        return np.array([self.claimed(np.delete(gauges, i)) for i in range(len(gauges))])

    def scenarios(self, gauges: np.ndarray) -> list[Scenario]:
        """Scenarios of every pose with these gauges as pool."""
        pool = self.pool
        return [
            scenario_of(bench, rows[gauges], np.hypot(pool.noise, off)[gauges], self.body.acceleration, white[gauges])
            for bench, rows, white, off in zip(self.benches, pool.readings, pool.white, pool.off, strict=True)
        ]

    def metric(self, gauges: np.ndarray, metric: Metric) -> float:
        """Metric with these gauges, inf if an unknown is unobservable, NaN if not solved accurately."""
        values = []
        for scenario in self.scenarios(gauges):
            try:
                solved = solve_pool(replace(scenario, weight=metric.weight, criterion=metric.criterion))
            except InfeasibleError:
                return float("inf")
            except NumericalError:
                return float("nan")
            values.append(solved.metric.value(solved.P))
        return float(np.mean(values) if self.body.place.aggregate == "mean" else np.max(values))


def _layouts(placement: Placement, subject: _Body) -> dict[str, BenchLayout]:
    """Placed layout and random layouts of the same size, all with the bonded gauges."""
    expected, candidates = placement.expected, placement.task.candidates
    metric = placement.task.metrics[placement.task.criterion.name][0]

    def layout(gauges: np.ndarray, cost: float, std: np.ndarray, without: np.ndarray) -> BenchLayout:
        where = {key: getattr(candidates, key)[gauges] for key in ("position", "direction", "length")}
        sensors = tuple(subject.pool.names[gauge] for gauge in gauges)
        return BenchLayout(candidate=gauges, sensor=sensors, **where, metric=cost, std=std, without=without)

    sigma = np.array(list(expected.std.values())), np.column_stack(list(expected.without.values()))
    layouts = {PLACED: layout(placement.gauges, placement.layout.cost, *sigma)}
    bonded, free = np.flatnonzero(candidates.bonded), np.flatnonzero(~candidates.bonded)
    count = len(placement.gauges) - len(bonded)
    some = int(subject.body.place.random)
    random = random_sets(len(free), count, some, placement.task.seed) if count else np.zeros((some, 0), dtype=int)
    for i, chosen in enumerate(random, start=1):
        gauges = np.concatenate([bonded, free[chosen]])
        cost, std = subject.metric(gauges, metric), subject.claimed(gauges)
        layouts[f"random-{i}"] = layout(gauges, cost, std, subject.without_each(gauges))
    return layouts
