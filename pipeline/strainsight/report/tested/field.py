"""The surface at the moment of the largest reading: strain and stress as maps, and in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from html import escape

import numpy as np

from strainsight.report.page.markup import measure, picture
from strainsight.report.picture.colours import Scale, scale_bar, scale_of
from strainsight.report.picture.geometry import areas
from strainsight.report.picture.layout import Layout
from strainsight.report.space.model import Shape, contour_of
from strainsight.report.space.section import space_section
from strainsight.report.tested.data import Findings, Map, Moment
from strainsight.report.text import number
from strainsight.report.view.viewed import FACETS, Panel, View

SIZE = (1000, 600)
"""Of a map [px]; the page shows it at about half of that."""


def views_of(report: Findings) -> tuple[View, ...]:
    """A view of every map of the moment, to be drawn as a picture; none where there is no moment."""
    moment = report.moment
    if moment is None:
        return ()
    panel = f"t = {moment.time:.5g} s, displacement × {moment.factor:g}"
    # Names of loads at one node would stand on one another; the view in space has the arrows.
    bare = replace(report.layout, loads=())
    return tuple(
        View(
            "",
            bare,
            (Panel(panel, own.values, moment.shift),),
            own.quantity,
            own.unit,
            FACETS,
            size=SIZE,
            bar=False,
        )
        for own in moment.maps
    )


def field_section(report: Findings, pictures: Sequence[bytes], problem: str) -> str:
    """Maps side by side; nothing where the mesh has no surface. pictures: of every map, or none with the sentence on why."""
    moment = report.moment
    if moment is None:
        return ""
    lead = (
        f'<p class="lead">The whole surface at {measure(moment.time, "s")}, the moment of the largest reading '
        f"({escape(moment.label)}), smoothed.</p>"
    )
    cards = ""
    for own, png in zip(moment.maps, pictures, strict=False):
        cards += (
            f'<figure class="card"><h3>{escape(own.quantity)}</h3><div class="scene" tabindex="0" role="region" '
            f'aria-label="picture: {escape(own.quantity)}">{picture(png, _alt(own, moment, report.layout), *SIZE)}</div>'
            f"{scale_bar(scale(own, report.layout))}<figcaption>{_said(own)}</figcaption></figure>"
        )
    if not pictures:
        said = f"<p><strong>No picture.</strong> {escape(problem)}</p>" if problem else ""
        cards = f'<div class="card">{said}{"".join(f"<p>{_said(own)}</p>" for own in moment.maps)}</div>'
    return f'<h2>Strain and stress of the surface</h2>{lead}<div class="figures">{cards}</div>'


def space_of(report: Findings) -> str:
    """The structure to turn round, coloured by each map of the moment, the last of them first."""
    moment = report.moment
    if moment is None:
        return space_section([("", report.layout)])
    when, group = f"at {number(moment.time)}\u00a0s", "Strain and stress"
    shapes = [
        Shape(
            f"{own.quantity} {when}", contour=contour_of(own.values, report.layout, own.quantity, own.unit), group=group
        )
        for own in reversed(moment.maps)
    ]
    moved = Shape(f"{when}, displacement × {number(moment.factor)}", moment.shift, shapes[0].contour, "Moved")
    return space_section([("", report.layout)], [*shapes, moved], first=0)


def scale(own: Map, layout: Layout) -> Scale:
    """That of the picture: about zero where both signs occur, a peak beyond its ends."""
    return scale_of(own.quantity, own.unit, own.values, areas(layout.points, layout.faces))


def _said(own: Map) -> str:
    """The extremes of a map, with σ at the largest where it is known."""
    low, high = int(np.argmin(own.values)), int(np.argmax(own.values))
    at = high if abs(own.values[high]) >= abs(own.values[low]) else low
    sigma = "" if own.std is None else f" ± {measure(float(own.std[at]), own.unit, 2)}"
    span = f"From {measure(float(own.values[low]), own.unit)} to {measure(float(own.values[high]), own.unit)}"
    largest = f"largest size {measure(float(own.values[at]), own.unit)}{sigma}" if own.std is not None else ""
    return f"{span}{f'; {largest}' if largest else ''}, by facets at their middles."


def _alt(own: Map, moment: Moment, layout: Layout) -> str:
    low, high = scale(own, layout).low, scale(own, layout).high
    return (
        f"{own.quantity} of the surface at {number(moment.time)} s, in colours from {number(low, 3)} to "
        f"{number(high, 3)} {own.unit}."
    )
