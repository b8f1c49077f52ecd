"""Figures, tables and statements of benches: what is drawn and said of good, lost and missing numbers."""

from __future__ import annotations

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.estimation.decision import FAULTS
from strainsight.pages.bench.data import BenchPageRun, BenchSensor, BenchStress, BenchUnknown, PlacedGauges
from strainsight.pages.bench.figures import components_figure, mismatch, sensor_figure
from strainsight.pages.bench.page import bench_figures, bench_page
from strainsight.pages.bench.tables import placement_table
from strainsight.pages.placement.data import MetricWords, Trend
from strainsight.pages.suite.data import Statement, Suite, SuiteStudy, measured, statements_table
from strainsight.pages.suite.figures import suite_figures
from strainsight.pages.suite.page import suite_page
from strainsight.pages.suite.summary import counts

from ...models import compute_once
from ..outline import names_of_regions, whole, words

TIME = np.linspace(0.0, 2.0, 41)
TRUE = 1e4 * np.sin(3 * TIME)


def load(error=0.01, there=None, truth=True):
    history = ("F$z", "N", TIME, TRUE if truth else None, TRUE * (1 + error), np.full(len(TIME), 50.0))
    return BenchUnknown(*history, kind="input", unscaled=there)


def sensor(name="relative", off=0.0, used=True):
    measured = np.outer(TRUE[1:], [1e-9, 2e-9, 0.0])
    return BenchSensor(name, TIME[1:], measured, measured * (1 + off), ("x", "y", "tilt y"), ("m", "m", "rad"), used)


def run(label="a", error=0.01, **more):
    numbers = {"error.F$z": error, "std.F$z": 0.02, "nis": 0.9, "expected_nis": 0.8, "method": "iterated"} | more
    record = SimpleNamespace(
        time=TIME, bearings={}, nis=np.ones(len(TIME) - 1), violation=np.full(len(TIME), 1e-16)
    )
    return BenchPageRun(
        label, label, study="s", reached="estimate", numbers={"estimate": numbers},
        estimated=record, unknowns=(load(error),), sensors=(sensor(off=error),),
    )  # fmt: skip


def suite(runs, claims=(), over=None, numbers=()):
    return Suite("s", "t", tuple(runs), (SuiteStudy("s", "", over, numbers, tuple(range(len(runs)))),), claims)


def claim(*values, **more):
    return Statement("A <statement>.", tuple((0, f"n{i}", value) for i, value in enumerate(values)), **more)


def over_seeds(*values, **more):
    return Statement("A <statement>.", tuple((0, "n", value) for value in values), **more)


@pytest.mark.parametrize(
    ("found", "verdict"),
    [
        (claim(1.0, above=0.9, below=1.1), "confirmed"),
        (claim(1.0, 1.2, above=0.9, below=1.1), "contradicted"),
        (claim(1.0, above=1.0), "contradicted"),
        (claim(math.inf, below=1.1), "contradicted"),
        (claim(math.nan, above=0.9), "no number"),
        (claim(math.nan, 0.5, above=0.9), "contradicted"),
        (claim(1.0, 1.0, equals=True), "confirmed"),
        (claim(1.0, 0.0, equals=True), "contradicted"),
        (claim(0.0, equals=False), "confirmed"),
        (over_seeds(*[1.0] * 18, 9.0, math.nan, below=2.0), "confirmed"),
        (over_seeds(*[1.0] * 17, 9.0, 9.0, 9.0, below=2.0), "contradicted"),
        (over_seeds(*[1.0] * 17, 9.0, math.nan, math.nan, below=2.0), "no number"),
    ],
)
def test_a_claim_holds_where_every_number_does_in_nine_of_ten_seeds(found, verdict):
    assert found.result == verdict


@pytest.mark.parametrize(
    ("numbers", "word"),
    [
        ({"claim.F$z": "overconfident"}, "overconfident"),
        ({"identified.F$z": False}, "not identified"),
        ({"verdict.F$z": "inconsistent with the sensors"}, "inconsistent with the sensors"),
        ({"verdict.F$z": "σ is withheld"}, "σ is withheld"),
        ({"verdict.F$z": "outside the range of the reduced model"}, "outside the range of the reduced model"),
    ],
)
def test_every_fault_of_a_run_is_counted(numbers, word):
    found = counts(suite([run("good"), run("bad", **numbers)]))
    assert [places for said, places in found.items() if said in FAULTS] == [[2]]
    assert word in found


