"""What the placement of a bench writes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.cases.bench.layout.placed import Layout, layout_table
from strainsight.cases.bench.layout.pool import GaugePool
from strainsight.cases.structure.gauge_list import GaugeList, gauge_csv
from strainsight.gauges.export import uff_text
from strainsight.placement.certificate import Certificate
from strainsight.placement.elimination import Elimination
from strainsight.placement.exchange import Exchange
from strainsight.placement.scenario import Scenario
from strainsight.records.bench_placed import (
    PLACED,
    AugmentedBench,
    BenchCandidates,
    BenchCertificate,
    BenchElimination,
    BenchLayout,
    BenchPlaced,
)
from strainsight.records.grids import gauge_grid
from strainsight.records.record import written
from strainsight.workflow.output import Output, Scalar, Table


@dataclass(frozen=True)
class Found:
    """All that a placement has found; inputs, units: of the unknown ones; resting (m,): strain of every candidate at the start;
    scenario: of the pool."""

    inputs: tuple[str, ...]
    units: tuple[str, ...]
    pool: GaugePool
    resting: np.ndarray
    scenario: Scenario
    result: Elimination
    swapped: Exchange
    certificate: Certificate
    layouts: dict[str, Layout]


def output_of(found: Found) -> Output:
    """Datasets, tables and files; gauges.csv has σ without each gauge in N or N m, and as peak the strain at the start."""
    pool, candidates, result = found.pool, found.pool.candidates, found.result
    best = found.layouts[PLACED]
    others = [layout for name, layout in found.layouts.items() if name != PLACED]
    step = np.full(len(pool.kept), len(result.removed) + 1)
    step[result.removed] = np.arange(1, len(result.removed) + 1)
    chosen = np.isin(pool.kept, best.gauges)
    grid, grid_attributes = gauge_grid(
        candidates.position[pool.kept],
        {"direction": candidates.direction[pool.kept], "removed_at": step, "placed": chosen.astype(np.int64)},
    )
    middle = np.median([layout.std for layout in others], axis=0) if others else np.zeros(0)
    said = ", ".join(f"{name} ± {value:.3g}" for name, value in zip(found.inputs, best.std, strict=True))
    listed = _listed(found, best)
    without = {name: best.without[:, i] for i, name in enumerate(found.inputs)}
    return Output(
        datasets=grid | written(_record(found)),
        attributes=grid_attributes,
        summary=_summary(found, middle),
        message=f"{len(candidates)} → {len(pool.kept)} → {len(best.gauges)}, gap {100 * found.certificate.gap:.3g} %, {said}",
        tables=(_gauge_table(listed, without), layout_table(found.layouts, found.inputs)),
        files={
            "gauges.csv": gauge_csv(listed, without),
            "gauges.unv": uff_text(
                listed.position, candidates.direction[best.gauges], listed.normal, listed.labels
            ).encode(),
        },
    )


def _record(found: Found) -> BenchPlaced:
    pool, candidates, solved, result = found.pool, found.pool.candidates, found.scenario, found.result
    return BenchPlaced(
        inputs=found.inputs,
        units=found.units,
        candidates=BenchCandidates(
            position=candidates.position,
            direction=candidates.direction,
            element=candidates.element,
            facet=candidates.facet,
            response=pool.response,
        ),
        augmented=AugmentedBench(F=solved.F, H=solved.H, Q=solved.Q, R=solved.r, weight=solved.weight),
        pool=pool.kept,
        elimination=BenchElimination(removed=result.removed, trace=result.cost, rise=result.rise, greedy=result.kept),
        exchange=found.swapped.cost,
        certificate=BenchCertificate(
            lower_bound=found.certificate.lower_bound, gap=found.certificate.gap, weights=found.certificate.weights
        ),
        layouts={
            name: BenchLayout(
                candidate=own.gauges,
                position=candidates.position[own.gauges],
                direction=candidates.direction[own.gauges],
                trace=own.trace,
                std=own.std,
                without=own.without,
            )
            for name, own in found.layouts.items()
        },
    )


def _summary(found: Found, middle: np.ndarray) -> dict[str, Scalar]:
    best = found.layouts[PLACED]
    summary: dict[str, Scalar] = {
        "candidates": len(found.pool.candidates),
        "pool": len(found.pool.kept),
        "selected": len(best.gauges),
        "trace_initial": float(found.result.cost[0]),
        "trace_greedy": float(found.result.cost[-1]),
        "trace_final": float(found.swapped.cost[-1]),
        "exchanges": len(found.swapped.swaps),
        "lower_bound": found.certificate.lower_bound,
        "gap": found.certificate.gap,
    }
    summary |= {f"std.{name}": float(value) for name, value in zip(found.inputs, best.std, strict=True)}
    if len(middle):
        summary |= {f"random.{name}": float(value) for name, value in zip(found.inputs, middle, strict=True)}
    return summary


def _listed(found: Found, layout: Layout) -> GaugeList:
    own, c = layout.gauges, found.pool.candidates
    count = len(own)
    peak = np.abs(found.resting[own])
    return GaugeList(
        labels=tuple(f"G{i + 1}" for i in range(count)),
        kind=("strain gauge",) * count,
        unit=("strain",) * count,
        element=c.element[own],
        facet=c.facet[own],
        position=c.position[own],
        normal=c.normal[own],
        directions=tuple(c.direction[own][:, None]),
        angles=tuple(c.angle[own][:, None]),
        length=c.length[own],
        glued=c.glued[own],
        family=("gauges",) * count,
        peak=peak,
        peaks=tuple(peak[:, None]),
        range=np.full(count, np.nan),
    )


def _gauge_table(listed: GaugeList, without: dict[str, np.ndarray]) -> Table:
    rows = tuple(
        (
            label,
            str(listed.element[i]),
            str(listed.facet[i]),
            " ".join(f"{x:.4f}" for x in listed.position[i]),
            " ".join(f"{round(x, 3) + 0.0:g}" for x in listed.directions[i][0]),
            *(f"{values[i]:.4g}" for values in without.values()),
        )
        for i, label in enumerate(listed.labels)
    )
    columns = ("gauge", "element", "facet", "x y z [m]", "direction", *(f"σ({name}) without it" for name in without))
    return Table("gauges", columns, rows)
