"""*ORIENTATION: the axes of anisotropic solids; which one a section names."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.decks.abaqus.parts import normal, orthonormal
from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.numbers import parse_real
from strainsight.mesh.anisotropic import Orientation
from strainsight.mesh.coordinates import BASIC, CoordinateSystem
from strainsight.mesh.model import FloatArray

SYSTEMS = ("RECTANGULAR", "ZRECTANGULAR", "CYLINDRICAL")


@dataclass(frozen=True)
class SolidAxes:
    """How the axes of a material of solids lie; about: which of them, 1, 2 or 3, the second line of the *ORIENTATION names, None
    where it names none; where it stands."""

    orientation: Orientation
    about: int | None
    where: str


def named_orientation(assembly: Assembly, scope: Scope, by: Keyword | Row, name: str) -> Keyword | None:
    """The *ORIENTATION of this name that a section or its line refers to, of its part or of the assembly; None for ""."""
    if not name:
        return None
    for within in (scope, assembly.scopes[""]):
        for own in within.part.keywords:
            if own.name == "ORIENTATION" and own.parameters.get("NAME", "").upper() == name.upper():
                return own
    raise by.error(f"orientation {name.upper()!r} is not in the deck", "add the *ORIENTATION, or correct the name")


def rectangular_axes(row: Row) -> FloatArray:
    """Axes (3, 3), one in a column, of the points a on x, b in the plane of x and y, and the origin c."""
    points = np.array([row.real(i, "a coordinate", 0.0) for i in range(9)]).reshape(3, 3)
    x, b = points[:2] - points[2]
    return orthonormal(x, normal(x, b), row)


def solid_orientation(assembly: Assembly, scope: Scope, keyword: Keyword) -> Orientation:
    """Of a section of solids of an anisotropic material, see `solid_axes`; without one the basic axes.

    Raises DeckError for an instance that is turned without one."""
    own = solid_axes(assembly, scope, keyword, keyword.parameters.get("ORIENTATION", ""))
    if own is None and not np.allclose(scope.rotation, np.eye(3)):
        raise keyword.error(
            "anisotropic solids of an instance that is turned have no ORIENTATION", "give the section one"
        )
    return Orientation(BASIC, np.eye(3)) if own is None else own.orientation


def solid_axes(assembly: Assembly, scope: Scope, by: Keyword | Row, name: str) -> SolidAxes | None:
    """Axes of an anisotropic material of solids, its instance turned with it: RECTANGULAR (a on x, b in the plane xy),
    Z RECTANGULAR (a on z, b in the plane xz) or CYLINDRICAL (a and b on the axis; 1 radial, 2 around, 3 along), by coordinates;
    then turned by an angle [deg] about its axis 1, 2 or 3, as the second line says. None for no name.

    Raises DeckError for one that is not there, for distributions, and other systems and definitions.
    """
    own = named_orientation(assembly, scope, by, name)
    if own is None:
        return None
    system = own.parameters.get("SYSTEM", "RECTANGULAR").upper().replace(" ", "")
    definition = own.parameters.get("DEFINITION", "COORDINATES").upper()
    if system not in SYSTEMS or definition not in ("COORDINATES", ""):
        raise own.error(
            f"SYSTEM={system}, DEFINITION={definition} is not supported for anisotropic solids",
            "give a rectangular or cylindrical one by coordinates",
        )
    rows = own.rows()
    first = rows[0]
    if parse_real(first.text(0)) is None:
        raise first.error(
            f"{first.text(0)!r} is a distribution, which is not supported for anisotropic solids",
            "give each group of elements a section with an orientation of its own, by coordinates",
        )
    points = np.array([first.real(i, "a coordinate", 0.0) for i in range(9)]).reshape(3, 3)
    if system == "CYLINDRICAL":
        origin, z = points[0], points[1] - points[0]
        aside = np.eye(3)[np.argmin(np.abs(z))]
        y = np.cross(z, aside)
        axes, kind = orthonormal(np.cross(y, z), z, first), "cylindrical"
    else:
        origin, kind = points[2], "rectangular"
        axes = rectangular_axes(first)
        if system == "ZRECTANGULAR":
            z, x, y = axes.T  # what a rectangular one calls x, y and z
            axes = np.column_stack([x, y, z])
    moved = CoordinateSystem(kind, scope.rotation @ origin + scope.translation, scope.rotation @ axes)
    if len(rows) < 2:
        return SolidAxes(Orientation(moved, np.eye(3)), None, own.where)
    about = rows[1].integer(0, "the axis", 1)
    if about not in (1, 2, 3):
        raise rows[1].error(f"axis {about}", "give the axis about which the others turn, 1, 2 or 3")
    turn = turned_about(about, rows[1].real(1, "the angle", 0.0))
    return SolidAxes(Orientation(moved, turn), about if rows[1].text(0) else None, own.where)


def turned_about(about: int, degrees: float) -> FloatArray:
    """Axes (3, 3), one in a column, that are turned by an angle [deg] about one of them, 1, 2 or 3."""
    angle = np.radians(degrees)
    one, two = about % 3, (about + 1) % 3
    turn = np.eye(3)
    turn[[one, one, two, two], [one, two, one, two]] = (
        np.cos(angle),
        -np.sin(angle),
        np.sin(angle),
        np.cos(angle),
    )
    return turn
