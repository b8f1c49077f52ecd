"""The finite-element model on its free motions: K(θ)z + M(θ)z̈ = S u with z = T z_free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from strainsight.errors import DeckError, UserError
from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.assembly import assemble
from strainsight.fem.constraints import Constraint, constraint_transform
from strainsight.fem.support import require_support
from strainsight.mesh.model import Mesh


@dataclass(frozen=True)
class FiniteElementModel:
    """stiffness Tᵀ K(θ) T and mass Tᵀ M(θ) T: sparse affine operators (n_free, n_free)."""

    mesh: Mesh
    constraint: Constraint
    stiffness: AffineOperator
    mass: AffineOperator

    @property
    def size(self) -> int:
        """n_free."""
        return int(self.constraint.transform.shape[1])


@dataclass(frozen=True)
class PointLoad:
    """A force of unit resultant on a node, or shared equally by the nodes of a set; direction (3,), not all zero."""

    name: str
    direction: tuple[float, float, float]
    node_id: int | None = None
    node_set: str | None = None


def build_model(mesh: Mesh, parameters: Sequence[Parameter] = (), *, supported: bool = True) -> FiniteElementModel:
    """Assemble, constrain, and make sure that nothing moves freely (`supported=False` leaves that out).

        K_free(θ) = Tᵀ K(θ) T,     M_free(θ) = Tᵀ M(θ) T     term by term (5.8)

    Raises DeckError and UserError of `assemble`, `constraint_transform` and `require_support`.
    """
    if not any(len(block.ids) for block in mesh.blocks):
        raise DeckError("the mesh has no solid elements", remedy="give it tetrahedra, hexahedra or wedges")
    constraint = constraint_transform(mesh)
    if constraint.transform.shape[1] == 0:
        raise DeckError("every node is clamped", remedy="free the nodes that are to move")
    if supported:
        require_support(mesh, constraint)
    stiffness, mass = assemble(mesh, parameters)
    T = constraint.transform[: 3 * len(mesh.position)]
    return FiniteElementModel(mesh, constraint, _restricted(stiffness, T), _restricted(mass, T))


def input_shape(model: FiniteElementModel, loads: Sequence[PointLoad]) -> np.ndarray:
    """S = Tᵀe (n_free, n_u) [-]: e puts a unit force on the node, or 1/k of it on each of the k nodes of a set.

    Raises UserError for a node or set that is not there, a direction of no length, and a node that is clamped in the
    direction.
    """
    mesh, T = model.mesh, model.constraint.transform
    e = np.zeros((T.shape[0], len(loads)))
    for column, load in enumerate(loads):
        direction = np.asarray(load.direction, dtype=float)
        length = np.linalg.norm(direction)
        if direction.shape != (3,) or not (length > 0 and np.isfinite(length)):
            raise UserError(
                f"load {load.name} has the direction {load.direction}", remedy="give three numbers, not all zero"
            )
        nodes = _loaded_nodes(mesh, load)
        for node in nodes:
            rows = T[3 * node : 3 * node + 3]
            if not np.any(rows.T @ direction):
                raise UserError(
                    f"load {load.name} acts on node {mesh.node_ids[node]}, which cannot move in its direction",
                    remedy="it is clamped or in no element: load another node or direction",
                )
            e[3 * node : 3 * node + 3, column] += direction / length / len(nodes)
    return T.T @ e


def nodal(model: FiniteElementModel, free_vectors: np.ndarray) -> np.ndarray:
    """Displacements of all nodes z = T z_free without the rotations: (n_free, r) → (3n, r), row 3·node + component."""
    return model.constraint.transform[: 3 * len(model.mesh.position)] @ free_vectors


def _loaded_nodes(mesh: Mesh, load: PointLoad) -> list[int]:
    if (load.node_id is None) == (load.node_set is None):
        raise UserError(f"load {load.name} needs a node or a node set", remedy="give one of the two")
    if load.node_id is not None:
        ids = [load.node_id]
    elif load.node_set is not None and load.node_set in mesh.node_sets:
        ids = [int(i) for i in np.unique(mesh.node_sets[load.node_set])]
    else:
        known = ", ".join(sorted(mesh.node_sets)) or "none"
        raise UserError(
            f"load {load.name} refers to node set {load.node_set!r}, which is not there", remedy=f"node sets: {known}"
        )
    index = {int(node): i for i, node in enumerate(mesh.node_ids)}
    missing = [node for node in ids if node not in index]
    if missing or not ids:
        raise UserError(
            f"load {load.name} refers to node {missing[0]}, which is not there"
            if missing
            else f"load {load.name} refers to an empty node set",
            remedy="node numbers are the ids of the mesh file",
        )
    return [index[node] for node in ids]


def _restricted(operator: AffineOperator, T: sparse.csr_array) -> AffineOperator:
    return AffineOperator(
        _congruence(operator.constant, T), {name: _congruence(term, T) for name, term in operator.terms.items()}
    )


def _congruence(X: sparse.csr_array, T: sparse.csr_array) -> sparse.csr_array:
    reduced = sparse.csr_array(T.T.tocsr() @ (X @ T))
    reduced.sort_indices()
    return reduced
