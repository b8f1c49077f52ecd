"""Figures of a suite: well-formed, small, each run once, and they survive what a run may lack."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from strainsight.report.suite.figures import suite_figures

from ...models import compute_once
from ..conftest import suite_report


def words(drawing):
    return " ".join("".join(node.itertext()) for node in ET.fromstring(drawing.svg).iter() if node.tag.endswith("text"))


@cache
def usual():
    """Figures of the suite of `suite()`, drawn once."""
    return compute_once(suite_figures, suite_report())


def drawn(report):
    return {drawing.key: drawing for drawing in compute_once(suite_figures, report)}


def test_a_suite_has_every_figure_once_small_and_with_units():
    drawings = usual()
    assert [drawing.key for drawing in drawings] == [
        "pbh", "errors", "trends", "estimate-1-E", "estimate-2-tip", "estimate-2-E", "estimate-3-tip", "estimate-3-E",
    ]  # fmt: skip
    for drawing in drawings:
        assert len(drawing.svg) < 200 * 1024
        assert "[" in words(drawing)
        assert len(drawing.alt) > 20
        assert drawing.caption


def test_figures_are_the_same_bytes_each_time(suite):
    assert suite_figures(suite()) == usual()


def test_the_observability_figure_has_a_group_a_set_and_a_colour_an_excitation(suite):
    figure = next(drawing for drawing in usual() if drawing.key == "pbh")
    text = words(figure)
    for entry in ("input + E + rho", "E + rho", "runs 1, 2 and 4: E, 20 Hz", "run 3 at 35 Hz: tip + E, slow", "91"):
        assert entry in text
    assert "at 4 excitations" in figure.alt
    assert "singular" not in figure.caption
    worse = tuple(replace(case, condition=np.inf) for case in suite().runs[0].cases if case.lost)
    lost = drawn(suite(runs=(replace(suite().runs[0], cases=worse),)))["pbh"]
    assert "∞" in words(lost)


def test_equal_trends_are_drawn_once_and_name_their_runs():
    text = words(next(drawing for drawing in usual() if drawing.key == "trends"))
    assert "1  E, 20 Hz" in text
    assert "2, 3  tip + E, 20 Hz" in text
    assert "tip + E, slow" not in text


def test_only_wrong_results_are_crosses(suite):
    first, *_ = suite().runs
    assert "run 1 E" in drawn(suite(runs=(first,)))["errors"].alt
    (unknown,) = first.unknowns
    over = replace(unknown.claims[0], verdict="overconfident")
    bad = replace(first, unknowns=(replace(unknown, error=0.5, claims=(over,)),))
    good, wrong = (drawn(suite(runs=(run,)))["errors"].svg for run in (first, bad))
    # The key has one cross, a wrong result has one more.
    assert wrong.count(b"#d55e00") > good.count(b"#d55e00")


def test_nothing_to_draw_is_no_figure(suite):
    assert compute_once(suite_figures, suite(runs=())) == ()
    assert list(drawn(suite(runs=suite().runs[3:]))) == ["pbh"]


@pytest.mark.parametrize("lost", [np.nan, np.inf])
def test_numbers_that_are_none_are_survived(suite, lost):
    first, second, third, seen = suite().runs
    trace = np.full_like(first.trend.value, lost)
    broken = replace(
        first,
        unknowns=tuple(replace(unknown, error=lost, std=lost) for unknown in first.unknowns),
        trend=replace(first.trend, value=trace, final=lost),
        cases=tuple(replace(case, condition=lost) for case in first.cases),
        repeats=tuple(replace(entry, error=np.full(20, lost)) for entry in first.repeats),
    )
    late = np.where(np.arange(len(trace)) < 20, second.trend.value, lost)
    broken_end = replace(
        second,
        trend=replace(second.trend, value=late, final=lost),
        unknowns=tuple(replace(unknown, std=lost, smoothed_error=0.1) for unknown in second.unknowns),
    )
    keys = [drawing.key for drawing in compute_once(suite_figures, suite(runs=(broken, broken_end, third, seen)))]
    assert {"pbh", "errors", "trends"} < set(keys)
    assert "trends" not in drawn(suite(runs=(broken,)))


def test_many_runs_fit(suite):
    runs = []
    for i in range(24):
        run = suite().runs[i % 3]
        trend = replace(run.trend, value=run.trend.value ** (1 + i / 12))
        runs.append(replace(run, name=f"run-{i}", label=f"run number {i}", trend=trend, histories=()))
    drawings = compute_once(suite_figures, suite(runs=tuple(runs)))
    assert [drawing.key for drawing in drawings] == ["pbh", "errors", "trends"]
    assert all(len(drawing.svg) < 400 * 1024 for drawing in drawings)
