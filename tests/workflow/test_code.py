"""The code and the commit that artefacts are made of, and numbers that change with the version of their stage alone."""

from __future__ import annotations

import ast
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import strainsight
from strainsight.stages.modes import MODES
from strainsight.workflow import code, provenance
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.output import Dataset, Output
from strainsight.workflow.plan import NO_CODE, OTHER_CODE, UP_TO_DATE, Job, plan
from strainsight.workflow.provenance import commit_of
from strainsight.workflow.runner import run as run_stages
from strainsight.workflow.stage import Stage

from .numbers import KEPT, differs, numbers_of, size

ROOT = Path(strainsight.__file__).parent


def stage(version=1):
    return Stage(
        "toy", version, (), (), (), lambda context: Output({"/x": Dataset([1.0], "m", "x")}, summary={}, message="")
    )


def test_a_stage_reaches_what_python_finds_by_parsing_its_imports():
    found = code.closure(MODES.run.__module__)
    assert {"strainsight.stages.modes", "strainsight.fem.modes", "strainsight.mesh.model"} <= found
    assert "strainsight.estimation.bank" not in found
    for name in found:
        path = ROOT.joinpath(*name.split(".")[1:])
        file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("strainsight"):
                assert node.module in found
            if isinstance(node, ast.Import):
                assert all(own.name in found for own in node.names if own.name.startswith("strainsight"))


def test_another_source_of_a_module_within_makes_another_code_and_one_beside_does_not(monkeypatch):
    before, source = code.code_of(MODES.run), code._source
    for module, same in (("strainsight.fem.modes", False), ("strainsight.estimation.bank", True)):
        monkeypatch.setattr(
            code,
            "_digest",
            lambda name, other=module: code.hashlib.sha256(source(name) + b"#" * (name == other)).digest(),
        )
        assert (code.code_of(MODES.run) == before) is same


def test_what_is_loaded_by_name_and_what_a_page_is_drawn_with_are_code():
    """Readers of measurements, processes of their own, styles and scripts: all that lie in the package."""
    estimate, report = (code.closure(f"strainsight.stages.{name}") for name in ("estimate", "report"))
    assert {f"strainsight.measurements.{name}" for name in ("mdf", "tdms", "mat", "hdf5_file")} <= estimate
    parts = {path.relative_to(ROOT).as_posix() for path in ROOT.rglob("*") if path.suffix in (".css", ".js")}
    assert len(parts) >= 6
    benches = code.closure("strainsight.stages.bench.report")
    assert parts <= report | benches
    assert {part for part in parts if part.startswith(("page/", "space/"))} <= report


def test_of_an_artefact_that_another_run_made_other_code_is_reported(tmp_path, monkeypatch):
    for name, own, said in (("first", "one", ""), ("second", "two", f" ({OTHER_CODE})"), ("third", "one", "")):
        monkeypatch.setattr("strainsight.workflow.runner.code_of", lambda run, own=own: own)
        monkeypatch.setattr("strainsight.workflow.plan.code_of", lambda run, own=own: own)
        (_, event) = run_stages([stage()], Job({"name": name}, tmp_path, tmp_path / "results"))
        assert event.reason == "never run" + (f", reused from first{said}" if name != "first" else "")


def test_an_artefact_without_a_digest_is_not_one_of_other_code(tmp_path, monkeypatch):
    job = Job({"name": "own"}, tmp_path, tmp_path / "results")
    with monkeypatch.context() as without:
        without.setattr("strainsight.workflow.runner.code_of", lambda run: "")
        list(run_stages([stage()], job))
    (status,) = plan([stage()], job)
    assert status.reasons == (NO_CODE,)


