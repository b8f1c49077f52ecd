"""The placement on a body of a bench: the bench linearised at rest, its strongest gauges as a pool, layouts to compare."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.bench.bench import BenchConfig, BenchPlace
from strainsight.errors import InfeasibleError, NumericalError, blame
from strainsight.experiment.bench.bench import Bench, bench_of, start_of
from strainsight.experiment.bench.inverse.problem import (
    BenchUnknowns,
    asked,
    corrects_in_a_test,
    free_properties,
    parameter_units,
    unknowns_of,
)
from strainsight.experiment.bench.layout.pool import (
    GaugePool,
    MotionCandidates,
    gauge_pool,
    installation_offs,
    known_of,
    motion_candidates,
    zeroed,
)
from strainsight.experiment.bench.layout.strained import Known, Strained
from strainsight.experiment.bench.loads import load_units, loads_of
from strainsight.experiment.layout.advice import Expectation
from strainsight.experiment.layout.gauge_list import gauge_list
from strainsight.experiment.layout.output import layout_output, layout_record
from strainsight.experiment.layout.placement import Placed, placed
from strainsight.experiment.layout.task import PoolRows, Readings, Task, Unknowns, Whole, layout_limits
from strainsight.experiment.resources import Resources
from strainsight.mesh.model import Mesh
from strainsight.multibody.initial import static_equilibrium
from strainsight.multibody.inverse.linear import LinearBench, linear_bench
from strainsight.placement.baselines import random_sets
from strainsight.placement.limits import Limits
from strainsight.placement.scenario import Pool, solve_pool
from strainsight.records.bench import PLACED, BenchCandidates, BenchLayout, BenchPlaced, ReducedBody
from strainsight.records.record import record_from
from strainsight.runner.output import Output, Scalar, Table
from strainsight.sensors.candidates import UNITS, concatenate

EXACT = (
    "Beside parameters σ here is that of exact gauges: estimate.tolerances are in the ranking, and in σ of estimate."
)
FELT = (1e-6, 1e6)
"""σ of its noise by which one increment of an input moves the gauge that feels it most. Beyond, the Riccati equation has no
digits left, at 1e-8 and 1e8."""
PERIODS = (1e-6, 1e6)
"""Periods in a step: where the last mode has less nothing springs back, where the first has more nothing swings."""


@dataclass(frozen=True)
class BenchPlacement(Placed):
    """All that a placement has found; σ is in the unit of each unknown, inputs before parameters.

    units of the unknowns; on: the body's gauges; layouts: the placed one and those drawn at random, by name; time (poses,) [s]
    and std (poses, unknowns) of the placed one in every pose; scale (unknowns,) as of `Strained`.
    """

    units: tuple[str, ...]
    on: GaugePool
    layouts: dict[str, BenchLayout]
    time: np.ndarray
    std: np.ndarray
    scale: np.ndarray


def placement_of(
    config: BenchConfig, meshes: Mapping[str, Mesh], reduced: Mapping[str, ReducedBody], using: Resources
) -> BenchPlacement:
    """Linearise about the static equilibria, screen, eliminate, exchange, prove; draw layouts to compare with.

    Raises InfeasibleError where no layout within the limits detects every unknown in every pose.
    """
    place = config.place
    assert place is not None
    bench = bench_of(config, reduced, meshes, free=free_properties(asked(config)))
    h = float(asked(config).time_step or config.simulate.time_step)
    unknowns = unknowns_of(bench, h)
    # by what the filter takes the parameters for when it begins
    bench = replace(bench, theta=unknowns.starts[0])
    loads = tuple(name for name in bench.system.inputs if name in asked(config).inputs)
    inputs = (*loads, *unknowns.free)
    time, poses = _poses(config, place, bench, using, place.poses)
    known, increment = known_of(config, unknowns, bench, loads, h, time)
    benches = tuple(_linear(config, bench, q, u, loads, unknowns, increment, h) for q, u in poses)
    modal = bench.system.modal(place.body)
    using.progress("candidates", 0.1)
    static = np.array([linear.static[modal] for linear in benches])
    taken_off, zero = np.zeros_like(static[0]), np.zeros(len(static[0]))
    if (unknowns.free or asked(config).tolerances is not None) and zeroed(config):
        at_zero = poses[0] if time[0] == 0 else _poses(config, place, bench, using, (0.0,))[1][0]
        zero = at_zero[0][modal]
        first = _linear(config, bench, *at_zero, loads, unknowns, increment, h)
        taken_off[:, len(loads) :] = first.static[modal, len(loads) :]
    on = gauge_pool(meshes[place.body], reduced[place.body].basis, static - taken_off, inputs, place)
    for linear in benches:
        refuse_sizes(linear, np.abs(on.response).max(axis=0)[:, : len(loads)], float(place.noise), loads)
    peak = np.max([np.abs(on.rows @ q[modal]) for q, _ in poses], axis=0)
    motion = motion_candidates(config, bench, place, poses, benches, *_unknown_columns(bench, loads, unknowns))
    off = installation_offs(
        config,
        place.body,
        bench,
        using.files,
        meshes[place.body],
        reduced[place.body].basis,
        on.candidates,
        time,
        poses,
        zero,
    )
    strained = _strained(config, place, bench, on, benches, taken_off, motion, off, known)
    on, peak = _with_motion(on, motion, benches), np.concatenate([peak, motion.peak])
    every = _every(place, meshes[place.body], on, inputs, strained) if place.search == "all" else None

    def task(kept: np.ndarray) -> Task:
        return _task(place, config.seed, meshes[place.body], replace(on, kept=kept), inputs, strained, every)

    found = placed(
        [task(on.kept)],
        lambda gauges: _expectation(strained, gauges, inputs),
        lambda gauges: gauge_list(on.candidates, on.names, gauges, ("gauges",), peak, np.full(len(peak), np.inf)),
        using.progress,
        pooled=task,
    )
    units = (*load_units(config, loads).values(), *parameter_units(config, unknowns.free).values())
    layouts, std = _layouts(found, place, strained, on.names), strained.in_poses(found.gauges)
    if len(untold := strained.untold(np.array(list(found.expected.std.values())))):
        names = " and ".join(unknowns.free[i] for i in untold)
        sentence = f"Of {names} the gauges tell next to nothing: σ stays that of the guess, through the whole run."
        found = replace(found, advice=(sentence, *found.advice))
    if known is not None and off.any():
        found = replace(found, advice=(EXACT, *found.advice))
    return BenchPlacement(**vars(found), units=units, on=on, layouts=layouts, time=time, std=std, scale=strained.scale)


def _poses(
    config: BenchConfig, place: BenchPlace, bench: Bench, using: Resources, instants: Sequence[float]
) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Instants (poses,) [s] and the static equilibrium at each, whatever the simulation starts from, with its loads and drives
    at rest; each is sought from the one before."""
    time = np.array(instants)
    u = loads_of(bench, using.files)(time)
    u[:, bench.system.drives.rates] = 0.0
    with blame("simulate"):
        q = start_of(bench.simulated(start="equilibrium"), u[0])[0]
    poses = [(q, u[0])]
    for k in range(1, len(time)):
        try:
            q = static_equilibrium(bench.system, q, u[k], bench.theta)[0]
        except (InfeasibleError, NumericalError) as error:
            raise type(error)(f"at {time[k]:.4g} s {error.what}", key="place.poses", remedy=error.remedy) from error
        poses.append((q, u[k]))
    return time, poses


