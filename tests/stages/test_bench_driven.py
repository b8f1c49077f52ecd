"""A bench that moves by drives, from its config: against closed forms, or refused with its place."""

from __future__ import annotations

import numpy as np
import pytest

from .test_bench_connections import run, simulated

MASS, ARM, CENTRAL, G = 2.0, 0.5, 0.3, 9.81
UP = np.array([0, 0, G])
TURN = -7.0
"""[rad] about y, in two seconds: more than a whole turn."""
PENDULUM = """
bodies:
  arm: {type: rigid, mass: 2.0, centre: [0.5, 0, 0], inertia: {xx: 0.1, yy: 0.3, zz: 0.3}}
frames: {wall: {body: ground}, end: {body: arm}, tip: {body: arm, pose: {origin: [1.0, 0, 0]}}}
joints:
  pivot: {type: revolute, frames: [wall, end], axis: y}
  motor: {type: driven_angle, frames: [wall, end], axis: y, drive: {signal: {type: ramp, end: -7.0, duration: 2.0}}}
forces: {weight: {type: gravity}}
sensors:
  tip: {type: motion, frame: tip}
  felt: {type: acceleration, frame: tip}
  moved: {type: acceleration, frame: tip, axes: global, gravity: false}
  hold: {type: reaction, joint: pivot}
simulate: {duration: 2.0, time_step: 0.02}
"""


def ramp(time):
    """p, ṗ, p̈ of the motor."""
    s = time / 2.0
    return (
        TURN * (10 * s**3 - 15 * s**4 + 6 * s**5),
        TURN / 2 * 30 * s**2 * (1 - s) ** 2,
        TURN / 4 * 60 * s * (1 - s) * (1 - 2 * s),
    )


def test_an_arm_turned_by_its_motor_is_where_it_is_turned_to_and_costs_the_torque_that_it_weighs():
    """About y a positive angle lowers the tip: T = J p̈ − m g a cos p; the joint carries m (a − g); the tip feels a − g."""
    found = simulated(PENDULUM)
    time = found["/time"]
    p, rate, second = ramp(time)
    along, across = (np.column_stack(x) for x in ((np.cos(p), 0 * p, -np.sin(p)), (-np.sin(p), 0 * p, -np.cos(p))))
    np.testing.assert_allclose(found["/sensors/tip"], along, atol=1e-12)
    accelerated = second[:, None] * across - (rate**2)[:, None] * along
    np.testing.assert_allclose(found["/sensors/moved"], accelerated, atol=1e-9)
    felt = accelerated + UP
    own = np.column_stack([np.sum(felt * along, axis=1), 0 * p, -np.sum(felt * across, axis=1)])
    np.testing.assert_allclose(found["/sensors/felt"], own, atol=1e-9)
    torque = (CENTRAL + MASS * ARM**2) * second - MASS * G * ARM * np.cos(p)
    np.testing.assert_allclose(found["/drives/motor/force"], torque, atol=1e-8)
    np.testing.assert_allclose(found["/drives/motor/position"], p, atol=1e-14)
    held = MASS * (ARM * accelerated + UP)
    np.testing.assert_allclose(found["/sensors/hold"], np.hstack([held, 0 * held]), atol=1e-8)


def test_an_angle_from_a_file_is_followed_through_its_samples():
    time = np.linspace(0, 2, 41)
    angle = 0.4 * np.sin(3 * time) / (np.pi / 180)
    lines = ["time,p [deg]", *(f"{t!r},{a!r}" for t, a in zip(time.tolist(), angle.tolist(), strict=True))]
    signal = "{type: csv, file: p.csv, time_column: time, value_column: p}"
    found = simulated(PENDULUM.replace("{type: ramp, end: -7.0, duration: 2.0}", signal), **{"p.csv": "\n".join(lines)})
    p = 0.4 * np.sin(3 * found["/time"])
    np.testing.assert_allclose(found["/sensors/tip"][:, [0, 2]], np.column_stack([np.cos(p), -np.sin(p)]), atol=1e-5)


def test_a_cylinder_lifts_a_flap_to_the_angle_of_its_triangle():
    """Law of cosines: |d|² = a² + b² − 2ab cos, pivot, foot of the cylinder and eye."""
    found = simulated(
        """
bodies: {flap: {type: rigid, mass: 5.0, centre: [0.5, 0, 0], inertia: {xx: 0.1, yy: 0.4, zz: 0.4}}}
frames:
  hinge: {body: ground}
  foot: {body: ground, pose: {origin: [0, 0, -1]}}
  root: {body: flap}
  eye: {body: flap, pose: {origin: [0.8, 0, 0]}}
joints:
  hinge: {type: revolute, frames: [hinge, root], axis: y}
  cylinder:
    type: driven_distance
    frames: [foot, eye]
    drive: {signal: {type: ramp, start: 1.2806248474865698, end: 1.7, duration: 1.0}}
forces: {weight: {type: gravity}}
sensors: {eye: {type: motion, frame: eye}}
simulate: {duration: 1.0, time_step: 0.01}
""",
    )
    z = found["/sensors/eye"][-1, 2]
    assert z == pytest.approx((1.7**2 - 0.64 - 1) / 2, abs=1e-12)
    # virtual work: the force times the way of the cylinder lifts the weight, half the arm of 0.8 m beyond
    assert found["/drives/cylinder/force"][-1] * 1.0 == pytest.approx(5 * G * 0.5 / 0.8 * 1.7, rel=1e-9)


