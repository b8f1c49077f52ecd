"""Consistency checks of the estimate of a bench with other sections."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from strainsight.config.base import Problem, known, step_problems
from strainsight.config.bench.bench import AccelerationSensor, BenchConfig, ReactionSensor, Sensor, units_of
from strainsight.config.bench.bodies import RADII
from strainsight.config.bench.connections import Load
from strainsight.config.bench.estimate import BenchEstimateSection, EstimatedParameter, FromFile

KEYS_OF_OTHER = ("step", "duration", "histories", "within")
"""Keys that apply to truth.model: independent only."""
CLOCK_SHARE = 1e-6
"""Relative tolerance for equal time steps."""


def truth_problems(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    """Check `estimate.truth` with the step of the filter and the joints."""
    truth, key = estimate.truth, "estimate.truth"
    if truth.model == "sampled" and estimate.tolerances is not None and estimate.measured is None:
        what = "gauges are exact in measurements simulated with truth.model: sampled"
        remedy = "use truth.model: fine or independent, or remove tolerances"
        yield Problem("estimate.tolerances", what, remedy, at_key=True)
    if truth.model != "independent":
        for name in KEYS_OF_OTHER:
            if name in truth.model_fields_set and getattr(truth, name) != type(truth).model_fields[name].default:
                what = f"has no effect with truth.model: {truth.model}"
                yield Problem(f"{key}.{name}", what, "remove it, or set estimate.truth.model: independent", at_key=True)
        return
    if config.driven:
        yield Problem(f"{key}.model", "this simulation does not support driven joints", "set truth.model: fine")
    h, duration = config.filter_step, config.filter_duration
    every = round(h / truth.step)
    if every < 1 or abs(every * truth.step - h) > CLOCK_SHARE * truth.step:
        what = f"steps of {truth.step:g} s do not divide the step of the filter, {h:g} s"
        yield Problem(f"{key}.step", what, "use estimate.time_step divided by an integer", at_key=True)
    if truth.duration is not None and truth.duration < duration * (1 - CLOCK_SHARE):
        what = f"the simulation ends at {truth.duration:g} s, but the estimate ends at {duration:g} s"
        yield Problem(f"{key}.duration", what, f"use at least {duration:g} s, or remove the key", at_key=True)
    if 1 < truth.histories < estimate.runs:
        what = f"{truth.histories} load histories are not enough for {estimate.runs} runs"
        yield Problem(f"{key}.histories", what, f"use {estimate.runs} histories, or 1 for the same history in all runs")
    if truth.histories > 1 and truth.within == 0:
        yield Problem(
            f"{key}.histories", "all load histories are identical", "set within, the largest start of a history [s]"
        )


FEW = 3
"""Largest number of parameters of the grid filter."""
FEWEST_STEPS, MOST_STEPS = 2, 1_000_000
FARTHEST = 100.0
"""Ratio of a guess to the bench value above which another unit is assumed: GPa for Pa, mm for m."""


def estimate_problems(config: BenchConfig) -> Iterator[Problem]:
    """Yield every inconsistency between `estimate` and the bench."""
    estimate = config.estimate
    if estimate is None:
        return
    loads = [name for name, force in config.forces.items() if isinstance(force, Load)]
    for name in estimate.inputs:
        yield from known(f"estimate.inputs.{name}", name, loads, "force or moment")
    yield from _load_models(config, estimate)
    if estimate.method.step_error == "estimated" and config.driven:
        what = "the step error cannot be estimated with driven joints"
        remedy = "remove the key, and use a time step that resolves the loads and the drive"
        yield Problem("estimate.method.step_error", what, remedy)
    if estimate.method.step_error == "estimated" and estimate.method.noise == "as_printed":
        what = "the step error depends on the load change within the step, but with noise: as_printed the loads change after it"
        remedy = "remove the key, or set estimate.method.noise: before_step"
        yield Problem("estimate.method.step_error", what, remedy)
    if not estimate.inputs and not any(entry.std for entry in estimate.parameters.values()):
        yield Problem("estimate", "the config has no unknowns", "add inputs, or parameters with std", at_key=True)
    if estimate.accept_inconsistent and not isinstance(estimate.measured, FromFile):
        what = "has no effect without the measurements of a test"
        remedy = "remove the key or --accept, or set the measurement file under estimate.measured"
        yield Problem("estimate.accept_inconsistent", what, remedy)
    yield from _sensors(config, estimate)
    yield from _parameters(config, estimate)
    yield from _distinguishable(config, estimate)
    yield from _check_grid_filter(estimate)
    times = config.filter_duration, config.filter_step
    yield from step_problems("estimate.time_step", *times, FEWEST_STEPS, MOST_STEPS, "estimate.duration")
    yield from truth_problems(config, estimate)
    yield from _elsewhere(config, estimate)


def _load_models(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    """Check the keys that the model of an unknown load needs."""
    for name, entry in estimate.inputs.items():
        key, force, walks = f"estimate.inputs.{name}", config.forces.get(name), entry.model == "random_walk"
        if not walks and entry.increment is not None:
            what = f"has no effect with the model {entry.model}: increment belongs to a random walk"
            yield Problem(f"{key}.increment", what, "remove the key; amplitude and frequency define the model")
        if not walks and config.place is not None:
            what = f"place supports random walks only, not {entry.model}"
            remedy = "use random_walk for placement, and this model in a separate run"
            yield Problem(f"{key}.model", what, remedy)
        if (walks and entry.increment is not None) or not isinstance(force, Load) or force.signal.type == "sine":
            continue
        need = "a random walk without increment" if walks else entry.model
        for field in ("frequency", "amplitude"):
            if getattr(entry, field) is None:
                what = f"{need} needs the typical {field} of the load, which only a sine history defines"
                yield Problem(key, what, f"set {field}" + ", or increment" * walks, at_key=True)


def disturbed(
    estimate: BenchEstimateSection | None, sensor: Sensor | None, name: str, remedy: str
) -> Iterator[Problem]:
    """Yield a problem for an accelerometer together with a white acceleration."""
    if isinstance(sensor, AccelerationSensor) and estimate is not None and estimate.disturbance > 0:
        what = f"accelerometer {name} would measure this white acceleration, which is undefined between samples"
        yield Problem("estimate.disturbance", what, f"set the disturbance to 0, {remedy}")


def _sensors(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    counts = []
    for name, entry in estimate.sensors.items():
        key, sensor = f"estimate.sensors.{name}", config.sensors.get(name)
        yield from known(key, name, config.sensors, "sensor")
        if sensor is None:
            return
        if isinstance(sensor, ReactionSensor):
            what = f"the filter does not support sensors of type {sensor.type}"
            yield Problem(key, what, "remove the sensor; it can be simulated only")
        yield from disturbed(estimate, sensor, name, f"and include the model error in the noise of {name}")
        count = channels_of(config, name)
        for field, many in (("noise", "noise values"), ("bias", "offsets"), ("drift", "drifts")):
            values = getattr(entry, field)
            if count is not None and isinstance(values, tuple) and len(values) != count:
                what = f"{len(values)} {many} are set for {count} components"
                yield Problem(f"{key}.{field}", what, f"use one value, or {count} values")
        counts.append(_used_components(config, estimate, name))
    if None not in counts and (channels := sum(filter(None, counts))) < len(estimate.inputs):
        what = f"{channels} channel{'s are' if channels != 1 else ' is'} not enough for {len(estimate.inputs)} unknown loads"
        yield Problem("estimate.sensors", what, "add sensors, or remove loads from estimate.inputs")


def _used_components(config: BenchConfig, estimate: BenchEstimateSection, name: str) -> int | None:
    """Number of components of a sensor that the filter uses; None if it depends on the layout."""
    if estimate.sensors[name].layout is not None:
        return None
    if isinstance(estimate.measured, FromFile) and name in estimate.measured.channels:
        return sum(channel is not None for channel in estimate.measured.channels[name])
    return channels_of(config, name)


def channels_of(config: BenchConfig, name: str) -> int | None:
    """Number of components of a sensor; None if it depends on the layout."""
    sensor = config.sensors[name]
    if sensor.type != "strain":
        return len(units_of(sensor))
    gauges = sensor.gauges
    return sum(len(gauge.angles) if gauge.angles else 1 for gauge in gauges) if gauges else None


def _parameters(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    moduli = {name: m.value for body in config.flexible.values() for name, m in body.moduli.items()}
    names: dict[tuple[str, str], str] = {}
    used = {force.bearing for force in config.forces.values() if force.type == "bearing"}
    for name, entry in estimate.parameters.items():
        key, bearing, part = f"estimate.parameters.{name}", entry.bearing, str(entry.property)
        if name in estimate.inputs:
            what = "a load of the estimate has the same name"
            yield Problem(key, what, "use another name for the parameter", at_key=True)
        if entry.starts and estimate.truth.model == "sampled":
            what = "with truth.model: sampled, the initial value is sampled from its distribution in the filter"
            yield Problem(f"{key}.starts", what, "remove starts, or use another truth.model")
        if (bearing is None) != (entry.property is None):
            continue
        nominal = moduli.get(name)
        if bearing is None:
            yield from known(key, name, moduli, "modulus under bodies.*.moduli")
        else:
            if bearing in config.bearings and bearing not in used:
                what = f"no force uses the bearing '{bearing}'"
                yield Problem(f"{key}.bearing", what, "use a bearing with a force of type bearing in this bench")
            if (other := names.setdefault((bearing, part), name)) != name:
                yield Problem(key, f"'{other}' has the same property", "remove one of the two parameters", at_key=True)
            # a preload may be of any sign and size
            sized = bearing in config.bearings and part != "preload"
            nominal = float(getattr(config.bearings[bearing], part)) if sized else None
        unit = "Pa" if bearing is None else "m"
        for field, value in entry.guesses():
            if nominal and value > 0 and not 1 / FARTHEST <= value / nominal <= FARTHEST:
                what = f"{value:g} {unit} is far from the bench value of {nominal:g} {unit}"
                yield Problem(
                    f"{key}.{field}", what, f"use the unit {unit}, and a value within a factor of {FARTHEST:g}"
                )
    for bearing in config.bearings:
        yield from _grooves(config, bearing, estimate.parameters)
        for name, entry in estimate.parameters.items():
            for start in entry.starts if entry.bearing == bearing else ():
                moved = {**estimate.parameters, name: entry.model_copy(update={"guess": start})}
                for problem in _grooves(config, bearing, moved):
                    yield replace(problem, key=f"estimate.parameters.{name}.starts")


def _grooves(config: BenchConfig, bearing: str, parameters: Mapping[str, EstimatedParameter]) -> Iterator[Problem]:
    """Check that every groove radius exceeds the ball radius at every guess."""
    names = {str(entry.property): name for name, entry in parameters.items() if entry.bearing == bearing}
    sizes = dict(config.bearings[bearing])
    sizes |= {part: guess for part, name in names.items() if (guess := parameters[name].guess) is not None}
    ball = sizes["ball_diameter"] / 2 + max(sizes["preload"], 0.0)
    narrow = [radius for radius in RADII if sizes[radius] <= ball]
    if narrow and names:
        blamed = names.get("ball_diameter") or names.get(narrow[0]) or next(iter(names.values()))
        what = f"{narrow[0]} of {sizes[narrow[0]]:g} m is not larger than the ball radius of {ball:g} m"
        remedy = "change the groove radii as well, or use a guess closer to the bench value"
        yield Problem(f"estimate.parameters.{blamed}.guess", what, remedy)


def _distinguishable(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    """Check that diameter and preload are not both unknown with fixed groove centres, where both only change the interference."""
    for bearing, entry in config.bearings.items():
        free = {
            str(e.property): n for n, e in estimate.parameters.items() if e.bearing == bearing and e.std is not None
        }
        if entry.groove_centres == "fixed" and {"ball_diameter", "preload"} <= free.keys():
            what = "with groove_centres: fixed, ball diameter and preload have the same effect"
            yield Problem(f"estimate.parameters.{free['preload']}", what, "estimate only one of them", at_key=True)


def _check_grid_filter(estimate: BenchEstimateSection) -> Iterator[Problem]:
    """Check the limits of the grid filter: few constant parameters, and iterated updates."""
    if estimate.method.parameters != "grid":
        return
    key, free = "estimate.method.parameters", [n for n, e in estimate.parameters.items() if e.std is not None]
    extended = "or set estimate.method.parameters: extended"
    if estimate.tolerances is not None:
        what = "the grid filter (method.parameters: grid) does not support tolerances"
        yield Problem("estimate.tolerances", what, f"remove the key, {extended}", at_key=True)
    if estimate.hold_out is not None:
        what = "the grid filter (method.parameters: grid) does not support hold_out"
        yield Problem("estimate.hold_out", what, f"remove the key, {extended}")
    if not free:
        yield Problem(
            key, "the config has no estimated parameter", "set std for one of estimate.parameters, or remove the key"
        )
    if len(free) > FEW:
        what = f"the grid filter supports at most {FEW} parameters, not {len(free)}"
        yield Problem(key, what, f"remove std of {len(free) - FEW} of them, {extended}")
    if estimate.method.update != "iterated":
        what = f"'{estimate.method.update}' is available for the extended filter only"
        yield Problem("estimate.method.update", what, f"use iterated, {extended}")
    for name in free:
        if estimate.parameters[name].increment > 0:
            what = "parameters are constant in the grid filter (method.parameters: grid)"
            yield Problem(f"estimate.parameters.{name}.increment", what, f"remove increment, {extended}")


def _elsewhere(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    measured = estimate.measured
    if measured is None:
        return
    if estimate.truth.model != "fine":
        what = f"truth.model: {estimate.truth.model} has no effect with measurements"
        yield Problem("estimate.truth.model", what, "remove truth.model, or measured")
    if isinstance(measured, FromFile):
        yield from _in_file(config, estimate, measured)
        return
    for name in estimate.sensors:
        sensor = config.sensors.get(name)
        if sensor is not None and sensor.type == "strain" and sensor.zeroed:
            what = "the sensor was zeroed on the other bench under loads that are not known here"
            yield Problem(f"sensors.{name}.zeroed", what, "set zeroed: false, or remove the sensor from the estimate")
        if isinstance(sensor, AccelerationSensor) and sensor.gravity and measured.scale != 1:
            what = "gravity does not scale with the lengths of the other bench"
            yield Problem(f"sensors.{name}.gravity", what, "set gravity: false on both, or scale: 1")
    for name in measured.sensors:
        yield from known(f"estimate.measured.sensors.{name}", name, list(estimate.sensors), "sensor of the filter")
    for name in measured.inputs:
        yield from known(f"estimate.measured.inputs.{name}", name, list(estimate.inputs), "unknown input")
    if measured.run == config.name:
        yield Problem(
            "estimate.measured.from", "is the name of this run", "use another run, whose sensors are the measurements"
        )


def _in_file(config: BenchConfig, estimate: BenchEstimateSection, measured: FromFile) -> Iterator[Problem]:
    """Check the channels of a file against the sensors of the filter."""
    if estimate.runs != 1:
        yield Problem("estimate.runs", "measurements of a test support one run only", "set runs: 1")
    for name, channels in measured.channels.items():
        key = f"estimate.measured.channels.{name}"
        yield from known(key, name, list(estimate.sensors), "sensor of the filter")
        count = channels_of(config, name) if name in config.sensors else None
        if count is not None and len(channels) != count:
            what = f"{len(channels)} channel{'s' * (len(channels) != 1)} listed for {count} components"
            yield Problem(
                key, what, "list one channel for each component in order, or null for a component that is not measured"
            )
        for i, entry in enumerate(channels):
            if entry is not None and entry.bridge is not None and entry.bridge.arrangement == "sum":
                what = "a bench does not support bridges with arms at different locations"
                yield Problem(f"{key}.{i}.bridge.arrangement", what, "use quarter, or the arrangement of the bridge")
        if not any(channels):
            yield Problem(key, "no component is measured", "remove the sensor from estimate.sensors")
    for name in estimate.sensors:
        if name not in measured.channels:
            remedy = f"add channels for {name}, or remove it from estimate.sensors"
            yield Problem("estimate.measured.channels", f"sensor '{name}' has no channels", remedy)