def test_what_other_code_of_the_same_version_made_is_up_to_date_and_reported_so(tmp_path, monkeypatch):
    job = Job({"name": "own"}, tmp_path, tmp_path / "results")
    list(run_stages([stage()], job))
    (status,) = plan([stage()], job)
    assert (status.status, status.reasons) == (UP_TO_DATE, ())
    own = Artefact(job.folder / "toy.h5")
    assert own.header.code == code.code_of(stage().run)
    monkeypatch.setattr("strainsight.workflow.plan.code_of", lambda run: "another")
    (status,) = plan([stage()], job)
    assert (status.status, status.reasons) == (UP_TO_DATE, (OTHER_CODE,))
    (event,) = run_stages([stage()], job)
    assert (event.status, event.reason) == (UP_TO_DATE, OTHER_CODE)
    (status,) = plan([stage(2)], job)
    assert status.reasons == ("stage version 1 → 2",)
    assert replace(own.header, code="") != own.header


def test_a_function_of_another_package_has_its_own_file(tmp_path, monkeypatch):
    (tmp_path / "own_stage.py").write_text("def run(context): ...\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    import own_stage

    try:
        assert code.closure("own_stage") == {"own_stage"}
        assert len(code.code_of(own_stage.run)) == 16
    finally:
        del sys.modules["own_stage"]


@pytest.mark.parametrize("name", ["strainsight.no_such_module", "numpy_that_is_not_there"])
def test_what_is_not_there_has_no_source(name):
    assert code._source(name) == b""


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
    """On a branch, packed, detached and in a worktree; none where there is no repository."""
    head = git("rev-parse", "HEAD")
    assert commit_of(tmp_path / "own") == head
    git("pack-refs", "--all")
    assert commit_of(tmp_path / "own") == head
    git("worktree", "add", "--quiet", "-b", "other", str(tmp_path / "tree"))
    assert commit_of(tmp_path / "tree") == head
    git("checkout", "--quiet", "--detach")
    assert commit_of(tmp_path / "own") == head
    assert commit_of(tmp_path) == ""


def test_a_system_that_says_nothing_of_its_processor(monkeypatch, tmp_path):
    monkeypatch.setattr(provenance, "CPU", tmp_path / "none")
    assert isinstance(provenance._processor(), str)


def test_numbers_change_with_the_version_of_their_stage_alone(tmp_path):
    """Those of all stages of a small beam and a small bench are kept in numbers.json, with the versions that made them."""
    kept, found = json.loads(KEPT.read_text(encoding="utf-8")), numbers_of(tmp_path)
    raised = [stage for stage, own in found.items() if own["version"] != kept.get(stage, {}).get("version")]
    assert not raised, f"{raised} have a new version: renew numbers.json, python -m tests.workflow.numbers"
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


def test_a_number_that_moves_is_seen():
    assert not differs([3, 1.0, 0.1], [3, 1.0 + 1e-6, 0.1 + 1e-6])
    assert differs([3, 1.0, 0.1], [3, 1.0 + 1e-4, 0.1])
    assert differs([3, 1.0, 0.1], [4, 1.0, 0.1])
    assert differs([3, 1.0, 0.1], [3, 1.0, 0.1 + 1e-4])


@pytest.mark.parametrize("shape", [(7,), (3, 2), (40, 25), (300, 300)])
@pytest.mark.parametrize("change", ["sign", "one sign", "order", "two exchanged", "rounding"])
def test_a_flipped_sign_and_a_swapped_order_are_seen_and_rounding_is_not(shape, change):
    x = 1e-6 * np.random.default_rng(0).standard_normal(shape)
    y = x.copy().ravel()
    if change == "sign":
        y = -y
    elif change == "one sign":
        y[np.argmax(np.abs(y))] *= -1
    elif change == "order":
        y = y[::-1]
    elif change == "two exchanged":
        low, high = np.argmin(y), np.argmax(y)
        y[[low, high]] = y[[high, low]]
    else:
        y *= 1 + 1e-7 * np.random.default_rng(1).uniform(-1, 1, y.shape)
    assert differs(size(y.reshape(shape)), size(x)) == (change != "rounding")


def test_where_a_number_is_missing_counts():
    assert differs(size(np.array([np.nan, 1.0, 2.0])), size(np.array([1.0, np.nan, 2.0])))
