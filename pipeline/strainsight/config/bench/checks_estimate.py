"""What the estimate of a bench, and its truth by another integrator, demand of other sections."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from strainsight.config.base import Problem, known, undivided
from strainsight.config.bench.bench import AccelerationSensor, BenchConfig, ReactionSensor
from strainsight.config.bench.bodies import RADII
from strainsight.config.bench.connections import Driven, Load
from strainsight.config.bench.estimate import BenchEstimateSection, EstimatedParameter, FromFile

KEYS_OF_OTHER = ("step", "duration", "histories", "within")
"""Keys that no other truth has."""
CLOCK_SHARE = 1e-6
"""Share of a step by which two clocks may differ."""


def truth_problems(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    """What keys of `estimate.truth` ask of each other, of the filter's step and of the joints."""
    truth, key = estimate.truth, "estimate.truth"
    if truth.model == "walk" and estimate.tolerances is not None and estimate.measured is None:
        what = "a truth of the filter's own model has exact gauges"
        yield Problem(
            "estimate.tolerances", what, "take truth.model: fine or other, or leave tolerances out", at_key=True
        )
    if truth.model != "other":
        for name in KEYS_OF_OTHER:
            if name in truth.model_fields_set and getattr(truth, name) != type(truth).model_fields[name].default:
                what = f"a truth '{truth.model}' has none"
                yield Problem(f"{key}.{name}", what, "leave it out, or set estimate.truth.model: other", at_key=True)
        return
    if any(isinstance(joint, Driven) for joint in config.joints.values()):
        yield Problem(f"{key}.model", "a driven joint has no such truth", "take fine")
    h = estimate.time_step or config.simulate.time_step
    every = round(h / truth.step)
    if every < 1 or abs(every * truth.step - h) > CLOCK_SHARE * truth.step:
        what = f"steps of {truth.step:g} s do not divide the filter's step of {h:g} s"
        yield Problem(f"{key}.step", what, "divide estimate.time_step by a whole number", at_key=True)
    duration = estimate.duration or config.simulate.duration
    if truth.duration is not None and truth.duration < duration * (1 - CLOCK_SHARE):
        what = f"it ends after {truth.duration:g} s, the estimate after {duration:g} s"
        yield Problem(f"{key}.duration", what, f"make it {duration:g} or more, or leave it out", at_key=True)
    if 1 < truth.histories < estimate.runs:
        what = f"{truth.histories} for {estimate.runs} runs"
        yield Problem(f"{key}.histories", what, f"make it {estimate.runs}, or 1: the same one for all")
    if truth.histories > 1 and truth.within == 0:
        yield Problem(f"{key}.histories", "all of them are the same", "give within, in seconds of the load histories")


FEW = 3
"""Parameters of a bank."""
FEWEST_STEPS, MOST_STEPS = 2, 1_000_000
FARTHEST = 100.0
"""Ratio of a guess to the bench's own value beyond which it is in another unit: GPa for Pa, mm for m."""
COMPONENTS = {"relative": 5, "motion": 3, "acceleration": 3, "reaction": 6}


def estimate_problems(config: BenchConfig) -> Iterator[Problem]:
    """Every contradiction between `estimate` and the bench."""
    estimate = config.estimate
    if estimate is None:
        return
    loads = [name for name, force in config.forces.items() if isinstance(force, Load)]
    for name in estimate.inputs:
        yield from known(f"estimate.inputs.{name}", name, loads, "force or moment")
    yield from _load_models(config, estimate)
    if estimate.method.step_error == "estimated" and any(isinstance(j, Driven) for j in config.joints.values()):
        yield Problem(
            "estimate.method.step_error",
            "what a step leaves out is not estimated beside driven joints",
            "leave it out, and take a step that follows the loads and the drive",
        )
    if estimate.method.step_error == "estimated" and estimate.method.noise == "as_printed":
        yield Problem(
            "estimate.method.step_error",
            "what a step leaves out follows from how the loads change within it, and as printed they change after it",
            "leave it out, or set estimate.method.noise: before_step",
        )
    if not estimate.inputs and not any(entry.std for entry in estimate.parameters.values()):
        yield Problem("estimate", "nothing is unknown", "name inputs, or parameters with std", at_key=True)
    if estimate.accept and not isinstance(estimate.measured, FromFile):
        yield Problem(
            "estimate.accept",
            "there is no record of a test that could contradict the model",
            "leave it out (--accept), or name the record under estimate.measured",
        )
    yield from _sensors(config, estimate)
    yield from _parameters(config, estimate)
    yield from _distinguishable(config, estimate)
    yield from _bank(estimate)
    yield from _times(config, estimate)
    yield from truth_problems(config, estimate)
    yield from _elsewhere(config, estimate)


