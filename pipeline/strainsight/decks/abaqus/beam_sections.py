"""*BEAM SECTION and *BEAM GENERAL SECTION: shapes, moments and directions; y of a `BeamSection` is n1 here, z is n2."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.decks.abaqus.scopes import Scope
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.faults import elastic_fault
from strainsight.decks.numbers import parse_real
from strainsight.errors import DeckError
from strainsight.mesh.model import FloatArray
from strainsight.mesh.section_shapes import section_of_shape
from strainsight.mesh.thin import BeamSection

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
        ratio = G / (E / 2)
        section = replace(
            section, torsion=section.torsion * ratio, shear=(section.shear[0] * ratio, section.shear[1] * ratio)
        )
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
        upright,
        second=turn @ upright.second @ turn.T,
        shear=upright.shear[::-1],
        points=upright.points @ turn.T,
    )
    return turned, np.array([0.0, -foot - l])


def _offset(keyword: Keyword, shape: str, d: list[float]) -> FloatArray:
    """OFFSET1 and OFFSET2 of CalculiX: how far the nodes lie from the axis along n1 and n2, in thicknesses there."""
    sizes = {"RECT": d[:2], "BOX": d[:2]}.get(shape, [2 * d[0]] * 2)
    if shape in ("I", "GENERAL"):
        raise keyword.error(
            f"OFFSET1 and OFFSET2 of SECTION={shape} are not supported", "give a RECT, BOX, PIPE or CIRC"
        )
    share = []
    for parameter in ("OFFSET1", "OFFSET2"):
        text = keyword.parameters.get(parameter, "") or "0"
        if (value := parse_real(text)) is None:
            raise keyword.error(f"{parameter}={text} is no number", "give the offset in thicknesses")
        share.append(value)
    return np.array(share) * sizes


def _n1(keyword: Keyword, rows: list[Row]) -> FloatArray:
    """The line of n1. Blank lines are passed over: the second of two lines is that of the moduli where they have to follow."""
    moduli = keyword.name == GENERAL and "MATERIAL" not in keyword.parameters
    if len(rows) < (3 if moduli else 2) or not any(rows[1].entries[:3]):
        return np.array(DEFAULT_N1)
    n1 = np.array([rows[1].real(i, "a component of n1", 0.0) for i in range(3)])
    if not np.linalg.norm(n1) > 0:
        raise rows[1].error("n1 is zero", "give the direction of the first axis of the section")
    return n1
