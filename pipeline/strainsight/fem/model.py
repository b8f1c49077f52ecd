"""The finite-element model on its free motions: K(θ)z + M(θ)z̈ = S u with z = T z_free."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from strainsight.errors import DeckError, StrainsightError
from strainsight.fem.affine import AffineOperator, Parameter, sum_of
from strainsight.fem.assembly import assemble
from strainsight.fem.constraints import Constraint, constraint_transform
from strainsight.fem.equations import turning_nodes
from strainsight.fem.factorisation import Factorise, factorise
from strainsight.fem.mass import mass_properties, point_mass_matrix
from strainsight.fem.modes import modes
from strainsight.fem.springs import spring_operator
from strainsight.fem.support import require_support, rigid_motions
from strainsight.fem.thin import motions, thin_operators
from strainsight.mesh.anisotropic import Anisotropic
from strainsight.mesh.kinds import FAMILIES
from strainsight.mesh.model import Material, Mesh
from strainsight.mesh.thin import Lamina

IDLE = 1e-11
"""Of the strongest resistance that a node has to rotations: one below it is rounding."""


@dataclass(frozen=True)
class FiniteElementModel:
    """stiffness Tᵀ K(θ) T and mass Tᵀ M(θ) T: sparse affine operators (n_free, n_free); rigid (n_free, k): the motions
    without stiffness of a free structure, None of one that is held; factorise: who factorises its stiffness."""

    mesh: Mesh
    constraint: Constraint
    stiffness: AffineOperator
    mass: AffineOperator
    rigid: np.ndarray | None = None
    factorise: Factorise = factorise

    @property
    def size(self) -> int:
        """n_free."""
        return int(self.constraint.transform.shape[1])


@dataclass(frozen=True)
class FullModel:
    """model; motion (r, n_free) of the rows of ready matrices, None for an assembled model; notes: sentences for a warning;
    modes: how many modes of another program it is made of, its first free motions, None of another model; alike: whether the
    model without loads has the same modes, in its first coordinates."""

    model: FiniteElementModel
    motion: sparse.csr_array | None = None
    notes: tuple[str, ...] = ()
    modes: int | None = None
    alike: bool = True

    def at_most(self, modes: int) -> int:
        """So many modes, or as many as there are results of."""
        return modes if self.modes is None else min(modes, self.modes)

    def in_coordinates(self, shape: np.ndarray) -> np.ndarray:
        """Modes of the model without loads, on the free motions of this one: static responses stand behind the modes."""
        behind = self.model.size - len(shape)
        return np.vstack([shape, np.zeros((behind, shape.shape[1]))]) if behind else shape


def build_model(
    mesh: Mesh, parameters: Sequence[Parameter] = (), *, supported: bool = True, free: bool = False
) -> FiniteElementModel:
    """Assemble, constrain, and make sure that nothing moves freely (`supported=False` leaves that out), or, of a `free`
    structure, that it moves as one rigid body.

        K_free(θ) = Tᵀ (K(θ) + K_s(θ)) T,     M_free(θ) = Tᵀ (M(θ) + M_p) T     term by term (5.8)

    K and M of solids, shells and beams, K_s the springs, M_p the point masses.

    Raises DeckError and UserError of `assemble`, `constraint_transform`, `require_support` and `rigid_motions`.
    """
    if not any(len(nodes) for nodes in mesh.connectivity):
        raise DeckError("the mesh has no elements", remedy=f"give it {FAMILIES}, shells or beams")
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
    if mesh.thin:
        T = sparse.csr_array(motions(mesh, constraint.reference_rows) @ constraint.transform)
        thin = (restricted(own, T) for own in thin_operators(mesh, parameters))
        stiffness, mass = (sum_of(own, more) for own, more in zip((stiffness, mass), thin, strict=True))
    if len(mesh.turning):
        idle = idle_rotations(mesh, constraint, at_reference(stiffness, parameters))
        stiffness = replace(stiffness, constant=stiffness.constant + idle)
    if mesh.springs or any(parameter.springs for parameter in parameters):
        springs = spring_operator(mesh, constraint.reference_rows, parameters)
        stiffness = sum_of(stiffness, restricted(springs, constraint.transform))
    if mesh.point_masses:
        points = congruence(point_mass_matrix(mesh, constraint.reference_rows), constraint.transform)
        mass = replace(mass, constant=mass.constant + points)
    return FiniteElementModel(mesh, constraint, stiffness.on_one_pattern(), mass.on_one_pattern(), rigid)


def at_reference(X: AffineOperator, parameters: Sequence[Parameter]) -> sparse.csr_array:
    """X at the reference values of its parameters."""
    return sparse.csr_array(
        X.at({parameter.name: parameter.reference for parameter in parameters if parameter.name in X.parameters})
    )


def soft_springs(mesh: Mesh) -> str:
    """Which soft springs a free structure could hang on: k = m (ω₁/10)², ω₁ of its first elastic mode; "" without one."""
    if not (speeds := _squared_wave_speeds(mesh)):
        return ""
    try:
        free = build_model(mesh, supported=False)
        mass, _ = mass_properties(mesh)
        # below the first elastic mode of a bar a hundred times as long as it is thick, above the rounding of the rigid ones
        low = 1e-4 * min(speeds) / float(np.ptp(mesh.position, axis=0).max()) ** 2
        frequency, _ = modes(free.stiffness.constant, free.mass.constant, min(7, free.size - 1), shift=-low)
        first = float(frequency[(2 * np.pi * frequency) ** 2 > low][0])
    except (StrainsightError, IndexError, ValueError):  # no mode of its own, or no density
        return ""
    k = float(f"{mass * (2 * np.pi * first / 10) ** 2:.2g}")
    return (
        "; of a structure that is free, with gauges only: mesh.free: true"
        "; or let it hang free on soft springs, on a face or on nodes that do not lie on a line: "
        f"`stiffness: {k:g}` [N/m] of mesh.supports keeps its rigid motions at a tenth of its first elastic mode, {first:.3g} Hz"
    )


def _squared_wave_speeds(mesh: Mesh) -> list[float]:
    """E/ρ [m²/s²] of every material that has mass, of an orthotropic or anisotropic one the smallest."""
    used = [mesh.material_of(region) for region in mesh.regions]
    plies = [ply for region in mesh.regions for ply in mesh.ply_materials(region)]
    layers = [layer for region in mesh.regions for layer in mesh.layer_materials(region)]
    stiff = [(own.youngs_modulus, own.density) for own in (*used, *plies, *layers) if isinstance(own, Material)]
    stiff += [(min(ply.e1, ply.e2), ply.density) for ply in plies if isinstance(ply, Lamina)]
    shells = (mesh.general_shell(region) for region in mesh.regions)
    stiff += [(float(np.linalg.eigvalsh(shell.membrane)[0]), shell.density) for shell in shells if shell is not None]
    solids = (*(mesh.anisotropic_of(region) for region in mesh.regions), *layers)
    stiff += [(min(solid.moduli), solid.density) for solid in solids if isinstance(solid, Anisotropic)]
    return [E / density for E, density in stiff if density > 0]


def restricted(operator: AffineOperator, T: sparse.csr_array) -> AffineOperator:
    """Tᵀ X(θ) T term by term; X (n, n), T CSR (n, n_free)."""
    return operator.of_all(lambda X: congruence(X, T))


def congruence(X: sparse.csr_array, T: sparse.csr_array) -> sparse.csr_array:
    """Tᵀ X T, CSR with sorted columns."""
    reduced = sparse.csr_array(T.T.tocsr() @ (X @ T))
    reduced.sort_indices()
    return reduced


def nodal(model: FiniteElementModel, free_vectors: np.ndarray) -> np.ndarray:
    """Displacements of all nodes z = T z_free without the rotations: (n_free, r) → (3n, r), row 3·node + component."""
    return model.constraint.transform[: 3 * len(model.mesh.position)] @ free_vectors


def idle_rotations(mesh: Mesh, constraint: Constraint, K: sparse.csr_array) -> sparse.csr_array:
    """Stiffness (n_free, n_free) for rotations v of single nodes that nothing resists:  Σ k v vᵀ  over vᵀKv = 0.

    K is positive semidefinite, so that Kv = 0 too: what is added there changes no other motion. So bars without torsion, and a
    truss of beams without bending, leave no mechanism (AUTOSPC in Nastran, here along any direction).
    K (n_free, n_free) on the free motions.
    """
    column = np.full(constraint.transform.shape[0], -1)
    column[constraint.free_rows] = np.arange(len(constraint.free_rows))
    at = column[constraint.rotations(mesh.turning)]
    rows, columns = (np.broadcast_to(own, (len(at), 3, 3)) for own in (at[:, :, None], at[:, None, :]))
    free = (rows >= 0) & (columns >= 0)
    if not free.any():
        return sparse.csr_array(K.shape)
    B = np.zeros(free.shape)
    B[free] = K[rows[free], columns[free]]
    largest = np.linalg.eigvalsh(B)[:, -1]
    k = np.where(largest > 0, largest, float(K.diagonal().mean()))
    # motions that are held, or follow others, are resisted
    B += k[:, None, None] * np.eye(3) * (at < 0)[:, :, None]
    strength, v = np.linalg.eigh(B)
    idle = strength <= IDLE * k[:, None]
    added = np.einsum("n,ni,nai,nbi->nab", k, idle, v, v)
    kept = free & (added != 0)
    return sparse.csr_array((added[kept], (rows[kept], columns[kept])), shape=K.shape)
