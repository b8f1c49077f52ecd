"""Answers for `strainsight init`, from its options or in the terminal."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import typer

from strainsight.config.deck_properties import MATERIALS, Answers, CandidateLocation, LoadAnswer, Suggestion
from strainsight.errors import UserError, did_you_mean
from strainsight_cli.printing import say

Value = TypeVar("Value")
SHOWN = 30
"""Largest number of locations that a question lists."""


def read_vector(option: str, text: str) -> str:
    """ "0 0 1", "0, 0, 1" or "[0, 0, 1]" as "[0, 0, 1]". Raises UserError for other text."""
    numbers = []
    with suppress(ValueError):
        numbers = [float(word) for word in re.split(r"[\s,;]+", text.strip().strip("[]()").strip())]
    if len(numbers) != 3 or not all(math.isfinite(number) for number in numbers):
        raise UserError(f"'{text}' is not a list of three numbers", where=option, remedy="use x, y, z as in '0, 0, 1'")
    return "[" + ", ".join(f"{number:.12g}" for number in numbers) + "]"


def read_direction(option: str, text: str) -> str:
    """Three numbers as in `read_vector`, not all zero. Raises UserError for a zero vector."""
    if not any(json.loads(vector := read_vector(option, text))):
        raise UserError(f"'{text}' is a vector of length zero", where=option, remedy="use a vector such as '0, 0, 1'")
    return vector


def read_support(option: str, text: str, hints: Suggestion) -> CandidateLocation:
    """A location as in `read_place` that can be supported. Raises UserError for a load of the deck."""
    place = read_place(option, text, hints)
    if place.kind == "deck_load":
        remedy = "use 'node ID', 'set NAME', or a point 'x, y, z' [m] on a face"
        raise UserError(f"'{text}' is a load, not the location of a support", where=option, remedy=remedy)
    return place


def read_loads(
    hints: Suggestion,
    places: Sequence[str],
    directions: Sequence[str],
    amplitudes: Sequence[str],
    frequencies: Sequence[str],
) -> tuple[LoadAnswer, ...]:
    """The loads of the options. Raises UserError for a number of values that does not fit, and a direction of a deck load."""
    known: list[CandidateLocation | None] = [read_place("--load", text, hints) for text in places]
    known = known or [None]
    free = [place for place in known if place is None or place.kind != "deck_load"]
    if directions and not free:
        remedy = "remove --direction; for another direction, use the location of the load instead of its name"
        raise UserError("the loads of the deck already have directions", where="--direction", remedy=remedy)
    along = iter(_for_each("--direction", directions, len(free), read_direction))
    sizes = _for_each("--amplitude", amplitudes, len(known), read_positive)
    bands = _for_each("--frequency", frequencies, len(known), read_band)
    return tuple(
        LoadAnswer(place, next(along) if place in free else None, size, band)
        for place, size, band in zip(known, sizes, bands, strict=True)
    )


def _for_each(option: str, texts: Sequence[str], count: int, read: Callable[[str, str], Value]) -> list[Value | None]:
    """One value of an option for each of several loads. Raises UserError unless there is one for all, or one for each."""
    if len(texts) not in (0, 1, count):
        loads = f"{count} load{'s' * (count != 1)}{' without a direction' * (option == '--direction')}"
        raise UserError(
            f"{len(texts)} values for {loads}",
            where=option,
            remedy="use the option once for all loads, or once for each load, in the order of --load",
        )
    return [read(option, text) for text in (texts if len(texts) == count else [*texts] * count)] or [None] * count


def read_band(option: str, text: str) -> tuple[float, float]:
    """ "20", or lowest and highest frequency, "0.5, 20" [Hz]. Raises UserError for other text."""
    words = re.split(r"[\s,;]+", text.strip().strip("[]()").strip())
    low, high = read_positive(option, words[0]), read_positive(option, words[-1])
    if len(words) > 2 or low > high:
        remedy = "use one frequency, or the lowest and the highest as in '0.5, 20' [Hz]"
        raise UserError(f"'{text}' is not a frequency or a band", where=option, remedy=remedy)
    return low, high


def read_place(option: str, text: str, hints: Suggestion) -> CandidateLocation:
    """A load or set of the deck by its name, node "2" or "node 2", or point of a face, "x, y, z" [m]. Raises UserError for other
    text."""
    name = text.strip()
    kind, _, rest = name.partition(" ")
    kinds: tuple[str, ...] = ("node",) if name.isdecimal() else ("deck_load", "set")
    if kind in ("node", "set", "deck_load"):
        kinds, name = (kind,), rest.strip()
    known = [place for place in hints.places if place.kind in kinds]
    if same := [place for place in known if place.name == name]:
        return same[0]
    if kinds == ("node",):
        if not name.isdecimal():
            raise UserError(f"'{name}' is not a node id", where=option, remedy="use a number, as in 'node 2'")
        return CandidateLocation("node", name, "a node")
    if len(kinds) > 1 and re.fullmatch(r"[\s\d.,;eE+()\[\]-]+", name):
        return CandidateLocation("face", read_vector(option, name), "a face")
    what = {"deck_load": "load", "set": "node set"}.get(kind, "load or set")
    listed = "; ".join(f"{place.name} ({place.what})" for place in known[:SHOWN]) or "none"
    near = did_you_mean(name, [place.name for place in known])
    raise UserError(
        f"the deck has no {what} '{name}'",
        where=option,
        remedy=f"{near} Known names: {listed}. Other locations: 'node ID', or a point 'x, y, z' [m] on a face".lstrip(),
    )


def read_material(option: str, text: str) -> tuple[float, float, float]:
    """Name of a material, or "E, ν, ρ" in Pa and kg/m³. Raises UserError for other text."""
    if text.strip().lower() in MATERIALS:
        return MATERIALS[text.strip().lower()]
    try:
        E, nu, rho = (float(word) for word in re.split(r"[\s,;]+", text.strip()))
    except ValueError:
        remedy = f"use {', '.join(MATERIALS)}, or E, ν and ρ as in '2.1e11, 0.3, 7850' [Pa, -, kg/m³]"
        raise UserError(f"unknown material '{text}'", where=option, remedy=remedy) from None
    if not (E > 0 and -1 < nu < 0.5 and rho >= 0):
        raise UserError(
            f"'{text}' is not a valid material",
            where=option,
            remedy="use E above 0, ν between -1 and 0.5, ρ not negative",
        )
    return E, nu, rho


def ask_answers(hints: Suggestion, answers: Answers, *, find: bool) -> Answers:
    """The answers, completed in the terminal; find: the unknown is already set by an option."""
    say("Press Enter to leave a line of the config blank and fill it in later.")

    def ask(field: str, question: str, read: Callable[[str], Any], needed: bool = True) -> None:
        nonlocal answers
        if needed and getattr(answers, field) is None:
            answer: dict[str, Any] = {field: _ask(question, read)}
            answers = replace(answers, **answer)

    known = f"{', '.join(MATERIALS)}, or E [Pa], ν, ρ [kg/m³]"
    lacking = f"material (the deck has none, or no density): {known}"
    ask("material", lacking, partial(read_material, "material"), bool(hints.lacking))
    what = "active support set" if hints.support_key == "spc" else "active step"
    sets = ", ".join(map(str, hints.support_sets))
    ask("spc", f"{what} ({sets})", partial(read_support_set, hints=hints), bool(hints.support_sets))
    _list_places(hints.places)
    support_question = "location of the support (number in the list, node ID, or x, y, z in m)"
    ask("support", support_question, _numbered(hints, read_support), not hints.supports)
    answers = replace(answers, loads=ask_loads(hints, answers.loads))
    sought = "estimate the loads (no: estimate Young's modulus from measured loads)"
    return answers if find or not typer.confirm(sought) else replace(answers, find="load")


def ask_loads(hints: Suggestion, chosen: tuple[LoadAnswer, ...]) -> tuple[LoadAnswer, ...]:
    """The loads of the options, completed; without --load one load after the other, until a blank line."""
    loads: list[LoadAnswer] = []
    while chosen[0].place is None or len(loads) < len(chosen):
        load = chosen[len(loads)] if len(loads) < len(chosen) else LoadAnswer()
        question = f"load {len(loads) + 1} (number in the list, name, node ID, or x, y, z in m; Enter: no further load)"
        place = load.place or _ask(question, _numbered(hints, read_place))
        if place is None:
            break
        name = "" if len(chosen) == 1 else f" {place.name}"
        along, size, band = load.direction, load.amplitude, load.band
        if place.kind != "deck_load" and along is None:
            question = f"direction of the load{name} in the global axes of the deck (x, y, z)"
            along = _ask(question, partial(read_direction, "direction"))
        if size is None:
            default = f"; Enter: {place.force:.4g}" if place.force else ""
            unit = "times the load of the deck" if place.factor else "N"
            size = _ask(f"amplitude of the load{name} [{unit}]{default}", partial(read_positive, "amplitude"))
        if band is None:
            question = f"frequency of the load{name}, or lowest and highest frequency [Hz]; Enter: slow"
            band = _ask(question, partial(read_band, "frequency"))
        loads.append(LoadAnswer(place, along, size, band))
    return tuple(loads) or chosen


def read_support_set(text: str, hints: Suggestion) -> int:
    """Number of a support set or step of the deck. Raises UserError for other text."""
    known = [str(number) for number in hints.support_sets]
    if text.strip() not in known:
        what = "support set" if hints.support_key == "spc" else "step"
        raise UserError(f"the deck has no {what} '{text.strip()}'", remedy=f"use one of {', '.join(known)}")
    return int(text)


def read_positive(option: str, text: str) -> float:
    """A positive number. Raises UserError for other text."""
    with suppress(ValueError):
        if 0 < float(text) < math.inf:
            return float(text)
    raise UserError(
        f"'{text}' is not a positive number", where=option, remedy="use a positive number without unit, as in 250"
    )


def _list_places(places: Sequence[CandidateLocation]) -> None:
    """Print the locations with their numbers."""
    for number, place in enumerate(places[:SHOWN], start=1):
        name = f"near {place.name}" if place.kind == "face" else f"{place.kind} {place.name}"
        say(f"{number:4}  {name:<38} {place.what}{', supported' if place.supported else ''}")
    if len(places) > SHOWN:
        say(f"      {len(places) - SHOWN} more")


def _numbered(
    hints: Suggestion, read: Callable[[str, str, Suggestion], CandidateLocation]
) -> Callable[[str], CandidateLocation]:
    """`read`, or the number of a location."""

    def place_of(text: str) -> CandidateLocation:
        if not (text.strip().isdecimal() and 1 <= int(text) <= len(hints.places)):
            return read("place", text, hints)
        place = hints.places[int(text) - 1]
        return place if place.kind == "face" else read("place", f"{place.kind} {place.name}", hints)

    return place_of


def _ask(question: str, read: Callable[[str], Value]) -> Value | None:
    """The answer; the question repeats until the answer is valid. None for a blank line."""
    while True:
        try:
            text = typer.prompt(question, default="", show_default=False)
        except typer.Abort:
            say("")
            remedy = "run the command in a terminal, or use options instead of --interactive (strainsight init --help)"
            raise UserError(
                "the input ended before the last question, and no file was written", remedy=remedy
            ) from None
        try:
            return read(text) if text.strip() else None
        except UserError as error:
            say(*str(error).split("\n"))
