"""What `strainsight init` asks: options, and with --interactive questions in the terminal for what they leave open."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import typer

from strainsight.config.answers import MATERIALS, Answers, Place, Suggestion
from strainsight.errors import UserError, did_you_mean
from strainsight_cli.printing import say

Value = TypeVar("Value")
SHOWN = 30
"""Places that a question lists."""


def vector(option: str, text: str) -> str:
    """ "0 0 1", "0, 0, 1" or "[0, 0, 1]" as "[0, 0, 1]". Raises UserError for what is not three numbers."""
    words = re.split(r"[\s,;]+", text.strip().strip("[]()").strip())
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != 3 or not all(math.isfinite(number) for number in numbers):
        raise UserError(f"'{text}' is not three numbers", where=option, remedy="give x, y, z as in '0, 0, 1'")
    return "[" + ", ".join(f"{number:.12g}" for number in numbers) + "]"


def direction(option: str, text: str) -> str:
    """A `vector` of some length. Raises UserError for one of none."""
    if not any(json.loads(found := vector(option, text))):
        raise UserError(f"'{text}' has no length", where=option, remedy="give a vector such as '0, 0, 1'")
    return found


def support(option: str, text: str, found: Suggestion) -> Place:
    """A `place` that can be held. Raises UserError for a load of the deck."""
    own = place(option, text, found)
    if own.kind == "deck_load":
        raise UserError(
            f"'{text}' is a load", where=option, remedy="give 'node ID', 'set NAME', or 'x, y, z' of a face"
        )
    return own


def checked(found: Suggestion, given: Answers) -> Answers:
    """The answers. Raises UserError for one that the deck has given already."""
    if given.material is not None and not found.lacking:
        remedy = "leave it out; mesh.materials in the config replaces what the deck states"
        raise UserError("the deck states its materials", where="--material", remedy=remedy)
    if given.held is not None and found.supports:
        remedy = "leave it out; mesh.supports in the config adds to those of the deck"
        raise UserError("the deck has supports", where="--held", remedy=remedy)
    return given


def place(option: str, text: str, found: Suggestion) -> Place:
    """ "node 2", "set NAME", "deck_load NAME" or a point of a face, "x, y, z" [m]. Raises UserError for anything else."""
    kind, _, name = text.strip().partition(" ")
    if kind in ("node", "set", "deck_load"):
        name = name.strip()
        known = [own for own in found.places if own.kind == kind]
        same = [own for own in known if own.name == name]
        if not same and kind != "node":
            names = [own.name for own in known]
            remedy = did_you_mean(name, names, f"it has {', '.join(names) or 'none'}")
            raise UserError(f"the deck has no {kind} '{name}'", where=option, remedy=remedy)
        if kind == "node" and not name.isdecimal():
            raise UserError(f"'{name}' is not the id of a node", where=option, remedy="give a number, as in 'node 2'")
        return same[0] if same else Place("node", name, "a node")
    try:
        return Place("face", vector(option, text), "a face")
    except UserError:
        remedy = "give 'node ID', 'set NAME', 'deck_load NAME', or a point 'x, y, z' in m of a face"
        raise UserError(f"'{text}' says of no place where it is", where=option, remedy=remedy) from None


def material(option: str, text: str) -> tuple[float, float, float]:
    """The name of a material, or "E, ν, ρ" in Pa and kg/m³. Raises UserError for anything else."""
    if text.strip().lower() in MATERIALS:
        return MATERIALS[text.strip().lower()]
    try:
        E, nu, rho = (float(word) for word in re.split(r"[\s,;]+", text.strip()))
    except ValueError:
        what = f"{', '.join(MATERIALS)}, or E, ν and ρ as in '2.1e11, 0.3, 7850' [Pa, -, kg/m³]"
        raise UserError(f"'{text}' is no material that is known", where=option, remedy=f"give {what}") from None
    if not (E > 0 and -1 < nu < 0.5 and rho >= 0):
        raise UserError(
            f"'{text}' is of no material", where=option, remedy="E above 0, ν between -1 and 0.5, ρ not negative"
        )
    return E, nu, rho


def asked(found: Suggestion, given: Answers, *, find: bool) -> Answers:
    """The answers with those of the terminal for what was not given; find: whether the user has said what is sought."""
    say("Enter leaves a line blank; it can be filled in later.")
    answers = given
    if found.lacking and answers.material is None:
        known = f"{', '.join(MATERIALS)}, or E [Pa], ν, ρ [kg/m³]"
        answers = replace(
            answers,
            material=_ask(f"the deck lacks a material, or its density: {known}", lambda t: material("material", t)),
        )
    if found.support_sets and answers.spc is None:
        known = ", ".join(map(str, found.support_sets))
        what = "which set of supports holds" if found.support_key == "spc" else "which step counts"
        answers = replace(answers, spc=_ask(f"{what} ({known})", lambda t: support_set(t, found)))
    places = _listed(found.places)
    if not found.supports and answers.held is None:
        answers = replace(
            answers,
            held=_ask("where is it held (number above, node ID or x, y, z in m)", _chosen(places, found, support)),
        )
    if answers.load is None:
        answers = replace(answers, load=_ask("where does the load act (as above)", _chosen(places, found, place)))
    deck = answers.load is not None and answers.load.kind == "deck_load"
    if answers.direction is None and not deck:
        answers = replace(answers, direction=_ask("along what (x, y, z)", lambda t: direction("direction", t)))
    if answers.amplitude is None and not deck:
        answers = replace(answers, amplitude=_ask("how large, its amplitude [N]", lambda t: positive("amplitude", t)))
    if answers.frequency is None:
        answers = replace(answers, frequency=_ask("how fast, its frequency [Hz]", lambda t: positive("frequency", t)))
    if not find and typer.confirm(
        "is the load itself to be found (otherwise the modulus, from a load that is measured)"
    ):
        answers = replace(answers, find="load")
    return answers


def support_set(text: str, found: Suggestion) -> int:
    """Number of a set of supports, or of a step, of the deck. Raises UserError for anything else."""
    known = [str(number) for number in found.support_sets]
    if text.strip() not in known:
        what = "set of supports" if found.support_key == "spc" else "step"
        raise UserError(f"the deck has no {what} '{text.strip()}'", remedy=f"it has {', '.join(known)}")
    return int(text)


def positive(option: str, text: str) -> float:
    """A number above zero. Raises UserError for anything else."""
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not 0 < number < math.inf:
        raise UserError(
            f"'{text}' is not a number above zero", where=option, remedy="give one without its unit, as in 250"
        )
    return number


def _listed(places: Sequence[Place]) -> Sequence[Place]:
    """The places with their numbers, for people."""
    for number, own in enumerate(places[:SHOWN], start=1):
        name = f"near {own.name}" if own.kind == "face" else f"{own.kind} {own.name}"
        say(f"{number:4}  {name:<38} {own.what}{', held' if own.held else ''}")
    if len(places) > SHOWN:
        say(f"      {len(places) - SHOWN} more")
    return places


def _chosen(
    places: Sequence[Place], found: Suggestion, read: Callable[[str, str, Suggestion], Place]
) -> Callable[[str], Place]:
    def numbered(text: str) -> Place:
        if not (text.strip().isdecimal() and 1 <= int(text) <= len(places)):
            return read("place", text, found)
        own = places[int(text) - 1]
        return own if own.kind == "face" else read("place", f"{own.kind} {own.name}", found)

    return numbered


def _ask(question: str, read: Callable[[str], Value]) -> Value | None:
    """The answer, asked again until it can be read; None where the line is left blank."""
    while True:
        text = _answer(lambda: typer.prompt(question, default="", show_default=False))
        if not text.strip():
            return None
        try:
            return read(text)
        except UserError as error:
            say(*str(error).split("\n"))


def _answer(ask: Callable[[], Value]) -> Value:
    try:
        return ask()
    except typer.Abort:
        say("")
        remedy = "answer in a terminal, or give options (strainsight init --help)"
        raise UserError("the answers have ended before the questions; nothing is written", remedy=remedy) from None