def _linear(
    config: BenchConfig,
    bench: Bench,
    q: np.ndarray,
    u: np.ndarray,
    loads: tuple[str, ...],
    unknowns: BenchUnknowns,
    increment: np.ndarray,
    h: float,
) -> LinearBench:
    places, by_xi = _unknown_columns(bench, loads, unknowns)
    corrected, method = corrects_in_a_test(config), config.simulate.method
    printed = asked(config).method.noise == "as_printed"
    return linear_bench(bench.system, q, u, bench.theta, places, increment, h, method, corrected, printed, by_xi)


def _unknown_columns(bench: Bench, loads: tuple[str, ...], unknowns: BenchUnknowns) -> tuple[list[int], np.ndarray]:
    """Places of the loads in the system's inputs, and ∂θ/∂ξ (nθ, p)."""
    by_xi = unknowns.coordinates.theta(unknowns.coordinates.xi(bench.theta))[1]
    return [bench.system.inputs.index(name) for name in loads], by_xi


def _strained(
    config: BenchConfig,
    place: BenchPlace,
    bench: Bench,
    on: GaugePool,
    benches: tuple[LinearBench, ...],
    taken_off: np.ndarray,
    motion: MotionCandidates,
    off: np.ndarray,
    known: Known | None,
) -> Strained:
    """Gauges, then sensors of motion; taken_off (r, unknowns): coordinates of the body that zeroed gauges do not tell; off
    (poses, gauges): what their installation does."""
    rows = np.zeros((len(on.rows), bench.system.size))
    rows[:, bench.system.modal(place.body)] = on.rows
    readings = []
    for linear, moved in zip(benches, motion.rows, strict=True):
        H = linear.readings(rows)
        H[:, 2 * len(linear.stiffness) :] -= on.rows @ taken_off
        readings.append(np.vstack([H, moved]))
    noise = np.concatenate([np.full(len(rows), float(place.noise)), motion.noise])
    white = np.hstack([np.zeros((len(benches), len(rows))), motion.white])
    disturbance = float(asked(config).disturbance)
    off = np.hstack([off, np.zeros_like(motion.white)])
    return Strained(benches, tuple(readings), noise, white, disturbance, place.aggregate, off, known)


