"""What the estimate of a bench, and its truth by another integrator, demand of other sections."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from strainsight.config.base import Problem, known, step_problems
from strainsight.config.bench.bench import AccelerationSensor, BenchConfig, ReactionSensor, Sensor, units_of
from strainsight.config.bench.bodies import RADII
from strainsight.config.bench.connections import Load
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
        remedy = "take truth.model: fine or other, or leave tolerances out"
        yield Problem("estimate.tolerances", what, remedy, at_key=True)
    if truth.model != "other":
        for name in KEYS_OF_OTHER:
            if name in truth.model_fields_set and getattr(truth, name) != type(truth).model_fields[name].default:
                what = f"a truth '{truth.model}' has none"
                yield Problem(f"{key}.{name}", what, "leave it out, or set estimate.truth.model: other", at_key=True)
        return
    if config.driven:
        yield Problem(f"{key}.model", "a driven joint has no such truth", "take fine")
    h, duration = config.filter_step, config.filter_duration
    every = round(h / truth.step)
    if every < 1 or abs(every * truth.step - h) > CLOCK_SHARE * truth.step:
        what = f"steps of {truth.step:g} s do not divide the filter's step of {h:g} s"
        yield Problem(f"{key}.step", what, "divide estimate.time_step by a whole number", at_key=True)
    if truth.duration is not None and truth.duration < duration * (1 - CLOCK_SHARE):
        what = f"it ends after {truth.duration:g} s, the estimate after {duration:g} s"
        yield Problem(f"{key}.duration", what, f"make it {duration:g} or more, or leave it out", at_key=True)
    if 1 < truth.histories < estimate.runs:
        what = f"{truth.histories} for {estimate.runs} runs"
        yield Problem(f"{key}.histories", what, f"make it {estimate.runs}, or 1: the same one for all")
    if truth.histories > 1 and truth.within == 0:
        yield Problem(f"{key}.histories", "all of them are the same", "give within, in seconds of the load histories")


FEW = 3
"""Parameters of a grid filter."""
FEWEST_STEPS, MOST_STEPS = 2, 1_000_000
FARTHEST = 100.0
"""Ratio of a guess to the bench's own value beyond which it is in another unit: GPa for Pa, mm for m."""


def estimate_problems(config: BenchConfig) -> Iterator[Problem]:
    """Every contradiction between `estimate` and the bench."""
    estimate = config.estimate
    if estimate is None:
        return
    loads = [name for name, force in config.forces.items() if isinstance(force, Load)]
    for name in estimate.inputs:
        yield from known(f"estimate.inputs.{name}", name, loads, "force or moment")
    yield from _load_models(config, estimate)
    if estimate.method.step_error == "estimated" and config.driven:
        what = "what a step leaves out is not estimated beside driven joints"
        remedy = "leave it out, and take a step that follows the loads and the drive"
        yield Problem("estimate.method.step_error", what, remedy)
    if estimate.method.step_error == "estimated" and estimate.method.noise == "as_printed":
        what = "what a step leaves out follows from how the loads change within it, and as printed they change after it"
        remedy = "leave it out, or set estimate.method.noise: before_step"
        yield Problem("estimate.method.step_error", what, remedy)
    if not estimate.inputs and not any(entry.std for entry in estimate.parameters.values()):
        yield Problem("estimate", "nothing is unknown", "name inputs, or parameters with std", at_key=True)
    if estimate.accept and not isinstance(estimate.measured, FromFile):
        what = "there is no record of a test that could contradict the model"
        remedy = "leave it out (--accept), or name the record under estimate.measured"
        yield Problem("estimate.accept", what, remedy)
    yield from _sensors(config, estimate)
    yield from _parameters(config, estimate)
    yield from _distinguishable(config, estimate)
    yield from _check_grid_filter(estimate)
    times = config.filter_duration, config.filter_step
    yield from step_problems("estimate.time_step", *times, FEWEST_STEPS, MOST_STEPS, "estimate.duration")
    yield from truth_problems(config, estimate)
    yield from _elsewhere(config, estimate)


