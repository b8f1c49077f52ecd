"""A picture of the structure with its gauges, and how pictures are drawn: off-screen, in a process of its own, which may crash.

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
from dataclasses import replace
from hashlib import sha256
from typing import Any, TypeVar

import numpy as np

from strainsight.errors import StrainsightError
from strainsight.imports import FOLDER
from strainsight.pages.arrays import FloatArray
from strainsight.pages.picture.layout import Layout
from strainsight.processes import end_with_parent, inherited, python

Pictures = TypeVar("Pictures")
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


def drawn_or_why(draw: Callable[[], Pictures]) -> tuple[Pictures | None, str]:
    """What `draw` makes, or None with the sentence on why there are no pictures."""
    try:
        return draw(), ""
    except StrainsightError as error:
        return None, f"{error.what}: {error.remedy}"


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


WIDTH, HEIGHT = 640, 420
"""As the page shows it [px]; the PNG has `picture.FINER` times as many pixels each way."""
TIME_LIMIT = 120.0
"""For the first picture [s]."""
TIME_A_PICTURE = 20.0
"""For every further one [s]."""
DOTS = 4000
"""More of a kind cannot be distinguished."""


def render(layout: Layout) -> bytes:
    """PNG of 1280 × 840 pixels on a transparent ground, for light and dark pages alike.

    Shows the facets with their edges, the candidate pool as dots, sensors as labelled marks by their kind
    (`markers.marker`), loads as arrows, clamped nodes as squares; two views where one corner does not show every gauge.
    Raises StrainsightError that names the Debian packages where nothing can render.
    """
    return render_all([layout])[0]


def render_all(layouts: Sequence[Layout]) -> list[bytes]:
    """A picture of each, as `render` makes it, in one child process: to start it takes longer than to draw."""
    limit = TIME_LIMIT + TIME_A_PICTURE * (len(layouts) - 1)
    return draw_apart("strainsight.pages.picture.scene", [thinned(layout) for layout in layouts], limit)


def thinned(layout: Layout) -> Layout:
    """The layout with no more dots of a kind than one can see."""

    def some(points: FloatArray) -> FloatArray:
        return points[:: max(1, -(-len(points) // DOTS))]

    return replace(layout, pool=some(layout.pool), fixed=some(layout.fixed), loose=some(layout.loose))


def look(layout: Layout) -> str:
    """A digest of what the picture shows, the same for layouts that are drawn alike."""
    words = [(g.label, g.kind, g.bonded) for g in layout.gauges], [load.name for load in layout.loads]
    places = [array for g in layout.gauges for array in (g.position, g.normal, g.channels)]
    places += [array for g in layout.gauges for arm in g.arms for array in (arm.position, arm.normal, arm.direction)]
    arrows = [array for load in layout.loads for array in (load.point, load.direction)]
    digest = sha256(repr(words).encode())
    for array in (layout.points, layout.faces, layout.pool, layout.fixed, layout.loose, layout.bars, *places, *arrows):
        digest.update(f"{np.shape(array)}".encode() + np.asarray(array, dtype=float).tobytes())
    return digest.hexdigest()


def drawn(layouts: Sequence[Layout]) -> list[bytes]:
    """In the child process: a picture of every layout of `render_all`."""
    from strainsight.pages.picture.picture import draw

    return [draw(layout, WIDTH, HEIGHT) for layout in layouts]


if __name__ == "__main__":
    answer(drawn)
