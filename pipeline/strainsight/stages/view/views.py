"""A view of a run from its artefacts alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.placement import PlacementConfig
from strainsight.errors import UserError
from strainsight.report.view.viewed import View
from strainsight.stages.view.bench import bench_view, body_of
from strainsight.stages.view.offers import chosen, offers_of, opened
from strainsight.stages.view.placement import placement_view


def view_of(
    config: PlacementConfig | BenchConfig,
    stages: Sequence[str],
    folder: Path,
    config_file: str,
    what: str | None = None,
    at: float | None = None,
    body: str | None = None,
) -> tuple[View, tuple[str, ...]]:
    """The view, and the stages that it was read from.

    config, stages: of a placement or a bench; folder: of its results; what: "mesh", "modes", "candidates", "layout", "field",
    None: the furthest of field, layout and mesh that is there; at [s]: instant of a field in time; body: of a bench.
    Raises UserError for what the run does not have or has not computed yet.
    """
    if body is not None and not isinstance(config, BenchConfig):
        raise UserError(f"--body {body}: a placement has one body", where=config_file, remedy="leave it out")
    shown = body_of(config, body) if isinstance(config, BenchConfig) else ""
    offers = offers_of(config, stages, shown)
    picked = chosen(offers, folder, what, config_file)
    read = offers.stages[picked]
    if at is not None and not (picked == "field" and read[-1] in ("field", "estimate")):
        remedy = (
            "leave it out, or ask for --what field" if picked != "field" else "leave it out: it is of one instant only"
        )
        raise UserError(f"--at {at:g}: this view of {picked} has no time", where=config_file, remedy=remedy)
    up = opened(offers, folder, picked)
    if isinstance(config, BenchConfig):
        return bench_view(config, picked, shown, up, at), read
    return placement_view(config, picked, up, at), read
