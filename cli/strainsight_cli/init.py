"""`strainsight init`: a commented config for a deck, from options and, with --interactive, from answers in the terminal."""

from __future__ import annotations

import json
import math
import os
import re
import shlex
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import typer

from strainsight.config.deck_properties import MATERIALS, Answers, CandidateLocation, Suggestion
from strainsight.errors import ConfigError, UserError, did_you_mean
from strainsight_cli.failures import reported
from strainsight_cli.options import Verbose
from strainsight_cli.printing import say

Value = TypeVar("Value")
SHOWN = 30
"""Largest number of locations that a question lists."""


def init(
    deck: Annotated[Path, typer.Argument(metavar="DECK", help="Finite-element deck.")],
    output: Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Config file to write.")] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite an existing file.")] = False,
    interactive: Annotated[
        bool, typer.Option("-i", "--interactive", help="Ask for missing data in the terminal.")
    ] = False,
    find: Annotated[
        Literal["modulus", "load"] | None,
        typer.Option(
            "--estimate", help="Unknown to estimate: Young's modulus from a measured load (default), or the load."
        ),
    ] = None,
    material: Annotated[
        str | None,
        typer.Option(
            "--material",
            help="Material, if the deck has none: steel, aluminium, titanium, or 'E, ν, ρ' [Pa, -, kg/m³].",
        ),
    ] = None,
    support: Annotated[
        str | None,
        typer.Option(
            "--support",
            help="Location of the support, if the deck has none: 'set NAME', 'node ID', or a point 'x, y, z' [m] on a face.",
        ),
    ] = None,
    load: Annotated[
        str | None,
        typer.Option(
            "--load", help="Location of the load: as for --support, or 'deck_load NAME' for a load of the deck."
        ),
    ] = None,
    direction: Annotated[
        str | None, typer.Option("--direction", help="Direction of the load in the global axes of the deck, 'x, y, z'.")
    ] = None,
    amplitude: Annotated[str | None, typer.Option("--amplitude", help="Amplitude of the load [N].")] = None,
    frequency: Annotated[str | None, typer.Option("--frequency", help="Frequency of the load [Hz].")] = None,
    axis: Annotated[
        str | None,
        typer.Option(
            "--axis",
            help="Measuring direction of the gauges in the global axes of the deck, 'x, y, z'; default: direction of the "
            "principal strain.",
        ),
    ] = None,
    keep: Annotated[int, typer.Option("--keep", min=1, help="Number of gauges to bond.")] = 4,
    verbose: Verbose = False,
) -> None:
    with reported(verbose):
        from strainsight.config.template import template

        if not deck.is_file():
            raise UserError("deck not found", where=str(deck), remedy="specify the path of a finite-element deck")
        if deck.suffix.lower() in (".yaml", ".yml"):
            raise UserError(
                "the file is a config, not a deck",
                where=str(deck),
                remedy=f"to compute this config, use: strainsight run {shlex.quote(str(deck))}; for a new config, specify the "
                "deck",
            )
        target = output or Path(f"{Path(deck.name.removesuffix('.gz')).stem}.yaml")
        if os.path.lexists(target) and not force:
            raise UserError(
                "the file already exists", where=str(target), remedy="specify another file with -o FILE, or use --force"
            )
        from strainsight.config.load import load_config
        from strainsight.stages.suggestion import suggestion
        from strainsight.writing import write_file

        relative = Path(os.path.relpath(deck.resolve(), target.resolve().parent)).as_posix()
        hints = suggestion(deck)
        answers = Answers(
            material=read_material("--material", material) if material else None,
            support=read_support("--support", support, hints) if support else None,
            load=read_place("--load", load, hints) if load else None,
            direction=read_direction("--direction", direction) if direction else None,
            amplitude=read_positive("--amplitude", amplitude) if amplitude else None,
            frequency=read_positive("--frequency", frequency) if frequency else None,
            find=find or "modulus",
            axis=read_direction("--axis", axis) if axis else None,
            keep=keep,
        )
        refuse_stated(hints, answers)
        if interactive:
            answers = ask_answers(hints, answers, find=find is not None)
            if answers.spc is not None:
                hints = suggestion(deck, answers.spc)
        target.parent.mkdir(parents=True, exist_ok=True)
        write_file(target, template(relative, hints, answers).encode())
        first = "check the lines marked ←"
        try:
            load_config(target)
        except ConfigError:
            first = "fill in the blank lines and check the other lines marked ←"
        if not hints.solids:
            nothing = "the deck has no solids, no shells and no beams with a cross-section to bond gauges on"
            first = f"{nothing}; set `mesh.matrices` and `gauges.strain_operator`. Then {first}"
        say(f"wrote {target}: {first}, then: strainsight run {shlex.quote(str(target))}")


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


def refuse_stated(hints: Suggestion, answers: Answers) -> None:
    """Raise UserError for an answer that the deck already contains."""
    if answers.material is not None and not hints.lacking:
        remedy = "remove --material; to replace the materials of the deck, set `mesh.materials` in the config"
        raise UserError("the deck already has materials", where="--material", remedy=remedy)
    if answers.support is not None and hints.supports:
        remedy = "remove --support; to add supports to those of the deck, set `mesh.supports` in the config"
        raise UserError("the deck already has supports", where="--support", remedy=remedy)


def read_place(option: str, text: str, hints: Suggestion) -> CandidateLocation:
    """ "node 2", "set NAME", "deck_load NAME" or a point of a face, "x, y, z" [m]. Raises UserError for other text."""
    kind, _, name = text.strip().partition(" ")
    if kind in ("node", "set", "deck_load"):
        name = name.strip()
        known = [place for place in hints.places if place.kind == kind]
        same = [place for place in known if place.name == name]
        if not same and kind != "node":
            names = [place.name for place in known]
            remedy = did_you_mean(name, names, f"known names: {', '.join(names) or 'none'}")
            raise UserError(
                f"the deck has no {'load' if kind == 'deck_load' else 'node set'} '{name}'", where=option, remedy=remedy
            )
        if kind == "node" and not name.isdecimal():
            raise UserError(f"'{name}' is not a node id", where=option, remedy="use a number, as in 'node 2'")
        return same[0] if same else CandidateLocation("node", name, "a node")
    try:
        return CandidateLocation("face", read_vector(option, text), "a face")
    except UserError:
        remedy = "use 'node ID', 'set NAME', 'deck_load NAME', or a point 'x, y, z' [m] on a face"
        raise UserError(f"'{text}' is not a location", where=option, remedy=remedy) from None


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
    ask("load", "location of the load (number in the list, node ID, or x, y, z in m)", _numbered(hints, read_place))
    free = answers.load is None or answers.load.kind != "deck_load"
    ask(
        "direction",
        "direction of the load in the global axes of the deck (x, y, z)",
        partial(read_direction, "direction"),
        free,
    )
    ask("amplitude", "amplitude of the load [N]", partial(read_positive, "amplitude"), free)
    ask("frequency", "frequency of the load [Hz]", partial(read_positive, "frequency"))
    sought = "estimate the load (no: estimate Young's modulus from a measured load)"
    return answers if find or not typer.confirm(sought) else replace(answers, find="load")


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
