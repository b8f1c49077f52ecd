"""Which stages are up to date, why the others are not, and what time and memory these will take: a table, or JSON."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from strainsight.errors import printable
from strainsight_cli import render
from strainsight_cli.clock import seconds_for, spelt
from strainsight_cli.printing import say
from strainsight_cli.work import Work, elsewhere, note, refuse_taken, show_warnings

if TYPE_CHECKING:
    from strainsight.runner.plan import Status

HEAD = ("stage", "status", "took", "what came out, or why it runs")
LEAST = (9, 11, 8, 0)
"""Least widths of the columns, so that those of a suite's runs stand below each other."""
COLOURS = {"up to date": "green", "will run": "yellow"}


def show_plan(work: Work, forced: Collection[str], as_json: bool, verbose: bool = False) -> None:
    """What would run and why; verbose: every reason, not only the first three."""
    from strainsight.runner.artefact import Artefact
    from strainsight.runner.plan import WILL_RUN, plan

    refuse_taken(work)
    if text := elsewhere(work):
        note(text)
    statuses = plan(work.stages, work.job, forced)
    show_warnings(work, statuses)
    if as_json:
        for status in statuses:
            say(render.status_json(status, work.run))
    else:
        print_statuses(statuses, verbose)
        say("", f"{sum_of(statuses)}")
        pending = [status.stage for status in statuses if status.status == WILL_RUN]
        imported = next((status.artefact for status in statuses if status.stage == "import"), None)
        if imported is not None and (
            line := forecast(work, pending, None if "import" in pending else Artefact(imported))
        ):
            say(line)


def print_statuses(statuses: Sequence[Status], verbose: bool = False, indent: int = 0, head: bool = True) -> None:
    """A row a stage: its status, how long it took when it was last computed, and the reasons or its message."""
    from rich.text import Text

    rows = []
    for status in statuses:
        cells = (status.stage, status.status, _took(status), _why(status, verbose))
        rows.append([Text(printable(cell), style=COLOURS.get(cell, "")) for cell in cells])
    render.print_grid(HEAD if head else ("",) * len(HEAD), rows, LEAST, (2,), indent)


def sum_of(statuses: Sequence[Status]) -> str:
    """`5 of 9 stages up to date; the other 4 took 12.3 s when last run`"""
    from strainsight.runner.plan import UP_TO_DATE

    pending = [status for status in statuses if status.status != UP_TO_DATE]
    text = f"{len(statuses) - len(pending)} of {len(statuses)} stages up to date"
    seconds = [seconds_for(status.artefact) for status in pending]
    known = [value for value in seconds if value is not None]
    if not known:
        return text
    others = f"the other {len(pending)}" if len(pending) > 1 else "the other"
    which = others if len(known) == len(pending) else f"{len(known)} of {others}"
    return f"{text}; {which} took {sum(known):.1f} s when last run"


def _took(status: Status) -> str:
    seconds = seconds_for(status.artefact)
    return "" if seconds is None else f"{seconds:.1f} s"


def _why(status: Status, verbose: bool) -> str:
    from strainsight.runner.artefact import Artefact

    if status.reasons:
        return ", ".join(status.reasons) if verbose else status.reason
    return Artefact(status.artefact).message


if TYPE_CHECKING:
    from strainsight.experiment.structure.cost import Cost, Size
    from strainsight.runner.artefact import Artefact
    from strainsight_cli.work import Work

GIB = 2.0**30
FACTOR = "processor time and memory within a factor of two (docs/scaling.md)"
WITH_PLACE = "processor time and memory within a factor of two, of place of three (docs/scaling.md)"


def forecast(work: Work, pending: Collection[str], imported: Artefact | None) -> str:
    """The line; nothing where no stage of that kind is pending, or the model is none of finite elements.

    pending: stages that will run; imported: import.h5, None where it is not up to date: then only the deck's size is known.
    """
    costs = costs_of(work, pending, imported)
    if costs is None:
        deck = _deck(work)
        return (
            f"forecast: the deck has {deck / 1e6:.1f} MB; time and memory are known once it is imported" if deck else ""
        )
    if not costs:
        return ""
    size, each = costs
    peak = max(cost.memory for cost in each.values())
    stages = [f"{name} {in_words(cost.seconds)}" for name, cost in each.items()]
    listed = " and ".join(filter(None, (", ".join(stages[:-1]), stages[-1])))
    factor = WITH_PLACE if "place" in each else FACTOR
    return f"forecast: {listed} for {size.unknowns} unknowns, {peak:.2g} GiB, {factor}{_short_of(peak)}"


def costs_of(
    work: Work, pending: Collection[str], imported: Artefact | None
) -> tuple[Size, dict[str, Cost]] | tuple[()] | None:
    """The size, and the cost of every stage that has a law; empty where none will run; None where the size is not known."""
    from strainsight.config.placement import PlacementConfig
    from strainsight.experiment.structure.cost import SOLVES, cost_of, cost_of_place

    config = work.job.model
    if not isinstance(config, PlacementConfig) or config.mesh.matrices is not None:
        return ()
    lawful = (*(SOLVES if config.solver == "direct" else ()), "place")
    names = [stage.name for stage in work.stages if stage.name in lawful and stage.name in pending]
    if not names:
        return ()
    if imported is None:
        return None
    size = size_in(imported)
    each = {name: cost_of(name, config, size) if name in SOLVES else cost_of_place(config, size) for name in names}
    known = {name: cost for name, cost in each.items() if cost is not None}
    return (size, known) if known else ()


def size_in(imported: Artefact) -> Size:
    """Of the mesh in import.h5; a node of shells or beams counts twice, as it has rotations."""
    from strainsight.experiment.structure.cost import size_of
    from strainsight.records.mesh import mesh_from

    mesh = mesh_from(imported)
    elements = {block.kind: len(block.ids) for block in mesh.blocks}
    return size_of(mesh.own_nodes + len(mesh.turning), elements, len(mesh.regions))


def in_words(seconds: float) -> str:
    """`12 s`, `3:20 min`"""
    return f"{max(seconds, 1.0):.0f} s" if seconds < 100 else f"{spelt(seconds)} {'h' if seconds >= 3600 else 'min'}"


def _short_of(peak: float) -> str:
    from strainsight.memory import available_memory

    available = available_memory() / GIB
    return (
        ""
        if math.isinf(available) or peak <= available
        else f"; {available:.2g} GiB are there: take a coarser mesh or a larger machine"
    )


def _deck(work: Work) -> int:
    path = work.job.base / str(work.job.config["mesh"]["file"])
    return path.stat().st_size if path.is_file() else 0
