"""Which stages are up to date, why the others are not, and their expected time and memory: a table, or JSON."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from strainsight.errors import printable
from strainsight.text import listed
from strainsight_cli import render
from strainsight_cli.clock import seconds_for, spelt
from strainsight_cli.printing import say
from strainsight_cli.work import Work, look_at_folder, note, show_warnings

if TYPE_CHECKING:
    from strainsight.experiment.structure.cost import Cost, Size
    from strainsight.runner.artefact import Artefact
    from strainsight.runner.plan import Status

HEAD = ("stage", "status", "run time", "result, or reason to run")
LEAST = (9, 11, 8, 0)
"""Minimum column widths, for aligned tables of the runs of a suite."""
COLOURS = {"up to date": "green", "will run": "yellow"}


def show_plan(work: Work, forced: Collection[str], as_json: bool, verbose: bool = False) -> None:
    """Stages that would run, with reasons; verbose: every reason instead of the first three."""
    from strainsight.runner.plan import plan

    look_at_folder(work, note)
    statuses = plan(work.stages, work.job, forced)
    show_warnings(work, statuses)
    if as_json:
        say(*(render.stage_json(status, work.run) for status in statuses))
        return
    print_statuses(statuses, verbose)
    say("", sum_of(statuses))
    pending = [status.stage for status in statuses if status.result is None]
    for status in statuses:
        if pending and status.stage == "import" and (line := forecast(work, pending, status.result)):
            say(line)


def print_statuses(statuses: Sequence[Status], verbose: bool = False, indent: int = 0, head: bool = True) -> None:
    """One row per stage: status, run time of the last computation, and the reasons or the message."""
    from rich.text import Text

    rows = []
    for status in statuses:
        result, why = status.result, ", ".join(status.reasons) if verbose else status.reason
        took = seconds_for(status.artefact) if result is None else result.header.seconds
        time = "" if took is None else f"{took:.1f} s"
        cells = (status.stage, status.status, time, why or (result.message if result else ""))
        rows.append([Text(printable(cell), style=COLOURS.get(cell, "")) for cell in cells])
    render.print_grid(HEAD if head else ("",) * len(HEAD), rows, LEAST, (2,), indent)


def sum_of(statuses: Sequence[Status]) -> str:
    """`5 of 9 stages up to date; last run time of the 4 stages to run: 12.3 s`"""
    from strainsight.runner.plan import UP_TO_DATE

    pending = [status for status in statuses if status.status != UP_TO_DATE]
    text = f"{len(statuses) - len(pending)} of {len(statuses)} stages up to date"
    seconds = [seconds_for(status.artefact) for status in pending]
    known = [value for value in seconds if value is not None]
    if not known:
        return text
    others = f"the {len(pending)} stages to run" if len(pending) > 1 else "the stage to run"
    which = others if len(known) == len(pending) else f"{len(known)} of {others}"
    return f"{text}; last run time of {which}: {sum(known):.1f} s"


GIB = 2.0**30
FACTOR = "the forecast of processor time and memory is accurate to a factor of two ({}docs/scaling.md)"
OF_THREE = ("place", "validate")
"""Stages with a forecast of time that is accurate to a factor of three."""


def forecast(work: Work, pending: Collection[str], imported: Artefact | None) -> str:
    """The forecast line; empty if no stage with a forecast is pending.

    pending: stages that will run; imported: import.h5, or None if it is not up to date, so that only the size of the deck is
    known."""
    from strainsight.memory import available_memory

    costs = costs_of(work, pending, imported)
    if costs is None:
        deck = work.job.base / str(work.job.config["mesh"]["file"])
        size = deck.stat().st_size / 1e6 if deck.is_file() else 0
        return f"forecast: the deck has {size:.1f} MB; time and memory are known after the import" if size else ""
    if not costs:
        return ""
    model, each = costs
    peak, available = max(cost.memory for cost in each.values()), available_memory() / GIB
    stages = listed([f"{name} {in_words(cost.seconds)}" for name, cost in each.items()])
    rough = [name for name in OF_THREE if name in each]
    factor = FACTOR.format(f"{listed(rough)}: three; " if rough else "")
    short = (
        "" if peak <= available else f"; only {available:.2g} GiB are available: use a coarser mesh or a larger machine"
    )
    note = single_run_note(work.job.model) if "validate" in each else ""
    return f"forecast: {stages} for {model.unknowns} degrees of freedom, {peak:.2g} GiB; {factor}{short}{note}"


def single_run_note(config: object) -> str:
    """Note that validation makes a single run, for a config without a known load; else empty."""
    from strainsight.config.placement import PlacementConfig

    if not isinstance(config, PlacementConfig) or not config.lacks_known_load:
        return ""
    return "; no load is known, so σ of parameters is invalid, and by default validate makes a single run"


def costs_of(
    work: Work, pending: Collection[str], imported: Artefact | None
) -> tuple[Size, dict[str, Cost]] | tuple[()] | None:
    """Model size and cost of every pending stage with a cost model; empty if none will run; None if the size is unknown."""
    from strainsight.config.placement import PlacementConfig
    from strainsight.experiment.structure.cost import FORECAST, SOLVES, cost_of, size_of
    from strainsight.records.mesh import mesh_from

    config = work.job.model
    if not isinstance(config, PlacementConfig) or config.mesh.matrices is not None:
        return ()
    lawful = [name for name in FORECAST if config.solver == "direct" or name not in SOLVES]
    names = [stage.name for stage in work.stages if stage.name in lawful and stage.name in pending]
    if not names:
        return ()
    if imported is None:
        return None
    mesh = mesh_from(imported)
    elements = {block.kind: len(block.ids) for block in mesh.blocks}
    # a node of shells or beams counts twice, as it has rotations
    size = size_of(mesh.own_nodes + len(mesh.turning), elements, len(mesh.regions))
    known = {name: cost for name in names if (cost := cost_of(name, config, size)) is not None}
    return (size, known) if known else ()


def in_words(seconds: float) -> str:
    """`12 s`, `3:20 min`"""
    return f"{max(seconds, 1.0):.0f} s" if seconds < 100 else f"{spelt(seconds)} {'h' if seconds >= 3600 else 'min'}"
