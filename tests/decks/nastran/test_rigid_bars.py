"""RBAR, RBAR1, RROD and RBE1: what a rigid body does is all that they allow."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from strainsight.errors import DeckError
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.model import build_model

GRIDS = """\
CORD2R,7,,.0,.1,.2,.3,.4,1.
+,1.,.4,.1
GRID,1,,0.,0.,0.{0}
GRID,2,,1.,.2,0.3{1}
GRID,3,,0.1,1.,0.{0}
GRID,4,,-.2,0.,1.{1}
CBAR,10,1,1,2,.3,.4,.5
CBAR,11,1,3,4,.3,.4,.5
PBAR,1,1,.1,.2,.2,.1
MAT1,1,2.1+11,,.3,7850.
"""
SYSTEMS = [("", ""), (",,7", ""), ("", ",,7"), (",,7", ",,7")]


def grids_of(systems):
    """CD is the seventh field of a GRID, after x, y, z."""
    return GRIDS.format(*(own.replace(",,", ",") for own in systems))


def rigid_motion(mesh, q):
    """(n, 6) motions along the axes of every node of a rigid body that moves by q = (u, θ) of the origin."""
    motion = np.column_stack([q[:3] + np.cross(q[3:], mesh.position), np.tile(q[3:], (len(mesh.position), 1))])
    for node, axes in mesh.axes.items():
        motion[node] = np.concatenate([axes.T @ motion[node, :3], axes.T @ motion[node, 3:]])
    return motion


@pytest.mark.parametrize("systems", SYSTEMS)
@pytest.mark.parametrize(
    ("card", "dependent"),
    [
        ("RBAR,20,1,2,1236,34", [(0, 3), (0, 4), (1, 0), (1, 1), (1, 2), (1, 4), (1, 5)]),
        ("RBAR,20,1,2,1236,34,0,15", [(1, 0), (1, 4)]),
        ("RBAR,20,1,2,45,1236,,45", [(1, 3), (1, 4)]),
        ("RBAR,20,1,2,45,1236,6,0", [(0, 5)]),
        (
            "RBE1,20,1,123,2,23,3,3\n+,UM,4,123,3,12,1,4",
            [(3, 0), (3, 1), (3, 2), (2, 0), (2, 1), (0, 3)],
        ),
    ],
)
def test_what_a_rigid_body_does_fulfils_the_relations_and_nothing_else(read, card, dependent, systems):
    mesh = read(f"{grids_of(systems)}{card}\n")
    expected = dependent
    if card == "RBAR,20,1,2,1236,34":  # blank CMA and CMB: all that are not independent
        free = {(0, 0), (0, 1), (0, 2), (0, 5), (1, 2), (1, 3)}
        expected = sorted(set(product((0, 1), range(6))) - free)
    assert mesh.rigid == ()
    assert sorted(own.follower for own in mesh.relations) == sorted(expected)
    assert {str(own) for own in mesh.relations} == {f"{card[:4]} 20"}
    for q in np.eye(6):
        z = rigid_motion(mesh, q)
        for own in mesh.relations:
            terms = own.value * z[own.node, own.component]
            assert abs(terms.sum()) < 1e-13 * np.abs(own.value).max()
    # nothing but six independent motions leads: they are all that the others follow
    lead = {(n, c) for own in mesh.relations for n, c in zip(own.node[1:], own.component[1:], strict=True)}
    assert len(lead) <= 6
    assert not lead & set(expected)


@pytest.mark.parametrize("systems", SYSTEMS)
@pytest.mark.parametrize(
    "card",
    [
        "RBAR,20,1,3,123456",
        "RBAR,20,1,3,123456,,,123456",
        "RBAR,20,3,1,,123456",
        "RBAR,20,3,1,0,123456,123456,0",
        "RBAR1,20,1,3,123456",
        "RBE1,20,1,123456\n+,UM,3,123456",
        "RBE1,20,1,123456\n+,UM,3,123,3,456,1.-5",
    ],
)
def test_a_node_that_leads_with_six_motions_is_a_rigid_element(read, card, systems):
    mesh = read(f"{grids_of(systems)}{card}\n")
    expected = read(f"{grids_of(systems)}RBE2,20,1,123456,3\n")
    assert mesh.relations == ()
    (own,), (other,) = mesh.rigid, expected.rigid
    assert (own.id, own.reference, own.nodes.tolist(), own.components) == (20, 0, [2], other.components)
    assert str(own) == f"{card.split(',')[0]} 20"
    for found, there in zip(*(build_model(m, supported=False).stiffness.constant for m in (mesh, expected)), strict=True):
        assert np.array_equal(found.toarray(), there.toarray())


def test_dependent_motions_of_several_kinds_are_several_rigid_elements(read):
    mesh = read(f"{grids_of(SYSTEMS[0])}RBE1,20,1,123456\n+,UM,3,123,4,123,2,45\n")
    assert [(own.nodes.tolist(), own.components) for own in mesh.rigid] == [([1], (3, 4)), ([2, 3], (0, 1, 2))]


@pytest.mark.parametrize("systems", SYSTEMS)
@pytest.mark.parametrize(("fields", "follower"), [("2", (0, 1)), (",1", (1, 0)), ("0,3", (1, 2))])
def test_a_rigid_rod_keeps_its_length(read, fields, follower, systems):
    mesh = read(f"{grids_of(systems)}RROD,20,1,2,{fields}\n")
    (own,) = mesh.relations
    assert own.follower == follower
    rng = np.random.default_rng(0)
    T = constraint_transform(mesh).transform
    along = mesh.position[1] - mesh.position[0]
    z = T @ rng.standard_normal((T.shape[1], 5))
    np.testing.assert_allclose(along @ z[3:6], along @ z[:3], atol=1e-13)
    assert np.linalg.matrix_rank((T @ rng.standard_normal((T.shape[1], 12)))[:6]) == 5


@pytest.mark.parametrize(
    ("card", "what"),
    [
        ("RBAR,20,1,1,123456", "both ends are node 1"),
        ("RBAR,20,1,77,123456", "node 77 is not in the deck"),
        ("RBAR,20,1,2,12345", "5 independent motions"),
        ("RBAR,20,1,2,123,123", "do not hold a rigid body"),
        ("RBAR,20,1,2,123456,,1,123456", "node 1 is independent and dependent in component 1"),
        ("RBAR,20,1,2,1237", "components '1237'"),
        ("RBE1,20,1,123456", "has no UM"),
        ("RBE1,20,1,123456\n+,UM", "no dependent motion"),
        ("RBE1,20,1,123,2,123\n+,UM,3,123", "do not hold a rigid body"),
        ("RBE1,20,1,123456\n+,UM,3.5,123", "'3.5' is no node id"),
        ("RROD,20,1,2", "not one translation"),
        ("RROD,20,1,2,1,2", "not one translation"),
        ("RROD,20,1,2,4", "not one translation"),
        ("RROD,20,2,5,1", "across its line"),
        ("GRID,6,,1.,.2,0.3\nRROD,20,2,6,1", "its ends coincide"),
        ("RBE2,20,1,123456,2\nRBAR,20,3,4,123456", "rigid element id 20 stands twice"),
    ],
)
def test_bars_that_cannot_be_rigid_are_refused(read, card, what):
    with pytest.raises(DeckError, match=what) as caught:
        read(f"{grids_of(SYSTEMS[0])}GRID,5,,1.,1.2,.3\n{card}\n")
    assert caught.value.where
    assert caught.value.remedy