def _load_models(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    """What a model of an unknown load needs."""
    for name, entry in estimate.inputs.items():
        key, force = f"estimate.inputs.{name}", config.forces.get(name)
        walks = entry.model == "random_walk"
        if not walks and entry.increment is not None:
            what = f"increment is of a random walk, and the model is {entry.model}"
            yield Problem(f"{key}.increment", what, "leave it out: amplitude and frequency say how the load moves")
        if walks and entry.increment is not None:
            continue
        if isinstance(force, Load) and force.signal.type != "sine":
            for field, value in (("frequency", entry.frequency), ("amplitude", entry.amplitude)):
                if value is None:
                    need = "a random walk without increment" if walks else entry.model
                    what = f"{need} needs the load's typical {field}, and its history is no sine"
                    yield Problem(key, what, f"give {field}" + (", or increment" if walks else ""), at_key=True)
        if not walks and config.place is not None:
            what = f"{entry.model}: place takes unknown loads of a bench for random walks"
            yield Problem(
                f"{key}.model", what, "take random_walk where gauges are placed, and this model in a run of its own"
            )


def _sensors(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    for name, entry in estimate.sensors.items():
        key = f"estimate.sensors.{name}"
        yield from known(key, name, config.sensors, "sensor")
        if name not in config.sensors:
            return
        if isinstance(config.sensors[name], ReactionSensor):
            yield Problem(
                key, "the filter has no equations for this kind of sensor", "take it out: it is simulated only"
            )
        if isinstance(config.sensors[name], AccelerationSensor) and estimate.disturbance > 0:
            yield Problem(
                "estimate.disturbance",
                f"{name} would feel the white acceleration, which is no motion between samples",
                f"set it to 0, and put what the model has wrong into the noise of {name}",
            )
        count = channels_of(config, name)
        for field, many in (("noise", "noises"), ("bias", "offsets"), ("drift", "drifts")):
            values = getattr(entry, field)
            if count is not None and isinstance(values, tuple) and len(values) != count:
                what = f"{len(values)} {many} for {count} components"
                yield Problem(f"{key}.{field}", what, f"give one number, or {count}")
    counts = [_given(config, estimate, name) for name in estimate.sensors]
    known_counts = [count for count in counts if count is not None]
    if len(known_counts) == len(counts) and sum(known_counts) < len(estimate.inputs):
        yield Problem(
            "estimate.sensors",
            f"{sum(known_counts)} channels for {len(estimate.inputs)} unknown loads",
            "give the filter more sensors, or make a load known",
        )


def _given(config: BenchConfig, estimate: BenchEstimateSection, name: str) -> int | None:
    """How many components of a sensor the filter is given; None where a placed layout says it later."""
    if estimate.sensors[name].layout is not None:
        return None
    if isinstance(estimate.measured, FromFile) and name in estimate.measured.channels:
        return sum(channel is not None for channel in estimate.measured.channels[name])
    return channels_of(config, name)


def channels_of(config: BenchConfig, name: str) -> int | None:
    """How many components a sensor has; None where a placed layout says it later."""
    sensor = config.sensors[name]
    if sensor.type != "strain":
        return COMPONENTS[sensor.type]
    gauges = sensor.gauges
    return sum(len(gauge.angles) if gauge.angles else 1 for gauge in gauges) if gauges else None


def _parameters(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    moduli = {
        name: m.value for body in config.bodies.values() if body.type == "flexible" for name, m in body.moduli.items()
    }
    taken: dict[tuple[str, str], str] = {}
    used = {force.bearing for force in config.forces.values() if force.type == "bearing"}
    for name, entry in estimate.parameters.items():
        key = f"estimate.parameters.{name}"
        if name in estimate.inputs:
            yield Problem(
                key, "a load of the estimate has the same name", "give the parameter another one", at_key=True
            )
        if (entry.bearing is None) != (entry.property is None):
            yield Problem(
                key, "bearing and property belong together", "give both, or neither for a modulus", at_key=True
            )
            continue
        if entry.bearing is None:
            yield from known(key, name, moduli, "modulus under bodies.*.moduli")
        else:
            if entry.bearing in config.bearings and entry.bearing not in used:
                yield Problem(
                    f"{key}.bearing", f"no force is of '{entry.bearing}'", "name a bearing of this bench's forces"
                )
            other = taken.setdefault((entry.bearing, str(entry.property)), name)
            if other != name:
                yield Problem(key, f"'{other}' is the same property", "name it once", at_key=True)
        if entry.starts and entry.std is None:
            yield Problem(f"{key}.starts", "it is not estimated", "give std, or leave starts out")
        if entry.starts and estimate.truth.model == "walk":
            what = "a drawn truth starts where the filter's own belief puts it"
            yield Problem(f"{key}.starts", what, "leave starts out, or take another truth")
        if entry.property != "preload":
            for field, value in (("guess", entry.guess), *(("starts", start) for start in entry.starts)):
                if value is not None and not value > 0:
                    yield Problem(f"{key}.{field}", f"{value:g} is not positive", "give a positive value")
        if entry.std is None and entry.guess is None:
            yield Problem(
                key, "neither guess nor std: nothing is wrong with it", "give one, or leave it out", at_key=True
            )
        nominal = moduli.get(name) if entry.bearing is None else _of_bearing(config, entry)
        yield from _units(key, entry, nominal)
    for bearing in config.bearings:
        yield from _grooves(config, bearing, estimate.parameters)
        for name, entry in estimate.parameters.items():
            for start in entry.starts if entry.bearing == bearing else ():
                moved = {**estimate.parameters, name: entry.model_copy(update={"guess": start})}
                for problem in _grooves(config, bearing, moved):
                    yield replace(problem, key=f"estimate.parameters.{name}.starts")


def _of_bearing(config: BenchConfig, entry: EstimatedParameter) -> float | None:
    """The bench's own value of a bearing's property; None for a preload, which may be of any sign and size."""
    if entry.bearing not in config.bearings or entry.property == "preload":
        return None
    return float(getattr(config.bearings[entry.bearing], str(entry.property)))


def _units(key: str, entry: EstimatedParameter, nominal: float | None) -> Iterator[Problem]:
    """A guess far from the bench's own value is in another unit."""
    unit = "Pa" if entry.bearing is None else "m"
    for field, value in (("guess", entry.guess), *(("starts", start) for start in entry.starts)):
        if nominal and value is not None and value > 0 and not 1 / FARTHEST <= value / nominal <= FARTHEST:
            what = f"{value:g} {unit} beside {nominal:g} {unit} in the bench"
            yield Problem(f"{key}.{field}", what, f"give it in {unit}, within a factor of {FARTHEST:g}")


def _grooves(config: BenchConfig, bearing: str, parameters: Mapping[str, EstimatedParameter]) -> Iterator[Problem]:
    """A groove has to be wider than its ball at every guess."""
    estimated = {str(e.property): (name, e) for name, e in parameters.items() if e.bearing == bearing}
    entry = config.bearings[bearing]

    def guess(field: str) -> float:
        stated = estimated[field][1].guess if field in estimated else None
        return float(getattr(entry, field) if stated is None else stated)

    ball = guess("ball_diameter") / 2 + max(guess("preload"), 0.0)
    for radius in RADII:
        if guess(radius) <= ball and estimated:
            blamed = estimated.get("ball_diameter") or estimated.get(radius) or next(iter(estimated.values()))
            yield Problem(
                f"estimate.parameters.{blamed[0]}.guess",
                f"{radius} of {guess(radius):g} m would not pass a ball of {ball:g} m in radius",
                "a groove is wider than its ball: change the radii with it, or guess nearer",
            )
            return


def _distinguishable(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    """Diameter and preload are one unknown where the groove centres stay: both only add to the interference."""
    for bearing, entry in config.bearings.items():
        free = {
            str(e.property): n for n, e in estimate.parameters.items() if e.bearing == bearing and e.std is not None
        }
        if entry.groove_centres == "fixed" and {"ball_diameter", "preload"} <= free.keys():
            yield Problem(
                f"estimate.parameters.{free['preload']}",
                "with groove_centres: fixed, ball diameter and preload are the same unknown",
                "estimate one of them",
                at_key=True,
            )


def _bank(estimate: BenchEstimateSection) -> Iterator[Problem]:
    """A bank is of few constants, and of iterated filters."""
    if estimate.method.parameters != "bank":
        return
    if estimate.tolerances is not None:
        what = "a bank has no errors of gauges"
        yield Problem(
            "estimate.tolerances", what, "leave it out, or set estimate.method.parameters: extended", at_key=True
        )
    if estimate.hold_out is not None:
        what = "a bank says nothing of channels that are left out"
        yield Problem("estimate.hold_out", what, "leave it out, or set estimate.method.parameters: extended")
    key, free = "estimate.method.parameters", [n for n, e in estimate.parameters.items() if e.std is not None]
    extended = "or set estimate.method.parameters: extended"
    if not free:
        yield Problem(key, "no parameter is estimated", "give one of estimate.parameters a std, or leave it out")
    if len(free) > FEW:
        what = f"{len(free)} parameters, a bank is of {FEW} at most"
        yield Problem(key, what, f"leave out the std of {len(free) - FEW} of them, {extended}")
    if estimate.method.update != "iterated":
        what = f"'{estimate.method.update}' is a form of the extended filter"
        yield Problem("estimate.method.update", what, f"set iterated, {extended}")
    for name in free:
        if estimate.parameters[name].increment > 0:
            what = "in a bank parameters are constants"
            yield Problem(f"estimate.parameters.{name}.increment", what, f"leave increment out, {extended}")


def _times(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    duration = estimate.duration or config.simulate.duration
    h = estimate.time_step or config.simulate.time_step
    steps = duration / h
    if not FEWEST_STEPS * (1 - 1e-9) <= steps <= MOST_STEPS:
        what = f"{duration:g} s are {steps:.3g} steps of {h:g} s"
        yield Problem("estimate.time_step", what, f"take {FEWEST_STEPS} to {MOST_STEPS} steps")
    else:
        yield from undivided("estimate.time_step", duration, h, "estimate.duration")


def _elsewhere(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    measured = estimate.measured
    if measured is None:
        return
    if estimate.truth.model != "fine":
        what = f"'{estimate.truth.model}' beside measurements"
        yield Problem("estimate.truth.model", what, "leave truth.model out, or measured")
    if isinstance(measured, FromFile):
        yield from _in_file(config, estimate, measured)
        return
    for name in estimate.sensors:
        sensor = config.sensors.get(name)
        if sensor is not None and sensor.type == "strain" and sensor.zeroed:
            what = "the loads under which it was zeroed on the other bench are not known here"
            yield Problem(f"sensors.{name}.zeroed", what, "set zeroed: false, or leave the sensor out of the estimate")
        if isinstance(sensor, AccelerationSensor) and sensor.gravity and measured.scale != 1:
            what = "gravity is not scaled with the lengths of the other bench"
            yield Problem(f"sensors.{name}.gravity", what, "set gravity: false on both, or scale: 1")
    for name in measured.sensors:
        yield from known(f"estimate.measured.sensors.{name}", name, list(estimate.sensors), "sensor of the filter")
    for name in measured.inputs:
        yield from known(f"estimate.measured.inputs.{name}", name, list(estimate.inputs), "unknown input")
    if measured.run == config.name:
        yield Problem("estimate.measured.from", "is this run itself", "name another run, whose sensors are measured")


def _in_file(config: BenchConfig, estimate: BenchEstimateSection, measured: FromFile) -> Iterator[Problem]:
    """Channels of a file beside the sensors of the filter."""
    if estimate.runs != 1:
        yield Problem("estimate.runs", "a test is one run, with the noise that it has", "set runs: 1")
    for name, channels in measured.channels.items():
        key = f"estimate.measured.channels.{name}"
        yield from known(key, name, list(estimate.sensors), "sensor of the filter")
        count = channels_of(config, name) if name in config.sensors else None
        if count is not None and len(channels) != count:
            what = f"{len(channels)} channels for {count} components"
            yield Problem(key, what, "give a channel for each, in their order; null where one was not measured")
        for i, entry in enumerate(channels):
            if entry is not None and entry.bridge is not None and entry.bridge.arrangement == "sum":
                what = "a bench has no bridges of several places"
                yield Problem(f"{key}.{i}.bridge.arrangement", what, "take quarter, or how its bridge is completed")
        if not any(channels):
            yield Problem(key, "no component is measured", "leave the sensor out of estimate.sensors")
    for name in estimate.sensors:
        if name not in measured.channels:
            yield Problem(
                "estimate.measured.channels",
                f"the sensor '{name}' has none",
                f"add {name}, or take it from estimate.sensors",
            )