def _load_models(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    """What a model of an unknown load needs."""
    for name, entry in estimate.inputs.items():
        key, force, walks = f"estimate.inputs.{name}", config.forces.get(name), entry.model == "random_walk"
        if not walks and entry.increment is not None:
            what = f"increment is of a random walk, and the model is {entry.model}"
            yield Problem(f"{key}.increment", what, "leave it out: amplitude and frequency say how the load moves")
        if not walks and config.place is not None:
            what = f"{entry.model}: place takes unknown loads of a bench for random walks"
            remedy = "take random_walk where gauges are placed, and this model in a run of its own"
            yield Problem(f"{key}.model", what, remedy)
        if (walks and entry.increment is not None) or not isinstance(force, Load) or force.signal.type == "sine":
            continue
        need = "a random walk without increment" if walks else entry.model
        for field in ("frequency", "amplitude"):
            if getattr(entry, field) is None:
                what = f"{need} needs the load's typical {field}, and its history is no sine"
                yield Problem(key, what, f"give {field}" + ", or increment" * walks, at_key=True)


def disturbed(
    estimate: BenchEstimateSection | None, sensor: Sensor | None, name: str, remedy: str
) -> Iterator[Problem]:
    """A problem of an accelerometer beside a white acceleration."""
    if isinstance(sensor, AccelerationSensor) and estimate is not None and estimate.disturbance > 0:
        what = f"{name} would feel the white acceleration, which is no motion between samples"
        yield Problem("estimate.disturbance", what, f"set it to 0, {remedy}")


def _sensors(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    counts = []
    for name, entry in estimate.sensors.items():
        key, sensor = f"estimate.sensors.{name}", config.sensors.get(name)
        yield from known(key, name, config.sensors, "sensor")
        if sensor is None:
            return
        if isinstance(sensor, ReactionSensor):
            what = "the filter has no equations for this kind of sensor"
            yield Problem(key, what, "take it out: it is simulated only")
        yield from disturbed(estimate, sensor, name, f"and put what the model has wrong into the noise of {name}")
        count = channels_of(config, name)
        for field, many in (("noise", "noises"), ("bias", "offsets"), ("drift", "drifts")):
            values = getattr(entry, field)
            if count is not None and isinstance(values, tuple) and len(values) != count:
                what = f"{len(values)} {many} for {count} components"
                yield Problem(f"{key}.{field}", what, f"give one number, or {count}")
        counts.append(_given(config, estimate, name))
    if None not in counts and (channels := sum(filter(None, counts))) < len(estimate.inputs):
        what = f"{channels} channels for {len(estimate.inputs)} unknown loads"
        yield Problem("estimate.sensors", what, "give the filter more sensors, or make a load known")


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
        return len(units_of(sensor))
    gauges = sensor.gauges
    return sum(len(gauge.angles) if gauge.angles else 1 for gauge in gauges) if gauges else None


def _parameters(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    moduli = {name: m.value for body in config.flexible.values() for name, m in body.moduli.items()}
    taken: dict[tuple[str, str], str] = {}
    used = {force.bearing for force in config.forces.values() if force.type == "bearing"}
    for name, entry in estimate.parameters.items():
        key, bearing, part = f"estimate.parameters.{name}", entry.bearing, str(entry.property)
        if name in estimate.inputs:
            what = "a load of the estimate has the same name"
            yield Problem(key, what, "give the parameter another one", at_key=True)
        if entry.starts and estimate.truth.model == "walk":
            what = "a drawn truth starts where the filter's own belief puts it"
            yield Problem(f"{key}.starts", what, "leave starts out, or take another truth")
        if (bearing is None) != (entry.property is None):
            continue
        nominal = moduli.get(name)
        if bearing is None:
            yield from known(key, name, moduli, "modulus under bodies.*.moduli")
        else:
            if bearing in config.bearings and bearing not in used:
                yield Problem(f"{key}.bearing", f"no force is of '{bearing}'", "name a bearing of this bench's forces")
            if (other := taken.setdefault((bearing, part), name)) != name:
                yield Problem(key, f"'{other}' is the same property", "name it once", at_key=True)
            # a preload may be of any sign and size
            sized = bearing in config.bearings and part != "preload"
            nominal = float(getattr(config.bearings[bearing], part)) if sized else None
        unit = "Pa" if bearing is None else "m"
        for field, value in entry.guesses():
            if nominal and value > 0 and not 1 / FARTHEST <= value / nominal <= FARTHEST:
                what = f"{value:g} {unit} beside {nominal:g} {unit} in the bench"
                yield Problem(f"{key}.{field}", what, f"give it in {unit}, within a factor of {FARTHEST:g}")
    for bearing in config.bearings:
        yield from _grooves(config, bearing, estimate.parameters)
        for name, entry in estimate.parameters.items():
            for start in entry.starts if entry.bearing == bearing else ():
                moved = {**estimate.parameters, name: entry.model_copy(update={"guess": start})}
                for problem in _grooves(config, bearing, moved):
                    yield replace(problem, key=f"estimate.parameters.{name}.starts")


def _grooves(config: BenchConfig, bearing: str, parameters: Mapping[str, EstimatedParameter]) -> Iterator[Problem]:
    """A groove has to be wider than its ball at every guess."""
    names = {str(entry.property): name for name, entry in parameters.items() if entry.bearing == bearing}
    sizes = dict(config.bearings[bearing])
    sizes |= {part: guess for part, name in names.items() if (guess := parameters[name].guess) is not None}
    ball = sizes["ball_diameter"] / 2 + max(sizes["preload"], 0.0)
    narrow = [radius for radius in RADII if sizes[radius] <= ball]
    if narrow and names:
        blamed = names.get("ball_diameter") or names.get(narrow[0]) or next(iter(names.values()))
        yield Problem(
            f"estimate.parameters.{blamed}.guess",
            f"{narrow[0]} of {sizes[narrow[0]]:g} m would not pass a ball of {ball:g} m in radius",
            "a groove is wider than its ball: change the radii with it, or guess nearer",
        )


def _distinguishable(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    """Diameter and preload are one unknown where the groove centres stay: both only add to the interference."""
    for bearing, entry in config.bearings.items():
        free = {
            str(e.property): n for n, e in estimate.parameters.items() if e.bearing == bearing and e.std is not None
        }
        if entry.groove_centres == "fixed" and {"ball_diameter", "preload"} <= free.keys():
            what = "with groove_centres: fixed, ball diameter and preload are the same unknown"
            yield Problem(f"estimate.parameters.{free['preload']}", what, "estimate one of them", at_key=True)


def _check_grid_filter(estimate: BenchEstimateSection) -> Iterator[Problem]:
    """A grid filter is of few constants, and of iterated filters."""
    if estimate.method.parameters != "bank":
        return
    key, free = "estimate.method.parameters", [n for n, e in estimate.parameters.items() if e.std is not None]
    extended = "or set estimate.method.parameters: extended"
    if estimate.tolerances is not None:
        what = "a grid filter has no errors of gauges"
        yield Problem("estimate.tolerances", what, f"leave it out, {extended}", at_key=True)
    if estimate.hold_out is not None:
        what = "a grid filter says nothing of channels that are left out"
        yield Problem("estimate.hold_out", what, f"leave it out, {extended}")
    if not free:
        yield Problem(key, "no parameter is estimated", "give one of estimate.parameters a std, or leave it out")
    if len(free) > FEW:
        what = f"{len(free)} parameters, a grid filter is of {FEW} at most"
        yield Problem(key, what, f"leave out the std of {len(free) - FEW} of them, {extended}")
    if estimate.method.update != "iterated":
        what = f"'{estimate.method.update}' is a form of the extended filter"
        yield Problem("estimate.method.update", what, f"set iterated, {extended}")
    for name in free:
        if estimate.parameters[name].increment > 0:
            what = "in a grid filter parameters are constants"
            yield Problem(f"estimate.parameters.{name}.increment", what, f"leave increment out, {extended}")


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
            remedy = f"add {name}, or take it from estimate.sensors"
            yield Problem("estimate.measured.channels", f"the sensor '{name}' has none", remedy)
