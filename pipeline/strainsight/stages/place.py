"""place: gauges leave one by one by the steady error covariance, exchanges, a bound on what any layout could reach (5.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.augmentation.observability import Observability, observability
from strainsight.cases.structure.advice import advice, advice_table
from strainsight.cases.structure.channels import largest_of_quantity
from strainsight.cases.structure.comparison import Comparison, comparison
from strainsight.cases.structure.expectation import Expectation, alike_gauges, expectation
from strainsight.cases.structure.gauge_list import gauge_csv, gauge_list, gauge_table
from strainsight.cases.structure.layout import Layout, gauge_losses, layout_of
from strainsight.cases.structure.pool import PoolRows, layout_cost, limits_of_config, pool_of
from strainsight.cases.structure.problem import Problem
from strainsight.cases.structure.scenarios import metrics_of, scenarios_of
from strainsight.errors import blame
from strainsight.gauges.candidates import Candidates
from strainsight.gauges.export import uff_text
from strainsight.placement.criteria.criterion import Criterion
from strainsight.placement.elimination import Elimination, eliminate_from
from strainsight.placement.ordering import tied_order
from strainsight.placement.recommendation import worth_keeping
from strainsight.placement.scenario import Scenario, solved
from strainsight.records.placement import (
    augmented_datasets,
    certificate_datasets,
    comparison_datasets,
    criteria_table,
    elimination_datasets,
    expectation_datasets,
    metric_key,
    observability_datasets,
    place_message,
    placed_grid,
    selection_datasets,
)
from strainsight.rom.model import modal_basis
from strainsight.stages import inputs
from strainsight.workflow.output import Dataset, Output, Scalar
from strainsight.workflow.stage import Context, Stage


@dataclass(frozen=True)
class _Found:
    """All that a placement has found; gauges (k,): numbers of the gauges of the layout, the most missed first; loss (k,):
    the metric when each fails."""

    pool: PoolRows
    result: Elimination
    layout: Layout
    final: np.ndarray
    gauges: np.ndarray
    loss: np.ndarray
    expected: Expectation
    others: Comparison
    condition: Observability
    words: tuple[str, ...]
    plain: bool

    @property
    def criterion(self) -> Criterion:
        return self.result.pools[0].metric.criterion


def run(context: Context) -> Output:
    """Linearise along the training run, eliminate, exchange, certify, and say what the layout is expected to know."""
    problem, candidates = inputs.problem(context), inputs.training(context).candidates
    found = _find(context, problem, candidates)
    return _output(context, problem, candidates, found)


def _find(context: Context, problem: Problem, candidates: Candidates) -> _Found:
    config, settings = context.config, context.config.place
    channels, unknowns = problem.channels, problem.unknowns
    pool = pool_of(inputs.screened(context).kept, channels, candidates, settings.symmetry)
    mesh = inputs.mesh(context)
    with blame("place.keep"):
        limits = limits_of_config(config, pool, mesh, channels, candidates)
    ranges = {name: entry.range for name, entry in config.parameters.items()}
    with blame("place.estimate"):
        scenarios = scenarios_of(problem, pool.channels, settings, ranges, context.seed)
        pools = context.sweep(solved, scenarios, unknowns.state_names)
    metrics = metrics_of(problem, pools, settings)
    metric = metrics[settings.criterion]
    context.progress("elimination", 0.0)
    with blame("place.keep"):
        pools = [own.under(metric) for own in pools]
        result = eliminate_from(pools, limits, settings.aggregate, names=unknowns.state_names)
        layout = layout_of(result.pools, result.kept, limits, settings, context.progress)
    gauges = pool.gauges_of(layout.gauges)
    expected = expectation(problem, gauges)
    final = _most_missed_first(
        pool, layout.gauges, gauges, expected.importance(settings.metric_over or unknowns.names)
    )
    ordered = pool.gauges_of(final)
    expected = expected.ordered(np.array([int(np.flatnonzero(gauges == g)[0]) for g in ordered]))
    context.progress("failures and other rules", 0.8)
    loss = gauge_losses(problem, pools, metric, final, ordered, settings, ranges, context.seed)
    others = comparison(
        problem,
        pools,
        metrics,
        settings.criterion,
        pool.channels,
        final,
        result.kept,
        settings.aggregate,
        limits.fixed,
        limits.allows,
        context.seed,
    )
    condition = _observability(context, problem, scenarios[0], pool)
    words = _advice(context, problem, candidates, pool, result, layout, ordered, loss, expected, limits.plain)
    return _Found(pool, result, layout, final, ordered, loss, expected, others, condition, words, limits.plain)


def _most_missed_first(pool: PoolRows, rows: np.ndarray, gauges: np.ndarray, importance: np.ndarray) -> np.ndarray:
    """Pool rows in the order in which their gauges are missed, the lower row first of those missed alike."""
    missed = [importance[np.isin(gauges, pool.gauges[row])].sum() for row in rows]
    return rows[tied_order(-np.array(missed))]


def _observability(context: Context, problem: Problem, scenario: Scenario, pool: PoolRows) -> Observability:
    p, n = problem, problem.model.size
    frequency = np.sqrt(modal_basis(p.model, p.model.reference)[0])
    amplitude = float(np.sqrt(np.sum((p.x[:, :n] * frequency) ** 2 + p.x[:, n:] ** 2, axis=1)).max())
    there = pool.channels >= 0
    used = pool.channels[there]
    strain, quantity = inputs.training(context).reading[:, used], p.channels.quantity[used]
    H = scenario.H[there] if scenario.H.ndim == 3 else scenario.H
    return observability(
        scenario.F,
        H / largest_of_quantity(strain, quantity)[:, None],
        names=p.unknowns.state_names,
        frequency=frequency,
        state_amplitude=amplitude,
        largest_strain=1.0,
        raw_scale=p.unknowns.state_scale,
        raw_rows=H,
    )


def _advice(
    context: Context,
    problem: Problem,
    candidates: Candidates,
    pool: PoolRows,
    result: Elimination,
    layout: Layout,
    gauges: np.ndarray,
    loss: np.ndarray,
    expected: Expectation,
    plain: bool,
) -> tuple[str, ...]:
    listed = gauge_list(gauges, problem.channels, inputs.training(context), inputs.screened(context))
    return advice(
        labels=listed.labels,
        criterion=result.pools[0].metric.criterion,
        over=context.config.place.metric_over or problem.unknowns.names,
        cost=result.cost if plain else result.cost[-1:],
        keep=int(context.config.place.keep),
        kept=len(layout.gauges),
        std=expected.std,
        certificate=layout.certificate,
        groups=alike_gauges(problem, gauges),
        glued=listed.glued,
        load=listed.peak / listed.range,
        loss=loss,
        without=expected.without,
        ties=sum(1 for tied in result.ties if tied),
        price=layout_cost(context.config, candidates, gauges),
        alone=pool.alone,
    )


def _output(context: Context, problem: Problem, candidates: Candidates, found: _Found) -> Output:
    names = problem.unknowns.names
    listed = gauge_list(found.gauges, problem.channels, inputs.training(context), inputs.screened(context))
    greedy = found.pool.gauges_of(found.result.kept)
    grid, grid_attributes = placed_grid(found.pool, found.final, found.result.removed, candidates)
    scales = {f"/expected_std/{n}": {"scale": float(s)} for n, s in zip(names, problem.unknowns.scale, strict=True)}
    first = candidates.first
    return Output(
        datasets=grid
        | augmented_datasets(found.result, found.pool)
        | elimination_datasets(found.result, problem, found.pool)
        | selection_datasets("greedy", found.pool, greedy, candidates, problem.channels)
        | selection_datasets("final", found.pool, found.gauges, candidates, problem.channels)
        | expectation_datasets(problem, found.expected)
        | {
            "/failure/loss": Dataset(
                found.loss,
                "1",
                f"{found.criterion.symbol} when each gauge fails; inf where an unknown is then lost, NaN where not solved",
            ),
            "/advice": Dataset(np.array(found.words, dtype=np.str_), "1", "what to do with the layout"),
            "/selected/final/load": Dataset(
                listed.peak / listed.range,
                "1",
                "largest training reading over the range of every gauge, NaN: none stated",
            ),
        }
        | observability_datasets(found.condition)
        | comparison_datasets(found.others, names)
        | certificate_datasets(found.layout.certificate, found.criterion.symbol),
        attributes=grid_attributes
        | {"/augmented": {"aggregate": context.config.place.aggregate, "criterion": found.criterion.name}}
        | scales,
        summary=_summary(found, len(listed.labels)),
        message=place_message(
            len(found.pool.gauges), len(listed.labels), found.layout.certificate, found.expected.std, found.condition
        ),
        tables=(
            gauge_table(listed, found.expected.without),
            criteria_table(found.others, problem),
            advice_table(found.words),
        ),
        files={
            "gauges.csv": gauge_csv(listed, found.expected.without),
            "gauges.unv": uff_text(
                candidates.position[first][found.gauges],
                candidates.direction[first][found.gauges],
                candidates.normal[first][found.gauges],
                listed.labels,
            ).encode(),
        },
    )


def _summary(found: _Found, selected: int) -> dict[str, Scalar]:
    result, layout = found.result, found.layout
    swapped, certificate, proof = layout.exchange, layout.certificate, layout.proof
    key = metric_key(found.criterion.name)
    named: dict[str, Scalar] = {"criterion": found.criterion.name}
    return (
        named
        | {
            "pool": len(found.pool.gauges),
            "selected": selected,
            f"{key}_initial": float(result.cost[0]),
            f"{key}_greedy": float(result.cost[-1]),
            f"{key}_final": float(layout.cost),
            "worst_failure": float(found.loss.max()),
            "riccati_residual": float(result.residual),
            "riccati_solves": int(result.solves.sum()),
            "condition": found.condition.condition,
            "ties": sum(1 for tied in result.ties if tied),
        }
        | ({"worth": worth_keeping(result.cost, len(result.kept))} if found.plain else {})
        | ({"exchanges": len(swapped.swaps), "exchange_complete": swapped.complete} if swapped else {})
        | ({"proven": proof.proven, "nodes": proof.nodes} if proof else {})
        | ({"lower_bound": certificate.lower_bound, "gap": certificate.gap} if certificate else {})
        | {f"std.{name}": value for name, value in found.expected.std.items()}
        | ({"null_direction": found.condition.null_direction} if found.condition.null_direction else {})
    )


PLACE = Stage(
    "place",
    version=5,
    reads=(
        "seed",
        "loads.*.signal",
        "loads.*.process_noise",
        "parameters.*.process_noise_scale",
        "parameters.*.range",
        "process_noise",
        "train",
        "place",
        "filter",
        "gauges.price",
        "motion_sensors.*.price",
    ),
    upstream=("import", "rom", "train", "screen"),
    files=("loads.*.signal.file",),
    run=run,
)
