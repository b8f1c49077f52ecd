"""A view as a PNG, or in a window: either way drawn by a child process."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace

from strainsight.errors import StrainsightError, UserError
from strainsight.imports import FOLDER
from strainsight.pages.picture.scene import draw_apart, last_words, thinned
from strainsight.pages.view.viewed import NO_DISPLAY, View
from strainsight.processes import inherited, python

CHILD = "strainsight.pages.view.viewer"
TIME_LIMIT = 300.0
"""For a screenshot [s]."""


def screenshot(view: View) -> bytes:
    """PNG of the view on white. Raises StrainsightError that names the Debian packages where nothing can render."""
    return screenshots([view])[0]


def screenshots(views: Sequence[View]) -> list[bytes]:
    """A picture of each, as `screenshot` makes it, by one child process."""
    return draw_apart(CHILD, [_sent(view) for view in views], TIME_LIMIT)


def window(view: View) -> None:
    """Show the view until its window is closed. Raises UserError without a display, StrainsightError if the window crashes."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise _no_display("there is no display to open a window on")
    # By stdin and not by a file: nothing is left behind where this process is interrupted.
    shown = pickle.dumps(_sent(view))
    done = subprocess.run(python(CHILD), env=inherited(), cwd=FOLDER, input=shown, stderr=subprocess.PIPE, check=False)
    if done.returncode == NO_DISPLAY:
        raise _no_display("the display does not answer")
    if done.returncode:
        text = last_words(done.stderr.decode(errors="replace"))
        raise StrainsightError(
            f"the window broke off (exit code {done.returncode}{text})",
            remedy="draw it into a file instead: --screenshot FILE.png",
        )


def _sent(view: View) -> View:
    return replace(view, layout=thinned(view.layout))


def _no_display(what: str) -> UserError:
    return UserError(what, remedy="draw it into a file: --screenshot FILE.png")
