"""Consistency checks between fields of a bench config."""

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
from strainsight.config.bench.bodies import BearingConfig, BearingSection, CurveSection, RigidBodySection
from strainsight.config.bench.checks_estimate import disturbed, estimate_problems
from strainsight.config.bench.connections import PointInput
from strainsight.config.checks_model import RESERVED
from strainsight.config.layout import layout_problems

RANDOM = ("no random layout is computed: place.random is 0", "set place.random to 1 or more")


def place_problems(config: BenchConfig) -> Iterator[Problem]:
    """Check `place`, and the sensors that use it."""
    place, estimate = config.place, config.estimate
    if place is not None:
        inputs, parameters = ({}, {}) if estimate is None else (estimate.inputs, estimate.parameters)
        if not inputs:
            remedy = "list the unknown loads under estimate.inputs"
            yield Problem("place", "the config has no unknown load to estimate", remedy, at_key=True)
        if place.pool + place.bonded < place.keep:
            what = f"place.keep ({place.keep}) exceeds place.pool ({place.pool}) plus bonded gauges ({place.bonded})"
            yield Problem("place.pool", what, "increase place.pool, or reduce place.keep")
        if list(place.poses) != sorted(set(place.poses)):
            yield Problem(
                "place.poses", "the instants are not strictly increasing", "sort the instants, and remove duplicates"
            )
        if max(place.poses) > config.simulate.duration:
            what = f"the instant {max(place.poses):g} s is after the end of the simulation at {config.simulate.duration:g} s"
            yield Problem("place.poses", what, "use instants before the end of the simulation (simulate.duration)")
        if estimate is not None and estimate.method.noise == "as_printed" and estimate.disturbance > 0:
            what = "the stage 'place' does not support a disturbance with method.noise: as_printed"
            remedy = "set estimate.disturbance: 0 or estimate.method.noise: before_step, or place the gauges with another config"
            yield Problem("estimate.disturbance", what, remedy)
        free = [name for name, entry in parameters.items() if entry.std is not None]
        among = "estimate.inputs and estimate.parameters" if free else "estimate.inputs"
        yield from layout_problems(place, (*inputs, *free), among, place.bonded, "place.fixed")
        yield from _candidates(config, place)
    for name, entry in {} if estimate is None else estimate.sensors.items():
        key = f"estimate.sensors.{name}.layout"
        if entry.layout is not None and (place is None or name not in place.sensors):
            absent = "the sensor is not one of the candidates in place.sensors"
            yield Problem(key, absent, f"set place.sensors.{name}: {{noise: …}}, or remove {key}")
        elif entry.layout == "random" and place is not None and place.random == 0:
            yield Problem(key, *RANDOM)
    for name, sensor in config.sensors.items():
        if isinstance(sensor, StrainSensorSection):
            yield from _layout(f"sensors.{name}", sensor, place)


def _candidates(config: BenchConfig, place: BenchPlace) -> Iterator[Problem]:
    """Check the candidate sensors of the bench."""
    for name in place.sensors:
        key, sensor = f"place.sensors.{name}", config.sensors.get(name)
        yield from known(key, name, config.sensors, "sensor")
        yield from disturbed(
            config.estimate, sensor, name, f"set estimate.disturbance: 0, or remove '{name}' from place.sensors"
        )
        moves = isinstance(sensor, RelativeSensor | AccelerationSensor)
        moves |= isinstance(sensor, MotionSensor) and sensor.quantity == "position"
        if sensor is not None and not moves:
            what = "only displacement sensors and accelerometers can be candidates for the placement"
            yield Problem(
                key,
                what,
                "use a sensor with type: relative, type: acceleration, or type: motion with quantity: position",
            )


def _layout(key: str, sensor: StrainSensorSection, place: BenchPlace | None) -> Iterator[Problem]:
    if (sensor.layout is None) == (not sensor.gauges):
        what = "neither 'gauges' nor 'layout' is set" if sensor.layout is None else "'gauges' and 'layout' are both set"
        yield Problem(key, what, "set either gauges or layout, not both", at_key=True)
    if sensor.layout is None:
        return
    instead = f"list the gauges under {key}.gauges and remove {key}.layout"
    if place is None:
        yield Problem(f"{key}.layout", "the config has no section 'place'", f"add the section 'place', or {instead}")
    elif sensor.body != place.body:
        what = f"the layout has its gauges on the body '{place.body}'"
        yield Problem(f"{key}.body", what, f"set {key}.body: {place.body}, or {instead}")
    elif sensor.layout == "random" and place.random == 0:
        yield Problem(f"{key}.layout", *RANDOM)


MOST_STEPS = 10_000_000
MASSES_APART = 1e12
"""Largest ratio of two masses for which joint constraints are accurate to rounding errors."""

LEAST_REACH = 1e-9
"""Smallest displacement relative to the ball diameter that exceeds rounding errors."""


def bearing_problems(config: BearingConfig | BenchConfig) -> Iterator[Problem]:
    """Yield every inconsistency between the fields of bearings."""
    yield from name_problems(config)
    yield from section_problems(config)
    for key in ("cases", "curves"):
        if getattr(config, key) and not config.bearings:
            yield Problem(
                key, "the config has no bearing", f"remove {key}, or add a bearing under bearings", at_key=True
            )
    for i, curve in enumerate(config.curves):
        yield from _curve(i, curve, config.bearings)


