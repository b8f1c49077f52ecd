"""The code and commit that artefacts are made of, numbers that change with versions, and artefacts of released versions."""

from __future__ import annotations

import ast
import json
import os
import shutil
import subprocess
from dataclasses import fields, replace
from pathlib import Path

import pytest

import strainsight
from strainsight.errors import ArtefactError
from strainsight.records.record import read
from strainsight.runner import artefact as artefacts
from strainsight.runner import plan as plan_module
from strainsight.runner.artefact import Artefact
from strainsight.runner.output import Dataset, Output
from strainsight.runner.plan import OTHER_CODE, UP_TO_DATE, Job, plan
from strainsight.runner.runner import run as run_stages
from strainsight.runner.stage import Stage
from strainsight.runner.store import commit_of
from strainsight.stages.placement import MODES

from ..shared import job_of, script, stages_of
from .numbers import KEPT, differs, numbers_of
from .release import KEPT as released_KEPT
from .release import LARGEST, TINY, unpacked

ROOT = Path(strainsight.__file__).parent


def stage(version=1):
    return Stage(
        "toy", version, (), (), (), lambda context: Output({"/x": Dataset([1.0], "m", "x")}, summary={}, message="")
    )


def test_a_stage_reaches_what_python_finds_by_parsing_its_imports():
    found = plan_module.closure(MODES.module)
    assert {"strainsight.stages.rom", "strainsight.fem.modes", "strainsight.mesh.model"} <= found
    assert "strainsight.estimation.grid_filter" not in found
    for name in sorted(found)[::5]:
        path = ROOT.joinpath(*name.split(".")[1:])
        file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("strainsight"):
                assert node.module in found
            if isinstance(node, ast.Import):
                assert all(own.name in found for own in node.names if own.name.startswith("strainsight"))


def test_code_digest_depends_on_imported_modules_only(monkeypatch):
    before, source = plan_module.code_of(MODES), plan_module._source
    for module, same in (("strainsight.fem.modes", False), ("strainsight.estimation.grid_filter", True)):
        monkeypatch.setattr(
            plan_module,
            "_digest",
            lambda name, other=module: plan_module.hashlib.sha256(source(name) + b"#" * (name == other)).digest(),
        )
        assert (plan_module.code_of(MODES) == before) is same


