"""Update of the stages of one config, with a line of progress for each."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from strainsight.errors import ConfigError, StrainsightError, UserError
from strainsight.runner.sweep_location import Where, opened
from strainsight_cli import render
from strainsight_cli.clock import RemainingTime, after, ends_at, seconds_for
from strainsight_cli.failures import same_text, warn
from strainsight_cli.printing import Level, say, shown
from strainsight_cli.runlog import peak, run_log

if TYPE_CHECKING:
    from strainsight.runner.artefact import Artefact
    from strainsight.runner.plan import Job, Status
    from strainsight.runner.stage import Stage

Say = Callable[[str], None]
Progress = Callable[[str, str, str, float, RemainingTime], None]
"""(run, stage, activity, fraction done, time left); without stage: the run has ended."""


def note(text: str) -> None:
    """Print a note that is not a result."""
    if shown(Level.WARNING):
        say(f"note: {text}", error=True)


@dataclass(frozen=True)
class Work:
    """The stages of one config and their environment; run: its name in a suite; label: its label in the progress bar; where:
    location of its sweeps."""

    stages: tuple[Stage, ...]
    job: Job
    run: str = ""
    label: str = ""
    where: Where = field(default_factory=Where)

    def forced(self, force: bool) -> list[str]:
        """Names of the stages that run in any case: all, or none."""
        return [stage.name for stage in self.stages] if force else []


def makers(work: Work, others: Sequence[Work]) -> dict[str, int]:
    """Dotted key of an input file → index of the run, among these, that writes the file."""
    from strainsight.runner.plan import files_of

    folders = {other.job.folder.resolve(): i for i, other in enumerate(others) if other is not work}
    files = {key: path.parent.resolve() for stage in work.stages for key, path in files_of(stage, work.job).items()}
    return {key: folders[folder] for key, folder in files.items() if folder in folders}


def refuse_foreign_folder(work: Work) -> None:
    """Raise ConfigError if a suite would write its page into the folder of a run, or a run into that of a suite."""
    this, foreign, its = ("suite", "run", "import") if work.stages[0].name == "suite" else ("run", "suite", "suite")
    if (work.job.folder / f"{its}.h5").exists():
        raise ConfigError(
            f"{work.job.folder} contains the results of a {foreign}, and this {this} would overwrite its report.html",
            key="name",
            where=work.job.locate("name"),
            remedy="use another name, or another folder with --results DIR",
        )


ABOVE = 3
"""Number of parent folders of the config to search for its results."""


def elsewhere(work: Work) -> str:
    """A note if this results folder is empty but a results folder near the config contains the run."""
    folder, base = work.job.folder, work.job.base.resolve()
    for above in [] if folder.exists() else [base, *base.parents[:ABOVE]]:
        other = above / "results" / folder.name
        if other.resolve() != folder.resolve() and (other / "import.h5").is_file():
            return f"{folder} has no results yet, but {other} has results; to use these, set --results {other.parent}"
    return ""


def look_at_folder(work: Work, note: Say) -> None:
    """Check the results folder before anything else: `refuse_foreign_folder`, `elsewhere`."""
    refuse_foreign_folder(work)
    if text := elsewhere(work):
        note(text)


def bring_up_to_date(
    work: Work, forced: Collection[str], as_json: bool, verbose: bool, say: Say, progress: Progress, note: Say = note
) -> list[Artefact]:
    """Run the stages that are not up to date, one line per stage; returns the artefacts of all stages."""
    look_at_folder(work, note)
    from strainsight.memory import available_memory
    from strainsight.runner.plan import WILL_RUN, plan
    from strainsight.runner.runner import DONE, RUNNING, Event
    from strainsight.runner.runner import run as run_stages
    from strainsight_cli.status import forecast

    artefacts: list[Artefact] = []
    at_work, started, following, forecast_said = "", time.time(), None, as_json or bool(work.run)
    files = {stage.name: work.job.folder / f"{stage.name}.h5" for stage in work.stages}
    last = {name: seconds for name, path in files.items() if (seconds := seconds_for(path)) is not None}

    def move(stage: str, activity: str, share: float) -> None:
        left = RemainingTime(ends_at(started, time.time(), share, last.get(stage)), following)
        progress(work.label, stage, activity, share, left)

    def notice(text: str) -> None:
        log(f"note: {text}")
        note(text)

    command = " ".join(stage.name for stage in work.stages)
    with run_log(work.job, command) as log, opened(work.where, available_memory) as sweep:
        try:
            for text in config_warnings(work.job):
                warn(text)
            for event in run_stages(work.stages, work.job, forced=forced, progress=move, notice=notice, sweep=sweep):
                if event.status == RUNNING:
                    at_work, started, following = event.stage, time.time(), after(work.stages, event.stage, last)
                    if not forecast_said and artefacts:
                        forecast_said = True
                        pending = [
                            each.stage for each in plan(work.stages, work.job, forced) if each.status == WILL_RUN
                        ]
                        first = artefacts[0]
                        if first.header.stage == "import" and (line := forecast(work, pending, first)):
                            say(line)
                    log(f"{event.stage} starts: {event.reason}")
                    move(event.stage, event.reason, 0.0)
                    continue
                assert event.artefact is not None
                artefacts.append(event.artefact)
                sized = config_warnings(work.job, event.artefact) if event.stage == "import" else ()
                for text in (*sized, *event.artefact.warnings):
                    warn(text)
                spent = f" after {event.seconds:.1f} s, {peak()}" if event.status == DONE else ""
                log(f"{event.stage} {event.status}{spent}: {event.artefact.message}")
                say(render.stage_json(event, work.run) if as_json else render.stage_line(event, verbose))
        except Exception as error:
            if at_work and (not artefacts or artefacts[-1].header.stage != at_work):
                log(f"{at_work} failed after {time.time() - started:.1f} s, {peak()}")
            if as_json and at_work:
                reason = str(error) if isinstance(error, StrainsightError) else f"{type(error).__name__}: {error}"
                say(render.stage_json(Event(at_work, "failed", reason), work.run))
            raise
        finally:
            if at_work:
                move("", "", 1.0)
    return artefacts


def show_results(artefacts: Sequence[Artefact], tables: Collection[str]) -> None:
    """Print the tables of the stages named, a table of all warnings, and the files written for readers."""
    from strainsight.runner.artefact import GRID
    from strainsight.runner.output import WARNINGS, warning_texts, warnings_table

    chosen = [table for artefact in artefacts if artefact.header.stage in tables for table in artefact.tables]
    warned = [table for table in chosen if table.title == WARNINGS]
    texts = {same_text(text): text for text in warning_texts(warned)}
    render.print_tables([*(table for table in chosen if table not in warned), *warnings_table([*texts.values()])])
    for artefact in artefacts:
        for name in artefact.header.side_files or {}:
            if not name.endswith(GRID):  # the artefact's own grid under a name that ParaView takes
                say(f"{name.rpartition('.')[0]}: {artefact.path.parent / name}")


def config_warnings(job: Job, imported: Artefact | None = None) -> tuple[str, ...]:
    """Warnings for numbers of a config outside their plausible ranges; imported: artefact with the size of the structure."""
    from strainsight.config.base import implausible, shown_key

    if job.model is None:
        return ()
    sizes = [value for key, value in imported.summary.items() if key.split(".")[0] == "extent"] if imported else []
    unlikely = implausible(job.model, max(map(float, sizes), default=math.inf))
    return tuple(
        f"{job.locate(problem.key)}  {shown_key(problem.key)}: {problem.what}; {problem.remedy}" for problem in unlikely
    )


def show_warnings(work: Work, statuses: Iterable[Status]) -> None:
    """Print the warnings of the config, and of the artefacts that a command reads or lists without computing."""
    artefacts = [status.result for status in statuses if status.result is not None]
    imported = next((artefact for artefact in artefacts if artefact.header.stage == "import"), None)
    for text in (*config_warnings(work.job, imported), *(text for artefact in artefacts for text in artefact.warnings)):
        warn(text)


def refuse_warned(work: Work) -> None:
    """Raise UserError if the config or the import of a run has warnings, with the first three."""
    from strainsight.runner.artefact import Artefact

    imported = Artefact(work.job.folder / "import.h5")
    texts = (*config_warnings(work.job, imported), *imported.warnings)
    if texts:
        more = f"; and {len(texts) - 3} more" if len(texts) > 3 else ""
        raise UserError(
            f"--strict does not permit {len(texts)} warning{'s' * (len(texts) > 1)}: {'; '.join(texts[:3])}{more}",
            where=work.job.locate("mesh"),
            remedy="follow the advice of each warning, or remove --strict",
        )


def exit_code(artefacts: Sequence[Artefact]) -> int:
    """Exit code of a command, from the results of its updated stages."""
    from strainsight.estimation.decision import exit_code_in

    return max((exit_code_in(artefact.summary) for artefact in artefacts), default=0)
