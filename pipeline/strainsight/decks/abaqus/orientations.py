"""*ORIENTATION: the axes of anisotropic solids; which one a section names."""

from __future__ import annotations

import numpy as np

from strainsight.decks.abaqus.parts import normal, orthonormal
from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.numbers import parse_real
from strainsight.mesh.anisotropic import Orientation
from strainsight.mesh.coordinates import BASIC, CoordinateSystem
from strainsight.mesh.model import FloatArray

SYSTEMS = ("RECTANGULAR", "ZRECTANGULAR", "CYLINDRICAL")


def named_orientation(assembly: Assembly, scope: Scope, keyword: Keyword) -> Keyword | None:
    """The *ORIENTATION that a section names, of its part or of the assembly; None where it names none."""
    name = keyword.parameters.get("ORIENTATION", "").upper()
    if not name:
        return None
    for within in (scope, assembly.scopes[""]):
        for own in within.part.keywords:
            if own.name == "ORIENTATION" and own.parameters.get("NAME", "").upper() == name:
                return own
    raise keyword.error(f"orientation {name!r} is not in the deck", "add the *ORIENTATION, or correct the name")


def rectangular_axes(row: Row) -> FloatArray:
    """Axes (3, 3), one in a column, of the points a on x, b in the plane of x and y, and the origin c."""
    points = np.array([row.real(i, "a coordinate", 0.0) for i in range(9)]).reshape(3, 3)
    x, b = points[:2] - points[2]
    return orthonormal(x, normal(x, b), row)


def solid_orientation(assembly: Assembly, scope: Scope, keyword: Keyword) -> Orientation:
    """Of a section of solids of an anisotropic material, its instance turned with it: RECTANGULAR (a on x, b in the plane xy),
    Z RECTANGULAR (a on z, b in the plane xz) or CYLINDRICAL (a and b on the axis; 1 radial, 2 around, 3 along), by coordinates;
    then turned by an angle [deg] about its axis 1, 2 or 3, as the second line says. Without one the basic axes.

    Raises DeckError for an instance that is turned without one, for distributions, and other systems and definitions.
    """
    own = named_orientation(assembly, scope, keyword)
    if own is None:
        if not np.allclose(scope.rotation, np.eye(3)):
            raise keyword.error(
                "anisotropic solids of an instance that is turned have no ORIENTATION", "give the section one"
            )
        return Orientation(BASIC, np.eye(3))
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
    return Orientation(moved, _turn(rows[1]) if len(rows) > 1 else np.eye(3))


def _turn(row: Row) -> FloatArray:
    """Axes (3, 3) that are turned by an angle [deg] about one of them."""
    about, angle = row.integer(0, "the axis", 1), np.radians(row.real(1, "the angle", 0.0))
    if about not in (1, 2, 3):
        raise row.error(f"axis {about}", "give the axis about which the others turn, 1, 2 or 3")
    one, two = about % 3, (about + 1) % 3
    turn = np.eye(3)
    turn[[one, one, two, two], [one, two, one, two]] = (
        np.cos(angle),
        -np.sin(angle),
        np.sin(angle),
        np.cos(angle),
    )
    return turn
