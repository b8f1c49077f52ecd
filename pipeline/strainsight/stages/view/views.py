"""What there is to see of a run, which stages have to have run for it, and the view from their artefacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.placement import PlacementConfig
from strainsight.errors import ArtefactError, UserError
from strainsight.pages.view.viewed import View
from strainsight.runner.artefact import Artefact
from strainsight.stages.view.bench import bench_view, body_of
from strainsight.stages.view.placement import placement_view

WHAT = ("mesh", "modes", "strain", "candidates", "layout", "field")
FURTHEST = ("layout", "mesh")
"""What is shown where nothing is asked for: the first of these that is there."""


@dataclass(frozen=True)
class Offers:
    """stages: what → stages whose artefacts it is read from, in order; absent: what → why this config has none of it; gauges:
    stages that have to have run for gauges to be drawn on the strain of a placement."""

    stages: Mapping[str, tuple[str, ...]]
    absent: Mapping[str, str]
    gauges: tuple[str, ...] = ()


TEST, VALIDATION = "test", "validation"
"""What a field of a placement may be of."""
STAGE = {TEST: "estimate", VALIDATION: "validate"}


def offers_of(
    config: PlacementConfig | BenchConfig, names: Sequence[str], body: str = "", of: str = VALIDATION
) -> Offers:
    """What a placement or a bench with these stages could show; body: the flexible body of a bench; of: what the field of a
    placement is of."""
    if isinstance(config, BenchConfig):
        return _of_bench(config, names, body)
    placed = ("import", "rom", "train", "screen", "place")
    return Offers(
        {
            "mesh": ("import",),
            "modes": ("import", "rom"),
            "strain": ("import", "rom", "train"),
            "candidates": ("import", "train"),
            "layout": placed,
            "field": (*placed, STAGE[of]),
        },
        {},
        placed,
    )


def _of_bench(config: BenchConfig, names: Sequence[str], body: str) -> Offers:
    strains = [s for s in config.sensors.values() if s.type == "strain" and s.body == body]
    placed_here = "place" in names and config.place is not None and config.place.body == body
    placed = ("place",) * (placed_here or any(sensor.layout for sensor in strains))
    stages: dict[str, tuple[str, ...]] = {"mesh": ("import",), "modes": ("import", "reduce")}
    absent = {}
    if placed_here:
        stages["candidates"] = ("import", "place")
    else:
        absent["candidates"] = f"nothing is placed on '{body}': give the config a section `place`"
    if strains or placed:
        stages["layout"] = ("import", *placed)
    else:
        absent["layout"] = f"there is no gauge on '{body}': give the config a strain sensor, or a section `place`"
    if "field" in names and config.field is not None and config.field.body == body:
        stages["field"] = stages["strain"] = ("import", *placed, "field")
    else:
        absent["field"] = f"no field of '{body}' is written: give the config a section `field`"
        absent["strain"] = absent["field"]
    return Offers(stages, absent)


def chosen(offers: Offers, folder: Path, asked: str | None, config_file: str) -> str:
    """What to show: what is asked for, else the layout, else the mesh.

    Raises UserError for what this config does not have, and for what has not been computed yet with the command to run.
    """
    if asked is not None:
        if asked not in offers.stages:
            can = ", ".join(what for what in WHAT if what in offers.stages)
            raise UserError(
                f"this run has nothing to show of '{asked}'",
                where=config_file,
                remedy=f"{offers.absent[asked]}; it has {can}",
            )
        if missing := _missing(offers, folder, asked):
            raise UserError(
                f"nothing to show of '{asked}' yet: {folder / missing[0]}.h5 has not been written",
                where=config_file,
                remedy=f"run first: strainsight {missing[-1]} {config_file}",
            )
        return asked
    there = [what for what in FURTHEST if what in offers.stages and not _missing(offers, folder, what)]
    if not there:
        raise UserError(
            f"there is nothing to show yet in {folder}",
            where=config_file,
            remedy=f"run first: strainsight import {config_file} (the mesh), or strainsight run {config_file}",
        )
    return there[0]


def opened(stages: Sequence[str], folder: Path) -> dict[str, Artefact]:
    """The artefacts of these stages, verified. Raises ArtefactError for one that is damaged."""
    found = {}
    for stage in stages:
        found[stage] = Artefact(folder / f"{stage}.h5")
        if found[stage].header.stage != stage:
            raise ArtefactError(
                f"this is the artefact of stage '{found[stage].header.stage}', not of '{stage}'",
                where=str(found[stage].path),
                remedy=f"run it again: strainsight {stage} CONFIG --force",
            )
    return found


def _missing(offers: Offers, folder: Path, what: str) -> list[str]:
    return [stage for stage in offers.stages[what] if not (folder / f"{stage}.h5").is_file()]


def view_of(
    config: PlacementConfig | BenchConfig,
    stages: Sequence[str],
    folder: Path,
    config_file: str,
    what: str | None = None,
    at: float | None = None,
    body: str | None = None,
    of: str | None = None,
    record: str | None = None,
) -> tuple[View, tuple[str, ...]]:
    """The view, and the stages that it was read from.

    config, stages: of a placement or a bench; folder: of its results; what: one of `WHAT`, None: the layout where there is one,
    else the mesh, and a field where `at`, `of` or `record` is given; at [s]: instant of a field in time; body: of a bench; of:
    "test" or "validation", whose field, None: the test's where there is one; record: of a test of several, None: the first.
    Raises UserError for what the run does not have or has not computed yet.
    """
    if body is not None and not isinstance(config, BenchConfig):
        raise UserError(f"--body {body}: a placement has one body", where=config_file, remedy="leave it out")
    if of is not None and (isinstance(config, BenchConfig) or what not in (None, "field")):
        remedy = "leave it out: a bench has one field" if isinstance(config, BenchConfig) else "ask for --what field"
        raise UserError(f"--of {of}: this view has one source only", where=config_file, remedy=remedy)
    shown = body_of(config, body) if isinstance(config, BenchConfig) else ""
    there = TEST if (folder / f"{STAGE[TEST]}.h5").is_file() else VALIDATION
    offers = offers_of(config, stages, shown, of or there)
    # Whoever names an instant, a record or a source means the field.
    named = any(given is not None for given in (at, of, record))
    picked = chosen(offers, folder, "field" if what is None and named else what, config_file)
    read = offers.stages[picked]
    if picked == "strain" and offers.gauges and all((folder / f"{stage}.h5").is_file() for stage in offers.gauges):
        read = offers.gauges
    up = opened(read, folder)
    if at is not None and not (picked in ("field", "strain") and "/VTKHDF/Steps" in up[read[-1]]):
        remedy = (
            "leave it out, or ask for --what field" if picked != "field" else "leave it out: it is of one instant only"
        )
        remedy += "; the surface in time is written with `estimate.field`" * (read[-1] == STAGE[TEST])
        raise UserError(f"--at {at:g}: this view of {picked} has no time", where=config_file, remedy=remedy)
    if record is not None and (isinstance(config, BenchConfig) or picked != "field" or read[-1] != STAGE[TEST]):
        raise UserError(
            f"--record {record}: this view of {picked} is of no record",
            where=config_file,
            remedy="ask for --what field",
        )
    if isinstance(config, BenchConfig):
        return bench_view(config, picked, shown, up, at), read
    return placement_view(config, picked, up, at, record), read
