"""The finite-element model on its free motions: K(θ)z + M(θ)z̈ = S u with z = T z_free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from strainsight.errors import DeckError
from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.assembly import assemble
from strainsight.fem.constraints import Constraint, constraint_transform
from strainsight.fem.point_masses import point_mass_matrix, turning_masses
from strainsight.fem.springs import spring_matrix, turning_springs
from strainsight.fem.support import require_support
from strainsight.mesh.kinds import FAMILIES
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


def build_model(mesh: Mesh, parameters: Sequence[Parameter] = (), *, supported: bool = True) -> FiniteElementModel:
    """Assemble, constrain, and make sure that nothing moves freely (`supported=False` leaves that out).

        K_free(θ) = Tᵀ (K(θ) + K_s) T,     M_free(θ) = Tᵀ (M(θ) + M_p) T     term by term (5.8)

    K_s the springs, M_p the point masses.

    Raises DeckError and UserError of `assemble`, `constraint_transform` and `require_support`.
    """
    if not any(len(block.ids) for block in mesh.blocks):
        raise DeckError("the mesh has no solid elements", remedy=f"give it {FAMILIES}")
    constraint = constraint_transform(mesh, rotations=[*turning_masses(mesh), *turning_springs(mesh)])
    if constraint.transform.shape[1] == 0:
        raise DeckError("every node is clamped", remedy="free the nodes that are to move")
    if supported:
        require_support(mesh, constraint)
    stiffness, mass = assemble(mesh, parameters)
    T = constraint.transform[: 3 * len(mesh.position)]
    # one after the other, so that the matrices of all nodes go as soon as those of the free motions are there
    stiffness = restricted(stiffness, T)
    mass = restricted(mass, T)
    if mesh.springs:
        springs = congruence(spring_matrix(mesh, constraint.reference_rows), constraint.transform)
        stiffness = AffineOperator(stiffness.constant + springs, stiffness.terms)
    if mesh.point_masses:
        points = congruence(point_mass_matrix(mesh, constraint.reference_rows), constraint.transform)
        mass = AffineOperator(mass.constant + points, mass.terms)
    return FiniteElementModel(mesh, constraint, stiffness, mass)


def restricted(operator: AffineOperator, T: sparse.csr_array) -> AffineOperator:
    """Tᵀ X(θ) T term by term; X (n, n), T CSR (n, n_free)."""
    terms = {name: congruence(term, T) for name, term in operator.terms.items()}
    return AffineOperator(congruence(operator.constant, T), terms)


def congruence(X: sparse.csr_array, T: sparse.csr_array) -> sparse.csr_array:
    """Tᵀ X T, CSR with sorted columns."""
    reduced = sparse.csr_array(T.T.tocsr() @ (X @ T))
    reduced.sort_indices()
    return reduced


def nodal(model: FiniteElementModel, free_vectors: np.ndarray) -> np.ndarray:
    """Displacements of all nodes z = T z_free without the rotations: (n_free, r) → (3n, r), row 3·node + component."""
    return model.constraint.transform[: 3 * len(model.mesh.position)] @ free_vectors
