"""Benches that no one means: each is refused at its place with what to do, or computed and right; none crashes or hangs."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.runner.artefact import Artefact
from strainsight_cli.main import app

COIL = "coil: {type: torsion, frames: [pin, eye], axis: y, stiffness: 100.0}"


def bob(mass="2.0", moment="0.3", about_z=None, **more):
    inertia = f"{{xx: {moment}, yy: {moment}, zz: {about_z or moment}}}"
    own = {"pose": "{origin: [0, 0, -1]}", **more}
    return f"{{bob: {{type: rigid, mass: {mass}, inertia: {inertia}, " + ", ".join(f"{k}: {v}" for k, v in own.items()) + "}}"


def moving(x, spin):
    return bob(velocity=f"[{x}, 0, 0]", spin=f"[0, {spin}, 0]")


def two(first, second, other="pin"):
    """Two joints of the bob."""
    return f"{{a: {{type: {first}, frames: [pin, eye]}}, b: {{type: {second}, frames: [{other}, eye]}}}}"



PARTS = {
    "bodies": bob(),
    "frames": "{pin: {body: ground}, side: {body: ground, pose: {origin: [1, 0, 0]}}, "
    "eye: {body: bob, pose: {origin: [0, 0, 1]}}, tip: {body: bob}, low: {body: bob, pose: {origin: [0, 0, -1]}}}",
    "joints": "{hinge: {type: revolute, frames: [pin, eye], axis: y}}",
    "forces": "{weight: {type: gravity}}",
    "simulate": "{duration: 0.1, time_step: 0.01}",
}
"""A bob of 2 kg, 1 m below a hinge about y."""


def bench(**parts):
    return "kind: bench\nname: own\n" + "".join(f"{name}: {part}\n" for name, part in {**PARTS, **parts}.items())


def forces(*own):
    return "{weight: {type: gravity}, " + ", ".join(own) + "}"


def load(name="F", frame="tip", direction="[1, 0, 0]", signal="{type: sine, frequency: 1.0, amplitude: 10.0}"):
    return f"{name}: {{type: force, frame: {frame}, direction: {direction}, signal: {signal}}}"


def constant(value):
    return f"{{type: constant, value: {value}}}"


LOAD = load()


def sought(inputs="{F: {std: 10, increment: 1}}", noise="1.0e-5", load=None, more=""):
    """The load is sought by a sensor of the bob's place."""
    return {
        "forces": forces(COIL, LOAD if load is None else load),
        "sensors": "{m: {type: motion, frame: tip}}",
        "estimate": f"{{sensors: {{m: {{noise: {noise}}}}}, inputs: {inputs}{more}}}",
    }


def driven(joint, of="angle", frames="[pin, eye]", axis="axis: y, ", signal="{type: ramp, end: 0.5, duration: 0.1}"):
    drive = f"{{type: driven_{of}, frames: {frames}, {axis}drive: {{signal: {signal}}}}}"
    return {"joints": f"{{j: {{type: {joint}}}, drive: {drive}}}"}


def stretched(end):
    """A cylinder from the side, of √2 m at first: 2 m is its dead centre."""
    ramp = f"{{type: ramp, start: 1.4142135623730951, end: {end}, duration: 0.1}}"
    return driven(HINGE, "distance", "[side, tip]", "", ramp)


def rubbed(coulomb, speed):
    """A wheel about the upright that friction brings to rest within 0.02 s, against a motor of half of it."""
    return {
        "bodies": bob(spin="[0, 0, 0.1]"),
        "joints": "{j: {type: revolute, frames: [pin, eye], axis: z}}",
        "forces": forces(
            f"f: {{type: friction, frames: [pin, eye], axis: z, coulomb: {coulomb}, speed: {speed}}}",
            f"m: {{type: torque, frames: [pin, eye], axis: z, signal: {constant(coulomb / 2)}}}",
        ),
        "simulate": GIVEN,
    }


PUSHED = {
    "bodies": f"{bob()[:-1]}, arm: {{type: rigid, mass: 1, inertia: {{xx: 0.1, yy: 0.1, zz: 0.1}}}}}}",
    "frames": PARTS["frames"][:-1] + ", hub: {body: arm}}",
    "joints": "{h: {type: revolute, frames: [pin, hub], axis: y}, e: {type: revolute, frames: [hub, eye], axis: y}, d: "
    "{type: driven_angle, frames: [pin, hub], axis: y, drive: {signal: {type: ramp, end: 0.2, duration: 0.1}}}}",
    "forces": forces(f"F: {{type: torque, frames: [pin, hub], axis: y, signal: {constant(1.0)}}}"),
}
"""The bob hangs on an arm that a motor turns, with a torque beside the motor."""


