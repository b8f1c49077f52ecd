"""Elimination gives what Lagrange multipliers give, and refuses what contradicts itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.fem.assembly import assemble
from strainsight.fem.constraints import constraint_transform
from strainsight.mesh.joins import AveragingElement, PointMass, RigidElement


def with_reference(mesh, at):
    """The mesh with one more node; returns it and the node's index."""
    n = len(mesh.position)
    return replace(mesh, node_ids=np.append(mesh.node_ids, 900 + n), position=np.vstack([mesh.position, at])), n


def tip_of(mesh):
    return np.flatnonzero(np.isclose(mesh.position[:, 0], mesh.position[:, 0].max()))


def by_elimination(mesh, force):
    """z for the force on all rows of z, with the transformation under test."""
    constraint = constraint_transform(mesh)
    T = constraint.transform.toarray()
    K = np.zeros((len(T), len(T)))
    n = 3 * len(mesh.position)
    K[:n, :n] = assemble(mesh)[0].constant.toarray()
    return T @ np.linalg.solve(T.T @ K @ T, T.T @ force(constraint, len(T)))


def by_multipliers(mesh, C, force):
    """z = (u, θ) of one reference node with C z = 0 and the clamped components zero, from the saddle-point system."""
    n = 3 * len(mesh.position)
    K = np.zeros((n + 3, n + 3))
    K[:n, :n] = assemble(mesh)[0].constant.toarray()
    scale = np.abs(K).max()
    K, f = K / scale, force / scale
    clamped = np.zeros((len(mesh.fixed), n + 3))
    clamped[np.arange(len(mesh.fixed)), 3 * mesh.fixed[:, 0] + mesh.fixed[:, 1]] = 1
    C = np.vstack([C, clamped])
    saddle = np.block([[K, C.T], [C, np.zeros((len(C), len(C)))]])
    return np.linalg.lstsq(saddle, np.append(f, np.zeros(len(C))), rcond=1e-14)[0][: n + 3]


def reference_force(node):
    """A force and a moment on the reference node."""

    def force(constraint, size):
        f = np.zeros(size)
        f[3 * node : 3 * node + 3] = [1e3, -2e3, 5e2]
        f[constraint.reference_rows[node] :][:3] = [300.0, 100.0, -200.0]
        return f

    return force


