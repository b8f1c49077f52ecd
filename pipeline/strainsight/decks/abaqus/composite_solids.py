"""*SOLID SECTION, COMPOSITE: layers of hexahedra and wedges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.decks.abaqus.materials import Materials
from strainsight.decks.abaqus.orientations import SolidAxes, solid_axes, turned_about
from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.numbers import parse_integer, parse_real
from strainsight.mesh.anisotropic import Orientation
from strainsight.mesh.composite_solids import STACKED, CompositeSolid, Layer
from strainsight.mesh.coordinates import BASIC
from strainsight.mesh.kinds import ELEMENTS
from strainsight.mesh.model import IntArray


def composite_solid(
    assembly: Assembly, scope: Scope, keyword: Keyword, rows: IntArray, made: Materials
) -> CompositeSolid:
    """Layers along STACK DIRECTION 1, 2 or 3 (the default) of the elements in rows (k,): a line each, relative thickness,
    points (not used), material, orientation of its own or angle [deg] by which that of the section is turned; mirrored
    by SYMMETRIC.

    The angle is about the axis, 1, 2 or 3, that the second line of the ORIENTATION names. Raises DeckError for a layer without
    thickness, a material that is not there or of plane stress, an angle without that axis, and elements without the direction.
    """
    if "MATERIAL" in keyword.parameters:
        raise keyword.error(
            "it is COMPOSITE and has a MATERIAL", "take one of them out: a composite states a material for each layer"
        )
    text = keyword.parameters.get("STACKDIRECTION") or "3"
    direction = parse_integer(text)
    if direction not in (1, 2, 3):
        raise keyword.error(
            f"STACK DIRECTION={text} is none", "give the direction of the layers in each element, 1, 2 or 3"
        )
    _check_elements(assembly, keyword, rows, direction)
    axes = solid_axes(assembly, scope, keyword, keyword.parameters.get("ORIENTATION", ""))
    layers = [_layer(assembly, scope, row, i, axes, made) for i, row in enumerate(keyword.rows(), start=1)]
    both = (*layers, *reversed(layers)) if "SYMMETRIC" in keyword.parameters else tuple(layers)
    return CompositeSolid(both, direction - 1)


def _layer(assembly: Assembly, scope: Scope, row: Row, number: int, axes: SolidAxes | None, made: Materials) -> Layer:
    t = row.real(0, f"the thickness of layer {number}")
    if not (t > 0 and np.isfinite(t)):
        raise row.error(f"the thickness of layer {number} is {t:g}, not positive", "give a positive thickness")
    if not row.text(2):
        raise row.error(f"layer {number} has no material", "give it as the third entry of the line")
    material = made.of_layer(row.text(2), row)
    if material not in made.solids:
        return Layer(material, t, Orientation(BASIC, np.eye(3)))
    angle = parse_real(row.text(3)) if row.text(3) else 0.0
    own = axes if angle is not None else solid_axes(assembly, scope, row, row.text(3))
    if own is None:
        if angle or not np.allclose(scope.rotation, np.eye(3)):
            turned = f"turned by {angle:g}°" if angle else "of an instance that is turned"
            raise row.error(
                f"layer {number} is anisotropic and {turned}, and its section has no ORIENTATION",
                "give the section one, with the axis about which layers are turned on its second line",
            )
        return Layer(material, t, Orientation(BASIC, np.eye(3)))
    if not angle:
        return Layer(material, t, own.orientation)
    if own.about is None:
        raise row.error(
            f"layer {number} is turned by {angle:g}°, and the ORIENTATION at {own.where} does not say about which of its axes",
            "add a second line to it: the axis across the layers, 1, 2 or 3, and the angle 0.",
        )
    turn = own.orientation.turn @ turned_about(own.about, angle)
    return Layer(material, t, replace(own.orientation, turn=turn))


def _check_elements(assembly: Assembly, keyword: Keyword, rows: IntArray, direction: int) -> None:
    for row in rows.tolist():
        kind = ELEMENTS[assembly.kind[row]].name if assembly.kind[row] >= 0 else ""
        if direction - 1 not in STACKED.get(kind, ()):
            lacks = f"no direction {direction} for layers" if kind in STACKED else "no layers"
            raise keyword.error(
                f"{assembly.element(row)} can have {lacks}",
                "give layers to hexahedra, or to wedges with STACK DIRECTION=3; give other elements a section with a MATERIAL",
            )
