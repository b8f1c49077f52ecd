"""A suite on the command line: its runs one after the other, then its own page, then where the time went."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from strainsight.errors import ConfigError, did_you_mean
from strainsight.runner.where import Where
from strainsight_cli import pipelines, render
from strainsight_cli.bar import progress_bar
from strainsight_cli.failures import tell
from strainsight_cli.printing import say
from strainsight_cli.status import print_statuses, sum_of
from strainsight_cli.timing import peak_memory, timing_table
from strainsight_cli.work import (
    Progress,
    Work,
    bring_up_to_date,
    exit_code,
    makers,
    refuse_taken,
    show_results,
    show_warnings,
)

if TYPE_CHECKING:
    from strainsight.config.load import LoadedConfig
    from strainsight.config.suite_runs import PlannedRun
    from strainsight.runner.artefact import Artefact
    from strainsight.runner.stage import Stage


def works_of(suite: LoadedConfig, results: Path, where: Where = Where(1)) -> list[Work]:
    """The runs of a suite, in order, and last the suite itself; where: the sweeps of a run run. Raises ConfigError for whatever
    is wrong with any of them."""
    from strainsight.config.suite_runs import all_of, runs_of

    runs = runs_of(suite)
    works = []
    for run, stages in zip(runs, all_of(runs, lambda run: _stages(suite, run)), strict=True):
        name = run.config.model.name
        beside = f"run {run.place + 1} of {len(runs)} {name}"
        works.append(
            replace(pipelines.work_of(run.config, results), stages=stages, run=name, beside=beside, where=where)
        )
    page = _page(suite, runs, works, results)
    all_of([*works, page], refuse_taken)
    all_of(range(len(works)), lambda i: _refuse_inputs(suite, works, i))
    return [*works, page]


def shared_out(suite: LoadedConfig, jobs: int | None, dask: str | None) -> tuple[int, Where]:
    """How many runs go on at a time, and where the sweeps of each run: `--jobs` are the runs; else the suite says how many,
    and they share the cores."""
    from strainsight.parallel.processes import cores

    at_once = jobs or int(suite.data["jobs"])
    return at_once, Where(1 if jobs else max(1, cores() // at_once), dask)


def _page(suite: LoadedConfig, runs: Sequence[PlannedRun], works: Sequence[Work], results: Path) -> Work:
    """The suite's own stage, on the numbers of its runs."""
    from strainsight.runner.plan import Job
    from strainsight.stages.pages.suite_entries import suite_config
    from strainsight.stages.suite import SUITE

    config = suite_config(suite, runs, [[stage.name for stage in work.stages] for work in works])
    return Work((SUITE,), Job(config, results, results, suite.locate), config["name"])


def _refuse_inputs(suite: LoadedConfig, works: Sequence[Work], i: int) -> None:
    """Raise ConfigError where a file that a run takes from another one is not made, or later."""
    from strainsight.runner.plan import files_of

    files = {key: path for stage in works[i].stages for key, path in files_of(stage, works[i].job).items()}
    for key, j in makers(works[i], works).items():
        stage = files[key].stem
        if j > i:
            raise ConfigError(
                f"{files[key]} comes from '{works[j].run}', which the suite runs later",
                key=key,
                where=works[i].job.locate(key),
                remedy="list that run before this one",
            )
        reached = [own.name for own in works[j].stages]
        later = [own.name for own in pipelines.stages_of(works[j].job.config) if own.name not in reached]
        if files[key].suffix == ".h5" and stage in later:
            raise ConfigError(
                f"the run ends after '{works[j].stages[-1].name}', before it writes {files[key].name}",
                key=f"runs[{j}].until",
                where=suite.locate(f"runs.{j}.until"),
                remedy=f"runs[{i}] takes its {'guess' if '.guess.' in key else key} from it: until: {stage}",
            )


def _stages(suite: LoadedConfig, run: PlannedRun) -> tuple[Stage, ...]:
    """The run's stages up to the last one that is asked for, but for those that neither it nor the page of the suite needs."""
    from strainsight.config.suite import SuiteConfig
    from strainsight.config.suite_measures import measures_of
    from strainsight.stages.pages.suite_entries import OF_A_BENCH

    stages = pipelines.stages_of(run.config.data)
    names = [stage.name for stage in stages]
    if run.entry.until not in names:
        raise ConfigError(
            f"the run has no stage '{run.entry.until}'",
            key=f"runs[{run.place}].until",
            where=suite.locate(f"runs.{run.place}.until"),
            remedy=did_you_mean(run.entry.until, names, f"its stages are {', '.join(names)}"),
        )
    reached = stages[: names.index(run.entry.until) + 1]
    if run.config.data["kind"] != "bench":
        return reached
    assert isinstance(suite.model, SuiteConfig)
    measures = measures_of(suite.model.claims, suite.model.comparisons).values()
    wanted = {run.entry.until, *OF_A_BENCH, *(own.stage for own in measures)}
    kept: list[Stage] = []
    for stage in reversed(reached):
        if stage.name in wanted:
            kept.insert(0, stage)
            wanted.update(stage.upstream)
    return tuple(kept)


