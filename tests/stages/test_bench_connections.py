"""Joints, force laws and drives from the config: each is what its closed form says, or refused with its place."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Literal, Union, get_args

import numpy as np
import pytest
from pydantic import Field, create_model
from scipy.integrate import solve_ivp

from strainsight.config import load
from strainsight.config.base import Name, NotNegative, Section
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.checks import bench_problems
from strainsight.config.bench.connections import Axis, Force, Frames
from strainsight.multibody.bodies import Frame
from strainsight.multibody.forces import Load, RelativeElement
from strainsight.multibody.laws import LAWS
from strainsight.multibody.relations import offset
from strainsight.runner.artefact import Artefact
from strainsight.stages.bench.pipeline import bench_stages

from ..models import Ended, ended
from .conftest import ROOT, finished, job_of

M, I = 2.0, 0.3
"""Mass [kg] and moment of inertia [kg m²] of the bob."""
BOB = f"bob: {{type: rigid, mass: {M}, inertia: {{xx: {I}, yy: {I}, zz: {I}}}"


def run(text: str, **files: str) -> Ended:
    return ended("simulate", f"kind: bench\nname: own\n{text}", files=files)


def simulated(text: str, **files: str) -> Artefact:
    return run(text, **files).artefact("simulate")


def test_a_nut_on_a_rail_slides_and_turns_each_by_itself():
    """cylindrical: ω² = k/m along the rail, κ/I about it, and at rest k x = m g sin α; spring and torsion with it."""
    k, kappa, slope = 500.0, 7.0, np.deg2rad(35.0)
    c, s = float(np.cos(slope)), float(np.sin(slope))
    axes = f"x_axis: [{c!r}, 0, {s!r}], y_axis: [0, 1, 0]"
    found = simulated(
        f"""
bodies: {{{BOB}}}}}
frames:
  rail: {{body: ground, pose: {{{axes}}}}}
  end: {{body: ground, pose: {{origin: [{-2 * c!r}, 0, {-2 * s!r}]}}}}
  nut: {{body: bob, pose: {{{axes}}}}}
joints: {{guide: {{type: cylindrical, frames: [rail, nut]}}}}
forces:
  weight: {{type: gravity, acceleration: [0, 0, -10]}}
  spring: {{type: spring, frames: [end, nut], stiffness: {k}, length: 2.0}}
  coil: {{type: torsion, frames: [rail, nut], stiffness: {kappa}, angle: 0.2}}
sensors: {{bob: {{type: motion, frame: nut}}, turn: {{type: motion, frame: nut, quantity: y_axis}}}}
simulate: {{duration: 0.01, time_step: 1.0e-3}}
""",
    )
    assert found.summary["constraints"] == 6 + 4
    np.testing.assert_allclose(found["/frequency"], np.sqrt([kappa / I, k / M]) / (2 * np.pi), rtol=1e-8)
    np.testing.assert_allclose(found["/sensors/bob"][0], -M * 10 * s / k * np.array([c, 0, s]), rtol=0, atol=1e-10)
    np.testing.assert_allclose(found["/sensors/turn"][0] @ [0, 1, 0], np.cos(0.2), rtol=0, atol=1e-10)


def test_a_cardan_joint_turns_the_second_shaft_by_its_law():
    """universal: tan φ₂ = tan φ₁ / cos β through two turns, ω₂/ω₁ between cos β and 1/cos β."""
    beta = np.deg2rad(30.0)
    c, s = float(np.cos(beta)), float(np.sin(beta))
    bent = f"pose: {{x_axis: [{c!r}, {s!r}, 0], y_axis: [{-s!r}, {c!r}, 0]}}"
    shaft = "type: rigid, mass: 1.0, inertia: {xx: 0.5, yy: 1.0, zz: 1.0}"
    found = simulated(
        f"""
bodies: {{driving: {{{shaft}}}, driven: {{{shaft}, {bent}}}}}
frames:
  inlet: {{body: ground}}
  outlet: {{body: ground, {bent}}}
  first: {{body: driving}}
  second: {{body: driven}}
joints:
  hinge: {{type: revolute, frames: [inlet, first]}}
  cross: {{type: universal, frames: [first, second]}}
  level: {{type: perpendicular, frames: [outlet, second], axis: y, to: x}}
  plumb: {{type: perpendicular, frames: [outlet, second], axis: z, to: x}}
