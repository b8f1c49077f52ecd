"""What one field of a bench demands of another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from strainsight.config.base import GROUND, Names, Problem, known, marked, name_problems, section_problems, undivided
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
    FlexibleBodySection,
    LoadCase,
    RigidBodySection,
)
from strainsight.config.bench.checks_estimate import estimate_problems
from strainsight.config.checks_model import RESERVED
from strainsight.config.layout import layout_problems


def place_problems(config: BenchConfig) -> Iterator[Problem]:
    """What `place` and the sensors that use it demand of the rest of a bench."""
    place = config.place
    if place is not None:
        if config.estimate is None or not config.estimate.inputs:
            yield Problem(
                "place", "no input is unknown", "name the loads to place for under estimate.inputs", at_key=True
            )
        parameters = {} if config.estimate is None else config.estimate.parameters
        if place.pool + place.bonded < place.keep:
            yield Problem("place.pool", f"{place.pool} candidates for {place.keep} gauges", "take a larger pool")
        if list(place.poses) != sorted(set(place.poses)):
            yield Problem("place.poses", "not in ascending order, each once", "sort them")
        if max(place.poses) > config.simulate.duration:
            what = f"{max(place.poses):g} s is beyond the run of {config.simulate.duration:g} s"
            yield Problem("place.poses", what, "take instants of the run")
        if (
            config.estimate is not None
            and config.estimate.method.noise == "as_printed"
            and config.estimate.disturbance > 0
        ):
            yield Problem(
                "estimate.disturbance",
                "place does not know the disturbance as printed, which is on every velocity, whatever the joints",
                "set it to 0, or method.noise: before_step, or place in a run of its own",
            )
        inputs = () if config.estimate is None else tuple(config.estimate.inputs)
        free = [name for name, entry in parameters.items() if entry.std is not None]
        among = "estimate.inputs and estimate.parameters" if free else "estimate.inputs"
        yield from layout_problems(place, (*inputs, *free), among, place.bonded, "place.fixed")
        yield from _candidates(config, place)
    sensors = {} if config.estimate is None else config.estimate.sensors
    for name, entry in sensors.items():
        if entry.layout is not None and (place is None or name not in place.sensors):
            what, remedy = (
                "it is not among the candidates of place",
                f"name it under place.sensors: {{{name}: {{noise: …}}}}",
            )
            yield Problem(f"estimate.sensors.{name}.layout", what, remedy)
        elif entry.layout == "random" and place is not None and place.random == 0:
            yield Problem(
                f"estimate.sensors.{name}.layout", "no layout is drawn at random", "set place.random to 1 or more"
            )
    for name, sensor in config.sensors.items():
        if isinstance(sensor, StrainSensorSection):
            yield from _layout(f"sensors.{name}", sensor, place)


def _candidates(config: BenchConfig, place: BenchPlace) -> Iterator[Problem]:
    """Sensors of the bench among the candidates."""
    for name in place.sensors:
        key, sensor = f"place.sensors.{name}", config.sensors.get(name)
        yield from known(key, name, config.sensors, "sensor")
        if isinstance(sensor, AccelerationSensor) and config.estimate is not None and config.estimate.disturbance > 0:
            what = f"{name} would feel the white acceleration, which is no motion between samples"
            yield Problem("estimate.disturbance", what, f"set it to 0, or take {name} out of place.sensors")
        moves = isinstance(sensor, RelativeSensor | AccelerationSensor)
        if (
            sensor is not None
            and not moves
            and not (isinstance(sensor, MotionSensor) and sensor.quantity == "position")
        ):
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
        yield Problem(f"{key}.layout", "no layout is drawn at random", "set place.random to 1 or more")


MOST_STEPS = 10_000_000
MASSES_APART = 1e12
"""Ratio of two masses up to which the joints between them hold to rounding."""

LEAST_REACH = 1e-9
"""Share of the ball diameter below which a displacement is rounding."""


def bearing_problems(config: BearingConfig) -> Iterator[Problem]:
    """Every contradiction between the fields of bearings."""
    yield from name_problems(config)
    yield from section_problems(config)
    yield from bearings_alone(config.bearings, config.cases, config.curves)


def bench_problems(config: BenchConfig) -> Iterator[Problem]:
    """Every contradiction between the fields of a bench."""
    yield from name_problems(config)
    yield from section_problems(config)
    yield from bearings_alone(config.bearings, config.cases, config.curves)
    if GROUND in config.bodies:
        yield Problem(f"bodies.{GROUND}", f"'{GROUND}' is the ground", "give the body another name", at_key=True)
    yield from _masses(config)
    yield from _frames(config)
    yield from _apart(config)
    yield from _loads(config)
    yield from _moduli(config)
    yield from _time(config)
    yield from estimate_problems(config)
    yield from place_problems(config)
    yield from _field(config)


def _time(config: BenchConfig) -> Iterator[Problem]:
    duration, h = config.simulate.duration, config.simulate.time_step
    steps = duration / h
    if not 1 - 1e-9 <= steps <= MOST_STEPS:
        yield Problem("simulate.time_step", f"{steps:.3g} steps", f"take 1 to {MOST_STEPS} steps")
    else:
        yield from undivided("simulate.time_step", duration, h)
    if config.simulate.start == "equilibrium":
        for name, body in config.bodies.items():
            for key in ("velocity", "spin"):
                if any(getattr(body, key)):
                    yield Problem(
                        f"bodies.{name}.{key}",
                        "a bench that starts from its equilibrium is at rest",
                        "set simulate.start: as_given",
                    )


def _field(config: BenchConfig) -> Iterator[Problem]:
    """What `field` demands of the rest of a bench."""
    field = config.field
    if field is None:
        return
    if field.of == "estimate" and config.estimate is None:
        yield Problem("field.of", "nothing is estimated", "give the section estimate, or say simulate")


def _moduli(config: BenchConfig) -> Iterator[Problem]:
    """A modulus of one name is one unknown, whatever bodies it scales."""
    first: dict[str, tuple[str, float]] = {}
    for name, body in config.bodies.items():
        if isinstance(body, FlexibleBodySection):
            for key, modulus in body.moduli.items():
                if key in RESERVED:
                    where = f"bodies.{name}.moduli.{key}"
                    yield Problem(where, f"the name '{key}' is taken", "choose another name", at_key=True)
                owner, value = first.setdefault(key, (name, modulus.value))
                if value != modulus.value:
                    yield Problem(
                        f"bodies.{name}.moduli.{key}.value",
                        f"{modulus.value:g} Pa here, {value:g} Pa in '{owner}'",
                        "a modulus of one name is one parameter: give the two different names, or one value",
                    )


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
        flexible = frame.body in _flexible(config)
        if flexible and frame.node is None:
            yield Problem(f"{key}.node", "missing", "a frame on a flexible body is at one of its nodes", at_key=True)
        if not flexible and frame.node is not None:
            yield Problem(f"{key}.node", f"'{frame.body}' has no nodes", "give pose.origin instead")
        if flexible and frame.node is not None and any(frame.pose.origin):
            yield Problem(f"{key}.pose.origin", "the node is the origin", "leave pose.origin out")


def _loads(config: BenchConfig) -> Iterator[Problem]:
    for name, force in config.forces.items():
        key = f"forces.{name}"
        if force.type not in ("force", "moment"):
            continue
        if force.frame in config.frames and config.frames[force.frame].body == GROUND:
            what = f"frame '{force.frame}' is on the ground, where a load moves nothing"
            yield Problem(f"{key}.frame", what, "name a frame on a body")


def _apart(config: BenchConfig) -> Iterator[Problem]:
    """Where a joint, a force or a sensor is between two frames, these are on two bodies."""
    for section in ("joints", "forces", "sensors"):
        for name, entry in getattr(config, section).items():
            named = [
                (frame_name.field, frame_name.value)
                for frame_name in marked(entry, Names, f"{section}.{name}")
                if frame_name.mark.section == "frames"
            ]
            bodies = [config.frames[frame].body for _, frame in named if frame in config.frames]
            if len(bodies) == 2 and bodies[0] == bodies[1]:
                keys = {key for key, _ in named}
                where = keys.pop() if len(keys) == 1 else f"{section}.{name}"
                yield Problem(where, f"both frames are on '{bodies[0]}'", "name frames of two bodies")


def _flexible(config: BenchConfig) -> list[str]:
    return [name for name, body in config.bodies.items() if isinstance(body, FlexibleBodySection)]


def bearings_alone(
    bearings: Mapping[str, BearingSection], cases: Mapping[str, LoadCase], curves: Sequence[CurveSection]
) -> Iterator[Problem]:
    """Bearings that cannot be built, cases and curves without any, curves that reach too far."""
    for key, entries in (("cases", cases), ("curves", curves)):
        if entries and not bearings:
            yield Problem(key, "there is no bearing", f"leave {key} out, or give bearings", at_key=True)
    if bearings:
        for i, curve in enumerate(curves):
            yield from _curve(i, curve, bearings)


def _chosen(entry: CurveSection, bearings: Mapping[str, BearingSection]) -> tuple[str, ...]:
    if entry.bearing is None:
        return tuple(bearings)
    return (entry.bearing,) if isinstance(entry.bearing, str) else entry.bearing


def _curve(i: int, curve: CurveSection, bearings: Mapping[str, BearingSection]) -> Iterator[Problem]:
    """A ring moves by no more than a ball, at the pitch circle, and by more than rounding."""
    for name in _chosen(curve, bearings):
        if name not in bearings:
            continue
        bearing = bearings[name]
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
