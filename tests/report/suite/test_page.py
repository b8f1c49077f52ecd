"""The page of a suite: self-contained, escaped, an answer a run first, and what failed is said in words."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from strainsight.report.page.document import own
from strainsight.report.placement.data import Benefit
from strainsight.report.suite.data import Statement, Study
from strainsight.report.suite.figures import suite_figures
from strainsight.report.suite.page import suite_page

from ...models import compute_once
from ..conftest import suite_report
from ..outline import Outline, names_of_regions, nothing_comes_from_outside, own_scripts, steps_in_order, words

PNG, OTHER = b"\x89PNG not really", b"\x89PNG another"

SCENES = {"beam-E": PNG, "beam-tip-E": OTHER, "beam-wrong": OTHER}


def page(report, scenes=SCENES, drawings=()):
    return suite_page(report, drawings, scenes)


@cache
def usual():
    """Figures of the suite of `suite()`, drawn once."""
    return compute_once(suite_figures, suite_report())


def first_screen(text):
    return text[text.index("<header>") : text.index("</section>")]


def test_the_page_is_well_formed_and_every_link_within_it_leads_somewhere(suite):
    outline = Outline(page(suite(), drawings=usual()))
    assert len(outline.ids) == len(set(outline.ids))
    assert {"run-1", "run-2", "run-3", "run-4"} <= outline.targets <= set(outline.ids)
    assert steps_in_order(outline)
    regions = names_of_regions(outline)
    assert len(regions) == len(set(regions)) > 5


def test_placements_have_studies_and_statements_too(suite):
    runs = tuple(
        replace(run, study="Step", at=float(i), numbers={"validate": {"error.E": 0.01 * i, "std.E": 0.02}})
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
    outline = nothing_comes_from_outside(page(suite(), drawings=usual()))
    assert own_scripts(outline)[0] == own("page/tables.js")


def test_every_picture_has_a_text_for_those_who_do_not_see_it(suite):
    for tag, attributes in Outline(page(suite(), drawings=usual())).seen:
        if tag == "img":
            assert "4 gauges of a pool of 30" in attributes["alt"]
            assert "G1 – G3 120\u00a0mm" in attributes["alt"]
        if tag == "svg" and attributes.get("aria-hidden") != "true":
            assert attributes["role"] == "img"
            assert len(attributes["aria-label"]) > 20


def test_the_exact_numbers_stand_in_the_first_table(suite):
    report = suite()
    first = first_screen(page(report))
    exact = {float(value) for value in re.findall(r'<data value="([^"]+)"', first)}
    for run in report.runs[:3]:
        for unknown in run.unknowns:
            assert (unknown.error if unknown.kind == "parameter" else unknown.smoothed_error) in exact
        assert {run.trend.value[0], run.trend.final, run.trend.gap} <= exact
        assert any(np.isclose(value, run.trend.final / run.trend.value[0]) for value in exact)
    assert np.max(np.abs(report.runs[1].repeats[0].error)) in exact
    assert "4 of 30" in words(first)


def test_what_failed_is_reported_in_words(suite):
    first = words(first_screen(page(suite())))
    assert first.count("✕ not identified") == 1
    assert first.count("✕ overconfident") == 2
    assert "✕ overconfident (RMS error of the repeats 6.6 times the claimed σ)" in first
    assert "E: overconfident (error 25 times the claimed σ, at most 3.21 where it holds)." in words(page(suite()))
    assert "✓ consistent" in first
    assert "not estimated (ends after observe): no gauge tells all three." in first


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


def test_a_placement_that_brings_no_benefit_is_counted_on_the_first_screen(suite):
    run = suite().runs[0]
    none = tuple(replace(unknown, benefit=Benefit(6, 10, "none")) for unknown in run.unknowns)
    text = words(first_screen(page(suite(runs=(replace(run, unknowns=none),)))))
    assert "Placement brings no benefit in run 1 ." in text
    assert "no benefit" not in words(page(suite()))


def test_a_load_that_is_zero_is_reported_to_be_judged_by_its_amplitude(suite):
    run = suite().runs[1]
    zero = tuple(replace(unknown, zero=unknown.kind == "input") for unknown in run.unknowns)
    assert "tip, load, zero: in % of its amplitude" in words(
        first_screen(page(suite(runs=(replace(run, unknowns=zero),))))
    )
    assert "of its amplitude" not in words(first_screen(page(suite())))


def test_a_diverged_repeat_is_reported_in_words(suite):
    run = suite().runs[0]
    error = np.append(run.repeats[0].error[:-1], np.nan)
    text = page(suite(runs=(replace(run, repeats=(replace(run.repeats[0], error=error),)),)))
    assert "✕ diverged ( 1 of 20 repeats)" in words(first_screen(text))
    assert "E: diverged ( 1 of 20 repeats)." in words(text)


def test_long_words_do_not_widen_the_page(suite):
    text = page(suite())
    rules = re.findall(r"([^{}]+)\{([^{}]*)\}", text)
    wrapped = {name.strip() for names, rule in rules if "overflow-wrap: anywhere" in rule for name in names.split(",")}
    assert {"p", "small", "h3", "tbody th", "td.v", "figcaption"} <= wrapped
    assert '<td class="v" colspan=' in text


def test_a_run_that_was_only_placed_says_what_is_expected(suite):
    first, *_ = suite().runs
    bare = tuple(replace(unknown, error=None, std=None, estimate=None) for unknown in first.unknowns)
    text = words(first_screen(page(suite(runs=(replace(first, unknowns=bare, reached="place", repeats=()),)))))
    assert "not estimated (ends after place)" in text
    assert "expected when placed: E ± 0.079\u00a0%".replace("\u00a0", " ") in text.replace("\u00a0", " ")


def test_every_row_leads_to_its_section_and_to_its_page_where_there_is_one(suite):
    links = [
        attributes["href"]
        for tag, attributes in Outline(first_screen(page(suite())) + "</section></main>").seen
        if tag == "a"
    ]
    assert links.count("../beam-E/report.html") == 1
    assert [link for link in links if link == "#run-2"]
    assert not any(link.startswith("../beam-tip") for link in links)


def test_a_picture_that_runs_share_is_shown_once(suite):
    text = page(suite())
    assert text.count("<img") == 2
    assert "2. tip + E, 20 Hz<br>3. tip + E, slow" in text
    assert "<img" not in page(suite(), {})
    assert "Where the gauges go" in page(suite(), {})


def test_a_suite_of_nothing_but_observed_runs_has_a_page(suite):
    text = page(suite(runs=suite().runs[3:]), {})
    Outline(text)
    assert "Where the gauges go" not in text
    assert "What can be distinguished" in text
    Outline(page(suite(runs=()), {}))


@pytest.mark.parametrize(
    "hostile",
    [
        "<script>alert(1)</script>",
        "\"><img src=x onerror='1'>",
        "javascript:alert(1)",
        "F" * 400,
        "力 & Ж $x^2 \\frac{",
        "_",
    ],
)
def test_hostile_names_come_out_escaped(suite, hostile):
    report = suite()
    runs = tuple(
        replace(
            run,
            name=hostile,
            label=hostile,
            note=hostile,
            page=hostile,
            reached=hostile,
            unknowns=tuple(replace(unknown, name=hostile, unit=hostile) for unknown in run.unknowns[:1]),
            layout=run.layout
            and replace(
                run.layout,
                gauges=tuple(replace(gauge, label=hostile) for gauge in run.layout.gauges),
                loads=tuple(replace(load, name=hostile) for load in run.layout.loads),
            ),
            expected_std={hostile: 0.1},
            histories=tuple(replace(entry, name=hostile, unit=hostile) for entry in run.histories[:1]),
            repeats=tuple(replace(entry, name=hostile) for entry in run.repeats),
            cases=tuple(replace(case, unknowns=(hostile,), excitation=hostile, lost=hostile) for case in run.cases),
            truth_description=hostile,
            pairs=((hostile, hostile, 0.1),) * bool(run.pairs),
            warnings=(hostile,),
        )
        for run in report.runs
    )
    report = replace(report, name=hostile, title=hostile, runs=runs, provenance={hostile: hostile})
    text = page(report, {}, compute_once(suite_figures, replace(report, runs=runs[1:])))
    outline = nothing_comes_from_outside(text)
    assert own_scripts(outline) == own_scripts(Outline(page(suite(), {})))
    assert "img" not in outline.tags
    assert not any(":" in attributes.get("href", "") for _, attributes in outline.seen)
    assert any(hostile in text for text in outline.text)


def test_results_that_are_no_numbers_have_a_page(suite):
    run = suite().runs[0]
    broken = replace(
        run,
        unknowns=tuple(replace(unknown, error=np.nan, std=np.nan) for unknown in run.unknowns),
        trend=replace(run.trend, final=np.inf, gap=np.nan, value=np.full_like(run.trend.value, np.inf)),
        cases=tuple(replace(case, condition=np.nan) for case in run.cases),
    )
    text = page(suite(runs=(broken,)), drawings=compute_once(suite_figures, suite(runs=(broken,))))
    Outline(text)
    assert "diverged" in text
