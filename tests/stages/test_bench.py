"""A bench from its config: the example with its flexible hub and bearing, a pendulum, and what is refused."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.linalg import eigh

from strainsight.errors import StrainsightError
from strainsight.experiment.bench.reduction import body_damping
from strainsight.fem.affine import AffineOperator
from strainsight.rom.craig_bampton import CraigBampton
from strainsight.rom.model import Damping

from ..models import ended
from .conftest import BENCHES, ROOT, made

SHORT, MOVED = "simulate.duration=0.05", ("import", "reduce", "simulate")
PENDULUM = """
kind: bench
name: pendulum
bodies:
  bob: {type: rigid, mass: 2.0, inertia: {xx: 1.0e-9, yy: 1.0e-9, zz: 1.0e-9}, pose: {origin: [SINE, 0, COSINE]}}
frames:
  pivot: {body: ground, pose: {x_axis: [0, 1, 0], y_axis: [1, 0, 0]}}
  hinge: {body: bob, pose: {origin: [-SINE, 0, MINUS], x_axis: [0, 1, 0], y_axis: [1, 0, 0]}}
  centre: {body: bob}
joints:
  hinge: {type: revolute, frames: [pivot, hinge], axis: x}
forces:
  weight: {type: gravity, acceleration: [0, 0, -10.0]}
sensors:
  bob: {type: motion, frame: hinge}
  rate: {type: motion, frame: centre, quantity: velocity}
  up: {type: motion, frame: centre, quantity: z_axis}