def _with_motion(on: GaugePool, motion: MotionCandidates, benches: Sequence[LinearBench]) -> GaugePool:
    """All sensors of motion behind the gauges, every one in the pool."""
    first, count = len(on.candidates), len(motion.names)
    response = [still @ linear.static for still, linear in zip(motion.still, benches, strict=True)]
    return replace(
        on,
        candidates=concatenate([on.candidates, motion.candidates]) if count else on.candidates,
        response=np.concatenate([on.response, np.array(response)], axis=1),
        kept=np.concatenate([on.kept, first + np.arange(count)]),
        names=(*on.names, *motion.names),
        price=np.concatenate([on.price, motion.price]),
    )


def _every(
    place: BenchPlace, mesh: Mesh, on: GaugePool, inputs: tuple[str, ...], strained: Strained
) -> tuple[tuple[Pool, ...], Limits]:
    """Every pose with all candidates, and the limits of a layout of them but for its spacing: that has as many as there are pairs
    of neighbours, and a bound without it is one with it."""
    numbers = np.arange(len(on.candidates))
    apart = place.model_copy(update={"minimum_spacing": 0.0})
    with blame("place.keep"):
        units = strained.benches[0].increment
        solved = tuple(solve_pool(scenario, inputs, units) for scenario in strained.scenarios(numbers))
        pool = PoolRows(numbers[:, None], numbers[:, None])
        return solved, layout_limits(apart, pool, mesh, on.candidates, on.price, "place.fixed")


def _task(
    place: BenchPlace,
    seed: int,
    mesh: Mesh,
    on: GaugePool,
    inputs: tuple[str, ...],
    strained: Strained,
    every: tuple[tuple[Pool, ...], Limits] | None,
) -> Task:
    """The pool as a linear problem: every unknown counts in its increments, every gauge is a pool row."""
    linear, kept = strained.benches[0], on.kept
    pool = PoolRows(kept[:, None], kept[:, None])
    price = on.price[kept]
    scenarios = strained.scenarios(kept)
    with blame("place.keep"):
        limits = layout_limits(place, pool, mesh, on.candidates, price, "place.fixed")
        solved = tuple(solve_pool(scenario, inputs, linear.increment) for scenario in scenarios)
    count, modes = len(inputs), len(linear.stiffness)
    moved = linear.B / linear.stiffness[:, None] * linear.increment
    return Task(
        Unknowns(inputs, inputs, np.arange(2 * modes, 2 * modes + count), strained.scale, linear.increment),
        solved,
        on.candidates,
        pool,
        price,
        limits,
        place,
        # rules that look at readings alone take the first pose
        Readings(scenarios[0].H[:, None, :modes], strained.noise[kept, None] ** 2, moved @ moved.T),
        seed,
        aggregate=strained.aggregate,
        relative=False,
        whole=Whole(*every, kept) if every is not None and len(kept) < len(on.candidates) else None,
    )


