"""Free motions are named before a factorisation breaks on them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import UserError
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.model import build_model
from strainsight.fem.support import require_support, rigid_body_motions
from strainsight.mesh.joins import RigidElement
from strainsight.mesh.model import CellBlock

ALL = ("translation x", "translation y", "translation z", "rotation about x", "rotation about y", "rotation about z")


def motions(mesh, fixed=(), **change):
    mesh = replace(mesh, fixed=np.array(fixed, dtype=np.int64).reshape(-1, 2), **change)
    return rigid_body_motions(mesh, constraint_transform(mesh))


def two_boxes(box, gap):
    mesh = box("hex8", (1, 1, 1))
    block = mesh.blocks[0]
    both = CellBlock("hex8", np.array([1, 2]), np.vstack([block.nodes, block.nodes + 8]), np.array([1, 1]))
    return replace(
        mesh,
        node_ids=np.arange(1, 17),
        position=np.vstack([mesh.position, mesh.position + np.array([1 + gap, 0, 0])]),
        blocks=(both,),
    )


@pytest.mark.parametrize(("unit", "offset"), [(1e-6, 0.0), (1.0, 0.0), (1.0, 1e4), (1e4, 0.0)])
@pytest.mark.parametrize("kind", ["tet10", "hex8"])
def test_every_free_motion_is_named_in_any_unit(box, kind, unit, offset):
    mesh = box(kind, (2, 2, 2), size=(unit, unit, unit))
    mesh = replace(mesh, position=mesh.position + offset * unit)
    corner = {
        c: int(np.argmin(np.linalg.norm(mesh.position - unit * (np.array(c) + offset), axis=1)))
        for c in [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    }
    assert motions(mesh) == ALL
    bottom = [(i, 2) for i in np.flatnonzero(np.isclose(mesh.position[:, 2], mesh.position[:, 2].min()))]
    assert motions(mesh, bottom) == ("translation x", "translation y", "rotation about z")
    isostatic = [
        (corner[0, 0, 0], 0),
        (corner[0, 0, 0], 1),
        (corner[0, 0, 0], 2),
        (corner[1, 0, 0], 1),
        (corner[1, 0, 0], 2),
        (corner[0, 1, 0], 2),
    ]
    assert motions(mesh, isostatic) == ()
    for left_out in range(6):
        assert len(motions(mesh, isostatic[:left_out] + isostatic[left_out + 1 :])) == 1


def test_hinge_line_is_described_by_its_axis(box):
    mesh = box("hex8", (1, 1, 1))
    hinge = [(i, c) for i in np.flatnonzero((mesh.position[:, 0] == 0) & (mesh.position[:, 1] == 0)) for c in range(3)]
    assert motions(mesh, hinge) == ("rotation about z through (0, 0, 0.5) m",)
    diagonal = [
        (i, c)
        for i in np.flatnonzero((mesh.position[:, 0] == mesh.position[:, 1]) & (mesh.position[:, 2] == 0))
        for c in range(3)
    ]
    assert motions(mesh, diagonal)[0].startswith("rotation about (0.7071, 0.7071, 0) through")


def test_motions_about_a_pin_are_the_three_along_the_axes_and_no_mixture(box):
    """All three are equally free: any combination of them is a free motion too, and rounding must not pick one."""
    mesh = box("hex8", (1, 1, 1))
    pin = [(int(np.argmin(np.linalg.norm(mesh.position, axis=1))), c) for c in range(3)]
    through = ("(0.5, 0, 0)", "(0, 0.5, 0)", "(0, 0, 0.5)")
    assert motions(mesh, pin) == tuple(
        f"rotation about {axis} through {point} m" for axis, point in zip("xyz", through, strict=True)
    )
    assert motions(mesh, pin[:1]) == (
        "translation y",
        "translation z",
        "rotation about x",
        "rotation about y through (0.5, 0.5, 0) m",
        "rotation about z through (0.5, 0, 0.5) m",
    )


def test_a_loose_second_part_is_found(box):
    mesh = two_boxes(box, 0.5)
    root = [(i, c) for i in np.flatnonzero(mesh.position[:, 0] == 0) for c in range(3)]
    assert motions(mesh, root) == tuple(f"{motion} of the part with node 9" for motion in ALL)


def test_parts_joined_by_rigid_elements_are_held(box):
    mesh = two_boxes(box, 0.5)
    mesh = replace(mesh, node_ids=np.arange(1, 18), position=np.vstack([mesh.position, [1.25, 0.5, 0.5]]))
    root = [(i, c) for i in np.flatnonzero(mesh.position[:, 0] == 0) for c in range(3)]
    faces = np.flatnonzero(np.isin(mesh.position[:, 0], [1.0, 1.5]))
    assert motions(mesh, root, rigid=(RigidElement(1, 16, faces, (0, 1, 2)),)) == ()
    # in y and z only, the reference still pivots about the first face: just the spin about x is held
    pivot = motions(mesh, root, rigid=(RigidElement(1, 16, faces, (1, 2)),))
    assert pivot == tuple(f"{motion} of the part with node 9" for motion in ALL if motion != "rotation about x")


def test_a_reference_that_can_spin_about_its_nodes_is_found(box):
    """The nodes lie on a slanted line through the reference, so the rotation about it moves nothing."""
    mesh = box("hex8", (1, 1, 1), clamp_root=True)
    mesh = replace(mesh, node_ids=np.arange(1, 10), position=np.vstack([mesh.position, [1.0, 2.0, 2.0]]))
    line = np.flatnonzero((mesh.position[:8, 0] == 1) & (mesh.position[:8, 1] == mesh.position[:8, 2]))
    found = motions(mesh, mesh.fixed, rigid=(RigidElement(1, 8, line, (0, 1, 2)),))
    assert found == ("node 9, rotation y of a rigid element", "node 9, rotation z of a rigid element")


def test_the_error_says_what_moves_and_what_to_do(box):
    mesh = box("tet4", (1, 1, 1))
    with pytest.raises(UserError, match="can move freely: translation x, translation y") as caught:
        require_support(mesh, constraint_transform(mesh))
    assert caught.value.remedy is not None
    assert caught.value.key is None
    with pytest.raises(UserError, match="rotation about z"):
        build_model(mesh)
    assert build_model(mesh, supported=False).size == 24
