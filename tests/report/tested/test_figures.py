"""Figures of a test draw what the findings hold: every peak of a long record, and no more than can be seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.report.chart.data import figure_csv
from strainsight.report.chart.drawing import kept
from strainsight.report.chart.panels import about
from strainsight.report.picture.geometry import at_points
from strainsight.report.tested.figures import load_figure, residual_figure
from strainsight.report.tested.readings import reading_figure

from .findings import findings, history, load, reading, spectrum


def numbers(draw):
    """The table of what a figure draws: head → column."""
    with kept() as figures:
        drawing = draw()
    rows = [line.split(",") for line in figure_csv(figures[drawing.svg]).decode().splitlines()]
    return {name: [float(row[i]) for row in rows[1:] if row[i]] for i, name in enumerate(rows[0])}


def test_a_long_record_keeps_its_peaks_and_is_drawn_in_few_points():
    steps = 200_000
    time, values = 1e-4 * np.arange(1, steps + 1), 1e-5 * np.sin(np.arange(steps))
    values[123_456], values[77] = 9e-4, -7e-4
    own = replace(reading(), time=time, measured=values, estimated=values.copy(), std=np.full(steps, 1e-6))
    drawn = numbers(lambda: reading_figure(own))
    measured = drawn["measured: strain [µm/m]"]
    assert max(measured) == pytest.approx(900)
    assert min(measured) == pytest.approx(-700)
    assert len(measured) < 4000
    assert len(reading_figure(own).svg) < 400_000


@pytest.mark.parametrize("at", [0, 10, 2000, 3999])
def test_a_window_lies_within_the_record_and_about_its_instant(at):
    window = about(np.sin(np.arange(4000) / 20.0), at)
    assert 0 <= window.start <= at < window.stop <= 4000
    # five periods of 126 samples, to a crossing
    assert window.stop - window.start == pytest.approx(5 * 40 * np.pi, rel=0.02)


def test_a_load_is_drawn_with_its_band_in_its_unit():
    drawn = numbers(lambda: load_figure("load", history("side", load(), 60.0), "#0072b2"))
    high = max(drawn["band high: side [kN]"])
    assert high == pytest.approx((load().max() + 120.0) / 1e3)
    assert not any(
        "band" in name for name in numbers(lambda: load_figure("known", history("tip", load(), np.nan), "#0072b2"))
    )


def test_the_noise_as_stated_is_a_line_at_the_root_of_its_density():
    own = spectrum("G1", level=4e-18)
    drawn = numbers(lambda: residual_figure(own, "#0072b2"))
    (level,) = drawn["noise as stated: √density [nm/m/√Hz]"]
    assert level == pytest.approx(2.0)
    assert max(drawn["left over: √density [nm/m/√Hz]"]) == pytest.approx(1e9 * np.sqrt(own.density.max()))


def test_values_of_facets_become_those_of_their_points_and_keep_a_constant():
    own = findings().layout
    np.testing.assert_allclose(at_points(np.full(len(own.faces), 7.0), own.faces, len(own.points)), 7.0)
    values = np.arange(3.0)
    faces = np.array([[0, 1, 2, -1], [1, 2, 3, -1], [2, 3, 4, -1]])
    np.testing.assert_allclose(at_points(values, faces, 6), [0, 0.5, 1.0, 1.5, 2.0, np.nan])
