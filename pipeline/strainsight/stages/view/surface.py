"""A surface in time as its VTKHDF group holds it: one instant of it, and pictures of mode shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.errors import UserError
from strainsight.experiment.structure.surface import SurfaceStrain, largest_principal, surface_strains
from strainsight.mesh.model import Mesh
from strainsight.pages.picture.layout import Layout
from strainsight.pages.space.model import Shape, contour_of
from strainsight.pages.text import number, quantity
from strainsight.pages.view.viewing import FACETS, POINTS, Panel, View, exaggerated
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
from strainsight.runner.artefact import Artefact

MOST = 6
"""So many loads, and as many load cases, are shown."""
QUANTITY, UNIT, MICRO = "principal strain of largest size", "µm/m", 1e6


def strain_view(title: str, layout: Layout, found: Sequence[SurfaceStrain]) -> View:
    """A panel each, side by side. Raises UserError where there is none."""
    if not found:
        raise UserError(
            "there is no strain to show: the model has no solids, or they lack a material",
            remedy="ask for --what layout, or state mesh.materials",
        )
    panels = tuple(Panel(caption(own), own.strain * MICRO) for own in found)
    return View(f"{title}: strain of the surface at the guess", layout, panels, QUANTITY, UNIT, FACETS)


def strain_shapes(layout: Layout, found: Sequence[SurfaceStrain]) -> tuple[Shape, ...]:
    """The same to choose from, each with a scale of its own."""
    return tuple(
        Shape(
            caption(own),
            contour=contour_of(own.strain * MICRO, layout, QUANTITY, UNIT),
            group="Strain of the surface",
        )
        for own in found
    )


def strains_of(config: PlacementConfig, mesh: Mesh, up: Mapping[str, Artefact]) -> tuple[SurfaceStrain, ...]:
    """From rom.h5 and train.h5, the first of the loads and of the load cases."""
    found = surface_strains(mesh, read(Reduced, up["rom"]), read(Training, up["train"]), config.loads, config.mesh.free)
    alone, runs = [own for own in found if own.load], [own for own in found if not own.load]
    return (*alone[:MOST], *runs[:MOST])


def caption(own: SurfaceStrain) -> str:
    """Under what."""
    if own.load:
        unit = own.unit.replace("N m", "N·m").replace("^2", "²")
        size = f"× {number(own.size)}" if unit == "1" else quantity(own.size, unit)
        return f"{own.load} alone, {size} {'against inertia' if own.free else 'at rest'}"
    run = f"load case {own.case}" if own.case else "training run"
    return f"{run}, t = {own.instant:.4g} s"


MODES = 6
"""So many shapes are shown side by side."""
MEGA = 1e6


def surface_view(title: str, artefact: Artefact, layout: Layout, at: float | None, strain: bool = False) -> View:
    """Von Mises stress, or the principal strain of largest size, on the deformed surface of a /VTKHDF group at one instant, its
    displacement exaggerated.

    layout: what else is drawn. at [s]: the instant nearest to it is taken; None:
    that of the largest stress. Raises UserError for a time outside the record.
    """
    time = artefact["/VTKHDF/Steps/Values"]
    points, offsets = artefact["/VTKHDF/Points"], artefact["/VTKHDF/Offsets"]
    nodes = artefact["/VTKHDF/Connectivity"]
    count = np.diff(offsets)
    faces = np.full((len(count), 8), -1)
    column = np.arange(len(nodes)) - np.repeat(offsets[:-1], count)
    faces[np.repeat(np.arange(len(count)), count), column] = nodes
    stress = artefact["/VTKHDF/CellData/von_mises"].reshape(len(time), -1)
    step = int(np.argmax(stress.max(axis=1))) if at is None else nearest(time, at)
    shift = artefact["/VTKHDF/PointData/displacement"].reshape(len(time), -1, 3)[step].astype(float)
    factor = exaggerated(points, shift)
    when = f"t = {time[step]:.4g} s{' (largest stress)' if at is None else ''}"
    values, quantity, unit = stress[step].astype(float) / MEGA, "von Mises stress", "MPa"
    if strain:
        own = artefact["/VTKHDF/CellData/strain"].reshape(len(time), -1, 6)[step].astype(float)
        values, quantity, unit = largest_principal(own) * MICRO, QUANTITY, UNIT
    panel = Panel(f"{when}, displacement × {factor:g}", values, factor * shift)
    nothing = np.empty((0, 3))
    surface = replace(layout, points=points, faces=faces, pool=nothing, fixed=nothing)
    return View(title, surface, (panel,), quantity, unit, FACETS)


def field_shape(view: View, layout: Layout) -> Shape:
    """What `surface_view` shows, as colours of the whole structure where it is: a state of the view in space.

    layout: of the structure, whose facets have the points of the view in their order.
    """
    values = view.panels[0].values
    own = contour_of(values, view.layout, view.quantity, view.unit)
    at = np.full(len(layout.points), np.nan)
    at[np.unique(layout.faces[layout.faces >= 0])] = own.values
    when = view.panels[0].title.split(",")[0]
    return Shape(f"{view.quantity}, {when}", contour=replace(own, values=at), group="Stress and strain of the surface")


def moment_view(title: str, layout: Layout, stress: np.ndarray, shift: np.ndarray, when: str) -> View:
    """Von Mises stress (f,) [Pa] on the layout's facets at one moment, its displacement (n, 3) [m] exaggerated."""
    factor = exaggerated(layout.points, shift)
    panel = Panel(f"{when}, displacement × {factor:g}", stress / MEGA, factor * shift)
    nothing = np.empty((0, 3))
    surface = replace(layout, pool=nothing, fixed=nothing)
    return View(title, surface, (panel,), "von Mises stress", "MPa", FACETS)


def nearest(time: np.ndarray, at: float) -> int:
    """The instant nearest to `at` [s]. Raises UserError for one outside the record."""
    slack = 0.5 * float(np.diff(time).max(initial=0.0))
    if not time[0] - slack <= at <= time[-1] + slack:
        raise UserError(
            f"--at {at:g}: the field is written from {time[0]:g} to {time[-1]:g} s",
            remedy="give a time in that span, or none for the instant of the largest stress",
        )
    return int(np.argmin(np.abs(time - at)))


def modes_view(title: str, layout: Layout, shapes: np.ndarray, captions: list[str], unit: str) -> View:
    """The first shapes (modes, n, 3) on the deformed structure, side by side; each with a scale of its own."""
    size = float(np.linalg.norm(np.ptp(layout.points, axis=0)))
    panels = []
    for shape, caption in zip(shapes[:MODES], captions, strict=False):
        length = np.linalg.norm(shape, axis=1)
        # A shape has no size of its own: it is drawn as large as it can be seen beside the structure.
        shift = shape * (0.06 * size / max(float(length.max(initial=0.0)), np.finfo(float).tiny))
        panels.append(Panel(caption, length, shift))
    return View(title, layout, tuple(panels), "size of the shape", unit, POINTS)
