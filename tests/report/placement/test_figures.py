"""Every figure of a placement is well-formed, small, says what it shows, and survives what a filter can throw at it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from strainsight.report.arrays import History
from strainsight.report.chart.histories import closing_figure, estimate_figure
from strainsight.report.chart.panels import last_periods
from strainsight.report.placement.data import Metric, Trend
from strainsight.report.placement.figures import elbow, owner, placement_figures, signal_figure, trend_figure

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


def test_a_long_run_gives_no_larger_figures():
    time = np.arange(400_000) * 1e-4
    noisy = 1e4 * np.sin(2 * np.pi * 20 * time) + np.random.default_rng(0).normal(size=len(time))
    history = History("F", "N", time, noisy, noisy + 1.0, np.full(len(time), 300.0), noisy, np.full(len(time), 100.0))
    assert len(estimate_figure(history).svg) < 200 * 1024
    assert len(closing_figure(history, "input").svg) < 200 * 1024


def test_a_truth_that_jumps_for_one_step_is_drawn():
    time = np.arange(100_000) * 1e-4
    mean = np.zeros(len(time))
    spike = mean.copy()
    spike[54_321] = 7.0
    flat, jump = (estimate_figure(History("u", "m", time, truth, mean, mean + 0.1)).svg for truth in (mean, spike))
    assert flat != jump


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


def test_the_trend_of_a_set_that_cannot_observe_everything():
    lost, metric = np.array([1.0, 2.0, np.inf]), Metric("λ₁(P)", "variance of the worst")
    trend = Trend(np.array([3, 2, 1]), lost, {"E": lost}, np.inf, metric)
    assert "∞" in trend_figure(trend).alt
    assert "Variance of the worst while gauges" in trend_figure(trend).caption
    trend_figure(replace(trend, value=np.full(3, np.inf)))


def test_a_diverged_filter_can_still_be_drawn():
    time = np.arange(3000) * 1e-3
    mean = np.where(time < 1.5, 1.0, np.nan)
    history = History("E", "Pa", time, np.ones(3000), mean, mean)
    estimate_figure(history)
    closing_figure(history, "parameter")
    closing_figure(replace(history, truth=None, mean=np.full(3000, np.nan)), "parameter")
    lost = np.where(time < 1.5, 1.0, np.inf)
    blown = replace(history, mean=lost, std=lost, truth=lost, smoothed=lost, smoothed_std=lost)
    estimate_figure(blown)
    closing_figure(blown, "input")


def test_a_channel_belongs_to_the_longest_label_that_it_begins_with():
    labels = ["G1", "G1 left", "G10"]
    assert [owner(name, labels, 7) for name in ("G1", "G10", "G10 45°", "G1 left 0°", "G1 0°", "other", "G100")] == [
        0, 2, 2, 1, 0, 7, 7,
    ]  # fmt: skip


def test_a_channel_that_is_no_number_at_times_or_always_is_drawn(full):
    signal = full().gauge_signals[0]
    for bad in (np.nan, np.inf):
        signal_figure(replace(signal, measured=np.where(signal.time > 0.9, bad, signal.measured)), "#0072b2")
        lost = np.full_like(signal.time, bad)
        signal_figure(replace(signal, measured=lost, estimated=lost, std=lost, truth=lost), "#0072b2")
