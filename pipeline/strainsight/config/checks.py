"""What one field of a config demands of another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from strainsight.config.base import Problem, known, named_twice, section_problems, step_problems
from strainsight.config.checks_model import gauge_problems, model_problems
from strainsight.config.estimate import Estimate, GaugeChannel
from strainsight.config.layout import layout_problems
from strainsight.config.loads import (
    CaseLoad,
    LoadSignal,
    MultiSineSection,
    Settle,
    SineSection,
    SweepSection,
    load_case_problems,
)
from strainsight.config.placement import PlacementConfig
from strainsight.errors import at_most

FEWEST_STEPS = 10
MOST_STEPS = 10_000_000  # a time step in the wrong unit, rather than a run that anyone waits for
FEWEST_STEPS_A_PERIOD = 8
LARGEST_START = 10.0
"""σ of a parameter at the start, in its logarithm: a factor of exp(10) either way."""
ONE = "or estimate one record with estimate.file"


def problems(config: PlacementConfig) -> Iterator[Problem]:
    """Every contradiction between the fields of a config."""
    yield from section_problems(config)
    yield from model_problems(config)
    yield from gauge_problems(config)
    stated = {name: load.signal for name, load in config.loads.items()}
    yield from _time("train", config.train.duration, config.train.time_step, stated)
    yield from _time("validate", config.validation.duration, config.validation.time_step, stated)
    yield from _settle("train", config.train.settle, min(config.train.time_step, config.validation.time_step))
    yield from _load_cases(config)
    yield from _estimate(config)
    yield from _optimum(config)
    yield from _input_models(config)
    yield from _fast(config)
    yield from _filter(config)
    yield from _drifting(config)
    yield from _validation(config)
    yield from _measurements(config)


def _time(section: str, duration: float, step: float, signals: Mapping[str, LoadSignal]) -> Iterator[Problem]:
    key = f"{section}.time_step"
    yield from step_problems(key, duration, step, FEWEST_STEPS, MOST_STEPS)
    for name, signal in signals.items():
        highest = _highest(signal)
        if highest is not None and step * highest * FEWEST_STEPS_A_PERIOD > 1:
            yield Problem(
                key,
                f"{step:g} s gives {1 / (step * highest):.3g} steps a period of load '{name}' ({highest:g} Hz)",
                f"take at most {1 / (FEWEST_STEPS_A_PERIOD * highest):.3g} s",
            )


def _settle(section: str, settle: Settle, step: float) -> Iterator[Problem]:
    if isinstance(settle, float) and settle / step > MOST_STEPS:
        yield Problem(
            f"{section}.settle",
            f"{settle:g} s are {settle / step:.3g} steps of {step:g} s",
            f"take at most {at_most(MOST_STEPS * step)} s, or auto",
        )


def _load_cases(config: PlacementConfig) -> Iterator[Problem]:
    cases, train = config.place.load_cases, config.train
    if cases is None:
        return
    over = config.place.metric_over or config.place.estimate
    yield from load_case_problems(cases, config.loads, config.place.estimate, over)
    for name, case in cases.items():
        key, step = f"place.load_cases.{name}", case.time_step or train.time_step
        signals = {load_name: load.signal for load_name, load in config.loads.items() if load_name not in case.loads}
        signals |= {load_name: entry.signal for load_name, entry in case.loads.items() if isinstance(entry, CaseLoad)}
        yield from _time(key, case.duration or train.duration, step, signals)
        yield from _settle(key, train.settle if case.settle is None else case.settle, step)
        asked = {}
        for load_name, load in config.loads.items():
            entry, noise = case.loads.get(load_name), load.process_noise.frequency
            if isinstance(entry, CaseLoad) and entry.frequency is not None:
                asked[f"{key}.loads.{load_name}.frequency"] = entry.frequency
            elif not load.known and noise is not None:
                asked[f"loads.{load_name}.process_noise.frequency"] = noise
            elif not load.known and entry == "none" and (highest := _highest(load.signal)) is not None:
                asked[f"{key}.loads.{load_name}"] = highest  # silent, it has the process noise that it has as stated
        yield from _resolved(asked, step, "the time step of this case")


def _highest(signal: LoadSignal) -> float | None:
    match signal:
        case SineSection():
            return signal.frequency
        case SweepSection():
            return max(signal.start_frequency, signal.end_frequency)
        case MultiSineSection():
            return signal.highest
    return None


def _estimate(config: PlacementConfig) -> Iterator[Problem]:
    yield from named_twice("place.estimate", config.place.estimate)
    for i, name in enumerate(config.place.estimate):
        key = f"place.estimate.{i}"
        yield from known(key, name, [*config.parameters, *config.loads], "parameter or load")
        if name in config.loads and config.loads[name].known:
            yield Problem(key, f"load '{name}' is known", f"set loads.{name}.known: false, or do not estimate it")
    for name, load in config.loads.items():
        if not load.known and name not in config.place.estimate:
            yield Problem(
                "place.estimate",
                f"the unknown load '{name}' is not estimated",
                f"add {name}, or set loads.{name}.known: true",
            )


def _optimum(config: PlacementConfig) -> Iterator[Problem]:
    bonded = len(config.gauges.fixed)
    yield from layout_problems(config.place, config.place.estimate, "place.estimate", bonded, "gauges.fixed")
    if config.place.symmetry is not None and config.place.optimise != "metric":
        yield Problem(
            "place.symmetry", "of a mirrored pair one gauge would fail, not both", "remove one of the two keys"
        )


def _input_models(config: PlacementConfig) -> Iterator[Problem]:
    if config.process_noise.rule == "continuous":
        return
    for name, load in config.loads.items():
        if not load.known and load.process_noise.model != "random_walk":
            yield Problem(
                "process_noise.rule",
                f"'{config.process_noise.rule}' is a rule for random walks, and load '{name}' is a "
                f"{load.process_noise.model}",
                "choose continuous, or the model random_walk",
            )


def _fast(config: PlacementConfig) -> Iterator[Problem]:
    """Frequencies beside those of the signals that the training step has to resolve."""
    step = config.train.time_step
    asked = {f"observe.frequencies.{i}": f for i, f in enumerate(config.observe.frequencies)}
    asked |= {
        f"loads.{name}.process_noise.frequency": load.process_noise.frequency
        for name, load in config.loads.items()
        if not load.known and load.process_noise.frequency is not None
    }
    yield from _resolved(asked, step, "train.time_step")


def _resolved(asked: Mapping[str, float], step: float, of: str) -> Iterator[Problem]:
    """Frequencies [Hz] by key that a step [s] is too long for; of: what the step is called."""
    for key, frequency in asked.items():
        if step * frequency * FEWEST_STEPS_A_PERIOD > 1 + 1e-9:
            yield Problem(
                key,
                f"{frequency:g} Hz, of which {of} takes {1 / (step * frequency):.3g} steps a period",
                f"take at most {1 / (FEWEST_STEPS_A_PERIOD * step):.4g} Hz, or a shorter step",
            )


def _filter(config: PlacementConfig) -> Iterator[Problem]:
    if config.filter.method == "bank" and config.filter.drift:
        yield Problem(
            "filter.drift",
            "parameters are constants in a grid filter",
            "leave it out, or take method extended or sigma-point",
        )


def _drifting(config: PlacementConfig) -> Iterator[Problem]:
    """Parameters that the filter would let drift, in their logarithm, by more than 1 in a step."""
    step, h = max(config.train.time_step, config.validation.time_step), config.train.time_step
    # √(q h) of δ = 1, with the q of `augmentation.noise.process_intensity`
    drift = (step * {"continuous": 1.0, "thesis": h, "as_printed": h * h}[config.process_noise.rule]) ** 0.5
    for name, parameter in config.parameters.items():
        if parameter.process_noise_scale * drift > 1:
            yield Problem(
                f"parameters.{name}.process_noise_scale",
                f"{parameter.process_noise_scale:g} lets it drift by {100 * parameter.process_noise_scale * drift:.3g} % "
                f"in a step of {step:g} s",
                f"take at most {at_most(1 / drift)}, a hundredth of it where nothing is known",
            )


def _validation(config: PlacementConfig) -> Iterator[Problem]:
    parameters, unknowns = config.parameters, [*config.parameters, *config.loads]
    for name, value in config.validation.truth.parameters.items():
        yield from known(f"validate.truth.parameters.{name}", name, parameters, "parameter", at_key=True)
        low, high = parameters[name].range if name in parameters else (value, value)
        if low <= high and not low <= value <= high:
            yield Problem(
                f"validate.truth.parameters.{name}",
                f"{value:g} lies outside parameters.{name}.range, {low:g} to {high:g}: no reduced model is made for it",
                "correct the value, or widen the range",
            )
    for name, std in config.validation.initial_std.items():
        if name in parameters and std > LARGEST_START:
            yield Problem(
                f"validate.initial_std.{name}",
                f"{std:g} times the guess, which the parameter's range is far within",
                f"take at most {LARGEST_START:g}; 0.1 is ten per cent",
            )
        yield from known(f"validate.initial_std.{name}", name, unknowns, "parameter or load", at_key=True)
    for name in config.place.estimate:
        if name in unknowns and name not in config.validation.initial_std:
            yield Problem(
                "validate.initial_std",
                f"no initial standard deviation for '{name}'",
                f"add {name}: 0.1 (relative)",
                at_key=True,
            )


def _measurements(config: PlacementConfig) -> Iterator[Problem]:
    """Names of `estimate` that nothing would read."""
    if config.estimate is None:
        return
    for name in config.estimate.initial_std:
        yield from known(f"estimate.initial_std.{name}", name, config.place.estimate, "unknown")
    yield from record_problems(config, config.estimate)
    stated = {f"estimate.inputs.{name}": name for name in config.estimate.inputs}
    for i, record in enumerate(config.estimate.records):
        stated |= {f"estimate.records.{i}.inputs.{name}": name for name in record.inputs or ()}
    for key, name in stated.items():
        yield from known(key, name, config.loads, "load")
        if name in config.loads and not config.loads[name].known:
            yield Problem(
                key,
                f"load '{name}' is unknown: its channel would not be read",
                f"leave it out, or set loads.{name}.known: true and take it out of place.estimate",
            )


def record_problems(config: PlacementConfig, settings: Estimate) -> Iterator[Problem]:
    """Every contradiction of `estimate.records`."""
    records = settings.records
    if not records:
        return
    if settings.file is not None:
        yield Problem(
            "estimate.records",
            f"'file' ({settings.file}) and 'records' are both given",
            "give one file, or a list of records",
            at_key=True,
        )
    names, files = [record.name.lower() for record in records], [record.file for record in records]
    for i, record in enumerate(records):
        key = f"estimate.records.{i}"
        if record.name.lower() in names[:i]:
            yield Problem(f"{key}.name", f"'{record.name}' is named twice", "give every record a name of its own")
        if record.file in files[:i]:
            yield Problem(f"{key}.file", f"{record.file} is named twice: it would count twice", "leave one of them out")
        if record.channels is not None:
            yield from _other_channels(f"{key}.channels", settings.channels, record.channels)
    if len(records) > 1:
        yield from _not_of_several(config, settings)


def _other_channels(
    key: str, shared: tuple[GaugeChannel, ...], channels: tuple[GaugeChannel, ...]
) -> Iterator[Problem]:
    remedy = "name the same gauges and grids in the same order, with the same bias"
    if len(channels) != len(shared):
        yield Problem(key, f"{len(channels)} channels, estimate.channels has {len(shared)}", remedy)
        return
    for i, (one, other) in enumerate(zip(channels, shared, strict=True)):
        for field in ("gauge", "grid", "bias"):
            stated, expected = getattr(one, field), getattr(other, field)
            if stated != expected:
                yield Problem(f"{key}.{i}", f"{field} {stated}, estimate.channels.{i} has {expected}", remedy)


def _not_of_several(config: PlacementConfig, settings: Estimate) -> Iterator[Problem]:
    """What holds for one record alone."""
    method = config.filter.method
    if method != "bank":
        yield Problem(
            "estimate.records",
            f"filter.method: {method} knows no constants that several records share",
            f"set filter.method: bank, {ONE}",
            at_key=True,
        )
    if config.filter.compare:
        yield Problem(
            "filter.compare", "the other filters take one record", f"leave it out with estimate.records, {ONE}"
        )
    if settings.tune.parts:
        yield Problem(
            "estimate.tune.parts",
            "noises are tuned on one record",
            f"tune on one with estimate.file and state what comes out, {ONE}",
        )
    if settings.field is not None:
        yield Problem("estimate.field", "the surface in time is of one record", f"leave it out, {ONE}")