def test_the_runs_that_disagree_with_a_statement_are_named():
    page = statements_table(
        suite([run("one"), run("two")], (Statement("t", ((0, "n", 1.0), (1, "n", 9.0)), below=2.0),))
    )
    assert "except two: n 9" in words(page)
    assert 'href="#run-1"' in page


def test_a_statement_over_seeds_is_shown_with_its_spread_in_how_many_it_holds_and_why():
    found = over_seeds(*map(float, range(21)), below=5.0, unit="%", why="Loads <move>.")
    assert measured(found) == "10 (2 to 18) %"
    page = statements_table(suite([run("one")], (found,)))
    assert "median and 10 to 90 % quantiles of 21 random seeds" in words(page)
    assert "except one: n within the bounds of the claim for 5 of 21 random seeds" in words(page)
    assert "Loads &lt;move&gt;." in page


def test_a_sensor_s_mismatch_is_the_rms_of_what_is_left_over_that_of_the_reading():
    assert mismatch(sensor(off=0.02), 1) == pytest.approx(0.02, rel=1e-12)
    assert math.isnan(mismatch(sensor(), 2))
    drawing = sensor_figure("k", "t", 1, [("a", sensor(off=0.02)), ("b", sensor(off=0.05))])
    assert "a 2.0\u00a0%, b 5.0\u00a0%" in drawing.alt
    assert "the filter does not use this sensor" in sensor_figure("k", "t", 0, [("", sensor(used=False))]).caption
    assert "x 2.0\u00a0%" in components_figure("k", "t", sensor(off=0.02)).caption


def test_pages_are_well_formed_fetch_nothing_and_lead_somewhere():
    runs = [run("<a>"), run("b", **{"identified.F$z": False}), BenchPageRun("c", "c", study="s", reached="simulate")]
    own = suite(runs, (claim(1.0, above=2.0),))
    pages = [
        suite_page(own, compute_once(suite_figures, own), {}),
        bench_page(runs[1], compute_once(bench_figures, runs[1]), {"k": "<v>"}),
    ]
    for page in pages:
        assert len(names_of_regions(whole(page))) > 2
        assert not re.search(r"<a>|<v>|<statement>", page)
        assert "F$z: not identified." in page


def test_a_layout_stands_with_random_ones_and_one_that_loses_a_load_is_reported():
    without = np.array([[1e3], [2e3], [np.inf]])
    best = SimpleNamespace(position=np.eye(3), direction=np.eye(3), std=np.array([1e3]), without=without)
    placed = SimpleNamespace(
        inputs=("F",), units=("N",), placed=best, random_std=np.array([[2e3], [np.inf]]), loss=np.array([1.5, 2.0, np.inf])
    )
    trend = Trend(np.arange(3), np.ones(3), {}, 1.0, MetricWords("tr", "the trace"))
    placement = PlacedGauges(placed, trend, labels=("G1", "G2", "G3"))
    cells = re.findall(r"<td[^>]*>(.*?)</td>", placement_table(placement, {}))
    assert [re.sub("<[^>]*>", "", cell) for cell in cells[:3]] == ["1\u00a0kN", "2\u00a0kN", "∞\u00a0N"]



def test_a_stress_beyond_the_allowable_comes_first_and_is_in_the_title():
    motion, largest = SimpleNamespace(time=TIME, bearings={}, drives={}), np.where(TIME == 1.0, 58.68e6, 1e7)
    stress, numbers = BenchStress("hub", TIME, largest, 6338, 40e6), {"simulate": {"band": 0.39642}}
    hubs = BenchPageRun("hubs", "hubs", numbers=numbers, simulated=motion, stress=stress)
    page = bench_page(hubs, compute_once(bench_figures, hubs), {})
    assert "✕ von Mises stress above the allowable stress – hubs" in page
    answer = page[page.index('class="answer"') :]
    share = re.search(r'<data value="([\d.]+)">[^<]*%', answer)
    assert float(share[1]) == pytest.approx(58.68 / 40)
    resolved = answer.index("The time step resolves load frequencies")
    assert answer.index('class="bad">Largest von Mises stress on hub: ') < share.start() < resolved
