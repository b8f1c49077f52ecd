"""Motions without stiffness: found from the supports, before a factorisation breaks on them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from strainsight.errors import UserError
from strainsight.fem.constraints import Constraint, describe_row
from strainsight.fem.springs import spring_rows
from strainsight.fem.ties import references, rigid_rows
from strainsight.mesh.model import Mesh

AXES = "xyz"
TOLERANCE = 1e-9


@dataclass(frozen=True)
class FreeMotions:
    """words for people; vectors (n_free, k) [m or rad per unit], which span the motions."""

    words: tuple[str, ...]
    vectors: np.ndarray


def rigid_body_motions(mesh: Mesh, constraint: Constraint) -> tuple[str, ...]:
    """Rigid motions that the constraints allow, in words ("translation x", "rotation about z"); empty where none.

    With z = R c on the nodes of an element body (six motions c) and y the motions of reference nodes outside the
    elements, the constraint holds where T (R c, y) = R c on the clamped and dependent rows, all along the axes of the node
    they belong to, and springs are not stretched where R_s T (R c, y) = 0. The null vectors (c, y) of that system, its columns
    scaled to unit motion, are what moves freely. First the whole structure is one body; if it is held, each part that shares no
    node with the others is a body of its own.
    Raises UserError for more than 300 parts.
    """
    nodes = mesh.nodes_of_elements
    label = np.full(len(mesh.position), -1)
    label[nodes] = 0
    whole = _free_motions(mesh, constraint, label).words
    if whole:
        return whole
    parts = _parts(mesh, nodes)
    return _free_motions(mesh, constraint, parts).words if parts.max() > 0 else ()


def rigid_motions(mesh: Mesh, constraint: Constraint) -> np.ndarray:
    """R (n_free, k) [m or rad per unit]: a basis of the rigid motions of a structure in one piece that nothing holds.

    They are the null vectors that `rigid_body_motions` names, on the free motions: K R = 0 at any moduli.
    Raises UserError where the supports hold all of them, and where parts move against each other.
    """
    nodes = mesh.nodes_of_elements
    label = np.full(len(mesh.position), -1)
    label[nodes] = 0
    whole = _free_motions(mesh, constraint, label)
    if not whole.words:
        raise UserError(
            "supports or springs hold every rigid motion of the structure", key="mesh.free", remedy="remove mesh.free"
        )
    parts = _parts(mesh, nodes)
    each = _free_motions(mesh, constraint, parts) if parts.max() > 0 else whole
    if each.vectors.shape[1] > whole.vectors.shape[1]:
        more = f" and {len(each.words) - 8} more" if len(each.words) > 8 else ""
        raise UserError(
            f"the {parts.max() + 1} parts of the structure move against each other, {each.vectors.shape[1]} free motions and not "
            f"{whole.vectors.shape[1]}: {', '.join(each.words[:8])}{more}",
            key="mesh.free",
            remedy="a free structure is one piece: tie the parts (mesh.ties), or merge coincident nodes",
        )
    return whole.vectors


def require_support(mesh: Mesh, constraint: Constraint, hint: Callable[[], str] = str) -> None:
    """Raise UserError that names the free motions where there are any; hint: more of a remedy for what is free altogether."""
    motions = rigid_body_motions(mesh, constraint)
    if motions:
        more = f" and {len(motions) - 8} more" if len(motions) > 8 else ""
        free = {f"translation {axis}" for axis in AXES} <= set(motions)
        raise UserError(
            f"the structure can move freely: {', '.join(motions[:8])}{more}",
            remedy="add supports or ties that hold these motions, in the deck or under mesh.supports and mesh.ties"
            + (hint() if free else ""),
        )


def _parts(mesh: Mesh, nodes: np.ndarray) -> np.ndarray:
    """Connected part of each node, through shared nodes of elements; −1 for a node outside the elements.

    Raises UserError for more than 300 parts.
    """
    n = len(mesh.position)
    rows = np.concatenate([nodes[:, :-1].ravel() for nodes in mesh.connectivity])
    columns = np.concatenate([nodes[:, 1:].ravel() for nodes in mesh.connectivity])
    graph = sparse.csr_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(n, n))
    _, component = connected_components(graph, directed=False)
    parts = np.full(n, -1)
    parts[nodes] = np.unique(component[nodes], return_inverse=True)[1]
    count = int(parts.max()) + 1
    if count > 300:
        raise UserError(
            f"the mesh falls into {count} parts that share no node", remedy="merge coincident nodes, then try again"
        )
    return parts


def _free_motions(mesh: Mesh, constraint: Constraint, label: np.ndarray) -> FreeMotions:
    bodies = int(label.max()) + 1
    centre = np.array([mesh.position[label == b].mean(axis=0) for b in range(bodies)])
    radius = np.array([np.linalg.norm(mesh.position[label == b] - centre[b], axis=1).max() for b in range(bodies)])
    nodes = np.flatnonzero(label >= 0)
    # along the axes of each node, in which its components are held and follow
    R = constraint.along_own_axes(_motions(mesh, constraint, nodes, label, centre, radius))
    T, free = constraint.along_own_axes(constraint.transform), constraint.free_rows
    supported = np.zeros(T.shape[0], dtype=bool)
    supported[(3 * nodes[:, None] + np.arange(3)).ravel()] = True
    supported[constraint.rotations(mesh.turning)] = True
    held = supported.copy()
    held[free] = False
    held_rows = np.flatnonzero(held)
    inside = supported[free]
    Th = T[held_rows]
    loose = Th[:, np.flatnonzero(~inside)]
    stretched = _stretched(mesh, constraint)
    size = np.sqrt(np.asarray(loose.multiply(loose).sum(axis=0)).ravel())
    size[size == 0] = 1.0
    B = sparse.hstack([Th[:, np.flatnonzero(inside)] @ R[free[inside]] - R[held_rows], loose / size], format="csr")
    if stretched.shape[0]:
        outside = stretched[:, np.flatnonzero(~inside)] / size
        B = sparse.vstack(
            [B, sparse.hstack([stretched[:, np.flatnonzero(inside)] @ R[free[inside]], outside])], format="csr"
        )
    null = _that_move(_null_space(B), R)
    words: list[str] = []
    for b in range(bodies):
        words += _named(null[6 * b : 6 * b + 6], centre[b], radius[b], "" if bodies == 1 else _near(mesh, label, b))
    if null.shape[1] and not words:
        column = null[6 * bodies :]
        rows = free[~inside][np.abs(column).max(axis=1) > 0.1 * np.abs(column).max()]
        words = [describe_row(mesh, constraint, int(row)) + _of_tie(mesh, constraint, int(row)) for row in rows]
    vectors = np.empty((len(free), null.shape[1]))
    vectors[inside] = R[free[inside]] @ null[: 6 * bodies]
    vectors[~inside] = null[6 * bodies :] / size[:, None]
    return FreeMotions(tuple(words), vectors)


def _of_tie(mesh: Mesh, constraint: Constraint, row: int) -> str:
    """Which kind of tie a motion outside of the elements belongs to."""
    leads = references(mesh)
    owner = {at + k: node for node, at in constraint.reference_rows.items() for k in range(3)}
    return " of a rigid element" if owner.get(row, row // 3) in leads else " of a relation"


def _stretched(mesh: Mesh, constraint: Constraint) -> sparse.csr_array:
    """How the free motions stretch each spring (s, n_free), its largest entry one."""
    R, k = spring_rows(mesh, constraint.reference_rows)
    rows = sparse.csr_array(R[np.flatnonzero(k > 0)] @ constraint.transform)
    largest = np.asarray(abs(rows).max(axis=1).todense()).ravel() if rows.shape[0] else np.zeros(0)
    kept = np.flatnonzero(largest > 0)
    return sparse.csr_array(sparse.diags_array(1 / largest[kept]) @ rows[kept])


def _motions(
    mesh: Mesh, constraint: Constraint, nodes: np.ndarray, label: np.ndarray, centre: np.ndarray, radius: np.ndarray
) -> sparse.csr_array:
    """R (3n + 3r, 6b): six motions of each body about its centre, rotations divided by its radius, on the rows of z of its
    nodes; label (n,): the body of each node."""
    body, turning = label[nodes], mesh.turning
    blocks = rigid_rows(mesh.position[nodes] - centre[body])
    blocks[:, :, 3:] /= radius[body][:, None, None]
    rows = np.broadcast_to((3 * nodes[:, None] + np.arange(3))[:, :, None], blocks.shape)
    columns = np.broadcast_to(6 * body[:, None, None] + np.arange(6), blocks.shape)
    turned = constraint.rotations(turning).ravel()
    about = (6 * label[turning][:, None] + np.arange(3, 6)).ravel()
    values = np.concatenate([blocks.ravel(), np.repeat(1 / radius[label[turning]], 3)])
    places = np.concatenate([rows.ravel(), turned]), np.concatenate([columns.ravel(), about])
    return sparse.csr_array((values, places), shape=(constraint.transform.shape[0], 6 * len(centre)))


def _null_space(B: sparse.csr_array) -> np.ndarray:
    """Right null space (columns, k), by QR of slabs of rows and an SVD of the last factor."""
    triangle = np.zeros((0, B.shape[1]))
    for start in range(0, B.shape[0], 4096):
        triangle = np.asarray(np.linalg.qr(np.vstack([triangle, B[start : start + 4096].toarray()]), mode="r"))
    _, strength, Vt = np.linalg.svd(triangle, full_matrices=True)
    # the columns are scaled to unit motion, so that a support has strength of the order of one whatever the units
    rank = int(np.count_nonzero(strength > TOLERANCE))
    return Vt[rank:].T


def _that_move(null: np.ndarray, R: sparse.csr_array) -> np.ndarray:
    """Null vectors (columns, k) without those that move nothing, as the turn of rods in a line about it."""
    if not null.size:
        return null
    rigid = R.shape[1]
    _, strength, Vt = np.linalg.svd(np.vstack([R @ null[:rigid], null[rigid:]]), full_matrices=False)
    return np.asarray(null @ Vt[strength > TOLERANCE * max(1.0, strength.max(initial=0.0))].T)


def _named(null: np.ndarray, centre: np.ndarray, radius: float, where: str) -> list[str]:
    """The motions in span(null), null (6, k) in scaled coordinates of one body."""
    U, strength, _ = np.linalg.svd(null, full_matrices=False)
    U = U[:, strength > 1e-6]
    pure = [i for i in range(6) if np.linalg.norm(U[i]) > 1 - 1e-9]
    words = [(f"translation {AXES[i]}" if i < 3 else f"rotation about {AXES[i - 3]}") + where for i in pure]
    rest = U.copy()
    rest[pure] = 0.0
    Q, strength, _ = np.linalg.svd(rest, full_matrices=False)
    for t, w in ((q[:3], q[3:] / radius) for q in _echelon(Q[:, strength > 1e-6]).T):
        if np.linalg.norm(w) * radius < 1e-6 * np.linalg.norm(t):
            words.append(f"translation along {_triple(_upward(t))}{where}")
        else:
            point = centre + np.cross(w, t) / (w @ w)
            words.append(f"rotation about {_line(_upward(w))} through {_triple(point)} m{where}")
    return words


def _echelon(Q: np.ndarray) -> np.ndarray:
    """The basis of span(Q), Q (6, k), in which each vector alone has a one in one of k rows, rotations first: no rounding
    chooses among the bases."""
    rows: list[int] = []
    for row in (3, 4, 5, 0, 1, 2):
        if np.linalg.matrix_rank(Q[[*rows, row]], tol=1e-6) > len(rows):
            rows.append(row)
    return Q @ np.linalg.inv(Q[rows])


def _upward(v: np.ndarray) -> np.ndarray:
    """±v/|v|, its first component that is none of rounding positive."""
    v = v / np.linalg.norm(v)
    return v * np.sign(v[np.argmax(np.abs(v) > 1e-6)])


def _near(mesh: Mesh, label: np.ndarray, body: int) -> str:
    return f" of the part with node {mesh.node_ids[np.argmax(label == body)]}"


def _line(w: np.ndarray) -> str:
    along = int(np.argmax(np.abs(w)))
    return AXES[along] if abs(w[along]) > 1 - 1e-9 else _triple(w)


def _triple(v: np.ndarray) -> str:
    return "(" + ", ".join(f"{round(float(x), 6) + 0.0:.4g}" for x in v) + ")"
