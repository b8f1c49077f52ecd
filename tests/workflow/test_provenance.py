"""The commit of a checkout is what git says, however it keeps it."""

from __future__ import annotations

import os
import shutil
import subprocess

import pytest

from strainsight.workflow import provenance
from strainsight.workflow.provenance import commit_of

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
