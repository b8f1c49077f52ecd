"""The real window of `view`, on an X server without a screen: its title, and what ends it."""

from __future__ import annotations

import os
import pickle
import shutil
import signal
import subprocess
import sys
import time

import pytest

from strainsight.pages.picture.scene import inherited
from strainsight.pages.view.viewing import View

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        not (shutil.which("Xvfb") and shutil.which("xwininfo")), reason="needs Debian's xvfb and x11-utils"
    ),
]
PATIENCE = 90.0
"""[s] on a busy machine."""


@pytest.fixture
def display():
    """DISPLAY of an X server of this test's own."""
    reading, writing = os.pipe()
    # without -noreset it starts anew whenever its last client goes, as xwininfo does, and refuses who comes meanwhile
    command = ["Xvfb", "-displayfd", str(writing), "-screen", "0", "1500x1000x24", "-nolisten", "tcp", "-noreset"]
    server = subprocess.Popen(command, pass_fds=[writing], stderr=subprocess.DEVNULL)
    os.close(writing)
    with os.fdopen(reading) as number:
        yield f":{number.readline().strip()}"
    server.terminate()
    server.wait()


@pytest.fixture
def window(beam, display, tmp_path):
    """A shell that stands for the process which asked for the window, and the number of the one that shows it."""
    view = tmp_path / "view"
    view.write_bytes(pickle.dumps(View('a beam of "5 $"', beam)))
    shell = f'"{sys.executable}" -P -m strainsight.pages.view.viewing < "{view}" & echo $!; wait'
    asked = subprocess.Popen(
        ["sh", "-c", shell], stdout=subprocess.PIPE, text=True, env={**inherited(), "DISPLAY": display}
    )
    child = int(asked.stdout.readline())
    _until(lambda: '"strainsight: a beam of "5 $""' in _windows(display))
    yield asked, child
    asked.kill()
    asked.wait()
    asked.stdout.close()
    if _lives(child):
        os.kill(child, signal.SIGKILL)


def test_ctrl_c_ends_it(window):
    _, child = window
    os.kill(child, signal.SIGINT)
    _until(lambda: not _lives(child))


def test_it_ends_with_the_process_that_asked_for_it(window):
    asked, child = window
    time.sleep(1.0)
    assert _lives(child)
    asked.kill()
    asked.wait()
    _until(lambda: not _lives(child))


def _windows(display):
    return subprocess.run(["xwininfo", "-root", "-tree", "-display", display], capture_output=True, text=True).stdout


def _lives(process):
    """Whether it is there and no zombie."""
    found = subprocess.run(["ps", "-o", "stat=", "-p", str(process)], capture_output=True, text=True).stdout.strip()
    return bool(found) and not found.startswith("Z")


def _until(true):
    start = time.monotonic()
    while not true():
        assert time.monotonic() - start < PATIENCE
        time.sleep(0.2)
