"""Loads on a model: unit forces and moments, and their input shapes on the free motions."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.spatial.transform import Rotation

from strainsight.errors import UserError
from strainsight.fem.constraints import Constraint
from strainsight.fem.model import FiniteElementModel
from strainsight.fem.nodal_forces import bearing, body_forces, evenly, pressure, summed, turning
from strainsight.mesh.joins import BodyForce, NodalForces
from strainsight.mesh.model import Mesh
from strainsight.ordering import index_of_largest

FLAT = 1e-9
"""Smallest principal moment of inertia of nodes, as a share of the largest, for a couple about that axis."""


def couple(mesh: Mesh, constraint: Constraint, nodes: np.ndarray, weight: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Forces and moments on the rows of z (3n + 3r,) that exert a moment (3,) [N m] on nodes (k,) (indices) with weights (k,).

    For a single node with rotations that lead others, the moment acts on these rotations. Otherwise it acts as forces
    w (ω × r) with Jω = M, r from the centre of the nodes and J = Σ w (r·r I − r rᵀ), like a moment on an averaging element:
    on the nodes (k > 1), or on those of the elements and ties at a single node. A component that the nodes cannot exert, such
    as a moment about the line of collinear nodes, is left out."""
    T, x = constraint.transform, mesh.position
    e = np.zeros(T.shape[0])
    if len(nodes) == 1:
        row = constraint.reference_rows.get(int(nodes[0]))
        if row is not None and T[row : row + 3].nnz:
            e[row : row + 3] = moment
            return e
        nodes = nodes_at(mesh, int(nodes[0]))
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


def nodes_at(mesh: Mesh, node: int) -> np.ndarray:
    """Nodes (indices) of the elements at a node, and of the ties that it leads: where a moment on it acts as a couple."""
    groups = [nodes[(nodes == node).any(axis=1)].ravel() for nodes in mesh.connectivity]
    groups += [e.nodes for e in mesh.rigid if e.reference == node]
    groups += [e.nodes for e in mesh.averaging if e.reference == node]
    return np.unique(np.concatenate([*groups, np.zeros(0, dtype=np.int64)]))


@dataclass(frozen=True)
class PointLoad:
    """A load of unit resultant on nodes, a face, all mass, or as a load of the deck distributes it.

    direction (3,), not all zero: force on a node, shared equally by the nodes of a set, or spread evenly over a face. moment
    (3,): unit moment about this axis, on a node or, as a `couple`, on the nodes of a set. bearing (3,): unit force of a pin on
    a face along this direction. pressure: unit pressure on a face. deck_load: a load of the deck, with factor unscaled.
    gravity (3,): 1 m/s² along this direction on all mass. rotation: centrifugal load of Ω² = 1 rad²/s² about an axis (3,)
    through a point (3,) [m]. A set is a face if the mesh has a face of that name."""

    name: str
    direction: tuple[float, float, float] | None = None
    node_id: int | None = None
    node_set: str | None = None
    deck_load: str | None = None
    moment: tuple[float, float, float] | None = None
    bearing: tuple[float, float, float] | None = None
    pressure: bool = False
    factor: bool = False
    gravity: tuple[float, float, float] | None = None
    rotation: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None

    @property
    def of_mass(self) -> bool:
        """Whether it acts on all mass."""
        return self.gravity is not None or self.rotation is not None


def input_shape(model: FiniteElementModel, loads: Sequence[PointLoad]) -> np.ndarray:
    """S = Tᵀe (n_free, n_u) [-] of unit loads e.

    e is a unit force on the node, or 1/k of it on each of the k nodes of a set, or a traction on a face. A load f of the deck
    is e = f / |Σ f|, or f with `factor`. A moment is the `couple` of 1 N m, on a face a traction.
    Raises the errors of `nodal_forces` and `moment_forces`, and UserError for a node that is clamped in the direction."""
    mesh, T = model.mesh, model.constraint.transform
    e = np.zeros((T.shape[0], len(loads)))
    for column, load in enumerate(loads):
        if load.moment is not None:
            e[:, column] = moment_forces(model, load, np.asarray(load.moment) / np.linalg.norm(load.moment))
            continue
        forces = nodal_forces(mesh, load)
        _check_acts(mesh, T, load, forces)
        e[:, column] = on_rows(model, forces)
        if forces.moment is not None:
            _check_moments(model, load, forces, e[:, column])
    return T.T @ e


