"""Forces on nodes that stand for a traction on a face."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from strainsight.mesh.facets import all_facets, facet_key
from strainsight.mesh.forces import NodalForces
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.model import Mesh
from strainsight.mesh.tractions import consistent_forces

Traction = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""x (q, 3) [m] and outward unit normal n (q, 3) → t (q, 3) [Pa]."""


def traction_forces(mesh: Mesh, face: str, traction: Traction) -> NodalForces:
    """f_a = ∫ N_a t dA over a face of the mesh, on all its nodes; the rule is that of the facets' N Nᵀ."""
    facets, own = all_facets(mesh), mesh.faces[face]
    chosen = np.isin(facets.key, facet_key(*own.T))
    force, on_it = np.zeros_like(mesh.position), np.zeros(len(mesh.position), dtype=bool)
    for number in np.unique(facets.kind[chosen]):
        kind = FACETS[number]
        nodes = facets.nodes[chosen & (facets.kind == number), : len(kind.nodes)]
        own_forces = consistent_forces(
            mesh.position,
            kind,
            nodes,
            lambda x, n, _: traction(x.reshape(-1, 3), n.reshape(-1, 3)).reshape(x.shape),
        )
        np.add.at(force, nodes, own_forces)
        on_it[nodes] = True
    found = np.flatnonzero(on_it)
    return NodalForces(found, force[found])


def evenly(mesh: Mesh, face: str, direction: np.ndarray) -> NodalForces:
    """A unit force along the unit direction (3,), t = d/A."""
    own = traction_forces(mesh, face, lambda x, n: np.broadcast_to(direction, x.shape))
    return _of_unit(own, direction)


def bearing(mesh: Mesh, face: str, direction: np.ndarray) -> NodalForces:
    """What a pin presses on a bore with, along the unit direction (3,):  t = −n p,  p ∝ max(0, −n·d),  a unit force along d.

    The force is zero where no part of the face is turned against d.
    """

    def pressed(x: np.ndarray, n: np.ndarray) -> np.ndarray:
        return -n * np.maximum(0.0, -(n @ direction))[:, None]

    return _of_unit(traction_forces(mesh, face, pressed), direction)


def pressure(mesh: Mesh, face: str) -> NodalForces:
    """A pressure of 1 Pa, t = −n."""
    return traction_forces(mesh, face, lambda x, n: -n)


def turning(mesh: Mesh, face: str, moment: np.ndarray) -> NodalForces:
    """A moment (3,) [N m] about the centre of the face and no force:  t = ω × r,  Jω = M,  J = ∫ (r·r I − r rᵀ) dA."""
    each = traction_forces(mesh, face, lambda x, n: np.ones_like(x))
    place, area = mesh.position[each.nodes], each.force[:, 0]
    centre = area @ place / area.sum()

    def about(axis: np.ndarray) -> NodalForces:
        return traction_forces(mesh, face, lambda x, n: np.cross(axis, x - centre))

    J = np.column_stack([np.cross(place - centre, about(axis).force).sum(axis=0) for axis in np.eye(3)])
    return about(np.linalg.solve(J, moment))


def _of_unit(own: NodalForces, direction: np.ndarray) -> NodalForces:
    """Divided by the part of its resultant along the direction, where it has one."""
    along = own.force.sum(axis=0) @ direction
    return NodalForces(own.nodes, own.force / along if along > 0 else np.zeros_like(own.force))
