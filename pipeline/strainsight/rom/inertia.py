"""Inertia invariants of a deformable body in its floating frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy import sparse

from strainsight.columns import Column
from strainsight.errors import DeckError
from strainsight.fem.affine import from_entries
from strainsight.fem.mass import element_mass_parts
from strainsight.fem.model import FiniteElementModel
from strainsight.mesh.joins import PointMass
from strainsight.mesh.model import Mesh

PER_UNIT = "per unit of the reduced coordinates (m, rad or m √kg)"


@dataclass(frozen=True)
class InertiaInvariants:
    """Integrals over the undeformed body, of the position x of a point and of its shapes Φ(x) (3, n), column k φ_k, in the
    floating frame: p = x + Φη."""

    mass: Annotated[float, Column("kg", "", "mass of the body ∫ρ dV")]
    first: Annotated[
        np.ndarray, Column("kg m", "3", "first moment of mass ∫ρ x dV about the origin of the body frame, in body axes")
    ]
    first_modal: Annotated[
        np.ndarray,
        Column(
            "kg per unit of coordinate",
            "3 × coordinate",
            f"first moment of mass of the deformation ∫ρ Φ dV in body axes, Φ: shapes {PER_UNIT}",
        ),
    ]
    second: Annotated[
        np.ndarray,
        Column("kg m^2", "3 × 3", "second moment of mass ∫ρ x xᵀ dV about the origin of the body frame, in body axes"),
    ]
    second_modal: Annotated[
        np.ndarray,
        Column(
            "kg m per unit of coordinate",
            "coordinate × 3 × 3",
            f"linear change ∫ρ (x φᵀ + φ xᵀ) dV of the second moment of mass in body axes, φ: shape {PER_UNIT}",
        ),
    ]
    second_modal2: Annotated[
        np.ndarray,
        Column(
            "kg per (unit of coordinate)^2",
            "coordinate × coordinate × 3 × 3",
            f"quadratic change ∫ρ φ_k φ_lᵀ dV of the second moment of mass in body axes, φ_k and φ_l: shapes {PER_UNIT}",
        ),
    ]
    coupling: Annotated[
        np.ndarray,
        Column(
            "kg m per unit of coordinate",
            "3 × 3 × coordinate",
            f"inertia coupling ∫ρ x_j Φ dV of body rotation and deformation (j: body axis), Φ: shapes {PER_UNIT}",
        ),
    ]
    coupling_modal: Annotated[
        np.ndarray,
        Column(
            "kg per (unit of coordinate)^2",
            "coordinate × 3 × 3 × coordinate",
            f"change ∫ρ φ_kj Φ dV of the inertia coupling with coordinate k (j: body axis), φ_k and Φ: shapes {PER_UNIT}",
        ),
    ]
    modal: Annotated[
        np.ndarray,
        Column(
            "kg per (unit of coordinate)^2",
            "coordinate × coordinate",
            f"reduced mass matrix ∫ρ ΦᵀΦ dV, Φ: shapes {PER_UNIT}",
        ),
    ]


def inertia_invariants(model: FiniteElementModel, basis: np.ndarray) -> InertiaInvariants:
    """Entries of one Gram matrix of scalar fields, with the consistent mass of the elements:

        G = ∫ρ f fᵀ dV = FᵀmF,     f = (1, x, Φ),   m_ab = Σ_elements ρ ∫ N_a N_b dV,   F the values of f on the nodes

    The shape functions contain 1, x and Φ, so the result agrees with the mass matrix of the model, and modal is ΦᵀMΦ. A
    point mass at c = x_i + d adds m_p f(c) f(c)ᵀ + ∇fᵀ(½ tr(J) I − J)∇f, with f(c) and ∇f of the rigid motion of its node.

    model with the densities of its mesh; basis (n_free, n), columns k [m per unit of η_k]; origin and axes of the floating
    frame are the basic ones. Clamped nodes count in m and x. Raises DeckError of `element_masses`, for a body without mass,
    and for one with a mass matrix (CONM1).
    Source: Shabana, Dynamics of Multibody Systems, ch. 5; the fields are those of thesis (1.16)."""
    mesh, n = model.mesh, basis.shape[1]
    z = model.constraint.transform @ basis
    x = mesh.position
    F = np.hstack([np.ones((len(x), 1)), x, z[: 3 * len(x)].reshape(len(x), 3 * n)])
    G = F.T @ (scalar_mass(mesh) @ F)
    for point in mesh.point_masses:
        if point.matrix is not None:
            raise DeckError(
                f"point mass {point.id} on node {mesh.node_ids[point.node]} has different masses along its axes, "
                "which is not supported in a moving body",
                remedy="Define the point mass with offset and inertia (CONM2).",
                entity=("node", int(mesh.node_ids[point.node])),
            )
        row = model.constraint.reference_rows.get(point.node)
        G += _point_mass_terms(point, F[point.node], None if row is None else z[row : row + 3])
    if not G[0, 0] > 0:
        raise DeckError(
            f"the total mass of the body is {G[0, 0]:g} kg",
            remedy="Specify the density of the materials (RHO on MAT1).",
        )
    G = 0.5 * (G + G.T)
    with_place = G[1:4, 4:].reshape(3, 3, n)
    modal2 = G[4:, 4:].reshape(3, n, 3, n)
    outer = with_place.transpose(2, 0, 1)
    return InertiaInvariants(
        mass=float(G[0, 0]),
        first=G[0, 1:4],
        first_modal=G[0, 4:].reshape(3, n),
        second=G[1:4, 1:4],
        second_modal=outer + outer.swapaxes(1, 2),
        second_modal2=modal2.transpose(1, 3, 0, 2),
        coupling=with_place,
        coupling_modal=modal2.transpose(1, 0, 2, 3),
        modal=np.einsum("akal->kl", modal2),
    )


def scalar_mass(mesh: Mesh) -> sparse.csr_array:
    """m_ab = Σ_elements ρ ∫ N_a N_b dV  (nodes, nodes) [kg]: the mass of one component, without point masses."""
    entries = []
    for part, m in element_mass_parts(mesh):
        a, b = np.triu_indices(part.nodes.shape[1])
        # half of the diagonal, because the transpose is added below
        entries.append((m * np.where(a == b, 0.5, 1.0), part.nodes[:, a], part.nodes[:, b]))
    half = from_entries(entries, (len(mesh.position),) * 2)
    return sparse.csr_array(half + half.T)


def _point_mass_terms(point: PointMass, f: np.ndarray, rotation: np.ndarray | None) -> np.ndarray:
    """m_p f(c) f(c)ᵀ + ∇fᵀ(½ tr(J) I − J)∇f, f (1 + 3 + 3n,) at the node; rotation (3, n) of the node, None without rotations."""
    if rotation is None:
        return point.mass * np.outer(f, f)
    n = rotation.shape[1]
    slope = np.zeros((3, len(f)))
    slope[:, 1:4] = np.eye(3)
    # ∂φ_k/∂x_b = ψ_k × e_b
    slope[:, 4:] = np.cross(rotation.T[None], np.eye(3)[:, None]).transpose(0, 2, 1).reshape(3, 3 * n)
    centre = f + np.asarray(point.offset, dtype=float) @ slope
    J = np.asarray(point.inertia, dtype=float)
    return point.mass * np.outer(centre, centre) + slope.T @ (0.5 * np.trace(J) * np.eye(3) - J) @ slope
