"""doctor: what it finds here, and what it says of environments that are broken on purpose."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from strainsight_cli import doctor
from strainsight_cli.doctor import FAILS, GOOD, WARNING, DoctorFinding, show
from strainsight_cli.main import app

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def found(tmp_path_factory) -> dict[str, DoctorFinding]:
    done = CliRunner().invoke(app, ["doctor", "--json", "--results", str(tmp_path_factory.mktemp("doctor") / "none")])
    assert done.exit_code == 0, done.output
    return {finding["subject"]: DoctorFinding(**finding) for finding in map(json.loads, done.stdout.splitlines())}


@pytest.mark.slow
def test_doctor_passes_and_runs_every_check(found):
    assert {"python", "numpy", "solver", "solver: slepc", "rendering", "cores"} <= found.keys()
    assert {"memory", "disk", "locale", "terminal"} <= found.keys()
    assert not [finding for finding in found.values() if finding.result == FAILS]
    assert found["solver"].value.startswith(("PARDISO, 8000 degrees of freedom", "SuperLU, 8000 degrees of freedom"))


@pytest.mark.slow
def test_every_package_of_pyproject_is_compared_with_its_range(found):
    _, asked = doctor.asked_for()
    assert any(line.startswith("numpy>=") for line in asked)
    names = {line.partition(">=")[0] for line in asked}
    assert names - found.keys() <= {"pypardiso"}


def test_versions_out_of_range_and_missing_packages_have_a_remedy():
    elsewhere = "none-on-any-machine>=1; platform_machine == 'abacus'"
    python, numpy, missing = doctor.compared(">=99", ["numpy>=99.0", "no-such-package>=1", elsewhere])
    assert (python.result, numpy.result, missing.result) == (FAILS, FAILS, FAILS)
    assert numpy.value.endswith(", but >=99.0 is required")
    assert numpy.remedy == "pip install 'numpy>=99.0'"
    assert "not installed" in missing.value


def test_missing_pardiso_is_explained(tmp_path, monkeypatch):
    (tmp_path / "pypardiso.py").write_text("raise OSError('no libmkl_rt')", encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    solver = doctor.check_solver()
    assert solver.result == WARNING
    assert "SuperLU" in solver.value
    assert "OSError: no libmkl_rt" in solver.value
    assert "100 000 degrees of freedom" in solver.value


def test_crashed_or_empty_rendering_fails(tmp_path, monkeypatch):
    (tmp_path / "pyvista.py").write_text("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    died = doctor.check_rendering()
    assert (died.result, died.value) == (FAILS, "off-screen rendering failed: crashed with SIGSEGV")
    assert "libegl1" in died.remedy
    monkeypatch.setattr(doctor, "tried", lambda name: ({"middle": [0, 0, 0], "corner": [0, 0, 0], "seconds": 0.1}, ""))
    blank = doctor.check_rendering()
    assert blank.value == "off-screen rendering failed: the picture is empty"


@pytest.mark.parametrize(
    ("name", "given", "result"),
    [
        ("OMP_NUM_THREADS", "2", GOOD),
        ("OMP_NUM_THREADS", "1,2", GOOD),
        ("OMP_NUM_THREADS", "8", WARNING),
        ("MKL_NUM_THREADS", "many", WARNING),
        ("MKL_NUM_THREADS", "0", WARNING),
    ],
)
def test_thread_variables(name, given, result):
    finding = doctor.check_threads({name: given}, cores=4 if given != "8" else 2)[1]
    assert (finding.subject, finding.result) == (name, result)
    assert bool(finding.remedy) == (result == WARNING)


def test_the_memory_model_is_what_was_measured():
    rows = [
        line.split("|")[2:9:6]
        for line in (ROOT / "docs" / "measured.md").read_text("utf-8").splitlines()
        if "| shell |" in line
    ]
    assert [(int(n.replace(" ", "")), float(gib.strip(" *"))) for n, gib in rows] == list(doctor.PEAKS)
    for unknowns, peak in doctor.PEAKS:
        assert doctor.largest_model(peak) == pytest.approx(unknowns)
    sizes = [doctor.largest_model(gib) for gib in (0.05, 0.15, 0.2, 1.0, 3.0, 10.0, 17.4, 64.0)]
    assert sizes == sorted(sizes)


@pytest.mark.parametrize(("gib", "result"), [(0.1, FAILS), (1.0, WARNING), (8.0, GOOD), (float("inf"), WARNING)])
def test_memory(gib, result, monkeypatch):
    monkeypatch.setattr("strainsight.memory.available_memory", lambda: gib * doctor.GIB)
    assert doctor.check_memory().result == result


def test_a_results_folder_that_is_a_file_fails_and_one_that_is_missing_does_not(tmp_path):
    (tmp_path / "file").touch()
    assert doctor.check_disk(tmp_path / "file").result == FAILS
    assert doctor.check_disk(tmp_path / "none" / "deeper").result != FAILS
    assert not (tmp_path / "none").exists()


def test_a_failure_is_exit_code_one_and_its_remedy_is_shown(capsys):
    assert show([DoctorFinding("a", GOOD, "b"), DoctorFinding("c", WARNING, "d", "e")], False) == 0
    assert show([DoctorFinding("x", FAILS, "y \x1b[2J", "mend it")], False) == 1
    said = capsys.readouterr().out
    assert "→ mend it" in said
    assert "\x1b" not in said
