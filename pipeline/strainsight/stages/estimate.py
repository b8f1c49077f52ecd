"""estimate: the filter on the measurements of a test, of one record or of several (1.53-1.60)."""

from __future__ import annotations

from strainsight.config.placement import PlacementConfig
from strainsight.experiment.structure.campaign import campaign_of
from strainsight.experiment.structure.campaign_text import campaign_output
from strainsight.runner.output import Output
from strainsight.runner.stage import Context
from strainsight.stages import inputs


def run(context: Context[PlacementConfig]) -> Output:
    """The estimate, with the surface in time as a grid where it is asked for."""
    campaign = campaign_of(
        context.config,
        inputs.mesh(context),
        inputs.reduced(context),
        inputs.training(context),
        inputs.screened(context),
        inputs.layout(context),
        context,
    )
    return campaign_output(campaign)
