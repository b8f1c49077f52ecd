"""Elimination gives what Lagrange multipliers give, along axes of the nodes' own too, and refuses what contradicts itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.errors import DeckError
from strainsight.fem.assembly import assemble
from strainsight.fem.constraints import constraint_transform, describe_row
from strainsight.fem.model import build_model
from strainsight.fem.support import rigid_body_motions
from strainsight.mesh.joins import AveragingElement, PointMass, RigidElement

from ..bodies import with_nodes


def with_reference(mesh, at):
    """The mesh with one more node; returns it and the node's index."""
    n = len(mesh.position)
    return with_nodes(mesh, at, ids=[900 + n]), n


def tip_of(mesh):
    return np.flatnonzero(np.isclose(mesh.position[:, 0], mesh.position[:, 0].max()))


def by_multipliers(K, C, f):
    """z of K z + Cᵀλ = f, C z = 0, with the least motions of what K does not hold."""
    scale = np.abs(K).max()
    saddle = np.block([[K / scale, C.T], [C, np.zeros((len(C), len(C)))]])
    return np.linalg.lstsq(saddle, np.append(f / scale, np.zeros(len(C))), rcond=1e-13)[0][: len(K)]


@pytest.mark.parametrize("components", [(0, 1, 2, 3, 4, 5), (0, 1, 2)])
def test_averaging_element_equals_lagrange_multipliers(box, components):
    """Under a force on the reference node and, where it turns with the others, a moment."""
    mesh, r = with_reference(box("tet10", (2, 1, 1), clamp_root=True), [1.4, 0.7, 0.1])
    tip = tip_of(replace(mesh, position=mesh.position[:-1]))
    weight = np.random.default_rng(2).uniform(0.2, 2.0, len(tip))
    mesh = replace(mesh, averaging=(AveragingElement(6, r, tip, weight, components),))
    n = 3 * len(mesh.position)
    arms = mesh.position[tip] - mesh.position[r]
    design = np.vstack([np.column_stack([np.eye(3), *(np.cross(axis, arm) for axis in np.eye(3))]) for arm in arms])
    root = np.repeat(np.sqrt(weight), 3)
    fit = np.linalg.pinv(design * root[:, None]) * root
    C = np.zeros((6, n + 3))
    C[:3, 3 * r : 3 * r + 3] = C[3:, n:] = np.eye(3)
    C[:, (3 * tip[:, None] + np.arange(3)).ravel()] = -fit
    f = np.zeros(n + 3)
    f[3 * r : 3 * r + 3], f[n:] = [1e3, -2e3, 5e2], [300.0, 100.0, -200.0]
    if len(components) == 3:
        C[3:], f[n:] = np.column_stack([np.zeros((3, n)), np.eye(3)]), 0.0
    K, clamped = np.zeros((n + 3, n + 3)), np.eye(n + 3)[3 * mesh.fixed[:, 0] + mesh.fixed[:, 1]]
    K[:n, :n] = assemble(mesh)[0].constant.toarray()
    T = constraint_transform(mesh).transform.toarray()
    expected = by_multipliers(K, np.vstack([C, clamped]), f)
    assert np.allclose(T @ np.linalg.solve(T.T @ K @ T, T.T @ f), expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_chains_resolve_in_any_order(box, order):
    mesh, a = with_reference(box("tet4", (2, 1, 1), clamp_root=True), [1.2, 0.5, 0.5])
    tip = tip_of(replace(mesh, position=mesh.position[:-1]))
    mesh, b = with_reference(mesh, [2.0, -1.0, 0.3])
    pair = (RigidElement(1, a, tip, (0, 1, 2)), RigidElement(2, b, np.array([a]), (0, 1, 2, 3, 4, 5)))
    chain = constraint_transform(replace(mesh, rigid=tuple(pair[i] for i in order))).transform
    single = constraint_transform(replace(mesh, rigid=(RigidElement(2, b, np.append(tip, a), (0, 1, 2)),))).transform
    n = 3 * len(mesh.position)
    assert chain.shape[1] == single.shape[1]
    assert np.abs((chain[:n] - single[:n]).toarray()).max() < 1e-13


def test_nodes_of_no_element_have_no_motion(box):
    mesh, loose = with_reference(box("tet10", (1, 1, 1), clamp_root=True), [5, 5, 5])
    constraint = constraint_transform(mesh)
    assert constraint.transform[[3 * loose, 3 * loose + 1, 3 * loose + 2]].nnz == 0
    assert not np.any(constraint.free_rows // 3 == loose)


def test_motions_without_stiffness_are_left_out(box):
    mesh, r = with_reference(box("hex8", (2, 1, 1), clamp_root=True), [1.0, 0.5, 0.5])
    mesh = replace(mesh, rigid=(RigidElement(1, r, tip_of(replace(mesh, position=mesh.position[:-1])), (2,)),))
    constraint = constraint_transform(mesh)
    rotation = constraint.reference_rows[r]
    own = [row for row in constraint.free_rows if row // 3 == r or row >= rotation]
    assert own == [3 * r + 2, rotation]


def test_clamped_rotation_of_a_solid_node_has_no_effect(box):
    mesh = box("hex8", (1, 1, 1), clamp_root=True)
    more = replace(mesh, fixed=np.vstack([mesh.fixed, [[7, 3], [7, 4], [7, 5]]]))
    assert np.array_equal(constraint_transform(mesh).free_rows, constraint_transform(more).free_rows)


@pytest.mark.parametrize("clamped", [(0, 1, 2, 3, 4, 5), (0, 3, 5)])
def test_dependents_turn_with_a_reference_that_is_partly_clamped(box, clamped):
    mesh, a = with_reference(box("hex8", (2, 1, 1), clamp_root=True), [1.2, 0.5, 0.5])
    tip = tip_of(replace(mesh, position=mesh.position[:-1]))
    mesh, b = with_reference(mesh, [2.0, -1.0, 0.3])
    mesh = replace(
        mesh,
        rigid=(RigidElement(1, a, tip, (0, 1, 2)), RigidElement(2, b, np.array([a]), (3, 4, 5))),
        fixed=np.vstack([mesh.fixed, [(b, c) for c in clamped]]),
    )
    constraint = constraint_transform(mesh)
    T = constraint.transform.toarray()
    spin = T[constraint.reference_rows[b] :][:3]
    assert np.array_equal(T[constraint.reference_rows[a] :][:3], spin)
    assert [bool(row.any()) for row in spin] == [c not in clamped for c in (3, 4, 5)]
    for node in tip:
        arm = mesh.position[node] - mesh.position[a]
        turned = np.cross(spin.T, arm).T
        np.testing.assert_allclose(T[3 * node : 3 * node + 3], T[3 * a : 3 * a + 3] + turned, atol=1e-15)
    # translations of b lead nothing
    assert not T[3 * b : 3 * b + 3].any()


def test_constraints_of_imported_matrices_use_their_supports(box):
    mesh, r = with_reference(box("hex8", (1, 1, 1), clamp_root=True), [1.5, 0.5, 0.5])
    one, other = tip_of(replace(mesh, position=mesh.position[:-1]))[:2]
    rigid = RigidElement(1, r, np.array([other]), (0, 1, 2, 3, 4, 5))
    mesh = replace(mesh, rigid=(rigid,), fixed=np.vstack([mesh.fixed, [one, 5]]))
    order = sorted([one, other, r])
    first = {node: 27 + 3 * order.index(node) for node in order}
    supported = np.zeros(36, dtype=bool)
    supported[[3 * one, 3 * one + 1, *range(first[one], first[one] + 3), *range(first[other], first[other] + 3)]] = True
    constraint = constraint_transform(mesh, supported=supported, rotations=[one, other])
    assert dict(constraint.reference_rows) == first
    # of the reference only what the other node's rotations feel; the one node's third rotation is clamped
    free = [3 * one, 3 * one + 1, first[one], first[one] + 1, *range(first[r], first[r] + 3)]
    assert list(constraint.free_rows) == sorted(free)
    T = constraint.transform.toarray()
    assert np.array_equal(T[first[other] :][:3], T[first[r] :][:3])


ALL_SIX, A, B, TIP_NODES = tuple(range(6)), 12, 13, np.arange(8, 12)
CONTRADICTIONS = [
    (
        ("tie", 2),
        "node 9 is dependent in rigid element 1 and in rigid element 2",
        {"rigid": (RigidElement(1, A, TIP_NODES, (0, 1, 2)), RigidElement(2, B, TIP_NODES[:1], (0,)))},
    ),
    (
        ("tie", 1),
        "component 1 of node 1 is clamped, but also dependent in rigid element 1",
        {"rigid": (RigidElement(1, A, np.array([0]), (0,)),)},
    ),
    (
        ("tie", 2),
        "cycle through nodes 912, 913",
        {"rigid": (RigidElement(1, A, np.array([B]), ALL_SIX), RigidElement(2, B, np.array([A]), ALL_SIX))},
    ),
    (("tie", 1), "the same node as reference", {"rigid": (RigidElement(1, A, np.array([A]), (0,)),)}),
    (("tie", 1), "rigid element 1 has no dependent nodes", {"rigid": (RigidElement(1, A, np.zeros(0, dtype=int), (0,)),)}),
    (
        ("tie", 3),
        "averaging element 3 has no averaged nodes",
        {"averaging": (AveragingElement(3, A, TIP_NODES, np.zeros(4), (0,)),)},
    ),
    (
        ("tie", 3),
        "do not determine the rotation z of its reference",
        {"averaging": (AveragingElement(3, A, TIP_NODES[:1], np.ones(1), (5,)),)},
    ),
    (
        ("tie", 3),
        "averaging element 3 averages node 913, which is connected to no element",
        {"averaging": (AveragingElement(3, A, np.append(TIP_NODES, B), np.ones(5), (0, 1, 2)),)},
    ),
    (("node", 912), "point mass 4 is on node 912", {"point_masses": (PointMass(4, A, 1.0),)}),
]


@pytest.mark.parametrize(("entity", "message", "change"), CONTRADICTIONS, ids=[row[1] for row in CONTRADICTIONS])
def test_conflicting_constraints_are_refused_with_node_ids(box, entity, message, change):
    mesh, a = with_reference(box("hex8", (2, 1, 1), clamp_root=True), [1.5, 0.5, 0.5])
    mesh, b = with_reference(mesh, [1.8, 0.5, 0.5])
    assert (a, b) == (A, B)
    with pytest.raises(DeckError, match=message) as caught:
        constraint_transform(replace(mesh, **change))
    assert caught.value.entity == entity


TURN = Rotation.from_rotvec([0.4, -0.7, 0.2]).as_matrix()


@pytest.fixture
def supported_part(box):
    """A box on rollers and one pin; part of its tip follows a node in two components and in their chain another one, whose
    turning is the mean of the root's."""
    mesh = box("tet10", (2, 1, 1), distort=0.2)
    n = len(mesh.position)
    x = mesh.position
    tip, root = (np.flatnonzero(np.isclose(x[:, 0], end)) for end in (1.0, 0.0))
    corner = int(np.argmin(np.abs(x).sum(axis=1)))
    fixed = [(int(i), 0) for i in root] + [(corner, 1), (corner, 2), (int(root[-1]), 2)]
    return replace(
        with_nodes(mesh, [1.3, 0.6, 0.2], [1.5, 0.1, 0.7], ids=[900, 901]),
        fixed=np.array(fixed, dtype=np.int64),
        rigid=(RigidElement(1, n, tip[::2], (0, 2)), RigidElement(2, n + 1, np.array([n]), (1, 2, 3, 4, 5))),
    )


def solution(mesh, force):
    constraint = constraint_transform(mesh)
    T = constraint.transform.toarray()
    n = 3 * len(mesh.position)
    K = T[:n].T @ (assemble(mesh)[0].constant @ T[:n])
    return T[:n] @ np.linalg.solve(K, T[:n].T @ force.ravel())


def test_local_axes_equal_lagrange_multipliers(supported_part):
    mesh = supported_part
    n = len(mesh.position)
    axes = dict(enumerate(Rotation.random(n, random_state=4).as_matrix()))
    whole = RigidElement(2, n - 1, np.array([n - 2]), tuple(range(6)))
    mesh = replace(mesh, axes=axes, rigid=(mesh.rigid[0], whole))
    size = 3 * n + 6
    motion = {n - 2: (3 * (n - 2), 3 * n), n - 1: (3 * (n - 1), 3 * n + 3)}
    rows = []
    for node, c in mesh.fixed:
        row = np.zeros(size)
        row[3 * node : 3 * node + 3] = axes[int(node)][:, c]
        rows.append(row)
    for e in mesh.rigid:
        u, theta = motion[e.reference]
        for node in e.nodes:
            arm = mesh.position[node] - mesh.position[e.reference]
            for c in e.components:
                axis = axes[int(node)][:, c % 3]
                row = np.zeros(size)
                if c < 3:
                    row[3 * node : 3 * node + 3] = axis
                    row[u : u + 3] -= axis
                    row[theta : theta + 3] -= np.cross(arm, axis)
                else:
                    row[motion[int(node)][1] :][:3] = axis
                    row[theta : theta + 3] -= axis
                rows.append(row)
    C = np.array(rows)
    K = np.zeros((size, size))
    K[: 3 * n, : 3 * n] = assemble(mesh)[0].constant.toarray()
    force = 1e11 * np.append(np.random.default_rng(1).normal(size=3 * n), np.zeros(6))
    expected = by_multipliers(K, C, force)[: 3 * n]
    np.testing.assert_allclose(solution(mesh, force[: 3 * n]), expected, atol=1e-8 * np.abs(expected).max())


def test_free_rows_are_motions_along_the_axes_of_the_node(box):
    mesh = box("hex8", (1, 1, 1), clamp_root=True)
    held = int(np.flatnonzero(mesh.position[:, 0] == 1)[0])
    mesh = replace(mesh, fixed=np.vstack([mesh.fixed, [held, 1]]), axes={held: TURN})
    constraint = constraint_transform(mesh)
    z = constraint.transform.toarray()
    own = constraint.along_local_axes(constraint.transform).toarray()
    np.testing.assert_allclose(own[constraint.free_rows], np.eye(z.shape[1]), atol=1e-15)
    assert 3 * held + 1 not in constraint.free_rows
    np.testing.assert_allclose(TURN[:, 1] @ z[3 * held : 3 * held + 3], 0, atol=1e-15)
    assert (
        describe_row(mesh, constraint, 3 * held + 2)
        == f"node {mesh.node_ids[held]}, translation 3 in its local coordinate system"
    )
    other = (held + 1) % len(mesh.position)
    assert describe_row(mesh, constraint, 3 * other).endswith(", translation x")


def frame(normal):
    """Axes whose third is the normal."""
    normal = np.asarray(normal) / np.linalg.norm(normal)
    first = np.cross(normal, [0.36, 0.48, 0.8])
    first /= np.linalg.norm(first)
    return np.column_stack([first, np.cross(normal, first), normal])


@pytest.mark.parametrize("turn", [np.eye(3), TURN])
def test_rollers_on_inclined_planes_hold_what_their_normals_span(box, turn):
    mesh = box("hex8", (1, 1, 1))
    mesh = replace(mesh, position=mesh.position @ turn.T)
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(6, 3))
    x = mesh.position[:6]
    assert np.linalg.matrix_rank(np.hstack([normals, np.cross(x, normals)])) == 6
    held = replace(mesh, fixed=np.array([(i, 2) for i in range(6)]), axes={i: frame(v) for i, v in enumerate(normals)})
    assert rigid_body_motions(held, constraint_transform(held)) == ()
    build_model(held)
    centre = turn @ [0.5, 0.5, 0.5]
    radial = [x - centre - ((x - centre) @ turn[:, 2]) * turn[:, 2] for x in mesh.position]
    ring = replace(
        mesh,
        fixed=np.array([(i, c) for i in range(8) for c in ((2, 0) if i == 0 else (2,))]),
        axes={i: np.column_stack([turn[:, 2], np.cross(r, turn[:, 2]) / np.linalg.norm(r), r / np.linalg.norm(r)])
              for i, r in enumerate(radial)},
    )  # fmt: skip
    (word,) = rigid_body_motions(ring, constraint_transform(ring))
    axis = "z" if turn is not TURN else "(0.5845, 0.4216, -0.6933) through"
    assert word.startswith(f"rotation about {axis}")


def test_clamped_tied_component_is_reported_in_local_axes(supported_part):
    mesh = supported_part
    node = int(mesh.rigid[0].nodes[0])
    turned = replace(mesh, axes={node: TURN})
    # component 2 is not tied: it may be clamped
    constraint_transform(replace(turned, fixed=np.vstack([mesh.fixed, [node, 1]])))
    with pytest.raises(DeckError, match=f"component 3 of node {mesh.node_ids[node]} is clamped, .* rigid element 1") as caught:
        constraint_transform(replace(turned, fixed=np.vstack([mesh.fixed, [node, 2]])))
    assert caught.value.entity == ("tie", 1)


def test_averaging_reference_uses_its_local_axes(box):
    mesh = box("hex8", (2, 1, 1), clamp_root=True)
    n = len(mesh.position)
    tip = np.flatnonzero(mesh.position[:, 0] == 1)
    mesh = replace(
        with_nodes(mesh, [1.0, 0.5, 0.5], ids=[900]),
        averaging=(AveragingElement(3, n, tip, np.ones(len(tip)), (1,)),),
        axes={n: TURN},
    )
    T = constraint_transform(mesh).transform.toarray()
    mean = sum(T[3 * i : 3 * i + 3] for i in tip) / len(tip)
    np.testing.assert_allclose(TURN.T @ T[3 * n : 3 * n + 3], np.diag([0, 1, 0]) @ TURN.T @ mean, atol=1e-15)
