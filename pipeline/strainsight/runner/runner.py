"""Run the stages that are not up to date, each on what the ones above have written."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from strainsight.errors import StrainsightError
from strainsight.parallel.sweep import Sweep, serial
from strainsight.runner.artefact import Artefact, Header, file_digest
from strainsight.runner.code import code_of
from strainsight.runner.lock import computing, locked
from strainsight.runner.output import warnings_table
from strainsight.runner.plan import UP_TO_DATE, Inputs, Job, inputs_of, judge, other_code
from strainsight.runner.reuse import reused
from strainsight.runner.slices import Slice, declared
from strainsight.runner.stage import Context, Stage
from strainsight.runner.store import remove_unfinished, write_artefact

RUNNING = "running"
DONE = "done"

Progress = Callable[[str, str, float], None]


def no_progress(stage: str, doing: str, share: float) -> None:
    """Say nothing."""


@dataclass(frozen=True)
class Event:
    """Something happened to a stage: "running" as it starts, then "done"; or "up to date" alone.

    reason    why it runs; seconds: how long it took; artefact: its file, verified ("done" and "up to date")
    """

    stage: str
    status: str
    reason: str = ""
    seconds: float = 0.0
    artefact: Artefact | None = None


def run(
    stages: Sequence[Stage],
    job: Job,
    *,
    forced: Collection[str] = (),
    progress: Progress = no_progress,
    notice: Callable[[str], None] = lambda text: None,
    sweep: Sweep = serial,
) -> Iterator[Event]:
    """Bring `stages` (in order, upstream first) up to date, yielding events.

    Input files of all stages are looked for before anything is written, and looked at (`Stage.check`) before the first one
    runs. The lock of the results folder is held until the iterator ends. A stage that fails writes nothing and leaves all
    earlier artefacts as they were; its StrainsightError gets the place of its config key. `forced` names stages that run in
    any case. A stage whose upstream ran again but came out the same stays up to date; one that a run beside this has done on
    the same inputs is reused from there; where another process is at it, that one is waited for.
    """
    # Digests are taken before a stage reads its files: a file that changes meanwhile is noticed by the next run.
    with _placed(job):
        inputs = {stage.name: inputs_of(stage, job) for stage in stages}
    with locked(job.folder) as left_by:
        if left_by is not None:
            notice(f"an earlier run (process {left_by}) was stopped in {job.folder}; its finished stages are kept")
        remove_unfinished(job.folder)
        finished: dict[str, Artefact] = {}
        checked = False
        for stage in stages:
            status, artefact = judge(stage, job, inputs[stage.name], finished, forced=stage.name in forced)
            if artefact is not None:
                finished[stage.name] = artefact
                yield Event(stage.name, UP_TO_DATE, status.reason, artefact=artefact)
                continue
            if not checked:
                checked = True
                _check(stages, job)
            yield Event(stage.name, RUNNING, status.reason)
            start = time.perf_counter()
            reason = status.reason
            key = inputs[stage.name].key(stage, {name: finished[name].digest for name in stage.upstream})
            waits = f"{job.config['name']} waits for another process that computes {stage.name}"
            with computing(job.results, key, partial(notice, waits)):
                taken = None if stage.name in forced else reused(stage, job, key)
                if taken is not None:
                    finished[stage.name] = taken
                    reason += f", reused from {taken.source}"
                    if other := other_code(stage, taken):
                        reason += f" ({other})"
                else:
                    with _placed(job):
                        finished[stage.name] = _execute(
                            stage, job, inputs[stage.name], key, finished, progress, notice, sweep
                        )
            yield Event(stage.name, DONE, reason, time.perf_counter() - start, finished[stage.name])


def _check(stages: Sequence[Stage], job: Job) -> None:
    """What is wrong with the files of the test is known before the first stage that takes an hour."""
    for stage in stages:
        if stage.check is not None and job.model is not None:
            with _placed(job):
                stage.check(job.model, job.base)


def _execute(
    stage: Stage,
    job: Job,
    inputs: Inputs,
    key: str,
    finished: Mapping[str, Artefact],
    progress: Progress,
    notice: Callable[[str], None],
    sweep: Sweep,
) -> Artefact:
    upstream = {name: finished[name] for name in stage.upstream}
    context = Context(
        config=Slice(inputs.config, stage.name) if job.model is None else declared(job.model, inputs.config),
        upstream=upstream,
        files=inputs.files,
        progress=lambda doing, share: progress(stage.name, doing, share),
        sweep=sweep,
        notice=notice,
        base=job.base,
    )
    start = time.perf_counter()
    with _warned() as texts:
        output = stage.run(context)
    output = replace(output, tables=(*output.tables, *warnings_table(tuple(texts))))
    seconds = time.perf_counter() - start
    header = Header(
        stage=stage.name,
        version=stage.version,
        key=key,
        config=inputs.config,
        upstream={name: artefact.digest for name, artefact in upstream.items()},
        files=inputs.digests,
        seed=inputs.config.get("seed"),
        found={os.path.relpath(path, job.base): file_digest(Path(path)) for path in output.inputs},
        seconds=seconds,
        code=code_of(stage.run),
    )
    return write_artefact(job.folder / f"{stage.name}.h5", output, header, stage.records)


@contextmanager
def _warned() -> Iterator[dict[str, None]]:
    """The texts of each UserWarning, which is shown as well; those of subclasses depend on the machine (`MachineWarning`)."""
    texts: dict[str, None] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("always", UserWarning)
        show = warnings.showwarning

        def keep(message: Warning | str, category: type[Warning], *rest: Any, **named: Any) -> None:
            if category is UserWarning:
                texts[str(message)] = None
            show(message, category, *rest, **named)

        warnings.showwarning = keep
        yield texts


@contextmanager
def _placed(job: Job) -> Iterator[None]:
    """Give an error that names a config key the place of that key."""
    try:
        yield
    except StrainsightError as error:
        for problem in (error, *error.others):
            if problem.key and problem.where is None:
                problem.where = job.locate(problem.key)
        raise
