"""What a placement writes and prints: the record that a structure and a bench share, the pool as points, summary, files."""

from __future__ import annotations

from typing import Any

import numpy as np

from strainsight.cases.layout.comparison import Comparison
from strainsight.cases.layout.gauge_list import gauge_csv
from strainsight.cases.layout.placement import Placed
from strainsight.gauges.candidates import channels_of_gauges
from strainsight.gauges.export import uff_text
from strainsight.placement.recommendation import worth_keeping
from strainsight.records.grids import gauge_grid
from strainsight.records.layout import Augmented, Bound, PlacedLayout, PoolTable, Removals, Rules, Selection, metric_key
from strainsight.records.record import Place
from strainsight.workflow.output import Dataset, Scalar


def layout_record(found: Placed) -> PlacedLayout:
    """The record of what was found."""
    task, result, certificate = found.task, found.elimination, found.layout.certificate
    pool, there, metric = task.pool, task.pool.channels >= 0, task.metric
    solved = [own.scenario for own in result.pools]
    several = solved[0].H.ndim == 3
    named = dict(zip(task.unknowns.at.tolist(), task.unknowns.names, strict=True))
    greedy = pool.gauges_of(result.kept)
    cost = {metric_key(metric.criterion.name): result.cost}
    return PlacedLayout(
        augmented=Augmented(
            F=np.array([s.F for s in solved]),
            H=np.array([s.H[there] if several else s.H for s in solved]),
            Q=np.array([s.Q for s in solved]),
            R=np.array([s.r[there] if several else s.r for s in solved]),
            weight=np.array([s.weight for s in solved]),
            scale=np.array([own.scale for own in result.pools]),
        ),
        pool=PoolTable(
            candidate=pool.first, channel=pool.channels[there], row=np.nonzero(there)[0], gauges=pool.gauges
        ),
        elimination=Removals(
            removed=result.removed,
            trace=cost.get("trace"),
            metric=cost.get("metric"),
            rise=result.rise,
            unknowns=tuple(named[state] for state in metric.states.tolist()),
            blocks=result.blocks,
            solves=result.solves,
            ties=np.array([len(tied) for tied in result.ties], dtype=np.int64),
        ),
        residual=result.residual,
        greedy=_selection(found, greedy),
        final=_selection(found, found.gauges, found.listed.peak / found.listed.range),
        loss=found.loss,
        certificate=certificate
        and Bound(lower_bound=certificate.lower_bound, gap=certificate.gap, weights=certificate.weights),
        baseline={
            rule: scores.cost[metric.criterion.name]
            for rule, scores in found.others.scores.items()
            if rule not in ("final", "greedy")
        },
        criteria=_rules(found.others, task.unknowns.names),
        advice=found.advice,
    )


def said_of(found: Placed) -> Place:
    """What `<what>` stands for in that record."""
    return Place("", what=found.task.metric.criterion.symbol)


def _selection(found: Placed, gauges: np.ndarray, load: np.ndarray | None = None) -> Selection:
    pool, candidates = found.task.pool, found.task.candidates
    row = np.array([int(np.flatnonzero((pool.gauges == g).any(axis=1))[0]) for g in gauges])
    rank = np.unique(row, return_index=True, return_inverse=True)
    first = candidates.first[gauges]
    return Selection(
        gauge=row,
        number=gauges,
        channel=channels_of_gauges(candidates.gauge, gauges),
        rank=np.argsort(np.argsort(rank[1]))[rank[2]] + 1,
        element=candidates.element[first],
        facet=candidates.facet[first],
        nodes=candidates.nodes[first],
        position=candidates.position[first],
        direction=candidates.direction[first],
        load=load,
    )


def _rules(others: Comparison, names: tuple[str, ...]) -> Rules:
    scores, sets = list(others.scores.values()), list(others.sets.values())
    criteria = tuple(scores[0].cost)
    # Under a budget the elimination may end with fewer than are in the layout.
    width = max(len(gauges) for gauges in sets)
    return Rules(
        rule=tuple(others.sets),
        gauges=np.array([np.pad(g, (0, width - len(g)), constant_values=-1) for g in sets]),
        name=criteria,
        value=np.array([[s.cost[c] for c in criteria] for s in scores]),
        std={name: np.array([s.std[i] for s in scores]) for i, name in enumerate(names)},
    )


def pool_grid(found: Placed) -> tuple[dict[str, Dataset], dict[str, dict[str, Any]]]:
    """The pool as points: rank in the final set (0: not in it), step at which a gauge was removed (0: never), direction."""
    pool, candidates, removed = found.task.pool, found.task.candidates, found.elimination.removed
    gauge, which = pool.flat
    first = candidates.first[gauge]
    rank, step = np.zeros(len(pool.gauges), dtype=np.int64), np.zeros(len(pool.gauges), dtype=np.int64)
    rank[found.final] = np.arange(1, len(found.final) + 1)
    step[removed] = np.arange(1, len(removed) + 1)
    return gauge_grid(
        candidates.position[first],
        {"rank": rank[which], "removed": step[which], "direction": candidates.direction[first]},
    )


def layout_summary(found: Placed) -> dict[str, Scalar]:
    """The numbers of a layout that scripts read."""
    result, layout = found.elimination, found.layout
    swapped, certificate, proof = layout.exchange, layout.certificate, layout.proof
    criterion = found.task.metric.criterion.name
    key = metric_key(criterion)
    numbers: dict[str, Scalar] = {
        "criterion": criterion,
        "pool": len(found.task.pool.gauges),
        "selected": len(found.gauges),
        f"{key}_initial": float(result.cost[0]),
        f"{key}_greedy": float(result.cost[-1]),
        f"{key}_final": float(layout.cost),
        "worst_failure": float(found.loss.max()),
        "riccati_residual": float(result.residual),
        "riccati_solves": int(result.solves.sum()),
        "ties": sum(1 for tied in result.ties if tied),
    }
    if found.task.limits.plain:
        numbers |= {"worth": worth_keeping(result.cost, len(result.kept))}
    if swapped:
        numbers |= {"exchanges": len(swapped.swaps), "exchange_complete": swapped.complete}
    if proof:
        numbers |= {"proven": proof.proven, "nodes": proof.nodes}
    if certificate:
        numbers |= {"lower_bound": certificate.lower_bound, "gap": certificate.gap}
    return numbers


def layout_files(found: Placed) -> dict[str, bytes]:
    """gauges.csv and gauges.unv, for whoever bonds the gauges and whoever draws them."""
    listed = found.listed
    directions = np.array([own[0] for own in listed.directions])
    return {
        "gauges.csv": gauge_csv(listed, found.expected.without),
        "gauges.unv": uff_text(listed.position, directions, listed.normal, listed.labels).encode(),
    }


def found_message(found: Placed, std: str) -> str:
    """How many gauges of how many, how far from the best at most, and what they tell; std: that in words."""
    certificate, proof = found.layout.certificate, found.layout.proof
    gap = "" if certificate is None else f", gap {100 * max(certificate.gap, 0.0):.3f} %"
    proven = ", proven" if proof is not None and proof.proven else ""
    return f"{len(found.task.pool.gauges)} → {len(found.gauges)}{gap}{proven}, {std}"
