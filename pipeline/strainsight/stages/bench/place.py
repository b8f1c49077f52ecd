"""place: gauges of a bench's flexible body for its unknown inputs, with a bound and layouts drawn at random beside them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from strainsight.cases.bench.bench import Bench, bench_of
from strainsight.cases.bench.inverse.unknowns import asked
from strainsight.cases.bench.layout.linear import expected_std, scenario_of
from strainsight.cases.bench.layout.output import Found, output_of
from strainsight.cases.bench.layout.placed import layout_of
from strainsight.cases.bench.layout.pool import GaugePool, gauge_pool
from strainsight.cases.bench.layout.scales import refuse_sizes
from strainsight.cases.bench.loads import load_units, loads_of
from strainsight.cases.bench.start import start_of
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.place import BenchPlace
from strainsight.errors import InfeasibleError, blame
from strainsight.multibody.inverse.linear import LinearBench, linear_bench
from strainsight.placement.baselines import random_sets
from strainsight.placement.certificate import certify
from strainsight.placement.elimination import eliminate
from strainsight.placement.exchange import exchange
from strainsight.placement.limits import Limits, limits_of
from strainsight.placement.scenario import whole_pool_weight
from strainsight.records.bench_placed import PLACED
from strainsight.stages.bench.inputs import bodies
from strainsight.stages.bench.inputs import meshes as body_meshes
from strainsight.workflow.output import Output
from strainsight.workflow.stage import Context, Stage


def run(context: Context) -> Output:
    """Linearise about the static equilibrium, screen, eliminate, exchange, certify; draw layouts to compare with."""
    config, place = context.config, context.config.place
    reduced, meshes = bodies(context), body_meshes(context)
    bench = bench_of(config, reduced, meshes)
    inputs = tuple(name for name in bench.system.inputs if name in config.estimate.inputs)
    q, u = _equilibrium(context, bench)
    linear = _linear(config, bench, q, u, inputs)
    modal = bench.system.modal(place.body)
    context.progress("candidates", 0.1)
    pool = gauge_pool(meshes[place.body], reduced[place.body].basis, linear.static[modal], inputs, place)
    refuse_sizes(linear, pool.response, float(place.noise), inputs)
    found = _find(context, bench, linear, pool, inputs, pool.rows @ q[modal])
    return output_of(found)


def _equilibrium(context: Context, bench: Bench) -> tuple[np.ndarray, np.ndarray]:
    """The static equilibrium under the loads at t = 0, whatever the simulation starts from, and those loads."""
    u = loads_of(context.config, bench, context.files)(np.zeros(1))[0]
    settings = context.config.simulate.model_copy(update={"start": "equilibrium"})
    with blame("simulate"):
        return start_of(bench, settings, u)[0], u


def _linear(config: BenchConfig, bench: Bench, q: np.ndarray, u: np.ndarray, inputs: tuple[str, ...]) -> LinearBench:
    estimate = asked(config)
    h = config.simulate.time_step if estimate.time_step is None else estimate.time_step
    share = h if estimate.increments == "second" else 1.0
    increment = share * np.array([estimate.inputs[name].increment for name in inputs])
    places = [bench.system.inputs.index(name) for name in inputs]
    return linear_bench(bench.system, q, u, bench.theta, places, increment, h)


def _find(
    context: Context, bench: Bench, linear: LinearBench, pool: GaugePool, inputs: tuple[str, ...], resting: np.ndarray
) -> Found:
    place, disturbance = context.config.place, float(context.config.estimate.disturbance)
    noise, kept = float(place.noise), pool.kept
    rows = np.zeros((len(pool.rows), bench.system.size))
    rows[:, bench.system.modal(place.body)] = pool.rows
    plain = scenario_of(linear, rows[kept], noise, disturbance)
    unknown = np.arange(len(plain.F) - len(inputs), len(plain.F))
    context.progress("elimination", 0.3)
    with blame("place.keep"):
        limits = _limits(place, pool.candidates.position[kept])
        scenario = replace(plain, weight=whole_pool_weight([plain], unknown, inputs))
        result = eliminate([scenario], limits, names=inputs)
    context.progress("exchange", 0.6)
    swapped = exchange(result.pools, result.kept, limits=limits)
    certificate = certify(result.pools, swapped.gauges, float(swapped.cost[-1]), limits=limits)
    context.progress("random layouts", 0.8)
    sets = {PLACED: kept[swapped.gauges]}
    with blame("estimate"):
        claimed = expected_std(linear, rows[sets[PLACED]], noise, disturbance)
    if not np.isfinite(claimed).all():
        raise InfeasibleError(
            f"a filter on the {place.keep} gauges does not detect every input",
            key="place.keep",
            remedy="keep more gauges, or estimate fewer inputs",
        )
    drawn = random_sets(len(rows), int(place.keep), int(place.random), context.seed)
    sets |= {f"random-{i}": gauges for i, gauges in enumerate(drawn, start=1)}
    layouts = {
        name: layout_of(linear, scenario.weight, own, rows[own], noise, disturbance) for name, own in sets.items()
    }
    units = tuple(load_units(context.config, inputs).values())
    return Found(inputs, units, pool, resting, scenario, result, swapped, certificate, layouts)


def _limits(place: BenchPlace, position: np.ndarray) -> Limits:
    near = None
    if place.minimum_spacing > 0:
        near = cKDTree(position).query_pairs(place.minimum_spacing * (1 - 1e-9), output_type="ndarray")
    return limits_of(len(position), int(place.keep), near=near)


PLACE = Stage(
    "place",
    version=4,
    reads=(
        "seed",
        "bodies",
        "frames",
        "joints",
        "bearings",
        "forces",
        "simulate.time_step",
        "simulate.snap_tolerance",
        "estimate.time_step",
        "estimate.increments",
        "estimate.disturbance",
        "estimate.inputs.*.increment",
        "place",
    ),
    upstream=("import", "reduce"),
    files=("forces.*.signal.file",),
    run=run,
)
