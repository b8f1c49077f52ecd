"""Section keywords of an Abaqus deck: beams (y of a `BeamSection` is n1 here, z is n2), shells and laminates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.decks.abaqus.materials import (
    Materials,
    SolidAxes,
    named_orientation,
    rectangular_axes,
    solid_axes,
    turned_about,
)
from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.faults import elastic_fault
from strainsight.decks.text import parse_integer, parse_real
from strainsight.errors import DeckError
from strainsight.mesh.anisotropic import STACKED, CompositeSolid, Layer, Orientation
from strainsight.mesh.coordinates import BASIC
from strainsight.mesh.kinds import ELEMENTS
from strainsight.mesh.model import FloatArray, IntArray
from strainsight.mesh.section_shapes import section_of_shape
from strainsight.mesh.thin import BeamSection, Laminate, Ply, ShellSection

SHAPES = {
    "RECT": ("a", "b"),
    "CIRC": ("r",),
    "PIPE": ("r", "t"),
    "THICKPIPE": ("r", "t"),
    "BOX": ("a", "b", "t1", "t2", "t3", "t4"),
    "I": ("l", "h", "b1", "b2", "t1", "t2", "t3"),
    "GENERAL": ("A", "I11", "I12", "I22", "J"),
}
"""Shape → its dimensions: a and b along n1 and n2, walls of a box at +n1, +n2, −n1, −n2; of an I the height l of the node above
its foot, height, width and thickness of the flange below and above, thickness of the web. Abaqus guide to elements, beam
cross-section library; CalculiX manual, *BEAM SECTION."""
GENERAL = "BEAMGENERALSECTION"
DEFAULT_N1 = (0.0, 0.0, -1.0)
ROUNDING = 1e-12


def beam_section(
    scope: Scope, keyword: Keyword, shears: bool, notes: list[str]
) -> tuple[BeamSection, FloatArray, FloatArray]:
    """Section, place (2,) of its centroid from the nodes along n1 and n2, and n1 (3,) along the basic axes.

    shears: its shear factors count; otherwise it does not shear. Raises DeckError for shapes that are not supported,
    dimensions that are missing or do not fit, and sections that vary.
    """
    for parameter in ("NODALTHICKNESS", "TAPER"):
        if parameter in keyword.parameters:
            raise keyword.error(
                f"{parameter}: a section that varies is not supported", "give pieces their own sections"
            )
    rows = keyword.rows()
    written = keyword.parameters.get("SECTION", "")
    shape = "".join(written.upper().split()) or ("GENERAL" if keyword.name == GENERAL else "")
    if shape not in SHAPES or (shape == "GENERAL" and keyword.name != GENERAL):
        raise keyword.error(
            f"SECTION={written or '?'} is not supported",
            f"give one of {', '.join(SHAPES)}; a *BEAM GENERAL SECTION with SECTION=GENERAL has any moments",
        )
    d = _dimensions(rows[0], shape)
    if shape == "GENERAL":
        if idle := [i for i in (5, 6) if rows[0].text(i) and rows[0].real(i, "a constant of warping") != 0]:
            notes.append(f"{rows[0].where}: constants of warping (entry {idle[0] + 1}) have no effect")
        if d[2] != 0:
            notes.append(f"{rows[0].where}: I12 = {d[2]:g} is taken as the integral of n1 n2 over the section")
        section, centroid = _general(rows[0], d), np.zeros(2)
    else:
        section, centroid = _shape(rows[0], shape, d)
    offsets = [parameter for parameter in ("OFFSET1", "OFFSET2") if parameter in keyword.parameters]
    if offsets:
        centroid = centroid - _offset(keyword, shape, d)
    if not shears:
        section = replace(section, shear=(0.0, 0.0))
    return section, centroid, scope.rotation @ _n1(keyword, rows)


def own_constants(keyword: Keyword, section: BeamSection, notes: list[str]) -> tuple[BeamSection, float, float, float]:
    """The section, E, ν and ρ of a *BEAM GENERAL SECTION without MATERIAL: its last line is E, G, and DENSITY its density.

        ν = E/(2 G) − 1

    A G that no isotropic material has is taken into J and the shear factors, with ν = 0, so that G J and G A are right.
    """
    row = keyword.rows()[-1]
    if row.i == 0:
        raise keyword.error("has no line of Young's modulus and shear modulus", "add it, or MATERIAL=…")
    E, G = row.real(0, "Young's modulus"), row.real(1, "the shear modulus")
    if not min(E, G) > 0:
        raise row.error(f"E is {E:g} and G {G:g}", "give positive moduli")
    nu = E / (2 * G) - 1
    if elastic_fault(E, nu):
        section = section.with_shear(G / (E / 2))
        notes.append(f"{row.where}: no isotropic material has E = {E:g} and G = {G:g}: G is taken into J and shear")
        nu = 0.0
    given = keyword.parameters.get("DENSITY", "")
    rho = parse_real(given) if given else 0.0
    if rho is None or rho < 0:
        raise keyword.error(f"DENSITY={given} is no density", "give a positive density")
    if not given:
        notes.append(f"{keyword.where}: {keyword.title} has no DENSITY: taken as 0")
    return section, E, nu, rho


def _dimensions(row: Row, shape: str) -> list[float]:
    """The dimensions of a shape; only those may be zero, or l and I12 negative, that are so in Abaqus."""
    names = SHAPES[shape]
    d = [row.real(i, f"the dimension {name}") for i, name in enumerate(names)]
    if shape == "CIRC" and row.text(1):
        # CalculiX has two diameters there
        if row.real(1, "the second diameter") != d[0]:
            raise row.error(
                "an ellipse (CalculiX) is not supported", "give the radius of a circle, or its diameter twice"
            )
        d = [d[0] / 2]
    for name, value in zip(names, d, strict=True):
        free = name in ("l", "I12") or (shape == "I" and value == 0 and name in ("b1", "b2", "t1", "t2"))
        if not (free or value > 0 or (shape == "GENERAL" and name != "A" and value == 0)):
            raise row.error(f"{name} of SECTION={shape} is {value:g}", "give a positive value")
    return d


def _general(row: Row, d: list[float]) -> BeamSection:
    """I11 = ∫ n2² dA, which resists bending about n1; I22 = ∫ n1² dA; I12 = ∫ n1 n2 dA. The shear factor is 1, as in Abaqus."""
    A, I11, I12, I22, J = d
    if I12**2 > I11 * I22 * (1 + 1e-9):
        raise row.error(
            f"I12 = {I12:g} is beyond what I11 = {I11:g} and I22 = {I22:g} allow", "I12² is at most I11 I22"
        )
    return BeamSection(A, np.array([[I22, I12], [I12, I11]]), J, (1.0, 1.0))


def _shape(row: Row, shape: str, d: list[float]) -> tuple[BeamSection, FloatArray]:
    """Section, and its centroid from the node along n1 and n2: y of the figures of `section_of_shape` is up, z to the right."""
    try:
        match shape:
            case "RECT":
                return section_of_shape("BAR", (d[1], d[0])), np.zeros(2)
            case "CIRC":
                return section_of_shape("ROD", d), np.zeros(2)
            case "PIPE" | "THICKPIPE":
                return section_of_shape("TUBE2", d), np.zeros(2)
            case "BOX":
                a, b, right, top, left, bottom = d
                section = section_of_shape("BOX1", (b, a, right, left, top, bottom))
                centroid = np.array([a, b]) / 2 - section.points.max(axis=0)
            case _:
                section, centroid = _i(row, *d)
    except DeckError as error:
        if error.where is not None:
            raise
        given = ", ".join(f"{value:g}" for value in d)
        raise row.error(
            f"the dimensions {given} of SECTION={shape} do not fit: a wall has no length left",
            f"check them in their order, {', '.join(SHAPES[shape])}",
        ) from None
    return section, np.where(np.abs(centroid) > ROUNDING * max(d), centroid, 0.0)


def _i(
    row: Row, l: float, h: float, b1: float, b2: float, t1: float, t2: float, t3: float
) -> tuple[BeamSection, FloatArray]:
    """An I whose web is along n2, or a T where one of its flanges has no width; its node l above its foot."""
    if b1 * t1 > 0 and b2 * t2 > 0:
        upright = section_of_shape("I", (h, b1, b2, t3, t1, t2))
    elif b2 * t2 > 0:
        upright = section_of_shape("T", (b2, h, t2, t3))
    elif b1 * t1 > 0:
        upright = section_of_shape("T2", (b1, h, t1, t3))
    else:
        raise row.error("an I without flanges", "give a RECT")
    foot = float(upright.points[:, 0].min())
    # y of the figure is n2 and its z −n1: a quarter of a turn, after which y is n1 and z is n2
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    turned = replace(
        upright, second=turn @ upright.second @ turn.T, shear=upright.shear[::-1], points=upright.points @ turn.T
    )
    return turned, np.array([0.0, -foot - l])


def _offset(keyword: Keyword, shape: str, d: list[float]) -> FloatArray:
    """OFFSET1 and OFFSET2 of CalculiX: how far the nodes lie from the axis along n1 and n2, in thicknesses there."""
    sizes = {"RECT": d[:2], "BOX": d[:2]}.get(shape, [2 * d[0]] * 2)
    if shape in ("I", "GENERAL"):
        raise keyword.error(
            f"OFFSET1 and OFFSET2 of SECTION={shape} are not supported", "give a RECT, BOX, PIPE or CIRC"
        )
    share = [keyword.number(name, 0.0, "give the offset in thicknesses") for name in ("OFFSET1", "OFFSET2")]
    return np.array(share) * sizes


def _n1(keyword: Keyword, rows: list[Row]) -> FloatArray:
    """The line of n1. Blank lines are passed over: the second of two lines is that of the moduli where they have to follow."""
    moduli = keyword.name == GENERAL and "MATERIAL" not in keyword.parameters
    if len(rows) < (3 if moduli else 2) or not any(rows[1].tokens[:3]):
        return np.array(DEFAULT_N1)
    n1 = np.array([rows[1].real(i, "a component of n1", 0.0) for i in range(3)])
    if not np.linalg.norm(n1) > 0:
        raise rows[1].error("n1 is zero", "give the direction of the first axis of the section")
    return n1


NEAR = np.cos(np.radians(0.1))
"""Normals nearer to x than 0.1° have the projection of z as their first axis in place of that of x."""


def laminate(keyword: Keyword, made: Materials, nonstructural: float) -> Laminate:
    """Plies from the lower face up, a line each: thickness, points of integration, material, angle [deg] about the normal from
    the axis of the section; mirrored by SYMMETRIC.

    Raises DeckError for a ply without thickness or material, and for an orientation of a ply of its own.
    """
    plies = []
    for number, row in enumerate(keyword.rows(), start=1):
        t = row.positive(0, f"the thickness of ply {number}")
        if not row.text(2):
            raise row.error(f"ply {number} has no material", "give it as the third entry of the line")
        if row.text(3) and parse_real(row.text(3)) is None:
            raise row.error(
                f"ply {number} has an orientation of its own, {row.text(3)!r}, which is not supported",
                "give its angle [deg] from the ORIENTATION of the section, about the normal",
            )
        plies.append(Ply(made.of_ply(row.text(2), keyword), t, row.real(3, f"the angle of ply {number}", 0.0)))
    both = (*plies, *reversed(plies)) if "SYMMETRIC" in keyword.parameters else tuple(plies)
    return Laminate(both, nonstructural)


def default_axes(corners: FloatArray) -> FloatArray:
    """First axis (n, 3) of the material of shells with corners (n, k, 3) where nothing states one: x, to be projected on the
    shell, or z where x is its normal (Abaqus, conventions)."""
    normal = np.cross(corners[:, -2] - corners[:, 0], corners[:, -1] - corners[:, 1])
    along = np.abs(normal[:, 0]) > NEAR * np.linalg.norm(normal, axis=1)
    return np.where(along[:, None], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])


SIDES = {"SPOS": 0.5, "SNEG": -0.5}
CONSTANT = "give a number: a distribution is not supported"
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
    beside = keyword.number("DENSITY", 0.0, CONSTANT)
    if beside < 0:
        raise keyword.error(f"DENSITY, the mass per area beside the material, is {beside:g}", "give a positive one")
    given = keyword.word("OFFSET", "0")
    off = SIDES[given] if given in SIDES else keyword.number("OFFSET", 0.0, CONSTANT)
    section: ShellSection | Laminate
    if "COMPOSITE" in keyword.parameters:
        section = laminate(keyword, made, beside)
    else:
        t = keyword.rows()[0].positive(0, "the thickness")
        section = ShellSection(t, nonstructural=beside)
        if made.orthotropic(keyword):
            section = Laminate((Ply(made.of_ply(keyword.parameters["MATERIAL"], keyword), t),), beside)
    axis = _axis(assembly, scope, keyword, isinstance(section, Laminate))
    return section, np.array([-off * section.thickness]), axis


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
    t = row.positive(0, f"the thickness of layer {number}")
    if not row.text(2):
        raise row.error(f"layer {number} has no material", "give it as the third entry of the line")
    material = made.of_layer(row.text(2), row)
    if material not in made.properties.anisotropic:
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
