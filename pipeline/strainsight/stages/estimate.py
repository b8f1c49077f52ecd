"""estimate: the filter on the measurements of a test (1.53-1.60)."""

from __future__ import annotations

from strainsight.cases.structure.estimation import estimation_of
from strainsight.cases.structure.estimation_text import (
    estimation_csv,
    estimation_message,
    estimation_numbers,
    estimation_tables,
)
from strainsight.cases.structure.full_model import FILES, READS
from strainsight.config.placement import PlacementConfig
from strainsight.records.grids import vtkhdf_datasets
from strainsight.records.record import written
from strainsight.stages import inputs
from strainsight.workflow.output import Output
from strainsight.workflow.stage import Context, Stage


def run(context: Context[PlacementConfig]) -> Output:
    """The estimate, with the surface in time as a grid where it is asked for."""
    found = estimation_of(
        context.config,
        inputs.mesh(context),
        inputs.reduced(context),
        inputs.training(context),
        inputs.screened(context),
        inputs.layout(context),
        context,
    )
    grid, attributes = ({}, {}) if found.surface is None else vtkhdf_datasets(found.surface)
    return Output(
        datasets=written(found.estimated, found.units) | grid,
        attributes=attributes,
        summary=estimation_numbers(found),
        message=estimation_message(found),
        tables=estimation_tables(found),
        files={"estimate.csv": estimation_csv(found)},
    )


ESTIMATE = Stage(
    "estimate",
    version=20,
    reads=(
        "seed",
        "loads",
        "parameters",
        "process_noise",
        "train",
        "tolerances",
        "place.estimate",
        "place.instants",
        "validate.initial_std",
        "estimate",
        "filter",
        "gauges.grid_length",
        "gauges.snap_tolerance",
        *READS,
    ),
    upstream=("import", "rom", "train", "screen", "place"),
    files=("loads.*.signal.file", "estimate.file", "estimate.gauges_file", "parameters.*.guess.from", *FILES),
    run=run,
)
