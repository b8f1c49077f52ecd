"""The layouts of a suite: on the structure they share, to turn round; as pictures; gauge by gauge."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

import numpy as np

from strainsight.report.page.markup import badge, block, cell, figures, grouped_table, measure, picture
from strainsight.report.page.positions import AXES, axes, decimals
from strainsight.report.picture.layout import Layout
from strainsight.report.space.section import space_section
from strainsight.report.suite.cases import numbered
from strainsight.report.suite.data import PlacementRun, Suite
from strainsight.report.text import number


def suite_space(report: Suite) -> str:
    """HTML: the structure of the first run that has gauges, with the layouts of all runs on the same one to choose from.

    Equal layouts are offered once, under the numbers of their runs.
    """
    found: dict[bytes, tuple[list[int], Layout]] = {}
    placed = [(index, run.layout) for index, run in report.placements if run.layout is not None]
    for index, layout in placed:
        if _same_structure(layout, placed[0][1]):
            found.setdefault(_look(layout), ([], layout))[0].append(index)
    label = {index: run.label for index, run in report.placements}
    return space_section(
        [(f"{', '.join(f'{index}.' for index in runs)} {label[runs[0]]}", layout) for runs, layout in found.values()]
    )


def gauges_section(report: Suite, scenes: Mapping[str, bytes]) -> str:
    """HTML: pictures of the layouts, equal ones once, and where every gauge sits; scenes: run's name → PNG."""
    shared: dict[bytes, list[int]] = {}
    for index, run in report.placements:
        if run.name in scenes:
            shared.setdefault(scenes[run.name], []).append(index)
    shown = figures(_picture(report, png, numbers) for png, numbers in shared.items())
    placed = [(index, run) for index, run in report.placements if run.layout is not None]
    if not placed:
        return f"<h2>Where the gauges go</h2>{shown}" if shown else ""
    bodies = [_gauge_rows(index, run) for index, run in placed]
    caption = "Gauges that stand together are redundant: they average noise, and one can replace the other."
    head = ("run", "gauge", "element", *AXES, "nearest", "distance")
    numbers = grouped_table("gauges", head, bodies, caption=caption, numeric=(2, 3, 4, 5, 7))
    return (
        f'<h2>Where the gauges go</h2>{shown}<details class="card below"><summary>All gauges of all runs, '
        f"and how near they stand to each other</summary>{numbers}</details>"
    )


def _picture(report: Suite, png: bytes, numbers: list[int]) -> str:
    """One layout with the runs that have it, and how near its gauges stand to each other."""
    run = dict(report.placements)[numbers[0]]
    title = "<br>".join(f"{index}. {escape(report.runs[index - 1].label)}" for index in numbers)
    near = "; ".join(f"{one} – {other} {number(1000 * size, 3)}\u00a0mm" for one, other, size in _distances(run))
    many = f"{run.gauges} gauges of a pool of {run.pool}" if run.gauges is not None else "the gauges"
    alt = f"The structure with {many} of {numbered(tuple(numbers))}" + (
        f"; nearest to each other: {near}." if near else "."
    )
    nearest = f"Nearest to each other: {near}." if near else ""
    label = f"picture of the gauges of {numbered(tuple(numbers))}"
    return (
        f'<figure class="card"><h3>{title}</h3><div class="scene" tabindex="0" role="region" aria-label="{label}">'
        f"{picture(png, alt, 1280, 840)}</div><figcaption>{escape(nearest)}</figcaption></figure>"
    )


def _distances(run: PlacementRun) -> list[tuple[str, str, float]]:
    """Every pair of nearest gauges once, the closest first."""
    found: dict[frozenset[str], tuple[str, str, float]] = {}
    for one, other, size in run.pairs:
        found.setdefault(frozenset((one, other)), (one, other, size))
    return sorted(found.values(), key=lambda pair: pair[2])


def _gauge_rows(index: int, run: PlacementRun) -> str:
    assert run.layout is not None
    places = decimals(run.layout.points)
    nearest = {one: (other, size) for one, other, size in run.pairs}
    rows = []
    for i, gauge in enumerate(run.layout.gauges):
        other, size = nearest.get(gauge.label, ("", None))
        row = [cell(badge(gauge.label, i, hollow=gauge.bonded)), cell(str(gauge.element), right=True)]
        row += [cell(text, right=True) for text in axes(gauge.position, places)]
        distance = "–" if size is None else measure(1000 * size, "mm", 3)
        rows.append([*row, cell(escape(other) or "–"), cell(distance, right=True)])
    return block(f"{index}. {escape(run.label)}", rows)


def _same_structure(one: Layout, other: Layout) -> bool:
    return np.array_equal(one.points, other.points) and np.array_equal(one.faces, other.faces)


def _look(layout: Layout) -> bytes:
    """What two layouts have in common that are drawn alike."""
    marks = [
        np.concatenate(
            [gauge.position, *gauge.channels, *(own for arm in gauge.arms for own in (arm.position, arm.direction))]
        )
        for gauge in layout.gauges
    ]
    return b"".join(np.asarray(array, dtype=float).tobytes() for array in (*marks, layout.pool))
