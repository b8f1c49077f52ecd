"""place: gauges leave one by one by the steady error covariance, exchanges, a bound on what any layout could reach (5.3)."""

from __future__ import annotations

from strainsight.config.placement import PlacementConfig
from strainsight.experiment.structure.placement import placement_of, placement_output
from strainsight.runner.output import Output
from strainsight.runner.stage import Context
from strainsight.stages import inputs


def run(context: Context[PlacementConfig]) -> Output:
    """The placement, with the pool as points of a grid."""
    mesh, training, screened = inputs.mesh(context), inputs.training(context), inputs.screened(context)
    placement = placement_of(context.config, mesh, inputs.reduced(context), training, screened, context)
    return placement_output(placement, mesh, context.config)