def turning(end):
    ramp = f"{{type: ramp, end: {end}, duration: 0.05}}"
    return {"forces": f"{{weight: {{type: gravity, turns: {{axis: [0, 1, 0], signal: {ramp}}}}}}}"}


HINGE = "revolute, frames: [pin, eye], axis: y"
BALL = "spherical, frames: [pin, eye]"
GIVEN = "{duration: 0.1, time_step: 0.01, start: as_given}"
FINE = "{duration: 0.1, time_step: 0.01, start: as_given, tolerance: 1.0e-300}"
WEAK = "{coil: {type: torsion, frames: [pin, eye], axis: y, stiffness: 1.0}}"
SHORT = "s: {type: spring, frames: [pin, eye], stiffness: 1}"
STIFF = "s: {type: spring, frames: [side, tip], stiffness: 1.0e+300}"
HEAVY = "{weight: {type: gravity, acceleration: [0, 0, -1.0e+300]}}"
UNFELT = "estimate.inputs.F: no sensor measures this unknown"
REFUSED = {
    "a billion steps": (2, "simulate.time_step", {"simulate": "{duration: 1.0e+6, time_step: 1.0e-3}"}),
    "a tolerance beyond rounding": (1, "increase simulate.tolerance", {"simulate": FINE, "bodies": moving(-1, 1)}),
    "nothing holds it, gravity": (1, "simulate.start: no static equilibrium", {"joints": "{}"}),
    "a joint twice": (2, "5 of 16 constraints are redundant", {"joints": two("revolute", "revolute")}),
    "joints that contradict": (2, "cannot all be satisfied", {"joints": two("spherical", "spherical", "side")}),
    "a start far from the joints": (2, "bodies.bob.pose", {"bodies": bob(pose="{origin: [0, 0, 5]}")}),
    "a spin against the joint": (2, "bodies.bob.velocity", {"bodies": moving(0, 600), "simulate": GIVEN}),
    "an inertia that no body has": (2, "bodies.bob.inertia", {"bodies": bob(about_z="10")}),
    "a torsion spring past half a turn": (
        1,
        "coil: the torsion spring is rotated by",
        {"bodies": moving(-60, 60), "forces": WEAK, "simulate": GIVEN},
    ),
    "a spring without length": (
        2,
        "forces.s: at the start of the simulation, the distance between the end points",
        {"forces": forces(SHORT)},
    ),
    "a spring of 1e300 N/m": (1, "simulate.start", {"forces": forces(STIFF)}),
    "a load of 1e30 N": (2, "simulate.start: the equilibrium is unstable", {"forces": forces(load(signal=constant("1.0e+30")))}),
    "a gravity of 1e300 m/s²": (1, "simulate", {"forces": HEAVY}),
    "an unknown load along the hinge": (2, UNFELT, sought(load=load(direction="[0, 1, 0]"))),
    "sensors that read nothing but noise": (2, UNFELT, sought(noise="1.0e+9")),
    "a load of 1e12 N, perhaps": (2, "smaller than the rounding errors", sought("{F: {std: 1.0e+12, increment: 1}}")),
    "an angle that jumps": (2, "joints.drive.drive", driven(HINGE, signal="{type: ramp, end: 6, duration: 1.0e-3}")),
    "an angle that the pose has not": (2, "bodies.bob.pose", driven(HINGE, signal=constant(1.0))),
    "an angle half a turn on": (2, "half a turn", driven(HINGE, signal=constant(np.pi))),
    "an angle about what is held": (2, "1 of 12 constraints", driven(HINGE, axis="axis: x, ")),
    "an angle about an axis that swings": (
        2,
        "keep them parallel by a joint",
        {**driven(BALL, axis="axis: z, "), "bodies": moving(-3, 3), "simulate": GIVEN},
    ),
    "a cylinder longer than its joints": (2, "block the drives", stretched(3.0)),
    "a cylinder at its dead centre": (2, "dead centre", stretched(2.0)),
    "a cylinder of no length": (
        2, "joints.drive.drive.signal: the drive sets a distance of 0 m between the frames at t = 0.1 s", stretched(0.0),
    ),
    "a place beyond the reach of a hinge": (
        2,
        "block the drives",
        driven(HINGE, "displacement", "[pin, tip]", "axis: x, ", "{type: ramp, end: 1.5, duration: 0.1}"),
    ),
    "a rod between points that are one": (
        2,
        "cannot all be satisfied",
        {"joints": "{a: {type: distance, frames: [pin, eye], length: 1.0}}"},
    ),
    "friction sharper than its step": (1, "forces.f: at t = ", rubbed(3.0, 1.0e-6)),
    "an unknown torque about a driven axis": (2, "the sensors cannot determine F at any of 5 instants", {**sought(), **PUSHED}),
    "gravity that spins": (2, "forces.weight.turns: the driven angle or the direction of gravity changes by", turning(1.0e20)),
}


