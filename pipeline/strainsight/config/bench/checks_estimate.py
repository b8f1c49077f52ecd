"""Consistency checks of the estimate of a bench with other sections."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from strainsight.config.base import Problem, known, one_of, step_problems
from strainsight.config.bench.bench import AccelerationSensor, BenchConfig, ReactionSensor, Sensor, units_of
from strainsight.config.bench.bodies import RADII
from strainsight.config.bench.connections import Load
from strainsight.config.bench.estimate import BenchEstimateSection, EstimatedParameter, FromFile

"""Keys that apply to truth.model: independent only."""
CLOCK_SHARE = 1e-6
"""Relative tolerance for equal time steps."""


def truth_problems(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    """Check `estimate.truth` with the step of the filter and the joints."""
    truth, key = estimate.truth, "estimate.truth"
    if truth.model == "sampled" and estimate.tolerances is not None and estimate.measured is None:
        what = "simulated gauges have no installation errors with truth.model: sampled"
        remedy = "set estimate.truth.model: fine or independent, or remove estimate.tolerances"
        yield Problem("estimate.tolerances", what, remedy, at_key=True)
    if truth.model != "independent":
        for name in ("step", "duration", "histories", "within"):
            if name in truth.model_fields_set and getattr(truth, name) != type(truth).model_fields[name].default:
                what = f"has no effect with truth.model: {truth.model}"
                yield Problem(
                    f"{key}.{name}", what, "remove the key, or set estimate.truth.model: independent", at_key=True
                )
        return
    if config.driven:
        yield Problem(
            f"{key}.model", "model: independent does not support driven joints", "set estimate.truth.model: fine"
        )
    h, duration = config.filter_step, config.filter_duration
    every = round(h / truth.step)
    if every < 1 or abs(every * truth.step - h) > CLOCK_SHARE * truth.step:
        what = f"the filter step of {h:g} s is not a multiple of the simulation step of {truth.step:g} s"
        yield Problem(f"{key}.step", what, f"set {key}.step to {h:g} s divided by an integer", at_key=True)
    if truth.duration is not None and truth.duration < duration * (1 - CLOCK_SHARE):
        what = f"the simulation ends at {truth.duration:g} s, but the estimate ends at {duration:g} s"
        yield Problem(
            f"{key}.duration", what, f"set {key}.duration to at least {duration:g} s, or remove the key", at_key=True
        )
    if 1 < truth.histories < estimate.runs:
        what = f"{truth.histories} load histories are not enough for {estimate.runs} runs"
        yield Problem(
            f"{key}.histories",
            what,
            f"set {key}.histories to {estimate.runs}, or to 1 for the same history in all runs",
        )
    if truth.histories > 1 and truth.within == 0:
        yield Problem(
            f"{key}.histories",
            "all load histories are identical, since estimate.truth.within is 0",
            f"set {key}.within to a value above 0 s: each further history then starts at a random instant before this time",
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
        yield from one_of(
            f"estimate.inputs.{name}", name, loads, f"no force or moment under forces has the name '{name}'"
        )
    yield from _load_models(config, estimate)
    if estimate.method.step_error == "estimated" and config.driven:
        what = "the discretisation error of a step cannot be estimated with driven joints"
        remedy = "remove the key, and use a small estimate.time_step that resolves the loads and the drive"
        yield Problem("estimate.method.step_error", what, remedy)
    if estimate.method.step_error == "estimated" and estimate.method.noise == "as_printed":
        what = (
            "the discretisation error depends on the load change within a step, but with estimate.method.noise: as_printed, "
            "the loads change after the step"
        )
        remedy = "remove the key, or set estimate.method.noise: before_step"
        yield Problem("estimate.method.step_error", what, remedy)
    if not estimate.inputs and not any(entry.std for entry in estimate.parameters.values()):
        remedy = "add a load under estimate.inputs, or a parameter with std under estimate.parameters"
        yield Problem("estimate", "the section has no unknown load and no parameter with std", remedy, at_key=True)
    if estimate.accept_inconsistent and not isinstance(estimate.measured, FromFile):
        what = "has no effect without the measurements of a test"
        remedy = "remove the key or the option --accept, or set estimate.measured.file"
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
            what = f"has no effect with model: {entry.model}; only model: random_walk has an increment"
            yield Problem(
                f"{key}.increment", what, "remove the key; the keys amplitude and frequency define this model"
            )
        if not walks and config.place is not None:
            what = f"the stage 'place' supports model: random_walk only, not {entry.model}"
            remedy = "set model: random_walk, or place the gauges with another config and remove the section 'place'"
            yield Problem(f"{key}.model", what, remedy)
        if (walks and entry.increment is not None) or not isinstance(force, Load) or force.signal.type == "sine":
            continue
        need = "a random walk for which increment is not set" if walks else f"model: {entry.model}"
        for field in ("frequency", "amplitude"):
            if getattr(entry, field) is None:
                what = f"{need} needs the typical {field} of the load, because the signal of the load is not a sine"
                yield Problem(key, what, f"set {key}.{field}" + f", or {key}.increment" * walks, at_key=True)


def disturbed(
    estimate: BenchEstimateSection | None, sensor: Sensor | None, name: str, remedy: str
) -> Iterator[Problem]:
    """Yield a problem for an accelerometer together with a white acceleration."""
    if isinstance(sensor, AccelerationSensor) and estimate is not None and estimate.disturbance > 0:
        what = (
            f"cannot be combined with accelerometer '{name}': readings of the white-noise acceleration are not defined"
        )
        yield Problem("estimate.disturbance", what, remedy)


def _sensors(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    counts = []
    for name, entry in estimate.sensors.items():
        key, sensor = f"estimate.sensors.{name}", config.sensors.get(name)
        yield from known(key, name, config.sensors, "sensor")
        if sensor is None:
            return
        if isinstance(sensor, ReactionSensor):
            what = f"the filter does not support sensors of type {sensor.type}"
            yield Problem(key, what, "remove the sensor from estimate.sensors; the sensor is for the simulation only")
        yield from disturbed(
            estimate,
            sensor,
            name,
            f"set estimate.disturbance: 0, and increase {key}.noise to √(noise² + e²), where e [m/s²] is the "
            "standard deviation of the acceleration error of the bench model",
        )
        count = channels_of(config, name)
        for field in ("noise", "bias", "drift"):
            values = getattr(entry, field)
            if count is not None and isinstance(values, tuple) and len(values) != count:
                what = f"the list length is {len(values)}, but the number of sensor components is {count}"
                yield Problem(f"{key}.{field}", what, f"use one value for all components, or a list of {count}")
        counts.append(_used_components(config, estimate, name))
    if None not in counts and (channels := sum(filter(None, counts))) < len(estimate.inputs):
        what = f"the number of sensor components, {channels}, is smaller than the number of unknown loads, {len(estimate.inputs)}"
        yield Problem("estimate.sensors", what, "add sensors to estimate.sensors, or remove loads from estimate.inputs")


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
            what = "a load in estimate.inputs has the same name as the parameter"
            yield Problem(key, what, "rename the parameter; rename a modulus also in bodies.*.moduli", at_key=True)
        if entry.starts and estimate.truth.model == "sampled":
            what = "not supported with truth.model: sampled: the true value is sampled, with mean `guess`"
            yield Problem(f"{key}.starts", what, "remove the key, or set another estimate.truth.model")
        if (bearing is None) != (entry.property is None):
            continue
        nominal = moduli.get(name)
        if bearing is None:
            yield from one_of(key, name, moduli, f"no modulus under bodies.*.moduli has the name '{name}'")
        else:
            if bearing in config.bearings and bearing not in used:
                what = f"no force of the bench uses the bearing '{bearing}'"
                yield Problem(
                    f"{key}.bearing",
                    what,
                    f"add a force with type: bearing and bearing: {bearing}, or use another bearing",
                )
            if (other := names.setdefault((bearing, part), name)) != name:
                yield Problem(
                    key,
                    f"parameter '{other}' is already the {part} of bearing '{bearing}'",
                    "remove one of the two parameters",
                    at_key=True,
                )
            # a preload may be of any sign and size
            sized = bearing in config.bearings and part != "preload"
            nominal = float(getattr(config.bearings[bearing], part)) if sized else None
        unit = "Pa" if bearing is None else "m"
        for field, value in entry.guesses():
            if nominal and value > 0 and not 1 / FARTHEST <= value / nominal <= FARTHEST:
                what = f"{value:g} {unit} is far from the value in the bench, {nominal:g} {unit}"
                yield Problem(
                    f"{key}.{field}",
                    what,
                    f"set a value in {unit}, within a factor of {FARTHEST:g} of the value in the bench",
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
    radius = next((radius for radius in RADII if sizes[radius] <= ball), None)
    if radius and names:
        blamed = names.get("ball_diameter") or names.get(radius) or next(iter(names.values()))
        what = f"the groove radius {radius} is {sizes[radius]:g} m, not larger than the ball radius with preload, {ball:g} m"
        remedy = f"use a guess closer to the value in bearings.{bearing}, or increase the groove radius"
        yield Problem(f"estimate.parameters.{blamed}.guess", what, remedy)


def _distinguishable(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    """Check that diameter and preload are not both unknown with fixed groove centres, where both only change the interference."""
    for bearing, entry in config.bearings.items():
        free = {
            str(e.property): n for n, e in estimate.parameters.items() if e.bearing == bearing and e.std is not None
        }
        if entry.groove_centres == "fixed" and {"ball_diameter", "preload"} <= free.keys():
            what = "with groove_centres: fixed, ball diameter and preload have the same effect on the forces"
            yield Problem(
                f"estimate.parameters.{free['preload']}",
                what,
                "remove std of the ball diameter or of the preload",
                at_key=True,
            )


def _check_grid_filter(estimate: BenchEstimateSection) -> Iterator[Problem]:
    """Check the limits of the grid filter: few constant parameters, and iterated updates."""
    if estimate.method.parameters != "grid":
        return
    key, free = "estimate.method.parameters", [n for n, e in estimate.parameters.items() if e.std is not None]
    extended = "or set estimate.method.parameters: extended"
    if estimate.tolerances is not None:
        what = "the grid filter does not support tolerances"
        yield Problem("estimate.tolerances", what, f"remove the key, {extended}", at_key=True)
    if estimate.hold_out is not None:
        what = "the grid filter does not support hold_out"
        yield Problem("estimate.hold_out", what, f"remove the key, {extended}")
    if not free:
        what = "the grid filter needs an estimated parameter, but no parameter has a std"
        yield Problem(key, what, "set std of a parameter in estimate.parameters, or remove the key")
    if len(free) > FEW:
        what = f"the grid filter supports at most {FEW} estimated parameters, not {len(free)}"
        yield Problem(key, what, f"remove std of {(n := len(free) - FEW)} parameter{'s' * (n > 1)}, {extended}")
    if estimate.method.update != "iterated":
        what = f"the grid filter does not support '{estimate.method.update}'"
        yield Problem("estimate.method.update", what, f"set estimate.method.update: iterated, {extended}")
    for name in free:
        if estimate.parameters[name].increment > 0:
            what = "parameters are constant in the grid filter"
            yield Problem(f"estimate.parameters.{name}.increment", what, f"remove the key, {extended}")


def _elsewhere(config: BenchConfig, estimate: BenchEstimateSection) -> Iterator[Problem]:
    measured = estimate.measured
    if measured is None:
        return
    if estimate.truth.model != "fine":
        what = f"'{estimate.truth.model}' has no effect with imported measurements (estimate.measured)"
        yield Problem("estimate.truth.model", what, "remove estimate.truth.model, or estimate.measured")
    if isinstance(measured, FromFile):
        yield from _in_file(config, estimate, measured)
        return
    for name in estimate.sensors:
        sensor = config.sensors.get(name)
        if sensor is not None and sensor.type == "strain" and sensor.zeroed:
            what = "the gauges of the bench in estimate.measured.from were zeroed under unknown loads"
            yield Problem(
                f"sensors.{name}.zeroed",
                what,
                "set zeroed: false for the sensor in the configs of both benches, or remove the sensor from estimate.sensors",
            )
        if isinstance(sensor, AccelerationSensor) and sensor.gravity and measured.scale != 1:
            what = (
                f"the reading includes gravity, which does not scale with estimate.measured.scale ({measured.scale:g})"
            )
            yield Problem(
                f"sensors.{name}.gravity",
                what,
                "set gravity: false for the sensor in the configs of both benches, or set estimate.measured.scale: 1",
            )
    for kind, what in (("sensors", "sensor"), ("inputs", "load")):
        for name in getattr(measured, kind):
            text = f"no {what} in estimate.{kind} has the name '{name}'"
            yield from one_of(f"estimate.measured.{kind}.{name}", name, list(getattr(estimate, kind)), text)
    if measured.run == config.name:
        what = "the measurements cannot come from this run itself"
        yield Problem("estimate.measured.from", what, "set the name of the run that simulates the measurements")


def _in_file(config: BenchConfig, estimate: BenchEstimateSection, measured: FromFile) -> Iterator[Problem]:
    """Check the channels of a file against the sensors of the filter."""
    if estimate.runs != 1:
        yield Problem(
            "estimate.runs", "with the measurements of a test, only one run is possible", "set estimate.runs: 1"
        )
    for name, channels in measured.channels.items():
        key = f"estimate.measured.channels.{name}"
        yield from one_of(key, name, list(estimate.sensors), f"no sensor in estimate.sensors has the name '{name}'")
        count = channels_of(config, name) if name in config.sensors else None
        if count is not None and len(channels) != count:
            what = f"the list length is {len(channels)}, but the number of sensor components is {count}"
            yield Problem(
                key, what, "list one channel for each component, in order; write null for a component without a channel"
            )
        for i, entry in enumerate(channels):
            if entry is not None and entry.bridge is not None and entry.bridge.arrangement == "sum":
                what = "a bench does not support 'sum', a bridge with arms at different locations"
                yield Problem(
                    f"{key}.{i}.bridge.arrangement",
                    what,
                    "set an arrangement with all arms at one location, for example quarter",
                )
        if not any(channels):
            yield Problem(
                key,
                "no component of the sensor has a channel",
                "list at least one channel, or remove the sensor from estimate.measured.channels and estimate.sensors",
            )
    for name in estimate.sensors:
        if name not in measured.channels:
            remedy = f"add estimate.measured.channels.{name}, or remove '{name}' from estimate.sensors"
            yield Problem("estimate.measured.channels", f"no channels are listed for sensor '{name}'", remedy)
