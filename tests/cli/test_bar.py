"""The bar on a terminal: time left, colours only where they are wanted; nothing at all in a pipe."""

from __future__ import annotations

import os
import pty
import re
import subprocess
import sys

import pytest

SCRIPT = """
import time
from strainsight_cli.bar import progress_bar
from strainsight_cli.clock import Left
with progress_bar(True) as move:
    move("run [1]", "place", "so {far} [red]", 0.5, Left(time.time() + 42.5, 75.0))
    time.sleep(0.3)
    move("run [1]", "", "", 1.0, Left())
"""
COLOUR = re.compile(rb"\x1b\[[0-9;]*[0-9]m")


def drawn(environment: dict[str, str]) -> bytes:
    own, its = pty.openpty()
    clean = {key: value for key, value in os.environ.items() if key not in ("NO_COLOR", "FORCE_COLOR")}
    settings = {**clean, "TERM": "xterm", "COLUMNS": "160", **environment}
    process = subprocess.Popen([sys.executable, "-c", SCRIPT], stderr=its, stdout=its, env=settings)
    os.close(its)
    said = b""
    while True:
        try:
            part = os.read(own, 65536)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        said += part
    os.close(own)
    assert process.wait(timeout=60) == 0
    return said


@pytest.mark.parametrize(("environment", "coloured"), [({}, True), ({"NO_COLOR": "1"}, False)])
def test_it_says_what_is_left_as_it_is_written(environment, coloured):
    said = drawn(environment)
    assert b"about 0:42 left, then 1:15" in COLOUR.sub(b"", said)
    assert b"so {far} [red]" in COLOUR.sub(b"", said)
    assert b"run [1]" in COLOUR.sub(b"", said)
    assert bool([code for code in COLOUR.findall(said) if code != b"\x1b[0m"]) == coloured


def test_there_is_none_in_a_pipe():
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