def test_a_rod_without_mass_keeps_its_length():
    found = simulated(
        """
bodies: {bob: {type: rigid, mass: 2.0, inertia: {xx: 1, yy: 1, zz: 1}, pose: {origin: [0.3, 0, -0.4]}}}
frames: {top: {body: ground}, at: {body: bob}}
joints:
  rod: {type: distance, frames: [top, at], length: 0.5}
  upright: {type: generic, frames: [top, at], held: [y, about_x, about_y, about_z]}
forces: {weight: {type: gravity}}
sensors: {bob: {type: motion, frame: at}}
simulate: {duration: 1.0, time_step: 0.005}
""",
    )
    place = found["/sensors/bob"]
    np.testing.assert_allclose(np.hypot(place[:, 0], place[:, 2]), 0.5, atol=1e-12)
    np.testing.assert_allclose(found["/frequency"], [np.sqrt(G / 0.5) / (2 * np.pi)], rtol=1e-9)


@pytest.mark.parametrize("free", ["about_x", "about_z"])
def test_what_a_generic_joint_leaves_free_is_free_and_the_rest_is_held(free):
    held = [own for own in ("x", "y", "z", "about_x", "about_y", "about_z") if own != free]
    axis = [float(free.endswith(own)) for own in "xyz"]
    found = simulated(
        f"""
bodies: {{block: {{type: rigid, mass: 3.0, inertia: {{xx: 1, yy: 1, zz: 1}}, spin: {[2.0 * own for own in axis]}}}}}
frames: {{wall: {{body: ground}}, at: {{body: block}}}}
joints: {{guide: {{type: generic, frames: [wall, at], held: [{", ".join(held)}]}}}}
sensors: {{x: {{type: motion, frame: at, quantity: x_axis}}, y: {{type: motion, frame: at, quantity: y_axis}}}}
simulate: {{duration: 1.0, time_step: 0.005, start: as_given}}
""",
    )
    k = axis.index(1.0)
    turned = found["/sensors/y" if k == 0 else "/sensors/x"][-1]
    start = np.eye(3)[1 if k == 0 else 0]
    assert turned @ axis == pytest.approx(0.0, abs=1e-12)
    assert np.arctan2(np.cross(start, turned) @ axis, start @ turned) == pytest.approx(2.0, abs=1e-3)


def test_a_start_of_a_drive_that_its_signal_has_is_refused():
    done = run(PENDULUM.replace("drive: {signal", "drive: {start: 1.0, signal"))
    assert done.code == 2, done.output
    assert "joints.motor.drive.start" in done.output
    assert "says where it starts" in done.output


def test_a_pitch_bearing_is_turned_against_the_friction_of_its_load():
    """The motor's torque at steady speed is the maker's formula of the weight that the bearing carries along its axis."""
    found = simulated(
        """
bodies: {blade: {type: rigid, mass: 2000.0, inertia: {xx: 500, yy: 4000, zz: 4000}}}
frames: {flange: {body: ground}, root: {body: blade}}
bearings:
  pitch: {balls: 112, ball_diameter: 0.06, pitch_diameter: 2.3, contact_angle: 45, radius_inner_left: 0.0318,
    radius_inner_right: 0.0318, radius_outer_left: 0.0318, radius_outer_right: 0.0318, preload: 1.0e-5}
joints: {motor: {type: driven_angle, frames: [flange, root], drive: {of: rate, signal: {type: constant, value: 0.1}}}}
forces:
  weight: {type: gravity, acceleration: [-10, 0, 0]}
  bearing: {type: bearing, bearing: pitch, outer: flange, inner: root, drag: {moment: 100.0, coefficient: 0.006, axial: 1.0e+5}}
simulate: {duration: 0.2, time_step: 0.01}
""",
    )
    expected = 100 + 0.006 / 2 * 2.3 * 2000 * 10
    np.testing.assert_allclose(found["/drives/motor/force"][1:], expected, rtol=1e-3)
    np.testing.assert_allclose(found["/bearings/bearing/load"][-1], [-2e4, 0, 0, 0, 0], atol=1.0)
