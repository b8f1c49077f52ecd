"""A suite on the command line: its runs in order, then its page, then a table of run times."""

from __future__ import annotations

import signal
import sys
import warnings
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from multiprocessing import active_children, get_context, resource_tracker
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from strainsight import processes
from strainsight.errors import ConfigError, StrainsightError, did_you_mean
from strainsight.processes import end_with_parent
from strainsight.runner.output import Table
from strainsight.runner.plan import NO_CODE, OTHER_CODE, UP_TO_DATE, WILL_RUN, Job, files_of, inputs_of, plan
from strainsight.runner.sweep_location import Where
from strainsight_cli import pipelines, printing, render
from strainsight_cli.bar import progress_bar
from strainsight_cli.failures import Failure, failure_of, plain_warnings, tell, warn
from strainsight_cli.printing import say
from strainsight_cli.status import print_statuses, sum_of
from strainsight_cli.summary import print_summary
from strainsight_cli.work import (
    Progress,
    Work,
    bring_up_to_date,
    exit_code,
    makers,
    note,
    refuse_foreign_folder,
    show_results,
    show_warnings,
)

if TYPE_CHECKING:
    from strainsight.config.load import LoadedConfig
    from strainsight.config.suite_runs import PlannedRun
    from strainsight.runner.artefact import Artefact
    from strainsight.runner.stage import Stage

Computed = tuple[str, str, float | None]
"""Key, checksum and seconds; a reused artefact is identical to the last digit."""


def timing_table(runs: Sequence[str], artefacts_of: Sequence[Sequence[Artefact]], page: Artefact) -> Table:
    """One row per run, one column per stage: run time in seconds, or "↩ 2" for a result reused from run 2.

    For results of previous commands, the first run with an artefact counts as its origin. page: artefact of the suite, in a
    separate row."""
    entries = [(i, artefact) for i, artefacts in enumerate(artefacts_of) for artefact in artefacts]
    stages = list(dict.fromkeys(artefact.header.stage for _, artefact in entries))
    maker: dict[Computed, int] = {}
    for i, artefact in sorted(entries, key=lambda entry: bool(entry[1].source)):
        maker.setdefault(_computed(artefact), i)
    cells = [dict.fromkeys(stages, "") for _ in runs]
    spent = [dict.fromkeys(stages, 0.0) for _ in runs]
    for i, artefact in entries:
        stage, seconds = artefact.header.stage, artefact.header.seconds
        if (other := maker[_computed(artefact)]) != i:
            cells[i][stage] = f"↩ {other + 1}"
        else:
            cells[i][stage] = "?" if seconds is None else _seconds(seconds)
            spent[i][stage] = seconds or 0.0
    whole = [sum(times.values()) for times in spent]
    rows = [
        (str(i + 1), name, *cells[i].values(), _seconds(whole[i]) if whole[i] else "") for i, name in enumerate(runs)
    ]
    page_seconds = page.header.seconds or 0.0
    rows.append(("", "page of the suite", *[""] * len(stages), _seconds(page_seconds)))
    below = [_seconds(sum(times[stage] for times in spent)) for stage in stages]
    rows.append(("", "all", *below, _seconds(page_seconds + sum(whole))))
    return Table("run time [s] (↩ n: reused from run n)", ("", "run", *stages, "all"), tuple(rows))


def peak_memory(jobs: int) -> str:
    """Peak memory of this process, and of its largest child, with `jobs` parallel children."""
    process, child = (processes.peak_memory(children) for children in (False, True))
    if process is None or child is None:
        return "\npeak memory: unknown on this system"
    at_once = f", {jobs} in parallel" if jobs > 1 else ""
    largest = f", largest child process {child / 2**30:.2f} GiB{at_once}" if child else ""
    return f"\npeak memory: {process / 2**30:.2f} GiB{largest}"


def _computed(artefact: Artefact) -> Computed:
    return artefact.key, artefact.digest, artefact.header.seconds


def _seconds(value: float) -> str:
    return f"{value:.1f}" if value < 100 else f"{value:.0f}"


def works_of(suite: LoadedConfig, results: Path, where: Where = Where(1)) -> list[Work]:
    """The runs of a suite in order, and the suite itself last; where: location of the sweeps of a run. Raises ConfigError for
    every fault in any of them."""
    from strainsight.config.suite_runs import all_of, runs_of
    from strainsight.stages.pages.suite_entries import suite_config
    from strainsight.stages.suite import SUITE

    runs = runs_of(suite)
    works = []
    for run, stages in zip(runs, all_of(runs, lambda run: _stages(suite, run)), strict=True):
        name = run.config.model.name
        label = f"run {run.place + 1} of {len(runs)} {name}"
        works.append(replace(pipelines.work_of(run.config, results), stages=stages, run=name, label=label, where=where))
    # the suite's own stage, on the numbers of its runs
    config = suite_config(suite, runs, [[stage.name for stage in work.stages] for work in works])
    page = Work((SUITE,), Job(config, results, results, suite.locate), config["name"])
    all_of([*works, page], refuse_foreign_folder)
    all_of(range(len(works)), lambda i: _refuse_inputs(suite, works, i))
    return [*works, page]


