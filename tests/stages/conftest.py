"""The real pipeline on the real cantilever, shortened where length does not matter."""

from __future__ import annotations

from pathlib import Path

import pytest

from strainsight.config.load import load_config
from strainsight.stages.bench.pipeline import bench_stages
from strainsight.stages.placement import PLACEMENT
from strainsight.workflow.plan import Job
from strainsight.workflow.runner import run

ROOT = Path(__file__).parents[2]
SHORT = (
    "train.duration=0.2",
    "place.instants=3",
    "validate.duration=0.2",
    "validate.random_sets=2",
    "validate.repeats=2",
    "validate.truth.modes=20",
)


def job_of(config: Path, results: Path, *overrides: str) -> Job:
    loaded = load_config(config, overrides)
    return Job(loaded.data, config.parent, results, loaded.locate, loaded.model)


def finished(job: Job, stages=PLACEMENT):
    """Run the stages and return stage → (status, reason, artefact)."""
    events = [event for event in run(stages, job) if event.artefact is not None]
    return {event.stage: (event.status, event.reason, event.artefact) for event in events}


@pytest.fixture(scope="session")
def config() -> Path:
    return ROOT / "configs" / "cantilever-youngs-modulus.yaml"


@pytest.fixture(scope="session")
def results(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("results")


@pytest.fixture(scope="session")
def artefacts(config, results):
    """stage → Artefact of one shortened run of cantilever-youngs-modulus in `results`."""
    return {stage: artefact for stage, (_, _, artefact) in finished(job_of(config, results, *SHORT)).items()}


@pytest.fixture(scope="session")
def bench_results(tmp_path_factory) -> Path:
    """Results of benches, which borrow each other's reduced hub."""
    return tmp_path_factory.mktemp("bench")


@pytest.fixture(scope="session")
def bench(bench_results):
    """stage → Artefact of one second of bench-full."""
    job = job_of(ROOT / "configs" / "bench-full.yaml", bench_results, "simulate.duration=1.0")
    return {stage: artefact for stage, (_, _, artefact) in finished(job, bench_stages(job.config)).items()}
