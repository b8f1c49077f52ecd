"""What the placement of a bench writes and prints."""

from __future__ import annotations

import numpy as np

from strainsight.cases.bench.layout.placement import BenchPlacement
from strainsight.cases.layout.advice import advice_table
from strainsight.cases.layout.comparison import criteria_table
from strainsight.cases.layout.gauge_list import gauge_table
from strainsight.cases.layout.output import (
    found_message,
    layout_files,
    layout_record,
    layout_summary,
    pool_grid,
    said_of,
)
from strainsight.records.bench_placed import PLACED, BenchCandidates, BenchPlaced
from strainsight.records.record import written
from strainsight.workflow.output import Output, Scalar, Table


def output_of(found: BenchPlacement) -> Output:
    """Datasets, tables and files; gauges.csv has σ without each gauge in N or N m, and as peak the strain at the start."""
    candidates, expected, inputs = found.on.candidates, found.expected, found.task.unknowns.names
    record = BenchPlaced(
        **vars(layout_record(found)),
        inputs=inputs,
        units=found.units,
        candidates=BenchCandidates(
            position=candidates.position,
            direction=candidates.direction,
            element=candidates.element,
            facet=candidates.facet,
            response=found.on.response,
        ),
        layouts=found.layouts,
    )
    grid, attributes = pool_grid(found)
    drawn = [layout.std for name, layout in found.layouts.items() if name != PLACED]
    middle = np.median(drawn, axis=0).tolist() if drawn else []
    numbers: dict[str, Scalar] = {"candidates": len(candidates)}
    said = ", ".join(f"{name} ± {value:.3g}" for name, value in expected.std.items())
    return Output(
        datasets=grid | written(record, at=said_of(found)),
        attributes=attributes | {"/augmented": {"aggregate": "mean", "criterion": found.task.metric.criterion.name}},
        summary=numbers
        | layout_summary(found)
        | {f"std.{name}": value for name, value in expected.std.items()}
        | {f"random.{name}": value for name, value in zip(inputs, middle, strict=bool(middle))},
        message=f"{len(candidates)} → {found_message(found, said)}",
        tables=(
            gauge_table(found.listed, expected.without, lambda std: f"{std:.4g}"),
            _layout_table(found),
            criteria_table(found.others, inputs, None),
            advice_table(found.advice),
        ),
        files=layout_files(found),
    )


def _layout_table(found: BenchPlacement) -> Table:
    rows = tuple(
        (name, f"{own.metric:.4g}", *(f"{value:.4g}" for value in own.std)) for name, own in found.layouts.items()
    )
    inputs, symbol = found.task.unknowns.names, found.task.metric.criterion.symbol
    return Table("layouts", ("layout", symbol, *(f"σ({name})" for name in inputs)), rows)
