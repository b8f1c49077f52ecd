"""report: the page of a placement, and the files for the workshop and for other programs: positions, drawing sheets, channels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.errors import ConfigError
from strainsight.experiment.layout import workshop
from strainsight.experiment.layout.gauge_list import channel_labels, frame_of, line_edges
from strainsight.experiment.structure.surface import SurfaceStrain
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.pages.chart.files import file_name
from strainsight.pages.picture.geometry import paper_axes
from strainsight.pages.picture.layout import PictureLayout
from strainsight.pages.picture.scene import draw_or_explain, render
from strainsight.pages.placement.data import Noise
from strainsight.pages.placement.figures import placement_figures
from strainsight.pages.placement.page import placement_page
from strainsight.pages.sheets.sheet import sheet_svg
from strainsight.pages.sheets.views import Projection, Sheet
from strainsight.pages.space.model import ShownState
from strainsight.pages.view.viewing import screenshots, untitled
from strainsight.records.placed import Placed
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.runner.output import Dataset, Output, warnings_table
from strainsight.runner.stage import Context
from strainsight.sensors.candidates import UNITS
from strainsight.sensors.enclosure import unobstructed
from strainsight.sensors.export import edge_lines, seen_from
from strainsight.sensors.surface_paths import skin_of
from strainsight.stages import inputs
from strainsight.stages.pages.page import placement_report
from strainsight.stages.pages.page_layout import listed_gauges
from strainsight.stages.view.surface import strain_shapes, strain_view, strains_of
from strainsight.stages.view.views import placement_view


def workshop_of_run(context: Context[PlacementConfig], mesh: Mesh) -> workshop.Workshop:
    """The layout of place.h5 in the axes that the config states."""
    frame = frame_of(context.config.mesh.length_unit, context.config.report.datum)
    listed = listed_gauges(context.upstream)
    return workshop.Workshop(listed, line_edges(listed.grids, mesh), frame)


def workshop_files(shop: workshop.Workshop) -> dict[str, bytes]:
    """File name → content."""
    return {"workshop.csv": workshop.workshop_csv(shop), "workshop.unv": workshop.workshop_unv(shop)}


def exported(context: Context[PlacementConfig], shop: workshop.Workshop) -> dict[str, bytes]:
    """File name → content of every export that the config asks for.

    Raises ConfigError where element sets are asked for and no gauge lies on an element."""
    config, wanted = context.config, context.config.report.exports
    elements = workshop.elements_of(shop)
    if not elements and (sets := [name for name in wanted if name in ("nastran", "abaqus")]):
        raise ConfigError(
            "the gauges of this layout are imported rows of the strain operator, not positions on elements",
            key="report.exports",
            remedy=f"remove {' and '.join(sets)}",
        )
    files = {
        "nastran": ("gauges-nastran.inc", lambda: workshop.nastran_sets(elements, config.name)),
        "abaqus": ("gauges-abaqus.inp", lambda: workshop.abaqus_sets(elements, config.name)),
        "catman": ("channels-catman.txt", lambda: workshop.catman_table(shop.listed, config.report)),
        "labview": ("channels-labview.txt", lambda: workshop.labview_table(shop.listed, config.report)),
        "mat": ("model.mat", lambda: _mat_file(context, shop)),
    }
    return {name: content() for name, content in (files[export] for export in wanted)}


def _mat_file(context: Context[PlacementConfig], shop: workshop.Workshop) -> bytes:
    from strainsight.experiment.structure.observation import mat_file  # with modules that no other export needs

    placed, model = read(Placed, context.upstream["place"]), read(Reduced, context.upstream["rom"]).model
    units = [UNITS[int(quantity)] for quantity in shop.listed.channels.quantity]
    of_loads = {name: load.unit for name, load in context.config.loads.items()}
    return mat_file(placed, model, channel_labels(shop.listed), units, of_loads)


def sheets_of(context: Context[PlacementConfig], shop: workshop.Workshop, mesh: Mesh) -> list[Sheet]:
    """A sheet for every gauge, of a bridge for every arm; none of what lies on no facet."""
    config, frame, edges, listed = context.config, shop.frame, shop.edges, shop.listed
    grids = listed.grids
    if not grids.facet.any():
        return []
    facets, on_facet = exterior_facets(mesh), np.flatnonzero(grids.facet)
    lines, outside = edge_lines(mesh.position, facets), np.ones(len(grids), dtype=bool)
    outside[on_facet] = unobstructed(skin_of(mesh.position, facets), grids.take(on_facet))

    @cache
    def views(normal: tuple[float, ...]) -> tuple[Projection, Projection]:
        n = np.array(normal)
        right, up = paper_axes(n)
        front, side = (
            Projection(a, b, *map(frame.place, seen_from(lines, toward @ frame.axes)))
            for a, b, toward in ((right, up, n), (right, n, -up))
        )
        return front, side

    sheets = []
    for name, bonded_grids in listed.places():
        i = bonded_grids[0]
        if not grids.facet[i]:
            continue
        gauge, normal, foil = listed.gauge[i], frame.turn(grids.normal[i]), workshop.foil_at(config.gauges, shop, i)
        front, side = views(tuple((np.round(normal, 9) + 0.0).tolist()))
        sheets.append(
            Sheet(
                name=name,
                kind=listed.kind[gauge] + ", bonded already" * bool(listed.bonded[gauge]),
                run=config.name,
                deck=Path(config.mesh.file).name,
                layout=context.upstream["place"].digest[:12],
                frame=frame,
                position=frame.place(grids.position[i]),
                normal=normal,
                directions=frame.turn(grids.direction[bonded_grids]),
                strain=listed.unit[gauge] == "strain",
                grid=float(frame.length(grids.length[i])),
                grid_width=0.0 if foil.type is None else float(frame.length(foil.type.grid_width)),
                carrier=(float(frame.length(foil.length)), float(frame.length(foil.width))),
                carrier_of="assumed" if foil.type is None else str(config.gauges.type),
                distance=frame.length(edges.distance[i]),
                angle=edges.angle[i],
                foot=frame.place(edges.foot[i]),
                along=frame.turn(edges.along[i]),
                element=int(grids.element[i]),
                facet=int(grids.facet[i]),
                outside=bool(outside[i]),
                front=front,
                side=side,
            )
        )
    return sheets


def sheet_files(sheets: list[Sheet]) -> dict[str, bytes]:
    """File name → content."""
    files: dict[str, bytes] = {}
    for sheet in sheets:
        name = file_name(f"sheet-{sheet.name}", {Path(other).stem.lower() for other in files})
        files[f"{name}.svg"] = sheet_svg(sheet).encode()
    return files


def _picture(layout: PictureLayout, strains: Sequence[SurfaceStrain]) -> bytes:
    """PNG of the gauges on the strain of the surface; without strain, on the surface."""
    if not strains:
        return render(layout)
    view = strain_view("", replace(layout, pool=layout.pool[:0]), strains)
    return screenshots([replace(untitled(view), size=(1280, 840))])[0]


def _noise_study(noise: Noise) -> dict[str, Dataset]:
    """Errors and σ by gauge noise."""
    level = (
        "noise standard deviation of a gauge, divided by the largest RMS strain of all candidates in the stage train"
    )
    datasets = {"/noise/level": Dataset(noise.level, "1", level)}
    kinds = (
        ("error", noise.error, "error (parameter: final, load: RMS)"),
        ("std", noise.std, "standard deviation σ"),
    )
    for key, by_name, what in kinds:
        for name, values in by_name.items():
            text = f"relative {what} of the estimate of {name}, for each gauge noise in /noise/level"
            datasets[f"/noise/{key}/{name}"] = Dataset(values, "1", text, ("/noise/level",))
    return datasets


def run(context: Context[PlacementConfig]) -> Output:
    """Gather what the page shows and write it as one self-contained file."""
    mesh = inputs.mesh(context)
    shop = workshop_of_run(context, mesh)
    report, sheets = placement_report(context, mesh, shop), sheet_files(sheets_of(context, shop, mesh))
    context.progress("picture", 0.1)
    modes = placement_view(context.config, "modes", context.upstream, None)
    strains = strains_of(context.config, mesh, context.upstream)
    scene, problem = draw_or_explain(lambda: _picture(report.layout, strains[:1]))
    shapes = (*strain_shapes(report.layout, strains), *(ShownState(panel.title, panel.shift) for panel in modes.panels))
    context.progress("figures", 0.5)
    page = placement_page(report, placement_figures(report), scene, problem, shapes, tuple(sheets.values())).encode()
    trend = report.trend
    datasets = {
        "/trend/count": Dataset(trend.count, "1", "number of gauges, initially and after each removal"),
        "/trend/metric": Dataset(
            trend.value,
            "1",
            f"placement criterion {trend.metric.symbol} of the layout with /trend/count gauges",
            ("/trend/count",),
        ),
        **({} if report.noise is None else _noise_study(report.noise)),
    }
    return Output(
        datasets=datasets,
        summary={"picture": scene is not None, "warnings": len(report.warnings)},
        message=f"report.html, {len(page) / 1024:.0f} KiB" + (f"; no 3D picture: {problem}" if problem else ""),
        tables=warnings_table(report.warnings),
        files={"report.html": page, **workshop_files(shop), **sheets, **exported(context, shop)},
    )
