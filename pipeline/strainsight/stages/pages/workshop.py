"""What a run gives to the workshop and to other programs."""

from __future__ import annotations

from strainsight.cases.layout.datum import frame_of
from strainsight.cases.layout.workshop import Workshop, workshop_csv, workshop_of, workshop_unv
from strainsight.config.placement import PlacementConfig
from strainsight.records.mesh import mesh_from
from strainsight.stages.pages.page_layout import listed_gauges
from strainsight.workflow.stage import Context


def workshop_of_run(context: Context[PlacementConfig]) -> Workshop:
    """The layout of place.h5 in the axes that the config states."""
    config, up = context.config, context.upstream
    frame = frame_of(config.mesh.length_unit, config.report.datum)
    return workshop_of(listed_gauges(up), mesh_from(up["import"]), frame)


def workshop_files(shop: Workshop) -> dict[str, bytes]:
    """File name → content."""
    return {"workshop.csv": workshop_csv(shop), "workshop.unv": workshop_unv(shop)}
