"""Drawing in a process of its own, which may crash.

VTK ends the whole process with a segmentation fault where it finds no OpenGL (seen with VTK 9.7 and no EGL, X or OSMesa
library); in a child process that costs the picture and not the run. What is drawn goes there by stdin and the pictures come by
stdout: no file is left behind where either process is interrupted or killed.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from io import BytesIO
from pathlib import Path

import numpy as np

import strainsight
from strainsight.errors import StrainsightError
from strainsight.processes import end_with_parent

Arrays = Mapping[str, np.ndarray]

OFF_SCREEN = "off-screen"
"""The argument of the child process."""
DEBIAN_PACKAGES = "libegl1 libegl-mesa0 libgl1-mesa-dri libgl1"


def draw_apart(module: str, arrays: Arrays, limit: float) -> list[bytes]:
    """Run `python -m module off-screen`, which hands the arrays to `answer`: the pictures that it drew; limit [s].

    Raises StrainsightError that names the Debian packages where nothing can render.
    """
    output = "no output"
    for environment in _environments():
        # -P: no module of the folder that this process happens to run in.
        command = [sys.executable, "-P", "-m", module, OFF_SCREEN]
        try:
            done = subprocess.run(
                command, env=environment, input=as_npz(arrays), capture_output=True, timeout=limit, check=False
            )
        except subprocess.TimeoutExpired:
            output = f"no picture after {limit:.0f} s"
            continue
        if done.returncode == 0 and done.stdout:
            return [picture.tobytes() for picture in from_npz(done.stdout).values()]
        output = f"exit code {done.returncode}" + last_words(done.stderr.decode(errors="replace"))
    raise StrainsightError(
        f"the 3D picture could not be rendered off-screen ({output})",
        remedy=f"install an off-screen OpenGL; on Debian and Ubuntu: apt-get install {DEBIAN_PACKAGES}",
    )


def answer(draw: Callable[[dict[str, np.ndarray]], Sequence[bytes]]) -> None:
    """In the child process: the pictures of the arrays that come by stdin, to stdout; what libraries print goes to stderr."""
    end_with_parent()
    out = os.dup(1)
    os.dup2(2, 1)
    pictures = draw(from_npz(sys.stdin.buffer.read()))
    with os.fdopen(out, "wb") as stream:
        stream.write(as_npz({str(i): np.frombuffer(picture, np.uint8) for i, picture in enumerate(pictures)}))


def as_npz(arrays: Arrays) -> bytes:
    """The arrays as the content of an .npz file."""
    file = BytesIO()
    np.savez(file, **arrays)  # type: ignore[arg-type]
    return file.getvalue()


def from_npz(content: bytes) -> dict[str, np.ndarray]:
    """The arrays of an .npz file, in their order; numbers and text only."""
    with np.load(BytesIO(content), allow_pickle=False) as file:
        return dict(file)


def inherited() -> dict[str, str]:
    """The environment of this process, in which the child finds this package."""
    root = str(Path(strainsight.__file__).parents[1])
    path = os.environ.get("PYTHONPATH")
    return {**os.environ, "PYTHONPATH": os.pathsep.join(part for part in (root, path) if part)}


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
