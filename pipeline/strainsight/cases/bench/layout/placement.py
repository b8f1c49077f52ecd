"""The placement on a body of a bench: the bench linearised at rest, its strongest gauges as a pool, layouts to compare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from strainsight.cases.bench.bench import Bench, bench_of
from strainsight.cases.bench.inverse.load_models import increments_of
from strainsight.cases.bench.inverse.unknowns import asked
from strainsight.cases.bench.layout.linear import expected_std, scenario_of
from strainsight.cases.bench.layout.pool import GaugePool, gauge_pool
from strainsight.cases.bench.layout.scales import refuse_sizes
from strainsight.cases.bench.loads import load_units, loads_of
from strainsight.cases.bench.start import start_of
from strainsight.cases.layout.expectation import Expectation
from strainsight.cases.layout.gauge_list import gauge_list
from strainsight.cases.layout.placement import Placed, placed
from strainsight.cases.layout.pool import PoolRows, layout_limits
from strainsight.cases.layout.task import Readings, Task, Unknowns
from strainsight.cases.resources import Resources
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.place import BenchPlace
from strainsight.errors import InfeasibleError, NumericalError, blame
from strainsight.mesh.model import Mesh
from strainsight.multibody.inverse.linear import LinearBench, linear_bench
from strainsight.placement.baselines import random_sets
from strainsight.placement.metric import Metric
from strainsight.placement.scenario import solve_pool
from strainsight.records.bench_placed import PLACED, BenchLayout
from strainsight.records.bodies import ReducedBody


@dataclass(frozen=True)
class BenchPlacement(Placed):
    """All that a placement has found; σ is in N or N m.

    units of the unknown inputs; on: the body's gauges; layouts: the placed one and those drawn at random, by name.
    """

    units: tuple[str, ...]
    on: GaugePool
    layouts: dict[str, BenchLayout]


@dataclass(frozen=True)
class Strained:
    """What gauges of a body mean for the bench: rows (m, n) of its candidates on all coordinates; noise σ [strain] of a sample;
    acceleration [m/s²] of the white force of the filter."""

    bench: LinearBench
    rows: np.ndarray
    noise: float
    acceleration: float

    def claimed(self, gauges: np.ndarray) -> np.ndarray:
        """σ (nu,) [N, N m] that a filter on these gauges comes to claim, NaN where it is not solved."""
        try:
            return expected_std(self.bench, self.rows[gauges], self.noise, self.acceleration)
        except NumericalError:
            return np.full(len(self.bench.increment), np.nan)

    def without_each(self, gauges: np.ndarray) -> np.ndarray:
        """The same without each of them (k, nu)."""
        return np.array([self.claimed(np.delete(gauges, i)) for i in range(len(gauges))])

    def metric(self, gauges: np.ndarray, metric: Metric) -> float:
        """The metric with these gauges; inf where an input is lost, NaN where the equation is not solved to accuracy."""
        own = scenario_of(self.bench, self.rows[gauges], self.noise, self.acceleration)
        try:
            solved = solve_pool(replace(own, weight=metric.weight, criterion=metric.criterion))
        except InfeasibleError:
            return float("inf")
        except NumericalError:
            return float("nan")
        return solved.metric.value(solved.P)


def placement_of(
    config: BenchConfig, meshes: Mapping[str, Mesh], reduced: Mapping[str, ReducedBody], using: Resources
) -> BenchPlacement:
    """Linearise about the static equilibrium, screen, eliminate, exchange, prove; draw layouts to compare with.

    Raises InfeasibleError where no layout within the limits detects every input.
    """
    place = config.place
    assert place is not None
    bench = bench_of(config, reduced, meshes)
    inputs = tuple(name for name in bench.system.inputs if name in asked(config).inputs)
    q, u = _equilibrium(config, bench, using)
    linear = _linear(config, bench, q, u, inputs)
    modal = bench.system.modal(place.body)
    using.progress("candidates", 0.1)
    on = gauge_pool(meshes[place.body], reduced[place.body].basis, linear.static[modal], inputs, place)
    noise = float(place.noise)
    refuse_sizes(linear, on.response, noise, inputs)
    rows = np.zeros((len(on.rows), bench.system.size))
    rows[:, modal] = on.rows
    strained = Strained(linear, rows, noise, float(asked(config).disturbance))
    peak = np.abs(on.rows @ q[modal])
    found = placed(
        [_task(place, config.seed, meshes[place.body], on, inputs, strained)],
        lambda gauges: _expectation(strained, gauges, inputs),
        lambda gauges: gauge_list(
            on.candidates, [""] * on.candidates.gauges, gauges, ("gauges",), peak, np.full(len(peak), np.inf)
        ),
        using.progress,
    )
    units = tuple(load_units(config, inputs).values())
    return BenchPlacement(**vars(found), units=units, on=on, layouts=_layouts(found, place, strained))


def _equilibrium(config: BenchConfig, bench: Bench, using: Resources) -> tuple[np.ndarray, np.ndarray]:
    """The static equilibrium under the loads at t = 0, whatever the simulation starts from, and those loads."""
    u = loads_of(config, bench, using.files)(np.zeros(1))[0]
    settings = config.simulate.model_copy(update={"start": "equilibrium"})
    with blame("simulate"):
        return start_of(bench, settings, u)[0], u


def _linear(config: BenchConfig, bench: Bench, q: np.ndarray, u: np.ndarray, inputs: tuple[str, ...]) -> LinearBench:
    estimate = asked(config)
    h = config.simulate.time_step if estimate.time_step is None else estimate.time_step
    own = dict(zip(estimate.inputs, increments_of(config, h), strict=True))
    increment = np.array([own[name] for name in inputs])
    places = [bench.system.inputs.index(name) for name in inputs]
    stated, method = estimate.method.step_error, config.simulate.method
    corrected = method == "second_order" if stated is None else stated == "estimated"
    return linear_bench(bench.system, q, u, bench.theta, places, increment, h, method, corrected)


def _task(place: BenchPlace, seed: int, mesh: Mesh, on: GaugePool, inputs: tuple[str, ...], strained: Strained) -> Task:
    """The pool as a linear problem: every input counts in its increments, every gauge is a pool row."""
    linear, kept = strained.bench, on.kept
    pool = PoolRows(kept[:, None], kept[:, None])
    price = np.where(on.candidates.bonded[kept], 0.0, float(place.price))
    scenario = scenario_of(linear, strained.rows[kept], strained.noise, strained.acceleration)
    with blame("place.keep"):
        limits = layout_limits(place, pool, mesh, on.candidates, price, "place.fixed")
        solved = solve_pool(scenario, inputs)
    count, modes = len(inputs), len(linear.stiffness)
    moved = linear.B / linear.stiffness[:, None] * linear.increment
    return Task(
        Unknowns(inputs, inputs, np.arange(2 * modes, 2 * modes + count), np.ones(count), linear.increment),
        (solved,),
        on.candidates,
        pool,
        price,
        limits,
        place,
        Readings(scenario.H[:, None, :modes], np.full((len(kept), 1), strained.noise**2), moved @ moved.T),
        seed,
        relative=False,
    )


def _expectation(strained: Strained, gauges: np.ndarray, inputs: tuple[str, ...]) -> Expectation:
    """σ of every input; raises InfeasibleError where one is lost, NumericalError where it is not solved."""
    with blame("estimate"):
        std = expected_std(strained.bench, strained.rows[gauges], strained.noise, strained.acceleration)
    if not np.isfinite(std).all():
        raise InfeasibleError(
            f"a filter on the {len(gauges)} gauges does not detect every input",
            key="place.keep",
            remedy="keep more gauges, or estimate fewer inputs",
        )
    without = strained.without_each(gauges)
    return Expectation(dict(zip(inputs, std.tolist(), strict=True)), dict(zip(inputs, without.T, strict=True)))


def _layouts(found: Placed, place: BenchPlace, strained: Strained) -> dict[str, BenchLayout]:
    """The placed layout, and as many gauges drawn from all candidates, those that are bonded already among them."""
    expected, candidates = found.expected, found.task.candidates
    metric = found.task.metrics[found.task.criterion.name][0]

    def layout(gauges: np.ndarray, cost: float, std: np.ndarray, without: np.ndarray) -> BenchLayout:
        where = {key: getattr(candidates, key)[gauges] for key in ("position", "direction", "length")}
        return BenchLayout(candidate=gauges, **where, metric=cost, std=std, without=without)

    own = np.array(list(expected.std.values())), np.column_stack(list(expected.without.values()))
    layouts = {PLACED: layout(found.gauges, found.layout.cost, *own)}
    bonded, free = np.flatnonzero(candidates.bonded), np.flatnonzero(~candidates.bonded)
    count = len(found.gauges) - len(bonded)
    some, seed = int(place.random), found.task.seed
    drawn = random_sets(len(free), count, some, seed) if count else np.zeros((some, 0), dtype=int)
    for i, chosen in enumerate(drawn, start=1):
        gauges = np.concatenate([bonded, free[chosen]])
        cost, std = strained.metric(gauges, metric), strained.claimed(gauges)
        layouts[f"random-{i}"] = layout(gauges, cost, std, strained.without_each(gauges))
    return layouts
