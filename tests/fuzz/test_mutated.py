"""Damaged files of every format end in a message of the product, soon, in little memory, and touch nothing else.

A small share of `make fuzz`, which reads 20 000 of each group, and 3000 altered models.
"""

from __future__ import annotations

import sys

import pytest

from strainsight.errors import UserError

from ..robustness.processes import Launcher
from . import structured
from .campaign import faults
from .cases import Group, companions
from .commands import command_faults
from .readers import READERS
from .seeds import write_seeds

SHARE = {"config": 250, "deck": 900, "measurement": 900, "results": 900}
"""Group → damaged files that are read here."""
SEED = 10
pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the limits of a process are those of Linux")


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz") / "seeds"
    write_seeds(folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_the_sound_files_are_read(seeds, tmp_path, name):
    companions(name, seeds / name, tmp_path / "work")
    here = {} if name == "config" else {"sandboxed": False}
    for path in Group(name, seeds / name).files:
        said = []
        for choice in range(1, 13):
            try:
                READERS[name](tmp_path / "work" / path, choice, **here)
                break
            except UserError as error:
                said.append(str(error))
        else:
            pytest.fail(f"{path}: {said[0]}")


@pytest.mark.slow
@pytest.mark.parametrize("name", READERS)
def test_damaged_files_are_refused_or_read(seeds, tmp_path, name):
    assert faults(name, seeds, tmp_path / "work", SEED, 0, SHARE[name]) == []


@pytest.mark.slow
def test_no_damaged_file_is_an_internal_error_of_the_command_line(seeds, tmp_path):
    with Launcher(tmp_path) as launcher:
        assert command_faults(launcher, seeds, tmp_path / "work", seed=10, first=0, last=12) == []


def test_altered_models_are_taken_or_refused(tmp_path):
    assert structured.faults(2, 0, 2, tmp_path) == {}