simulate: {duration: 1.0, time_step: 5.0e-4, start: as_given}
"""


def pendulum(angle: float, **changes: str) -> str:
    """A point mass on a massless rod of 1 m, held at an angle from the vertical."""
    sine, cosine = float(np.sin(angle)), float(np.cos(angle))
    text = PENDULUM.replace("COSINE", repr(-cosine)).replace("MINUS", repr(cosine)).replace("SINE", repr(sine))
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    return text


def test_hub_bearing_and_blade_have_25_coordinates_and_hold_seven_constraints(bench):
    summary = bench["simulate"].summary
    assert (summary["coordinates"], summary["constraints"]) == (25, 7)
    assert summary["violation"] < 1e-13
    assert summary["violation_rate"] < 1e-13


def test_at_the_start_the_bearing_carries_weight_and_loads(bench):
    """Statics: the blade is in equilibrium under its weight, the loads at 15 m, and what the bearing gives."""
    simulate = bench["simulate"]
    u = np.array([simulate[f"/inputs/F{axis}"][0] for axis in "xyz"])
    weight = np.array([0.0, 0.0, -1.4e4 * 9.81])
    force = u + weight
    moment = np.cross([15.0, 0, 0], u) + np.cross([17.0, 0, 0], weight)
    load = simulate["/bearings/bearing/load"][0]
    # the axes of the flange turn by 3e-4 as the hub gives way
    np.testing.assert_allclose(load[:3], force, atol=1e-3 * np.linalg.norm(force))
    np.testing.assert_allclose(load[3:], moment[1:], atol=1e-3 * np.linalg.norm(moment))


def test_the_relative_sensor_is_the_displacement_of_the_bearing(bench):
    simulate = bench["simulate"]
    np.testing.assert_array_equal(simulate["/sensors/relative"], simulate["/bearings/bearing/displacement"])


def test_a_pendulum_swings_with_the_period_of_its_length():
    """T = 2π √(L/g) at small angles: a quarter of it after the start the bob is at the bottom."""
    angle = 0.05
    simulate = ended("simulate", pendulum(angle)).artefact("simulate")
    # the first three coordinates are the bob's place
    x, time = simulate["/q"][:, 0], simulate["/time"]
    crossing = time[np.argmax(x < 0)]
    assert crossing == pytest.approx(np.pi / 2 * np.sqrt(0.1), rel=3e-3)
    rate, step = simulate["/sensors/rate"], time[1] - time[0]
    # central differences are off by a sixth of h² times the jerk
    jerk = np.abs(np.diff(x, 3)).max() / step**3
    np.testing.assert_allclose(rate[1:-1, 0], (x[2:] - x[:-2]) / (2 * step), rtol=0, atol=jerk * step**2 / 3)
    np.testing.assert_allclose(np.linalg.norm(simulate["/sensors/up"], axis=1), 1.0, atol=1e-12)
    assert simulate.summary["first_frequency"] == pytest.approx(np.sqrt(10.0 * np.cos(angle)) / (2 * np.pi), rel=2e-3)


def test_gauges_may_be_zeroed_at_the_start(bench, bench_config):
    changes = ("simulate.duration=0.1", "sensors.gauges.zeroed=true")
    zeroed = made(bench_config, *changes, only=MOVED, beside=BENCHES)["simulate"]
    plain = bench["simulate"]["/sensors/gauges"][:11]
    np.testing.assert_array_equal(zeroed["/sensors/gauges"], plain - plain[0])


def test_rings_that_face_away_from_each_other_are_refused(bench_config):
    """Turned by 180° about z the displacements look small; the model does not hold."""
    with pytest.raises(StrainsightError, match=r"differ in direction by 3\.14 rad") as refused:
        made(bench_config, "bodies.blade.pose.x_axis=[-1, 0, 0]", SHORT, only=MOVED, beside=BENCHES)
    assert refused.value.key == "forces.bearing"


def test_a_frame_at_a_node_without_rotations_is_blamed_on_the_frame():
    text = "kind: bench\nname: beam\nbodies:\n  beam: {type: flexible, damping: {type: modal, ratio: 0.01}, "
    text += f"mesh: {{file: {ROOT / 'meshes' / 'cantilever-coarse.bdf'}}}}}\n"
    text += "frames:\n  tip: {body: beam, node: 705}\nsimulate: {duration: 1.0, time_step: 0.1}\n"
    done = ended("run", text)
    assert done.code == 2
    assert "own.yaml:6:27  frames.tip.node" in done.stderr
    assert "node 705 has no rotations" in done.stderr


FORCED = "push: {type: force, frame: pivot, direction: [1, 0, 0], signal: {type: constant, value: 1.0}}"
TURNED = "x_axis: [0, 1, 0], y_axis: [1, 0, 0]}}\n  centre"


@pytest.mark.parametrize(
    ("changes", "key", "says"),
    [
        ({"time_step: 5.0e-4": "time_step: 5.0"}, "simulate.time_step", "0.2 times the time step"),
        ({"duration: 1.0": "duration: 1.0003"}, "simulate.time_step", ""),
        ({TURNED: TURNED.replace("[1, 0", "[0, 2")}, "frames.hinge", "parallel"),
        ({TURNED: TURNED.replace("[0, 1", "[0, -1")}, "joints.hinge", "opposite"),  # constraints hold for half a turn, too
        ({"pose: {origin: [0.2": "spin: [0, 1, 0], pose: {origin: [0.2"}, "bodies.bob.velocity", "100 %"),
        ({"start: as_given": "start: equilibrium", "pose: {origin: [0.2": "spin: [0, 1, 0], pose: {origin: [0.2"},
         "bodies.bob.spin", ""),
        ({"simulate:": "cases: {a: {force: [1, 2, 3]}}\nsimulate:"}, "cases", ""),
        ({"weight: {type": f"{FORCED}\n  weight: {{type"}, "forces.push.frame", ""),
    ],
)  # fmt: skip
def test_what_cannot_be_or_would_be_dropped_in_silence_is_refused_with_its_place(changes, key, says):
    done = ended("run", pendulum(0.3, **changes))
    assert done.code == 2, done.output
    assert key in done.stderr
    assert says in done.stderr
    assert "own.yaml:" in done.stderr


@pytest.mark.parametrize("law", [Damping("modal", ratio=0.05), Damping("rayleigh", alpha=3.0, beta=1e-4)])
def test_damping_is_that_of_the_free_modes_of_a_free_body(law):
    """Three masses on two springs, the first one the interface: ζ of each mode that deforms it, nothing on its drift."""
    K = 1e4 * np.array([[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]])
    M = np.diag([1.0, 2.0, 1.5])
    body = CraigBampton(AffineOperator(K, {}), M, np.eye(3), {1: np.eye(6, 3)}, np.zeros(0), np.inf)
    C = body_damping(body, law, {}, 1).constant
    np.testing.assert_allclose(C @ np.ones(3), 0.0, atol=1e-9)
    lam, Phi = eigh(K, M)
    omega = np.sqrt(lam[1:])
    ratio = np.full(2, 0.05) if law.kind == "modal" else 0.5 * (3.0 / omega + 1e-4 * omega)
    np.testing.assert_allclose(np.diag(Phi.T @ C @ Phi)[1:], 2 * ratio * omega, rtol=1e-9)


def test_a_slow_mode_with_a_stiff_residual_vector_is_damped():
    """Eigenvalues 1 and 1e11 (rad/s)² of a held body: neither is rigid."""
    lam = np.array([1.0, 1e11])
    body = CraigBampton(AffineOperator(np.diag(lam), {}), np.eye(2), np.eye(2), {}, np.array([1.0]), 5.0)
    C = body_damping(body, Damping("modal", ratio=0.05), {}, 0).constant
    np.testing.assert_allclose(C, np.diag(0.1 * np.sqrt(lam)), rtol=1e-9)


def test_a_body_that_turns_fast_for_its_step_is_warned_of():
    """A free rotor at 40 rad/s. Implicit Euler, h = 5e-4 s: dω/dt = −ω³h/2 takes 25 % in the first second; second order,
    h = 5 ms: it lags by a share of its angle, and its spin grows."""
    text = "kind: bench\nname: rotor\nbodies:\n"
    text += "  r: {type: rigid, mass: 1.0, inertia: {xx: 1.0, yy: 1.0, zz: 1.5}, spin: [0, 0, 40.0]}\n"
    text += "frames:\n  f: {body: r}\nsimulate: {duration: 1.0, time_step: 5.0e-4, start: as_given, method: thesis}\n"
    first, second = (
        ended("simulate", text, *changes) for changes in ((), ("simulate.method=second_order", "simulate.time_step=5e-3"))
    )
    spin, other = (
        np.linalg.norm(done.artefact("simulate")["/v"][:, 3:12], axis=1) / np.sqrt(2) for done in (first, second)
    )
    assert f"by {100 * (1 - spin[-1] / spin[0]):.2g} % in the first second" in first.text
    q = second.artefact("simulate")["/q"]
    lag = 1 - np.arctan2(q[5, 4], q[5, 3]) / (40.0 * 0.025)
    shares = re.search(r"lags by ([\d.]+) % of its angle and gains ([\d.]+) % of its speed per second", second.text)
    assert [float(share) for share in shares.groups()] == pytest.approx([100 * lag, 100 * (other[-1] / 40 - 1)], rel=0.05)
