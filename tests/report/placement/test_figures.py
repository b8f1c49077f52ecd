"""Every figure of a placement is well-formed, small, says what it shows, and survives what a filter can throw at it."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from strainsight.report.chart.panels import last_periods
from strainsight.report.placement.figures import elbow, owner, placement_figures

from ...models import compute_once


def words(drawing):
    return " ".join("".join(node.itertext()) for node in ET.fromstring(drawing.svg).iter() if node.tag.endswith("text"))


def test_a_full_report_has_every_figure_once_small_and_with_units(full):
    drawings = compute_once(placement_figures, full())
    keys = [drawing.key for drawing in drawings]
    assert len(keys) == len(set(keys))
    assert {"trend", "noise", "repeats-E", "signal-G4", "estimate-tip", "closing-E", "posterior-E"} < set(keys)
    assert {"random-errors-tip", "random-errors-E", "random-histories-E"} < set(keys)
    assert "random-histories-tip" not in keys
    for drawing in drawings:
        assert len(drawing.svg) < 200 * 1024
        assert "[" in words(drawing)
        assert drawing.alt
        assert drawing.caption


def test_the_elbow_is_where_two_straight_lines_meet():
    count = np.unique(np.logspace(0, 3, 60).astype(int))
    trace = np.where(count < 20, (20 / count) ** 2, (20 / count) ** 0.1)
    found = elbow(count[::-1], trace[::-1])
    assert found == count[np.argmin(np.abs(np.log(count / 20)))]


def test_an_even_fall_has_no_elbow():
    count = np.arange(100, 3, -1)
    assert elbow(count, 100.0 / count) is None
    assert elbow(count, np.ones(len(count))) is None


def test_the_last_periods_of_a_sine_are_the_last_periods():
    time = np.arange(10_000) * 1e-4
    window = last_periods(np.sin(2 * np.pi * 20 * time) + 0.3, periods=4)
    assert time[-1] - time[window][0] == pytest.approx(4 / 20, abs=0.5 / 20)
    assert last_periods(np.ones(50)) == last_periods(np.full(50, np.inf)) == slice(0, None)


def test_a_channel_belongs_to_the_longest_label_that_it_begins_with():
    labels = ["G1", "G1 left", "G10"]
    assert [owner(name, labels, 7) for name in ("G1", "G10", "G10 45°", "G1 left 0°", "G1 0°", "other", "G100")] == [
        0, 2, 2, 1, 0, 7, 7,
    ]  # fmt: skip
