"""place: gauges leave one by one by the steady error covariance, exchanges, a bound on what any layout could reach (5.3)."""

from __future__ import annotations

import numpy as np

from strainsight.cases.structure.advice import advice_table
from strainsight.cases.structure.gauge_list import gauge_csv, gauge_table
from strainsight.cases.structure.placement import Placement, placement_of
from strainsight.gauges.candidates import Candidates
from strainsight.gauges.export import uff_text
from strainsight.placement.recommendation import worth_keeping
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
from strainsight.stages import inputs
from strainsight.workflow.output import Dataset, Output, Scalar
from strainsight.workflow.stage import Context, Stage


def run(context: Context) -> Output:
    """The placement, with the pool as points of a grid."""
    training, screened = inputs.training(context), inputs.screened(context)
    found = placement_of(context.config, inputs.mesh(context), inputs.problem(context), training, screened, context)
    return _output(context, training.candidates, found)


def _output(context: Context, candidates: Candidates, found: Placement) -> Output:
    problem, listed, result = found.problem, found.listed, found.elimination
    names = problem.unknowns.names
    greedy = found.pool.gauges_of(result.kept)
    grid, grid_attributes = placed_grid(found.pool, found.final, result.removed, candidates)
    scales = {f"/expected_std/{n}": {"scale": float(s)} for n, s in zip(names, problem.unknowns.scale, strict=True)}
    first = candidates.first
    return Output(
        datasets=grid
        | augmented_datasets(result, found.pool)
        | elimination_datasets(result, problem, found.pool)
        | selection_datasets("greedy", found.pool, greedy, candidates, problem.channels)
        | selection_datasets("final", found.pool, found.gauges, candidates, problem.channels)
        | expectation_datasets(problem, found.expected)
        | {
            "/failure/loss": Dataset(
                found.loss,
                "1",
                f"{found.criterion.symbol} when each gauge fails; inf where an unknown is then lost, NaN where not solved",
            ),
            "/advice": Dataset(np.array(found.advice, dtype=np.str_), "1", "what to do with the layout"),
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
            advice_table(found.advice),
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


def _summary(found: Placement, selected: int) -> dict[str, Scalar]:
    result, layout = found.elimination, found.layout
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
    version=6,
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
