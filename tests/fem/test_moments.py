"""A moment as a load: by virtual work of rigid motions, and on a cantilever by beam theory and Saint-Venant's torsion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from strainsight.errors import UserError
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.misaligned import axes_across, misaligned_shape, misalignment_shapes
from strainsight.fem.model import build_model, nodal
from strainsight.mesh.joins import AveragingElement, RigidElement

from .test_misaligned import NU, B, E, G, H, L, torsion_constant

TIP, LOOSE, STIFF, MEAN = 10**6, "loose", "stiff", "mean"
END = PointLoad("M", node_set="END")
AT_TIP = PointLoad("M", node_id=TIP)


@pytest.fixture(scope="module")
def cantilever(box):
    """Clamped at x = 0, with the set END of its end, without a node that leads it, with a rigid and with an averaging one."""
    plain = box("hex20", (12, 3, 3), (L, B, H), clamp_root=True, material=(E, NU, 7850.0))
    end = np.flatnonzero(np.isclose(plain.position[:, 0], L))
    line = end[np.isclose(plain.position[end, 1], 0.0)]
    sets = {"END": plain.node_ids[end], "LINE": plain.node_ids[line], "ROOT": plain.node_ids[plain.position[:, 0] == 0]}
    plain = replace(plain, node_sets=sets)
    led = replace(
        plain, node_ids=np.append(plain.node_ids, TIP), position=np.vstack([plain.position, [L, B / 2, H / 2]])
    )
    rigid = replace(led, rigid=(RigidElement(1, len(plain.position), end, (0, 1, 2)),))
    mean = AveragingElement(1, len(plain.position), end, np.ones(len(end)), tuple(range(6)))
    return {LOOSE: build_model(plain), STIFF: build_model(rigid), MEAN: build_model(replace(led, averaging=(mean,)))}


def at_the_end(mesh):
    """Nodes of elements there."""
    return np.flatnonzero(np.isclose(mesh.position[:, 0], L) & (mesh.node_ids != TIP))


def about(load, axis):
    return replace(load, moment=tuple(axis))


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 2.0, 0.0), (1.0, -2.0, 3.0)])
@pytest.mark.parametrize(("where", "load"), [(LOOSE, END), (MEAN, AT_TIP)])
def test_a_unit_moment_does_its_work_on_rigid_turns_and_none_on_translations(cantilever, where, load, axis):
    """The forces are on nodes that are free; of the axis the length does not matter."""
    model = cantilever[where]
    S = input_shape(model, (about(load, axis),))[:, 0]
    T, x = model.constraint.transform, model.mesh.position
    # z of the free motions at which the end moves as a rigid body: their nodes are free, others do no work
    end = at_the_end(model.mesh)
    unit = np.array(axis) / np.linalg.norm(axis)
    for j, basis in enumerate(np.eye(3)):
        turned, moved = (np.zeros(T.shape[0]) for _ in range(2))
        for field, value in (
            (turned, np.cross(basis, x[end] - x[end].mean(axis=0))),
            (moved, np.tile(basis, (len(end), 1))),
        ):
            field[: 3 * len(x)].reshape(-1, 3)[end] = value
        pick = T[: 3 * len(x)]  # a selection: every free motion is one component of one node
        assert S @ (pick.T @ turned[: 3 * len(x)]) == pytest.approx(unit[j], abs=1e-12)
        assert S @ (pick.T @ moved[: 3 * len(x)]) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("where", "load"), [(LOOSE, END), (STIFF, AT_TIP), (MEAN, AT_TIP)])
def test_the_cantilever_bends_and_twists_by_beam_theory(cantilever, where, load):
    """θ = ML/EI about y and z, TL/GJ about x, of the mean turn of the end; the clamp holds back Poisson's contraction."""
    model = cantilever[where]
    stiffness = model.stiffness.at({}).tocsc()
    end = at_the_end(model.mesh)
    r = model.mesh.position[end] - [L, B / 2, H / 2]
    rigidity = (G * torsion_constant(), E * B * H**3 / 12, E * H * B**3 / 12)
    for axis, (own, unit) in enumerate(zip(rigidity, np.eye(3), strict=True)):
        S = input_shape(model, (about(load, unit),))[:, 0]
        u = nodal(model, spsolve(stiffness, S)[:, None]).reshape(-1, 3)[end]
        # least squares of u = ω × r
        A = np.concatenate([np.stack([np.cross(e, r[i]) for e in np.eye(3)], axis=1) for i in range(len(r))])
        omega = np.linalg.lstsq(A, (u - u.mean(axis=0)).ravel(), rcond=None)[0]
        assert omega[axis] == pytest.approx(L / own, rel=0.04)
        assert np.abs(np.delete(omega, axis)).max() < 1e-6 * abs(omega[axis])


