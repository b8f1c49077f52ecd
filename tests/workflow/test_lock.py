"""Who holds the lock of a results folder, and what its file may be."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from strainsight.errors import UserError
from strainsight.workflow.lock import COMPUTING, NAME, computing, locked

KEY = "f" * 64


def test_a_second_holder_is_refused_and_the_file_goes_with_the_first(tmp_path):
    with locked(tmp_path) as left_by:
        assert left_by is None
        with pytest.raises(UserError, match=r"another run \(process \d+\)"), locked(tmp_path):
            pass
    assert not (tmp_path / NAME).exists()


def test_what_a_killed_run_has_left_is_named_and_taken(tmp_path):
    (tmp_path / NAME).write_text("4711\n")
    with locked(tmp_path) as left_by:
        assert left_by == 4711


def test_a_link_in_place_of_a_lock_leaves_the_file_it_names_alone(tmp_path):
    other = tmp_path / "other.txt"
    other.write_text("mine\n")
    for name in (NAME, COMPUTING):
        (tmp_path / name).symlink_to(other)
    with locked(tmp_path) as left_by, computing(tmp_path, KEY):
        assert left_by is None
    assert other.read_text() == "mine\n"


@pytest.mark.parametrize("number", [errno.EROFS, errno.EACCES, errno.EPERM])
def test_a_folder_that_became_read_only_meanwhile_is_no_error(tmp_path, monkeypatch, number):
    """The run is done, and what it leaves is a lock that nobody holds."""

    def refused(self, missing_ok=False):
        raise OSError(number, "read-only")

    with monkeypatch.context() as patched, locked(tmp_path):  # the lock is given back first
        patched.setattr(Path, "unlink", refused)
    assert (tmp_path / NAME).exists()
    with locked(tmp_path):
        pass
    assert not (tmp_path / NAME).exists()
