"""Pages and figures of placements: self-contained, escaped, exact on the first screen, and whole where much is lacking."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from strainsight.config.placement import Report
from strainsight.estimation.decision import Benefit
from strainsight.pages.chart.drawing import recorded_figures
from strainsight.pages.page.sections import SPACE_SCRIPTS, text_of
from strainsight.pages.placement.figures import elbow, frequency_response_figure, placement_figures
from strainsight.pages.placement.page import placement_page
from strainsight.runner.output import Table

from ...models import compute_once
from ...shared import slowly
from ..conftest import report as whole_report
from ..outline import HOSTILE, Outline, nothing_comes_from_outside, own_scripts, renamed, whole, words

PNG = b"\x89PNG not really"


@cache
def figures_once():
    """Of the full report: most tests change its texts, and drawing is what takes the time."""
    return compute_once(placement_figures, whole_report())


def page(report, scene=PNG, problem="", *, drawn=False):
    """drawn: with figures of its own, not those of the full report."""
    return placement_page(report, compute_once(placement_figures, report) if drawn else figures_once(), scene, problem)


def first_screen(text):
    """Sentence and section that a reader decides from."""
    return text[text.index('<p class="answer"') : text.index("<h2>Gauges</h2>")]


def test_nothing_is_fetched_and_nothing_runs_but_what_the_policy_names(full, mixed):
    whole(page(mixed()))
    outline = whole(page(full()))
    assert [attributes["src"][:22] for tag, attributes in outline.seen if tag == "img"] == ["data:image/png;base64,"]
    assert own_scripts(outline) == [text_of("page/tables.js"), "\n".join(map(text_of, SPACE_SCRIPTS))]


def test_the_exact_numbers_stand_on_the_first_screen(full):
    report = full()
    first = first_screen(page(report))
    exact = {float(value) for value in re.findall(r'<data value="([^"]+)"', first)}
    load, _ = report.unknowns
    for unknown in report.unknowns:
        assert {unknown.error, unknown.expected_std, unknown.expected_std * unknown.reference} <= exact
    assert {report.trend.gap, len(report.layout.gauges), 30, len(report.layout.pool)} <= exact
    whole_page = page(report)
    exact = {float(value) for value in re.findall(r'<data value="([^"]+)"', whole_page)}
    for unknown in report.unknowns:
        assert {unknown.estimate, unknown.truth, unknown.std} <= exact
    assert {load.smoothed_error, report.trend.final, report.trend.lower_bound} <= exact
    for gauge in report.layout.gauges:
        assert {*gauge.position.tolist(), *gauge.normal.tolist(), gauge.without["E"]} <= exact
    assert "209.9\u00a0GPa" in whole_page
    assert "0.052\u00a0%" in first
    said = words(first)
    assert "4 gauges chosen from 30 candidates estimate tip to within ± 16 % (expected σ)." in said
    for phrase in ("not identified (the measurements hardly reduce the initial uncertainty of this unknown)",
                   "Temperature.", "Warnings G1 and G2 are 200 mm apart."):
        assert phrase in said


def test_the_tile_of_a_zero_load_states_the_amplitude_of_its_relative_values(full):
    load, *others = full().unknowns
    assert "amplitude, as the load is zero" not in words(first_screen(page(full())))
    zero = full(unknowns=(replace(load, zero=True, reference=1234.0), *others))
    assert "amplitude, as the load is zero 1.23 kN" in words(first_screen(page(zero))).replace("\u00a0", " ")


def test_sections_stand_in_the_order_of_their_use(full):
    """Answer, gauges, what limits the accuracy, validation; details, which are not printed, at the end."""
    text = page(full())
    headings = re.findall(r"<h2[^>]*>([^<]*)</h2>", text.split('class="details"')[0])
    order = ["Gauge positions", "Warnings", "Gauges", "Sources of uncertainty", "Advice on this layout", "Simulated test"]
    assert [heading for heading in headings if heading in order] == order
    for heading in ("Quality of the layout", "Model and provenance"):
        assert heading in text.split('class="details"')[1]


def observed(full, **changes):
    """What the first screen says is not observable."""
    text = first_screen(page(full(**changes)))
    return words(text.split("<h2>Observability</h2>")[1].split("</ul>")[0]) if "Observability" in text else None


def test_what_cannot_be_distinguished_is_reported_by_its_smallest_sets(full):
    cases = full().cases
    assert observed(full) == "All unknowns are observable. E, rho and tip: jointly weakly observable."
    pair = tuple(replace(case, unknowns=("tip", "rho"), lost="tip and rho") for case in cases[1::3])
    # With the pair goes the set of three that it is part of.
    assert observed(full, cases=cases + pair) == (
        "All unknowns are observable. rho and tip: jointly weakly observable."
    )
    once = tuple(replace(case, lost="") if case.excitation == "35 Hz" else case for case in cases)
    assert "E, rho and tip: jointly weakly observable at training simulation." in observed(full, cases=once)


def test_what_was_asked_for_and_is_lost_is_reported_loudly(full):
    asked = tuple(replace(case, unknowns=("E", "tip")) if case.lost else case for case in full().cases)
    assert observed(full, cases=asked) == "E and tip: jointly weakly observable."
    never = tuple(replace(case, condition=np.inf) for case in asked)
    assert observed(full, cases=never) == "E and tip: jointly not observable."
    load, modulus = full().unknowns
    assert observed(full, unknowns=(load, replace(modulus, std=np.inf))).startswith("Not observable with these gauges: E.")
    assert '<strong class="bad">' in first_screen(page(full(cases=asked)))
    assert observed(full, cases=(), unknowns=(load, modulus)) == "All unknowns are observable."
    assert observed(full, cases=(), unknowns=(load, replace(modulus, expected_std=None))) is None


def test_what_does_not_hold_leads_the_page_and_its_headline(full):
    """Before any number is promised: E is wrong and has no ± in the sentence; what holds is told after it."""
    text = page(full())
    said = words(text.split('id="in-short">')[1].split("</p>")[0]).replace("\u00a0", " ")
    assert said.startswith(
        "E: overconfident (RMS error of the repeated filter runs 6.6 times the claimed σ; at most 1.49 for a calibrated σ), "
        "not identified (the measurements hardly reduce the initial uncertainty of this unknown); "
        "error of the estimate: 0.052 % . 4 gauges chosen"
    )
    assert "E to within" not in said
    assert said.index("overconfident") < said.index("estimate tip to within")
    assert "<h1>✕ E overconfident and not identified – Cantilever: load and stiffness</h1>" in text
    load, modulus = full().unknowns
    good = page(full(unknowns=(load, replace(modulus, claims=modulus.claims[1:], repeats=None))))
    assert "<h1>Cantilever: load and stiffness</h1>" in good
    assert "✕" not in first_screen(good)
    assert "estimate tip to within" in words(good)


def test_a_placement_without_benefit_leads_what_the_gauges_determine(full):
    load, modulus = full().unknowns
    none, some, shown = (Benefit(count, 10, word) for count, word in ((6, "none"), (3, "not shown"), (0, "shown")))

    def said(one, other):
        return words(first_screen(page(full(unknowns=(replace(load, benefit=one), replace(modulus, benefit=other))))))

    both = said(none, none)
    phrase = "No benefit of the placement: 6 of 10 (tip) and 6 of 10 (E) random layouts with the same number of gauges are "
    phrase += "at least"
    assert phrase in both
    assert both.index("No benefit") < both.index("estimate tip to within")
    assert "No benefit of the placement for E: 6 of 10 random" in said(shown, none)
    assert "No benefit" not in said(shown, some)
    assert "The benefit of the placement for E is not significant: 3 of 10 random layouts" in said(shown, some)


def test_a_remark_of_the_config_is_on_the_page_line_by_line_and_only_there_where_it_has_one(full):
    remark = Report(remark="bond by May\nask <Tom>")
    assert "bond by May<br>ask &lt;Tom&gt;" in page(replace(full(), settings=remark))
    assert "Remark" not in page(full())


@pytest.mark.parametrize("hostile", [HOSTILE, *slowly("F" * 400, "_")])
def test_hostile_names_come_out_escaped(full, hostile):
    few = {name: getattr(full(), name)[:1] for name in ("histories", "gauge_signals", "random_sets")}
    outline = nothing_comes_from_outside(page(renamed(full(**few), hostile), None, hostile, drawn=True))
    ordinary = Outline(page(full(), None, "none"))
    assert own_scripts(outline) == own_scripts(ordinary)
    assert [tag for tag, _ in outline.seen].count("script") == [tag for tag, _ in ordinary.seen].count("script")
    assert "img" not in outline.tags
    assert any(hostile in text for text in outline.text)


def test_a_placement_without_validation_bound_or_picture_has_a_page(bare):
    text = page(bare, None, "no off-screen OpenGL: apt-get install libegl1", drawn=True)
    Outline(text)
    assert "no off-screen OpenGL" in text
    assert "not computed" in text
    for missing in ("Simulated test", "Comparison with random", "Noise and repeats", "Warnings", "nan", "None"):
        assert missing not in text.split("</style>")[1]


@pytest.mark.parametrize("lost", [np.nan, *slowly(np.inf)])
def test_a_placement_of_which_nothing_is_a_number_has_a_page(mixed, lost):
    report = mixed()

    def gone(entry, *names):
        old = {name: getattr(entry, name) for name in names}
        return replace(entry, **{name: np.full_like(value, lost) for name, value in old.items() if value is not None})

    broken = replace(
        report,
        unknowns=tuple(replace(unknown, error=lost, std=lost, expected_std=lost, repeats=None) for unknown in report.unknowns),
        histories=tuple(gone(entry, "mean", "std", "smoothed", "smoothed_std") for entry in report.histories),
        gauge_signals=tuple(gone(entry, "measured", "estimated", "std") for entry in report.gauge_signals[:1]),
        criteria=tuple(replace(entry, values=(lost,) * 3, std={"E": lost}) for entry in report.criteria),
        cases=tuple(replace(case, condition=lost, raw=lost) for case in report.cases),
        trend=replace(gone(report.trend, "value"), blocks={}, final=lost, lower_bound=lost, gap=lost),
        random_sets=(),
    )
    Outline(page(broken, drawn=True))


def drawn_words(drawing):
    return " ".join("".join(node.itertext()) for node in ET.fromstring(drawing.svg).iter() if node.tag.endswith("text"))


def test_a_full_report_has_every_figure_once_small_and_with_units(full):
    drawings = compute_once(placement_figures, full())
    keys = [drawing.key for drawing in drawings]
    assert len(keys) == len(set(keys))
    assert {"trend", "noise", "repeats-E", "signal-G4", "estimate-tip", "closing-E", "posterior-E"} < set(keys)
    assert {"frequency-response", "random-errors-tip", "random-errors-E", "random-histories-E"} < set(keys)
    assert "random-histories-tip" not in keys
    for drawing in drawings:
        assert len(drawing.svg) < 200 * 1024
        assert "[" in drawn_words(drawing)
        assert drawing.alt
        assert drawing.caption


def test_frequency_response_has_a_panel_per_load_after_the_influence_matrix(full):
    """Curves in µm/m per kN over all frequencies but 0 Hz, a dashed line at each excited natural frequency."""
    influence = Table("influence matrix", ("channel", "unit", "per kN of tip"), (("G1", "µm/m", "10"),))
    report = full(influence=influence)
    response = report.frequency_response
    with recorded_figures() as drawn:
        drawing = frequency_response_figure(response)
    panels = drawn[drawing.svg].axes
    assert [axes.get_ylabel() for axes in panels] == ["tip\n[µm/m per kN]", "thrust\n[µm/m per kN]"]
    for axes, natural, scale in zip(panels, (40.12, 58.9), (1.0, 0.3), strict=True):
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
        assert [segment[0][0] for segment in axes.collections[0].get_segments()] == [natural]
        for gauge, curve in enumerate(axes.lines, start=1):
            np.testing.assert_array_equal(curve.get_xdata(), response.frequency[1:])
            # static 0.01 µm/m per N, 50 times as much at the mode
            assert curve.get_ydata().max() == pytest.approx(500 * gauge * scale, rel=1e-9)
    assert "per kN of thrust 600 µm/m at 58.9 Hz" in drawing.alt
    text = page(report)
    assert text.index("Influence matrix</h2>") < text.index("Strain per unit load over frequency") < text.index("Quality of the")
    assert "Frequency response</h2>" not in page(full(frequency_response=None), drawn=True)


def test_the_elbow_is_where_two_straight_lines_meet():
    count = np.unique(np.logspace(0, 3, 60).astype(int))
    trace = np.where(count < 20, (20 / count) ** 2, (20 / count) ** 0.1)
    found = elbow(count[::-1], trace[::-1])
    assert found == count[np.argmin(np.abs(np.log(count / 20)))]


def test_an_even_fall_has_no_elbow():
    count = np.arange(100, 3, -1)
    assert elbow(count, 100.0 / count) is None
    assert elbow(count, np.ones(len(count))) is None
