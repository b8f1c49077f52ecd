"""What one field of a bench demands of another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from strainsight.config.bench.bearing import Bearing, BearingConfig
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.bodies import FlexibleBody, Pose
from strainsight.config.problem import Problem
from strainsight.errors import did_you_mean

GROUND = "ground"
RADII = ("radius_inner_left", "radius_inner_right", "radius_outer_left", "radius_outer_right")
MOST_STEPS = 10_000_000
PARALLEL = 1e-6


def bearing_problems(config: BearingConfig) -> Iterator[Problem]:
    """Every contradiction between the fields of bearings."""
    yield from _bearings(config.bearings)


def bench_problems(config: BenchConfig) -> Iterator[Problem]:
    """Every contradiction between the fields of a bench."""
    yield from _bearings(config.bearings)
    if GROUND in config.bodies:
        yield Problem(f"bodies.{GROUND}", f"'{GROUND}' is the ground", "give the body another name", at_key=True)
    yield from _bodies(config)
    yield from _frames(config)
    for name, joint in config.joints.items():
        yield from _two_frames(f"joints.{name}.frames", joint.frames, config)
    yield from _forces(config)
    for name, sensor in config.sensors.items():
        if sensor.type == "strain":
            yield from _known(f"sensors.{name}.body", sensor.body, _flexible(config), "flexible body")
        elif sensor.type == "relative":
            yield from _two_frames(f"sensors.{name}.frames", sensor.frames, config)
        else:
            yield from _known(f"sensors.{name}.frame", sensor.frame, config.frames, "frame")
    yield from _moduli(config)
    if config.cases and not config.bearings:
        yield Problem("cases", "there is no bearing", "leave cases out, or give bearings", at_key=True)
    if config.curves and not config.bearings:
        yield Problem("curves", "there is no bearing", "leave curves out, or give bearings", at_key=True)
    yield from _time(config)


def _bearings(bearings: Mapping[str, Bearing]) -> Iterator[Problem]:
    for name, bearing in bearings.items():
        half = bearing.ball_diameter / 2
        for radius in RADII:
            value = getattr(bearing, radius)
            if not value > half:
                yield Problem(
                    f"bearings.{name}.{radius}",
                    f"{value:g} m is not above half the ball diameter, {half:g} m",
                    "a groove is wider than its ball: usual radii are 1.03 to 1.06 times half the diameter",
                )
        if bearing.ball_diameter * bearing.balls > np.pi * bearing.pitch_diameter:
            yield Problem(
                f"bearings.{name}.balls",
                f"{bearing.balls} balls of {bearing.ball_diameter:g} m do not fit on a circle of "
                f"{bearing.pitch_diameter:g} m",
                f"take at most {int(np.pi * bearing.pitch_diameter / bearing.ball_diameter)}",
            )


def _time(config: BenchConfig) -> Iterator[Problem]:
    duration, h = config.simulate.duration, config.simulate.time_step
    steps = duration / h
    if not 1 - 1e-9 <= steps <= MOST_STEPS:
        yield Problem("simulate.time_step", f"{steps:.3g} steps", f"take 1 to {MOST_STEPS} steps")
    elif abs(steps - round(steps)) > 1e-6 * steps:
        yield Problem(
            "simulate.time_step",
            f"{h:g} s does not divide the duration of {duration:g} s ({steps:.6g} steps)",
            f"take {duration / round(steps):.9g} s",
        )
    if config.simulate.start == "equilibrium":
        for name, body in config.bodies.items():
            for key in ("velocity", "spin"):
                if any(getattr(body, key)):
                    yield Problem(
                        f"bodies.{name}.{key}",
                        "a bench that starts from its equilibrium is at rest",
                        "set simulate.start: as_given",
                    )


def _moduli(config: BenchConfig) -> Iterator[Problem]:
    """A modulus of one name is one unknown, whatever bodies it scales."""
    first: dict[str, tuple[str, float]] = {}
    for name, body in config.bodies.items():
        if isinstance(body, FlexibleBody):
            for key, modulus in body.moduli.items():
                owner, value = first.setdefault(key, (name, modulus.value))
                if value != modulus.value:
                    yield Problem(
                        f"bodies.{name}.moduli.{key}.value",
                        f"{modulus.value:g} Pa here, {value:g} Pa in '{owner}'",
                        "a modulus of one name is one parameter: give the two different names, or one value",
                    )


def _bodies(config: BenchConfig) -> Iterator[Problem]:
    for name, body in config.bodies.items():
        yield from _pose(f"bodies.{name}.pose", body.pose)
        if isinstance(body, FlexibleBody):
            if body.modes is not None and body.cutoff is not None:
                yield Problem(f"bodies.{name}.cutoff", "modes and cutoff are both given", "give one of them")
            if body.mesh.matrices is not None:
                yield Problem(
                    f"bodies.{name}.mesh.matrices",
                    "a body of a bench is reduced from its solids",
                    "leave mesh.matrices out",
                )
        else:
            I = body.inertia
            tensor = np.array([[I.xx, I.xy, I.xz], [I.xy, I.yy, I.yz], [I.xz, I.yz, I.zz]])
            least = np.linalg.eigvalsh(0.5 * np.trace(tensor) * np.eye(3) - tensor)[0]
            if least < -1e-9 * np.trace(tensor):
                yield Problem(
                    f"bodies.{name}.inertia",
                    "one principal moment is larger than the sum of the two others, which no body has",
                    "give the moments about the centre of mass, with xy = −∫ρxy",
                )


def _frames(config: BenchConfig) -> Iterator[Problem]:
    for name, frame in config.frames.items():
        key = f"frames.{name}"
        yield from _known(f"{key}.body", frame.body, [*config.bodies, GROUND], "body")
        yield from _pose(f"{key}.pose", frame.pose)
        flexible = frame.body in _flexible(config)
        if flexible and frame.node is None:
            yield Problem(f"{key}.node", "missing", "a frame on a flexible body is at one of its nodes", at_key=True)
        if not flexible and frame.node is not None:
            yield Problem(f"{key}.node", f"'{frame.body}' has no nodes", "give pose.origin instead")
        if flexible and frame.node is not None and any(frame.pose.origin):
            yield Problem(f"{key}.pose.origin", "the node is the origin", "leave pose.origin out")


def _forces(config: BenchConfig) -> Iterator[Problem]:
    for name, force in config.forces.items():
        key = f"forces.{name}"
        if force.type == "spring":
            yield from _two_frames(f"{key}.frames", force.frames, config)
        elif force.type == "bearing":
            yield from _known(f"{key}.bearing", force.bearing, config.bearings, "bearing")
            yield from _two_frames(key, (force.outer, force.inner), config)
        elif force.type in ("force", "moment"):
            yield from _known(f"{key}.frame", force.frame, config.frames, "frame")
            if force.frame in config.frames and config.frames[force.frame].body == GROUND:
                what = f"frame '{force.frame}' is on the ground, where a load moves nothing"
                yield Problem(f"{key}.frame", what, "name a frame on a body")
            if not any(force.direction):
                yield Problem(f"{key}.direction", "has no length", "give three numbers, not all zero")


def _two_frames(key: str, frames: tuple[str, str], config: BenchConfig) -> Iterator[Problem]:
    for frame in frames:
        yield from _known(key, frame, config.frames, "frame")
    if all(frame in config.frames for frame in frames):
        bodies = {config.frames[frame].body for frame in frames}
        if len(bodies) == 1:
            yield Problem(key, f"both frames are on '{bodies.pop()}'", "name frames of two bodies")


def _pose(key: str, pose: Pose) -> Iterator[Problem]:
    for axis in ("x_axis", "y_axis"):
        if not any(getattr(pose, axis)):
            yield Problem(f"{key}.{axis}", "has no length", "give three numbers, not all zero")
            return
    x, y = (np.array(v) / np.linalg.norm(v) for v in (pose.x_axis, pose.y_axis))
    if np.linalg.norm(np.cross(x, y)) < PARALLEL:
        yield Problem(f"{key}.y_axis", "is parallel to the x axis", "give another direction")


def _flexible(config: BenchConfig) -> list[str]:
    return [name for name, body in config.bodies.items() if isinstance(body, FlexibleBody)]


def _known(key: str, name: str, known: Any, what: str) -> Iterator[Problem]:
    if name not in known:
        listed = ", ".join(known) or "none"
        yield Problem(key, f"no {what} '{name}'", did_you_mean(name, list(known), f"known here: {listed}"))
