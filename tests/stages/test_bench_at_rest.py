"""Statics, modes and state space of a bench by their commands, and equilibria that nothing would stay in."""

from __future__ import annotations

import numpy as np
import pytest

from ..models import ended
from ..robustness.small import BENCH

G = 9.81
ARM = """
kind: bench
name: own
bodies:
  arm: {type: rigid, mass: 2.0, centre: [0.5, 0, 0], inertia: {xx: 0.1, yy: 0.3, zz: 0.3}, pose: {POSE}}
frames: {wall: {body: ground}, end: {body: arm}, tip: {body: arm, pose: {origin: [1.0, 0, 0]}}}
joints: {pivot: {type: revolute, frames: [wall, end], axis: y}}
forces:
  weight: {type: gravity}
  oil: {type: torsion, frames: [wall, end], axis: y, stiffness: 0.0, damping: 0.4}
  push: {type: force, frame: tip, direction: [1, 0, 0], signal: {type: constant, value: 0.0}}
sensors: {tip: {type: motion, frame: tip}, hold: {type: reaction, joint: pivot}}
simulate: {duration: 0.1, time_step: 0.01}
"""
DOWN, UP = "x_axis: [0, 0, -1]", "x_axis: [0, 0, 1]"
J, OMEGA = 0.3 + 2 * 0.25, np.sqrt(2 * G * 0.5 / 0.8)


def found(stage, text, *changes):
    return ended(stage, text, *changes).artefact(stage)


def test_statics_reports_where_a_bench_hangs_and_what_its_joint_carries():
    """Sideways load F: it hangs along the resultant, whatever `start` says."""
    text = ARM.replace("POSE", DOWN).replace("value: 0.0", "value: 5.0").replace("0.01}", "0.01, start: as_given}")
    rest = found("statics", text)
    along = np.array([5.0, 0, -0.5 * 2 * G])  # the weight acts at half the arm
    along /= np.linalg.norm(along)
    np.testing.assert_allclose(rest["/frames/tip/position"], along, atol=1e-9)
    np.testing.assert_allclose(rest["/reactions/pivot"], [-5.0, 0, 2 * G, 0, 0, 0], atol=1e-8)
    np.testing.assert_allclose(rest["/sensors/hold"], rest["/reactions/pivot"])
    assert rest.summary["growth"] == 0


def test_modes_have_the_frequency_the_damping_and_the_shape_of_the_pendulum():
    own = found("modes", ARM.replace("POSE", DOWN))
    np.testing.assert_allclose(own["/frequency"], [OMEGA / (2 * np.pi)], rtol=1e-9)
    np.testing.assert_allclose(own["/damping"], [0.4 / (2 * J * OMEGA)], rtol=1e-9)
    turn, moved = own["/frames/tip/rotation"][0], own["/frames/tip/displacement"][0]
    assert abs(turn[1]) == pytest.approx(1 / np.sqrt(J), rel=1e-9)  # unit mass
    np.testing.assert_allclose(moved, np.cross(turn, [0, 0, -1.0]), atol=1e-12)


def test_the_state_space_answers_a_load_as_the_pendulum_does():
    """G(iω) = L²/(J(ω₀² − ω²) + iωc) of the tip along the load, from modes.npz alone."""
    own = np.load(ended("modes", ARM.replace("POSE", DOWN)).folder / "modes.npz")
    assert list(own["inputs"]) == ["push"]
    assert list(own["outputs"]) == ["tip 1", "tip 2", "tip 3"]
    for w in (0.0, 2.0, 7.0):
        x = np.linalg.solve(1j * w * np.eye(2) - own["A"], own["B"])
        exact = 1.0 / (J * (OMEGA**2 - w**2) + 1j * w * 0.4)
        np.testing.assert_allclose(own["C"] @ x + own["D"], [[exact], [0], [0]], atol=1e-9)


@pytest.mark.parametrize("stage", ["simulate", "statics"])
def test_a_pendulum_on_its_head_is_refused_until_it_is_allowed(stage):
    text = ARM.replace("POSE", UP)
    done = ended(stage, text)
    assert done.code == 2
    assert "the equilibrium is unstable: a deviation of 'arm' from the equilibrium grows by a factor of 2.7" in done.output
    assert "simulate.allow_unstable: true" in done.output
    done = ended(stage, text, "simulate.allow_unstable=true")
    assert done.code == 0, done.output


def test_modes_of_what_topples_report_it():
    own = found("modes", ARM.replace("POSE", UP))
    assert own["/growth"] == pytest.approx(-0.2 / J + np.sqrt((0.2 / J) ** 2 + OMEGA**2), rel=1e-9)
    assert own.summary["toppling"] == 1


def test_gauges_of_a_sensor_are_placed_first_where_it_takes_them_from_there():
    """The small bench, linear: the state space answers a constant load with what statics reads of it, of the same gauges."""
    text = BENCH.replace("type: sine, frequency: 2.0, amplitude: 100.0", "type: constant, value: 10.0")
    text = text.replace("name: bench", "name: own")
    quick = ("place.random=0", "place.certificate=false", "place.pool=4", "place.keep=2")
    read = found("statics", text, *quick)["/sensors/gauges"]
    state = found("modes", text, *quick)
    A, B, C = (state[f"/system/{name}"] for name in "ABC")
    np.testing.assert_allclose(-C @ np.linalg.solve(A, B[:, 0]) * 10.0, read, rtol=1e-6)


def test_statics_holds_a_drive_that_moves_at_the_start():
    """p = p₀ cos ωt has p̈ = −ω²p₀ at t = 0: the torque on a bench at rest is that of the weight alone."""
    away, signal = (
        [float(np.sin(0.2)), 0, -float(np.cos(0.2))],
        "{type: sine, frequency: 2, amplitude: 0.2, phase: PHASE}",
    )
    motor = f"motor: {{type: driven_angle, frames: [turned, end], axis: y, drive: {{signal: {signal}}}}}"
    text = ARM.replace("POSE", DOWN).replace("axis: y}}\nforces", f"axis: y}}, {motor}}}\nforces")
    text = text.replace("PHASE", repr(np.pi / 2)).replace(
        "{wall:", f"{{turned: {{body: ground, pose: {{x_axis: {away}}}}}, wall:"
    )
    text = text.replace("{tip:", "{felt: {type: acceleration, frame: tip, axes: global}, tip:")
    rest = found("statics", text)
    np.testing.assert_allclose(rest["/drives/motor"], 0.0, atol=1e-6)
    np.testing.assert_allclose(rest["/reactions/pivot"][:3], [0, 0, 2 * G], atol=1e-6)
    np.testing.assert_allclose(rest["/sensors/felt"], [0, 0, G], atol=1e-6)
