"""*SHELL SECTION: thickness, where the middle lies, and the axes of the material."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.decks.abaqus.composites import laminate
from strainsight.decks.abaqus.materials import Materials
from strainsight.decks.abaqus.orientations import (
    SolidAxes,
    named_orientation,
    rectangular_axes,
    solid_axes,
    turned_about,
)
from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.numbers import parse_integer, parse_real
from strainsight.mesh.anisotropic import Orientation
from strainsight.mesh.composite_solids import STACKED, CompositeSolid, Layer
from strainsight.mesh.coordinates import BASIC
from strainsight.mesh.kinds import ELEMENTS
from strainsight.mesh.laminates import Laminate, Ply
from strainsight.mesh.model import FloatArray, IntArray
from strainsight.mesh.thin import ShellSection

SIDES = {"SPOS": 0.5, "SNEG": -0.5}
REFUSED = {
    "NODALTHICKNESS": "a thickness that varies is not supported",
    "SHELLTHICKNESS": "a thickness that varies is not supported",
}


def shell_section(
    assembly: Assembly, scope: Scope, keyword: Keyword, made: Materials
) -> tuple[ShellSection | Laminate, FloatArray, FloatArray]:
    """Section, offset (1,) of the middle from the nodes along the normal, and x of the material (3,), NaN for none.

        offset = −OFFSET t

    OFFSET is the distance of the nodes from the middle along the normal in thicknesses, ½ for SPOS, where the nodes lie on the
    upper face; so *SHELL SECTION in the manuals of Abaqus and CalculiX.
    A laminate with COMPOSITE, or one ply of a material TYPE=LAMINA.
    Raises DeckError for a thickness that varies or is not positive, and *SHELL GENERAL SECTION.
    """
    if keyword.name != "SHELLSECTION":
        raise keyword.error("is not supported", "give a *SHELL SECTION with the thickness and the material")
    for parameter, what in REFUSED.items():
        if parameter in keyword.parameters:
            raise keyword.error(f"{parameter}: {what}", "give one thickness")
    beside = _number(keyword, "DENSITY", 0.0)
    if beside < 0:
        raise keyword.error(f"DENSITY, the mass per area beside the material, is {beside:g}", "give a positive one")
    given = keyword.parameters.get("OFFSET", "0").upper()
    off = SIDES[given] if given in SIDES else _number(keyword, "OFFSET", 0.0)
    section: ShellSection | Laminate
    if "COMPOSITE" in keyword.parameters:
        section = laminate(keyword, made, beside)
    else:
        row = keyword.rows()[0]
        t = row.real(0, "the thickness")
        if not t > 0:
            raise row.error(f"the thickness is {t:g}, not positive", "give a positive thickness")
        section = ShellSection(t, nonstructural=beside)
        if made.orthotropic(keyword):
            section = Laminate((Ply(made.of_ply(keyword.parameters["MATERIAL"], keyword), t),), beside)
    axis = _axis(assembly, scope, keyword, isinstance(section, Laminate))
    return section, np.array([-off * section.thickness]), axis


def _number(keyword: Keyword, parameter: str, default: float) -> float:
    text = keyword.parameters.get(parameter, "")
    value = parse_real(text) if text else default
    if value is None:
        raise keyword.error(f"{parameter}={text} is no number", "give a number: a distribution is not supported")
    return value


def _axis(assembly: Assembly, scope: Scope, keyword: Keyword, matters: bool) -> FloatArray:
    """The axis (3,) of its ORIENTATION that is projected on the shell: the one that follows, 1 → 2 → 3 → 1, the axis that is
    stated to be near the normal, which is 1 where none is; matters: of plies, whose axes are not to be left out."""
    nothing = np.full(3, np.nan)
    own = named_orientation(assembly, scope, keyword, keyword.parameters.get("ORIENTATION", ""))
    if own is None:
        if matters and not np.allclose(scope.rotation, np.eye(3)):
            raise keyword.error("plies of an instance that is turned have no ORIENTATION", "give the section one")
        return nothing
    name, rows, parameters = own.parameters["NAME"].upper(), own.rows(needed=False), own.parameters
    simple = parameters.get("SYSTEM", "RECTANGULAR").upper() == "RECTANGULAR" and parameters.get(
        "DEFINITION", "COORDINATES"
    ).upper() in ("COORDINATES", "")
    turn = [row.real(1, "the angle", 0.0) for row in rows[1:2] if simple]
    if not simple or not rows or parse_real(rows[0].text(0)) is None or any(turn):
        if matters:
            raise keyword.error(
                f"orientation {name} at {own.where} is not supported for plies",
                "give a rectangular one by coordinates, and a turn about the normal as the angles of the plies",
            )
        assembly.notes.append(
            f"{own.where}: orientation {name} of shells is not imported: their materials are isotropic"
        )
        return nothing
    near_normal = rows[1].integer(0, "the axis", 1) if len(rows) > 1 else 1
    if near_normal not in (1, 2, 3):
        raise rows[1].error(f"axis {near_normal}", "give the axis near the normal of the shell, 1, 2 or 3")
    return np.asarray(scope.rotation @ rectangular_axes(rows[0])[:, near_normal % 3])


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
