"""Views of a placement: its mesh, mode shapes, candidates, layout, and what the filter makes of the surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.errors import UserError, did_you_mean
from strainsight.mesh.model import Mesh
from strainsight.pages.picture.layout import Layout
from strainsight.pages.view.viewed import DOTS, Panel, View
from strainsight.records.estimated import estimated_in
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
from strainsight.records.validated import Validated
from strainsight.runner.artefact import Artefact
from strainsight.sensors.candidates import STRAIN
from strainsight.stages.pages.page_layout import bare, layout_of_page
from strainsight.stages.view.strain import strain_view, strains_of
from strainsight.stages.view.surface import modes_view, moment_view, surface_view

MICRO = 1e6


def placement_view(
    config: PlacementConfig, what: str, up: Mapping[str, Artefact], at: float | None, record: str | None = None
) -> View:
    """What is asked for, from the artefacts that `offers` names; at [s]: the instant of a field in time; record: of a test that
    has several, None for the first."""
    name, mesh = str(config.name), mesh_from(up["import"])
    if what == "modes":
        return _modes(name, mesh, up["rom"])
    if what == "candidates":
        return _candidates(name, bare(mesh, config.loads), up["train"])
    if what == "strain":
        own = layout_of_page(mesh, up, config.loads) if "place" in up else bare(mesh, config.loads)
        return strain_view(name, replace(own, pool=np.empty((0, 3))), strains_of(config, mesh, up))
    if what == "mesh":
        elements = sum(len(block.nodes) for block in mesh.elements)
        title = f"{name}: {elements} elements, {mesh.own_nodes} nodes"
        return View(title, bare(mesh, config.loads))
    layout = layout_of_page(mesh, up, config.loads)
    title = f"{name}: {len(layout.gauges)} of {len(layout.pool)} places"
    if what == "layout":
        return View(title, layout)
    if "estimate" in up:
        return _tested(name, layout, up["estimate"], at, record)
    return _strain(f"{name}: estimate of the validation, which is simulated", layout, up)


def _tested(name: str, layout: Layout, estimate: Artefact, at: float | None, record: str | None) -> View:
    """Of the surface in time where it was asked for, else at the moment of the largest reading. Raises UserError without one, and
    for a record that the test has not."""
    records = estimated_in(estimate)
    names = [one for one in records if one]
    shown = next(iter(records)) if record is None else record
    if record is not None and record not in names:
        raise UserError(
            f"--record {record}: the test has {'no record of that name' if names else 'one record'}",
            where=str(estimate.path),
            remedy=did_you_mean(record, names, f"there are {', '.join(names)}") if names else "leave it out",
        )
    own = records[shown]
    title = f"{name}: estimate of the test {own.source.file}" + (
        f", record {shown} of {', '.join(names)}" * bool(shown)
    )
    if "/VTKHDF/Steps" in estimate:
        return surface_view(title, estimate, layout, at)
    then = own.moment
    if then is None:
        raise UserError(
            "the estimate has no field: the mesh has no surface with materials",
            where=str(estimate.path),
            remedy="ask for --what layout, or --of validation",
        )
    when = f"t = {then.time:.4g} s (largest reading, {then.label})"
    return moment_view(title, layout, then.von_mises.astype(float), then.displacement.astype(float), when)


def _modes(name: str, mesh: Mesh, rom: Artefact) -> View:
    frequency = read(Reduced, rom).frequency
    shapes = rom["/VTKHDF/PointData/mode"].reshape(-1, len(mesh.position), 3)[: len(frequency)]
    captions = [f"mode {i}, {f:.4g} Hz" for i, f in enumerate(frequency, start=1)]
    layout = replace(bare(mesh, {}), fixed=np.empty((0, 3)))
    return modes_view(f"{name}: mode shapes at the guess", layout, shapes, captions, "kg^-1/2")


def _candidates(name: str, layout: Layout, train: Artefact) -> View:
    training = read(Training, train)
    candidates = training.candidates
    rms = training.rms
    # Of bridges every arm.
    grids, channel = candidates.grids, candidates.channel_of_grid
    strains = np.flatnonzero(grids.quantity == STRAIN)
    # Of a gauge with several channels, or several gauges at a place, the strongest: it is drawn last.
    order = strains[np.argsort(rms[channel[strains]], kind="stable")]
    others = candidates.position[candidates.first[candidates.quantity[candidates.first] != STRAIN]]
    title = f"{name}: {candidates.gauges} candidates"
    view = View(title, replace(layout, pool=others), (Panel(values=rms[channel[order]] * MICRO),))
    return replace(view, quantity="RMS training strain", unit="µm/m", on=DOTS, dots=grids.position[order])


def _strain(title: str, layout: Layout, up: Mapping[str, Artefact]) -> View:
    field, candidates = read(Validated, up["validate"]).field, read(Training, up["train"]).candidates
    grids, strain = candidates.grids, field.strain[candidates.channel_of_grid]
    position, known = grids.position, np.flatnonzero(np.isfinite(strain) & (grids.quantity == STRAIN))
    order = known[np.argsort(np.abs(strain[known]), kind="stable")]
    panel = Panel(f"t = {field.instant:.4g} s, largest true strain", strain[order] * MICRO)
    own = replace(layout, pool=np.empty((0, 3)))
    return View(title, own, (panel,), "estimated strain of every candidate", "µm/m", DOTS, position[order])
