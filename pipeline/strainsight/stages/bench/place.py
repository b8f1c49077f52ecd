"""place: gauges of a bench's flexible body for its unknown inputs, with a bound and layouts drawn at random beside them."""

from __future__ import annotations

from strainsight.cases.bench.layout.output import output_of
from strainsight.cases.bench.layout.placement import placement_of
from strainsight.config.bench.bench import BenchConfig
from strainsight.stages.bench.inputs import bodies, meshes
from strainsight.workflow.output import Output
from strainsight.workflow.stage import Context, Stage


def run(context: Context[BenchConfig]) -> Output:
    """The placement, with the pool as points of a grid."""
    return output_of(placement_of(context.config, meshes(context), bodies(context), context))


PLACE = Stage(
    "place",
    version=8,
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
