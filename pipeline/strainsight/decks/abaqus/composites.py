"""Laminates of an Abaqus deck: *SHELL SECTION, COMPOSITE, and shells of one orthotropic material."""

from __future__ import annotations

import numpy as np

from strainsight.decks.abaqus.materials import Materials
from strainsight.decks.abaqus.text import Keyword
from strainsight.decks.numbers import parse_real
from strainsight.mesh.laminates import Laminate, Ply
from strainsight.mesh.model import FloatArray

NEAR = np.cos(np.radians(0.1))
"""Normals nearer to x than 0.1° have the projection of z as their first axis in place of that of x."""


def laminate(keyword: Keyword, made: Materials, nonstructural: float) -> Laminate:
    """Plies from the lower face up, a line each: thickness, points of integration, material, angle [deg] about the normal from
    the axis of the section; mirrored by SYMMETRIC.

    Raises DeckError for a ply without thickness or material, and for an orientation of a ply of its own.
    """
    plies = []
    for number, row in enumerate(keyword.rows(), start=1):
        t = row.real(0, f"the thickness of ply {number}")
        if not t > 0:
            raise row.error(f"the thickness of ply {number} is {t:g}, not positive", "give a positive thickness")
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
