"""Decimated curves look as the full ones, and one figure's bytes depend on its data alone."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from strainsight.report.chart.drawing import GAUGES, figure, ink_on, styled, svg, visible_instants


def test_every_extreme_survives_decimation():
    draw = np.random.default_rng(5)
    columns = draw.normal(size=(50_000, 3))
    columns[31_234, 1] = 80.0
    columns[7, 2] = -90.0
    index = visible_instants(columns, buckets=200)
    assert len(index) <= 2 + 2 * 3 * 200
    assert {0, 7, 31_234, 49_999} <= set(index.tolist())
    np.testing.assert_array_equal(columns[index].max(axis=0), columns.max(axis=0))
    np.testing.assert_array_equal(columns[index].min(axis=0), columns.min(axis=0))


def test_within_every_pixel_column_the_curve_spans_the_same_heights():
    time = np.linspace(0, 1, 20_000)
    curve = np.sin(2 * np.pi * 400 * time)[:, None]
    index = visible_instants(curve, buckets=100)
    pixel = np.linspace(0, 20_000, 101).astype(int)
    for start, stop in pairwise(pixel):
        kept = curve[index[(index >= start) & (index < stop)]]
        assert kept.max() == curve[start:stop].max()
        assert kept.min() == curve[start:stop].min()


def test_a_short_or_broken_history_is_no_obstacle():
    assert len(visible_instants(np.zeros((10, 2)))) == 10
    broken = np.full((5000, 1), np.nan)
    broken[1234] = 1.0
    assert 1234 in visible_instants(broken)


def drawn(value):
    with styled():
        sheet, axes = figure()
        axes.plot([0.0, 0.123456], [0.0, value], label="a $b <c>")
        axes.set_xticks([0.012345], ["0.012345"])
        axes.legend()
        return svg(sheet)


def test_the_same_data_give_the_same_bytes_and_others_do_not():
    assert drawn(1.0) == drawn(1.0)
    assert drawn(1.0) != drawn(2.0)
    assert b"<dc:date>" not in drawn(1.0)


def test_rounded_coordinates_leave_the_tick_labels_alone():
    text = drawn(1.0).decode()
    assert ">0.012345<" in text
    assert "a $b &lt;c&gt;" in text


def test_labels_on_gauge_colours_reach_the_contrast_of_wcag_aa():
    def luminance(colour):
        channel = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
        linear = np.where(channel <= 0.04045, channel / 12.92, ((channel + 0.055) / 1.055) ** 2.4)
        return linear @ [0.2126, 0.7152, 0.0722]

    for colour in GAUGES:
        low, high = sorted((luminance(colour), luminance(ink_on(colour))))
        assert (high + 0.05) / (low + 0.05) >= 4.5
