"""The code that a stage is made of: what it reaches by imports, and what is said of artefacts that other code made."""

from __future__ import annotations

import ast
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import strainsight
from strainsight.stages.modes import MODES
from strainsight.workflow import code
from strainsight.workflow.artefact import Artefact
from strainsight.workflow.output import Dataset, Output
from strainsight.workflow.plan import OTHER_CODE, UP_TO_DATE, Job, plan
from strainsight.workflow.runner import run as run_stages
from strainsight.workflow.stage import Stage

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
