"""Processes without streams, folder or memory, configs that are no files, and names that are attacks."""

from __future__ import annotations

import errno
import os
import subprocess
import sys

import pytest

from strainsight.config.load import load_config
from strainsight.errors import ConfigError
from strainsight_cli.failures import failure_of

from ..shared import slowly

COMMAND = [sys.executable, "-m", "strainsight_cli.main"]
posix = pytest.mark.skipif(os.name != "posix", reason="the shell and the limits of POSIX")


def shell(line, folder, *words):
    return subprocess.run(["sh", "-c", line, "sh", *COMMAND, *words], cwd=folder, capture_output=True, text=True, timeout=60)


@posix
@pytest.mark.parametrize("closed", ["<&- >&- 2>&-", *slowly(">&-", "2>&-", ">&- 2>&-")])
def test_a_process_without_streams_does_its_work(closed, tmp_path):
    assert shell(f'"$@" {closed}', tmp_path, "status", "nothing.yaml").returncode == 2


@posix
def test_a_working_folder_that_is_gone_is_named(tmp_path):
    (tmp_path / "gone").mkdir()
    done = shell('cd gone && rmdir ../gone && "$@"', tmp_path, "status", "c.yaml")
    assert done.returncode == 2
    assert done.stderr.startswith("the working folder is gone, or may not be read\n    change to")


@posix
def test_too_small_a_limit_of_memory_stops_before_anything_is_loaded(tmp_path):
    done = shell('ulimit -v 300000 && "$@"', tmp_path, "status", "c.yaml")
    assert done.returncode == 2
    assert "the limit of address space is 293 MiB" in done.stderr
    assert "ulimit -v 1048576" in done.stderr


@posix
def test_a_config_that_is_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "c.yaml")
    with pytest.raises(ConfigError, match="is not a plain file"):
        load_config(tmp_path / "c.yaml")


def test_too_many_open_files_are_no_full_disk():
    for number in (errno.EMFILE, errno.ENFILE):
        for error in (OSError(number, os.strerror(number)), OSError(number, os.strerror(number), "results/a.h5")):
            failure = failure_of(error)
            assert failure.code == 2
            assert "ulimit -n" in failure.message


@posix
def test_a_reader_that_has_gone_ends_nothing_and_is_no_failure(tmp_path):
    done = shell('{ "$@" 2>&1; echo $? >&3; } 3>code | true', tmp_path, "status", "nothing.yaml")
    assert (tmp_path / "code").read_text() == "2\n"
    assert done.stderr == ""


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="a device of Linux")
@pytest.mark.parametrize("words", [("schema",), ("--help",)])
def test_output_that_cannot_be_written_is_a_failure(tmp_path, words):
    done = shell('unset PYTHONUNBUFFERED; "$@" >/dev/full', tmp_path, *words)
    assert done.returncode == 2
    assert "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr


@posix
def test_files_do_not_get_the_numbers_of_streams_that_are_closed(tmp_path):
    code = "from strainsight_cli.surroundings import prepare_streams as p; p(); "
    code += "open('n', 'w').write(str(open('a', 'w').fileno()))"
    line = f'{sys.executable} -c "{code}" <&- >&- 2>&-'
    assert subprocess.run(["sh", "-c", line], cwd=tmp_path, timeout=60).returncode == 0
    assert int((tmp_path / "n").read_text()) > 2
