"""`strainsight init`: a commented config for a deck."""

from __future__ import annotations

import os
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import typer

from strainsight.config.deck_properties import Answers, LoadAnswer, Suggestion
from strainsight.errors import ConfigError, StrainsightError, UserError
from strainsight.writing import write_file
from strainsight_cli.failures import reported
from strainsight_cli.init_answers import ask_answers, read_direction, read_loads, read_material, read_support
from strainsight_cli.options import Verbose
from strainsight_cli.printing import say
from strainsight_cli.render import print_tables


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
            "--estimate", help="Unknown to estimate: Young's modulus from measured loads (default), or the loads."
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
        list[str] | None,
        typer.Option(
            "--load",
            help="Load: name of a load of the deck, or a location as for --support. Repeat it for several loads; then the "
            "next three options apply to all loads, or are repeated in the same order.",
        ),
    ] = None,
    direction: Annotated[
        list[str] | None,
        typer.Option(
            "--direction",
            help="Direction of a load that is not one of the deck, in the global axes of the deck, 'x, y, z'.",
        ),
    ] = None,
    amplitude: Annotated[
        list[str] | None, typer.Option("--amplitude", help="Amplitude of the load [N]; default: its size in the deck.")
    ] = None,
    frequency: Annotated[
        list[str] | None,
        typer.Option(
            "--frequency",
            help="Frequency of the load [Hz], or lowest and highest frequency '0.5, 20'; default: a slow load, 1 Hz or less.",
        ),
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option(
            "--axis",
            help="Measuring direction of the gauges in the global axes of the deck, 'x, y, z'; default: direction of the "
            "principal strain.",
        ),
    ] = None,
    keep: Annotated[
        int | None,
        typer.Option("--keep", min=1, help="Number of gauges to bond; default: 4, or one more than the unknowns."),
    ] = None,
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
        from strainsight.stages.suggestion import suggestion

        relative = Path(os.path.relpath(deck.resolve(), target.resolve().parent)).as_posix()
        hints = suggestion(deck)
        answers = Answers(
            material=read_material("--material", material) if material else None,
            support=read_support("--support", support, hints) if support else None,
            loads=read_loads(hints, load or [], direction or [], amplitude or [], frequency or []),
            find=find or "modulus",
            axis=read_direction("--axis", axis) if axis else None,
            keep=keep,
        )
        refuse_stated(hints, answers)
        show_facts(hints)
        target.parent.mkdir(parents=True, exist_ok=True)
        complete = hints.supports and not (hints.lacking or hints.support_sets)
        first = first_frequency(hints, template(relative, hints, answers), target.parent) if complete else None
        if interactive:
            answers = ask_answers(hints, answers, find=find is not None)
            if answers.spc is not None:
                hints = suggestion(deck, answers.spc)
        answers = with_only_load(hints, answers)
        if not complete:
            first = first_frequency(hints, template(relative, hints, answers), target.parent)
        write_file(target, template(relative, hints, answers, first).encode())
        show_next(target, hints)


def show_facts(hints: Suggestion) -> None:
    """Print what the deck contains: size, materials, supports and loads."""
    from strainsight.runner.output import Table

    loads = [(load.name, f"{load.what}{', on supported nodes' * load.supported}") for load in hints.loads]
    rows = [*hints.facts, *(loads or [("loads", "none")] * bool(hints.facts))]
    if rows:
        print_tables([Table("", ("deck", ""), tuple(rows))])


def with_only_load(hints: Suggestion, answers: Answers) -> Answers:
    """The answers; without a load, that of the deck if it has only one."""
    free = [load for load in hints.loads if not (load.supported or load.body)]
    (only, *others) = answers.loads
    if others or only.place is not None or only.direction is not None or len(free) != 1:
        if len(free) > 1 and answers.loads == (LoadAnswer(),):
            say(f"the deck has {len(free)} loads; choose those that act with --load, as in --load {free[0].name}")
        return answers
    say(f"load: {free[0].name}, the only one of the deck")
    return replace(answers, loads=(replace(only, place=free[0]),))


FEW_NODES = 50_000
"""Largest number of nodes for which natural frequencies are computed, in about ten seconds."""


def first_frequency(hints: Suggestion, text: str, folder: Path) -> float | None:
    """First natural frequency [Hz] of the model of a config, with a line of output; None with the reason, if not computed."""
    from strainsight.stages.suggestion import first_frequencies

    try:
        if hints.nodes > FEW_NODES:
            raise UserError(f"the model has more than {FEW_NODES} nodes")
        frequencies = first_frequencies(text, folder)
    except StrainsightError as error:
        say(f"natural frequencies: not computed, {error.what}")
        return None
    say(f"natural frequencies: {', '.join(f'{frequency:.4g}' for frequency in frequencies)} Hz")
    return frequencies[0]


def show_next(target: Path, hints: Suggestion) -> None:
    """Print the lines of a written config that are still blank, and the next command."""
    from strainsight.config.load import load_config

    first = "check the lines marked ←"
    try:
        load_config(target)
    except ConfigError as error:
        first = "fill in the blank lines, and check the other lines marked ←"
        for problem in (error, *error.others):
            say(f"{problem.where}  {problem.key}: {problem.what}")
    if hints.no_surface:
        first = f"{hints.no_surface} Then {first}"
    say(f"wrote {target}: {first}, then: strainsight run {shlex.quote(str(target))}")


def refuse_stated(hints: Suggestion, answers: Answers) -> None:
    """Raise UserError for an answer that the deck already contains."""
    if answers.material is not None and not hints.lacking:
        remedy = "remove --material; to replace the materials of the deck, set `mesh.materials` in the config"
        raise UserError("the deck already has materials", where="--material", remedy=remedy)
    if answers.support is not None and hints.supports:
        remedy = "remove --support; to add supports to those of the deck, set `mesh.supports` in the config"
        raise UserError("the deck already has supports", where="--support", remedy=remedy)
