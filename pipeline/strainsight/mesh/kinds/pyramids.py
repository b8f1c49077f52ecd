"""Pyramids of 5 nodes: what joins hexahedra to tetrahedra."""

from __future__ import annotations

import numpy as np
from scipy.special import roots_jacobi

from strainsight.mesh.kinds import quadrangles
from strainsight.mesh.kinds.kind import HYBRID, ElementKind, Rule, Split, Values, alike, gauss, halves
from strainsight.mesh.kinds.quadrangles import QUAD4
from strainsight.mesh.kinds.triangles import TRI3
from strainsight.mesh.model import FloatArray

BASE, APEX = quadrangles.CORNERS, np.array([0.0, 0.0, 1.0])


def linear(xi: FloatArray) -> Values:
    """Base ¼(1 − ζ)(1 + ξ_a u)(1 + η_a v) with u = ξ/(1 − ζ), v = η/(1 − ζ); apex ζ (Bedrosian 1992).

    At the apex, where the gradient depends on the way there, it is that along the axis, u = v = 0.
    """
    t = 1 - xi[:, 2:]
    u, v = np.divide(xi[:, :2], t, out=np.zeros_like(xi[:, :2]), where=t != 0).T[:, :, None]
    a, b = BASE.T
    N = np.hstack([0.25 * t * (1 + a * u) * (1 + b * v), xi[:, 2:]])
    dN = np.stack([0.25 * a * (1 + b * v), 0.25 * b * (1 + a * u), -0.25 * (1 - a * b * u * v)], axis=2)
    return N, np.concatenate([dN, np.broadcast_to(APEX, (len(xi), 1, 3))], axis=1)


def _rule(points: int) -> Rule:
    """Gauss-Legendre in u and v, Gauss-Jacobi in ζ with the weight (1 − ζ)²: exact for degree 3 in u and v.

    ∂N/∂ξ and the Jacobian do not depend on ζ at u, v: one point in ζ is exact for the stiffness of any shape.
    """
    plane, weight = gauss(2, 2)
    x, w = roots_jacobi(points, 2.0, 0.0)
    t = 0.5 * (1 - np.repeat(x, len(plane)))
    return np.column_stack([np.tile(plane, (points, 1)) * t[:, None], 1 - t]), np.outer(w / 8, weight).ravel()


NODES = np.vstack([np.column_stack([BASE, np.zeros(4)]), APEX])


def _parts() -> Split:
    """Pyramids at the five corners and one upside down below the apex, four tetrahedra between."""
    foot, upright, side = np.zeros(3), 0.5 * (NODES[:4] + APEX), 0.5 * (NODES[:4] + np.roll(NODES[:4], -1, axis=0))
    pyramids = (*halves(NODES), np.vstack([upright[::-1], foot]))
    between = [np.array([foot, side[a], upright[(a + 1) % 4], upright[a]]) for a in range(4)]
    return (*alike("pyra5", pyramids), *alike("tet4", between))


PYRA5 = ElementKind(
    name="pyra5",
    family="pyramids",
    nodes=NODES,
    centre=0.25 * APEX,
    functions=linear,
    stiffness=_rule(1),
    mass=_rule(2),
    facets=((QUAD4, (0, 3, 2, 1)), (TRI3, (0, 1, 4)), (TRI3, (1, 2, 4)), (TRI3, (2, 3, 4)), (TRI3, (3, 0, 4))),
    sides=(
        *((0, 1, 3, 4), (1, 2, 0, 4), (2, 3, 1, 4), (3, 0, 2, 4)),
        *((4, 1, 0, 2), (4, 2, 1, 3), (4, 3, 2, 0), (4, 0, 3, 1)),
    ),
    regular=0.5**0.5,
    mirrored=(0, 3, 2, 1, 4),
    vtk=14,
    split=_parts(),
    nastran="CPYRAM",
    gmsh=7,
    abaqus={"C3D5": "", "C3D5H": HYBRID},
    meshio={"pyramid": ()},
)