def bench_problems(config: BenchConfig) -> Iterator[Problem]:
    """Yield every inconsistency between the fields of a bench."""
    yield from bearing_problems(config)
    if GROUND in config.bodies:
        what = f"the name '{GROUND}' is reserved for the ground"
        yield Problem(f"bodies.{GROUND}", what, "rename the body", at_key=True)
    for check in (_masses, _frames, _two_bodies, _loads, _moduli, _time, estimate_problems, place_problems):
        yield from check(config)
    if config.field is not None and config.field.of == "estimate" and config.estimate is None:
        yield Problem("field.of", "the config has no section 'estimate'", "add the section, or set field.of: simulate")


def _time(config: BenchConfig) -> Iterator[Problem]:
    yield from step_problems("simulate.time_step", config.simulate.duration, config.simulate.time_step, 1, MOST_STEPS)
    if config.simulate.start == "equilibrium":
        for name, body in config.bodies.items():
            for key in ("velocity", "spin"):
                if any(getattr(body, key)):
                    what = "has no effect with a static equilibrium as initial state"
                    yield Problem(f"bodies.{name}.{key}", what, "set simulate.start: as_given, or remove the key")


def _moduli(config: BenchConfig) -> Iterator[Problem]:
    """Check that moduli with the same name, which are one unknown, have the same value."""
    first: dict[str, tuple[str, float]] = {}
    for name, body in config.flexible.items():
        for key, modulus in body.moduli.items():
            where = f"bodies.{name}.moduli.{key}"
            if key in RESERVED:
                yield Problem(
                    where,
                    f"the name '{key}' is reserved for a dataset of the result files",
                    "rename the modulus",
                    at_key=True,
                )
            owner, value = first.setdefault(key, (name, modulus.value))
            if value != modulus.value:
                what = f"{modulus.value:g} Pa differs from {value:g} Pa of the modulus '{key}' in body '{owner}'"
                remedy = "moduli with the same name are one parameter: use the same value, or different names"
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
            f"a mass of {masses[odd]:g} kg and the mass of '{other}', {masses[other]:g} kg, differ by more than a factor of "
            f"{MASSES_APART:g}",
            "check that both masses are in kg; to replace a very heavy body by the ground, set body: ground in its frames",
        )


def _frames(config: BenchConfig) -> Iterator[Problem]:
    for name, frame in config.frames.items():
        key = f"frames.{name}"
        flexible = frame.body in config.flexible
        if flexible and frame.node is None:
            what = f"a frame on the flexible body '{frame.body}' needs a node"
            yield Problem(f"{key}.node", what, "set the id of the node at the origin of the frame", at_key=True)
        if not flexible and frame.node is not None:
            yield Problem(f"{key}.node", f"'{frame.body}' is not a flexible body", "remove node, and set pose.origin")
        if flexible and frame.node is not None and any(frame.pose.origin):
            yield Problem(f"{key}.pose.origin", "has no effect: the node is the origin of the frame", "remove the key")


def _loads(config: BenchConfig) -> Iterator[Problem]:
    for name, force in config.forces.items():
        frame = config.frames.get(force.frame) if isinstance(force, PointInput) else None
        if isinstance(force, PointInput) and frame is not None and frame.body == GROUND:
            what = f"frame '{force.frame}' is on the ground, where a load has no effect"
            yield Problem(f"forces.{name}.frame", what, "use a frame on a body")


def _two_bodies(config: BenchConfig) -> Iterator[Problem]:
    """Check that the two frames of a joint, force or sensor are on different bodies."""
    for section in ("joints", "forces", "sensors"):
        for name, entry in getattr(config, section).items():
            frames = [one for one in marked(entry, Names, f"{section}.{name}") if one.mark.section == "frames"]
            bodies = [config.frames[one.value].body for one in frames if one.value in config.frames]
            if len(bodies) == 2 and bodies[0] == bodies[1]:
                keys = {one.field for one in frames}
                where = keys.pop() if len(keys) == 1 else f"{section}.{name}"
                yield Problem(
                    where, f"both frames are on the same body, '{bodies[0]}'", "use frames on two different bodies"
                )


def _curve(i: int, curve: CurveSection, bearings: Mapping[str, BearingSection]) -> Iterator[Problem]:
    """Check that a displacement of a ring is below the ball diameter (at the pitch circle), and above rounding errors."""
    for name, bearing in bearings.items():
        if not curve.includes(name):
            continue
        tilts = curve.along.startswith("tilt")
        arm, unit = (bearing.pitch_diameter / 2, "rad") if tilts else (1.0, "m")
        most, least = bearing.ball_diameter / arm, LEAST_REACH * bearing.ball_diameter / arm
        if curve.reach > most:
            yield Problem(
                f"curves.{i}.reach",
                f"{curve.reach:g} {unit} moves the balls of '{name}' by up to {curve.reach * arm:.4g} m, more than the ball "
                f"diameter of {bearing.ball_diameter:g} m",
                f"use at most {most:.4g} {unit}; bearing displacements are typically micrometres to a few millimetres",
            )
        elif curve.reach < least:
            what = f"{curve.reach:g} {unit} is below the numerical resolution of {least:.3g} {unit} for the bearing '{name}'"
            yield Problem(f"curves.{i}.reach", what, f"use a larger value, for example {1e-4 / arm:.2g} {unit}")
