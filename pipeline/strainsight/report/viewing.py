"""A view as a PNG, or in a window: either way drawn by a child process."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from strainsight.errors import StrainsightError, UserError
from strainsight.report.offscreen import draw_apart, inherited, last_words
from strainsight.report.viewed import View, pack_view

CHILD = "strainsight.report.viewer"
TIME_LIMIT = 300.0
"""For a screenshot [s]."""


def screenshot(view: View) -> bytes:
    """PNG of the view on white. Raises StrainsightError that names the Debian packages where nothing can render."""
    with tempfile.TemporaryDirectory(prefix="strainsight-view-") as folder:
        arrays, picture = _written(view, folder), Path(folder, "view.png")
        draw_apart(CHILD, [str(arrays), str(picture)], [picture], Path(folder), TIME_LIMIT)
        return picture.read_bytes()


def window(view: View) -> None:
    """Show the view until its window is closed. Raises UserError without a display, StrainsightError if the window crashes."""
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise UserError("there is no display to open a window on", remedy="draw it into a file: --screenshot FILE.png")
    with tempfile.TemporaryDirectory(prefix="strainsight-view-") as folder:
        arrays = _written(view, folder)
        command = [sys.executable, "-m", CHILD, str(arrays)]
        done = subprocess.run(command, env=inherited(), stderr=subprocess.PIPE, check=False, cwd=folder)
    if done.returncode:
        said = last_words(done.stderr.decode(errors="replace"))
        raise StrainsightError(
            f"the window broke off (exit code {done.returncode}{said})",
            remedy="draw it into a file instead: --screenshot FILE.png",
        )


def _written(view: View, folder: str) -> Path:
    arrays = Path(folder, "view.npz")
    np.savez(arrays, **pack_view(view))  # type: ignore[arg-type]
    return arrays