def on_rows(model: FiniteElementModel, forces: NodalForces) -> np.ndarray:
    """Forces and moments of a load on the rows of z (3n + 3r,): a moment at a node as the `couple` there."""
    e = np.zeros(model.constraint.transform.shape[0])
    np.add.at(e[: 3 * len(model.mesh.position)].reshape(-1, 3), forces.nodes, forces.force)
    if forces.moment is not None:
        for i in np.flatnonzero(forces.moment.any(axis=1)):
            e += couple(model.mesh, model.constraint, forces.nodes[i : i + 1], np.ones(1), forces.moment[i])
    return e


def moment_forces(model: FiniteElementModel, load: PointLoad, moment: np.ndarray, *, whole: bool = True) -> np.ndarray:
    """Forces and moments on the rows of z (3n + 3r,) that exert a moment (3,) [N m] where a load with a moment acts.

    whole: require the full moment; otherwise the part that its nodes can exert.
    Raises UserError for a node or set that does not exist, and if the nodes cannot exert the full moment: they lie on a line or
    at a point, or cannot move."""
    mesh, constraint = model.mesh, model.constraint
    if load.node_set in mesh.faces:
        forces, e = turning(mesh, str(load.node_set), moment), np.zeros(constraint.transform.shape[0])
        e[: 3 * len(mesh.position)].reshape(-1, 3)[forces.nodes] = forces.force
        if whole:
            _check_acts(mesh, constraint.transform, load, forces)
        return e
    nodes = np.array(loaded_nodes(mesh, load), dtype=np.int64)
    e = couple(mesh, constraint, nodes, np.ones(len(nodes)), moment)
    if not whole:
        return e
    exerted = np.cross(mesh.position, e[: 3 * len(mesh.position)].reshape(-1, 3)).sum(axis=0) + sum(
        [e[row : row + 3] for row in constraint.reference_rows.values()], np.zeros(3)
    )
    shortfall = np.linalg.norm(exerted - moment) / np.linalg.norm(moment)
    if shortfall > 1e-6 or not np.any(constraint.transform.T @ e):
        where = f"node {load.node_id}" if load.node_id is not None else f"node set {load.node_set!r}"
        raise UserError(
            f"load {load.name}: {100 * shortfall:.3g} % of the moment cannot be applied to {where}",
            remedy="Apply the moment to the reference node of an RBE2 or RBE3, or to a node set with free nodes not on one line.",
        )
    return e


def nodal_forces(mesh: Mesh, load: PointLoad) -> NodalForces:
    """The forces (k, 3) [N] of a load of unit resultant, on nodes (k,) (indices).

    Raises UserError for a node, set or load that does not exist, a direction of zero length, a load of the deck without
    resultant, a pressure or bearing load without a face, and a bearing load that no part of its face is turned against."""
    if load.gravity is not None:
        return body_forces(mesh, BodyForce(acceleration=_unit(load.name, load.gravity)))
    if load.rotation is not None:
        axis, point = load.rotation
        return body_forces(mesh, BodyForce(rotation=_unit(load.name, axis), centre=np.asarray(point, dtype=float)))
    if sum(place is not None for place in (load.node_id, load.node_set, load.deck_load)) != 1:
        raise UserError(
            f"load {load.name} must act on a node or on a node set, or be a load of the deck",
            remedy="Specify exactly one of `node`, `set` and `deck_load` in the load.",
        )
    if load.deck_load is not None:
        return _deck_load(mesh, load)
    face = str(load.node_set) if load.node_set in mesh.faces else None
    if (load.pressure or load.bearing is not None) and face is None:
        where = f"node {load.node_id}" if load.node_id is not None else f"node set {load.node_set!r}"
        raise UserError(
            f"load {load.name} is a pressure or bearing load on {where}, which has no area",
            remedy="Set `set` to the name of a face in mesh.faces.",
        )
    if face is not None and load.pressure:
        return pressure(mesh, face)
    if face is not None and load.bearing is not None:
        forces = bearing(mesh, face, _unit(load.name, load.bearing))
        if not forces.force.any():
            raise UserError(
                f"load {load.name}: the bearing vector points out of the material everywhere on face {face!r}",
                remedy="Reverse the bearing vector (it must point from the pin into the material), or use another face.",
            )
        return forces
    direction = _unit(load.name, load.direction)
    if face is not None:
        return evenly(mesh, face, direction)
    nodes = loaded_nodes(mesh, load)
    return NodalForces(np.array(nodes, dtype=np.int64), np.tile(direction / len(nodes), (len(nodes), 1)))


