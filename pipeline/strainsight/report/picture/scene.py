"""A picture of the structure with its gauges, rendered off-screen in a child process (`offscreen` says why)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256

import numpy as np

from strainsight.report.arrays import FloatArray
from strainsight.report.picture.layout import Layout
from strainsight.report.picture.offscreen import answer, draw_apart

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
    return draw_apart("strainsight.report.picture.scene", [thinned(layout) for layout in layouts], limit)


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
    from strainsight.report.picture.picture import draw

    return [draw(layout, WIDTH, HEIGHT) for layout in layouts]


if __name__ == "__main__":
    answer(drawn)
