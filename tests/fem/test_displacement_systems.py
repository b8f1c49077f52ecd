"""Supports and ties along axes of the nodes' own: the same structure, however its components are written."""

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
from strainsight.mesh.joins import AveragingElement, RigidElement

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
        mesh,
        node_ids=np.append(mesh.node_ids, [900, 901]),
        position=np.vstack([x, [1.3, 0.6, 0.2], [1.5, 0.1, 0.7]]),
        fixed=np.array(fixed, dtype=np.int64),
        rigid=(RigidElement(1, n, tip[::2], (0, 2)), RigidElement(2, n + 1, np.array([n]), (1, 2, 3, 4, 5))),
    )


def solution(mesh, force):
    constraint = constraint_transform(mesh)
    T = constraint.transform.toarray()
    n = 3 * len(mesh.position)
    K = T[:n].T @ (assemble(mesh)[0].constant @ T[:n])
    return T[:n] @ np.linalg.solve(K, T[:n].T @ force.ravel())


def test_axes_of_their_own_equal_lagrange_multipliers(supported_part):
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
    force = np.append(np.random.default_rng(1).normal(size=3 * n), np.zeros(6))
    scale = np.abs(K).max()
    saddle = np.block([[K / scale, C.T], [C, np.zeros((len(C), len(C)))]])
    expected = np.linalg.lstsq(saddle, np.append(force, np.zeros(len(C))), rcond=1e-13)[0][: 3 * n]
    np.testing.assert_allclose(solution(mesh, force[: 3 * n] * scale), expected, atol=1e-8 * np.abs(expected).max())


def test_free_rows_are_motions_along_the_axes_of_the_node(box):
    mesh = box("hex8", (1, 1, 1), clamp_root=True)
    held = int(np.flatnonzero(mesh.position[:, 0] == 1)[0])
    mesh = replace(mesh, fixed=np.vstack([mesh.fixed, [held, 1]]), axes={held: TURN})
    constraint = constraint_transform(mesh)
    z = constraint.transform.toarray()
    own = constraint.along_own_axes(constraint.transform).toarray()
    np.testing.assert_allclose(own[constraint.free_rows], np.eye(z.shape[1]), atol=1e-15)
    assert 3 * held + 1 not in constraint.free_rows
    np.testing.assert_allclose(TURN[:, 1] @ z[3 * held : 3 * held + 3], 0, atol=1e-15)
    assert (
        describe_row(mesh, constraint, 3 * held + 2) == f"node {mesh.node_ids[held]}, translation 3 along its own axes"
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


def test_a_clamp_on_a_tied_component_is_reported_in_the_nodes_own_components(supported_part):
    mesh = supported_part
    node = int(mesh.rigid[0].nodes[0])
    turned = replace(mesh, axes={node: TURN})
    # component 2 is not tied: it may be clamped
    constraint_transform(replace(turned, fixed=np.vstack([mesh.fixed, [node, 1]])))
    with pytest.raises(DeckError, match=f"node {mesh.node_ids[node]} is clamped in component 3 .* rigid element 1") as caught:
        constraint_transform(replace(turned, fixed=np.vstack([mesh.fixed, [node, 2]])))
    assert caught.value.entity == ("tie", 1)


def test_an_averaging_reference_moves_along_its_own_axes(box):
    mesh = box("hex8", (2, 1, 1), clamp_root=True)
    n = len(mesh.position)
    tip = np.flatnonzero(mesh.position[:, 0] == 1)
    mesh = replace(
        mesh,
        node_ids=np.append(mesh.node_ids, 900),
        position=np.vstack([mesh.position, [1.0, 0.5, 0.5]]),
        averaging=(AveragingElement(3, n, tip, np.ones(len(tip)), (1,)),),
        axes={n: TURN},
    )
    T = constraint_transform(mesh).transform.toarray()
    mean = sum(T[3 * i : 3 * i + 3] for i in tip) / len(tip)
    np.testing.assert_allclose(TURN.T @ T[3 * n : 3 * n + 3], np.diag([0, 1, 0]) @ TURN.T @ mean, atol=1e-15)