def _unit(name: str, vector: tuple[float, float, float] | None) -> np.ndarray:
    direction = np.asarray(() if vector is None else vector, dtype=float)
    length = np.linalg.norm(direction)
    if direction.shape != (3,) or not (length > 0 and np.isfinite(length)):
        raise UserError(
            f"`direction` or `axis` of load {name} is {vector or 'missing'}",
            remedy="Specify a vector of three numbers, not all zero.",
        )
    return np.asarray(direction / length)


def _check_acts(mesh: Mesh, T: sparse.csr_array, load: PointLoad, forces: NodalForces) -> None:
    """Raise UserError if a force on nodes, or no force of a deck load, mass or face load, acts on a free motion; warn if some
    forces of a deck load do not (at the rim of a face, supports react them)."""
    loaded = np.flatnonzero(forces.force.any(axis=1))
    fixed = [
        i for i in loaded.tolist() if not np.any(T[3 * forces.nodes[i] : 3 * forces.nodes[i] + 3].T @ forces.force[i])
    ]
    distributed = load.deck_load is not None or load.of_mass or load.node_set in mesh.faces
    if fixed and not distributed:
        raise UserError(
            f"load {load.name} acts on node {mesh.node_ids[forces.nodes[fixed[0]]]}, which cannot move in the direction of "
            "the load",
            remedy="Use another node or direction for the load: this node is clamped or belongs to no element.",
        )
    if len(fixed) == len(loaded) and forces.moment is None:
        what = load.deck_load or load.node_set or "gravity or rotation load"
        raise UserError(
            f"load {load.name} ({what}) acts only on nodes that cannot move in the direction of the load",
            remedy="Apply the load to other nodes: these nodes are clamped or belong to no element.",
        )
    if fixed and load.deck_load is not None and not forces.regions:
        resultant = np.linalg.norm(forces.force.sum(axis=0)) or 1.0
        share = np.linalg.norm(forces.force[fixed].sum(axis=0)) / resultant
        warnings.warn(
            f"load {load.name} ({load.deck_load}): {100 * share:.3g} % of the resultant has no effect, because {len(fixed)} of "
            f"{len(loaded)} loaded nodes (e.g. node {mesh.node_ids[forces.nodes[fixed[0]]]}) cannot move in the load direction",
            stacklevel=2,
        )


def _check_moments(model: FiniteElementModel, load: PointLoad, forces: NodalForces, e: np.ndarray) -> None:
    """Raise UserError if no part of a load of the deck acts on a free motion; warn of moments without effect."""
    mesh, constraint = model.mesh, model.constraint
    if not np.any(constraint.transform.T @ e):
        raise UserError(
            f"load {load.name} ({load.deck_load}): its moments act only on nodes without rotations or with clamped rotations",
            remedy="Make the loaded node the reference node of an RBE2 or RBE3, or use another load.",
        )
    moment = np.zeros((0, 3)) if forces.moment is None else forces.moment
    without_effect = [
        node
        for node, M in zip(forces.nodes, moment, strict=True)
        if M.any() and not np.any(constraint.transform.T @ couple(mesh, constraint, node[None], np.ones(1), M))
    ]
    if without_effect:
        warnings.warn(
            f"load {load.name} ({load.deck_load}): the moment on node {mesh.node_ids[without_effect[0]]}"
            f"{f' (one of {len(without_effect)} such nodes)' if len(without_effect) > 1 else ''} has no effect: the node has no "
            "rotations, or is clamped",
            stacklevel=2,
        )