forces: {{drive: {{type: moment, frame: first, direction: [1, 0, 0], signal: {{type: constant, value: 30.0}}}}}}
sensors:
  first: {{type: motion, frame: first, quantity: y_axis}}
  second: {{type: motion, frame: second, quantity: y_axis}}
simulate: {{duration: 1.0, time_step: 2.5e-3, start: as_given}}
""",
    )
    y, z = found["/sensors/first"], found["/sensors/second"]
    one = np.unwrap(np.arctan2(y[:, 2], y[:, 1]))
    two = np.unwrap(np.arctan2(z[:, 2], z @ [-s, c, 0]))
    assert one[-1] > 4 * np.pi
    np.testing.assert_allclose(two, np.unwrap(np.arctan2(np.sin(one), c * np.cos(one))), rtol=0, atol=1e-9)
    ratio = np.diff(two)[1:] / np.diff(one)[1:]
    np.testing.assert_allclose([ratio.min(), ratio.max()], [c, 1 / c], rtol=1e-3)


def test_a_pendulum_on_a_pin_swings_across_it_and_along_it():
    """pin along y: ω² = mgL/(I + mL²) about the pin; along it the eye slides, the centre falls, and ω² = mgL/I."""
    L, g = 0.8, 10.0
    found = simulated(
        f"""
bodies: {{{BOB}, pose: {{origin: [0, 0, {-L}]}}}}}}
frames: {{pin: {{body: ground}}, eye: {{body: bob, pose: {{origin: [0, 0, {L}]}}}}}}
joints: {{pin: {{type: pin, frames: [pin, eye], axis: y}}}}
forces: {{weight: {{type: gravity, acceleration: [0, 0, {-g}]}}}}
simulate: {{duration: 0.01, time_step: 1.0e-3, start: as_given}}
""",
    )
    assert found.summary["constraints"] == 6 + 2
    across, along = np.sqrt(M * g * L / (I + M * L**2)), np.sqrt(M * g * L / I)
    np.testing.assert_allclose(found["/frequency"], np.array([across, along]) / (2 * np.pi), rtol=1e-8)


OSCILLATOR = f"""
bodies: {{{BOB}, pose: {{origin: [0.2, 0, 0]}}}}}}
frames:
  origin: {{body: ground}}
  anchor: {{body: ground, pose: {{origin: [-3, 0, 0]}}}}
  centre: {{body: bob}}
joints: {{guide: {{type: prismatic, frames: [origin, centre]}}}}
forces: {{LAW}}
sensors: {{bob: {{type: motion, frame: centre}}}}
simulate: {{duration: 0.5, time_step: 0.01, start: as_given}}
"""


def test_what_a_step_gets_wrong_of_a_load_is_named_where_it_is_much():
    """1.6 Hz of its own; a push of 0.2 Hz and one of 12 Hz, which has eight steps a period."""
    push = "slow: {{type: force, frame: centre, direction: [1, 0, 0], signal: {{type: sine, frequency: 0.2, amplitude: 1.0}}}}"
    quick = push.replace("slow", "quick").replace("0.2", "12.0")
    law = "mount: {type: bushing, frames: [origin, centre], stiffness: [200, 0, 0, 0, 0, 0], damping: [8, 0, 0, 0, 0, 0]}"
    text = OSCILLATOR.replace("LAW", ", ".join([law, push.format(), quick.format()]))
    done = run(text.replace("duration: 0.5", "duration: 10.0"))
    assert done.code == 0, done.output
    said = " ".join(done.output.split())
    assert re.search(r"the time step does not resolve \d+ % of the RMS of quick", said)
    assert "of slow" not in said


def test_a_bushing_that_is_turned_too_far_is_refused():
    mount = "mount: {type: bushing, frames: [origin, centre], stiffness: [1, 1, 1, 9, 9, 9]}"
    text = OSCILLATOR.replace("LAW", mount).replace("type: prismatic", "type: cylindrical")
    turned = f"[0.2, 0, 0], y_axis: [0, {np.cos(0.12):.15g}, {np.sin(0.12):.15g}]"
    done = run(text.replace("[0.2, 0, 0]", turned))
    assert done.code == 2, done.output
    assert "forces.mount" in done.stderr
    assert "differ in direction by 0.12 rad at t = 0 s; the limit is 0.1 rad" in done.stderr
    assert "own.yaml:" in done.stderr


def test_the_law_of_the_page_on_extending_is_one(tmp_path, monkeypatch):
    """Law, section and entry as the page has them: a mass falls on the buffer as scipy integrates it."""
    text = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
    text = text.split("## A force element of a bench")[1].split("\n## ")[0]
    law, section = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    there = {"np": np, "dataclass": dataclass, "Load": Load, "RelativeElement": RelativeElement, "Frame": Frame, "offset": offset,
             "Section": Section, "Literal": Literal, "Field": Field, "Frames": Frames, "NotNegative": NotNegative,
             "Axis": Axis}  # fmt: skip
    for block in (law, section):
        exec(compile(block, "extending.md", "exec", dont_inherit=True), there)
    monkeypatch.setitem(LAWS, "buffer", there["buffer"])
    known = get_args(get_args(Force)[0])
    whole = Annotated[Union[*known, there["Buffer"]], Field(discriminator="type")]  # noqa: F821
    extended = create_model("Extended", __base__=BenchConfig, forces=(dict[Name, whole], {}))
    monkeypatch.setattr(load, "model_and_check", lambda _kind: (extended, bench_problems))
    k, a, c, m, g = 8e3, 4e6, 3e3, 50.0, 9.81
    text = f"""
