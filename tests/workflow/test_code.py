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
from strainsight.workflow.plan import NO_CODE, OTHER_CODE, UP_TO_DATE, Job, plan
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
