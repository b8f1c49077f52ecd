"""Strain and stress of a surface as pictures: under each load, at one instant, and mode shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.errors import UserError
from strainsight.experiment.structure.surface import SurfaceStrain, largest_principal, surface_strains
from strainsight.mesh.model import Mesh
from strainsight.pages.picture.layout import PictureLayout
from strainsight.pages.space.model import ShownState, contour_of
from strainsight.pages.view.viewing import FACETS, POINTS, Panel, View, exaggerated
from strainsight.records.record import read
from strainsight.records.reduced import Reduced
from strainsight.records.training import Training
from strainsight.runner.artefact import Artefact
from strainsight.text import number, quantity

MOST = 6
"""So many loads, and as many load cases, are shown."""
QUANTITY, UNIT, MICRO = "principal strain of largest magnitude", "µm/m", 1e6


def strain_view(title: str, layout: PictureLayout, strains: Sequence[SurfaceStrain]) -> View:
    """One panel per load, side by side. Raises UserError without strain."""
    if not strains:
        raise UserError(
            "no strain to show: the model has no solids with a material",
            remedy="use --what layout, or set mesh.materials",
        )
    panels = tuple(Panel(caption(strain), strain.strain * MICRO) for strain in strains)
    return View(f"{title}: surface strain at the initial parameter values", layout, panels, QUANTITY, UNIT, FACETS)


def strain_shapes(layout: PictureLayout, strains: Sequence[SurfaceStrain]) -> tuple[ShownState, ...]:
    """The same as selectable states, each with a separate scale."""
    return tuple(
        ShownState(
            caption(strain), contour=contour_of(strain.strain * MICRO, layout, QUANTITY, UNIT), group="Surface strain"
        )
        for strain in strains
    )


def strains_of(config: PlacementConfig, mesh: Mesh, up: Mapping[str, Artefact]) -> tuple[SurfaceStrain, ...]:
    """From rom.h5 and train.h5, the first of the loads and of the load cases."""
    strains = surface_strains(
        mesh, read(Reduced, up["rom"]), read(Training, up["train"]), config.loads, config.mesh.free
    )
    alone, runs = [strain for strain in strains if strain.load], [strain for strain in strains if not strain.load]
    return (*alone[:MOST], *runs[:MOST])


def caption(strain: SurfaceStrain) -> str:
    """Under what."""
    if strain.load:
        unit = strain.unit.replace("N m", "N·m").replace("^2", "²")
        size = f"× {number(strain.size)}" if unit == "1" else quantity(strain.size, unit)
        return f"static strain under load {strain.load} alone, {size}{', with inertia relief' * bool(strain.free)}"
    run = f"load case {strain.case}" if strain.case else "training simulation (stage train)"
    return f"{run}, t = {strain.instant:.4g} s"


MODES = 6
"""So many shapes are shown side by side."""
MEGA, NOTHING = 1e6, np.empty((0, 3))


def surface_view(title: str, artefact: Artefact, layout: PictureLayout, at: float | None, strain: bool = False) -> View:
    """Von Mises stress, or the principal strain of largest size, on the deformed surface of a /VTKHDF group at one instant, its
    displacement exaggerated.

    layout: what else is drawn. at [s]: the instant nearest to it is taken; None:
    that of the largest stress. Raises UserError for a time outside the record."""
    time, nodes = artefact["/VTKHDF/Steps/Values"], artefact["/VTKHDF/Connectivity"]
    count = np.diff(artefact["/VTKHDF/Offsets"])
    faces = np.full((len(count), 8), -1)
    faces[np.arange(8) < count[:, None]] = nodes
    stress = artefact["/VTKHDF/CellData/von_mises"].reshape(len(time), -1)
    step = int(np.argmax(stress.max(axis=1))) if at is None else nearest(time, at)
    shift = artefact["/VTKHDF/PointData/displacement"].reshape(len(time), -1, 3)[step].astype(float)
    surface = replace(layout, points=artefact["/VTKHDF/Points"], faces=faces)
    when = f"t = {time[step]:.4g} s{' (largest stress)' if at is None else ''}"
    if not strain:
        return moment_view(title, surface, stress[step].astype(float), shift, when)
    tensor = artefact["/VTKHDF/CellData/strain"].reshape(len(time), -1, 6)[step].astype(float)
    return _deformed(title, surface, largest_principal(tensor) * MICRO, QUANTITY, UNIT, shift, when)


def field_shape(view: View, layout: PictureLayout) -> ShownState:
    """Stress and strain of `surface_view` as colours of the whole structure: a state of the 3D view.
    layout: of the structure, with facet points in the order of the view."""
    contour = contour_of(view.panels[0].values, view.layout, view.quantity, view.unit)
    at = np.full(len(layout.points), np.nan)
    at[np.unique(layout.faces[layout.faces >= 0])] = contour.values
    when = view.panels[0].title.split(",")[0]
    contour = replace(contour, values=at)
    return ShownState(f"{view.quantity}, {when}", contour=contour, group="Surface stress and strain")


def moment_view(title: str, layout: PictureLayout, stress: np.ndarray, shift: np.ndarray, when: str) -> View:
    """Von Mises stress (f,) [Pa] on the layout's facets at one moment, its displacement (n, 3) [m] exaggerated."""
    return _deformed(title, layout, stress / MEGA, "von Mises stress", "MPa", shift, when)


def _deformed(
    title: str, layout: PictureLayout, values: np.ndarray, quantity: str, unit: str, shift: np.ndarray, when: str
) -> View:
    factor = exaggerated(layout.points, shift)
    panel = Panel(f"{when}, displacement × {factor:g}", values, factor * shift)
    return View(title, replace(layout, pool=NOTHING, fixed=NOTHING), (panel,), quantity, unit, FACETS)


def nearest(time: np.ndarray, at: float) -> int:
    """The instant nearest to `at` [s]. Raises UserError for one outside the record."""
    slack = 0.5 * float(np.diff(time).max(initial=0.0))
    if not time[0] - slack <= at <= time[-1] + slack:
        raise UserError(
            f"--at {at:g} s is outside the time range of the field, {time[0]:g} to {time[-1]:g} s",
            remedy="use a time in that range, or omit --at for the instant of the largest stress",
        )
    return int(np.argmin(np.abs(time - at)))


def modes_view(title: str, layout: PictureLayout, shapes: np.ndarray, frequency: np.ndarray) -> View:
    """Mode shapes on the deformed structure, side by side: the first mass-normalised shapes (modes, n, 3) and frequencies
    (modes,) [Hz], each with a separate scale."""
    panels = []
    for i, (shape, f) in enumerate(zip(shapes[:MODES], frequency, strict=False), start=1):
        length = np.linalg.norm(shape, axis=1)
        # A mode shape has an arbitrary amplitude; it is scaled to the size of the structure.
        shift = shape * (0.06 * layout.size / max(float(length.max(initial=0.0)), np.finfo(float).tiny))
        panels.append(Panel(f"mode {i}, {f:.4g} Hz", length, shift))
    return View(title, replace(layout, fixed=NOTHING), tuple(panels), "magnitude of the mode shape", "kg^-1/2", POINTS)


def mesh_view(title: str, layout: PictureLayout, mesh: Mesh) -> View:
    """The structure alone, with the size of its mesh."""
    elements = sum(len(block.nodes) for block in mesh.elements)
    return View(f"{title} {elements} elements, {mesh.own_nodes} nodes", layout)
