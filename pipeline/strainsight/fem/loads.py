"""Loads on a model: where unit forces and moments act, and what they are on the free motions."""

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
from strainsight.ordering import first_of_largest

FLAT = 1e-9
"""A principal moment of inertia of nodes below this share of the largest: they exert no couple about that axis."""


def couple(mesh: Mesh, constraint: Constraint, nodes: np.ndarray, weight: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Forces and moments on the rows of z (3n + 3r,) that exert a moment (3,) [N m] on nodes (k,) (indices) of some weight (k,).

    On the rotations of a single node, where it has some that lead others; else as forces w (ω × r) with Jω = M, r from the
    centre of the nodes and J = Σ w (r·r I − r rᵀ), on the nodes (k > 1), or on those of the elements at a single one and of the
    ties that it leads: as an averaging element distributes a moment. A couple that the nodes cannot exert, such as that of
    nodes in a line about the line, is left out.
    """
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
    """Nodes (indices) of the elements at a node, and of the ties that it leads: where the couple of a moment on it acts."""
    found = [nodes[(nodes == node).any(axis=1)].ravel() for nodes in mesh.connectivity]
    found += [e.nodes for e in mesh.rigid if e.reference == node]
    found += [e.nodes for e in mesh.averaging if e.reference == node]
    return np.unique(np.concatenate([*found, np.zeros(0, dtype=np.int64)]))


@dataclass(frozen=True)
class PointLoad:
    """A force of unit resultant: in a direction (3,), not all zero, on a node, shared equally by the nodes of a set or spread
    evenly over a face, or as a load of the deck distributes it (without a direction of its own). Or a unit moment about an axis
    (3,), not all zero, on a node or on the nodes of a set as a `couple`. Or, on a face, a unit force by which a pin bears on it
    along a direction (3,), or a unit pressure. Or a load of the deck as it is (factor). Or 1 m/s² of gravity along a vector (3,)
    on all mass, or what a rotation of Ω² = 1 rad²/s² about an axis (3,) through a point (3,) [m] does to it.
    A set is a face where the mesh has one of that name."""

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
        """Whether it acts on all mass, and so nowhere in particular."""
        return self.gravity is not None or self.rotation is not None


def input_shape(model: FiniteElementModel, loads: Sequence[PointLoad]) -> np.ndarray:
    """S = Tᵀe (n_free, n_u) [-]: e puts a unit force on the node, or 1/k of it on each of the k nodes of a set, or stands for a
    traction on a face; a load f of the deck is e = f / |Σ f|, or f where it is taken as it is; of a moment e is the `couple` of
    1 N m, on a face a traction.

    Raises the errors of `nodal_forces` and `moment_forces`, and UserError for a node that is clamped in the direction.
    """
    mesh, T = model.mesh, model.constraint.transform
    e = np.zeros((T.shape[0], len(loads)))
    for column, load in enumerate(loads):
        if load.moment is not None:
            e[:, column] = moment_forces(model, load, np.asarray(load.moment) / np.linalg.norm(load.moment))
            continue
        own = nodal_forces(mesh, load)
        _check_acts(mesh, T, load, own)
        e[:, column] = on_rows(model, own)
        if own.moment is not None:
            _check_moments(model, load, own, e[:, column])
    return T.T @ e


def on_rows(model: FiniteElementModel, own: NodalForces) -> np.ndarray:
    """Forces and moments of a load on the rows of z (3n + 3r,): a moment at a node as the `couple` there."""
    e = np.zeros(model.constraint.transform.shape[0])
    np.add.at(e[: 3 * len(model.mesh.position)].reshape(-1, 3), own.nodes, own.force)
    if own.moment is not None:
        for i in np.flatnonzero(own.moment.any(axis=1)):
            e += couple(model.mesh, model.constraint, own.nodes[i : i + 1], np.ones(1), own.moment[i])
    return e


def moment_forces(model: FiniteElementModel, load: PointLoad, moment: np.ndarray, *, whole: bool = True) -> np.ndarray:
    """Forces and moments on the rows of z (3n + 3r,) that exert a moment (3,) [N m] where a load with a moment acts; whole: all
    of it, otherwise what its nodes can exert.

    Raises UserError for a node or set that is not there, and where the nodes cannot exert the whole: they lie on a line or at a
    point, or cannot move.
    """
    mesh, constraint = model.mesh, model.constraint
    if load.node_set in mesh.faces:
        own, e = turning(mesh, str(load.node_set), moment), np.zeros(constraint.transform.shape[0])
        e[: 3 * len(mesh.position)].reshape(-1, 3)[own.nodes] = own.force
        if whole:
            _check_acts(mesh, constraint.transform, load, own)
        return e
    nodes = np.array(loaded_nodes(mesh, load), dtype=np.int64)
    e = couple(mesh, constraint, nodes, np.ones(len(nodes)), moment)
    if not whole:
        return e
    turned = [e[row : row + 3] for row in constraint.reference_rows.values()]
    exerted = np.cross(mesh.position, e[: 3 * len(mesh.position)].reshape(-1, 3)).sum(axis=0) + sum(turned, np.zeros(3))
    missed = np.linalg.norm(exerted - moment) / np.linalg.norm(moment)
    if missed > 1e-6 or not np.any(constraint.transform.T @ e):
        where = f"node {load.node_id}" if load.node_id is not None else f"set {load.node_set!r}"
        raise UserError(
            f"load {load.name}: {where} cannot exert its moment, {100 * missed:.3g} % of it is missed",
            remedy="take the reference node of an RBE2 or RBE3, or a set of nodes that move and do not lie on a line",
        )
    return e


def nodal_forces(mesh: Mesh, load: PointLoad) -> NodalForces:
    """The forces (k, 3) [N] of a load of unit resultant, on nodes (k,) (indices).

    Raises UserError for a node, set or load that is not there, a direction of no length, a load of the deck without
    resultant, and for what presses on no face, or on none that is turned against it.
    """
    if load.gravity is not None:
        return body_forces(mesh, BodyForce(acceleration=_unit(load.name, load.gravity)))
    if load.rotation is not None:
        axis, point = load.rotation
        return body_forces(mesh, BodyForce(rotation=_unit(load.name, axis), centre=np.asarray(point, dtype=float)))
    if sum(place is not None for place in (load.node_id, load.node_set, load.deck_load)) != 1:
        raise UserError(
            f"load {load.name} needs a node or a node set, or a load of the deck", remedy="give one of them"
        )
    if load.deck_load is not None:
        return _deck_load(mesh, load)
    face = str(load.node_set) if load.node_set in mesh.faces else None
    if (load.pressure or load.bearing is not None) and face is None:
        where = f"node {load.node_id}" if load.node_id is not None else f"set {load.node_set!r}"
        raise UserError(
            f"load {load.name} presses on {where}, which has no area", remedy="give `set` the name of one of mesh.faces"
        )
    if face is not None and load.pressure:
        return pressure(mesh, face)
    if face is not None and load.bearing is not None:
        own = bearing(mesh, face, _unit(load.name, load.bearing))
        if not own.force.any():
            raise UserError(
                f"load {load.name}: no part of face {face!r} is turned against the bearing load",
                remedy="its vector points from the pin into the material: take the other sign, or another face",
            )
        return own
    direction = _unit(load.name, load.direction)
    if face is not None:
        return evenly(mesh, face, direction)
    nodes = loaded_nodes(mesh, load)
    return NodalForces(np.array(nodes, dtype=np.int64), np.tile(direction / len(nodes), (len(nodes), 1)))


def _unit(name: str, vector: tuple[float, float, float] | None) -> np.ndarray:
    direction = np.asarray(() if vector is None else vector, dtype=float)
    length = np.linalg.norm(direction)
    if direction.shape != (3,) or not (length > 0 and np.isfinite(length)):
        raise UserError(f"load {name} has the direction {vector}", remedy="give three numbers, not all zero")
    return np.asarray(direction / length)


def _check_acts(mesh: Mesh, T: sparse.csr_array, load: PointLoad, own: NodalForces) -> None:
    """Raise UserError where a force on nodes, or none of those of a deck, on mass or on a face, acts on a free motion; warn where
    some of a deck do not: at the rim of a face a support takes them."""
    loaded = np.flatnonzero(own.force.any(axis=1))
    idle = [i for i in loaded.tolist() if not np.any(T[3 * own.nodes[i] : 3 * own.nodes[i] + 3].T @ own.force[i])]
    distributed = load.deck_load is not None or load.of_mass or load.node_set in mesh.faces
    if idle and not distributed:
        raise UserError(
            f"load {load.name} acts on node {mesh.node_ids[own.nodes[idle[0]]]}, which cannot move in its direction",
            remedy="it is clamped or in no element: load another node or direction",
        )
    if len(idle) == len(loaded) and own.moment is None:
        what = load.deck_load or load.node_set or "on all mass"
        raise UserError(
            f"load {load.name} ({what}) acts on nodes which cannot move in its direction",
            remedy="they are clamped or in no element: take another load",
        )
    if idle and load.deck_load is not None and not own.regions:
        whole = np.linalg.norm(own.force.sum(axis=0)) or 1.0
        share = np.linalg.norm(own.force[idle].sum(axis=0)) / whole
        warnings.warn(
            f"load {load.name} ({load.deck_load}): {len(idle)} of its {len(loaded)} nodes cannot move in its direction "
            f"(node {mesh.node_ids[own.nodes[idle[0]]]}, …); {100 * share:.3g} % of its resultant moves nothing",
            stacklevel=2,
        )


def _check_moments(model: FiniteElementModel, load: PointLoad, own: NodalForces, e: np.ndarray) -> None:
    """Raise UserError where nothing of a load of the deck acts on a free motion; warn of moments that do not."""
    mesh, constraint = model.mesh, model.constraint
    if not np.any(constraint.transform.T @ e):
        raise UserError(
            f"load {load.name} ({load.deck_load}): its nodes cannot exert its moments", remedy="take another load"
        )
    moment = np.zeros((0, 3)) if own.moment is None else own.moment
    idle = [
        node
        for node, M in zip(own.nodes, moment, strict=True)
        if M.any() and not np.any(constraint.transform.T @ couple(mesh, constraint, node[None], np.ones(1), M))
    ]
    if idle:
        warnings.warn(
            f"load {load.name} ({load.deck_load}): the moment on node {mesh.node_ids[idle[0]]} moves nothing"
            f"{f', and so those on {len(idle) - 1} more' if len(idle) > 1 else ''}: the node has no rotations and is on no "
            "element that could turn, or is held",
            stacklevel=2,
        )


def _deck_load(mesh: Mesh, load: PointLoad) -> NodalForces:
    """f / |Σ f|, or f of a factor: a force a node, with the moments."""
    if load.deck_load is None or load.deck_load not in mesh.loads:
        known = ", ".join(sorted(mesh.loads)) or "none"
        raise UserError(
            f"load {load.name} refers to load {load.deck_load!r} of the deck, which is not there",
            remedy=f"loads of the deck: {known}",
        )
    if load.direction is not None:
        raise UserError(
            f"load {load.name} has a direction, and {load.deck_load} one of its own", remedy="leave the direction out"
        )
    forces = mesh.loads[load.deck_load]
    if forces.body:
        raise UserError(
            f"load {load.name}: {load.deck_load} acts on the mass of the deck, and where that is nothing says",
            remedy="give it as forces of the deck",
        )
    total = 1.0 if load.factor else np.linalg.norm(forces.force.sum(axis=0))
    if not total > 1e-9 * np.abs(forces.force).sum():
        raise UserError(
            f"load {load.name}: the forces of {load.deck_load} add up to nothing",
            remedy="state `factor: true`: the load is then how often it acts, and not its resultant in N",
        )
    whole = summed([forces])
    return replace(whole, force=whole.force / total, moment=None if whole.moment is None else whole.moment / total)


def loaded_nodes(mesh: Mesh, load: PointLoad) -> list[int]:
    """Indices of the node or of the nodes of the set. Raises UserError where it is not there."""
    if load.node_id is not None:
        ids = [load.node_id]
    elif load.node_set is not None and load.node_set in mesh.node_sets:
        ids = [int(i) for i in np.unique(mesh.node_sets[load.node_set])]
    else:
        known = ", ".join(sorted(mesh.node_sets)) or "none"
        raise UserError(
            f"load {load.name} refers to node set {load.node_set!r}, which is not there", remedy=f"node sets: {known}"
        )
    index = {int(node): i for i, node in enumerate(mesh.node_ids[: mesh.own_nodes])}
    missing = [node for node in ids if node not in index]
    if missing or not ids:
        raise UserError(
            f"load {load.name} refers to node {missing[0]}, which is not there"
            if missing
            else f"load {load.name} refers to an empty node set",
            remedy="node numbers are the ids of the mesh file",
        )
    return [index[node] for node in ids]


MISALIGNMENTS = 4
"""Of one load: turns about, and shifts along, two axes across its line of action."""


def axes_across(direction: np.ndarray) -> np.ndarray:
    """Unit vectors a₁, a₂ (2, 3) with a₁ × a₂ = d, the direction (3,) of unit length."""
    first = np.cross(np.eye(3)[first_of_largest(-np.abs(direction))], direction)
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(direction, first)])


def misaligned_shape(model: FiniteElementModel, load: PointLoad, turn: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """Input shape (n_free,) [-] of a load of unit resultant that is off by finite turn and shift:

        S = Tᵀ(e(R f) + c(δ × Σ R f)),     R = exp([θ₁a₁ + θ₂a₂]×),   δ = δ₁a₁ + δ₂a₂

    f the forces on its nodes, e puts forces and c a `couple` on them, in proportion to f. A moment turns, and is the same
    wherever it acts; what its nodes cannot exert of the turned one is left out. A pressure, a rotation and a load of the deck
    without resultant have no direction and no point, and what acts on mass has no point that could be another.
    turn θ (2,) [rad] about and shift δ (2,) [m] along the `axes_across`.
    """
    if load.moment is not None:
        axis = np.asarray(load.moment, dtype=float) / np.linalg.norm(load.moment)
        turned = Rotation.from_rotvec(np.asarray(turn) @ axes_across(axis)).apply(axis)
        return np.asarray(model.constraint.transform.T @ moment_forces(model, load, turned, whole=False))
    own = nodal_forces(model.mesh, load)
    if _has_none(load, own):
        return np.asarray(model.constraint.transform.T @ on_rows(model, own))
    axes = _axes_of(own.force)
    off = Rotation.from_rotvec(np.asarray(turn) @ axes)
    rotated = replace(own, force=off.apply(own.force), moment=None if own.moment is None else off.apply(own.moment))
    e = on_rows(model, rotated)
    if not own.regions:
        e += _couple(model, own, np.cross(np.asarray(shift) @ axes, rotated.force.sum(axis=0)))
    return np.asarray(model.constraint.transform.T @ e)


def misalignment_shapes(model: FiniteElementModel, loads: Sequence[PointLoad]) -> np.ndarray:
    """∂S/∂(θ₁, θ₂, δ₁, δ₂) of `misaligned_shape` at zero (n_free, n_u, MISALIGNMENTS) [1/rad, 1/m]:

    Tᵀ e(a × f) of a turn about a, Tᵀ c(a × Σ f) of a shift along a; of a moment Tᵀ c(a × M), and nothing
    of a shift; nothing of a pressure, a rotation and a load of the deck without resultant; no shift of what acts on mass.
    """
    columns = []
    for load in loads:
        if load.moment is not None:
            axis = np.asarray(load.moment, dtype=float) / np.linalg.norm(load.moment)
            turned = [np.cross(across, axis) for across in axes_across(axis)]
            columns += [moment_forces(model, load, moment, whole=False) for moment in turned]
            columns += [np.zeros(model.constraint.transform.shape[0])] * 2
            continue
        own = nodal_forces(model.mesh, load)
        if _has_none(load, own):
            columns += [np.zeros(model.constraint.transform.shape[0])] * MISALIGNMENTS
            continue
        axes, whole = _axes_of(own.force), own.force.sum(axis=0)
        for axis in axes:
            across = None if own.moment is None else np.cross(axis, own.moment)
            columns.append(on_rows(model, replace(own, force=np.cross(axis, own.force), moment=across)))
        columns += [_couple(model, own, np.cross(axis, whole) * (not own.regions)) for axis in axes]
    shapes = np.asarray(model.constraint.transform.T @ np.column_stack(columns))
    return shapes.reshape(model.size, len(loads), MISALIGNMENTS)


def _has_none(load: PointLoad, own: NodalForces) -> bool:
    """Whether a load has neither a direction nor a point."""
    balanced = np.linalg.norm(own.force.sum(axis=0)) <= 1e-9 * np.abs(own.force).sum()
    return load.pressure or load.rotation is not None or bool(balanced)


def _axes_of(force: np.ndarray) -> np.ndarray:
    whole = force.sum(axis=0)
    return axes_across(whole / np.linalg.norm(whole))


def _couple(model: FiniteElementModel, own: NodalForces, moment: np.ndarray) -> np.ndarray:
    return couple(model.mesh, model.constraint, own.nodes, np.linalg.norm(own.force, axis=1), moment)
