"""Stages of a config, imported only when a command needs them, and their work."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from strainsight.errors import ArtefactError, UserError
from strainsight_cli.work import Work, note

if TYPE_CHECKING:
    from strainsight.config.keys import Override
    from strainsight.config.load import LoadedConfig
    from strainsight.runner.stage import Stage

STAGES = {
    "bearing": "Compute load-displacement curves, stiffness and ball loads of a single bearing",
    "import": "Read the deck, with its materials and constraints",
    "reduce": "Compute reduced-order models of the flexible bodies of a bench",
    "statics": "Compute the static equilibrium of a bench under its loads",
    "modes": "Compute natural frequencies and mode shapes (for a bench, also the state-space model)",
    "rom": "Compute the reduced-order model",
    "train": "Simulate the structure under the configured loads, with the reading of every candidate gauge",
    "screen": "Remove candidate gauges with weak or out-of-range readings, or too close to others or to edges",
    "observe": "Compute which loads and parameters are observable together",
    "place": "Place the gauges",
    "simulate": "Simulate a bench over time",
    "truth": "Simulate a bench with the Radau method, as reference for its estimate",
    "estimate": "Estimate loads and parameters from the measurements of a test or of a bench",
    "test": "Write test.html, the results page of a test",
    "field": "Write strain and stress of a body of a bench over time",
    "spectrum": "Compute the modes for the simulated test of the validation",
    "validate": "Validate the filter with simulated measurements",
    "report": "Write report.html, the results page",
}


def stages_of(config: Mapping[str, Any]) -> tuple[Stage, ...]:
    """Pipeline of a config, in order."""
    if config["kind"] == "placement":
        from strainsight.stages.placement import stages_for

        estimate, validation = config.get("estimate") or {}, config["validate"]
        truth = validation["truth"]["model"] if validation else None
        return stages_for(bool(estimate.get("file") or estimate.get("records")), truth)
    from strainsight.stages.bench.pipeline import BEARING, bench_stages

    return (BEARING,) if config["kind"] == "bearing" else bench_stages(config)


PAGES = ("test", "report")
"""Stages that write a page."""
LAST_TEST = ("file", "allow_unobservable")
"""Keys of `estimate` that the options of the command `estimate` set; other commands read them from its results."""


def with_last_test(
    path: Path, overrides: Iterable[str | Override] | None, results: Path, stage: str | None = None
) -> LoadedConfig:
    """The config, completed with the last estimated measurement file if its section `estimate` names none.

    The file name is read from estimate.h5; if the file is missing, a note is printed and the estimate is omitted."""
    loaded = loaded_config(path, overrides, stage)
    section = loaded.data.get("estimate") if loaded.data["kind"] == "placement" else None
    artefact = results / str(loaded.data["name"]) / "estimate.h5"
    if not section or section.get("file") or section.get("records") or not artefact.is_file():
        return loaded
    from strainsight.config.keys import Override
    from strainsight.runner.artefact import header_of

    try:
        last = header_of(artefact).config.get("estimate") or {}
    except ArtefactError as error:
        note(f"the estimate from the test in {artefact} is not shown: {error.what}")
        return loaded
    if last.get("records"):
        note(
            f"the estimate from the test in {artefact} is not shown: the test has several records, "
            "but the config has no `estimate.records`"
        )
        return loaded
    if not (loaded.path.parent / str(last.get("file") or "")).is_file():
        note(f"the estimate from the test in {artefact} is not shown: measurement file {last.get('file')} is missing")
        return loaded
    last_test = [Override(f"estimate.{key}", last[key], str(artefact)) for key in LAST_TEST if last.get(key)]
    return loaded_config(path, [*(overrides or ()), *last_test])


def loaded_config(path: Path, overrides: Iterable[str | Override] | None, stage: str | None = None) -> LoadedConfig:
    """Check the config, up to the sections that a stage needs, before anything else is loaded."""
    from strainsight.config.load import load_config

    return load_config(path, overrides or (), stage)


def work_of(config: LoadedConfig, results: Path) -> Work:
    """All stages of a config that is not a suite."""
    from strainsight.runner.plan import Job

    data: dict[str, Any] = config.data
    return Work(stages_of(data), Job(data, config.path.parent, results, config.locate, config.model))


def work_of_one(path: Path, results: Path, overrides: Iterable[str | Override] | None, stage: str) -> Work:
    """The work of a config with this stage. Raises UserError for a config without it, and for suites."""
    from strainsight.config.load import kind_of

    if kind_of(path) == "suite":
        other = f"use strainsight {stage} with the config of one of its runs, or: strainsight run {path}"
        raise UserError(f"a suite has no stage '{stage}'", where=str(path), remedy=other)
    loaded = with_last_test(path, overrides, results) if stage in PAGES else loaded_config(path, overrides, stage)
    work = work_of(loaded, results)
    if loaded.data["kind"] == "bench":
        from strainsight.stages.bench.pipeline import demanded

        work = replace(work, stages=demanded(stage, loaded.data) or work.stages)
    names = [each.name for each in work.stages]
    kind = loaded.data["kind"]
    if stage not in names and (kind, stage) != ("placement", "estimate"):  # which says itself what is missing
        section = (
            f"add a section `{stage}` to the config; "
            if kind == "bench" and stage in ("place", "estimate", "field")
            else ""
        )
        raise UserError(
            f"this config of kind {kind} has no stage '{stage}'",
            where=str(path),
            remedy=f"{section}use one of the stages {', '.join(names)}",
        )
    return work