def test_code_digest_includes_named_modules_and_page_assets():
    estimate, report = (plan_module.closure(f"strainsight.stages.{name}") for name in ("estimate", "report"))
    assert {f"strainsight.measurements.{name}" for name in ("mdf", "tdms", "mat", "hdf5_datasets")} <= estimate
    parts = {path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*") if path.suffix in (".css", ".js")}
    assert len(parts) >= 6
    benches = plan_module.closure("strainsight.stages.bench.report")
    assert parts <= report | benches
    assert {part for part in parts if part.startswith(("page/", "space/"))} <= report


def test_artefact_of_other_code_is_up_to_date_with_remark(tmp_path, monkeypatch):
    job = Job({"name": "own"}, tmp_path, tmp_path / "results")
    list(run_stages([stage()], job))
    (status,) = plan([stage()], job)
    assert (status.status, status.reasons) == (UP_TO_DATE, ())
    own = Artefact(job.folder / "toy.h5")
    assert own.header.code == plan_module.code_of(stage())
    monkeypatch.setattr("strainsight.runner.plan.code_of", lambda stage: "another")
    (status,) = plan([stage()], job)
    assert (status.status, status.reasons) == (UP_TO_DATE, (OTHER_CODE,))
    (event,) = run_stages([stage()], job)
    assert (event.status, event.reason) == (UP_TO_DATE, OTHER_CODE)
    (status,) = plan([stage(2)], job)
    assert status.reasons == ("stage version 1 → 2",)
    assert replace(own.header, code="") != own.header


NOBODY = {"GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_NOSYSTEM": "1"}


@pytest.fixture
def git(tmp_path):
    """A repository with one commit → a function that calls git in it."""
    if shutil.which("git") is None:
        pytest.skip("no git")

    def call(*words, folder=tmp_path / "own"):
        folder.mkdir(exist_ok=True)
        command = ["git", "-c", "user.name=a", "-c", "user.email=a@b", *words]
        done = subprocess.run(command, cwd=folder, env=os.environ | NOBODY, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    call("init", "--quiet")
    call("commit", "--quiet", "--allow-empty", "--message", "first")
    return call


def test_the_commit_is_that_of_git(git, tmp_path):
    head = git("rev-parse", "HEAD")
    assert commit_of(tmp_path / "own") == head
    git("pack-refs", "--all")
    assert commit_of(tmp_path / "own") == head
    git("worktree", "add", "--quiet", "-b", "other", str(tmp_path / "tree"))
    assert commit_of(tmp_path / "tree") == head
    git("checkout", "--quiet", "--detach")
    assert commit_of(tmp_path / "own") == head
    assert commit_of(tmp_path) == ""


def test_numbers_change_with_the_version_of_their_stage_alone(tmp_path):
    kept, found = json.loads(KEPT.read_text(encoding="utf-8")), numbers_of(tmp_path)
    raised = [stage for stage, own in found.items() if own["version"] != kept.get(stage, {}).get("version")]
    assert not raised, f"{raised} have a new version: renew numbers.json, python -m tests.runner.numbers"
    moved = {
        stage: [
            path
            for path in sorted({*own["numbers"], *kept[stage]["numbers"]})
            if differs(own["numbers"].get(path, [0, 0, 0]), kept[stage]["numbers"].get(path, [-1, 0, 0]))
        ]
        for stage, own in found.items()
    }
    moved = {stage: paths for stage, paths in moved.items() if paths}
    first = next(iter(moved), "")
    assert not moved, f"{first} has other numbers ({moved[first][:6]}) and its version: raise it, then renew numbers.json"


RELEASED = sorted(path.name.removesuffix(".tar.xz") for path in released_KEPT.glob("*.tar.xz"))
_artefacts = script("docs/artefact_reference.py")
RECORDS = {"structure": _artefacts.PLACEMENT, "bench": _artefacts.PLACEMENT | _artefacts.BENCH}


@pytest.fixture(scope="module", params=RELEASED)
def folder(request, tmp_path_factory):
    return unpacked(request.param, tmp_path_factory.mktemp("released"))


def stages(folder, name):
    job = job_of(folder / f"{name}.yaml", folder / "results")
    found = [(stage, job.folder / f"{stage.name}.h5") for stage in stages_of(job)]
    return [(stage, path) for stage, path in found if path.exists()]


def opened(path):
    try:
        return Artefact(path), ""
    except ArtefactError as error:
        return None, str(error)


def test_release_artefacts_exist_and_are_small():
    assert "0.1.0" in RELEASED
    assert all((released_KEPT / f"{version}.tar.xz").stat().st_size < LARGEST for version in RELEASED)


@pytest.mark.parametrize("name", TINY)
def test_every_artefact_opens_or_names_its_version_and_the_remedy(folder, name):
    found = stages(folder, name)
    assert len(found) >= (6 if name == "bench" else 9)
    for stage, path in found:
        own, error = opened(path)
        if own is None:
            assert "format version" in error
            assert "--force" in error
            continue
        assert own.header.stage == stage.name
        assert own.message
        for dataset in own.paths():
            assert own[dataset].size >= 0


@pytest.mark.parametrize("name", TINY)
def test_release_records_are_complete_or_report_version(folder, name):
    for stage, path in stages(folder, name):
        if stage.name not in RECORDS[name]:
            continue
        own, _ = opened(path)
        if own is None:  # the test above says how
            continue
        record = read(RECORDS[name][stage.name], own)
        for field in fields(RECORDS[name][stage.name]):
            error = ""
            try:
                getattr(record, field.name)
            except ArtefactError as raised:
                error = str(raised)
            assert not error or own.header.version != stage.version, f"{stage.name}: {error}"
            assert not error or "--force" in error


def test_another_format_is_refused_by_both_numbers_and_computed_anew(folder, monkeypatch):
    monkeypatch.setattr(artefacts, "FORMAT_VERSION", 99)
    job = job_of(folder / "structure.yaml", folder / "results")
    with pytest.raises(ArtefactError, match=r"format version \d+, by strainsight [\d.]+; .* reads version 99") as caught:
        Artefact(job.folder / "rom.h5")
    assert "--force" in caught.value.remedy
    first = plan(stages_of(job), job)[0]
    assert first.status != UP_TO_DATE
    assert any("reads version 99" in reason for reason in first.reasons)
