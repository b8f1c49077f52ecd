"""Strain of the surface under each load alone and in the training run, as panels of a view and as states of the view in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from strainsight.config.placement import PlacementConfig
from strainsight.errors import UserError
from strainsight.experiment.structure.contour import SurfaceStrain, surface_strains
from strainsight.mesh.model import Mesh
from strainsight.pages.picture.layout import Layout
from strainsight.pages.space.model import Shape, contour_of
from strainsight.pages.text import number, quantity
from strainsight.pages.view.viewed import FACETS, Panel, View
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
