"""Drawing in a process of its own, which may crash.

VTK ends the whole process with a segmentation fault where it finds no OpenGL (seen with VTK 9.7 and no EGL, X or OSMesa
library); in a child process that costs the picture and not the run. What is drawn goes there by stdin and the pictures come by
stdout, both pickled: no file is left behind where either process is interrupted or killed.
"""

from __future__ import annotations

import os
import pickle
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import Any

from strainsight.errors import StrainsightError
from strainsight.imports import FOLDER
from strainsight.processes import end_with_parent, inherited, python

OFF_SCREEN = "off-screen"
"""The argument of the child process."""
DEBIAN_PACKAGES = "libegl1 libegl-mesa0 libgl1-mesa-dri libgl1"


def draw_apart(module: str, what: Any, limit: float) -> list[bytes]:
    """Run `python -m module off-screen`, which draws `what` by `answer`: the pictures; limit [s].

    Raises StrainsightError that names the Debian packages where nothing can render.
    """
    output = "no output"
    for environment in _environments():
        command, asked = [*python(module), OFF_SCREEN], pickle.dumps(what)
        try:
            done = subprocess.run(
                command, env=environment, cwd=FOLDER, input=asked, capture_output=True, timeout=limit, check=False
            )
        except subprocess.TimeoutExpired:
            output = f"no picture after {limit:.0f} s"
            continue
        if done.returncode == 0 and done.stdout:
            pictures: list[bytes] = pickle.loads(done.stdout)
            return pictures
        output = f"exit code {done.returncode}" + last_words(done.stderr.decode(errors="replace"))
    raise StrainsightError(
        f"the 3D picture could not be rendered off-screen ({output})",
        remedy=f"install an off-screen OpenGL; on Debian and Ubuntu: apt-get install {DEBIAN_PACKAGES}",
    )


def answer(draw: Callable[[Any], Sequence[bytes]]) -> None:
    """In the child process: the pictures of what comes by stdin, to stdout; what libraries print goes to stderr."""
    end_with_parent()
    out = os.dup(1)
    os.dup2(2, 1)
    pictures = draw(pickle.load(sys.stdin.buffer))
    with os.fdopen(out, "wb") as stream:
        pickle.dump(list(pictures), stream)


def _environments() -> list[dict[str, str]]:
    """Off-screen first, whatever DISPLAY says; then as VTK itself would choose (an X display, OSMesa)."""
    base = inherited()
    if not sys.platform.startswith("linux"):
        return [base]
    egl = {name: value for name, value in base.items() if name != "DISPLAY"}
    return [{**egl, "VTK_DEFAULT_OPENGL_WINDOW": "vtkEGLRenderWindow"}, base]


def last_words(stderr: str) -> str:
    """The last line that VTK wrote, without its colours, time stamp and place."""
    lines = re.sub(r"\x1b\[[0-9;]*m", "", stderr).strip().splitlines()
    return f", {lines[-1].rpartition('|')[2].strip()}" if lines else ""
