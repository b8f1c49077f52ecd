"""Section keywords of an Abaqus deck: beams (y of a `BeamSection` is n1 here, z is n2), shells and laminates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.decks.abaqus.materials import Materials, SolidAxes, named_orientation, rectangular_axes, solid_axes
from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.faults import elastic_fault
from strainsight.decks.text import parse_integer, parse_real
from strainsight.errors import DeckError
from strainsight.mesh.anisotropic import STACKED, CompositeSolid, Layer, Orientation
from strainsight.mesh.coordinates import BASIC, rotation
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
"""Shape → its dimensions. RECT, BOX: a and b along n1 and n2, wall thicknesses of a box at +n1, +n2, −n1, −n2. I:
height l of the node above the foot, height, width and thickness of the lower and upper flange, web thickness. Source:
Abaqus guide to elements, beam cross-section library; CalculiX manual, *BEAM SECTION."""
GENERAL = "BEAMGENERALSECTION"
DEFAULT_N1 = (0.0, 0.0, -1.0)
ROUNDING = 1e-12


def beam_section(
    scope: Scope, keyword: Keyword, shears: bool, notes: list[str]
) -> tuple[BeamSection, FloatArray, FloatArray]:
    """Section, offset (2,) of its centroid from the nodes along n1 and n2, and n1 (3,) along the basic axes.

    shears: use the shear factors; otherwise the beam is rigid in shear. Raises DeckError for unsupported shapes,
    missing or inconsistent dimensions, and tapered sections."""
    for parameter in ("NODALTHICKNESS", "TAPER"):
        if parameter in keyword.parameters:
            raise keyword.error(
                f"{parameter}: tapered sections are not supported", "remove the parameter, and use constant sections"
            )
    rows = keyword.rows()
    written = keyword.parameters.get("SECTION", "")
    shape = "".join(written.upper().split()) or ("GENERAL" if keyword.name == GENERAL else "")
    if shape not in SHAPES or (shape == "GENERAL" and keyword.name != GENERAL):
        raise keyword.error(
            f"SECTION={written or '?'} is not supported",
            f"use one of {', '.join(SHAPES)}; for other shapes use *BEAM GENERAL SECTION with SECTION=GENERAL",
        )
    d = _dimensions(rows[0], shape)
    if shape == "GENERAL":
        if warping_entries := [i for i in (5, 6) if rows[0].text(i) and rows[0].real(i, "a warping constant") != 0]:
            notes.append(
                f"{rows[0].where}: warping constants (entry {warping_entries[0] + 1}) have no effect: warping is not modelled"
            )
        if d[2] != 0:
            notes.append(f"{rows[0].where}: I12 = {d[2]:g} is imported as ∫ x1 x2 dA, with x1 along n1 and x2 along n2")
        section, centroid = _general(rows[0], d), np.zeros(2)
    else:
        section, centroid = _shape(rows[0], shape, d)
    if {"OFFSET1", "OFFSET2"} & keyword.parameters.keys():
        centroid = centroid - _offset(keyword, shape, d)
    if not shears:
        section = replace(section, shear=(0.0, 0.0))
    return section, centroid, scope.rotation @ _n1(keyword, rows)


def section_constants(
    keyword: Keyword, section: BeamSection, notes: list[str]
) -> tuple[BeamSection, float, float, float]:
    """Section, E, ν and ρ of a *BEAM GENERAL SECTION without MATERIAL: its last line is E, G, and DENSITY its density.

        ν = E/(2 G) − 1

    If no isotropic material has this G, then ν = 0, and J and the shear factors are scaled so that G J and G A are correct."""
    row = keyword.rows()[-1]
    if row.i == 0:
        raise keyword.error(
            "the line with Young's modulus and shear modulus is missing",
            "add the line below the section dimensions, or add MATERIAL=… to the keyword",
        )
    E, G = row.real(0, "Young's modulus"), row.real(1, "the shear modulus")
    if not min(E, G) > 0:
        raise row.error(f"the moduli are E = {E:g} and G = {G:g}, but both must be positive", "specify positive moduli")
    nu = E / (2 * G) - 1
    if elastic_fault(E, nu):
        section = section.with_shear(G / (E / 2))
        notes.append(
            f"{row.where}: Poisson's ratio E/2G - 1 = {nu:.3g} is outside -1 to 0.5, so ν = 0 is used. "
            "J and the shear factors are scaled to preserve the torsional and shear stiffness"
        )
        nu = 0.0
    density = keyword.parameters.get("DENSITY", "")
    rho = parse_real(density) if density else 0.0
    if rho is None or rho < 0:
        raise keyword.error(f"DENSITY={density} is not a valid density", "specify a positive density")
    if not density:
        notes.append(f"{keyword.where}: the *BEAM GENERAL SECTION has no DENSITY, so the density is set to 0")
    return section, E, nu, rho


def _dimensions(row: Row, shape: str) -> list[float]:
    """Dimensions of a shape; only those that Abaqus allows may be zero, or negative (l and I12)."""
    names = SHAPES[shape]
    d = [row.real(i, f"the dimension {name}") for i, name in enumerate(names)]
    if shape == "CIRC" and row.text(1):
        # CalculiX reads two diameters here
        if row.real(1, "the second diameter of the section") != d[0]:
            raise row.error(
                "an elliptical section (CalculiX) is not supported",
                "for a circle, specify the radius, or the diameter twice",
            )
        d = [d[0] / 2]
    for name, value in zip(names, d, strict=True):
        free = name in ("l", "I12") or (shape == "I" and value == 0 and name in ("b1", "b2", "t1", "t2"))
        if not (free or value > 0 or (shape == "GENERAL" and name != "A" and value == 0)):
            raise row.error(
                f"the dimension {name} of SECTION={shape} is {value:g}, not positive", "specify a positive value"
            )
    return d


def _general(row: Row, d: list[float]) -> BeamSection:
    """I11 = ∫ n2² dA for bending about n1; I22 = ∫ n1² dA; I12 = ∫ n1 n2 dA. The shear factor is 1, as in Abaqus."""
    A, I11, I12, I22, J = d
    if I12**2 > I11 * I22 * (1 + 1e-9):
        raise row.error(
            f"I12 = {I12:g} is too large for I11 = {I11:g} and I22 = {I22:g}",
            "correct the values: I12² must not exceed I11 I22",
        )
    return BeamSection(A, np.array([[I22, I12], [I12, I11]]), J, (1.0, 1.0))


def _shape(row: Row, shape: str, d: list[float]) -> tuple[BeamSection, FloatArray]:
    """Section, and offset of its centroid from the node along n1 and n2; in `section_of_shape` y is up and z to the right."""
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
        dimensions = ", ".join(f"{value:g}" for value in d)
        raise row.error(
            f"the dimensions {dimensions} of SECTION={shape} are inconsistent: the walls are too thick for the outer dimensions",
            f"correct the dimensions; their order is {', '.join(SHAPES[shape])}",
        ) from None
    return section, np.where(np.abs(centroid) > ROUNDING * max(d), centroid, 0.0)


def _i(
    row: Row, l: float, h: float, b1: float, b2: float, t1: float, t2: float, t3: float
) -> tuple[BeamSection, FloatArray]:
    """An I with its web along n2, or a T if one flange has no width; the node is l above the foot."""
    if b1 * t1 > 0 and b2 * t2 > 0:
        upright = section_of_shape("I", (h, b1, b2, t3, t1, t2))
    elif b2 * t2 > 0:
        upright = section_of_shape("T", (b2, h, t2, t3))
    elif b1 * t1 > 0:
        upright = section_of_shape("T2", (b1, h, t1, t3))
    else:
        raise row.error("the I section has no flanges", "use SECTION=RECT")
    foot = float(upright.points[:, 0].min())
    # y of the section is n2 and z is −n1: rotate by 90° so that y is n1 and z is n2
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])
    rotated = replace(
        upright, second=turn @ upright.second @ turn.T, shear=upright.shear[::-1], points=upright.points @ turn.T
    )
    return rotated, np.array([0.0, -foot - l])


def _offset(keyword: Keyword, shape: str, d: list[float]) -> FloatArray:
    """OFFSET1 and OFFSET2 of CalculiX: distance of the nodes from the axis along n1 and n2, in section widths."""
    sizes = {"RECT": d[:2], "BOX": d[:2]}.get(shape, [2 * d[0]] * 2)
    if shape in ("I", "GENERAL"):
        raise keyword.error(
            f"OFFSET1 and OFFSET2 of SECTION={shape} are not supported",
            "remove OFFSET1 and OFFSET2, or use SECTION=RECT, BOX, PIPE or CIRC",
        )
    share = [
        keyword.number(
            name,
            0.0,
            f"write the distance of the nodes from the beam axis along {n}, divided by the section size along {n}",
        )
        for name, n in (("OFFSET1", "n1"), ("OFFSET2", "n2"))
    ]
    return np.array(share) * sizes


def _n1(keyword: Keyword, rows: list[Row]) -> FloatArray:
    """Direction n1. Blank lines are skipped: the second of two lines contains the moduli if they are required."""
    moduli = keyword.name == GENERAL and "MATERIAL" not in keyword.parameters
    if len(rows) < (3 if moduli else 2) or not any(rows[1].tokens[:3]):
        return np.array(DEFAULT_N1)
    n1 = np.array([rows[1].real(i, "a component of n1", 0.0) for i in range(3)])
    if not np.linalg.norm(n1) > 0:
        raise rows[1].error("the first section axis n1 is zero", "write a direction across the beam on this line")
    return n1


NEAR = np.cos(np.radians(0.1))
"""For normals within 0.1° of x, the first axis is the projection of z instead of x."""


def laminate(keyword: Keyword, materials: Materials, nonstructural: float) -> Laminate:
    """Plies from the bottom up, one line each: thickness, integration points, material, angle [deg] about the normal
    from the axis of the section; mirrored by SYMMETRIC.

    Raises DeckError for a ply without thickness or material, or with a separate orientation."""
    plies = []
    for number, row in enumerate(keyword.rows(), start=1):
        t = row.positive(0, f"the thickness of ply {number}")
        if not row.text(2):
            raise row.error(f"ply {number} has no material", "add the material as the third entry of the line")
        if row.text(3) and parse_real(row.text(3)) is None:
            raise row.error(
                f"ply {number} has a separate orientation {row.text(3)!r}, which is not supported",
                "specify the ply angle [deg] about the shell normal, relative to the ORIENTATION of the section",
            )
        plies.append(Ply(materials.of_ply(row.text(2), keyword), t, row.real(3, f"the angle of ply {number}", 0.0)))
    both = (*plies, *reversed(plies)) if "SYMMETRIC" in keyword.parameters else tuple(plies)
    return Laminate(both, nonstructural)


def default_axes(corners: FloatArray) -> FloatArray:
    """Default first material axis (n, 3) of shells with corners (n, k, 3): x, to be projected on the shell, or z if
    x is its normal (Abaqus, conventions)."""
    normal = np.cross(corners[:, -2] - corners[:, 0], corners[:, -1] - corners[:, 1])
    along = np.abs(normal[:, 0]) > NEAR * np.linalg.norm(normal, axis=1)
    return np.where(along[:, None], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])


SIDES = {"SPOS": 0.5, "SNEG": -0.5}
CONSTANT = "specify one number; distributions are not supported"


def shell_section(
    assembly: Assembly, scope: Scope, keyword: Keyword, materials: Materials
) -> tuple[ShellSection | Laminate, FloatArray, FloatArray]:
    """Section, offset (1,) of the middle surface from the nodes along the normal, and x of the material (3,), NaN if undefined.

        offset = −OFFSET t

    OFFSET is the distance of the nodes from the middle surface along the normal in thicknesses, ½ for SPOS, where
    the nodes are on the upper face (*SHELL SECTION in the manuals of Abaqus and CalculiX). With COMPOSITE the section
    is a laminate, with a material TYPE=LAMINA a laminate of one ply. Raises DeckError for variable or non-positive
    thickness and for *SHELL GENERAL SECTION."""
    if keyword.name != "SHELLSECTION":
        raise keyword.error("this keyword is not supported", "use *SHELL SECTION with thickness and material")
    for parameter in ("NODALTHICKNESS", "SHELLTHICKNESS"):
        if parameter in keyword.parameters:
            raise keyword.error(f"{parameter}: variable thickness is not supported", "specify one constant thickness")
    nonstructural = keyword.number("DENSITY", 0.0, CONSTANT)
    if nonstructural < 0:
        raise keyword.error(f"DENSITY (mass per area) is {nonstructural:g}, negative", "specify a positive value")
    offset = keyword.word("OFFSET", "0")
    off = SIDES[offset] if offset in SIDES else keyword.number("OFFSET", 0.0, CONSTANT)
    section: ShellSection | Laminate
    if "COMPOSITE" in keyword.parameters:
        section = laminate(keyword, materials, nonstructural)
    else:
        t = keyword.rows()[0].positive(0, "the thickness")
        section = ShellSection(t, nonstructural=nonstructural)
        if materials.orthotropic(keyword):
            section = Laminate((Ply(materials.of_ply(keyword.parameters["MATERIAL"], keyword), t),), nonstructural)
    axis = _axis(assembly, scope, keyword, isinstance(section, Laminate))
    return section, np.array([-off * section.thickness]), axis


def _axis(assembly: Assembly, scope: Scope, keyword: Keyword, matters: bool) -> FloatArray:
    """Axis (3,) of the ORIENTATION to project on the shell: the one that follows, in the order 1 → 2 → 3 → 1, the
    axis near the normal (default 1); matters: plies require it."""
    nothing = np.full(3, np.nan)
    orientation = named_orientation(assembly, scope, keyword, keyword.parameters.get("ORIENTATION", ""))
    if orientation is None:
        if matters and not np.allclose(scope.rotation, np.eye(3)):
            raise keyword.error(
                "the plies are in a rotated instance, but the section has no ORIENTATION",
                "add ORIENTATION=… to the section",
            )
        return nothing
    name, rows = orientation.word("NAME"), orientation.rows(needed=False)
    by_coordinates = orientation.word("DEFINITION", "COORDINATES") in ("COORDINATES", "")
    simple = by_coordinates and orientation.word("SYSTEM", "RECTANGULAR") == "RECTANGULAR"
    turn = [row.real(1, "the angle", 0.0) for row in rows[1:2] if simple]
    if not simple or not rows or parse_real(rows[0].text(0)) is None or any(turn):
        if matters:
            raise keyword.error(
                f"orientation {name} at {orientation.where} is not supported for plies",
                "use a rectangular system defined by coordinates, and specify rotations about the normal as ply angles",
            )
        assembly.notes.append(
            f"{orientation.where}: orientation {name} of shells is not imported, because the shell materials are isotropic"
        )
        return nothing
    near_normal = rows[1].integer(0, "the ORIENTATION axis nearest to the shell normal", 1) if len(rows) > 1 else 1
    if near_normal not in (1, 2, 3):
        raise rows[1].error(
            f"the ORIENTATION axis nearest to the shell normal is {near_normal}, but must be 1, 2 or 3",
            "correct the first entry of this line",
        )
    return np.asarray(scope.rotation @ rectangular_axes(rows[0])[:, near_normal % 3])


def composite_solid(
    assembly: Assembly, scope: Scope, keyword: Keyword, rows: IntArray, materials: Materials
) -> CompositeSolid:
    """Layers along STACK DIRECTION 1, 2 or 3 (default) of the elements in rows (k,): one line each with relative thickness,
    integration points (not used), material, and orientation or angle [deg] relative to the section; mirrored by SYMMETRIC.

    The angle is about axis 1, 2 or 3 in the second line of the ORIENTATION. Raises DeckError for a layer without
    thickness, a material that is missing or plane-stress only, an angle without that axis, and unsupported elements."""
    if "MATERIAL" in keyword.parameters:
        raise keyword.error(
            "a COMPOSITE section must not have a MATERIAL",
            "remove MATERIAL, because each layer of a composite defines a material",
        )
    text = keyword.parameters.get("STACKDIRECTION") or "3"
    direction = parse_integer(text)
    if direction not in (1, 2, 3):
        raise keyword.error(
            f"STACK DIRECTION={text} is not valid",
            "specify the stacking direction of the layers in each element, 1, 2 or 3",
        )
    _check_elements(assembly, keyword, rows, direction)
    axes = solid_axes(assembly, scope, keyword, keyword.parameters.get("ORIENTATION", ""))
    layers = [_layer(assembly, scope, row, i, axes, materials) for i, row in enumerate(keyword.rows(), start=1)]
    both = (*layers, *reversed(layers)) if "SYMMETRIC" in keyword.parameters else tuple(layers)
    return CompositeSolid(both, direction - 1)


def _layer(
    assembly: Assembly, scope: Scope, row: Row, number: int, axes: SolidAxes | None, materials: Materials
) -> Layer:
    t = row.positive(0, f"the thickness of layer {number}")
    if not row.text(2):
        raise row.error(f"layer {number} has no material", "add the material as the third entry of the line")
    material = materials.of_layer(row.text(2), row)
    if material not in materials.properties.anisotropic:
        return Layer(material, t, Orientation(BASIC, np.eye(3)))
    angle = parse_real(row.text(3)) if row.text(3) else 0.0
    layer_axes = axes if angle is not None else solid_axes(assembly, scope, row, row.text(3))
    if layer_axes is None:
        if angle or not np.allclose(scope.rotation, np.eye(3)):
            turned = f"rotated by {angle:g}°" if angle else "in a rotated instance"
            raise row.error(
                f"layer {number} is anisotropic and {turned}, but its section has no ORIENTATION",
                "add ORIENTATION=… to the section; write line 2 of its *ORIENTATION: number 1, 2 or 3 of the axis normal "
                "to the layers, then the angle 0",
            )
        return Layer(material, t, Orientation(BASIC, np.eye(3)))
    if not angle:
        return Layer(material, t, layer_axes.orientation)
    if layer_axes.about is None:
        raise row.error(
            f"layer {number} is rotated by {angle:g}°, but the ORIENTATION at {layer_axes.where} does not "
            "define the rotation axis",
            "add a second line to this *ORIENTATION: the axis normal to the layers (1, 2 or 3), and the angle 0",
        )
    turn = layer_axes.orientation.turn @ rotation(np.eye(3)[layer_axes.about - 1], np.radians(angle))
    return Layer(material, t, replace(layer_axes.orientation, turn=turn))


def _check_elements(assembly: Assembly, keyword: Keyword, rows: IntArray, direction: int) -> None:
    for row in rows.tolist():
        kind = ELEMENTS[assembly.kind[row]].name if assembly.kind[row] >= 0 else ""
        if direction - 1 not in STACKED.get(kind, ()):
            lacks = f"layers stacked in direction {direction}" if kind in STACKED else "layers"
            raise keyword.error(
                f"{assembly.element(row)} cannot have {lacks}",
                "use layers only in hexahedra, or in wedges with STACK DIRECTION=3; use a section with a "
                "MATERIAL for other elements",
            )
