"""The page: self-contained, escaped, and every number on its first screen is the report's."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest

from strainsight.report.data import Consistency
from strainsight.report.figures import placement_figures
from strainsight.report.page import placement_page
from strainsight.report.signals import signal_figure

VOID = {"meta", "img", "br", "link", "input"}
PNG = b"\x89PNG not really"


class Outline(HTMLParser):
    """Tags in order, with a check that each is closed; texts; attributes."""

    def __init__(self, text):
        super().__init__()
        self.open, self.seen, self.text = [], [], []
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        self.seen.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


def page(report, scene=PNG, problem=""):
    return placement_page(report, placement_figures(report), scene, problem)


def test_the_page_is_well_formed_and_every_identifier_is_its_own(full):
    outline = Outline(page(full()))
    ids = [attributes["id"] for _, attributes in outline.seen if "id" in attributes]
    assert len(ids) == len(set(ids))
    used = {attributes["href"][1:] for _, attributes in outline.seen if attributes.get("href", "").startswith("#")}
    assert used <= set(ids)


def test_nothing_is_fetched_from_anywhere(full):
    text = page(full())
    assert not re.search(r"https?:|//[a-z]", text)
    outline = Outline(text)
    assert {tag for tag, _ in outline.seen}.isdisjoint({"script", "link", "iframe", "object", "embed", "base"})
    sources = [value for _, attributes in outline.seen for name, value in attributes.items() if name == "src"]
    assert len(sources) == 1
    assert sources[0].startswith("data:image/png;base64,")
    assert not re.search(r"url\((?!#)", text)


def test_every_picture_has_a_text_for_those_who_do_not_see_it(full):
    for tag, attributes in Outline(page(full())).seen:
        if tag == "img":
            assert "G1 at 0.1000" in attributes["alt"]
        if tag == "svg":
            assert attributes["role"] == "img"
            assert len(attributes["aria-label"]) > 20


def test_the_exact_numbers_stand_on_the_first_screen(full):
    report = full()
    text = page(report)
    first = text[text.index("<header>") : text.index("What they tell")]
    exact = {float(value) for value in re.findall(r'<data value="([^"]+)"', first)}
    for unknown in report.unknowns:
        for value in (unknown.estimate, unknown.truth, unknown.error, unknown.std, unknown.expected_std):
            assert value in exact
    assert {report.trend.final_trace, report.trend.lower_bound, report.trend.gap, 0.001, 0.004} <= exact
    assert "209.9\u00a0GPa" in first
    assert "0.052\u00a0%" in first
    assert "4 gauges, chosen from 30 candidates" in first
    assert "The weakest unknown is tip." in first
    for phrase in ("Not identified: E", "G1 and G2 are 200 mm apart.", "Temperature."):
        assert phrase in first


def test_the_mark_says_when_the_claim_did_not_hold(full):
    report = full(repeats=())
    wrong = tuple(replace(unknown, error=9 * unknown.std) for unknown in report.unknowns)
    assert page(report).count("as claimed") == 2
    assert page(replace(report, unknowns=wrong)).count("the claim did not hold") == 2
    assert "overconfident" in page(full(consistency=Consistency(nis=1.31, nis_band=(0.96, 1.04))))


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
        trend=replace(report.trend, blocks={hostile: report.trend.trace, hostile + "2": report.trend.trace}),
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
    outline = Outline(page(hostile_report, None, hostile))
    assert {tag for tag, _ in outline.seen}.isdisjoint({"script", "img"})
    assert not any(name.startswith("on") for _, attributes in outline.seen for name in attributes)
    assert any(hostile in text for text in outline.text)


def test_a_placement_without_validation_bound_or_picture_has_a_page(bare):
    text = page(bare, None, "no off-screen OpenGL: apt-get install libegl1")
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


def test_what_to_do_stands_between_the_picture_and_the_gauges(full):
    text = placement_page(full(advice=("2 gauges more would lower σ by 7 % & more.",)), (), PNG)
    advice = text.index("<li>2 gauges more would lower σ by 7 % &amp; more.</li>")
    assert text.index("Where the gauges go") < advice < text.index("σ(E) without it")
    assert "What to do with this layout" not in placement_page(full(advice=()), (), PNG)


def key_of(text):
    return re.findall(r'<li><i class="(\w*)"[^>]*></i>([^<]*)</li>', text)


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
        ("hollow", "2 of them glued already"),
    ]


def test_a_page_of_every_kind_of_sensor(mixed):
    text = page(mixed())
    Outline(text)
    assert "6 sensors, 2 of them glued already, chosen from 30 candidates" in text
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
    text = page(full(unknowns=(), histories=(), random_sets=(), noise=(), repeats=(), cases=(), advice=()))
    Outline(text)
    assert "4 gauges, chosen from 30 candidates</strong>. No other set" in text
    assert "frozen σ(" not in text


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
        criteria=tuple(
            replace(entry, trace=lost, log_determinant=lost, worst_eigenvalue=lost, std={"E": lost})
            for entry in report.criteria
        ),
        cases=tuple(replace(case, condition=lost, raw=lost) for case in report.cases),
        trend=replace(gone(report.trend, "trace"), blocks={}, final_trace=lost, lower_bound=lost, gap=lost),
        random_sets=(),
        repeats=(),
    )
    Outline(page(broken))
