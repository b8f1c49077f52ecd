"""Taking over what a run beside has done: what was checked is what is taken, and only artefacts are shared on the disk."""

from __future__ import annotations

import errno
import fcntl
import hashlib
import json
import os
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from strainsight.errors import ArtefactError
from strainsight.runner import runner
from strainsight.runner.artefact import header_of, seal
from strainsight.runner.output import Dataset, Output
from strainsight.runner.plan import Job
from strainsight.runner.runner import computing, run
from strainsight.runner.stage import Stage

KEY = "0" * 14 + "7" + "0" * 49


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
def test_artefact_replaced_during_copy_is_skipped(results, changed, monkeypatch):
    source_of(job_of(results, "second"))
    source_of(job_of(results, "other", by=2))
    name = {"look.h5": "_shared", "page.html": "_copy_sibling"}[changed]
    real = getattr(runner, name)

    def late(source: Path, *rest):
        if source == results / "first" / changed:
            os.replace(results / "other" / changed, source)
            source.write_bytes(source.read_bytes() + b"x" * (changed == "page.html"))
        return real(source, *rest)

    monkeypatch.setattr(runner, name, late)
    assert source_of(job_of(results, "third")) == "second"
    assert {path.name for path in (results / "third").iterdir()} == {"look.h5", "page.html"}


def sealed_anew(path: Path, **attributes) -> None:
    """As a stranger writes it, who can seal what he likes."""
    with h5py.File(path, "r+") as file:
        file.attrs.update({name: json.dumps(value) for name, value in attributes.items()})
    seal(path)


def digest_of(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


SECRET = b"what lies outside"
LONGER = b"<html> and more"


def at(name: str, content: bytes, make, stated: bytes | None = None):
    """A file beside `look.h5` and what the artefact says of it."""
    stated = content if stated is None else stated
    return name, digest_of(stated), len(stated), make


def link_to(target: str):
    return lambda path, outside: path.symlink_to(outside if target == "file" else target)


STRANGE = {
    "a device": at("/dev/null", b"", lambda path, outside: None),
    "a link to a device": at("page.html", b"", link_to("/dev/null")),
    "a link to a file outside": at("page.html", SECRET, link_to("file")),
    "a path to a file outside": at("../../outside", SECRET, lambda path, outside: None),
    "a pipe": at("page.html", b"", lambda path, outside: os.mkfifo(path)),
    "a folder": at("page.html", b"", lambda path, outside: path.mkdir()),
    "a file larger than stated": at("page.html", b"", lambda path, outside: path.write_bytes(LONGER), LONGER[:6]),
    "a file of other content": at("page.html", b"", lambda path, outside: path.write_bytes(LONGER[::-1]), LONGER),
    "a hidden file": at(".lock", SECRET, lambda path, outside: path.write_bytes(SECRET)),
    "another artefact": at("place.h5", SECRET, lambda path, outside: path.write_bytes(SECRET)),
}


@pytest.mark.parametrize("case", STRANGE)
def test_only_plain_files_of_the_stated_size_and_digest_are_copied(tmp_path, case):
    name, digest, size, make = STRANGE[case]
    results = tmp_path / "results"
    source_of(job_of(results, "first"))
    outside = tmp_path / "outside"
    outside.write_bytes(SECRET)
    (results / "first" / "page.html").unlink()
    make(results / "first" / name, outside)
    sealed_anew(results / "first" / "look.h5", side_files={name: digest}, sizes={name: size})
    assert source_of(job_of(results, "second")) == ""
    assert {path.name for path in (results / "second").iterdir()} == {"look.h5", "page.html"}
    assert (results / "second" / "page.html").read_bytes() == b"<html>"


def test_a_file_that_is_mostly_holes_is_not_copied(results):
    page = results / "first" / "page.html"
    with page.open("wb") as stream:
        stream.truncate(runner.LARGEST + 1)
    with pytest.raises(ArtefactError, match="differs from the file that the stage wrote"):
        runner._copy_sibling(page, runner.LARGEST + 1, "0" * 64, results / "part")
    assert (results / "part").stat().st_size == 0


def test_an_artefact_has_nothing_outside_its_folder_removed(tmp_path):
    outside = tmp_path / "outside"
    outside.write_bytes(SECRET)
    source_of(job_of(tmp_path / "results", "first"))
    artefact = tmp_path / "results" / "first" / "look.h5"
    sealed_anew(artefact, side_files={"../../outside": digest_of(SECRET)}, sizes={"../../outside": len(SECRET)})
    with pytest.raises(ArtefactError, match="a file with an invalid name"):
        header_of(artefact)
    source_of(job_of(tmp_path / "results", "first"))
    assert outside.read_bytes() == SECRET


def test_a_disk_without_links_gets_a_copy(results, monkeypatch):
    def refused(*_):
        raise OSError(errno.EPERM, "no links here")

    monkeypatch.setattr(os, "link", refused)
    assert source_of(job_of(results, "second")) == "first"
    assert not os.path.samefile(results / "first" / "look.h5", results / "second" / "look.h5")


def test_a_disk_without_locks_is_no_failure(tmp_path, monkeypatch):
    def refused(*_):
        raise OSError(errno.ENOLCK, "no locks available")

    monkeypatch.setattr(fcntl, "lockf", refused)
    with computing(tmp_path, KEY, lambda: pytest.fail("there is nobody to wait for")):
        pass
