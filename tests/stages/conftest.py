"""The real pipeline on the real cantilever, shortened where length does not matter."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from strainsight.runner.plan import Job
from strainsight.runner.runner import run
from strainsight.stages.placement import PLACEMENT
from strainsight_cli.main import app

from ..shared import BENCHES, COARSE, ROOT, SHORT, UNSTUDIED, job_of, made, without_hot_spots  # noqa: F401  for the tests beside
from .column import on_column

LOADS = ROOT / "configs" / "bench" / "loads.yaml"
DIAMETER = ROOT / "configs" / "bench" / "diameter.yaml"
MODULUS = ROOT / "configs" / "bench" / "modulus.yaml"
SMALL = ROOT / "configs" / "bench" / "small.yaml"
"""Benches of one hub, each with an estimate of its own."""
HUBS = "hubs"
"""Runs of benches on their hub, which take it over from each other."""
GRID_FILTER = "estimate.method.parameters=grid"


def finished(job: Job, stages=PLACEMENT):
    """Run the stages and return stage → (status, reason, artefact)."""
    events = [event for event in run(stages, job) if event.artefact is not None]
    return {event.stage: (event.status, event.reason, event.artefact) for event in events}


def invoked(*words: object) -> str:
    """What a command that succeeds prints, in one line."""
    done = CliRunner().invoke(app, [str(word) for word in words])
    assert done.exit_code == 0, done.output
    return " ".join(done.output.split())


@pytest.fixture(scope="module")
def no_hot_spots():
    with without_hot_spots():
        yield


@pytest.fixture(scope="session")
def config() -> Path:
    return ROOT / "configs" / "cantilever-youngs-modulus.yaml"


@pytest.fixture(scope="session")
def artefacts(config):
    """stage → Artefact of one shortened run of cantilever-youngs-modulus."""
    return made(config, *COARSE)


@pytest.fixture(scope="session")
def results(artefacts, tmp_path_factory) -> Path:
    """A copy of the results that hold them."""
    folder = artefacts["import"].path.parent
    copy = tmp_path_factory.mktemp("results")
    shutil.copytree(folder, copy / folder.name)
    return copy


@pytest.fixture(scope="session")
def bench_config() -> Path:
    return on_column(ROOT / "configs" / "bench-full.yaml")


@pytest.fixture(scope="session")
def bench(bench_config):
    """stage → Artefact of 0.3 s of bench-full on the column."""
    return made(bench_config, "simulate.duration=0.3", "name=bench-full", beside=BENCHES)


@pytest.fixture(scope="session")
def estimate():
    """config, overrides → the artefact of an estimate on the column, which is reduced once for all."""
    return lambda config, *overrides, **stage: estimated(on_column(config), BENCHES, *overrides, **stage)


@pytest.fixture(scope="session")
def hub_estimate():
    """config, overrides → the artefact of an estimate, its hub reduced once for all."""
    return lambda config, *overrides, **stage: estimated(config, HUBS, *overrides, **stage)


def estimated(config, beside, *overrides, stage="estimate"):
    stages = ("import", "reduce", "place", "simulate", "truth", "estimate")  # without that of the bearing alone
    return made(config, "simulate.duration=1.0", *overrides, until=stage, beside=beside, only=stages)[stage]
