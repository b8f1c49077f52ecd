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
from strainsight.fem.shells_and_beams import motions, thin_operators
from strainsight.fem.springs import spring_operator
from strainsight.fem.support import require_support, rigid_motions
from strainsight.mesh.anisotropic import Anisotropic
from strainsight.mesh.kinds import FAMILIES
from strainsight.mesh.model import Material, Mesh
from strainsight.mesh.thin import Lamina

ZERO_STIFFNESS = 1e-11
"""Share of the strongest rotational stiffness of a node: a smaller one is rounding."""


@dataclass(frozen=True)
class FiniteElementModel:
    """stiffness Tᵀ K(θ) T and mass Tᵀ M(θ) T: sparse affine operators (n_free, n_free); rigid (n_free, k): rigid-body modes of
    a free structure, None of a supported one; factorise: the factorisation of its stiffness."""

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
    """model; motion (r, n_free) of the rows of imported matrices, None for an assembled model; notes: sentences for a warning;
    modes: number of imported modes, which are its first free motions, None of another model; alike: whether the model
    without loads has the same modes, in its first coordinates."""

    model: FiniteElementModel
    motion: sparse.csr_array | None = None
    notes: tuple[str, ...] = ()
    modes: int | None = None
    alike: bool = True

    def at_most(self, modes: int) -> int:
        """The number of modes, limited to the number of imported ones."""
        return modes if self.modes is None else min(modes, self.modes)

    def in_coordinates(self, shape: np.ndarray) -> np.ndarray:
        """Modes of the model without loads, on the free motions of this one: static responses follow the modes."""
        behind = self.model.size - len(shape)
        return np.vstack([shape, np.zeros((behind, shape.shape[1]))]) if behind else shape


def build_model(
    mesh: Mesh, parameters: Sequence[Parameter] = (), *, supported: bool = True, free: bool = False
) -> FiniteElementModel:
    """Assemble and constrain the mesh; check that it is supported (unless `supported=False`), or, if `free`, that it has
    exactly the rigid-body motions.

        K_free(θ) = Tᵀ (K(θ) + K_s(θ)) T,     M_free(θ) = Tᵀ (M(θ) + M_p) T     term by term (5.8)

    K and M of solids, shells and beams, K_s the springs, M_p the point masses.

    Raises DeckError and UserError of `assemble`, `constraint_transform`, `require_support` and `rigid_motions`."""
    if not any(len(nodes) for nodes in mesh.connectivity):
        raise DeckError("the mesh has no elements", remedy=f"Provide a mesh with {FAMILIES}, shells or beams.")
    constraint = constraint_transform(mesh, rotations=turning_nodes(mesh))
    if constraint.transform.shape[1] == 0:
        raise DeckError("every node is clamped", remedy="Remove the supports of nodes that can move in the test.")
    rigid = rigid_motions(mesh, constraint) if free else None
    if supported and not free:
        require_support(mesh, constraint, lambda: soft_springs(mesh))
    stiffness, mass = assemble(mesh, parameters)
    T = constraint.transform[: 3 * len(mesh.position)]
    # sequentially, so that the matrices of all nodes are freed as soon as they are reduced
    stiffness = restricted(stiffness, T)
    mass = restricted(mass, T)
    if mesh.thin:
        T = sparse.csr_array(motions(mesh, constraint.reference_rows) @ constraint.transform)
        thin = (restricted(operator, T) for operator in thin_operators(mesh, parameters))
        stiffness, mass = (sum_of(solid, more) for solid, more in zip((stiffness, mass), thin, strict=True))
    if len(mesh.turning):
        autospc = autospc_stiffness(mesh, constraint, at_reference(stiffness, parameters))
        stiffness = replace(stiffness, constant=stiffness.constant + autospc)
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
    """Suggest soft springs to support a free structure: k = m (ω₁/10)², ω₁ of its first elastic mode; "" without one."""
    if not (speeds := _squared_wave_speeds(mesh)):
        return ""
    try:
        free = build_model(mesh, supported=False)
        mass, _ = mass_properties(mesh)
        # below the first elastic mode of a bar a hundred times as long as thick, above the rounding of the rigid-body modes
        low = 1e-4 * min(speeds) / float(np.ptp(mesh.position, axis=0).max()) ** 2
        frequency, _ = modes(free.stiffness.constant, free.mass.constant, min(7, free.size - 1), shift=-low)
        first = float(frequency[(2 * np.pi * frequency) ** 2 > low][0])
    except (StrainsightError, IndexError, ValueError):  # no elastic mode, or no density
        return ""
    k = float(f"{mass * (2 * np.pi * first / 10) ** 2:.2g}")
    return (
        " For a free structure with strain gauges only, set mesh.free: true. Otherwise add soft springs on a face, or "
        f"on nodes that do not lie on one line. With `stiffness: {k:g}` [N/m] in mesh.supports, the frequencies of the "
        f"rigid-body modes are about a tenth of that of the first elastic mode ({first:.3g} Hz)."
    )


def _squared_wave_speeds(mesh: Mesh) -> list[float]:
    """E/ρ [m²/s²] of every material that has mass, of an orthotropic or anisotropic one the smallest."""
    used = [mesh.material_of(region) for region in mesh.regions]
    plies = [ply for region in mesh.regions for ply in mesh.ply_materials(region)]
    layers = [layer for region in mesh.regions for layer in mesh.layer_materials(region)]
    stiff = [(iso.youngs_modulus, iso.density) for iso in (*used, *plies, *layers) if isinstance(iso, Material)]
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


def autospc_stiffness(mesh: Mesh, constraint: Constraint, K: sparse.csr_array) -> sparse.csr_array:
    """Stiffness (n_free, n_free) for unconstrained rotations v of single nodes (AUTOSPC):  Σ k v vᵀ  over vᵀKv = 0.

    K is positive semidefinite, so that Kv = 0 too and the added stiffness changes no other motion. Bars without torsion and
    trusses of beams without bending then leave no mechanism. Unlike AUTOSPC in Nastran, v may have any direction.
    K (n_free, n_free) on the free motions."""
    column = np.full(constraint.transform.shape[0], -1)
    column[constraint.free_rows] = np.arange(len(constraint.free_rows))
    at = column[constraint.rotations(mesh.turning)]
    rows, columns = (np.broadcast_to(index, (len(at), 3, 3)) for index in (at[:, :, None], at[:, None, :]))
    if not (free := (rows >= 0) & (columns >= 0)).any():
        return sparse.csr_array(K.shape)
    B = np.zeros(free.shape)
    B[free] = K[rows[free], columns[free]]
    largest = np.linalg.eigvalsh(B)[:, -1]
    k = np.where(largest > 0, largest, float(K.diagonal().mean()))
    # prescribed and dependent motions count as resisted
    B += k[:, None, None] * np.eye(3) * (at < 0)[:, :, None]
    strength, v = np.linalg.eigh(B)
    unconstrained = strength <= ZERO_STIFFNESS * k[:, None]
    added = np.einsum("n,ni,nai,nbi->nab", k, unconstrained, v, v)
    nonzero = free & (added != 0)
    return sparse.csr_array((added[nonzero], (rows[nonzero], columns[nonzero])), shape=K.shape)