def _deck_load(mesh: Mesh, load: PointLoad) -> NodalForces:
    """f / |Σ f|, or f with `factor`: one force per node, with the moments."""
    if load.deck_load is None or load.deck_load not in mesh.loads:
        known = ", ".join(sorted(mesh.loads))
        raise UserError(
            f"load {load.name} refers to load {load.deck_load!r} of the deck, which does not exist",
            remedy=f"Set `deck_load` to one of the loads of the deck: {known}."
            if known
            else "The deck has no loads. Specify `node` or `set` instead of `deck_load`.",
        )
    if load.direction is not None:
        raise UserError(
            f"load {load.name} has a direction, but the deck load {load.deck_load} already defines the direction",
            remedy="Remove `direction` from the load.",
        )
    forces = mesh.loads[load.deck_load]
    if forces.body:
        raise UserError(
            f"load {load.name}: {load.deck_load} is a body force (gravity or rotation), but the mass of the mesh is unknown",
            remedy="Replace the body force by nodal forces in the deck.",
        )
    total = 1.0 if load.factor else np.linalg.norm(forces.force.sum(axis=0))
    if not total > 1e-9 * np.abs(forces.force).sum():
        raise UserError(
            f"load {load.name}: the resultant of the forces of {load.deck_load} is zero",
            remedy="Set `factor: true`, so that the load is a multiple of the deck load instead of a resultant in N.",
        )
    combined = summed([forces])
    return replace(
        combined, force=combined.force / total, moment=None if combined.moment is None else combined.moment / total
    )


def loaded_nodes(mesh: Mesh, load: PointLoad) -> list[int]:
    """Indices of the node, or of the nodes of the set. Raises UserError if it does not exist."""
    if load.node_id is not None:
        ids = [load.node_id]
    elif load.node_set is not None and load.node_set in mesh.node_sets:
        ids = [int(i) for i in np.unique(mesh.node_sets[load.node_set])]
    else:
        known = ", ".join(sorted(mesh.node_sets))
        raise UserError(
            f"load {load.name} refers to node set {load.node_set!r}, which does not exist",
            remedy=f"Set `set` to one of the node sets: {known}."
            if known
            else "The mesh has no node sets. Specify `node`, or define a face in mesh.faces.",
        )
    index = {int(node): i for i, node in enumerate(mesh.node_ids[: mesh.own_nodes])}
    missing = [node for node in ids if node not in index]
    if missing or not ids:
        raise UserError(
            f"load {load.name} refers to node {missing[0]}, which does not exist"
            if missing
            else f"load {load.name} refers to node set {load.node_set!r}, which is empty",
            remedy="Use a node id of the mesh file." if missing else "Use a node set that contains nodes.",
        )
    return [index[node] for node in ids]


MISALIGNMENTS = 4
"""Misalignments of a load: two rotations about, and two shifts along, axes across its line of action."""


def axes_across(direction: np.ndarray) -> np.ndarray:
    """Unit vectors a₁, a₂ (2, 3) with a₁ × a₂ = d, the direction (3,) of unit length."""
    first = np.cross(np.eye(3)[index_of_largest(-np.abs(direction))], direction)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(direction, first)])