def _expectation(strained: Strained, gauges: np.ndarray, inputs: tuple[str, ...]) -> Expectation:
    """σ of every unknown (`Strained.summed_up`); raises InfeasibleError where one is lost, NumericalError where it is not
    solved."""
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


def _layouts(found: Placed, place: BenchPlace, strained: Strained, names: Sequence[str]) -> dict[str, BenchLayout]:
    """The placed layout, and as many gauges drawn from all candidates, those that are bonded already among them."""
    expected, candidates = found.expected, found.task.candidates
    metric = found.task.metrics[found.task.criterion.name][0]

    def layout(gauges: np.ndarray, cost: float, std: np.ndarray, without: np.ndarray) -> BenchLayout:
        where = {key: getattr(candidates, key)[gauges] for key in ("position", "direction", "length")}
        sensors = tuple(names[gauge] for gauge in gauges)
        return BenchLayout(candidate=gauges, sensor=sensors, **where, metric=cost, std=std, without=without)

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


def refuse_sizes(linear: LinearBench, response: np.ndarray, noise: float, inputs: Sequence[str]) -> None:
    """Raise InfeasibleError where gauges feel nothing of an input, or next to no noise; or where nothing moves in a step.

    response (m, nu) strain per unit of every unknown input, at rest; noise σ [strain]; inputs: their names.
    """
    felt = np.abs(response).max(axis=0) * linear.increment[: len(inputs)] / noise
    for name, share in zip(inputs, felt, strict=True):
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


def output_of(found: BenchPlacement, mesh: Mesh, length_unit: str) -> Output:
    """Datasets, tables and files; gauges.csv has σ without each gauge in N or N m, and as peak the strain at the start.

    mesh of the body that the gauges are on; length_unit of its deck.
    """
    candidates, inputs, symbol = found.on.candidates, found.task.unknowns.names, found.task.criterion.symbol
    record = BenchPlaced(
        **vars(layout_record(found)),
        inputs=inputs,
        units=found.units,
        candidates=record_from(BenchCandidates, candidates, response=found.on.response[0] / found.scale),
        layouts=found.layouts,
    )
    drawn = [layout.std for name, layout in found.layouts.items() if name != PLACED]
    middle = np.median(drawn, axis=0).tolist() if drawn else []
    numbers: dict[str, Scalar] = {"candidates": len(candidates)}
    numbers |= {f"random.{name}": value for name, value in zip(inputs, middle, strict=bool(middle))}
    rows = tuple(
        (name, f"{own.metric:.4g}", *(f"{value:.4g}" for value in own.std)) for name, own in found.layouts.items()
    )
    layouts = Table("layouts", ("layout", symbol, *(f"σ({name})" for name in inputs)), rows)
    tables: tuple[Table, ...] = (layouts,)
    if len(found.time) > 1:
        worst = found.std.max(axis=0)
        listed = zip(found.time, found.std, strict=True)
        rows = tuple((f"{t:.4g} s", *(f"{x:.4g}" for x in own)) for t, own in listed)
        tables += (Table("poses", ("pose", *(f"σ({name})" for name in inputs)), rows),)
        numbers |= {f"best_pose.{name}": float(x) for name, x in zip(inputs, found.std.min(axis=0), strict=True)}
        numbers |= {f"worst_pose.{name}": float(x) for name, x in zip(inputs, worst, strict=True)}
        numbers["poses"] = len(found.time)
    kinds = np.unique(candidates.quantity).tolist()
    output = layout_output(
        found, record, mesh, length_unit, numbers, {}, tables, " or ".join(UNITS[kind] for kind in kinds)
    )
    return replace(output, message=f"{len(candidates)} → {output.message}")
