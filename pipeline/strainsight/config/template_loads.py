"""Loads, training simulation and channels in the config of `strainsight init`, with the reason for each default."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

from strainsight.config.checks_model import RESERVED
from strainsight.config.deck_properties import Answers, CandidateLocation, LoadAnswer, Suggestion
from strainsight.config.template_text import WORDS, plain, quoted

STATIC = 0.1
"""Largest ratio of a load frequency to the first natural frequency for a static model: inertia then changes strains by 1 %, from
which `train` warns."""
SLOW = 0.05
"""Ratio of the assumed frequency of a load to the first natural frequency."""
ASSUMED = 1.0
"""Largest assumed frequency of a load [Hz]."""
LISTED = 12
"""Largest number of load locations that a config lists."""
PARAMETERS = ("E", "stiffness")
"""Names of the parameter of a config."""


@dataclass(frozen=True)
class NamedLoad:
    """A load with its name in the config, that of its face in `mesh.faces` if any, and its frequencies [Hz], which may be
    assumed."""

    name: str
    face: str
    answer: LoadAnswer
    band: tuple[float, float]
    assumed: bool


def named_loads(suggestion: Suggestion, answers: Answers, first: float | None = None) -> list[NamedLoad]:
    """Loads by the name of their deck load or set, others as `force`; first: first natural frequency [Hz] or None."""
    loads: list[NamedLoad] = []
    slow = rounded(min(ASSUMED, SLOW * first) if first else ASSUMED)
    for answer in answers.loads:
        place, name, face = answer.place, "force", ""
        if place is not None and place.kind in ("deck_load", "set") and _usable(place.name):
            name = place.name
        if place is not None and place.kind == "face":
            face = suggestion.free(_unused("loaded", [load.face for load in loads]))
        name = _unused(name, [load.name for load in loads])
        loads.append(NamedLoad(name, face, answer, answer.band or (slow, slow), answer.band is None))
    return loads


def _unused(name: str, names: Sequence[str]) -> str:
    """The name, with a number if it is one of the names."""
    return next(text for text in (name, *(f"{name}-{i}" for i in range(2, len(names) + 2))) if text not in names)


def _usable(name: str) -> bool:
    """Whether a name of the deck may be that of a load."""
    form = re.fullmatch(r"[A-Za-z_][A-Za-z0-9_-]{0,59}", name)
    return form is not None and name.lower() not in (*WORDS, *RESERVED) and name not in PARAMETERS


def rounded(x: float, up: bool = False) -> float:
    """Nearest 1, 2 or 5 times a power of ten that is not larger; up: with two digits, not smaller."""
    power = 10.0 ** math.floor(math.log10(x) + 1e-9)
    if up:
        return float(f"{math.ceil(round(10 * x / power, 6)) * power / 10:.2g}")
    return float(f"{max(n for n in (1, 2, 5) if n * power <= x * (1 + 1e-9)) * power:.2g}")


PERIODS, STEPS, MANY = (20, 5), (100, 40), 5000
"""Periods of the lowest and time steps per period of the highest load frequency, and in records of more than MANY steps."""


def training(loads: Sequence[NamedLoad], first: float | None) -> str:
    """Model, duration and time step of the training simulation; first: first natural frequency [Hz] or None."""
    low, high = min(load.band[0] for load in loads), max(load.band[1] for load in loads)
    which = PERIODS[0] * STEPS[0] * high / low > MANY
    duration, step = rounded(PERIODS[which] / low, up=True), rounded(1 / (STEPS[which] * high))
    if first is None:
        model, why = (
            "dynamic",
            f"with inertia; use static if the first natural frequency is above {high / STATIC:.4g} Hz",
        )
    else:
        model = "static" if high <= STATIC * first else "dynamic"
        inertia = "inertia is negligible" if model == "static" else "inertia matters"
        why = f"{inertia}: {high:.4g} Hz is {high / first:.2g} of the first natural frequency, {first:.4g} Hz (limit: {STATIC:g})"
    return (
        f"  model: {model:<24} # {why}\n"
        f"  duration: {plain(duration):<21} # [s] {PERIODS[which]} periods of the lowest load frequency, {low:.4g} Hz\n"
        f"  time_step: {plain(step):<20} # [s] at least {STEPS[which]} steps per period of the highest load frequency, "
        f"{high:.4g} Hz\n"
    )


def times(train: str) -> str:
    """Lines `duration` and `time_step` of the text of `training`, without comments."""
    return "".join(f"{line.partition('#')[0].rstrip()}\n" for line in train.splitlines()[1:])


def load_lines(load: NamedLoad, suggestion: Suggestion, known: bool) -> list[str]:
    """Location, direction, time history and model of a load."""
    place, answer, (low, high) = load.answer.place, load.answer, load.band
    lines = [f"  {load.name}:"]
    if place is None:
        lines += _locations(suggestion)
    elif place.kind == "face":
        lines.append(f"    set: {load.face:<24} # the face above; the force is distributed over it")
    else:
        lines.append(f"    {place.kind}: {location(place):<20} # {place.what}")
    if place is not None and place.factor:
        lines.append("    factor: true                 # the signal is a factor on the load of the deck")
    if place is None or place.kind != "deck_load":
        direction = answer.direction or ""
        lines.append(f"    direction: {direction:<18} # ← [x, y, z], or instead key `moment`, `bearing` or `pressure`")
    lines.append(f"    known: {str(known).lower():<22} # ← true: measured by a load cell; false: estimated")
    amplitude = answer.amplitude if answer.amplitude is not None or place is None else place.force
    kind = f"type: sine, frequency: {plain(low)}"
    if low < high:
        kind = f"type: multisine, lowest: {plain(low)}, highest: {plain(high)}, count: 10"
    unit = "times the load of the deck" if place is not None and place.factor else "[N]"
    assumed = "assumed: a slow load; " if load.assumed else ""
    lines.append(
        f"    signal: {{{kind}, amplitude: {plain(amplitude)}}} # ← {assumed}[Hz], {unit}; other types: sweep, csv"
    )
    if not known:
        model = f"{{model: matern, frequency: {plain(high)}}}"
        lines.append(
            f"    process_noise: {model} # [Hz] bandwidth: highest frequency of the load; or random_walk: any load"
        )
    return lines


def _locations(suggestion: Suggestion) -> list[str]:
    """Possible locations of a load as comments, and a blank line."""
    lines = ["    # ← location of the load, one of"]
    likely = [spot for spot in suggestion.places if spot.kind != "face" and not (spot.supported or spot.factor)]
    lines += [f"    #   {spot.kind}: {location(spot):<20} # {spot.what}" for spot in likely[:LISTED]]
    lines.append("    #   set: NAME                 # a name of mesh.faces: the force is distributed over the face")
    for spot in [spot for spot in suggestion.loads if spot.factor]:
        lines.append(f"    #   deck_load: {location(spot):<14} # {spot.what}; set `factor: true`, omit `direction`")
    return [*lines, "    set:"]


def location(place: CandidateLocation) -> str:
    """Name or id of a location in YAML form."""
    return place.name if place.kind == "node" else quoted(place.name)


def channels(name: str, loads: Sequence[NamedLoad], keep: int, known: bool, settled: bool) -> str:
    """The section `estimate` in comments, with the channels of the simulated record of `validate`."""
    lines = [
        "estimate:",
        "  as_placed: true                 # after bonding, instead: gauges_file: bonded.csv, the copy of gauges.csv",
        "  time: {channel: time}           # or {rate: 1000, unit: Hz}",
        "  channels:                       # names and units as in the file: um/m, or mV/V with `bridge`",
        *(f"    - {{gauge: G{i}, channel: G{i}, unit: m/m}}" for i in range(1, keep + 1)),
    ]
    if known:
        lines.append("  inputs:                         # channels of the load cells")
        for load in loads:
            unit = '"1"' if load.answer.place is not None and load.answer.place.factor else "N"
            lines.append(f"    {load.name}: {{channel: {load.name}, unit: {unit}}}")
    if settled:
        lines.append("  start: settled                  # periodic motion from the start; or rest, moving")
    return (
        f"# For the test, remove the # at the start of the lines below. They fit results/{name}/measured.csv, the simulated\n"
        f"# record of `validate`. After bonding, copy results/{name}/gauges.csv, and correct the positions of the copy. Then:\n"
        "# strainsight estimate CONFIG --measurements FILE\n"
    ) + "".join(f"#{line}\n" for line in lines)
