"""What one field of a bench demands of another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from strainsight.config.base import (
    GROUND,
    Names,
    Problem,
    known,
    marked,
    name_problems,
    section_problems,
    step_problems,
)
from strainsight.config.bench.bench import (
    AccelerationSensor,
    BenchConfig,
    BenchPlace,
    MotionSensor,
    RelativeSensor,
    StrainSensorSection,
)
from strainsight.config.bench.bodies import (
    BearingConfig,
    BearingSection,
    CurveSection,
    RigidBodySection,
)
from strainsight.config.bench.checks_estimate import disturbed, estimate_problems
from strainsight.config.bench.connections import PointInput
from strainsight.config.checks_model import RESERVED
from strainsight.config.layout import layout_problems

RANDOM = ("no layout is drawn at random", "set place.random to 1 or more")


def place_problems(config: BenchConfig) -> Iterator[Problem]:
    """What `place` and the sensors that use it demand of the rest of a bench."""
    place, estimate = config.place, config.estimate
    if place is not None:
        inputs, parameters = ({}, {}) if estimate is None else (estimate.inputs, estimate.parameters)
        if not inputs:
            remedy = "name the loads to place for under estimate.inputs"
            yield Problem("place", "no input is unknown", remedy, at_key=True)
        if place.pool + place.bonded < place.keep:
            yield Problem("place.pool", f"{place.pool} candidates for {place.keep} gauges", "take a larger pool")
        if list(place.poses) != sorted(set(place.poses)):
            yield Problem("place.poses", "not in ascending order, each once", "sort them")
        if max(place.poses) > config.simulate.duration:
            what = f"{max(place.poses):g} s is beyond the run of {config.simulate.duration:g} s"
            yield Problem("place.poses", what, "take instants of the run")
        if estimate is not None and estimate.method.noise == "as_printed" and estimate.disturbance > 0:
            what = "place does not know the disturbance as printed, which is on every velocity, whatever the joints"
            remedy = "set it to 0, or method.noise: before_step, or place in a run of its own"
            yield Problem("estimate.disturbance", what, remedy)
        free = [name for name, entry in parameters.items() if entry.std is not None]
        among = "estimate.inputs and estimate.parameters" if free else "estimate.inputs"
        yield from layout_problems(place, (*inputs, *free), among, place.bonded, "place.fixed")
        yield from _candidates(config, place)
    for name, entry in {} if estimate is None else estimate.sensors.items():
        key = f"estimate.sensors.{name}.layout"
        if entry.layout is not None and (place is None or name not in place.sensors):
            what, remedy = (
                "it is not among the candidates of place",
                f"name it under place.sensors: {{{name}: {{noise: …}}}}",
            )
            yield Problem(key, what, remedy)
        elif entry.layout == "random" and place is not None and place.random == 0:
            yield Problem(key, *RANDOM)
    for name, sensor in config.sensors.items():
        if isinstance(sensor, StrainSensorSection):
            yield from _layout(f"sensors.{name}", sensor, place)


def _candidates(config: BenchConfig, place: BenchPlace) -> Iterator[Problem]:
    """Sensors of the bench among the candidates."""
    for name in place.sensors:
        key, sensor = f"place.sensors.{name}", config.sensors.get(name)
        yield from known(key, name, config.sensors, "sensor")
        yield from disturbed(config.estimate, sensor, name, f"or take {name} out of place.sensors")
        moves = isinstance(sensor, RelativeSensor | AccelerationSensor)
        moves |= isinstance(sensor, MotionSensor) and sensor.quantity == "position"
        if sensor is not None and not moves:
            what = "it is no displacement sensor and no accelerometer"
            yield Problem(key, what, "name one of type relative, acceleration, or motion with quantity: position")


def _layout(key: str, sensor: StrainSensorSection, place: BenchPlace | None) -> Iterator[Problem]:
    if (sensor.layout is None) == (not sensor.gauges):
        what = "neither is given" if sensor.layout is None else "both are given"
        yield Problem(key, f"gauges and layout: {what}", "give one of them", at_key=True)
    if sensor.layout is None:
        return
    if place is None:
        yield Problem(f"{key}.layout", "nothing is placed", "give the section place, or gauges")
    elif sensor.body != place.body:
        yield Problem(f"{key}.body", f"gauges are placed on '{place.body}'", f"name '{place.body}', or give gauges")
    elif sensor.layout == "random" and place.random == 0:
        yield Problem(f"{key}.layout", *RANDOM)


MOST_STEPS = 10_000_000
MASSES_APART = 1e12
"""Ratio of two masses up to which the joints between them hold to rounding."""

LEAST_REACH = 1e-9
"""Share of the ball diameter below which a displacement is rounding."""


def bearing_problems(config: BearingConfig | BenchConfig) -> Iterator[Problem]:
    """Every contradiction between the fields of bearings."""
    yield from name_problems(config)
    yield from section_problems(config)
    for key in ("cases", "curves"):
        if getattr(config, key) and not config.bearings:
            yield Problem(key, "there is no bearing", f"leave {key} out, or give bearings", at_key=True)
    for i, curve in enumerate(config.curves):
        yield from _curve(i, curve, config.bearings)


def bench_problems(config: BenchConfig) -> Iterator[Problem]:
    """Every contradiction between the fields of a bench."""
    yield from bearing_problems(config)
    if GROUND in config.bodies:
        yield Problem(f"bodies.{GROUND}", f"'{GROUND}' is the ground", "give the body another name", at_key=True)
    for check in (_masses, _frames, _apart, _loads, _moduli, _time, estimate_problems, place_problems):
        yield from check(config)
    if config.field is not None and config.field.of == "estimate" and config.estimate is None:
        yield Problem("field.of", "nothing is estimated", "give the section estimate, or say simulate")


def _time(config: BenchConfig) -> Iterator[Problem]:
    yield from step_problems("simulate.time_step", config.simulate.duration, config.simulate.time_step, 1, MOST_STEPS)
    if config.simulate.start == "equilibrium":
        for name, body in config.bodies.items():
            for key in ("velocity", "spin"):
                if any(getattr(body, key)):
                    what = "a bench that starts from its equilibrium is at rest"
                    yield Problem(f"bodies.{name}.{key}", what, "set simulate.start: as_given")


def _moduli(config: BenchConfig) -> Iterator[Problem]:
    """A modulus of one name is one unknown, whatever bodies it scales."""
    first: dict[str, tuple[str, float]] = {}
    for name, body in config.flexible.items():
        for key, modulus in body.moduli.items():
            where = f"bodies.{name}.moduli.{key}"
            if key in RESERVED:
                yield Problem(where, f"the name '{key}' is taken", "choose another name", at_key=True)
            owner, value = first.setdefault(key, (name, modulus.value))
            if value != modulus.value:
                what = f"{modulus.value:g} Pa here, {value:g} Pa in '{owner}'"
                remedy = "a modulus of one name is one parameter: give the two different names, or one value"
                yield Problem(f"{where}.value", what, remedy)


def _masses(config: BenchConfig) -> Iterator[Problem]:
    masses = {name: body.mass for name, body in config.bodies.items() if isinstance(body, RigidBodySection)}
    if not masses:
        return
    light, heavy = min(masses, key=masses.__getitem__), max(masses, key=masses.__getitem__)
    if masses[heavy] / MASSES_APART > masses[light]:
        # which of the two is meant nobody can know: the one farther from a kilogram is the odd one
        odd, other = (heavy, light) if abs(np.log(masses[heavy])) >= abs(np.log(masses[light])) else (light, heavy)
        yield Problem(
            f"bodies.{odd}.mass",
            f"{masses[odd]:g} kg beside {masses[other]:g} kg of '{other}': more than {MASSES_APART:g} lie between them",
            "check both, in kg; what is to stay where it is belongs to the ground",
        )


def _frames(config: BenchConfig) -> Iterator[Problem]:
    for name, frame in config.frames.items():
        key = f"frames.{name}"
        flexible = frame.body in config.flexible
        if flexible and frame.node is None:
            yield Problem(f"{key}.node", "missing", "a frame on a flexible body is at one of its nodes", at_key=True)
        if not flexible and frame.node is not None:
            yield Problem(f"{key}.node", f"'{frame.body}' has no nodes", "give pose.origin instead")
        if flexible and frame.node is not None and any(frame.pose.origin):
            yield Problem(f"{key}.pose.origin", "the node is the origin", "leave pose.origin out")


def _loads(config: BenchConfig) -> Iterator[Problem]:
    for name, force in config.forces.items():
        frame = config.frames.get(force.frame) if isinstance(force, PointInput) else None
        if isinstance(force, PointInput) and frame is not None and frame.body == GROUND:
            what = f"frame '{force.frame}' is on the ground, where a load moves nothing"
            yield Problem(f"forces.{name}.frame", what, "name a frame on a body")


def _apart(config: BenchConfig) -> Iterator[Problem]:
    """Where a joint, a force or a sensor is between two frames, these are on two bodies."""
    for section in ("joints", "forces", "sensors"):
        for name, entry in getattr(config, section).items():
            frames = [one for one in marked(entry, Names, f"{section}.{name}") if one.mark.section == "frames"]
            bodies = [config.frames[one.value].body for one in frames if one.value in config.frames]
            if len(bodies) == 2 and bodies[0] == bodies[1]:
                keys = {one.field for one in frames}
                where = keys.pop() if len(keys) == 1 else f"{section}.{name}"
                yield Problem(where, f"both frames are on '{bodies[0]}'", "name frames of two bodies")


def _curve(i: int, curve: CurveSection, bearings: Mapping[str, BearingSection]) -> Iterator[Problem]:
    """A ring moves by no more than a ball, at the pitch circle, and by more than rounding."""
    for name, bearing in bearings.items():
        if not curve.includes(name):
            continue
        tilts = curve.along.startswith("tilt")
        arm, unit = (bearing.pitch_diameter / 2, "rad") if tilts else (1.0, "m")
        most, least = bearing.ball_diameter / arm, LEAST_REACH * bearing.ball_diameter / arm
        if curve.reach > most:
            moved = f"moves the balls of '{name}' by {curve.reach * arm:.4g} m, " if tilts else ""
            yield Problem(
                f"curves.{i}.reach",
                f"{curve.reach:g} {unit} {moved or 'is '}beyond the ball diameter of '{name}', {bearing.ball_diameter:g} m",
                f"take at most {most:.4g} {unit}; a bearing gives way by micrometres to a few millimetres",
            )
        elif curve.reach < least:
            yield Problem(
                f"curves.{i}.reach",
                f"{curve.reach:g} {unit} is below {least:.3g} {unit}, which is rounding beside the balls of '{name}'",
                f"take {1e-4 / arm:.2g} {unit}, say",
            )
