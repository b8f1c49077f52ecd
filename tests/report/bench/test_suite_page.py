"""Figures, tables and statements of benches: what is drawn and said of good, lost and missing numbers."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from strainsight.report.arrays import History
from strainsight.report.bench.data import (
    BenchEstimate,
    BenchPlacement,
    BenchRun,
    BenchSensor,
    BenchUnknown,
)
from strainsight.report.bench.figures import Line, ratio_figure, runs_figure, unknown_figure
from strainsight.report.bench.page import bench_figures, bench_page
from strainsight.report.bench.sensors import components_figure, mismatch, sensor_figure
from strainsight.report.bench.tables import placement_table, ratio, runs_table
from strainsight.report.placement.data import Metric, Trend
from strainsight.report.suite.data import Statement, Study, Suite
from strainsight.report.suite.figures import suite_figures
from strainsight.report.suite.page import suite_page
from strainsight.report.suite.results import RED, counts
from strainsight.report.suite.statements import measured, statements_table, target
from strainsight.report.suite.studies import study_figures

from ...models import compute_once
from ..outline import names_of_regions, nothing_comes_from_outside, steps_in_order, words

TIME = np.linspace(0.0, 2.0, 41)
TRUE = 1e4 * np.sin(3 * TIME)


def load(error=0.01, name="F$z", there=None, truth=True, lost_from=None):
    mean = TRUE * (1 + error)
    if lost_from is not None:
        mean = np.where(np.arange(len(mean)) < lost_from, mean, np.nan)
    history = History(name, "N", TIME, TRUE if truth else None, mean, np.full(len(TIME), 50.0))
    return BenchUnknown("input", history, there=there)


def sensor(name="relative", off=0.0, used=True):
    measured = np.outer(TRUE[1:], [1e-9, 2e-9, 0.0])
    return BenchSensor(name, TIME[1:], measured, measured * (1 + off), ("x", "y", "tilt y"), ("m", "m", "rad"), used)


def run(label="a", error=0.01, at=None, group="", study="s", unknowns=None, **more):
    numbers = {"error.F$z": error, "std.F$z": 0.02, "nis": 0.9, "expected_nis": 0.8, "method": "iterated"} | more
    estimate = BenchEstimate(
        TIME,
        (load(error),) if unknowns is None else unknowns,
        (sensor(off=error),),
        (),
        np.ones(len(TIME) - 1),
        np.full(len(TIME), 1e-16),
        numbers,
    )
    return BenchRun(label, label, study=study, group=group, at=at, reached="estimate", estimate=estimate)


def suite(runs, claims=(), over=None, numbers=()):
    return Suite("s", "t", tuple(runs), (Study("s", "", over, numbers, tuple(range(len(runs)))),), claims)


def claim(*values, **more):
    """Numbers of one seed each."""
    return Statement("A <statement>.", tuple((0, f"n{i}", value) for i, value in enumerate(values)), **more)


def over_seeds(*values, **more):
    """One number of several seeds."""
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
    assert found.verdict == verdict


@pytest.mark.parametrize(
    ("numbers", "word"),
    [
        ({"claim.F$z": "overconfident"}, "overconfident"),
        ({"identified.F$z": False}, "not identified"),
        ({"verdict.F$z": "contradicted by its sensors"}, "contradicted by its sensors"),
        ({"verdict.F$z": "σ is withheld"}, "σ is withheld"),
        ({"verdict.F$z": "beyond the range of the reduced model"}, "beyond the range of the reduced model"),
    ],
)
def test_every_fault_of_a_run_is_counted(numbers, word):
    """The page of a suite with a run of each fault had no word for the last three."""
    found = counts(suite([run("good"), run("bad", **numbers)]))
    assert [places for said, places in found.items() if said in RED] == [[2]]
    assert word in found


def test_the_target_and_what_is_measured_in_words():
    assert target(claim(1.0, above=0.5, below=1.5, unit="N")) == "0.5 to 1.5 N"
    assert (target(claim(1.0, above=0.5)), target(claim(1.0, below=0.5))) == ("above 0.5", "below 0.5")
    assert (target(claim(1.0, equals=False)), measured(claim(1.0, equals=False))) == ("no", "yes")
    assert measured(claim(1.0, 0.0, equals=True)) == "1 of 2 yes"
    assert measured(claim(1.0, 2.0, unit="N", below=3.0)) == "1, 2 N"
    assert measured(claim(3.0, 1.0, 2.0, math.nan, below=3.0)) == "1 to 3 (4 numbers), 1 without a number"


def test_the_runs_that_contradict_a_statement_are_named():
    page = statements_table(
        suite([run("one"), run("two")], (Statement("t", ((0, "n", 1.0), (1, "n", 9.0)), below=2.0),))
    )
    assert "not in two: n 9" in words(page)
    assert 'href="#run-1"' in page


def test_a_statement_over_seeds_is_shown_with_its_spread_in_how_many_it_holds_and_why():
    """0, 1, …, 20: median 10, a tenth of the seeds up to 2 and from 18 on."""
    found = over_seeds(*map(float, range(21)), below=5.0, unit="%", why="Loads <move>.")
    assert measured(found) == "10 (2 to 18) %"
    page = statements_table(suite([run("one")], (found,)))
    assert "median and 10 to 90 % of 21 seeds" in words(page)
    assert "not in one: n holds in 5 of 21 seeds" in words(page)
    assert "Loads &lt;move&gt;." in page


def test_every_number_of_a_statement_keeps_its_exact_value_and_its_unit_is_text():
    found = claim(1.0, 2.5, 1 / 3, 4.0, above=0.25, unit="<b>")
    page = statements_table(suite([run("one")], (found,)))
    assert {float(value) for value in re.findall(r'<data value="([^"]+)"', page)} >= {1 / 3, 4.0, 0.25}
    assert "0.3333 to 4 <b> ( 4 numbers)" in words(page.replace("&lt;b&gt;", "⟨b⟩")).replace("⟨", "<").replace("⟩", ">")
    assert "<b>" not in page


def test_errors_span_decades_below_an_estimate_and_a_perfect_first_guess_is_left_out():
    mean = TRUE + 1e4 * np.geomspace(1e-9, 1e-2, len(TIME))
    mean[0] = TRUE[0]
    drawing = unknown_figure("k", "t", "input", [Line("", History("F", "N", TIME, TRUE, mean, np.full(41, 5.0)))])
    text = drawing.svg.decode()
    assert "10⁻⁸" in text
    assert "10⁻¹³" not in text
    assert "mathdefault" not in text
    assert "±2σ" in text


def test_the_lines_of_several_runs_have_their_labels_and_one_truth():
    lines = [Line(f"run {i}", load(0.1 * i).history) for i in range(3)]
    text = unknown_figure("k", "t", "input", lines).svg.decode()
    assert text.count(">truth<") == 1
    assert all(f">run {i}<" in text for i in range(3))
    coarse = History("F", "N", TIME[::2], TRUE[::2], TRUE[::2], np.full(21, 5.0))
    other = History("F", "N", TIME, 2 * TRUE, TRUE, np.full(41, 5.0))

    def dashes(*histories):
        drawn = unknown_figure("k", "t", "input", [Line("", history) for history in histories]).svg.decode()
        return len(re.findall(r"stroke-dasharray[^\"]*#1c2430", drawn))

    # the second truth is a coarser sampling of the first; the third is another
    assert dashes(lines[0].history, coarse) == dashes(lines[0].history, lines[1].history)
    assert dashes(lines[0].history, other) == dashes(lines[0].history, coarse) + 1


def test_a_filter_that_diverged_leaves_a_gap():
    drawing = unknown_figure("k", "t", "input", [Line("", load(lost_from=20).history)])
    assert b"nan" not in drawing.svg.lower().replace(b"finance", b"")
    nothing = unknown_figure("k", "t", "input", [Line("", load(lost_from=0).history)])
    assert nothing.svg


def test_the_ratio_of_two_loads_is_drawn_where_it_means_something():
    unknown = load(error=0.0, there=4 * TRUE, truth=False)
    drawing = ratio_figure("k", "t", [("", unknown)])
    assert "F$z 0.25 to 0.25" in drawing.caption
    offset = BenchUnknown("input", History("F", "N", TIME, None, TRUE + 1e3, np.ones(41)), there=TRUE)
    large = np.abs(TRUE) > 0.3 * np.abs(TRUE).max()
    quotient = (TRUE[large] + 1e3) / TRUE[large]
    assert f"{quotient.min():.4g} to {quotient.max():.4g}" in ratio_figure("k", "t", [("", offset)]).caption


def test_a_sensor_s_mismatch_is_the_rms_of_what_is_left_over_that_of_the_reading():
    assert mismatch(sensor(off=0.02), 1) == pytest.approx(0.02, rel=1e-12)
    assert math.isnan(mismatch(sensor(), 2))
    drawing = sensor_figure("k", "t", 1, [("a", sensor(off=0.02)), ("b", sensor(off=0.05))])
    assert "a 2.0\u00a0%, b 5.0\u00a0%" in drawing.alt
    assert "the filter was not given it" in sensor_figure("k", "t", 0, [("", sensor(used=False))]).caption
    assert "x 2.0\u00a0%" in components_figure("k", "t", sensor(off=0.02)).caption


def test_runs_over_seeds_say_their_rms_and_how_many_were_lost():
    history = History("D", "m", TIME, np.full(41, 0.06), np.full(41, 0.06), np.full(41, 1e-8))
    unknown = BenchUnknown("parameter", history, 0.06 * np.array([3e-6, -4e-6, np.nan]), np.full(3, 6e-8))
    assert "RMS 3.5×10⁻⁶, largest 4×10⁻⁶; 1 lost" in runs_figure(unknown).caption


def test_a_study_is_drawn_over_what_it_varies_a_line_a_group_zero_beside_the_logarithms():
    runs = [
        run(f"{group} {at}", error, at, group)
        for group, factor in (("iterated", 1e-6), ("one-shot", 1.0))
        for at, error in ((0.0, 1e-3 * factor), (0.01, 2e-3 * factor), (0.1, 3e-3 * factor), (1.0, 5e-3 * factor))
    ]
    drawings = compute_once(study_figures, suite(runs, over="estimate.h"), suite(runs, over="estimate.h").studies[0])
    sweep = drawings[0]
    text = sweep.svg.decode()
    assert "estimate.h" in text
    assert {">0<", ">0.01<", ">0.1<", ">1<"} <= set(re.findall(r">[\d.]+<", text))
    assert all(f">{group}<" in text for group in ("iterated", "one-shot"))
    assert "0.01 0.002" in sweep.alt
    # eight runs do not fit into one figure: a pair a group
    assert [drawing.title for drawing in drawings[1:]] == [
        f"{what} ({group})"
        for group in ("iterated", "one-shot")
        for what in ("F$z: estimate", "relative: measured against estimated")
    ]


def test_a_study_of_few_runs_has_one_pair_and_the_component_that_moves_most():
    own = suite([run("a"), run("b", 0.1)])
    pair = compute_once(study_figures, own, own.studies[0])
    assert [drawing.title for drawing in pair] == ["F$z: estimate", "relative: measured against estimated"]
    assert "relative, y: measured" in pair[1].caption


def test_named_numbers_are_drawn_instead_of_errors():
    runs = [run(str(at), at=at, **{"slope.F$z": 1.0 + at}) for at in (1.0, 2.0)]
    own = suite(runs, over="k", numbers=("slope.F$z",))
    (sweep, *_) = compute_once(study_figures, own, own.studies[0])
    assert "slope.F$z: 1 2, 2 3" in sweep.alt


def test_small_ratios_are_numbers_and_large_ones_per_cent():
    assert [re.sub("<[^>]*>", "", ratio(value)) for value in (3.14e-9, 0.0123, 0.0, None)] == [
        "3.1×10⁻⁹", "1.2\u00a0%", "0.000\u00a0%", "–",
    ]  # fmt: skip


def test_the_table_has_columns_only_for_what_there_is():
    plain = runs_table("runs", [("one", run(nis=-1.0))])
    assert "load ratio" not in plain
    assert "lost" not in plain
    assert "NIS" not in plain
    empty = runs_table("runs", [("one", run(**{"ratio_slope.F$z": math.nan, "ratio_mean.F$z": math.nan}))])
    assert "ratio" not in empty
    more = runs_table(
        "runs", [("one", run(lost=2, runs=20, iterations=3.2, **{"ratio_slope.F$z": 0.25, "identified.F$z": False}))]
    )
    for text in ("load ratio: slope", ">0.25<", "2 of 20", "iterations", ">no<", "0.9</data> ("):
        assert text in more


def test_a_layout_stands_beside_random_ones_and_one_that_loses_a_load_is_reported():
    placement = BenchPlacement(
        np.eye(3), np.eye(3), {"F": 1e3}, {"F": np.array([2e3, np.inf])}, {}, {"F": "N"},
        Trend(np.arange(3), np.ones(3), {}, 1.0, Metric("tr", "the trace")), np.array([1.5, 2.0, np.inf]),
        {"F": np.array([1e3, 2e3, np.inf])},
    )  # fmt: skip
    cells = re.findall(r"<td[^>]*>(.*?)</td>", placement_table(placement))
    assert [re.sub("<[^>]*>", "", cell) for cell in cells[:3]] == ["1\u00a0kN", "2\u00a0kN", "∞\u00a0N"]


def test_pages_are_well_formed_fetch_nothing_and_lead_somewhere():
    runs = [run("<a>"), run("b", **{"identified.F$z": False}), BenchRun("c", "c", study="s", reached="simulate")]
    own = suite(runs, (claim(1.0, above=2.0),))
    pages = [
        suite_page(own, compute_once(suite_figures, own), {}),
        bench_page(runs[1], compute_once(bench_figures, runs[1]), {"k": "<v>"}.items()),
    ]
    for page in pages:
        outline = nothing_comes_from_outside(page)
        assert len(outline.ids) == len(set(outline.ids))
        assert outline.targets <= set(outline.ids)
        assert steps_in_order(outline)
        regions = names_of_regions(outline)
        assert len(regions) == len(set(regions)) > 2
        assert not re.search(r"<a>|<v>|<statement>", page)
        assert "F$z: not identified." in page


def test_a_component_of_rounding_is_drawn_as_none():
    """Of a sensor that is simulated only: 1e-13 N beside 10 N has no scale of its own."""
    wave, noise = np.sin(TIME[1:]), np.random.default_rng(1).standard_normal(len(TIME) - 1)

    def drawn(small):
        read = np.column_stack([10 * wave, small * noise])
        return components_figure("k", "t", BenchSensor("r", TIME[1:], read, None, ("Fx", "Fy"), ("N", "N"), True))

    assert drawn(1e-13) == drawn(0.0) != drawn(1e-10)
