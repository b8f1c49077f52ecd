"""From a config file to the work that it asks for."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from strainsight_cli import pipelines
from strainsight_cli.work import Work

if TYPE_CHECKING:
    from strainsight.config.load import LoadedConfig
    from strainsight.config.overrides import Override


def loaded_config(path: Path, overrides: Iterable[str | Override] | None) -> LoadedConfig:
    """Check the config before anything else is loaded."""
    from strainsight.config.load import load_config

    return load_config(path, overrides or ())


def work_of(config: LoadedConfig, results: Path) -> Work:
    """All stages of a config that is no suite."""
    from strainsight.workflow.plan import Job

    data: dict[str, Any] = config.data
    return Work(pipelines.stages_of(data), Job(data, config.path.parent, results, config.locate, config.model))


def work_of_one(path: Path, results: Path, overrides: Iterable[str | Override] | None, stage: str) -> Work:
    """The work of a config that has the stage; a suite has none."""
    from strainsight_cli import suites

    suites.refuse(path, stage)
    loaded = loaded_config(path, overrides)
    work = work_of(loaded, results)
    names = [own.name for own in work.stages]
    kind = loaded.data["kind"]
    if stage not in names and (kind, stage) != ("placement", "estimate"):  # which says itself what is missing
        from strainsight.errors import UserError

        section = (
            f"give it a section `{stage}`; " if kind == "bench" and stage in ("place", "estimate", "field") else ""
        )
        raise UserError(
            f"this config of kind {kind} has no stage '{stage}'",
            where=str(path),
            remedy=f"{section}its stages are {', '.join(names)}",
        )
    return work
