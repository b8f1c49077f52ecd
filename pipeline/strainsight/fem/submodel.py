"""A part of a mesh by itself, moved at its cut boundary as the whole model moves there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.factorisation import factorise
from strainsight.fem.nodal_forces import Tractions, spread_forces
from strainsight.fem.patch import Patch
from strainsight.mesh.facets import Facets
from strainsight.mesh.model import Mesh
from strainsight.mesh.subdivision import Refined, refined


@dataclass(frozen=True)
class Submodel:
    """A patch in equilibrium: its mesh; field z (3k, r); held (k, 3): what is given; force (3k, r) at nodes, zero where held;
    applied: tractions, which make some of it."""

    mesh: Mesh
    field: np.ndarray
    held: np.ndarray
    force: np.ndarray
    applied: Tractions

    def part(self, patch: Patch) -> Submodel:
        """Some of its elements by themselves, moved at their cut boundary as it is."""
        held = self.held[patch.nodes] | patch.cut[:, None]
        rows = (3 * patch.nodes[:, None] + np.arange(3)).ravel()
        force = np.where(held.reshape(-1, 1), 0.0, self.force[rows])
        return Submodel(patch.mesh, self.field[rows], held, force, self.applied.within(patch))

    @property
    def concentrated(self) -> np.ndarray:
        """What no traction makes of the forces (3k, r) at nodes, zero where held."""
        return np.where(self.held.reshape(-1, 1), 0.0, self.force - self.applied.forces(self.mesh.position))


def submodel(patch: Patch, field: np.ndarray, held: np.ndarray, forced: np.ndarray, applied: Tractions) -> Submodel:
    """The patch for the motion of what is cut or held, under the forces that the field needs at forced nodes:

        K_ii z_i = f − K_ib z_b,     f = (K z)_i at forced nodes, zero elsewhere

    so that inertia within the patch is left out, which on the scale of a few elements bends nothing.
    field z (3k, r) of the whole model at the nodes of the patch; held (k, 3) and forced (k,) of its nodes; applied: `tractions`
    of the whole mesh. Raises NumericalError where a part of it hangs on nothing.
    """
    given = held | patch.cut[:, None]
    K = assemble_stiffness(patch.mesh)
    acting = forced[:, None] & ~given
    force = np.where(acting.reshape(-1, 1), K @ field, 0.0) if acting.any() else np.zeros_like(field)
    return Submodel(patch.mesh, _solved(K, given, field, force), given, force, applied.within(patch))


def with_spread_forces(own: Submodel, facets: Facets) -> Submodel:
    """The same with the concentrated force of each node as a traction of its resultant and moment over the facets around.

    facets: exterior ones of the whole mesh that lie in it, with its node numbers.
    """
    f = own.concentrated
    forced = np.asarray(np.any(f.reshape(-1, 3 * f.shape[1]) != 0, axis=1))
    force = spread_forces(own.mesh.position, facets, forced) @ f + own.applied.forces(own.mesh.position)
    K = assemble_stiffness(own.mesh)
    return replace(own, field=_solved(K, own.held, own.field, force), force=force)


def refined_submodel(own: Submodel) -> tuple[Submodel, Refined]:
    """The same on a mesh of parts of its elements: what is held moves as its shape functions say, x_b = P z, tractions act on
    the parts of their facets, other forces stay at their nodes. A new node is held where all nodes that it is a mean of are."""
    fine = refined(own.mesh)
    P = sparse.csr_array(sparse.kron(fine.interpolation, sparse.eye_array(3), format="csr"))
    free = (~own.held).ravel().astype(float)
    given = (np.asarray(abs(P) @ free) == 0).reshape(-1, 3)
    force = np.zeros((P.shape[0], own.field.shape[1]))
    force[(3 * _fine_of_coarse(fine)[:, None] + np.arange(3)).ravel()] = own.concentrated
    applied = own.applied.cut(fine)
    force = np.where(given.reshape(-1, 1), 0.0, force + applied.forces(fine.mesh.position))
    K = assemble_stiffness(fine.mesh)
    return Submodel(fine.mesh, _solved(K, given, P @ own.field, force), given, force, applied), fine


def _fine_of_coarse(fine: Refined) -> np.ndarray:
    """The fine node (k,) at every coarse one."""
    P = fine.interpolation
    alone = np.flatnonzero(np.diff(P.indptr) == 1)
    at = np.full(P.shape[1], -1)
    at[P.indices[P.indptr[alone]]] = alone
    return at


def _solved(K: sparse.csr_array, held: np.ndarray, z: np.ndarray, force: np.ndarray) -> np.ndarray:
    """z (3k, r) where it is held (k, 3), in equilibrium with the force (3k, r) elsewhere."""
    given = held.ravel()
    found, free = z.copy(), np.flatnonzero(~given)
    if len(free):
        rows = sparse.csr_array(K[free])
        pushed = force[free] - rows[:, np.flatnonzero(given)] @ z[given]
        found[free] = factorise(sparse.csr_array(rows[:, free])).solve(pushed)
    return found