bodies: {{mass: {{type: rigid, mass: {m}, inertia: {{xx: 1.0, yy: 1.0, zz: 1.0}}}}}}
frames: {{seat: {{body: ground}}, foot: {{body: mass}}}}
joints: {{guide: {{type: prismatic, frames: [seat, foot], axis: z}}}}
forces:
  weight: {{type: gravity}}
  buffer: {{type: buffer, frames: [seat, foot], stiffness: {k}, cubic: {a}, damping: {c}, axis: z}}
sensors: {{mass: {{type: motion, frame: foot}}}}
simulate: {{duration: 0.2, time_step: 5.0e-4, start: as_given}}
"""

    path = tmp_path / "own.yaml"
    path.write_text(f"kind: bench\nname: own\n{text}", encoding="utf-8")
    job = job_of(path, tmp_path / "results")
    stages = [stage for stage in bench_stages(job.config) if stage.name != "report"]
    height = finished(job, stages)["simulate"][2]["/sensors/mass"][:, 2]
    exact = solve_ivp(
        lambda t, z: [z[1], -(k * z[0] + a * z[0] ** 3 + c * z[1] * abs(z[1])) / m - g],
        (0, 0.2),
        [0, 0],
        rtol=1e-11,
        atol=1e-13,
    ).y[0, -1]
    assert abs(height[-1] - exact) < 1e-4 * abs(exact)


MASS, ARM, CENTRAL, G = 2.0, 0.5, 0.3, 9.81
UP = np.array([0, 0, G])
TURN = -7.0
"""[rad] about y, in two seconds: more than a whole turn."""
ARM_ON_MOTOR = """
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
    found = simulated(ARM_ON_MOTOR)
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
    found = simulated(ARM_ON_MOTOR.replace("{type: ramp, end: -7.0, duration: 2.0}", signal), **{"p.csv": "\n".join(lines)})
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


@pytest.mark.parametrize("free", ["about_x", "about_z"])
def test_what_a_generic_joint_leaves_free_is_free_and_the_rest_is_held(free):
    held = [own for own in ("x", "y", "z", "about_x", "about_y", "about_z") if own != free]
    axis = [float(free.endswith(own)) for own in "xyz"]
    found = simulated(
        f"""
bodies: {{block: {{type: rigid, mass: 3.0, inertia: {{xx: 1, yy: 1, zz: 1}}, spin: {[2.0 * own for own in axis]}}}}}
frames: {{wall: {{body: ground}}, at: {{body: block}}}}
joints: {{guide: {{type: generic, frames: [wall, at], fixed: [{", ".join(held)}]}}}}
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
    done = run(ARM_ON_MOTOR.replace("drive: {signal", "drive: {start: 1.0, signal"))
    assert done.code == 2, done.output
    assert "joints.motor.drive.start" in done.output
    assert "the signal defines the position at t = 0" in done.output


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