@pytest.mark.parametrize(("where", "load"), [(LOOSE, END), (STIFF, AT_TIP)])
def test_a_moment_that_is_off_turns_and_is_the_same_wherever_it_acts(cantilever, where, load):
    model, unit = cantilever[where], np.array([1.0, 2.0, -1.0]) / np.sqrt(6)
    own = about(load, unit)
    off = misalignment_shapes(model, (own,))[:, 0]
    whole = np.column_stack([input_shape(model, (about(load, e),))[:, 0] for e in np.eye(3)])
    for i, axis in enumerate(axes_across(unit)):
        np.testing.assert_allclose(off[:, i], whole @ np.cross(axis, unit), atol=1e-12 * np.abs(whole).max())
        step = 1e-5 * np.eye(2)[i]
        central = (
            misaligned_shape(model, own, step, np.zeros(2)) - misaligned_shape(model, own, -step, np.zeros(2))
        ) / 2e-5
        np.testing.assert_allclose(off[:, i], central, atol=1e-8 * np.abs(whole).max())
    assert not off[:, 2:].any()
    np.testing.assert_array_equal(
        misaligned_shape(model, own, np.zeros(2), np.array([0.01, 0.0])),
        misaligned_shape(model, own, np.zeros(2), np.zeros(2)),
    )


@pytest.mark.parametrize(
    ("load", "axis"),
    [(PointLoad("M", node_set="LINE"), (0, 0, 1)), (PointLoad("M", node_set="ROOT"), (0, 1, 0))],
)
def test_nodes_that_cannot_exert_the_moment_are_refused(cantilever, load, axis):
    with pytest.raises(UserError, match="cannot exert its moment") as caught:
        input_shape(cantilever[LOOSE], (about(load, axis),))
    assert "RBE2 or RBE3" in caught.value.remedy
    # two axes across the line are no trouble
    assert input_shape(cantilever[LOOSE], (about(PointLoad("M", node_set="LINE"), (0, 1, 0)),)).any()


def test_a_line_of_nodes_exerts_what_it_can_of_a_moment_that_turns_towards_it(cantilever):
    """Along z: a moment about y turns towards x, which it exerts as well, or towards z, of which it has nothing."""
    model, line = cantilever[LOOSE], PointLoad("M", node_set="LINE")
    own, whole = about(line, (0, 1, 0)), input_shape(model, (about(line, (0, 1, 0)), about(line, (1, 0, 0))))
    off = misalignment_shapes(model, (own,))[:, 0]
    towards = [np.cross(axis, (0, 1, 0)) for axis in axes_across(np.array([0.0, 1.0, 0.0]))]
    np.testing.assert_allclose(off[:, :2], np.outer(whole[:, 1], [unit[0] for unit in towards]), atol=1e-12)
    for i, unit in enumerate(towards):
        turned = misaligned_shape(model, own, 0.1 * np.eye(2)[i], np.zeros(2))
        expected = np.cos(0.1) * whole[:, 0] + np.sin(0.1) * unit[0] * whole[:, 1]
        np.testing.assert_allclose(turned, expected, atol=1e-12 * np.abs(whole).max())
