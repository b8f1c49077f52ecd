"""Page, figures, comparisons and results of a suite: self-contained, escaped, and they survive what a run may lack."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from strainsight.pages.arrays import rms
from strainsight.pages.page.sections import text_of
from strainsight.pages.suite.data import (
    CONTRADICTED,
    HOLDS,
    OURS_ONLY,
    THEIRS_ONLY,
    UNDECIDED,
    UNMEASURED,
    SourceComparison,
    Statement,
    Suite,
    SuiteStudy,
    comparisons_answer,
)
from strainsight.pages.suite.figures import suite_figures
from strainsight.pages.suite.page import suite_page
from strainsight.pages.suite.summary import counts, groups_of, results_of, series_of

from ...models import compute_once
from ...shared import slowly
from ..conftest import suite_report
from ..outline import HOSTILE, Outline, nothing_comes_from_outside, own_scripts, renamed, whole, words

PNG, OTHER = b"\x89PNG not really", b"\x89PNG another"

SCENES = {"beam-E": PNG, "beam-tip-E": OTHER, "beam-wrong": OTHER}


def page(report, scenes=SCENES, drawings=()):
    return suite_page(report, drawings, scenes)


@cache
def usual():
    return compute_once(suite_figures, suite_report())


def first_screen(text):
    return text[text.index("<header>") : text.index("</section>")]


def test_placements_have_studies_and_statements_too(suite):
    runs = tuple(
        replace(run, study="Step", at=float(i), numbers={"validate": {"error.E": 0.01 * i, "std.E": 0.02}}, histories=())
        for i, run in enumerate(suite().runs[:3], start=1)
    )
    own = suite(
        runs=runs,
        studies=(SuiteStudy("Step", "What it costs.", "train.time_step", (), (0, 1, 2)),),
        statements=(Statement("E is known.", ((0, "error.E", 0.01),), below=0.05),),
    )
    drawings = compute_once(suite_figures, own)
    (sweep,) = (drawing for drawing in drawings if drawing.key.startswith("study-"))
    assert "error of E: 1 0.01, 2 0.02, 3 0.03" in sweep.alt
    text = page(own, drawings=drawings)
    assert len(Outline(text).ids) == len(set(Outline(text).ids))
    assert "1 consistent (run 1 ); run 2 both. 1 statement : 1 confirmed; from 3 runs, 3 with an estimate." in words(text)
    assert text.index("E is known.") < text.index('data-table="runs"') < text.index("What it costs.") < text.index(sweep.caption)


def test_nothing_is_fetched_and_nothing_runs_but_what_the_policy_names(suite):
    outline = whole(page(suite(), drawings=usual()))
    assert {"run-1", "run-2", "run-3", "run-4"} <= outline.targets
    assert own_scripts(outline)[0] == text_of("page/tables.js")


def test_what_does_not_hold_leads_the_page_and_its_headline(suite):
    text = page(suite())
    said = words(text[text.index('id="in-short"') :].split("</p>")[0].partition(">")[2])
    assert said.startswith("1 not identified (run 2 ), 2 overconfident (runs 2 , 3 ), 1 consistent (run 1 )")
    assert "<h1>✕ 1 not identified, 2 overconfident of 4 runs – The beam of chapter 6.1</h1>" in text
    own = words(text[text.index('id="run-3"') :])
    assert own.index("E: overconfident") < own.index("estimate tip")
    good = page(suite(runs=suite().runs[:1]))
    assert "<h1>The beam of chapter 6.1</h1>" in good
    assert "✕" not in first_screen(good)


@pytest.mark.parametrize("hostile", [HOSTILE, "javascript:alert(1)", *slowly("F" * 400, "_")])
def test_hostile_names_come_out_escaped(suite, hostile):
    runs = tuple(replace(run, unknowns=run.unknowns[:1], histories=run.histories[:1]) for run in suite().runs[1:])
    report = renamed(suite(runs=runs), hostile)
    text = page(report, {}, compute_once(suite_figures, report))
    outline = nothing_comes_from_outside(text)
    assert own_scripts(outline) == own_scripts(Outline(page(suite(), {})))
    assert "img" not in outline.tags
    assert not any(":" in attributes.get("href", "") for _, attributes in outline.seen)
    assert any(hostile in text for text in outline.text)


def written(drawing):
    return " ".join("".join(node.itertext()) for node in ET.fromstring(drawing.svg).iter() if node.tag.endswith("text"))


def drawn(report):
    return {drawing.key: drawing for drawing in compute_once(suite_figures, report)}


def test_a_suite_has_every_figure_once_small_and_with_units():
    drawings = usual()
    assert [drawing.key for drawing in drawings] == [
        "pbh", "errors", "trends", "estimate-1-E", "estimate-2-tip", "estimate-2-E", "estimate-3-tip", "estimate-3-E",
    ]  # fmt: skip
    for drawing in drawings:
        assert len(drawing.svg) < 200 * 1024
        assert "[" in written(drawing)
        assert len(drawing.alt) > 20
        assert drawing.caption


@pytest.mark.parametrize("lost", [np.nan, *slowly(np.inf)])
def test_numbers_that_are_none_are_survived(suite, lost):
    first, second, third, seen = suite().runs
    trace = np.full_like(first.trend.value, lost)
    broken = replace(
        first,
        unknowns=tuple(
            replace(unknown, error=lost, std=lost, repeats=replace(unknown.repeats, error=np.full(20, lost)))
            for unknown in first.unknowns
        ),
        trend=replace(first.trend, value=trace, final=lost),
        cases=tuple(replace(case, condition=lost) for case in first.cases),
    )
    late = np.where(np.arange(len(trace)) < 20, second.trend.value, lost)
    broken_end = replace(
        second,
        trend=replace(second.trend, value=late, final=lost),
        unknowns=tuple(replace(unknown, std=lost, smoothed_error=0.1) for unknown in second.unknowns),
    )
    report = suite(runs=(broken, broken_end, third, seen))
    drawings = compute_once(suite_figures, report)
    assert {"pbh", "errors", "trends"} < {drawing.key for drawing in drawings}
    assert "diverged" in "".join(whole(page(report, drawings=drawings)).text)
    assert "trends" not in drawn(suite(runs=(broken,)))


NAN = float("nan")


def row(theirs, ours):
    """A row whose number has to be below 1; None: that side is not measured."""
    sides = [None if value is None else Statement("s", ((0, "n", value),), below=1.0) for value in (theirs, ours)]
    return SourceComparison("figure 2.4", "It <falls>.", "4", *sides, why="Because.")


@pytest.mark.parametrize(
    ("theirs", "ours", "verdict"),
    [
        (0.5, 0.5, HOLDS),
        (0.5, None, HOLDS),
        (None, 0.5, HOLDS),
        (0.5, 2.0, THEIRS_ONLY),
        (2.0, 0.5, OURS_ONLY),
        (2.0, 2.0, CONTRADICTED),
        (2.0, None, CONTRADICTED),
        (None, 2.0, CONTRADICTED),
        (NAN, 0.5, UNDECIDED),
        (0.5, NAN, UNDECIDED),
        (2.0, NAN, CONTRADICTED),
        (NAN, 2.0, CONTRADICTED),
        (NAN, None, UNDECIDED),
        (None, None, UNMEASURED),
    ],
)
def test_the_result(theirs, ours, verdict):
    assert row(theirs, ours).result == verdict


def test_the_answer_counts_rows_and_links_those_that_do_not_simply_hold():
    own = row(0.5, 0.5), row(0.5, 2.0), row(2.0, 2.0)
    suite = Suite("s", "t", (), comparisons=own)
    text = re.sub(r"</?data[^>]*>", "", comparisons_answer(suite))
    assert "3 comparisons</strong>: 1 holds, 1 holds with source settings only" in text
    assert '1 contradicted (<a href="#comparison-3">3</a>)' in text
    twice = Suite("s", "t", (), comparisons=(*own, *own))
    assert "2 hold, 2 hold with source settings only" in re.sub(r"</?data[^>]*>", "", comparisons_answer(twice))
    assert comparisons_answer(Suite("s", "t", ())) == ""


def test_every_run_comes_to_what_its_numbers_say(suite):
    found = counts(suite())
    assert found == {"consistent": [1], "overconfident": [2, 3], "not identified": [2], "not estimated": [4]}
    assert list(found) == ["not identified", "overconfident", "consistent", "not estimated"]  # what does not hold first


def test_a_smoothed_load_is_measured_by_its_smoothed_claim(suite):
    run = suite().runs[1]
    load, modulus = results_of(run)
    assert load.smoothed
    assert load.error == run.unknowns[0].smoothed_error
    assert load.std == run.unknowns[0].smoothed_std
    assert not modulus.smoothed
    assert modulus.std == run.unknowns[1].std


def test_the_claim_that_decides_is_the_result(suite):
    run = suite().runs[0]
    held, repeated = run.unknowns[0].claims
    for claims, verdict, wrong in (
        ((held, repeated), "consistent", ()),
        ((replace(repeated, result="too cautious"), held), "too cautious", ()),
        ((replace(repeated, result="overconfident"), held), "overconfident", ("overconfident",)),
        ((), "no claim", ()),
    ):
        own = replace(run, unknowns=(replace(run.unknowns[0], claims=claims),))
        (result,) = results_of(own)
        assert (result.status, result.problems) == (verdict, wrong)
        assert result.unknown.repeats.worst == pytest.approx(0.0007)


def repeated(run, error):
    """The run with other errors of its repeats."""
    return replace(run, unknowns=tuple(replace(own, repeats=replace(own.repeats, error=error)) for own in run.unknowns))


def test_repeats_that_diverged_are_left_out_of_the_numbers(suite):
    run = suite().runs[0]
    (result,) = results_of(repeated(run, np.full(20, np.nan)))
    repeats = result.unknown.repeats
    assert (repeats.worst, repeats.lost, result.status) == (np.inf, 20, "diverged")


def test_one_lost_repeat_makes_the_worst_infinite_and_leaves_the_rms_of_the_others(suite):
    run = suite().runs[0]
    (result,) = results_of(repeated(run, np.append(np.full(19, 0.0007), np.inf)))
    repeats = result.unknown.repeats
    assert (rms(repeats.error), repeats.worst, repeats.lost) == (pytest.approx(0.0007), np.inf, 1)
    assert result.problems == ("diverged",)


def test_runs_with_the_same_excitation_are_one_series(suite):
    series = series_of(suite())
    assert [entry.runs for entry in series] == [(1, 2, 4), (1, 2, 4), (3,), (3,)]
    assert [entry.heading for entry in series][:2] == ["runs 1, 2 and 4", "runs 1, 2 and 4 at 35 Hz"]
    # tip is a load of the layout, rho is not: loads are "input" in all runs, however many they are.
    assert groups_of(series) == ("input", "E + rho", "input + E + rho")
