"""What one field of a config demands of another."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches

from strainsight.config.loads import Load, MultiSine, Recorded, Sine, Sweep
from strainsight.config.placement import AxisDirection, GuessFrom, KeepOutBox, MaterialParameter, PlacementConfig

FEWEST_STEPS = 10
MOST_STEPS = 10_000_000  # a time step in the wrong unit, rather than a run that anyone waits for
FEWEST_STEPS_A_PERIOD = 8
RESERVED = {"constant"}  # names the terms of an affine operator that belong to no parameter


@dataclass(frozen=True)
class Problem:
    """One thing to mend: dotted key, what is wrong, how to mend it; whether the key itself is wrong, not its value."""

    key: str
    what: str
    remedy: str = ""
    at_key: bool = False


def problems(config: PlacementConfig) -> Iterator[Problem]:
    """Every contradiction between the fields of a config."""
    yield from _names(config)
    for name, parameter in config.parameters.items():
        yield from _parameter(f"parameters.{name}", parameter, config.name)
    for name, load in config.loads.items():
        yield from _load(f"loads.{name}", load)
    yield from _direction(config.gauges.direction)
    for i, zone in enumerate(config.gauges.exclude):
        if isinstance(zone, KeepOutBox) and any(low >= high for low, high in zip(*zone.box, strict=True)):
            yield Problem(
                f"gauges.exclude.{i}.box",
                "the lower corner is not below the upper one",
                "give [[lowest], [highest]] x, y, z",
            )
    yield from _time("train", config.train.duration, config.train.time_step, config)
    yield from _time("validate", config.validation.duration, config.validation.time_step, config)
    yield from _estimate(config)
    yield from _keep(config)
    yield from _validation(config)


def did_you_mean(word: str, known: Iterable[str], otherwise: str = "") -> str:
    """A suggestion in words, or `otherwise`."""
    spelt = {name.lower(): name for name in known}
    close = get_close_matches(word.lower(), spelt, n=1, cutoff=0.5)
    return f"did you mean {spelt[close[0]]}?" if close else otherwise


def _names(config: PlacementConfig) -> Iterator[Problem]:
    for name in config.parameters:
        if name in config.loads:
            yield Problem(
                f"loads.{name}", "a parameter has this name too", "give every unknown a name of its own", at_key=True
            )
    for section, names in (("parameters", config.parameters), ("loads", config.loads)):
        for name in names:
            if name in RESERVED:
                yield Problem(f"{section}.{name}", f"the name '{name}' is taken", "choose another name", at_key=True)


def _parameter(key: str, parameter: MaterialParameter, run: str) -> Iterator[Problem]:
    low, high = parameter.range
    if low >= high:
        yield Problem(
            f"{key}.range", f"the lowest value {low:g} is not below the highest {high:g}", "give [lowest, highest]"
        )
    elif isinstance(parameter.guess, float | int) and not low <= parameter.guess <= high:
        yield Problem(
            f"{key}.guess",
            f"{parameter.guess:g} lies outside the range {low:g} to {high:g}",
            f"widen {key}.range, or guess within it",
        )
    if isinstance(parameter.guess, GuessFrom) and parameter.guess.source == run:
        yield Problem(f"{key}.guess.from", "a run cannot take a guess from itself", "name another run")


def _load(key: str, load: Load) -> Iterator[Problem]:
    if (load.node is None) == (load.set is None):
        given = "neither 'node' nor 'set' is given" if load.node is None else "'node' and 'set' are both given"
        yield Problem(key, given, "give exactly one of them", at_key=True)
    if not any(load.direction):
        yield Problem(f"{key}.direction", "a direction of length zero", "give a vector such as [0, 0, 1]")
    if isinstance(load.signal, MultiSine) and load.signal.lowest > load.signal.highest:
        yield Problem(
            f"{key}.signal.lowest",
            f"{load.signal.lowest:g} Hz is above the highest, {load.signal.highest:g} Hz",
            "swap them",
        )
    if not load.known and isinstance(load.signal, Recorded) and load.process_noise.frequency is None:
        yield Problem(
            f"{key}.process_noise",
            "an unknown load from a recorded signal needs a typical frequency",
            f"give {key}.process_noise.frequency [Hz]",
            at_key=True,
        )


def _direction(direction: AxisDirection) -> Iterator[Problem]:
    if not any(direction.axis):
        yield Problem("gauges.direction.axis", "an axis of length zero", "give a vector such as [1, 0, 0]")
    # A gauge turned by half a turn is the same gauge.
    turned = [angle % 180 for angle in direction.angles]
    if len(set(turned)) < len(turned):
        yield Problem("gauges.direction.angles", "two angles are the same direction", "remove one of them")


def _time(section: str, duration: float, step: float, config: PlacementConfig) -> Iterator[Problem]:
    steps = duration / step
    if steps < FEWEST_STEPS * (1 - 1e-9):
        yield Problem(
            f"{section}.time_step",
            f"{duration:g} s are {steps:.3g} steps of {step:g} s",
            f"take at least {FEWEST_STEPS} steps",
        )
    elif steps > MOST_STEPS:
        yield Problem(
            f"{section}.time_step",
            f"{duration:g} s are {steps:.3g} steps of {step:g} s",
            f"take at most {MOST_STEPS} steps",
        )
    elif abs(steps - round(steps)) > 1e-6 * steps:
        yield Problem(
            f"{section}.time_step",
            f"{step:g} s does not divide the duration of {duration:g} s ({steps:.6g} steps)",
            f"take {duration / round(steps):.9g} s",
        )
    for name, load in config.loads.items():
        highest = _highest(load)
        if highest is not None and step * highest * FEWEST_STEPS_A_PERIOD > 1:
            yield Problem(
                f"{section}.time_step",
                f"{step:g} s gives {1 / (step * highest):.3g} steps a period of load '{name}' ({highest:g} Hz)",
                f"take at most {1 / (FEWEST_STEPS_A_PERIOD * highest):.3g} s",
            )


def _highest(load: Load) -> float | None:
    match load.signal:
        case Sine():
            return load.signal.frequency
        case Sweep():
            return max(load.signal.start_frequency, load.signal.end_frequency)
        case MultiSine():
            return load.signal.highest
    return None


def _estimate(config: PlacementConfig) -> Iterator[Problem]:
    known = [*config.parameters, *config.loads]
    for i, name in enumerate(config.place.estimate):
        key = f"place.estimate.{i}"
        if name not in known:
            yield Problem(
                key,
                f"no parameter or load is named '{name}'",
                did_you_mean(name, known, f"there are {', '.join(known)}"),
            )
        elif name in config.place.estimate[:i]:
            yield Problem(key, f"'{name}' is named twice", "remove one of them")
        elif name in config.loads and config.loads[name].known:
            yield Problem(key, f"load '{name}' is known", f"set loads.{name}.known: false, or do not estimate it")
    for name, load in config.loads.items():
        if not load.known and name not in config.place.estimate:
            yield Problem(
                "place.estimate",
                f"the unknown load '{name}' is not estimated",
                f"add {name}, or set loads.{name}.known: true",
            )


def _keep(config: PlacementConfig) -> Iterator[Problem]:
    keep, names = config.place.keep, tuple(dict.fromkeys(config.place.estimate))
    kinds = {"inputs" if name in config.loads else "parameters" for name in names}
    what = f"unknown {kinds.pop()}" if len(kinds) == 1 else "unknowns"
    if keep < len(names):
        yield Problem(
            "place.keep",
            f"{keep} gauge{'s' * (keep != 1)} cannot observe {len(names)} {what} ({', '.join(names)})",
            f"keep at least {len(names)}, or estimate fewer {what.removeprefix('unknown ')}",
        )
    pool = config.screen.keep
    if pool != "all" and keep > pool:
        yield Problem(
            "place.keep",
            f"{keep} is larger than the pool of {pool} (screen.keep)",
            f"keep at most {pool}, or raise screen.keep",
        )


def _validation(config: PlacementConfig) -> Iterator[Problem]:
    parameters, known = list(config.parameters), [*config.parameters, *config.loads]
    for name in config.validation.truth.parameters:
        if name not in parameters:
            otherwise = f"there are {', '.join(parameters)}" if parameters else "the config has no parameters"
            yield Problem(
                f"validate.truth.parameters.{name}",
                f"no parameter is named '{name}'",
                did_you_mean(name, parameters, otherwise),
                True,
            )
    for name in config.validation.initial_std:
        if name not in known:
            yield Problem(
                f"validate.initial_std.{name}",
                f"no parameter or load is named '{name}'",
                did_you_mean(name, known, f"there are {', '.join(known)}"),
                True,
            )
    for name in config.place.estimate:
        if name in known and name not in config.validation.initial_std:
            yield Problem(
                "validate.initial_std",
                f"no initial standard deviation for '{name}'",
                f"add {name}: 0.1 (relative)",
                at_key=True,
            )
