"""The model on its free motions, and the loads on it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import DeckError, UserError
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.mesh.forces import NodalForces
from strainsight.mesh.joins import PointMass, RigidElement


@pytest.fixture(scope="module")
def bar(box):
    """A bar with a rigid tip whose reference node 100 carries 3 kg."""
    mesh = box("hex20", (4, 1, 1), size=(4.0, 1.0, 1.0), clamp_root=True)
    tip = np.flatnonzero(np.isclose(mesh.position[:, 0], 4.0))
    n = len(mesh.position)
    return replace(
        mesh,
        node_ids=np.append(mesh.node_ids, 1000),
        position=np.vstack([mesh.position, [4.0, 0.5, 0.5]]),
        rigid=(RigidElement(1, n, tip, (0, 1, 2)),),
        point_masses=(PointMass(2, n, 3.0),),
        node_sets={"tip": mesh.node_ids[tip], "nothing": np.array([], dtype=np.int64)},
        loads={
            "FORCE-1": NodalForces(np.array([n, tip[0]]), np.array([[0.0, 3.0, 0.0], [0.0, 0.0, -4.0]])),
            "FORCE-2": NodalForces(tip[:2], np.array([[0.0, 3.0, 0.1], [0.0, -3.0, -0.1]])),
            "FORCE-3": NodalForces(np.flatnonzero(mesh.position[:, 0] == 0), np.ones((8, 3))),
        },
    )


def test_a_tip_force_does_the_work_of_its_displacement(bar):
    model = build_model(bar)
    loads = [
        PointLoad("x", (2.0, 0.0, 0.0), node_id=1000),
        PointLoad("set", (0.0, 0.0, 1.0), node_set="tip"),
        PointLoad("oblique", (1.0, 1.0, 0.0), node_id=1000),
    ]
    S = input_shape(model, loads)
    field = np.random.default_rng(0).normal(size=(model.size, 1))
    z = nodal(model, field).reshape(-1, 3)
    tip = np.isin(bar.node_ids, bar.node_sets["tip"])
    assert np.allclose((S.T @ field)[:, 0], [z[-1, 0], z[tip, 2].mean(), (z[-1, 0] + z[-1, 1]) / np.sqrt(2)])


def test_a_load_of_the_deck_has_a_unit_resultant_and_its_distribution(bar):
    model = build_model(bar)
    reference, node = bar.node_ids[bar.loads["FORCE-1"].nodes]
    parts = [PointLoad("a", (0, 1, 0), node_id=int(reference)), PointLoad("b", (0, 0, -1), node_id=int(node))]
    S = input_shape(model, [PointLoad("F", deck_load="FORCE-1"), *parts])
    assert np.allclose(S[:, 0], 0.6 * S[:, 1] + 0.8 * S[:, 2], rtol=0, atol=1e-15)


def test_constrained_mass_keeps_the_point_mass_and_the_body(bar):
    model = build_model(replace(bar, fixed=np.zeros((0, 2), dtype=np.int64)), supported=False)
    e = np.zeros(model.size)
    e[(model.constraint.free_rows < 3 * len(bar.position)) & (model.constraint.free_rows % 3 == 1)] = 1.0
    assert e @ model.mass.constant @ e == pytest.approx(4.0 * 7850.0 + 3.0, rel=1e-13)


@pytest.mark.parametrize(
    ("load", "message"),
    [
        (PointLoad("F", (0, 0, 1), node_id=77777), "node 77777, which is not there"),
        (PointLoad("F", (0, 0, 1), node_set="tips"), "node set 'tips', which is not there"),
        (PointLoad("F", (0, 0, 1), node_set="nothing"), "empty node set"),
        (PointLoad("F", (0, 0, 0), node_id=1000), "direction"),
        (PointLoad("F", (0, np.nan, 0), node_id=1000), "direction"),
        (PointLoad("F", (0, 0, 1), node_id=1), "node 1, which cannot move in its direction"),
        (PointLoad("F", (0, 0, 1)), "needs a node or a node set"),
        (PointLoad("F", (0, 0, 1), node_id=1, node_set="tip"), "needs a node or a node set"),
        (PointLoad("F", node_id=1, deck_load="FORCE-1"), "needs a node or a node set, or a load of the deck"),
        (PointLoad("F", node_id=1000), "direction"),
        (PointLoad("F", (0, 0, 1), deck_load="FORCE-1"), "direction"),
        (PointLoad("F", deck_load="FORCE-9"), "'FORCE-9' of the deck, which is not there"),
        (PointLoad("F", deck_load="FORCE-2"), "add up to nothing"),
        (PointLoad("F", deck_load="FORCE-3"), "cannot move"),
    ],
)
def test_loads_that_cannot_act_are_refused(bar, load, message):
    with pytest.raises(UserError, match=message):
        input_shape(build_model(bar), [load])


def test_a_mesh_with_nothing_to_move_is_refused(box):
    mesh = box("tet4", (1, 1, 1))
    with pytest.raises(DeckError, match="no elements"):
        build_model(replace(mesh, blocks=()))
    with pytest.raises(DeckError, match="every node is clamped"):
        build_model(replace(mesh, fixed=np.array([(i, c) for i in range(8) for c in range(3)])))


def test_forces_of_a_deck_on_clamped_nodes_are_reported_and_push_only_the_support(bar):
    root, tip = int(np.flatnonzero(bar.position[:, 0] == 0)[0]), len(bar.position) - 1
    both = NodalForces(np.array([root, tip]), np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 3.0]]))
    model = build_model(replace(bar, loads={"FORCE-4": both}))
    with pytest.warns(UserWarning, match=r"1 of its 2 nodes cannot move .* 25 % of its resultant"):
        S = input_shape(model, [PointLoad("F", deck_load="FORCE-4")])
    np.testing.assert_allclose(S, 0.75 * input_shape(model, [PointLoad("F", (0, 0, 1), node_id=1000)]), atol=1e-15)
