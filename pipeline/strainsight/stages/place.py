"""place: gauges leave one by one by the steady error covariance, exchanges, a bound on what any layout could reach (5.3)."""

from __future__ import annotations

from strainsight.config.placement import PlacementConfig
from strainsight.experiment.structure.placement import placement_of, placement_output
from strainsight.experiment.structure.references import KINDS_OF_LOAD, WHAT_IS_FREE
from strainsight.runner.output import Output
from strainsight.runner.stage import Context, Stage
from strainsight.stages import inputs


def run(context: Context[PlacementConfig]) -> Output:
    """The placement, with the pool as points of a grid."""
    mesh, training, screened = inputs.mesh(context), inputs.training(context), inputs.screened(context)
    placement = placement_of(context.config, mesh, inputs.reduced(context), training, screened, context)
    return placement_output(placement, mesh, context.config.mesh.length_unit)


PLACE = Stage(
    "place",
    version=35,
    reads=(
        "seed",
        "mesh.length_unit",
        "mesh.point_masses",
        "loads.*.node",
        "loads.*.set",
        "loads.*.deck_load",
        *KINDS_OF_LOAD,
        "loads.*.signal",
        "loads.*.process_noise",
        "parameters.*.process_noise_scale",
        *WHAT_IS_FREE,
        "process_noise",
        "tolerances",
        "train",
        "place",
        "filter.method",
        "filter.drift",
        "filter.scheme",
        "filter.form",
        "filter.iterations",
        "gauges.price",
        "motion_sensors.*.price",
    ),
    upstream=("import", "rom", "train", "screen"),
    files=("loads.*.signal.file", "place.load_cases.*.loads.*.signal.file"),
    run=run,
    records=("gauges.csv",),
)
