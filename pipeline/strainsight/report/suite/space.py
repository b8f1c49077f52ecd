"""The layouts of a suite on the structure they share, to turn round."""

from __future__ import annotations

import numpy as np

from strainsight.report.picture.layout import Layout
from strainsight.report.space.section import space_section
from strainsight.report.suite.data import SuiteReport


def suite_space(report: SuiteReport) -> str:
    """HTML: the structure of the first run that has gauges, with the layouts of all runs on the same one to choose from.

    Equal layouts are offered once, under the numbers of their runs.
    """
    found: dict[bytes, tuple[list[int], Layout]] = {}
    placed = [(index, run.layout) for index, run in enumerate(report.runs, start=1) if run.layout is not None]
    for index, layout in placed:
        if _same_structure(layout, placed[0][1]):
            found.setdefault(_look(layout), ([], layout))[0].append(index)
    label = {index: run.label for index, run in enumerate(report.runs, start=1)}
    return space_section(
        [(f"{', '.join(f'{index}.' for index in runs)} {label[runs[0]]}", layout) for runs, layout in found.values()]
    )


def _same_structure(one: Layout, other: Layout) -> bool:
    return np.array_equal(one.points, other.points) and np.array_equal(one.faces, other.faces)


def _look(layout: Layout) -> bytes:
    """What two layouts have in common that are drawn alike."""
    marks = [np.concatenate([gauge.position, *gauge.channels]) for gauge in layout.gauges]
    return b"".join(np.asarray(array, dtype=float).tobytes() for array in (*marks, layout.pool))
