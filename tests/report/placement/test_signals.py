"""Readings of every channel in its own unit, in the colour of its gauge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.report.chart.drawing import gauge_colour
from strainsight.report.placement.data import GaugeSignal
from strainsight.report.placement.signals import owner, signal_figure, signal_figures


def test_every_channel_has_the_colour_of_its_gauge(mixed):
    report = mixed()
    drawings = signal_figures(report.gauge_signals, report.layout.gauges)
    for drawing in drawings:
        number = int(drawing.key.removeprefix("signal-G")[0]) - 1
        assert gauge_colour(number) in drawing.svg.decode()
        others = {gauge_colour(i) for i in range(6)} - {gauge_colour(number)}
        assert not any(colour in drawing.svg.decode() for colour in others)


def test_a_channel_belongs_to_the_longest_label_that_it_begins_with():
    labels = ["G1", "G1 left", "G10"]
    assert [owner(name, labels, 7) for name in ("G1", "G10", "G10 45°", "G1 left 0°", "G1 0°", "other", "G100")] == [
        0, 2, 2, 1, 0, 7, 7,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("peak", "unit", "label", "residual"),
    [
        (9e-5, "strain", "strain [µm/m]", "0.9 µm/m"),
        (4e-4, "m", "displacement [µm]", "4 µm"),
        (12.0, "m/s^2", "acceleration [m/s²]", "0.12 m/s²"),
        (5e3, "V", "reading [V]", "50 V"),
    ],
)
def test_readings_have_the_name_and_unit_of_what_is_read(peak, unit, label, residual):
    time = np.arange(1000) * 1e-3
    wave = peak * np.sin(2 * np.pi * 20 * time)
    drawing = signal_figure(GaugeSignal("G1", time, wave + 0.01 * peak, None, wave, 0 * time, unit), "#0072b2")
    assert f">{label}<" in drawing.svg.decode()
    assert f"RMS {residual} over the run" in drawing.caption
    assert unit != "V" or "peak 4990 V" in drawing.alt


def test_a_channel_that_is_no_number_at_times_or_always_is_drawn(full):
    signal = full().gauge_signals[0]
    for bad in (np.nan, np.inf):
        signal_figure(replace(signal, measured=np.where(signal.time > 0.9, bad, signal.measured)), "#0072b2")
        lost = np.full_like(signal.time, bad)
        signal_figure(replace(signal, measured=lost, estimated=lost, std=lost, truth=lost), "#0072b2")
