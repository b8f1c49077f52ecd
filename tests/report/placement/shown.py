"""The page of a report, with pictures that are drawn once."""

from __future__ import annotations

from functools import cache

from strainsight.report.placement.figures import placement_figures
from strainsight.report.placement.page import placement_page

from ...models import compute_once
from ..conftest import report as whole_report

PNG = b"\x89PNG not really"


@cache
def figures_once():
    """Of the full report: most tests change its texts, and drawing is what takes the time."""
    return compute_once(placement_figures, whole_report())


def page(report, scene=PNG, problem="", *, drawn=False):
    """drawn: with figures of its own, not those of the full report."""
    return placement_page(report, compute_once(placement_figures, report) if drawn else figures_once(), scene, problem)
