"""Loads whose direction and point of action are not those that were meant."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from strainsight.fem.model import FiniteElementModel, PointLoad, nodal_forces
from strainsight.mesh.model import Mesh
from strainsight.ordering import first_of_largest

MISALIGNMENTS = 4
"""Of one load: turns about, and shifts along, two axes across its line of action."""
FLAT = 1e-9
"""A principal moment of inertia of nodes below this share of the largest: they exert no couple about that axis."""


def axes_across(direction: np.ndarray) -> np.ndarray:
    """Unit vectors a₁, a₂ (2, 3) with a₁ × a₂ = d, the direction (3,) of unit length."""
    first = np.cross(np.eye(3)[first_of_largest(-np.abs(direction))], direction)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(direction, first)])


def misaligned_shape(model: FiniteElementModel, load: PointLoad, turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Input shape (n_free,) [-] of a load of unit resultant that is off by finite turn and shift:

        S = Tᵀ(e(R f) + c(δ × Σ R f)),     R = exp([θ₁a₁ + θ₂a₂]×),   δ = δ₁a₁ + δ₂a₂

    f the forces on its nodes, e puts forces and c a couple on them: on the rotations of the node of a single one, where it
    has some that lead others; else as forces w (ω × r) on the nodes of the load (k > 1), of the elements at the node, or of
    the ties that it leads, r from their centre: as an averaging element distributes a moment.
    turn θ (2,) [rad] about and shift δ (2,) [m] along the `axes_across`. A couple that the nodes cannot exert, such as that of
    nodes in a line about the line, is left out.
    """
    own = nodal_forces(model.mesh, load)
    axes = _axes_of(own.force)
    force = Rotation.from_rotvec(np.asarray(turn) @ axes).apply(own.force)
    e = _couple(model, own.nodes, own.force, np.cross(np.asarray(shift) @ axes, force.sum(axis=0)))
    np.add.at(e[: 3 * len(model.mesh.position)].reshape(-1, 3), own.nodes, force)
    return np.asarray(model.constraint.transform.T @ e)


def misalignment_shapes(model: FiniteElementModel, loads: Sequence[PointLoad]) -> np.ndarray:
    """∂S/∂(θ₁, θ₂, δ₁, δ₂) of `misaligned_shape` at zero (n_free, n_u, MISALIGNMENTS) [1/rad, 1/m]:

    Tᵀ e(a × f) of a turn about a, Tᵀ c(a × Σ f) of a shift along a.
    """
    columns = []
    for load in loads:
        own = nodal_forces(model.mesh, load)
        axes, whole = _axes_of(own.force), own.force.sum(axis=0)
        for axis in axes:
            e = np.zeros(model.constraint.transform.shape[0])
            np.add.at(e[: 3 * len(model.mesh.position)].reshape(-1, 3), own.nodes, np.cross(axis, own.force))
            columns.append(e)
        columns += [_couple(model, own.nodes, own.force, np.cross(axis, whole)) for axis in axes]
    shapes = np.asarray(model.constraint.transform.T @ np.column_stack(columns))
    return shapes.reshape(model.size, len(loads), MISALIGNMENTS)


def _axes_of(force: np.ndarray) -> np.ndarray:
    whole = force.sum(axis=0)
    return axes_across(whole / np.linalg.norm(whole))


def _couple(model: FiniteElementModel, nodes: np.ndarray, force: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Forces and moments on the rows of z (3n + 3r,) that exert a moment (3,) on nodes (k,) loaded with force (k, 3)."""
    T, x = model.constraint.transform, model.mesh.position
    e, weight = np.zeros(T.shape[0]), np.linalg.norm(force, axis=1)
    if len(nodes) == 1:
        row = model.constraint.reference_rows.get(int(nodes[0]))
        if row is not None and T[row : row + 3].nnz:
            e[row : row + 3] = moment
            return e
        nodes = _nodes_at(model.mesh, int(nodes[0]))
        weight = np.ones(len(nodes))
    moves = np.diff(T.indptr[: 3 * len(x) + 1]).reshape(-1, 3)[nodes].sum(axis=1) > 0
    nodes, weight = nodes[moves], weight[moves]
    if len(nodes) < 2:
        return e
    r = x[nodes] - np.average(x[nodes], axis=0, weights=weight)
    J = np.einsum(
        "k,kij->ij", weight, np.einsum("k,ij->kij", np.sum(r**2, axis=1), np.eye(3)) - r[:, :, None] * r[:, None]
    )
    omega = np.linalg.pinv(J, rcond=FLAT, hermitian=True) @ moment
    np.add.at(e[: 3 * len(x)].reshape(-1, 3), nodes, weight[:, None] * np.cross(omega, r))
    return e


def _nodes_at(mesh: Mesh, node: int) -> np.ndarray:
    """Nodes of the elements at a node, and of the ties that it leads."""
    found = [block.nodes[(block.nodes == node).any(axis=1)].ravel() for block in mesh.blocks]
    found += [e.nodes for e in mesh.rigid if e.reference == node]
    found += [e.nodes for e in mesh.averaging if e.reference == node]
    return np.unique(np.concatenate([*found, np.zeros(0, dtype=np.int64)]))
