"""Loads on an arm that a motor turns while gauges on what carries it are read."""

from __future__ import annotations

import numpy as np
import pytest

from ..models import Ended, ended
from ..robustness.small import BENCH
from .conftest import ROOT

HALF = float(np.sqrt(0.5))
GAUGES = "".join(
    f"{{position: [{x}], direction: [1, 0, 0]}}, "
    for x in ("0.075, 0.09, 0.095", "0.075, -0.125, 0.07", "0.125, -0.125, 0.07")
)
CONFIG = f"""
kind: bench
name: arm
bodies:
  beam: {{type: flexible, mesh: {{file: {ROOT}/meshes/cantilever-coarse.bdf}}, modes: 4, damping: {{type: modal, ratio: 0.01}}}}
  arm:
    type: rigid
    mass: 20.0
    inertia: {{xx: 1.0, yy: 1.0, zz: 1.0}}
    pose: {{origin: [2.0, {-0.5 * HALF!r}, {-0.5 * HALF!r}], y_axis: [0, {HALF!r}, {-HALF!r}]}}
frames:
  tip: {{body: beam, node: 2}}
  eye: {{body: arm, pose: {{origin: [0, 0, 0.5]}}}}
  end: {{body: arm}}
joints:
  hinge: {{type: revolute, frames: [tip, eye], axis: x}}
  motor:
    type: driven_angle
    frames: [tip, eye]
    axis: x
    drive: {{signal: {{type: sine, frequency: 0.5, amplitude: {np.pi / 4!r}, phase: {-np.pi / 2!r}}}}}
forces:
  weight: {{type: gravity}}
  down: {{type: force, frame: end, direction: [0, 0, 1], signal: {{type: sine, frequency: 1.0, amplitude: 500.0}}}}
  side: {{type: force, frame: end, direction: [0, 1, 0], signal: {{type: sine, frequency: 0.7, amplitude: 300.0}}}}
sensors:
  gauges: {{type: strain, body: beam, gauges: [{GAUGES}]}}
  end: {{type: motion, frame: end}}
simulate: {{duration: 0.5, time_step: 0.005}}
estimate:
  sensors: {{gauges: {{noise: 1.0e-7}}}}
  inputs:
    down: {{std: 500, increment: 20}}
    side: {{std: 300, increment: 12}}
"""
"""Through a quarter of a turn and back in two seconds."""


def run(*changes: str) -> Ended:
    return ended("estimate", CONFIG, *changes)


@pytest.mark.slow
def test_loads_on_a_turning_arm_are_known_to_their_sigma():
    found = run("seed=3").artefact("estimate")
    for name in ("down", "side"):
        off = found[f"/inputs/{name}/estimate"] - found[f"/inputs/{name}/true"]
        assert found.summary[f"claim.{name}"] == "consistent"
        assert np.sqrt(np.mean((off / found[f"/inputs/{name}/std"])[20:] ** 2)) < 1.2
    end = found["/sensors/end/measured"]
    assert np.ptp(end[:, 1]) > 0.3
    np.testing.assert_allclose(found["/sensors/end/expected"], end, rtol=0, atol=2e-5)
    assert found["/violation"].max() < 1e-12


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (("estimate.method.step_error=estimated",),
         "estimate.method.step_error: the discretisation error of a step cannot be estimated with driven joints"),
        # from one end to the other in half a period, which simulate takes in ten steps
        (("joints.motor.drive.signal.frequency=10", "estimate.time_step=0.05"),
         "joints.motor.drive: the driven angle or the direction of gravity changes by 1.57 rad in a time step"),
    ],
)  # fmt: skip
def test_what_a_filter_has_no_equations_for_with_a_drive_is_refused(changes, says):
    done = run(*changes)
    assert done.code == 2
    assert says in done.stderr


QUICK = ("place.random=0", "place.certificate=false", "place.pool=4", "place.keep=2")


def test_the_filter_claims_what_was_expected_of_gauges_with_a_drive():
    """A motor that stands still on the small beam: placement and filter both take the step for true."""
    text = BENCH.replace("frames:", "  arm: {type: rigid, mass: 0.1, inertia: {xx: 1.0e-3, yy: 1.0e-3, zz: 1.0e-3}, "
                         "pose: {origin: [1.0, 0.05, 0.04]}}\nframes:\n  eye: {body: arm}")  # fmt: skip
    drive = "{type: driven_angle, frames: [tip, eye], drive: {signal: {type: constant, value: 0.0}}}"
    text = text.replace("forces:", f"joints: {{hinge: {{type: revolute, frames: [tip, eye], axis: x}}, motor: {drive}}}\nforces:")
    end = ended("estimate", text.replace("duration: 0.2", "duration: 0.6").replace("name: bench", "name: arm"), *QUICK)
    place, estimate = (end.artefact(stage) for stage in ("place", "estimate"))
    claimed = [estimate[f"/inputs/{name}/std"][-1] for name in place["/inputs"]]
    np.testing.assert_allclose(claimed, place["/layouts/place/std"], rtol=1e-5)


ARM = """
kind: bench
name: arm
bodies:
  arm: {type: rigid, mass: 200.0, centre: [0.5, 0, 0], inertia: {xx: 10, yy: 30, zz: 30}}
frames: {wall: {body: ground}, root: {body: arm}, tip: {body: arm, pose: {origin: [1, 0, 0]}}}
joints: {hinge: {type: revolute, frames: [wall, root], axis: y}}
forces:
  held: {type: torsion, frames: [wall, root], axis: y, stiffness: 2.0e+4, damping: 100.0}
  push: {type: torque, frames: [wall, root], axis: y, signal: {type: SIGNAL}}
sensors: {tip: {type: motion, frame: tip}}
simulate: {duration: 0.01, time_step: 0.005}
estimate: {sensors: {tip: {noise: 1.0e-5}}, inputs: {push: {std: 1000}}, truth: {model: filter_step}}
"""


@pytest.mark.parametrize(
    ("signal", "code"), [("sine, frequency: 1.0, amplitude: 900.0", 0), ("constant, value: 900.0", 2)]
)
def test_the_torque_of_a_motor_is_an_unknown_load_with_the_size_of_its_history(signal, code):
    """Without increment: that of the sine, and where it is none the config is asked for it."""
    done = ended("estimate", ARM.replace("SIGNAL", signal))
    assert done.code == code, done.output
    assert ("estimate.inputs.push: a random walk for which increment is not set needs" in done.stderr) == (code == 2)
