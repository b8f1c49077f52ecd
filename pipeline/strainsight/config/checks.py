"""Consistency checks between fields of a config."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

from strainsight.config.base import Problem, duplicate_name_problems, known, one_of, section_problems, step_problems
from strainsight.config.checks_model import (
    damping_problems,
    gauge_problems,
    model_problems,
    result_problems,
    static_problems,
)
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
from strainsight.config.placement import NEEDED_BY, PlacementConfig, later_sections, sections_from_stage
from strainsight.errors import at_most

FEWEST_STEPS = 10
MOST_STEPS = 10_000_000  # a time step in the wrong unit, rather than a run that anyone waits for
FEWEST_STEPS_A_PERIOD = 8
LARGEST_START = 10.0
"""Largest initial σ of the logarithm of a parameter: a factor of exp(10)."""


def problems(config: PlacementConfig) -> Iterator[Problem]:
    """Yield every inconsistency between the sections that a config has."""
    yield from section_problems(config)
    fields = type(config).model_fields
    present = {fields[name].alias or name for name in config.model_fields_set}
    for check, sections in CHECKS.items():
        if {*sections.split()} <= present:
            yield from check(config)


def absent_problems(data: Mapping[str, Any], stage: str | None) -> Iterator[Problem]:
    """Yield a problem for every absent section that a stage or one before it needs; None: the whole pipeline."""
    later = later_sections(stage)
    for section, (first, example) in sections_from_stage().items():
        if section not in data and section not in later and stage in NEEDED_BY.get(section, (stage,)):
            what = f"the section is missing; the stage `{first}` needs it"
            yield Problem(section, what, f"add it, for example {section}: {example}", at_key=True)


def _training_time(config: PlacementConfig) -> Iterator[Problem]:
    yield from _time("train", config.train.duration, config.train.time_step, _signals(config))


def _validation_time(config: PlacementConfig) -> Iterator[Problem]:
    yield from _time("validate", config.validation.duration, config.validation.time_step, _signals(config))
    yield from _settle("train", config.train.settle, min(config.train.time_step, config.validation.time_step))


def _signals(config: PlacementConfig) -> dict[str, LoadSignal]:
    return {name: load.signal for name, load in config.loads.items()}


def _time(section: str, duration: float, step: float, signals: Mapping[str, LoadSignal]) -> Iterator[Problem]:
    key = f"{section}.time_step"
    yield from step_problems(key, duration, step, FEWEST_STEPS, MOST_STEPS)
    for name, signal in signals.items():
        highest = _highest(signal)
        if highest is not None and step * highest * FEWEST_STEPS_A_PERIOD > 1:
            yield Problem(
                key,
                f"the shortest period of load '{name}' ({highest:g} Hz) is {1 / (step * highest):.3g} times the time step of "
                f"{step:g} s; the minimum is {FEWEST_STEPS_A_PERIOD}",
                f"use a time step of at most {1 / (FEWEST_STEPS_A_PERIOD * highest):.3g} s",
            )


def _settle(section: str, settle: Settle, step: float) -> Iterator[Problem]:
    if isinstance(settle, float) and settle / step > MOST_STEPS:
        what = (
            f"the settling time of {settle:g} s is {settle / step:.3g} times the time step of {step:g} s; the maximum is "
            f"{MOST_STEPS:.0e}"
        )
        yield Problem(f"{section}.settle", what, f"use at most {at_most(MOST_STEPS * step)} s, or set settle: auto")


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
        frequencies = {}
        for load_name, load in config.loads.items():
            entry, noise = case.loads.get(load_name), load.process_noise.frequency
            if isinstance(entry, CaseLoad) and entry.frequency is not None:
                frequencies[f"{key}.loads.{load_name}.frequency"] = entry.frequency
            elif not load.known and noise is not None:
                frequencies[f"loads.{load_name}.process_noise.frequency"] = noise
            elif not load.known and entry == "none" and (highest := _highest(load.signal)) is not None:
                frequencies[f"{key}.loads.{load_name}"] = (
                    highest  # silent, it has the process noise that it has as stated
                )
        yield from _resolved(frequencies, step, "train.time_step" if case.time_step is None else f"{key}.time_step")


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
    yield from duplicate_name_problems("place.estimate", config.place.estimate)
    for i, name in enumerate(config.place.estimate):
        key = f"place.estimate.{i}"
        yield from one_of(key, name, [*config.parameters, *config.loads], f"no parameter or load has the name '{name}'")
        if name in config.loads and config.loads[name].known:
            what = f"load '{name}' is known, but place.estimate is a list of unknowns"
            yield Problem(key, what, f"set loads.{name}.known: false, or remove {name} from place.estimate")
    for name, load in config.loads.items():
        if not load.known and name not in config.place.estimate:
            what = f"the unknown load '{name}' is not in the list"
            yield Problem("place.estimate", what, f"add {name} to place.estimate, or set loads.{name}.known: true")


def _optimum(config: PlacementConfig) -> Iterator[Problem]:
    bonded = len(config.gauges.fixed)
    yield from layout_problems(config.place, config.place.estimate, "place.estimate", bonded, "gauges.fixed")
    if config.place.symmetry is not None and config.place.optimise != "metric":
        what = "place.optimise: worst_failure removes single gauges, but place.symmetry places gauges in pairs"
        yield Problem("place.symmetry", what, "remove place.symmetry, or set place.optimise: metric")


def _input_models(config: PlacementConfig) -> Iterator[Problem]:
    if config.process_noise.rule == "continuous":
        return
    for name, load in config.loads.items():
        if not load.known and load.process_noise.model != "random_walk":
            yield Problem(
                "process_noise.rule",
                f"the rule '{config.process_noise.rule}' applies to the load model random_walk only, but "
                f"loads.{name}.process_noise.model is {load.process_noise.model}",
                f"set process_noise.rule: continuous, or loads.{name}.process_noise.model: random_walk",
            )


def _fast(config: PlacementConfig) -> Iterator[Problem]:
    """Check that the training step resolves the frequencies that are not those of signals."""
    step = config.train.time_step
    frequencies = {f"observe.frequencies.{i}": f for i, f in enumerate(config.observe.frequencies)}
    frequencies |= {
        f"loads.{name}.process_noise.frequency": load.process_noise.frequency
        for name, load in config.loads.items()
        if not load.known and load.process_noise.frequency is not None
    }
    yield from _resolved(frequencies, step, "train.time_step")


def _resolved(frequencies: Mapping[str, float], step: float, step_key: str) -> Iterator[Problem]:
    """Yield a problem for each frequency [Hz] that a step [s] does not resolve; step_key: key of the step."""
    for key, frequency in frequencies.items():
        if step * frequency * FEWEST_STEPS_A_PERIOD > 1 + 1e-9:
            ratio = (
                f"{1 / (step * frequency):.3g} times the time step {step_key}; the minimum is {FEWEST_STEPS_A_PERIOD}"
            )
            remedy = f"use at most {1 / (FEWEST_STEPS_A_PERIOD * step):.4g} Hz, or reduce {step_key}"
            yield Problem(key, f"the period at {frequency:g} Hz is {ratio}", remedy)


def _filter(config: PlacementConfig) -> Iterator[Problem]:
    if config.filter.method == "grid" and config.filter.drift:
        what = "parameters are constant in the grid filter"
        yield Problem("filter.drift", what, "remove filter.drift, or set filter.method to extended or sigma-point")


def _drifting(config: PlacementConfig) -> Iterator[Problem]:
    """Check that no parameter can drift by more than a factor of e in one step."""
    h = config.train.time_step
    step = h if config.validation is None else max(h, config.validation.time_step)
    # √(q h) of δ = 1, with the q of `augmentation.noise.process_intensity`
    drift = (step * {"continuous": 1.0, "thesis": h, "as_printed": h * h}[config.process_noise.rule]) ** 0.5
    for name, parameter in config.parameters.items():
        if parameter.process_noise_scale * drift > 1:
            yield Problem(
                f"parameters.{name}.process_noise_scale",
                f"a drift rate of {parameter.process_noise_scale:g} changes the parameter by "
                f"{100 * parameter.process_noise_scale * drift:.3g} % in one step of {step:g} s, more than 100 %",
                f"use at most {at_most(1 / drift)}; if the drift rate is not known, use {at_most(0.01 / drift)}",
            )


def _validation(config: PlacementConfig) -> Iterator[Problem]:
    parameters, unknowns = config.parameters, [*config.parameters, *config.loads]
    for name, value in config.validation.truth.parameters.items():
        yield from known(f"validate.truth.parameters.{name}", name, parameters, "parameter", at_key=True)
        low, high = parameters[name].range if name in parameters else (value, value)
        if low <= high and not low <= value <= high:
            what = f"{value:g} is outside parameters.{name}.range, {low:g} to {high:g}, the range of the reduced model"
            remedy = f"change the value, or extend parameters.{name}.range"
            yield Problem(f"validate.truth.parameters.{name}", what, remedy)
    for name, std in config.validation.initial_std.items():
        if name in parameters and std > LARGEST_START:
            what = f"the initial σ is {std:g} times the guess, more than {LARGEST_START:g} times"
            remedy = f"use at most {LARGEST_START:g}; 0.1 is 10 % of the guess"
            yield Problem(f"validate.initial_std.{name}", what, remedy)
        yield from one_of(
            f"validate.initial_std.{name}", name, unknowns, f"no parameter or load has the name '{name}'", at_key=True
        )
    for name in config.place.estimate:
        if name in unknowns and name not in config.validation.initial_std:
            what = f"the initial standard deviation of '{name}' is missing"
            remedy = f"add {name}: 0.1 (10 % of the guess or of the load amplitude)"
            yield Problem("validate.initial_std", what, remedy, at_key=True)


def _measurements(config: PlacementConfig) -> Iterator[Problem]:
    """Check for names under `estimate` that have no effect."""
    if config.estimate is None:
        return
    for name in config.estimate.initial_std:
        yield from one_of(
            f"estimate.initial_std.{name}",
            name,
            config.place.estimate,
            f"no entry of place.estimate has the name '{name}'",
        )
    for name in config.place.estimate if config.validation is None else ():
        if name not in config.estimate.initial_std:
            what = f"the initial standard deviation of '{name}' is missing"
            remedy = f"add {name}: 0.1 (10 % of the guess or of the load amplitude), or add the section `validate`"
            yield Problem("estimate.initial_std", what, remedy, at_key=True)
    yield from record_problems(config, config.estimate)
    load_names = {f"estimate.inputs.{name}": name for name in config.estimate.inputs}
    for i, record in enumerate(config.estimate.records):
        load_names |= {f"estimate.records.{i}.inputs.{name}": name for name in record.inputs or ()}
    for key, name in load_names.items():
        yield from known(key, name, config.loads, "load")
        if name in config.loads and not config.loads[name].known:
            what = f"load '{name}' is unknown, so the measured channel of this load has no effect"
            remedy = f"remove this entry, or set loads.{name}.known: true and remove {name} from place.estimate"
            yield Problem(key, what, remedy)


def record_problems(config: PlacementConfig, settings: Estimate) -> Iterator[Problem]:
    """Yield every inconsistency of `estimate.records`."""
    records = settings.records
    if not records:
        return
    if settings.file is not None:
        what = f"cannot be combined with estimate.file ({settings.file})"
        yield Problem(
            "estimate.records", what, "remove estimate.records, or estimate.file (option --measurements)", at_key=True
        )
    names, files = [record.name.lower() for record in records], [record.file for record in records]
    for i, record in enumerate(records):
        key = f"estimate.records.{i}"
        if record.name.lower() in names[:i]:
            yield Problem(f"{key}.name", f"'{record.name}' appears twice", "rename one of the two records")
        if record.file in files[:i]:
            yield Problem(f"{key}.file", f"{record.file} is the file of two records", "remove one of the two records")
        if record.channels is not None:
            yield from _other_channels(f"{key}.channels", settings.channels, record.channels)
    if len(records) > 1:
        yield from _not_of_several(config, settings)


def _other_channels(
    key: str, shared: tuple[GaugeChannel, ...], channels: tuple[GaugeChannel, ...]
) -> Iterator[Problem]:
    remedy = "list the same gauges and measuring grids as in estimate.channels, in the same order, with the same `bias`"
    if len(channels) != len(shared):
        yield Problem(key, f"the number of channels is {len(channels)}, but {len(shared)} in estimate.channels", remedy)
        return
    for i, (one, other) in enumerate(zip(channels, shared, strict=True)):
        for field in ("gauge", "grid", "bias"):
            actual, expected = getattr(one, field), getattr(other, field)
            if actual != expected:
                yield Problem(f"{key}.{i}", f"`{field}` is {actual}, but {expected} in estimate.channels[{i}]", remedy)


def _not_of_several(config: PlacementConfig, settings: Estimate) -> Iterator[Problem]:
    """Check the keys that support one record only."""
    method = config.filter.method
    one = "or replace estimate.records by estimate.file with one record"
    if method != "grid":
        what = f"filter.method: {method} supports one record only"
        yield Problem("estimate.records", what, f"set filter.method: grid, {one}", at_key=True)
    if config.filter.compare:
        what = "the comparison with the extended and the sigma-point filter supports one record only"
        yield Problem("filter.compare", what, f"remove filter.compare, {one}")
    if settings.tune.parts:
        what = "noise levels can be tuned with one record only"
        remedy = (
            "remove estimate.tune; or tune in a run with estimate.file, and apply its printed factors f to this config: "
            "multiply every `noise_std`, process_noise.model_error and parameters.NAME.process_noise_scale by √f, "
            "and loads.NAME.process_noise.kappa by f"
        )
        yield Problem("estimate.tune.parts", what, remedy)
    if settings.field is not None:
        what = "strain of the surface over time is available for one record only"
        yield Problem("estimate.field", what, f"remove estimate.field, {one}")


CHECKS: dict[Callable[[PlacementConfig], Iterator[Problem]], str] = {
    model_problems: "",
    static_problems: "loads damping train place",
    damping_problems: "loads damping train place",
    result_problems: "loads damping train place",
    gauge_problems: "gauges place",
    _training_time: "loads train",
    _validation_time: "loads train validate",
    _load_cases: "loads train place",
    _estimate: "loads place",
    _optimum: "gauges place",
    _input_models: "loads",
    _fast: "loads train",
    _filter: "",
    _drifting: "train",
    _validation: "loads place validate",
    _measurements: "loads place",
}
"""Check → sections without which it is omitted."""