def _refuse_inputs(suite: LoadedConfig, works: Sequence[Work], i: int) -> None:
    """Raise ConfigError if a file that a run needs from another run is not written, or written later."""
    files = {key: path for stage in works[i].stages for key, path in files_of(stage, works[i].job).items()}
    for key, j in makers(works[i], works).items():
        path, stage = files[key], files[key].stem
        if j > i:
            raise ConfigError(
                f"{path} is written by the run '{works[j].run}', which is later in this suite",
                key=key,
                where=works[i].job.locate(key),
                remedy=f"move run '{works[j].run}' before this run",
            )
        reached = [each.name for each in works[j].stages]
        later = [each.name for each in pipelines.stages_of(works[j].job.config) if each.name not in reached]
        if path.suffix == ".h5" and stage in later:
            raise ConfigError(
                f"the run ends after the stage '{reached[-1]}', before it writes {path.name}",
                key=f"runs[{j}].until",
                where=suite.locate(f"runs.{j}.until"),
                remedy=f"set until: {stage}; the key {key} of runs[{i}] needs this file",
            )


def _stages(suite: LoadedConfig, run: PlannedRun) -> tuple[Stage, ...]:
    """Stages of the run up to `until`, without those that neither the run nor the page of the suite needs."""
    from strainsight.config.suite import SuiteConfig, measures_of
    from strainsight.stages.pages.suite_entries import OF_A_BENCH

    stages = pipelines.stages_of(run.config.data)
    names = [stage.name for stage in stages]
    if run.entry.until not in names:
        raise ConfigError(
            f"the run has no stage '{run.entry.until}'",
            key=f"runs[{run.place}].until",
            where=suite.locate(f"runs.{run.place}.until"),
            remedy=did_you_mean(run.entry.until, names, f"use one of the stages {', '.join(names)}"),
        )
    reached = stages[: names.index(run.entry.until) + 1]
    if run.config.data["kind"] != "bench":
        return reached
    assert isinstance(suite.model, SuiteConfig)
    measures = measures_of(suite.model.claims, suite.model.comparisons).values()
    wanted = {run.entry.until, *OF_A_BENCH, *(measure.stage for measure in measures)}
    selected: list[Stage] = []
    for stage in reversed(reached):
        if stage.name in wanted:
            selected.insert(0, stage)
            wanted.update(stage.upstream)
    return tuple(selected)


def show_suite(works: Sequence[Work], force: bool, as_json: bool, verbose: bool = False) -> None:
    """Stages that would run, with reasons, run by run; the page follows if any run changes."""
    pending = []
    for work in works[:-1]:
        statuses = plan(work.stages, work.job, work.forced(force))
        show_warnings(work, statuses)
        waits = any(status.status != UP_TO_DATE for status in statuses)
        if waits:
            pending.append(f"{work.run} changed")
        if as_json:
            say(*(render.stage_json(status, work.run) for status in statuses))
            continue
        say(f"{work.label}: {sum_of(statuses)}")
        if waits or verbose:
            print_statuses(statuses, verbose, indent=2, head=False)
    (status_of_page,) = plan(works[-1].stages, works[-1].job, works[-1].forced(force))
    if pending:
        passed = (" is missing", OTHER_CODE, NO_CODE)
        besides = [reason for reason in status_of_page.reasons if not reason.endswith(passed)]
        status_of_page = replace(status_of_page, status=WILL_RUN, reasons=(*besides, *pending))
    if as_json:
        say(render.stage_json(status_of_page, works[-1].run))
    else:
        print_statuses([status_of_page], verbose, head=False)


def run_suite(works: Sequence[Work], jobs: int, force: bool, as_json: bool, verbose: bool) -> None:
    """Update every run, `jobs` in parallel, then the page; a failed run ends the command, with its name in the message.

    Exits with 3 if the measurements of a run are inconsistent with its model."""
    _look_for_inputs(works[:-1])
    with progress_bar(not as_json) as progress:
        computed = _all_runs(works[:-1], jobs, force, as_json, verbose, progress)
        (page,) = _one_run(works[-1], force, as_json, verbose, progress)
    if not as_json:
        if verbose:
            show_results([page], [page.header.stage])
            render.print_tables([timing_table([work.run for work in works[:-1]], computed, page)])
        print_summary([page], works[-1].job.folder, peak_memory(jobs))
    if code := exit_code([artefact for run in computed for artefact in run]):
        raise typer.Exit(code)


