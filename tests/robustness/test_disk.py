"""A disk that is full, or that nobody may write to: one message with file and remedy, and what was there stays."""

from __future__ import annotations

import functools
import os
import resource
import shutil
import subprocess
from pathlib import Path

import pytest

from ..shared import slowly
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


@pytest.mark.parametrize(("room", "stage"), [(0, "import"), *slowly((60, "place"), (380, "report"))])
def test_a_full_disk_is_reported_and_what_was_there_stays(mounts, project, undisturbed, results, tmp_path, room, stage):
    """room [KiB]: for the log alone, not for what the stage writes, for report.h5 but not for the page beside it."""
    disk, after = tmp_path / "disk", tmp_path / "after"
    disk.mkdir(), after.mkdir()
    run = command(project / "beam.yaml", disk, "--force", stage=stage)
    done = ran([*APART, FULL, "sh", str(room), str(disk), str(results), str(after), *run])
    refused(done, "cannot be written: No space left on device", disk / "beam" / f"{stage}.h5")
    assert set(compared(after / "beam", undisturbed / "beam")) == names(undisturbed / "beam")
    assert not list((after / "beam").glob(".part-*"))


@pytest.mark.parametrize(("limit", "name"), [(30_000, "import.h5"), (300_000, "report.h5")])
@pytest.mark.slow
def test_a_limit_on_the_size_of_files_is_as_a_full_disk(project, undisturbed, results, limit, name):
    """Without a mount; the second is that of the page, which is written beside report.h5."""
    run = command(project / "beam.yaml", results, "--force", stage=Path(name).stem)
    done = ran(run, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
    refused(done, "cannot be written: File too large", results / "beam" / name)
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


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_of_somebody_else_is_reported(project, results):
    (results / "beam").chmod(0o555)
    done = ran(command(project / "beam.yaml", results, "--force"))
    (results / "beam").chmod(0o755)
    refused(done, "Permission denied", results / "beam" / ".lock")
