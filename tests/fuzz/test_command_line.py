"""Damaged configs, decks and tables through the command line: exit code 0 or 2, one message, nothing left elsewhere."""

from __future__ import annotations

import sys

import pytest

from ..robustness.processes import Launcher
from .commands import command_faults
from .seeds import write_seeds

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the processes are started as on Linux")


@pytest.mark.slow
def test_no_damaged_file_is_an_internal_error(tmp_path):
    write_seeds(tmp_path / "seeds")
    with Launcher(tmp_path) as launcher:
        assert command_faults(launcher, tmp_path / "seeds", tmp_path / "work", seed=10, first=0, last=12) == []