def _all_runs(
    works: Sequence[Work], jobs: int, force: bool, as_json: bool, verbose: bool, progress: Progress
) -> list[Sequence[Artefact]]:
    if jobs == 1 or len(works) == 1:
        return [_one_run(work, force, as_json, verbose, progress) for work in works]
    by_place: dict[int, Sequence[Artefact]] = {}
    failed = []
    with closing(side_by_side(works, jobs, force, as_json, verbose, progress)) as runs:
        for ended in runs:
            say(*[_heading(works[ended.place])] * (not as_json), *ended.lines)
            by_place[ended.place] = ended.artefacts
            if ended.failure is not None:
                say(f"{_heading(works[ended.place])} failed:", error=True)
                failed.append(tell(ended.failure, verbose))
    if failed:
        raise failed[0]
    return [by_place[place] for place in range(len(works))]


def _one_run(work: Work, force: bool, as_json: bool, verbose: bool, progress: Progress) -> Sequence[Artefact]:
    if not as_json:
        say(_heading(work))
    with _named(work):
        return bring_up_to_date(work, work.forced(force), as_json, verbose, say, progress)


@contextmanager
def _named(work: Work) -> Iterator[None]:
    """Print the name of the run before its failure is reported."""
    try:
        yield
    except Exception:
        say(f"{_heading(work)} failed:", error=True)
        raise


def _heading(work: Work) -> str:
    return work.label or f"suite {work.run}"


def _look_for_inputs(works: Sequence[Work]) -> None:
    """Check that the input files of all runs exist before the first one starts, except files that they exchange."""
    for work in works:
        coming = makers(work, works)
        for stage in work.stages:
            inputs = inputs_of(stage, work.job, required=False)
            if inputs.files.keys() - inputs.digests.keys() - coming.keys():
                with _named(work):
                    inputs_of(stage, work.job)


LOOK = 0.2
"""[s] Polling interval of the processes."""


@dataclass(frozen=True)
class Ended:
    """A finished run: its lines, the artefacts of its stages, and the report of a failure."""

    place: int
    lines: tuple[str, ...]
    artefacts: tuple[Artefact, ...]
    failure: Failure | None


def side_by_side(
    works: Sequence[Work], jobs: int, force: bool, as_json: bool, verbose: bool, progress: Progress
) -> Generator[Ended]:
    """Every finished run, `jobs` in parallel; a process waits for results that another one is computing, and reuses them.

    After a failure no other run starts. Raises StrainsightError if a process was killed."""
    waits = [set(makers(work, works).values()) for work in works]
    pending, ended = list(range(len(works))), set[int]()
    running: dict[Future[Ended], int] = {}
    with _processes(min(jobs, len(works)), verbose) as (pool, moves):
        while pending or running:
            for place in [place for place in pending if waits[place] <= ended][: jobs - len(running)]:
                pending.remove(place)
                running[pool.submit(_run, place, works[place], force, as_json, verbose)] = place
            done = wait(running, timeout=LOOK, return_when=FIRST_COMPLETED).done
            _pass_on(moves, progress)
            for future in sorted(done, key=lambda future: (future.exception() is not None, running[future])):
                try:
                    result = future.result()
                except BrokenProcessPool:
                    raise StrainsightError(
                        "a process was killed, probably for lack of memory; compute one run at a time with --set jobs=1",
                        where=", ".join(works[place].label for place in sorted(running.values())),
                    ) from None
                ended.add(running.pop(future))
                if result.failure is not None:
                    pending.clear()
                yield result


@contextmanager
def _processes(count: int, verbose: bool) -> Iterator[tuple[ProcessPoolExecutor, Any]]:
    context = get_context("spawn")
    # the process that clears up semaphores after Ctrl-C must not report it
    sys.warnoptions.append("ignore:resource_tracker")
    try:
        resource_tracker.ensure_running()
    finally:
        sys.warnoptions.pop()
    moves = context.SimpleQueue()
    with ProcessPoolExecutor(count, context, _start, (moves, verbose, printing.now())) as pool:
        try:
            yield pool, moves
        except BaseException:
            # Nobody listens any more: they would wait for that, and the pool for them.
            for process in active_children():
                process.terminate()
            raise


def _pass_on(moves: Any, progress: Progress) -> None:
    """Messages of the processes since the last poll: progress, notes and warnings."""
    while not moves.empty():
        text = moves.get()
        if isinstance(text, str):
            note(text)
        elif isinstance(text, UserWarning):
            warn(str(text))
        else:
            progress(*text)


_moves: Any = None


def _start(moves: Any, verbose: bool, level: printing.Level) -> None:
    """Prepare a child process: it ends with its parent, which prints its warnings once."""
    global _moves
    _moves = moves
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    end_with_parent()
    printing.set_level(level)
    plain_warnings(verbose)
    warnings.showwarning = lambda message, *_, **__: moves.put(UserWarning(str(message)))


def _run(place: int, work: Work, force: bool, as_json: bool, verbose: bool) -> Ended:
    lines: list[str] = []
    artefacts: list[Artefact] = []
    failure = None
    try:
        artefacts = bring_up_to_date(
            work, work.forced(force), as_json, verbose, lines.append, lambda *move: _moves.put(move), _moves.put
        )
    except Exception as error:
        failure = failure_of(error)
    return Ended(place, tuple(lines), tuple(artefacts), failure)
