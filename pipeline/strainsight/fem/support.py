"""Detection of motions without stiffness (rigid-body motions and mechanisms) from the supports, before the factorisation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from strainsight.errors import UserError
from strainsight.fem.affine import from_entries
from strainsight.fem.constraints import Constraint, describe_row
from strainsight.fem.equations import references, rigid_rows, translation_rows
from strainsight.fem.springs import spring_rows
from strainsight.fem.stiff_pieces import Pieces, parts, single_piece, stiff_pieces
from strainsight.mesh.model import FloatArray, IntArray, Mesh

AXES = "xyz"


def motion_words(null: np.ndarray, centre: np.ndarray, radius: float, where: str = "") -> list[str]:
    """The motions in span(null), each followed by `where`: "rotation about z through (0, 0, 0.5) m".

    null (6, k): translations and rotations times the radius [m] of a body about its centre (3,) [m]."""
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
    """The basis of span(Q), Q (6, k), in which each vector has the only one in one of k rows, rotations first, so that rounding
    does not choose the basis."""
    rows: list[int] = []
    for row in (3, 4, 5, 0, 1, 2):
        if np.linalg.matrix_rank(Q[[*rows, row]], tol=1e-6) > len(rows):
            rows.append(row)
    return Q @ np.linalg.inv(Q[rows])


def _upward(v: np.ndarray) -> np.ndarray:
    """±v/|v|, with a positive first component (apart from rounding)."""
    v = v / np.linalg.norm(v)
    return v * np.sign(v[np.argmax(np.abs(v) > 1e-6)])


def _line(w: np.ndarray) -> str:
    along = int(np.argmax(np.abs(w)))
    return AXES[along] if abs(w[along]) > 1 - 1e-9 else _triple(w)


def _triple(v: np.ndarray) -> str:
    return "(" + ", ".join(f"{round(float(x), 6) + 0.0:.4g}" for x in v) + ")"


TOLERANCE = 1e-9
MOST = 300
"""Largest number of bodies whose motions are analysed separately."""


@dataclass(frozen=True)
class FreeMotions:
    """words: description in messages; vectors (n_free, k) [m or rad per unit], which span the motions."""

    words: tuple[str, ...]
    vectors: np.ndarray


def rigid_body_motions(mesh: Mesh, constraint: Constraint) -> tuple[str, ...]:
    """Rigid motions that the constraints allow, in words ("translation x", "rotation about z"); possibly empty.

    With z = R c on the nodes of an element body (six motions c) and y the motions of reference nodes outside the
    elements, the constraint is met if T (R c, y) = R c on the clamped and dependent rows, all in the local axes of their
    nodes. Springs are not stretched if R_s T (R c, y) = 0; bodies that share a node move it equally. The null vectors (c, y) of
    that system, its columns scaled to unit motion, are the free motions. First the whole structure is one body; if it is
    supported, each stiff piece is a separate body.
    Raises UserError for more than 300 parts that share no node."""
    return _describe_motions(mesh, constraint)[0]


def _describe_motions(mesh: Mesh, constraint: Constraint) -> tuple[tuple[str, ...], bool]:
    """Those of `rigid_body_motions`, and whether they are motions of pieces that share nodes."""
    words = _free_motions(mesh, constraint, single_piece(mesh)).words
    if words:
        return words, False
    bodies = _bodies(mesh)
    words = _free_motions(mesh, constraint, bodies).words if bodies.count > 1 else ()
    return words, bool(bodies.meeting[0].size)


def rigid_motions(mesh: Mesh, constraint: Constraint) -> np.ndarray:
    """R (n_free, k) [m or rad per unit]: a basis of the rigid-body motions of an unsupported structure in one piece.

    They are the null vectors of `rigid_body_motions`, on the free motions: K R = 0 at any moduli.
    Raises UserError if supports prevent all of them, and if parts move relative to each other."""
    together = _free_motions(mesh, constraint, single_piece(mesh))
    if not together.words:
        raise UserError(
            "supports or springs prevent every rigid-body motion of the structure",
            key="mesh.free",
            remedy="Remove mesh.free.",
        )
    bodies = _bodies(mesh)
    separate = _free_motions(mesh, constraint, bodies, against_first=True) if bodies.count > 1 else together
    if separate.vectors.shape[1] > together.vectors.shape[1]:
        first = _node_of(mesh, bodies, 0)
        raise UserError(
            f"the {bodies.count} parts of the structure move relative to each other: {separate.vectors.shape[1]} rigid-body "
            f"motions instead of {together.vectors.shape[1]} of a single part. Motions relative to the part with node {first}: "
            f"{_listed(separate.words)}",
            key="mesh.free",
            remedy="Tie the parts (mesh.ties) or merge coincident nodes (mesh.merge): a free structure must be one piece.",
        )
    return together.vectors


def require_support(mesh: Mesh, constraint: Constraint, hint: Callable[[], str] = str) -> None:
    """Raise UserError that names the free motions, if any; hint: further remedy for a structure without supports."""
    motions, hinged = _describe_motions(mesh, constraint)
    if motions:
        free = {f"translation {axis}" for axis in AXES} <= set(motions)
        raise UserError(
            f"the structure can move freely: {_listed(motions)}",
            remedy="Add supports or ties that prevent these motions, in the deck or under mesh.supports and mesh.ties."
            + (" Parts that share only nodes on one line are hinged: tie their rotations (RBE3)." if hinged else "")
            + (hint() if free else ""),
        )


def _listed(words: tuple[str, ...]) -> str:
    return ", ".join(words[:8]) + (f" and {len(words) - 8} more" if len(words) > 8 else "")


def _bodies(mesh: Mesh) -> Pieces:
    """Stiff pieces, or if there are more than MOST, the parts that share no node. Raises UserError for more than MOST parts."""
    pieces = stiff_pieces(mesh)
    if pieces.count > MOST:
        pieces = parts(mesh)
    if pieces.count > MOST:
        raise UserError(
            f"the mesh consists of {pieces.count} parts that share no node (limit {MOST})",
            remedy="Merge coincident nodes (mesh.merge).",
        )
    return pieces


def _free_motions(mesh: Mesh, constraint: Constraint, pieces: Pieces, against_first: bool = False) -> FreeMotions:
    """against_first: describe the motions relative to the first piece."""
    label, bodies = pieces.label, pieces.count
    body_nodes = [mesh.position[pieces.node[pieces.piece == b]] for b in range(bodies)]
    centre = np.array([x.mean(axis=0) for x in body_nodes])
    radius = np.array([np.linalg.norm(x - x.mean(axis=0), axis=1).max() for x in body_nodes])
    nodes = np.flatnonzero(label >= 0)
    # in the local axes of each node, which supports and ties refer to
    R = constraint.along_local_axes(_motions(mesh, constraint, nodes, label, centre, radius))
    T, free = constraint.along_local_axes(constraint.transform), constraint.free_rows
    supported = np.zeros(T.shape[0], dtype=bool)
    supported[translation_rows(nodes)] = True
    supported[constraint.rotations(mesh.turning)] = True
    constrained = supported.copy()
    constrained[free] = False
    constrained_rows = np.flatnonzero(constrained)
    inside = supported[free]
    Th = T[constrained_rows]
    loose = Th[:, np.flatnonzero(~inside)]
    stretched = _spring_elongations(mesh, constraint)
    parted = _relative_motions(mesh, pieces, centre, radius)
    size = np.sqrt(np.asarray(loose.multiply(loose).sum(axis=0)).ravel())
    size[size == 0] = 1.0
    within, moved = np.flatnonzero(inside), R[free[inside]]
    rows = [
        (Th[:, within] @ moved - R[constrained_rows], loose / size),
        (stretched[:, within] @ moved, stretched[:, np.flatnonzero(~inside)] / size),
        (parted, sparse.csr_array((parted.shape[0], loose.shape[1]))),
    ]
    B = sparse.vstack([sparse.hstack(row) for row in rows], format="csr")
    null = _without_zero_motions(_null_space(B), R)
    words: list[str] = []
    named = null @ _null_space(sparse.csr_array(null[:6])) if against_first else null
    for b in range(bodies):
        where = f" of the part with node {_node_of(mesh, pieces, b)}" if bodies > 1 else ""
        words += motion_words(named[6 * b : 6 * b + 6], centre[b], radius[b], where)
    column = null[6 * bodies :]
    if column.size and not words:
        loosest = free[~inside][np.abs(column).max(axis=1) > 0.1 * np.abs(column).max()]
        words = [
            f"{describe_row(mesh, constraint, row)} of {_kind_of_tie(mesh, constraint, row)}"
            for row in loosest.tolist()
        ]
    vectors = np.empty((len(free), null.shape[1]))
    vectors[inside] = moved @ null[: 6 * bodies]
    vectors[~inside] = null[6 * bodies :] / size[:, None]
    return FreeMotions(tuple(words), vectors)


def _kind_of_tie(mesh: Mesh, constraint: Constraint, row: int) -> str:
    """Kind of the tie that a motion outside of the elements belongs to."""
    leads = references(mesh)
    owner = {at + k: node for node, at in constraint.reference_rows.items() for k in range(3)}
    node = owner.get(row, row // 3)
    if node in {*mesh.turned_by_springs.tolist()} - leads:
        return "a spring"
    return "a rigid element" if node in leads else "a constraint equation (MPC)"


def _spring_elongations(mesh: Mesh, constraint: Constraint) -> sparse.csr_array:
    """Elongation of each spring by the free motions (s, n_free), its largest entry one."""
    R, k = spring_rows(mesh, constraint.reference_rows)
    rows = sparse.csr_array(R[np.flatnonzero(k > 0)] @ constraint.transform)
    largest = np.asarray(abs(rows).max(axis=1).todense()).ravel() if min(rows.shape) else np.zeros(rows.shape[0])
    nonzero = np.flatnonzero(largest > 0)
    return sparse.csr_array(sparse.diags_array(1 / largest[nonzero]) @ rows[nonzero])


def _motions(
    mesh: Mesh, constraint: Constraint, nodes: np.ndarray, label: np.ndarray, centre: np.ndarray, radius: np.ndarray
) -> sparse.csr_array:
    """R (3n + 3r, 6b): six motions of each body about its centre, rotations divided by its radius, on the rows of z of its
    nodes; label (n,): the body of each node."""
    body, turning = label[nodes], mesh.turning
    blocks = rigid_rows(mesh.position[nodes] - centre[body])
    blocks[:, :, 3:] /= radius[body][:, None, None]
    displaced = blocks, (3 * nodes[:, None] + np.arange(3))[:, :, None], 6 * body[:, None, None] + np.arange(6)
    about = 6 * label[turning][:, None] + np.arange(3, 6)
    turned = np.repeat(1 / radius[label[turning]], 3).reshape(-1, 3), constraint.rotations(turning), about
    return from_entries([displaced, turned], (constraint.transform.shape[0], 6 * len(centre)))


def _relative_motions(mesh: Mesh, pieces: Pieces, centre: np.ndarray, radius: np.ndarray) -> sparse.csr_array:
    """R_a c_a − R_b c_b (3s, 6b) at the s nodes of a piece that move with another one."""
    node, other = pieces.meeting
    entries, rows = [], np.arange(3 * len(node)).reshape(-1, 3, 1)
    for body, sign in ((pieces.label[node], 1.0), (other, -1.0)):
        blocks = sign * rigid_rows(mesh.position[node] - centre[body])
        blocks[:, :, 3:] /= radius[body][:, None, None]
        entries.append((blocks, rows, 6 * body[:, None, None] + np.arange(6)))
    return from_entries(entries, (3 * len(node), 6 * len(centre)))


def _null_space(B: sparse.csr_array) -> np.ndarray:
    """Right null space (columns, k), by QR of slabs of rows and an SVD of the last factor."""
    triangle = np.zeros((0, B.shape[1]))
    for start in range(0, B.shape[0], 4096):
        triangle = np.asarray(np.linalg.qr(np.vstack([triangle, B[start : start + 4096].toarray()]), mode="r"))
    _, strength, Vt = np.linalg.svd(triangle, full_matrices=True)
    # the columns are scaled to unit motion, so that a support has strength of the order of one whatever the units
    return Vt[int(np.count_nonzero(strength > TOLERANCE)) :].T


def _without_zero_motions(null: np.ndarray, R: sparse.csr_array) -> np.ndarray:
    """Null vectors (columns, k) without those that move no node, such as the rotation of rods in a line about it."""
    if not null.size:
        return null
    rigid = R.shape[1]
    _, strength, Vt = np.linalg.svd(np.vstack([R @ null[:rigid], null[rigid:]]), full_matrices=False)
    return np.asarray(null @ Vt[strength > TOLERANCE * max(1.0, strength.max(initial=0.0))].T)


def _node_of(mesh: Mesh, pieces: Pieces, body: int) -> int:
    """Id of the first node that belongs to this piece only, otherwise of its first node."""
    nodes = pieces.node[pieces.piece == body]
    unshared = nodes[~np.isin(nodes, pieces.meeting[0])]
    return int(mesh.node_ids[(unshared if len(unshared) else nodes)[0]])


EXACT = 1e-6
"""Share of the largest term of a spring or relation: rounding of the positions in a deck."""
MOTIONS = (*(f"translation {axis}" for axis in AXES), *(f"rotation about {axis}" for axis in AXES))


@dataclass(frozen=True)
class StretchedLink:
    """A spring or relation between several nodes that a rigid motion stretches: name; motion: the one that stretches it most;
    share: |Σ r z| over Σ |r| |z| under it, 0 if correct; apart [m]: the largest distance between its nodes."""

    name: str
    motion: str
    share: float
    apart: float


def links(mesh: Mesh, least: float = 0.0) -> tuple[StretchedLink, ...]:
    """Springs and relations between several nodes, s = Σ r z, that a rigid motion z = u + ω × (x − x₀) stretches, largest share
    first; least: smallest share that counts, EXACT if s should be 0.

    A link with a single node leads to the ground and is a support. Elements, rigid and averaging elements follow a rigid
    motion exactly."""
    x, stretched = mesh.position - mesh.position.mean(axis=0), list[StretchedLink]()
    for spring in mesh.springs:
        for i in np.flatnonzero(spring.stiffness > 0):
            part = spring.spring == i
            stretched += _stretched_link(
                x, spring.name, spring.node[part], spring.component[part], spring.value[part], {}
            )
    for tie in mesh.relations:
        stretched += _stretched_link(x, str(tie), tie.node, tie.component, tie.value, mesh.axes)
    return tuple(sorted((link for link in stretched if link.share >= least), key=lambda link: -link.share))


def _stretched_link(
    x: FloatArray, name: str, node: IntArray, component: IntArray, value: FloatArray, axes: Mapping[int, FloatArray]
) -> Iterator[StretchedLink]:
    nonzero = value != 0
    node, component, value = node[nonzero], component[nonzero], value[nonzero]
    if len(np.unique(node)) < 2:
        return
    terms = value[:, None] * _rows(x, node, component, axes)
    size = np.abs(terms).sum(axis=0)
    share = np.divide(np.abs(terms.sum(axis=0)), size, out=np.zeros(6), where=size > EXACT * size.max(initial=0.0))
    worst = int(np.argmax(share))
    distance = float(np.linalg.norm(x[node] - x[node[0]], axis=1).max())
    yield StretchedLink(name, MOTIONS[worst], float(share[worst]), distance)


def _rows(x: FloatArray, node: IntArray, component: IntArray, axes: Mapping[int, FloatArray]) -> FloatArray:
    """(k, 6): each motion component of its node under six rigid motions, in the local axes of the node."""
    rows = np.zeros((len(node), 6, 6))
    rows[:, :3] = rigid_rows(x[node])
    rows[:, 3:, 3:] = np.eye(3)
    for i, node_index in enumerate(node.tolist()):
        if node_index in axes:
            Q = np.asarray(axes[node_index])
            rows[i] = np.vstack([Q.T @ rows[i, :3], Q.T @ rows[i, 3:]])
    return rows[np.arange(len(node)), component]
