"""What the placement of a bench demands of its other sections."""

from __future__ import annotations

from collections.abc import Iterator

from strainsight.config.bench.bench import AccelerationSensor, BenchConfig, MotionSensor, RelativeSensor, StrainSensor
from strainsight.config.bench.place import BenchPlace
from strainsight.config.layout import layout_problems
from strainsight.config.problem import Problem, known
from strainsight.config.zones import zone_problems


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
        free = [name for name, own in parameters.items() if own.std is not None]
        among = "estimate.inputs and estimate.parameters" if free else "estimate.inputs"
        yield from layout_problems(place, (*inputs, *free), among, place.bonded, "place.fixed")
        yield from _candidates(config, place)
        yield from zone_problems("place.include", place.include)
        yield from zone_problems("place.exclude", place.exclude)
    given = {} if config.estimate is None else config.estimate.sensors
    for name, own in given.items():
        if own.layout is not None and (place is None or name not in place.sensors):
            what, remedy = (
                "it is not among the candidates of place",
                f"name it under place.sensors: {{{name}: {{noise: …}}}}",
            )
            yield Problem(f"estimate.sensors.{name}.layout", what, remedy)
        elif own.layout == "random" and place is not None and place.random == 0:
            yield Problem(
                f"estimate.sensors.{name}.layout", "no layout is drawn at random", "set place.random to 1 or more"
            )
    for name, sensor in config.sensors.items():
        if isinstance(sensor, StrainSensor):
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


def _layout(key: str, sensor: StrainSensor, place: BenchPlace | None) -> Iterator[Problem]:
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