def show_suite(works: Sequence[Work], force: bool, as_json: bool, verbose: bool = False) -> None:
    """What would run and why, run by run; the page follows wherever a run will do anything."""
    from strainsight.runner.plan import NO_CODE, OTHER_CODE, UP_TO_DATE, WILL_RUN, plan

    pending = []
    for work in works[:-1]:
        statuses = plan(work.stages, work.job, [stage.name for stage in work.stages] if force else ())
        show_warnings(work, statuses)
        waits = any(status.status != UP_TO_DATE for status in statuses)
        if waits:
            pending.append(f"{work.run} changed")
        if as_json:
            for status in statuses:
                say(render.status_json(status, work.run))
            continue
        say(f"{work.beside}: {sum_of(statuses)}")
        if waits or verbose:
            print_statuses(statuses, verbose, indent=2, head=False)
    (own,) = plan(works[-1].stages, works[-1].job, [works[-1].stages[0].name] if force else ())
    if pending:
        passed = (OTHER_CODE, NO_CODE)
        besides = [reason for reason in own.reasons if not reason.endswith(" is missing") and reason not in passed]
        own = replace(own, status=WILL_RUN, reasons=(*besides, *pending))
    if as_json:
        say(render.status_json(own, works[-1].run))
    else:
        print_statuses([own], verbose, head=False)


def run_suite(works: Sequence[Work], jobs: int, force: bool, as_json: bool, verbose: bool) -> None:
    """Bring every run up to date, `jobs` at a time, then the page; a run that fails ends it, and the message says which.
    Ends with 3 where a record of a test contradicts its model."""
    _look_for_inputs(works[:-1])
    with progress_bar(not as_json) as progress:
        found = _all_runs(works[:-1], jobs, force, as_json, verbose, progress)
        page = works[-1]
        if not as_json:
            say(_heading(page))
        with _named(page):
            (own,) = bring_up_to_date(page, [page.stages[0].name] if force else [], as_json, verbose, say, progress)
    if not as_json:
        show_results([own], [page.stages[0].name])
        render.print_tables([timing_table([work.run for work in works[:-1]], found, own)])
        say(peak_memory(jobs))
    if code := exit_code([artefact for run in found for artefact in run]):
        raise typer.Exit(code)


def _all_runs(
    works: Sequence[Work], jobs: int, force: bool, as_json: bool, verbose: bool, progress: Progress
) -> list[Sequence[Artefact]]:
    if jobs > 1 and len(works) > 1:
        from strainsight_cli.side_by_side import side_by_side

        by_place: dict[int, Sequence[Artefact]] = {}
        failed = []
        with closing(side_by_side(works, jobs, force, as_json, verbose, progress)) as runs:
            for ended in runs:
                if not as_json:
                    say(_heading(works[ended.place]))
                for line in ended.lines:
                    say(line)
                by_place[ended.place] = ended.artefacts
                if ended.failure is not None:
                    _say_failed(works[ended.place])
                    failed.append(tell(ended.failure, verbose))
        if failed:
            raise failed[0]
        return [by_place[place] for place in range(len(works))]
    found: list[Sequence[Artefact]] = []
    for work in works:
        if not as_json:
            say(_heading(work))
        with _named(work):
            forced = [stage.name for stage in work.stages] if force else []
            found.append(bring_up_to_date(work, forced, as_json, verbose, say, progress))
    return found


@contextmanager
def _named(work: Work) -> Iterator[None]:
    """Say which run it was, before the failure itself is reported."""
    try:
        yield
    except Exception:
        _say_failed(work)
        raise


def _say_failed(work: Work) -> None:
    say(f"{_heading(work)} failed:", error=True)


def _heading(work: Work) -> str:
    return work.beside or f"suite {work.run}"


def _look_for_inputs(works: Sequence[Work]) -> None:
    """Look for the input files of all runs before the first one starts, but for what they give each other."""
    from strainsight.runner.plan import inputs_of

    for work in works:
        coming = makers(work, works)
        for stage in work.stages:
            inputs = inputs_of(stage, work.job, required=False)
            if inputs.files.keys() - inputs.digests.keys() - coming.keys():
                with _named(work):
                    inputs_of(stage, work.job)
