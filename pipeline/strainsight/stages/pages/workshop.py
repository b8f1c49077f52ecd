"""What a run gives to the workshop and to other programs."""

from __future__ import annotations

from strainsight.cases.layout.datum import frame_of
from strainsight.cases.layout.exports.channel_lists import Wiring, catman_table, labview_table
from strainsight.cases.layout.exports.element_sets import abaqus_sets, elements_of, nastran_sets
from strainsight.cases.layout.gauge_list import channel_labels
from strainsight.cases.layout.workshop import Workshop, workshop_csv, workshop_of, workshop_unv
from strainsight.cases.structure.observation import LinearModel, linear_model, mat_file
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError
from strainsight.mesh.model import Mesh
from strainsight.records.placed import Placed
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.stages.pages.page_layout import listed_gauges
from strainsight.workflow.stage import Context


def workshop_of_run(context: Context[PlacementConfig], mesh: Mesh) -> Workshop:
    """The layout of place.h5 in the axes that the config states."""
    frame = frame_of(context.config.mesh.length_unit, context.config.report.datum)
    return workshop_of(listed_gauges(context.upstream), mesh, frame)


def workshop_files(shop: Workshop) -> dict[str, bytes]:
    """File name → content."""
    return {"workshop.csv": workshop_csv(shop), "workshop.unv": workshop_unv(shop)}


def exported(context: Context[PlacementConfig], shop: Workshop) -> dict[str, bytes]:
    """File name → content of every export that the config asks for.

    Raises ConfigError where element sets are asked for and no gauge lies on an element.
    """
    config, wanted = context.config, context.config.report.exports
    wiring = Wiring(config.report.gauge_factor, config.report.resistance)
    elements = elements_of(shop)
    if not elements and (sets := [name for name in wanted if name in ("nastran", "abaqus")]):
        raise ConfigError(
            "the gauges of this layout lie on no element: their strain rows were given",
            key="report.exports",
            remedy=f"leave out {' and '.join(sets)}",
        )
    files = {
        "nastran": ("gauges-nastran.inc", lambda: nastran_sets(elements, config.name)),
        "abaqus": ("gauges-abaqus.inp", lambda: abaqus_sets(elements, config.name)),
        "catman": ("channels-catman.txt", lambda: catman_table(shop.listed, wiring)),
        "labview": ("channels-labview.txt", lambda: labview_table(shop.listed, wiring)),
        "mat": ("model.mat", lambda: mat_file(_model(context, shop))),
    }
    return {name: content() for name, content in (files[export] for export in wanted)}


def _model(context: Context[PlacementConfig], shop: Workshop) -> LinearModel:
    placed, model = read(Placed, context.upstream["place"]), read(Reduced, context.upstream["rom"]).model
    listed = shop.listed
    units = [unit for unit, own in zip(listed.unit, listed.directions, strict=True) for _ in own]
    of_loads = {name: load.unit for name, load in context.config.loads.items()}
    return linear_model(placed, model, channel_labels(listed), units, of_loads)
