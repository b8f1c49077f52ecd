"""The finite-element model on its free motions: K(θ)z + M(θ)z̈ = S u with z = T z_free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from strainsight.errors import DeckError, StrainsightError
from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.assembly import assemble, mass_properties
from strainsight.fem.constraints import Constraint, constraint_transform
from strainsight.fem.modes import modes
from strainsight.fem.point_masses import point_mass_matrix
from strainsight.fem.springs import spring_matrix
from strainsight.fem.support import require_support, rigid_motions
from strainsight.fem.turning import turning_nodes
from strainsight.mesh.kinds import FAMILIES
from strainsight.mesh.model import Mesh


@dataclass(frozen=True)
class FiniteElementModel:
    """stiffness Tᵀ K(θ) T and mass Tᵀ M(θ) T: sparse affine operators (n_free, n_free); rigid (n_free, k): the motions
    without stiffness of a free structure, None of one that is held."""

    mesh: Mesh
    constraint: Constraint
    stiffness: AffineOperator
    mass: AffineOperator
    rigid: np.ndarray | None = None

    @property
    def size(self) -> int:
        """n_free."""
        return int(self.constraint.transform.shape[1])


def build_model(
    mesh: Mesh, parameters: Sequence[Parameter] = (), *, supported: bool = True, free: bool = False
) -> FiniteElementModel:
    """Assemble, constrain, and make sure that nothing moves freely (`supported=False` leaves that out), or, of a `free`
    structure, that it moves as one rigid body.

        K_free(θ) = Tᵀ (K(θ) + K_s) T,     M_free(θ) = Tᵀ (M(θ) + M_p) T     term by term (5.8)

    K_s the springs, M_p the point masses.

    Raises DeckError and UserError of `assemble`, `constraint_transform`, `require_support` and `rigid_motions`.
    """
    if not any(len(block.ids) for block in mesh.blocks):
        raise DeckError("the mesh has no solid elements", remedy=f"give it {FAMILIES}")
    constraint = constraint_transform(mesh, rotations=turning_nodes(mesh))
    if constraint.transform.shape[1] == 0:
        raise DeckError("every node is clamped", remedy="free the nodes that are to move")
    rigid = rigid_motions(mesh, constraint) if free else None
    if supported and not free:
        require_support(mesh, constraint, lambda: soft_springs(mesh))
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
    return FiniteElementModel(mesh, constraint, stiffness, mass, rigid)


def soft_springs(mesh: Mesh) -> str:
    """Which soft springs a free structure could hang on: k = m (ω₁/10)², ω₁ of its first elastic mode; "" without one."""
    try:
        free = build_model(mesh, supported=False)
        mass, _ = mass_properties(mesh)
        used = [
            mesh.materials[region.material] for region in mesh.regions.values() if region.material in mesh.materials
        ]
        waves = min(own.youngs_modulus / own.density for own in used if own.density > 0)
        # below the first elastic mode of a bar a hundred times as long as it is thick, above the rounding of the rigid ones
        low = 1e-4 * waves / float(np.ptp(mesh.position, axis=0).max()) ** 2
        frequency, _ = modes(free.stiffness.constant, free.mass.constant, min(7, free.size - 1), shift=-low)
        first = float(frequency[(2 * np.pi * frequency) ** 2 > low][0])
    except (StrainsightError, IndexError):
        return ""
    k = float(f"{mass * (2 * np.pi * first / 10) ** 2:.2g}")
    return (
        "; of a structure that is free, with gauges only: mesh.free: true"
        "; or let it hang free on soft springs, on a face or on nodes that do not lie on a line: "
        f"`stiffness: {k:g}` [N/m] of mesh.supports keeps its rigid motions at a tenth of its first elastic mode, {first:.3g} Hz"
    )


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