def misaligned_shape(model: FiniteElementModel, load: PointLoad, turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Input shape (n_free,) [-] of a load of unit resultant that is misaligned by finite rotations and shifts:

        S = Tᵀ(e(R f) + c(δ × Σ R f)),     R = exp([θ₁a₁ + θ₂a₂]×),   δ = δ₁a₁ + δ₂a₂

    f the forces on its nodes, e puts forces and c a `couple` on them, in proportion to f. A moment rotates; its point has no
    effect, and the part that its nodes cannot exert is left out. A pressure, a rotation and a load of the deck without
    resultant have neither direction nor point; a load on all mass has no point.
    turn θ (2,) [rad] about and shift δ (2,) [m] along the `axes_across`."""
    if load.moment is not None:
        axis = np.asarray(load.moment, dtype=float) / np.linalg.norm(load.moment)
        rotated_moment = Rotation.from_rotvec(np.asarray(turn) @ axes_across(axis)).apply(axis)
        return np.asarray(model.constraint.transform.T @ moment_forces(model, load, rotated_moment, whole=False))
    forces = nodal_forces(model.mesh, load)
    if _has_no_direction(load, forces):
        return np.asarray(model.constraint.transform.T @ on_rows(model, forces))
    axes = _axes_of(forces.force)
    rotation = Rotation.from_rotvec(np.asarray(turn) @ axes)
    rotated = replace(
        forces,
        force=rotation.apply(forces.force),
        moment=None if forces.moment is None else rotation.apply(forces.moment),
    )
    e = on_rows(model, rotated)
    if not forces.regions:
        e += _couple(model, forces, np.cross(np.asarray(shift) @ axes, rotated.force.sum(axis=0)))
    return np.asarray(model.constraint.transform.T @ e)


def misalignment_shapes(model: FiniteElementModel, loads: Sequence[PointLoad]) -> np.ndarray:
    """∂S/∂(θ₁, θ₂, δ₁, δ₂) of `misaligned_shape` at zero (n_free, n_u, MISALIGNMENTS) [1/rad, 1/m]:

    Tᵀ e(a × f) for a rotation about a, Tᵀ c(a × Σ f) for a shift along a; for a moment Tᵀ c(a × M), and zero for a shift.
    Zero for a pressure, a rotation and a load of the deck without resultant; no shift of a load on all mass."""
    columns = []
    for load in loads:
        if load.moment is not None:
            axis = np.asarray(load.moment, dtype=float) / np.linalg.norm(load.moment)
            moments = [np.cross(across, axis) for across in axes_across(axis)]
            columns += [moment_forces(model, load, moment, whole=False) for moment in moments]
            columns += [np.zeros(model.constraint.transform.shape[0])] * 2
            continue
        forces = nodal_forces(model.mesh, load)
        if _has_no_direction(load, forces):
            columns += [np.zeros(model.constraint.transform.shape[0])] * MISALIGNMENTS
            continue
        axes, resultant = _axes_of(forces.force), forces.force.sum(axis=0)
        for axis in axes:
            across = None if forces.moment is None else np.cross(axis, forces.moment)
            columns.append(on_rows(model, replace(forces, force=np.cross(axis, forces.force), moment=across)))
        columns += [_couple(model, forces, np.cross(axis, resultant) * (not forces.regions)) for axis in axes]
    shapes = np.asarray(model.constraint.transform.T @ np.column_stack(columns))
    return shapes.reshape(model.size, len(loads), MISALIGNMENTS)


def _has_no_direction(load: PointLoad, forces: NodalForces) -> bool:
    """Whether a load has neither a direction nor a point."""
    balanced = np.linalg.norm(forces.force.sum(axis=0)) <= 1e-9 * np.abs(forces.force).sum()
    return load.pressure or load.rotation is not None or bool(balanced)


def _axes_of(force: np.ndarray) -> np.ndarray:
    resultant = force.sum(axis=0)
    return axes_across(resultant / np.linalg.norm(resultant))


def _couple(model: FiniteElementModel, forces: NodalForces, moment: np.ndarray) -> np.ndarray:
    return couple(model.mesh, model.constraint, forces.nodes, np.linalg.norm(forces.force, axis=1), moment)
