"""The placement on a body of a bench: the bench linearised at rest, its strongest gauges as a pool, layouts to compare."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.bench.bench import BenchConfig, BenchPlace
from strainsight.errors import InfeasibleError, blame
from strainsight.experiment.bench.bench import bench_of
from strainsight.experiment.bench.inverse.problem import asked, free_properties, unknowns_of
from strainsight.experiment.bench.layout.pool import (
    GaugePool,
    MotionCandidates,
    gauge_pool,
    installation_offs,
    motion_candidates,
)
from strainsight.experiment.bench.layout.strained import PlacedBody, Strained, known_of, poses_of, zeroed
from strainsight.experiment.layout.advice import Expectation
from strainsight.experiment.layout.gauge_list import GaugeList, gauge_list
from strainsight.experiment.layout.output import layout_output, layout_record
from strainsight.experiment.layout.placement import Placement, Subject, place
from strainsight.experiment.layout.task import PoolReadings, PoolRows, Task, UnknownStates, Whole, layout_limits
from strainsight.experiment.resources import Resources
from strainsight.mesh.model import Mesh
from strainsight.multibody.inverse.linear import LinearBench
from strainsight.placement.baselines import random_sets
from strainsight.placement.limits import Limits
from strainsight.placement.scenario import Pool, solve_pool
from strainsight.records.bench import PLACED, BenchCandidates, BenchLayout, BenchPlaced, ReducedBody
from strainsight.records.record import record_from
from strainsight.runner.output import Output, Scalar, Table
from strainsight.sensors.candidates import concatenate

EXACT = (
    "Beside parameters σ here is that of exact gauges: estimate.tolerances are in the ranking, and in σ of estimate."
)
FELT = (1e-6, 1e6)
"""σ of its noise by which one increment of an input moves the gauge that feels it most. Beyond, the Riccati equation has no
digits left, at 1e-8 and 1e8."""
PERIODS = (1e-6, 1e6)
"""Periods in a step: where the last mode has less nothing springs back, where the first has more nothing swings."""


@dataclass(frozen=True)
class BodyPlacement(Placement):
    """The result of a placement; σ is in the unit of each unknown, inputs before parameters.

    units of the unknowns; pool: the body's gauges; layouts: the placed one and those drawn at random, by name; time (poses,) [s]
    and std (poses, unknowns) of the placed one in every pose; scale (unknowns,) as of `Strained`.
    """

    units: tuple[str, ...]
    pool: GaugePool
    layouts: dict[str, BenchLayout]
    time: np.ndarray
    std: np.ndarray
    scale: np.ndarray


def placement_of(
    config: BenchConfig, meshes: Mapping[str, Mesh], reduced: Mapping[str, ReducedBody], using: Resources
) -> BodyPlacement:
    """Linearise about the static equilibria, screen, eliminate, exchange, prove; draw layouts to compare with.

    Raises InfeasibleError where no layout within the limits detects every unknown in every pose.
    """
    settings = config.place
    assert settings is not None
    bench = bench_of(config, reduced, meshes, free=free_properties(asked(config)))
    h = float(asked(config).time_step or config.simulate.time_step)
    unknowns = unknowns_of(bench, h)
    # by what the filter takes the parameters for when it begins
    bench = replace(bench, theta=unknowns.starts[0])
    body = PlacedBody(
        config, settings, using.files, bench, unknowns, h, meshes[settings.body], reduced[settings.body].basis
    )
    time, poses = np.array(settings.poses), poses_of(body, settings.poses)
    known, increment = known_of(body, time)
    benches = tuple(body.linear(pose, increment) for pose in poses)
    modal, loads = body.modal, len(body.loads)
    using.progress("candidates", 0.1)
    static = np.array([linear.static[modal] for linear in benches])
    taken_off, zero = np.zeros_like(static[0]), np.zeros(len(static[0]))
    if (unknowns.free or asked(config).tolerances is not None) and zeroed(config):
        at_zero = poses[0] if time[0] == 0 else poses_of(body, (0.0,))[0]
        zero = at_zero[0][modal]
        taken_off[:, loads:] = body.linear(at_zero, increment).static[modal, loads:]
    pool = gauge_pool(body, static - taken_off)
    for linear in benches:
        _refuse_sizes(body, linear, np.abs(pool.response).max(axis=0)[:, :loads])
    motion = motion_candidates(body, poses, benches)
    off = installation_offs(body, pool.candidates, time, poses, zero)
    peak = np.max([np.abs(pool.rows @ q[modal]) for q, _ in poses], axis=0)
    rows = np.zeros((len(pool.rows), bench.system.size))
    rows[:, modal] = pool.rows
    readings = []
    for linear, moved in zip(benches, motion.rows, strict=True):
        H = linear.readings(rows)
        H[:, 2 * len(linear.stiffness) :] -= pool.rows @ taken_off
        readings.append(np.vstack([H, moved]))
    strained = Strained(
        benches,
        tuple(readings),
        np.concatenate([np.full(len(rows), float(settings.noise)), motion.noise]),
        np.hstack([np.zeros((len(benches), len(rows))), motion.white]),
        float(asked(config).disturbance),
        settings.aggregate,
        np.hstack([off, np.zeros_like(motion.white)]),
        known,
    )
    subject = _Body(body, _with_motion(pool, motion, benches), strained, np.concatenate([peak, motion.peak]))
    if settings.search == "all":
        subject = replace(subject, every=subject.all_candidates())
    placement = place(subject, using.progress)
    advice = placement.advice
    if len(untold := strained.untold(np.array(list(placement.expected.std.values())))):
        names = " and ".join(unknowns.free[i] for i in untold)
        sentence = f"Of {names} the gauges tell next to nothing: σ stays that of the guess, through the whole run."
        advice = (sentence, *advice)
    if known is not None and off.any():
        advice = (EXACT, *advice)
    return BodyPlacement(
        **vars(replace(placement, advice=advice)),
        units=body.units,
        pool=subject.pool,
        layouts=_layouts(placement, subject),
        time=time,
        std=strained.in_poses(placement.gauges),
        scale=strained.scale,
    )


@dataclass(frozen=True)
class _Body(Subject):
    """Gauges on a body: the linear bench that they strain; pool of candidates, with the largest reading at rest of each (m,);
    every: all candidates in every pose, and their limits, where the bound is to be over them."""

    body: PlacedBody
    pool: GaugePool
    strained: Strained
    peak: np.ndarray
    every: tuple[tuple[Pool, ...], Limits] | None = None

    def tasks(self) -> list[Task]:
        return [self.task_of(self.pool.kept)]

    def task_of(self, gauges: np.ndarray) -> Task:
        """Every unknown counts in its increments, every gauge is a pool row."""
        linear, inputs, candidates = self.strained.benches[0], self.body.inputs, self.pool.candidates
        solved, limits = self._solved(gauges, self.body.place)
        modes = len(linear.stiffness)
        moved = linear.B / linear.stiffness[:, None] * linear.increment
        whole = None
        if self.every is not None and len(gauges) < len(candidates):
            whole = Whole(*self.every, gauges)
        at = np.arange(2 * modes, 2 * modes + len(inputs))
        return Task(
            UnknownStates(inputs, inputs, at, self.strained.scale, linear.increment),
            solved,
            candidates,
            PoolRows(gauges[:, None], gauges[:, None]),
            self.pool.price[gauges],
            limits,
            self.body.place,
            # rules that look at readings alone take the first pose
            PoolReadings(
                self.strained.readings[0][gauges][:, None, :modes],
                self.strained.noise[gauges, None] ** 2,
                moved @ moved.T,
            ),
            self.body.config.seed,
            aggregate=self.strained.aggregate,
            relative=False,
            whole=whole,
        )

    def all_candidates(self) -> tuple[tuple[Pool, ...], Limits]:
        """Every pose with all candidates, and the limits of a layout of them but for its spacing: that has as many as there are
        pairs of neighbours, and a bound without it is one with it."""
        apart = self.body.place.model_copy(update={"minimum_spacing": 0.0})
        return self._solved(np.arange(len(self.pool.candidates)), apart)

    @blame("place.keep")
    def _solved(self, gauges: np.ndarray, settings: BenchPlace) -> tuple[tuple[Pool, ...], Limits]:
        """Every pose with these gauges as a pool, and the limits of a layout of them."""
        rows, price, candidates = PoolRows(gauges[:, None], gauges[:, None]), self.pool.price, self.pool.candidates
        limits = layout_limits(settings, rows, self.body.mesh, candidates, price[gauges], "place.fixed")
        increment, scenarios = self.strained.benches[0].increment, self.strained.scenarios(gauges)
        return tuple(solve_pool(scenario, self.body.inputs, increment) for scenario in scenarios), limits

    def expectation(self, gauges: np.ndarray) -> Expectation:
        """σ of every unknown (`Strained.summed_up`); raises InfeasibleError where one is lost, NumericalError where it is not
        solved."""
        inputs, strained = self.body.inputs, self.strained
        with blame("estimate"):
            std = strained.summed_up(strained.in_poses(gauges))
        if not np.isfinite(std).all():
            raise InfeasibleError(
                f"a filter on the {len(gauges)} gauges does not detect every unknown",
                key="place.keep",
                remedy="keep more gauges, or estimate fewer unknowns",
            )
        without = strained.without_each(gauges)
        return Expectation(dict(zip(inputs, std.tolist(), strict=True)), dict(zip(inputs, without.T, strict=True)))

    def listed(self, gauges: np.ndarray) -> GaugeList:
        unlimited = np.full(len(self.peak), np.inf)
        return gauge_list(self.pool.candidates, self.pool.names, gauges, ("gauges",), self.peak, unlimited)


def _with_motion(pool: GaugePool, motion: MotionCandidates, benches: Sequence[LinearBench]) -> GaugePool:
    """All sensors of motion behind the gauges, every one in the pool."""
    first, count = len(pool.candidates), len(motion.names)
    response = [still @ linear.static for still, linear in zip(motion.still, benches, strict=True)]
    return replace(
        pool,
        candidates=concatenate([pool.candidates, motion.candidates]) if count else pool.candidates,
        response=np.concatenate([pool.response, np.array(response)], axis=1),
        kept=np.concatenate([pool.kept, first + np.arange(count)]),
        names=(*pool.names, *motion.names),
        price=np.concatenate([pool.price, motion.price]),
    )


def _layouts(placement: Placement, subject: _Body) -> dict[str, BenchLayout]:
    """The placed layout, and as many gauges drawn from all candidates, those that are bonded already among them."""
    expected, candidates, strained = placement.expected, placement.task.candidates, subject.strained
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
    drawn = random_sets(len(free), count, some, placement.task.seed) if count else np.zeros((some, 0), dtype=int)
    for i, chosen in enumerate(drawn, start=1):
        gauges = np.concatenate([bonded, free[chosen]])
        cost, std = strained.metric(gauges, metric), strained.claimed(gauges)
        layouts[f"random-{i}"] = layout(gauges, cost, std, strained.without_each(gauges))
    return layouts


def _refuse_sizes(body: PlacedBody, linear: LinearBench, response: np.ndarray) -> None:
    """Raise InfeasibleError where gauges feel nothing of an input, or next to no noise; or where nothing moves in a step.

    response (m, nu) strain per unit of every unknown load, at rest.
    """
    noise = float(body.place.noise)
    felt = np.abs(response).max(axis=0) * linear.increment[: len(body.loads)] / noise
    for name, share in zip(body.loads, felt, strict=True):
        if not FELT[0] <= share <= FELT[1]:
            raise InfeasibleError(
                f"{noise:g}: one increment of {name} moves the gauge that feels it most by {share:.2g} times that, which is "
                f"outside {FELT[0]:g} to {FELT[1]:g}",
                key="place.noise",
                remedy=f"check its unit (1 µm/m is 1e-6), estimate.inputs.{name}.increment and the moduli",
            )
    first, last = np.sqrt(np.maximum(linear.stiffness[[0, -1]], 0.0)) / (2 * np.pi)
    for name, mode, bad in (
        ("last", last, last * linear.h < PERIODS[0]),
        ("first", first, first * linear.h > PERIODS[1]),
    ):
        if bad and mode:
            raise InfeasibleError(
                f"the {name} mode of the bench at rest has {mode:.3g} Hz, a step of {linear.h:g} s is {mode * linear.h:.2g} of "
                f"its periods, which is outside {PERIODS[0]:g} to {PERIODS[1]:g}",
                key="bodies",
                remedy="check length and mass units, moduli and densities, and the time step [s]",
            )


def placement_output(placement: BodyPlacement, mesh: Mesh, length_unit: str) -> Output:
    """Datasets, tables and files; gauges.csv has σ without each gauge in N or N m, and as peak the strain at the start.

    mesh of the body that the gauges are on; length_unit of its deck.
    """
    candidates, inputs = placement.pool.candidates, placement.task.unknowns.names
    record = layout_record(
        BenchPlaced,
        placement,
        inputs=inputs,
        units=placement.units,
        candidates=record_from(BenchCandidates, candidates, response=placement.pool.response[0] / placement.scale),
        layouts=placement.layouts,
    )
    numbers: dict[str, Scalar] = {"candidates": len(candidates)}
    if len(placement.layouts) > 1:
        numbers |= _named("random", inputs, np.median(record.random_std, axis=0))
    rows = [(name, layout.metric, *layout.std) for name, layout in placement.layouts.items()]
    heads = [f"σ({name})" for name in inputs]
    layouts = tuple((name, *(f"{value:.4g}" for value in values)) for name, *values in rows)
    tables = [Table("layouts", ("layout", placement.task.criterion.symbol, *heads), layouts)]
    if len(placement.time) > 1:
        poses = zip(placement.time, placement.std, strict=True)
        rows_of_poses = tuple((f"{t:.4g} s", *(f"{x:.4g}" for x in std)) for t, std in poses)
        tables.append(Table("poses", ("pose", *heads), rows_of_poses))
        numbers |= _named("best_pose", inputs, placement.std.min(axis=0))
        numbers |= _named("worst_pose", inputs, placement.std.max(axis=0))
        numbers["poses"] = len(placement.time)

    output = layout_output(placement, record, mesh, length_unit, numbers, {}, tuple(tables))
    return replace(output, message=f"{len(candidates)} → {output.message}")


def _named(what: str, names: Sequence[str], values: np.ndarray) -> dict[str, float]:
    return {f"{what}.{name}": value for name, value in zip(names, values.tolist(), strict=True)}