@pytest.mark.parametrize("components", [(0, 1, 2), (0, 2), (0, 1)])
@pytest.mark.parametrize("kind", ["tet10", "hex8"])
def test_rigid_element_equals_lagrange_multipliers(box, kind, components):
    mesh, r = with_reference(box(kind, (2, 1, 1), distort=0.0, clamp_root=True), [1.3, 0.6, 0.2])
    tip = tip_of(replace(mesh, position=mesh.position[:-1]))
    mesh = replace(mesh, rigid=(RigidElement(5, r, tip, components),))
    n = 3 * len(mesh.position)
    rows = []
    for node in tip:
        arm = mesh.position[node] - mesh.position[r]
        for c in components:
            row = np.zeros(n + 3)
            row[3 * node + c] = 1
            row[3 * r + c] = -1
            row[n:] = [-np.cross(axis, arm)[c] for axis in np.eye(3)]
            rows.append(row)
    force = reference_force(r)
    found = by_elimination(mesh, force)
    expected = by_multipliers(mesh, np.array(rows), force(constraint_transform(mesh), n + 3))
    assert np.allclose(found, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("components", [(0, 1, 2, 3, 4, 5), (0, 1, 2)])
def test_averaging_element_equals_lagrange_multipliers(box, components):
    mesh, r = with_reference(box("tet10", (2, 1, 1), clamp_root=True), [1.4, 0.7, 0.1])
    tip = tip_of(replace(mesh, position=mesh.position[:-1]))
    weight = np.random.default_rng(2).uniform(0.2, 2.0, len(tip))
    mesh = replace(mesh, averaging=(AveragingElement(6, r, tip, weight, components),))
    n = 3 * len(mesh.position)
    design = np.vstack(
        [
            np.column_stack(
                [np.eye(3), *(np.cross(axis, mesh.position[node] - mesh.position[r]) for axis in np.eye(3))]
            )
            for node in tip
        ]
    )
    root = np.repeat(np.sqrt(weight), 3)
    fit = np.linalg.pinv(design * root[:, None]) * root
    C = np.zeros((6, n + 3))
    C[:3, 3 * r : 3 * r + 3] = C[3:, n:] = np.eye(3)
    C[:, (3 * tip[:, None] + np.arange(3)).ravel()] = -fit
    if len(components) == 3:
        C[3:] = np.column_stack([np.zeros((3, n)), np.eye(3)])

    def force(constraint, size):
        f = reference_force(r)(constraint, size)
        f[n:] *= len(components) == 6
        return f

    found = by_elimination(mesh, force)
    expected = by_multipliers(mesh, C, force(constraint_transform(mesh), n + 3))
    assert np.allclose(found, expected, atol=1e-9 * np.abs(expected).max())


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


def test_motions_that_nothing_carries_are_left_out(box):
    mesh, r = with_reference(box("hex8", (2, 1, 1), clamp_root=True), [1.0, 0.5, 0.5])
    mesh = replace(mesh, rigid=(RigidElement(1, r, tip_of(replace(mesh, position=mesh.position[:-1])), (2,)),))
    constraint = constraint_transform(mesh)
    rotation = constraint.reference_rows[r]
    own = [row for row in constraint.free_rows if row // 3 == r or row >= rotation]
    assert own == [3 * r + 2, rotation]


def test_clamped_rotation_of_a_solid_node_means_nothing(box):
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


def test_rows_of_other_matrices_have_rotations_and_supports_of_their_own(box):
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


def refused(mesh, entity, message, **change):
    with pytest.raises(DeckError, match=message) as caught:
        constraint_transform(replace(mesh, **change))
    assert caught.value.entity == entity


def test_contradictions_name_the_nodes(box):
    mesh, a = with_reference(box("hex8", (2, 1, 1), clamp_root=True), [1.5, 0.5, 0.5])
    mesh, b = with_reference(mesh, [1.8, 0.5, 0.5])
    tip = tip_of(replace(mesh, position=mesh.position[:-2]))
    rigid = RigidElement(1, a, tip, (0, 1, 2))
    root = int(mesh.fixed[0, 0])
    refused(
        mesh,
        ("tie", 2),
        f"node {mesh.node_ids[tip[0]]} is dependent in rigid element 1 and in rigid element 2",
        rigid=(rigid, RigidElement(2, b, tip[:1], (0,))),
    )
    refused(
        mesh,
        ("tie", 1),
        f"node {mesh.node_ids[root]} is clamped in component 1 and dependent in rigid element 1",
        rigid=(RigidElement(1, a, np.array([root]), (0,)),),
    )
    refused(
        mesh,
        ("tie", 2),
        f"circle through nodes {mesh.node_ids[a]}, {mesh.node_ids[b]}",
        rigid=(
            RigidElement(1, a, np.array([b]), (0, 1, 2, 3, 4, 5)),
            RigidElement(2, b, np.array([a]), (0, 1, 2, 3, 4, 5)),
        ),
    )
    refused(mesh, ("tie", 1), "rigid element 1 depends on its own reference", rigid=(RigidElement(1, a, np.array([a]), (0,)),))
    refused(
        mesh, ("tie", 1), "rigid element 1 has no dependent nodes", rigid=(RigidElement(1, a, np.array([], dtype=int), (0,)),)
    )
    weightless = AveragingElement(3, a, tip, np.zeros(len(tip)), (0,))
    refused(mesh, ("tie", 3), "averaging element 3 needs nodes", averaging=(weightless,))
    line = tip[np.isclose(mesh.position[tip, 1], 0)]
    refused(
        mesh,
        ("tie", 3),
        "do not hold rotation z of its reference",
        averaging=(AveragingElement(3, a, line[:1], np.ones(1), (5,)),),
    )
    refused(
        mesh,
        ("tie", 3),
        f"averaging element 3 averages node {mesh.node_ids[b]}, which no element holds",
        averaging=(AveragingElement(3, a, np.append(tip, b), np.ones(len(tip) + 1), (0, 1, 2)),),
    )
    refused(
        mesh,
        ("node", int(mesh.node_ids[a])),
        f"point mass 4 sits on node {mesh.node_ids[a]}",
        point_masses=(PointMass(4, a, 1.0),),
    )
