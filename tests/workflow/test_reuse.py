"""Taking over what a run beside has done: what was checked is what is taken, and only artefacts are shared on the disk."""

from __future__ import annotations

import errno
import fcntl
import os
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from strainsight.workflow import artefact as artefacts
from strainsight.workflow import reuse
from strainsight.workflow.lock import computing
from strainsight.workflow.output import Dataset, Output
from strainsight.workflow.plan import Job
from strainsight.workflow.runner import run
from strainsight.workflow.stage import Stage

KEY = "0" * 14 + "7" + "0" * 49
HOLDER = """
import sys, time, pathlib
from strainsight.workflow.lock import computing
with computing(pathlib.Path(sys.argv[1]), sys.argv[2]):
    print("held", flush=True)
    sys.stdin.read()
"""


def look(context) -> Output:
    return Output({"/x": Dataset(np.ones(3), "m", "x")}, {}, "", files={"page.html": b"<html>"})


def stage(version: int = 1) -> Stage:
    return Stage("look", version, ("by",), (), (), look)


def job_of(results: Path, name: str, by: int = 1) -> Job:
    return Job({"name": name, "by": by}, results, results)


def source_of(job: Job) -> str:
    (*_, event) = run((stage(),), job)
    assert event.artefact.path == job.folder / "look.h5"
    return event.artefact.source


@pytest.fixture
def results(tmp_path) -> Path:
    assert source_of(job_of(tmp_path, "first")) == ""
    return tmp_path


def test_an_artefact_is_one_file_and_what_people_edit_is_a_copy(results):
    assert source_of(job_of(results, "second")) == "first"
    assert os.path.samefile(results / "first" / "look.h5", results / "second" / "look.h5")
    with (results / "second" / "page.html").open("a") as stream:
        stream.write("mine")
    assert (results / "first" / "page.html").read_bytes() == b"<html>"
    assert {path.name for path in (results / "second").iterdir()} == {"look.h5", "page.html"}


def test_a_record_stays_where_another_runs_takes_its_place(results):
    """What a file said may have been built, whoever made the next one."""
    record = replace(stage(), records=("page.html",))
    (results / "mine").mkdir()
    (results / "mine" / "page.html").write_bytes(b"built by")
    (*_, event) = run((record,), job_of(results, "mine"))
    assert event.artefact.source == "first"
    assert (results / "mine" / "page.html").read_bytes() == b"<html>"
    assert [path.read_bytes() for path in (results / "mine").glob("page-*.html")] == [b"built by"]


def test_a_link_is_followed_to_the_file(results):
    (results / "first" / "look.h5").rename(results / "elsewhere.h5")
    (results / "first" / "look.h5").symlink_to("../elsewhere.h5")
    assert source_of(job_of(results, "second")) == "first"
    assert not (results / "second" / "look.h5").is_symlink()


@pytest.mark.parametrize("changed", ["look.h5", "page.html"])
def test_what_is_replaced_while_it_is_taken_is_passed_over(results, changed, monkeypatch):
    source_of(job_of(results, "second"))
    source_of(job_of(results, "other", by=2))
    real = reuse._part

    def late(source: Path, folder: Path) -> Path:
        if source == results / "first" / changed:
            os.replace(results / "other" / changed, source)
            source.write_bytes(source.read_bytes() + b"x" * (changed == "page.html"))
        return real(source, folder)

    monkeypatch.setattr(reuse, "_part", late)
    assert source_of(job_of(results, "third")) == "second"
    assert {path.name for path in (results / "third").iterdir()} == {"look.h5", "page.html"}


def test_a_disk_without_links_gets_a_copy(results, monkeypatch):
    def refused(*_):
        raise OSError(errno.EPERM, "no links here")

    monkeypatch.setattr(os, "link", refused)
    assert source_of(job_of(results, "second")) == "first"
    assert not os.path.samefile(results / "first" / "look.h5", results / "second" / "look.h5")


def test_files_of_another_key_are_hashed_once_and_their_content_is_not_read(results, monkeypatch):
    source_of(job_of(results, "other", by=2))
    for path in results.glob("*/look.h5"):
        os.utime(path, (time.time() - 60,) * 2)
    hashed, read = [], []
    intact, digest = artefacts.is_intact, artefacts.content_digest
    monkeypatch.setattr(artefacts, "is_intact", lambda path: hashed.append(path.parent.name) or intact(path))
    monkeypatch.setattr(artefacts, "content_digest", lambda file: read.append(file.filename) or digest(file))
    for name in ("second", "third"):
        assert reuse.reused(stage(2), job_of(results, name), "f" * 64) is None
    assert sorted(hashed) == ["first", "other"]
    assert read == []


def test_who_waits_for_another_process_says_so(tmp_path):
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER, str(tmp_path), KEY], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as holder:
        holder.stdout.readline()
        said = []

        def waits():
            said.append(holder.poll())
            holder.stdin.close()

        with computing(tmp_path, KEY, waits):
            assert holder.wait(10) == 0
        with computing(tmp_path, KEY, waits):
            pass
    assert said == [None]


def test_a_disk_without_locks_is_no_failure(tmp_path, monkeypatch):
    def refused(*_):
        raise OSError(errno.ENOLCK, "no locks available")

    monkeypatch.setattr(fcntl, "lockf", refused)
    with computing(tmp_path, KEY, lambda: pytest.fail("there is nobody to wait for")):
        pass
