"""Misaligned forces, and moments, on a cantilever by beam theory and by statics."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.sparse.linalg import spsolve

from strainsight.errors import UserError
from strainsight.fem.loads import PointLoad, axes_across, input_shape, misaligned_shape, misalignment_shapes
from strainsight.fem.model import build_model
from strainsight.mesh.joins import AveragingElement, NodalForces, RigidElement

from ..bodies import with_nodes

L, B, H = 2.0, 0.25, 0.19
E, NU, RHO = 2.1e11, 0.3, 7850.0
G = E / (2 * (1 + NU))
MILLIMETRE = 1e-3
TIP = 10**6


def torsion_constant():
    """Saint-Venant's series of a rectangle."""
    n = np.arange(1, 60, 2)
    return B * H**3 * (1 / 3 - 64 / np.pi**5 * H / B * np.sum(np.tanh(n * np.pi * B / (2 * H)) / n**5))


def skew(axis):
    return np.cross(np.eye(3), axis)


def nodes_at_the_tip(mesh):
    """Nodes of elements there."""
    return np.flatnonzero(np.isclose(mesh.position[:, 0], L) & (mesh.node_ids != TIP))


LOOSE, STIFF, MEAN = "loose", "stiff", "mean"
END = PointLoad("M", node_set="END")
AT_TIP = PointLoad("M", node_id=TIP)


@pytest.fixture(scope="module")
def ended(box):
    """Clamped at x = 0, with sets of its end, a line of it and its root: without a node that leads the end, with a rigid and with
    an averaging one."""
    plain = box("hex20", (16, 4, 4), (L, B, H), clamp_root=True, material=(E, NU, RHO))
    end = nodes_at_the_tip(plain)
    line = end[np.isclose(plain.position[end, 1], 0.0)]
    sets = {"END": plain.node_ids[end], "LINE": plain.node_ids[line], "ROOT": plain.node_ids[plain.position[:, 0] == 0]}
    plain = replace(plain, node_sets=sets)
    led = with_nodes(plain, [L, B / 2, H / 2], ids=[TIP])
    rigid = replace(led, rigid=(RigidElement(1, len(plain.position), end, (0, 1, 2)),))
    mean = AveragingElement(1, len(plain.position), end, np.ones(len(end)), tuple(range(6)))
    return {LOOSE: build_model(plain), STIFF: build_model(rigid), MEAN: build_model(replace(led, averaging=(mean,)))}


def test_a_shifted_tip_force_twists_and_bends_the_beam_by_its_moment(ended):
    """φ = F δ L/GJ of a shift across the beam, F δ L/EI of one along it; the root, which cannot warp, stiffens by 1 %."""
    model, load = ended[STIFF], PointLoad("tip", (0, 0, 1.0), TIP)
    axes, row = axes_across(np.array([0.0, 0.0, 1.0])), model.constraint.reference_rows[model.mesh.node_index(TIP)]

    def rotation(shift):
        S = misaligned_shape(model, load, np.zeros(2), shift) - input_shape(model, [load])[:, 0]
        return model.constraint.transform[row : row + 3] @ spsolve(model.stiffness.constant.tocsc(), S)

    for axis, shift in zip(axes, 2 * MILLIMETRE * np.eye(2), strict=True):
        moment = np.cross(2 * MILLIMETRE * axis, [0, 0, 1.0])
        found = rotation(shift)
        np.testing.assert_allclose(found[0], moment[0] * L / (G * torsion_constant()), rtol=0.015, atol=1e-16)
        np.testing.assert_allclose(found[1], moment[1] * L / (E * B * H**3 / 12), rtol=0.015, atol=1e-16)


