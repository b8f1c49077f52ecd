"""One line before a run: how long the stages that take longest will, and how much memory."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import TYPE_CHECKING

from strainsight_cli.clock import spelt

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
    peak = max(own.memory for own in each.values())
    stages = [f"{name} {in_words(own.seconds)}" for name, own in each.items()]
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
    known = {name: own for name, own in each.items() if own is not None}
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

    there = available_memory() / GIB
    return (
        ""
        if math.isinf(there) or peak <= there
        else f"; {there:.2g} GiB are there: take a coarser mesh or a larger machine"
    )


def _deck(work: Work) -> int:
    path = work.job.base / str(work.job.config["mesh"]["file"])
    return path.stat().st_size if path.is_file() else 0
