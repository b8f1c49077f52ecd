"""Output of a placement on a structure or a bench: record, pool as points, summary, tables and files."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from strainsight.experiment.layout.advice import Expectation, sigma_table, sigma_text
from strainsight.experiment.layout.comparison import RuleComparison, criteria_table
from strainsight.experiment.layout.gauge_list import (
    GaugeList,
    deck_frame,
    gauge_table,
    line_edges,
    marked_places,
    measured_cells,
    measured_columns,
)
from strainsight.experiment.layout.placement import Placement
from strainsight.mesh.model import Mesh
from strainsight.placement.score import worth_keeping
from strainsight.positions import PositionAxes
from strainsight.records.mesh import gauge_grid
from strainsight.records.placed import (
    Augmented,
    LayoutBound,
    PlacedLayout,
    PoolTable,
    Removals,
    Rules,
    Selection,
    metric_key,
)
from strainsight.records.record import FieldPlace, record_from, written
from strainsight.runner.output import Dataset, Output, Scalar, Table, warnings_table
from strainsight.sensors.candidates import channels_of_gauges, grouped, units_in_words
from strainsight.sensors.export import uff_text
from strainsight.text import csv_bytes

R = TypeVar("R", bound=PlacedLayout)
CLUSTER = 0.05
"""Largest distance within a cluster, relative to the extent of all candidates."""


def layout_record(kind: type[R], placement: Placement, **more: Any) -> R:
    """Record of a placement; more: fields specific to structure or bench."""
    task, result, certificate = placement.task, placement.elimination, placement.layout.certificate
    pool, exists, criterion = task.pool, task.pool.channels >= 0, task.criterion
    solved = [pool.scenario for pool in task.weighed_pools(task.pools)]
    several = solved[0].H.ndim == 3
    greedy = pool.gauges_of(result.selected)
    cost = {metric_key(criterion.name): result.cost}
    return kind(
        augmented=Augmented(
            state=task.states,
            F=np.array([s.F for s in solved]),
            H=np.array([s.H[exists] if several else s.H for s in solved]),
            Q=np.array([s.Q for s in solved]),
            R=np.array([s.r[exists] if several else s.r for s in solved]),
            weight=np.array([s.weight for s in solved]),
            scale=np.array([pool.scale for pool in task.pools]),
        ),
        pool=PoolTable(
            candidate=pool.first, channel=pool.channels[exists], row=np.nonzero(exists)[0], gauges=pool.gauges
        ),
        elimination=record_from(
            Removals,
            result,
            trace=cost.get("trace"),
            metric=cost.get("metric"),
            unknowns=task.weighed,
            ties=np.array([len(tied) for tied in result.ties], dtype=np.int64),
        ),
        residual=result.residual,
        greedy=_selection(placement, greedy),
        final=_selection(placement, placement.gauges, placement.listed.most / placement.listed.range),
        loss=placement.loss,
        certificate=None if certificate is None else record_from(LayoutBound, certificate),
        baseline={
            rule: scores.cost[criterion.name]
            for rule, scores in placement.others.scores.items()
            if rule not in ("final", "greedy")
        },
        criteria=_rules(placement.others, task.unknowns.names),
        advice=placement.advice,
        **more,
    )


def layout_output(
    placement: Placement,
    record: PlacedLayout,
    mesh: Mesh,
    length_unit: str,
    numbers: Mapping[str, Scalar],
    attributes: Mapping[str, Mapping[str, Any]],
    units: Mapping[str, str],
    tables: tuple[Table, ...] = (),
) -> Output:
    """Output of a placement; mesh: of the gauges; length_unit: of its deck; units: of the unknowns; numbers, attributes, tables:
    additional ones."""
    task, listed, expected, names = placement.task, placement.listed, placement.expected, placement.task.unknowns.names
    criterion, certificate = task.criterion, placement.layout.certificate
    grid, grid_attributes = _pool_grid(placement)
    parts = [f"{len(task.pool.gauges)} → {len(placement.gauges)}"]
    if certificate:
        over = "" if task.whole is None else f" over all {len(task.whole.limits.size)} candidates"
        parts.append(f"gap of the criterion to its lower bound{over} {100 * max(certificate.gap, 0.0):.3f} %")
    if placement.layout.proven:
        parts.append("proven optimal")
    parts += [f"{n} ± {sigma_text(std, expected.reference.get(n), units[n])}" for n, std in expected.std.items()]
    marked, labels = marked_places(listed)
    unit = units_in_words(task.candidates.quantity)
    of_datasets = {"the channel": unit, "the intensity": f"{grouped(unit)}^2 s"}
    return Output(
        datasets=grid | written(record, of_datasets, FieldPlace("", what=criterion.symbol)),
        attributes={
            **grid_attributes,
            "/augmented": {"aggregate": task.aggregate, "criterion": criterion.name},
            **attributes,
        },
        summary={
            **_summary(placement),
            **{f"std.{name}": value for name, value in expected.std.items()},
            **{f"std_absolute.{name}": value for name, value in expected.absolute.items()},
            **numbers,
        },
        message=", ".join(parts),
        tables=(
            gauge_table(listed, mesh, expected.without, {} if task.relative else units),
            sigma_table(expected, units),
            *warnings_table(placement.advice, "advice", answer=True),
            *tables,
            criteria_table(placement.others, names, [expected.reference[n] for n in names] if task.relative else None),
        ),
        files={
            "gauges.csv": gauge_csv(listed, expected, mesh, deck_frame(length_unit)),
            "gauges.unv": uff_text(marked.position, marked.direction, marked.normal, labels).encode(),
        },
    )


def _selection(placement: Placement, gauges: np.ndarray, load: np.ndarray | None = None) -> Selection:
    pool, candidates = placement.task.pool, placement.task.candidates
    row = np.array([int(np.flatnonzero((pool.gauges == g).any(axis=1))[0]) for g in gauges])
    rank = np.unique(row, return_index=True, return_inverse=True)
    return record_from(
        Selection,
        candidates.take(candidates.first[gauges]),
        gauge=row,
        number=gauges,
        channel=channels_of_gauges(candidates.gauge, gauges),
        rank=np.argsort(np.argsort(rank[1]))[rank[2]] + 1,
        load=load,
    )


def _rules(others: RuleComparison, names: tuple[str, ...]) -> Rules:
    scores, sets = list(others.scores.values()), list(others.sets.values())
    criteria = tuple(scores[0].cost)
    # with a budget, the elimination may keep fewer gauges than the layout has
    width = max(len(gauges) for gauges in sets)
    return Rules(
        rule=tuple(others.sets),
        gauges=np.array([np.pad(g, (0, width - len(g)), constant_values=-1) for g in sets]),
        name=criteria,
        value=np.array([[s.cost[c] for c in criteria] for s in scores]),
        std={name: np.array([s.std[i] for s in scores]) for i, name in enumerate(names)},
    )


def _pool_grid(placement: Placement) -> tuple[dict[str, Dataset], dict[str, dict[str, Any]]]:
    """Point grid of the pool: rank in the layout (0: not in it), step of removal (0: never), direction."""
    pool, candidates, removed = placement.task.pool, placement.task.candidates, placement.elimination.removed
    gauge, which = pool.flat
    first = candidates.first[gauge]
    rank, step = np.zeros(len(pool.gauges), dtype=np.int64), np.zeros(len(pool.gauges), dtype=np.int64)
    rank[placement.final] = np.arange(1, len(placement.final) + 1)
    step[removed] = np.arange(1, len(removed) + 1)
    return gauge_grid(
        candidates.position[first],
        {"rank": rank[which], "removed": step[which], "direction": candidates.direction[first]},
    )


def _summary(placement: Placement) -> dict[str, Scalar]:
    result, layout, criterion = placement.elimination, placement.layout, placement.task.criterion.name
    swapped, certificate, proof = layout.exchange, layout.certificate, layout.proof
    key, candidates = metric_key(criterion), placement.task.candidates
    position = candidates.position[candidates.first[placement.gauges]]
    near = cdist(position, position) <= CLUSTER * float(np.ptp(candidates.position, axis=0).max())
    numbers: dict[str, Scalar] = {
        "criterion": criterion,
        "pool": len(placement.task.pool.gauges),
        "selected": len(placement.gauges),
        "clusters": int(connected_components(near, directed=False)[0]),
        f"{key}_initial": float(result.cost[0]),
        f"{key}_greedy": float(result.cost[-1]),
        f"{key}_final": float(layout.cost),
        "worst_failure": float(placement.loss.max()),
        "riccati_residual": float(result.residual),
        "riccati_solves": int(result.solves.sum()),
        "ties": sum(1 for tied in result.ties if tied),
    }
    if placement.task.limits.plain:
        numbers |= {"worth": worth_keeping(result.cost, len(result.selected))}
    if swapped:
        numbers |= {"exchanges": len(swapped.swaps), "exchange_complete": swapped.complete}
    if proof:
        numbers |= {"proven": layout.proven, "nodes": proof.nodes}
    if placement.task.whole is not None:
        numbers["bounded"] = len(placement.task.whole.limits.size)
    if layout.better is not None:
        numbers["beyond"] = layout.better
    if certificate:
        numbers |= {"lower_bound": certificate.lower_bound, "gap": certificate.gap}
    return numbers


def gauge_csv(listed: GaugeList, expected: Expectation, mesh: Mesh, frame: PositionAxes) -> bytes:
    """CSV with one line per channel or bridge arm: position etc. in m, largest training reading, expected σ of every unknown
    with all gauges (relative and in SI) and without the gauge; then position and edge distances in the deck's unit, and notes."""
    bridged, noted, grids = any(listed.signs), any(listed.notes), listed.grids
    axes = [f"{vector}_{axis}" for vector in ("position", "normal", "direction") for axis in "xyz"]
    head = ["gauge", "kind", "sensors", "glued", "element", "facet", *axes, "angle_deg", "grid_length", "peak", "unit"]
    head += ["sign"] * bridged
    sigma = {f"std_{name}": std for name, std in expected.std.items()}
    sigma |= {f"std_absolute_{name}": std for name, std in expected.absolute.items()}
    without = {f"std_{name}_without": values for name, values in expected.without.items()}
    rows = [[*head, *sigma, *without, *measured_columns(frame), *["notes"] * noted]]
    vectors = np.round(np.hstack([grids.position, grids.normal, grids.direction]), 12) + 0.0
    numbers = np.column_stack([vectors, grids.angle, grids.length, listed.peaks[listed.channel]])
    for line, measured in enumerate(measured_cells(grids, line_edges(grids, mesh), frame)):
        i = listed.gauge[line]
        words = [listed.labels[i], listed.kind[i], listed.family[i], "yes" if listed.bonded[i] else "no"]
        words += [str(grids.element[line]), str(grids.facet[line]), *(f"{x:.9g}" for x in numbers[line])]
        stds = [f"{value:.9g}" for value in (*sigma.values(), *(values[i] for values in without.values()))]
        tail = [listed.unit[i], *[listed.signs[line]] * bridged, *stds, *measured, *listed.notes[i : i + noted]]
        rows.append([*words, *tail])
    return csv_bytes(rows)
