"""From a config file to its stages, which are imported only when a command needs them, and to the work that they are."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from strainsight_cli.work import Work, note

if TYPE_CHECKING:
    from strainsight.config.keys import Override
    from strainsight.config.load import LoadedConfig
    from strainsight.runner.stage import Stage

STAGES = {
    "bearing": "Look at a bearing alone: load-displacement curves, stiffness, loads of the balls",
    "import": "Read the deck, with its materials and constraints",
    "reduce": "Reduce the flexible bodies of a bench",
    "statics": "Find where a bench rests, and what it carries there",
    "modes": "Find natural frequencies and mode shapes, of a bench with its state space",
    "rom": "Reduce the model",
    "train": "Simulate the training run and the strain of every candidate",
    "screen": "Drop weak and clustered candidates",
    "observe": "Say which unknowns are observable together",
    "place": "Choose the gauges",
    "simulate": "Simulate a bench in time",
    "truth": "Move a bench by another integrator, as the truth of an estimate",
    "estimate": "Estimate from measurements: of a test, or of a bench",
    "test": "Write test.html, the page of a test",
    "field": "Write the strain and stress of a bench's body in time",
    "spectrum": "Find the modes of a validation's truth",
    "validate": "Estimate from simulated measurements",
    "report": "Write report.html",
}


def stages_of(config: Mapping[str, Any]) -> tuple[Stage, ...]:
    """The pipeline of a config, in order."""
    if config["kind"] == "placement":
        from strainsight.stages.placement import stages_for

        estimate = config.get("estimate") or {}
        return stages_for(bool(estimate.get("file") or estimate.get("records")), config["validate"]["truth"]["model"])
    from strainsight.stages.bench.pipeline import BEARING_ALONE, bench_stages

    return BEARING_ALONE if config["kind"] == "bearing" else bench_stages(config)


PAGES = ("test", "report")
"""Stages that write a page."""
LAST_TEST = ("file", "allow_unobservable")
"""Keys of `estimate` that options of the command `estimate` set: the other commands take them from what it wrote."""


def with_last_test(path: Path, overrides: Iterable[str | Override] | None, results: Path) -> LoadedConfig:
    """The config, with the file of the test that was estimated last where its own section `estimate` names none.

    That stands in estimate.h5; a file that is no longer there is reported and left out, with its estimate.
    """
    loaded = loaded_config(path, overrides)
    section = loaded.data.get("estimate") if loaded.data["kind"] == "placement" else None
    artefact = results / str(loaded.data["name"]) / "estimate.h5"
    if not section or section.get("file") or section.get("records") or not artefact.is_file():
        return loaded
    from strainsight.config.keys import Override
    from strainsight.errors import ArtefactError
    from strainsight.runner.artefact import header_of

    try:
        last = header_of(artefact).config.get("estimate") or {}
    except ArtefactError as error:
        note(f"{artefact} is left out: {error.what}")
        return loaded
    if last.get("records"):
        note(f"{artefact} is left out: it is of records, and the config names none")
        return loaded
    if not (loaded.path.parent / str(last.get("file") or "")).is_file():
        note(f"{artefact} is left out: {last.get('file')}, the file of the test, is not there any more")
        return loaded
    kept = [Override(f"estimate.{key}", last[key], str(artefact)) for key in LAST_TEST if last.get(key)]
    return loaded_config(path, [*(overrides or ()), *kept])


def loaded_config(path: Path, overrides: Iterable[str | Override] | None) -> LoadedConfig:
    """Check the config before anything else is loaded."""
    from strainsight.config.load import load_config

    return load_config(path, overrides or ())


def work_of(config: LoadedConfig, results: Path) -> Work:
    """All stages of a config that is no suite."""
    from strainsight.runner.plan import Job

    data: dict[str, Any] = config.data
    return Work(stages_of(data), Job(data, config.path.parent, results, config.locate, config.model))


def work_of_one(path: Path, results: Path, overrides: Iterable[str | Override] | None, stage: str) -> Work:
    """The work of a config that has the stage. Raises UserError for one that has not; a suite has none."""
    from strainsight.config.load import kind_of
    from strainsight.errors import UserError

    if kind_of(path) == "suite":
        other = f"strainsight {stage} on the config of one of its runs, or: strainsight run {path}"
        raise UserError(f"a suite has no stage '{stage}'", where=str(path), remedy=other)
    loaded = with_last_test(path, overrides, results) if stage in PAGES else loaded_config(path, overrides)
    work = work_of(loaded, results)
    if loaded.data["kind"] == "bench":
        from strainsight.stages.bench.pipeline import demanded

        work = replace(work, stages=demanded(stage, loaded.data) or work.stages)
    names = [each.name for each in work.stages]
    kind = loaded.data["kind"]
    if stage not in names and (kind, stage) != ("placement", "estimate"):  # which says itself what is missing
        section = (
            f"give it a section `{stage}`; " if kind == "bench" and stage in ("place", "estimate", "field") else ""
        )
        raise UserError(
            f"this config of kind {kind} has no stage '{stage}'",
            where=str(path),
            remedy=f"{section}its stages are {', '.join(names)}",
        )
    return work