@pytest.mark.parametrize("where", [{"node_set": "END"}, {"node_set": "MIDDLE"}, {"deck_load": "any"}])
def test_force_and_moment_are_those_of_the_turned_and_shifted_load(box, where):
    """R Σf, and Σ r × R f + δ × R Σf, on a body that nothing holds, where the free motions are those of the nodes."""
    mesh = box("hex8", (3, 2, 2), (L, B, H))
    end = nodes_at_the_tip(mesh)
    forces = NodalForces(np.r_[0, end[:3], end[:1]], np.random.default_rng(1).standard_normal((5, 3)))
    mesh = replace(mesh, node_sets={"END": mesh.node_ids[end], "MIDDLE": mesh.node_ids[end[4:5]]}, loads={"any": forces})
    model = build_model(mesh, supported=False)
    load = PointLoad("F", None if "deck_load" in where else (0.3, -1.0, 0.4), **where)
    turn, shift = np.array([0.2, -0.5]), np.array([0.03, 0.01])
    f = input_shape(model, [load])[:, 0].reshape(-1, 3)
    whole = f.sum(axis=0)
    assert np.linalg.norm(whole) == pytest.approx(1.0)
    axes = axes_across(whole)
    np.testing.assert_allclose(np.vstack([axes, whole]) @ np.vstack([axes, whole]).T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(np.cross(*axes), whole, atol=1e-14)
    R = expm(skew(turn @ axes))
    off = misaligned_shape(model, load, turn, shift).reshape(-1, 3)
    np.testing.assert_allclose(off.sum(axis=0), R @ whole, atol=1e-12)
    moment = np.cross(mesh.position, f @ R.T).sum(axis=0) + np.cross(shift @ axes, R @ whole)
    np.testing.assert_allclose(np.cross(mesh.position, off).sum(axis=0), moment, atol=1e-12)


def test_a_set_takes_the_couple_with_the_least_forces(box):
    """Of all forces of a couple without resultant on the nodes the least, by a least-norm solution; as an RBE3 does."""
    mesh = box("hex8", (3, 2, 3), (L, B, H))
    end = nodes_at_the_tip(mesh)
    model = build_model(replace(mesh, node_sets={"END": mesh.node_ids[end]}), supported=False)
    load = PointLoad("F", (0.3, -1.0, 0.4), node_set="END")
    shift = np.array([0.03, 0.01])
    plain = input_shape(model, [load])[:, 0]
    found = (misaligned_shape(model, load, np.zeros(2), shift) - plain).reshape(-1, 3)
    d = plain.reshape(-1, 3).sum(axis=0)
    equations = np.vstack([np.tile(np.eye(3), len(end)), np.hstack([skew(x) for x in mesh.position[end]])])
    least = np.linalg.lstsq(equations, np.r_[0, 0, 0, np.cross(shift @ axes_across(d), d)], rcond=None)[0]
    np.testing.assert_allclose(found[end].ravel(), least, atol=1e-12)
    assert not np.delete(found, end, axis=0).any()
    e = AveragingElement(1, len(mesh.position), end, np.ones(len(end)), tuple(range(6)))
    with_reference = replace(with_nodes(mesh, mesh.position[end].mean(axis=0), ids=[TIP]), averaging=(e,))
    by_reference = build_model(with_reference, supported=False)
    at_reference = misaligned_shape(by_reference, PointLoad("F", (0.3, -1.0, 0.4), TIP), np.zeros(2), shift)
    np.testing.assert_allclose(at_reference.reshape(-1, 3), found + plain.reshape(-1, 3), atol=1e-12)


@pytest.mark.parametrize("load", [PointLoad("F", (1.0, 0.2, 0.3), TIP), PointLoad("F", (0, 0.2, -0.3), node_set="END")])
def test_the_slopes_are_those_of_small_misalignments(ended, load):
    model, h = ended[STIFF if load.node_id else LOOSE], 1e-5
    found = misalignment_shapes(model, [load])[:, 0]
    for k, step in enumerate(h * np.eye(4)):
        ends = [misaligned_shape(model, load, s * step[:2], s * step[2:]) for s in (1, -1)]
        np.testing.assert_allclose(found[:, k], (ends[0] - ends[1]) / (2 * h), atol=1e-9 * np.abs(found[:, k]).max())
    none = misaligned_shape(model, load, np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(none, input_shape(model, [load])[:, 0], rtol=1e-12, atol=1e-15)


def test_nodes_in_a_line_take_no_couple_about_it(box):
    mesh = box("hex8", (3, 2, 2), (L, B, H))
    pair = [i for i in nodes_at_the_tip(mesh) if np.isclose(mesh.position[i, 2], 0) and mesh.position[i, 1] % B < 1e-12]
    assert len(pair) == 2
    model = build_model(replace(mesh, node_sets={"PAIR": mesh.node_ids[pair]}), supported=False)
    load = PointLoad("F", (1.0, 0, 0), node_set="PAIR")
    slopes = misalignment_shapes(model, [load])[:, 0, 2:].reshape(-1, 3, 2)
    for axis, own in zip(axes_across(np.array([1.0, 0, 0])), np.moveaxis(slopes, 2, 0), strict=True):
        moment = np.cross(axis, [1.0, 0, 0])
        moment[1] = 0.0  # the line is along y
        np.testing.assert_allclose(np.cross(mesh.position, own).sum(axis=0), moment, atol=1e-12)


def about(load, axis):
    return replace(load, moment=tuple(axis))


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.0, 2.0, 0.0), (1.0, -2.0, 3.0)])
@pytest.mark.parametrize(("where", "load"), [(LOOSE, END), (MEAN, AT_TIP)])
def test_forces_of_a_unit_moment_have_that_moment_and_no_resultant(ended, where, load, axis):
    model = ended[where]
    S = input_shape(model, (about(load, axis),))[:, 0]
    x, end = model.mesh.position, nodes_at_the_tip(model.mesh)
    # of the nodes of elements T is a selection: every free motion is one component of one of them
    forces = (model.constraint.transform[: 3 * len(x)] @ S).reshape(-1, 3)[end]
    np.testing.assert_allclose(forces.sum(axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.cross(x[end], forces).sum(axis=0), np.array(axis) / np.linalg.norm(axis), atol=1e-12)


@pytest.mark.parametrize(("where", "load"), [(LOOSE, END), (STIFF, AT_TIP)])
def test_a_moment_that_is_off_turns_and_is_the_same_wherever_it_acts(ended, where, load):
    model, unit = ended[where], np.array([1.0, 2.0, -1.0]) / np.sqrt(6)
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
def test_nodes_that_cannot_exert_the_moment_are_refused(ended, load, axis):
    with pytest.raises(UserError, match="100 % of the moment cannot be applied to") as caught:
        input_shape(ended[LOOSE], (about(load, axis),))
    assert "RBE2 or RBE3" in caught.value.remedy
    # two axes across the line are no trouble
    assert input_shape(ended[LOOSE], (about(PointLoad("M", node_set="LINE"), (0, 1, 0)),)).any()


def test_a_line_of_nodes_exerts_what_it_can_of_a_moment_that_turns_towards_it(ended):
    """Along z: a moment about y turns towards x, which it exerts as well, or towards z, of which it has nothing."""
    model, line = ended[LOOSE], PointLoad("M", node_set="LINE")
    own, whole = about(line, (0, 1, 0)), input_shape(model, (about(line, (0, 1, 0)), about(line, (1, 0, 0))))
    off = misalignment_shapes(model, (own,))[:, 0]
    towards = [np.cross(axis, (0, 1, 0)) for axis in axes_across(np.array([0.0, 1.0, 0.0]))]
    np.testing.assert_allclose(off[:, :2], np.outer(whole[:, 1], [unit[0] for unit in towards]), atol=1e-12)
    for i, unit in enumerate(towards):
        turned = misaligned_shape(model, own, 0.1 * np.eye(2)[i], np.zeros(2))
        expected = np.cos(0.1) * whole[:, 0] + np.sin(0.1) * unit[0] * whole[:, 1]
        np.testing.assert_allclose(turned, expected, atol=1e-12 * np.abs(whole).max())
