"""Pages of hostile names, of sensors of every kind, and of placements that lack much: nothing breaks, nothing is lost."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from strainsight.report.placement.figures import signal_figure
from strainsight.report.placement.page import placement_page

from ..outline import Outline, nothing_comes_from_outside, own_scripts, words
from .shown import PNG, page


@pytest.mark.parametrize(
    "hostile", ["<script>alert(1)</script>", "\"><img src=x onerror='1'>", "F" * 400, "力 & Ж $x^2 \\frac{", "_"]
)
def test_hostile_names_come_out_escaped(full, hostile):
    report = full()
    loads = tuple(replace(load, name=hostile) for load in report.layout.loads)
    gauges = tuple(
        replace(gauge, label=hostile, without={hostile: 0.1}, kind=hostile, mirror=hostile, peak=1.0, unit=hostile)
        for gauge in report.layout.gauges
    )
    hostile_report = replace(
        report,
        name=hostile,
        title=hostile,
        unknowns=tuple(replace(unknown, name=hostile, unit=hostile) for unknown in report.unknowns),
        layout=replace(report.layout, loads=loads, gauges=gauges),
        trend=replace(report.trend, blocks={hostile: report.trend.value, hostile + "2": report.trend.value}),
        histories=tuple(replace(entry, name=hostile, unit=hostile) for entry in report.histories),
        gauge_signals=tuple(replace(entry, label=hostile, unit=hostile) for entry in report.gauge_signals),
        random_sets=tuple(replace(entry, name=hostile) for entry in report.random_sets),
        noise=tuple(replace(row, error={hostile: 0.1}, std={hostile: 0.1}) for row in report.noise),
        repeats=tuple(replace(entry, name=hostile) for entry in report.repeats),
        criteria=tuple(replace(entry, rule=hostile, std={hostile: 0.1}) for entry in report.criteria),
        cases=tuple(replace(case, unknowns=(hostile,), excitation=hostile, lost=hostile) for case in report.cases),
        advice=(hostile,),
        observability={hostile: 2.0},
        truth_description=hostile,
        warnings=(hostile,),
        not_tested=(hostile,),
        facts={hostile: hostile},
        provenance={hostile: hostile},
    )
    outline = nothing_comes_from_outside(page(hostile_report, None, hostile, drawn=True))
    ordinary = Outline(page(full(), None, "none"))
    assert own_scripts(outline) == own_scripts(ordinary)
    assert [tag for tag, _ in outline.seen].count("script") == [tag for tag, _ in ordinary.seen].count("script")
    assert "img" not in outline.tags
    assert any(hostile in text for text in outline.text)


def test_a_placement_without_validation_bound_or_picture_has_a_page(bare):
    text = page(bare, None, "no off-screen OpenGL: apt-get install libegl1", drawn=True)
    Outline(text)
    assert "no off-screen OpenGL" in text
    assert "not certified" in text
    for missing in ("What they tell", "Beside random sets", "How sure one can be", "Warnings", "nan", "None"):
        assert missing not in text.split("</style>")[1]


def test_gauges_that_carry_an_unknown_alone_are_marked(full):
    report = full()
    first, *rest = report.layout.gauges
    gauges = (replace(first, without={"E": np.inf}), *rest)
    text = page(replace(report, layout=replace(report.layout, gauges=gauges)))
    assert "can no longer be observed" in text
    assert '<data value="inf">∞</data>' in text


def test_what_to_do_stands_between_the_answer_and_the_gauges(full):
    text = placement_page(full(advice=("2 gauges more would lower σ by 7 % & more.",)), (), PNG)
    advice = text.index("<li>2 gauges more would lower σ by 7 % &amp; more.</li>")
    assert text.index("Where the gauges go") < text.index("</section>") < advice < text.index("σ(E) without it")
    assert "What to do with this layout" not in placement_page(full(advice=()), (), PNG)


def key_of(text):
    return [(mark, words(said)) for mark, said in re.findall(r'<li><i class="(\w*)"[^>]*></i>(.*?)</li>', text)]


def test_the_key_of_the_picture_names_only_what_occurs(full, mixed):
    assert key_of(placement_page(full(), (), PNG)) == [
        ("bar", "4 strain gauges"),
        ("dot", f"{len(full().layout.pool)} candidates in the pool"),
        ("", "load tip (known)"),
        ("", "clamped nodes"),
    ]
    assert key_of(placement_page(mixed(), (), PNG))[:5] == [
        ("bar", "2 strain gauges"),
        ("star", "1 rosette"),
        ("block", "2 accelerometers"),
        ("cone", "1 displacement sensor"),
        ("hollow", "2 of them bonded already"),
    ]


def test_a_page_of_every_kind_of_sensor(mixed):
    text = page(mixed(), drawn=True)
    Outline(text)
    assert "6 sensors, 2 of them bonded already, chosen from 30 candidates" in words(text)
    assert "<h2>Readings</h2>" in text
    assert text.index("Gauge G2 0°") < text.index("Gauge G2 45°") < text.index("Gauge G4 x")


def test_many_readings_are_folded_away_and_none_is_lost(full):
    report = full()
    drawing = signal_figure(report.gauge_signals[0], "#0072b2")
    drawings = [replace(drawing, key=f"signal-G{i}", title=f"Gauge G{i}") for i in range(1, 31)]
    text = placement_page(report, tuple(drawings), None)
    Outline(text)
    assert "18 more</summary>" in text
    assert text.count("<h3>Gauge G") == 30
    assert "<details>" not in placement_page(report, tuple(drawings[:12]), None)


def test_a_placement_without_unknowns_has_a_page(full):
    text = page(full(unknowns=(), histories=(), random_sets=(), noise=(), repeats=(), cases=(), advice=()), drawn=True)
    Outline(text)
    assert "4 gauges, chosen from 30 candidates . " in words(text)
    assert "steady-state σ(" not in text


@pytest.mark.parametrize("lost", [np.nan, np.inf])
def test_a_placement_of_which_nothing_is_a_number_has_a_page(mixed, lost):
    report = mixed()

    def gone(entry, *names):
        old = {name: getattr(entry, name) for name in names}
        return replace(entry, **{name: np.full_like(value, lost) for name, value in old.items() if value is not None})

    broken = replace(
        report,
        unknowns=tuple(replace(unknown, error=lost, std=lost, expected_std=lost) for unknown in report.unknowns),
        histories=tuple(gone(entry, "mean", "std", "smoothed", "smoothed_std") for entry in report.histories),
        gauge_signals=tuple(gone(entry, "measured", "estimated", "std") for entry in report.gauge_signals[:1]),
        criteria=tuple(replace(entry, values=(lost,) * 3, std={"E": lost}) for entry in report.criteria),
        cases=tuple(replace(case, condition=lost, raw=lost) for case in report.cases),
        trend=replace(gone(report.trend, "value"), blocks={}, final=lost, lower_bound=lost, gap=lost),
        random_sets=(),
        repeats=(),
    )
    Outline(page(broken, drawn=True))
