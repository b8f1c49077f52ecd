"""A disk that is full or that nobody may write to, and a working folder full of modules of a stranger."""

from __future__ import annotations

import functools
import os
import re
import resource
import shutil
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

from strainsight.contrib.mpi.session import LACKING
from strainsight.processes import SAFE_PATH

from .small import command
from .whole import compared, names

APART = ("unshare", "--user", "--map-root-user", "--mount", "sh", "-c")
# Of $1 KiB that are left on a disk of its own the command may have as many; then $4 holds what it left there.
FULL = """
mount -t tmpfs -o size=16m none "$2" && cp -r "$3/." "$2" || exit 99
free=$(df --output=avail -k "$2" | tail -1)
head -c $(((free - $1) * 1024)) /dev/zero > "$2/filler"
room=$1 disk=$2 after=$4; shift 4; "$@"; code=$?
rm "$disk/filler" && cp -r "$disk/." "$after" || exit 98
exit $code
"""
READ_ONLY = 'mount --bind "$1" "$1" && mount -o remount,bind,ro "$1" || exit 99; shift; exec "$@"'


@functools.cache
def _why_not() -> str:
    """Why nothing can be mounted here, "" if it can."""
    if shutil.which("unshare") is None:
        return "there is no `unshare`"
    done = subprocess.run([*APART, "mount -t tmpfs none /tmp"], capture_output=True, text=True, check=False)
    return done.stderr.strip()


@pytest.fixture
def mounts() -> None:
    if _why_not():
        pytest.skip(f"no disk of one's own: {_why_not()}")


@pytest.fixture
def results(undisturbed, tmp_path) -> Path:
    """Results of an earlier run, which are up to date."""
    shutil.copytree(undisturbed, tmp_path / "results")
    return tmp_path / "results"


def refused(done: subprocess.CompletedProcess[str], says: str, path: Path | str) -> None:
    assert done.returncode == 2, done.stderr
    assert f"{path}  " in done.stderr
    assert says in done.stderr
    assert "--results" in done.stderr
    for word in ("Traceback", "internal error", "Exception ignored", "HDF5"):
        assert word not in done.stderr


def ran(words: list[str], **more) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, capture_output=True, text=True, check=False, **more)


@pytest.mark.slow
def test_a_full_disk_is_reported_and_what_was_there_stays(mounts, project, placed, tmp_path):
    (tmp_path / "results" / "beam").mkdir(parents=True)
    for name in ("import.h5", "import.vtkhdf"):
        shutil.copyfile(placed / "beam" / name, tmp_path / "results" / "beam" / name)
    disk, after = tmp_path / "disk", tmp_path / "after"
    disk.mkdir(), after.mkdir()
    run = command(project / "beam.yaml", disk, "--force", stage="import")
    done = ran([*APART, FULL, "sh", "0", str(disk), str(tmp_path / "results"), str(after), *run])
    refused(done, "the file cannot be written: No space left on device", disk / "beam" / "import.h5")
    assert set(compared(after / "beam", placed / "beam")) == {"import.h5", "import.vtkhdf"}
    assert not list((after / "beam").glob(".part-*"))


@pytest.mark.parametrize(("limit", "name"), [(30_000, "import.h5"), (300_000, "report.h5")])
@pytest.mark.slow
def test_a_limit_on_the_size_of_files_is_as_a_full_disk(project, undisturbed, results, limit, name):
    run = command(project / "beam.yaml", results, "--force", stage=Path(name).stem)
    done = ran(run, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
    refused(done, "the file cannot be written: File too large", results / "beam" / name)
    assert set(compared(results / "beam", undisturbed / "beam")) == names(undisturbed / "beam")
    assert not list((results / "beam").glob(".part-*"))
    assert ran(command(project / "beam.yaml", results)).returncode == 0


@pytest.mark.slow
def test_a_read_only_folder_is_reported_and_can_be_looked_at(mounts, project, results):
    def apart(*more: str) -> subprocess.CompletedProcess[str]:
        return ran([*APART, READ_ONLY, "sh", str(results), *command(project / "beam.yaml", results, *more)])

    before = {path: path.stat().st_mtime_ns for path in results.rglob("*")}
    refused(apart("--force"), "Read-only file system", results / "beam" / ".lock")
    refused(apart("--set", "name=other"), "Read-only file system", results / "other")
    looked = apart("--dry-run")
    assert looked.returncode == 0, looked.stderr
    assert looked.stdout.count("up to date") >= 10
    assert {path: path.stat().st_mtime_ns for path in results.rglob("*")} == before


COMMAND = """
import sys
from strainsight import parallel
parallel.WORTH = 0.0  # other processes at once, however little there is to do
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


def within(hostile: Path, *words: str) -> str:
    """What Python prints in that folder, without the setting by which a command in this process protects its children."""
    environment = {name: value for name, value in os.environ.items() if name != SAFE_PATH}
    done = subprocess.run([sys.executable, *words], cwd=hostile, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def run(hostile: Path, *words: str) -> str:
    return within(hostile, str(hostile.parent / "strainsight"), *words)


def loaded(hostile: Path) -> str:
    return path.read_text() if (path := hostile.parent / "loaded").exists() else ""


def test_the_folder_would_be_loaded_from_if_it_were_on_the_path(hostile):
    within(hostile, "-c", "import joblib, numba")
    assert "joblib" in loaded(hostile)


@pytest.mark.slow
def test_no_module_and_no_setting_of_the_working_folder_changes_a_run(hostile, undisturbed):
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
    assert re.fullmatch(r"[\w ]*\n", within(hostile, "-c", LACKING))
    assert loaded(hostile) == ""
