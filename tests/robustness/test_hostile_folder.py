"""A working folder full of modules and settings of a stranger: none is loaded, and nothing that is computed changes."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from strainsight.fem.mpi.programs import LACKING

from .whole import compared

COMMAND = """
import sys
from strainsight.sweep import processes
processes.WORTH = 0.0  # other processes at once, however little there is to do
from strainsight_cli.main import main
if __name__ == "__main__":
    main()
"""
"""The console script: a file of another folder, which Python puts on the path."""
SETTINGS = {
    "matplotlibrc": "svg.fonttype: path\nfont.size: 30\nlines.linewidth: 9\naxes.formatter.use_locale: True\nnonsense\n",
    ".numba_config.yaml": "cache_dir: ./cache\ndisable_jit: 1\nboundscheck: 1\n",
    ".petscrc": "-help\n-malloc_debug\n",
    "dask.yaml": "distributed: {worker: {preload: [marker]}}\n",
    "distributed.yaml": "distributed: {worker: {preload: [marker]}}\n",
    ".env": "PYTHONPATH=.\nMPLBACKEND=module://marker\n",
    "pyvenv.cfg": "home = .\n",
    "pyproject.toml": "[tool.strainsight]\nresults = 'elsewhere'\n",
    "x.pth": "import marker\n",
}


@pytest.fixture
def hostile(project, tmp_path) -> Path:
    """The project, with a module of the name of every one that could be imported, and with settings for all libraries."""
    folder = tmp_path / "folder"
    shutil.copytree(project, folder)
    names = {*sys.stdlib_module_names, *packages_distributions(), "sitecustomize", "usercustomize", "strainsight", "marker"}
    for name in filter(str.isidentifier, names):
        (folder / f"{name}.py").write_text(f"open({str(tmp_path / 'loaded')!r}, 'a').write({name!r} + '\\n')\n")
    for name, text in SETTINGS.items():
        (folder / name).write_text(text)
    (tmp_path / "strainsight").write_text(COMMAND)
    return folder


def run(hostile: Path, *words: str) -> str:
    command = [sys.executable, str(hostile.parent / "strainsight"), *words]
    done = subprocess.run(command, cwd=hostile, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def loaded(hostile: Path) -> str:
    return path.read_text() if (path := hostile.parent / "loaded").exists() else ""


def test_the_folder_would_be_loaded_from_if_it_were_on_the_path(hostile):
    subprocess.run([sys.executable, "-c", "import joblib, numba"], cwd=hostile, capture_output=True)
    assert "joblib" in loaded(hostile)


def test_no_module_of_the_working_folder_reaches_the_processes_of_a_sweep(hostile):
    assert re.search(r"\nplace +done", run(hostile, "place", "beam.yaml", "--jobs", "2"))
    assert loaded(hostile) == ""


@pytest.mark.slow
def test_no_module_and_no_setting_of_the_working_folder_changes_a_run(hostile, undisturbed):
    """Processes of a sweep, pictures drawn apart, compiled code, and every stage of a placement and of a bench."""
    before = {path.name for path in hostile.iterdir()}
    for name, last in (("beam", "validate.h5"), ("bench", "field.h5")):
        run(hostile, "run", f"{name}.yaml", "--jobs", "2")
        assert set(compared(hostile / "results" / name, undisturbed / name)) >= {"report.html", last}
    run(hostile, "figures", "beam.yaml")
    assert b"stroke-width: 9" not in b"".join(path.read_bytes() for path in hostile.glob("results/beam/figures/*.svg"))
    assert loaded(hostile) == ""
    assert {path.name for path in hostile.iterdir()} == before | {"results"}


@pytest.mark.slow
def test_no_module_of_the_working_folder_reaches_a_suite_in_processes_and_the_reader_of_a_file(hostile):
    (hostile / "suite.yaml").write_text(
        "kind: suite\nname: two\ntitle: Two\nruns:\n"
        "  - {config: beam.yaml, name: a, label: a, until: modes}\n"
        "  - {config: beam.yaml, name: b, label: b, set: {rom.modes: 3}, until: modes}\n"
    )
    run(hostile, "run", "suite.yaml", "--jobs", "2")
    (hostile / "mesh.vtk").write_text(
        "# vtk DataFile Version 2.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 4 float\n0 0 0 1 0 0 0 1 0 0 0 1\n"
        "CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\n"
    )
    run(hostile, "init", "mesh.vtk")
    assert loaded(hostile) == ""


def test_an_interpreter_that_is_asked_for_its_packages_takes_none_of_the_working_folder(hostile):
    done = subprocess.run([sys.executable, "-c", LACKING], cwd=hostile, capture_output=True, text=True, check=True)
    assert re.fullmatch(r"[\w ]*\n", done.stdout)
    assert loaded(hostile) == ""