def simulated(folder, **parts):
    path = folder / "own.yaml"
    path.write_text(bench(**parts), encoding="utf-8")
    done = CliRunner().invoke(app, ["run", str(path), "--results", str(folder / "r")], env={"COLUMNS": "400"})
    return done.exit_code, done.output + (done.stderr or "")


@pytest.mark.parametrize(("code", "says", "parts"), REFUSED.values(), ids=REFUSED)
def test_it_is_refused_at_its_place_with_a_remedy(tmp_path, code, says, parts):
    found, said = simulated(tmp_path, **parts)
    assert found == code, said
    assert says in said
    place, remedy = said.rstrip().splitlines()[-2:]
    assert "own.yaml:" in place
    assert remedy.startswith("    ")
    assert "internal error" not in said


@pytest.mark.slow
def test_a_load_that_no_step_follows_is_reported_and_its_page_is_written(tmp_path):
    """45 Hz in steps of 10 ms, where constraints hold to 1e-110 at some instants and to rounding at others."""
    parts = sought(load=load(signal="{type: sine, frequency: 45.0, amplitude: 10.0}"))
    code, said = simulated(tmp_path, **parts, simulate="{duration: 1.0, time_step: 0.01}")
    assert "the time step does not resolve" in said
    assert (code == 0 and "F is overconfident" in said) or (code == 2 and "estimate" in said), said


def test_a_body_of_no_weight_to_mention_hangs_as_any_other(tmp_path):
    code, said = simulated(tmp_path, bodies=bob(mass="2.0e-30", moment="3.0e-31"))
    assert code == 0, said
    found = Artefact(tmp_path / "r" / "own" / "simulate.h5")
    np.testing.assert_allclose(found["/frequency"], np.sqrt(2 * 9.81 / (0.3 + 2.0)) / (2 * np.pi), rtol=1e-9)


def test_a_spring_beyond_measure_holds_as_a_bar_does(tmp_path):
    """1e12 N/m from the side: it does not leave its length."""
    code, said = simulated(
        tmp_path,
        forces=forces("s: {type: spring, frames: [side, tip], stiffness: 1.0e+12, length: 1.4142135623730951}"),
        sensors="{m: {type: motion, frame: tip}}",
    )
    assert code == 0, said
    place = Artefact(tmp_path / "r" / "own" / "simulate.h5")["/sensors/m"]
    np.testing.assert_allclose(np.linalg.norm(place - [1, 0, 0], axis=1), np.sqrt(2), rtol=1e-10)


def test_a_load_that_is_not_felt_at_the_start_is_sought_where_the_bench_moves_on(tmp_path):
    parts = sought(load=load(direction="[0, 0, 1]"))
    turns = "weight: {type: gravity, turns: {axis: [0, 1, 0], signal: {type: ramp, end: 0.5, duration: 0.05}}}"
    moved = parts["forces"].replace("weight: {type: gravity}", turns)
    code, said = simulated(tmp_path, **{**parts, "forces": moved})
    assert code == 0, said


def test_what_no_sensor_feels_keeps_its_first_sigma_where_that_is_allowed(tmp_path):
    code, said = simulated(tmp_path, **sought(load=load(direction="[0, 1, 0]"), more=", allow_unobservable: true"))
    assert code == 0, said
    assert "F is weakly observable" in said
    found = Artefact(tmp_path / "r" / "own" / "estimate.h5")["/inputs/F/std"]
    np.testing.assert_allclose(found, np.sqrt(10.0**2 + np.arange(len(found))), rtol=1e-9)


@pytest.mark.parametrize(
    ("samples", "says"),
    [
        ([(k / 100, 0.3 * (k > 5)) for k in range(11)], "of their range at 0."),
        ([(k / 1000, 0.0) for k in range(21)] + [(0.09, 0.1), (0.1, 0.1)], "drive has no samples from 0.02 to 0.09 s"),
    ],
)
def test_a_file_that_a_spline_does_not_follow_is_warned_of(tmp_path, samples, says):
    (tmp_path / "own.csv").write_text("t,a\n" + "".join(f"{t},{a}\n" for t, a in samples))
    file = "{type: csv, file: own.csv, time_column: t, value_column: a}"
    code, said = simulated(tmp_path, **driven(HINGE, signal=file))
    assert code == 0, said
    assert says in said
