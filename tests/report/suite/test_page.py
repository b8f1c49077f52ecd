"""Page and figures of a suite: self-contained, escaped, an answer a run first, and they survive what a run may lack."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from strainsight.report.page.document import own
from strainsight.report.suite.data import Statement, Study
from strainsight.report.suite.figures import suite_figures
from strainsight.report.suite.page import suite_page

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
        studies=(Study("Step", "What it costs.", "train.time_step", (), (0, 1, 2)),),
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
    assert own_scripts(outline)[0] == own("page/tables.js")


def test_what_does_not_hold_leads_the_page_and_its_headline(suite):
    text = page(suite())
    said = words(text[text.index('id="in-short"') :].split("</p>")[0].partition(">")[2])
    assert said.startswith("1 not identified (run 2 ), 2 overconfident (runs 2 , 3 ), 1 consistent (run 1 )")
    assert "<h1>✕ 1 not identified, 2 overconfident of 4 runs – The beam of chapter 6.1</h1>" in text
    own = words(text[text.index('id="run-3"') :])
    assert own.index("E: overconfident") < own.index("tell tip")
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
    report = suite(runs=(broken, broken_end, third, seen))
    drawings = compute_once(suite_figures, report)
    assert {"pbh", "errors", "trends"} < {drawing.key for drawing in drawings}
    assert "diverged" in "".join(whole(page(report, drawings=drawings)).text)
    assert "trends" not in drawn(suite(runs=(broken,)))
