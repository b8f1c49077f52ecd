"""The page: self-contained, escaped, and every number on its first screen is the report's."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from strainsight.report.page.document import own
from strainsight.report.placement.data import Benefit, OtherFilter
from strainsight.report.space.section import script

from ..outline import Outline, names_of_regions, nothing_comes_from_outside, own_scripts, steps_in_order, words
from .shown import page


def first_screen(text):
    """Sentence and section that a reader decides from."""
    return text[text.index('<p class="answer"') : text.index("</section>", text.index('id="answer"'))]


def test_the_page_is_well_formed_and_every_identifier_is_its_own(full, mixed):
    for text in (page(full()), page(mixed(), drawn=True)):
        outline = Outline(text)
        assert len(outline.ids) == len(set(outline.ids))
        assert "warnings" in outline.targets <= set(outline.ids)
        assert steps_in_order(outline)
        regions = names_of_regions(outline)
        assert len(regions) == len(set(regions)) > 5


def test_nothing_is_fetched_and_nothing_runs_but_what_the_policy_names(full):
    outline = nothing_comes_from_outside(page(full()))
    assert [attributes["src"][:22] for tag, attributes in outline.seen if tag == "img"] == ["data:image/png;base64,"]
    assert own_scripts(outline) == [own("page/tables.js"), script()]


def test_every_picture_has_a_text_for_those_who_do_not_see_it(full):
    for tag, attributes in Outline(page(full())).seen:
        if tag == "img":
            assert "G1 at 0.1000" in attributes["alt"]
        if tag == "svg" and attributes.get("aria-hidden") != "true":
            assert attributes["role"] == "img"
            assert len(attributes["aria-label"]) > 20


def test_another_rule_below_the_bound_is_marked_as_beyond_the_limits(full):
    """Other rules know neither spacing nor budget: without the words the tile contradicts itself."""
    report = full()
    assert "best other rule (log-determinant)" in first_screen(page(report))
    *others, last = report.criteria
    below = replace(report, criteria=(*others, replace(last, values=(2.5, 0.04, 1.6))))
    assert "best other rule, beyond the limits (log-determinant)" in first_screen(page(below))


def test_the_exact_numbers_stand_on_the_first_screen(full):
    report = full()
    first = first_screen(page(report))
    exact = {float(value) for value in re.findall(r'<data value="([^"]+)"', first)}
    load = report.unknowns[0]
    for unknown in report.unknowns:
        assert {unknown.estimate, unknown.truth, unknown.error, unknown.std, unknown.expected_std} <= exact
    assert load.smoothed_error in exact
    assert {report.trend.final, report.trend.lower_bound, report.trend.gap, 2.71} <= exact
    assert {len(report.layout.gauges), 30, len(report.layout.pool), len(report.warnings)} <= exact
    for gauge in report.layout.gauges:
        assert {*gauge.position.tolist(), gauge.without["E"]} <= exact
    assert "209.9\u00a0GPa" in first
    assert "0.052\u00a0%" in first
    said = words(first)
    assert "4 gauges, chosen from 30 candidates tell tip to within ± 16 % of its RMS (claimed σ)." in said
    for phrase in ("not identified (the measurements hardly narrow it)", "Temperature.", "1 warning : read it"):
        assert phrase in said
    assert "G1 and G2 are 200 mm apart." in page(report).split('id="warnings"')[1]


def test_no_number_of_the_first_screen_stands_outside_its_exact_value(full, mixed, bare):
    for report in (full(), mixed(), bare, full(unknowns=(), histories=(), random_sets=(), noise=(), repeats=())):
        text = re.sub(r"<data .*?</data>", "", first_screen(page(report)))
        text = re.sub(r'<span class="badge".*?</span>', "", text)  # G1: a name
        assert not re.search(r"\d", words(text)), words(text)


def test_a_load_that_is_zero_is_reported_to_be_judged_by_its_amplitude(full):
    load, modulus = full().unknowns
    first = first_screen(page(full(unknowns=(replace(load, truth=0.0, zero=True), modulus))))
    assert "tip to within ± 16 % of its amplitude" in words(first)
    tile = words(first.split("tip, load")[1].split("</dl>")[0])
    assert "± claimed σ of its amplitude" in tile
    assert "amplitude 10 kN" in tile.replace("\u00a0", " ")
    assert "amplitude" not in words(first_screen(page(full())))


def observed(full, **changes):
    """What the first screen says is not observable."""
    text = first_screen(page(full(**changes)))
    return words(text.split("<h2>What can be known</h2>")[1].split("</ul>")[0]) if "What can be known" in text else None


def test_what_cannot_be_distinguished_is_reported_by_its_smallest_sets(full):
    cases = full().cases
    assert observed(full) == "All unknowns are observable. E, rho and tip can hardly be estimated together."
    pair = tuple(replace(case, unknowns=("tip", "rho"), lost="tip and rho") for case in cases[1::3])
    # With the pair goes the set of three that it is part of.
    assert observed(full, cases=cases + pair) == (
        "All unknowns are observable. rho and tip can hardly be estimated together."
    )
    once = tuple(replace(case, lost="") if case.excitation == "35 Hz" else case for case in cases)
    assert "E, rho and tip can hardly be estimated together in training run." in observed(full, cases=once)


def test_what_was_asked_for_and_is_lost_is_reported_loudly(full):
    asked = tuple(replace(case, unknowns=("E", "tip")) if case.lost else case for case in full().cases)
    assert observed(full, cases=asked) == "E and tip can hardly be estimated together."
    never = tuple(replace(case, condition=np.inf) for case in asked)
    assert observed(full, cases=never) == "E and tip cannot be estimated together."
    load, modulus = full().unknowns
    assert observed(full, unknowns=(load, replace(modulus, std=np.inf))).startswith("E: not with these gauges.")
    assert '<strong class="bad">' in first_screen(page(full(cases=asked)))
    assert observed(full, cases=(), unknowns=(load, modulus)) == "All unknowns are observable."
    assert observed(full, cases=(), unknowns=(load, replace(modulus, expected_std=None))) is None


def test_sections_come_in_the_order_in_which_questions_do(full):
    text = page(full(seconds={"import": 0.5, "place": 1.5}, advice=("Two are enough.",)))
    titles = [words(title) for title in re.findall(r"<h2[^>]*>(.*?)</h2>", text)]
    below = titles[titles.index("Warnings") + 1 :]
    assert below == [
        "The structure in space", "What to do with this layout", "Gauge by gauge", "What the uncertainty is made of",
        "How good the set is", "What they tell", "Gauge strains", "Beside random sets", "How sure one can be",
        "Observability, consistency, modes",
        "What it rests on", "Warnings",
    ]  # fmt: skip


def section_of_budget(text):
    return text.split("<h2>What the uncertainty is made of</h2>")[1].split("<h2>")[0]


def test_every_share_of_the_variance_is_as_wide_as_it_is_and_stands_in_words_and_numbers(full, bare):
    report = full()
    text = section_of_budget(page(report))
    exact = [float(value) for value in re.findall(r'<data value="([^"]+)"', text)]
    assert sorted(exact) == sorted(value for shares in report.budget.values() for value in shares.values())
    bars = re.findall(r'<div class="bar" role="img" aria-label="([^"]+)">(.*?)</div>', text)
    for (said, pieces), (name, shares) in zip(bars, report.budget.items(), strict=True):
        width = [float(value) for value in re.findall(r"width:([\d.]+)%", pieces)]
        assert sorted(width) == pytest.approx(sorted(100 * value for value in shares.values() if value > 0.01))
        largest = max(shares, key=shares.get)
        assert said.startswith(f"Variance of {name}: {largest} ")
        assert all((source in said) == (value > 0.01) for source, value in shares.items())
    assert "What the uncertainty is made of" not in page(bare)


def test_other_filters_stand_beside_the_bank_with_their_verdicts(full, bare):
    beside = (
        OtherFilter("E", "Pa", "bank", 2.1e11, 0.01, 1.0),
        OtherFilter("E", "Pa", "extended", 2.2e11, 0.004, 11.6, "overconfident"),
        OtherFilter("<b>&", "Pa", "sigma-point", np.nan, np.nan, np.nan, "overconfident"),
    )
    text = page(full(filters=beside)).split("<h2>By other filters</h2>")[1].split("<h2>")[0]
    shown = [words(row) for row in re.findall(r"<tr>(.*?)</tr>", text)]
    assert "✓" not in shown[1]
    assert "✕" not in shown[1]
    assert "✕ overconfident" in shown[2]
    assert "11.6" in shown[2]
    assert "✕ overconfident" in shown[3]
    assert "<b>&" not in text
    assert "By other filters" not in page(full()) + page(bare)


def test_sources_beyond_the_colours_are_one_part_of_a_bar(full):
    shares = {f"source {i}": (i + 1) / 45 for i in range(9)}
    text = section_of_budget(page(full(budget={"E": shares})))
    width = [float(value) for value in re.findall(r"width:([\d.]+)%", text)]
    assert sum(width) == pytest.approx(100, abs=0.05)
    assert width[-1] == pytest.approx(100 * (1 + 2) / 45, abs=0.01)
    assert "all others" in words(text)
    colours = re.findall(r"background:var\(--(\w+)\)", text.split('class="key"')[1])
    assert len(colours) == len(set(colours)) == 8


def test_where_the_time_went(full, bare):
    text = page(full(seconds={"import": 0.5, "place": 1.5}))
    rows = words(text.split("Where the time went")[1].split("</table>")[0])
    assert "import 0.5\u00a0s 25\u00a0%".replace("\u00a0", " ") in rows
    assert "place 1.5 s 75 %" in rows
    assert "all stages 2 s" in rows
    assert "Where the time went" not in page(bare)


def test_the_mark_says_when_the_claim_did_not_hold(full):
    load, modulus = full().unknowns

    def marks(*unknowns):
        first = first_screen(page(full(repeats=(), unknowns=unknowns)))
        return [(kind, words(text)) for kind, text in re.findall(r'<p class="mark (\w+)">(.*?)</p>', first)]

    assert marks(load, modulus) == [
        ("bad", "✕ overconfident (RMS error of the repeats 6.6 times the claimed σ)"),  # what does not hold first
        ("good", "✓ consistent (error 1.1 times the claimed σ)"),
    ]
    claim = replace(load.claims[1], ratio=0.001, verdict="too cautious")
    assert marks(replace(load, claims=(claim,)), replace(modulus, claims=())) == [
        ("good", "✓ too cautious (smoothed error 0.001 times the claimed σ)")
    ]
    assert "✕ overconfident" in words(page(full()).split('data-table="consistency"')[1])


def test_what_does_not_hold_leads_the_page_and_its_headline(full):
    """Before any number is promised: E is wrong and has no ± in the sentence; what holds is told after it."""
    text = page(full())
    said = words(text.split('id="in-short">')[1].split("</p>")[0]).replace("\u00a0", " ")
    assert said.startswith(
        "E: overconfident (RMS error of the repeats 6.6 times the claimed σ, at most 1.49 where it holds), not identified "
        "(the measurements hardly narrow it); it is 0.052 % off. 4 gauges,"
    )
    assert "E to within" not in said
    assert said.index("overconfident") < said.index("tell tip to within")
    assert "<h1>✕ E overconfident and not identified – Cantilever: load and stiffness</h1>" in text
    load, modulus = full().unknowns
    good = page(full(repeats=(), unknowns=(load, replace(modulus, claims=modulus.claims[1:]))))
    assert "<h1>Cantilever: load and stiffness</h1>" in good
    assert "✕" not in first_screen(good)
    assert "tell tip to within" in words(good)


def test_a_placement_without_benefit_leads_what_the_gauges_tell(full):
    load, modulus = full(repeats=()).unknowns
    none, some, shown = (Benefit(count, 10, word) for count, word in ((6, "none"), (3, "not shown"), (0, "shown")))

    def said(one, other):
        return words(first_screen(page(full(unknowns=(replace(load, benefit=one), replace(modulus, benefit=other))))))

    both = said(none, none)
    phrase = "Placement brings no benefit here: 6 of 10 (tip) and 6 of 10 (E) random layouts of the same size do"
    assert phrase in both
    assert both.index("no benefit") < both.index("tell tip to within")
    assert "Placement brings no benefit here for E: 6 of 10 random" in said(shown, none)
    assert "no benefit" not in said(shown, some)
    assert "That the placement helps E is not shown: 3 of 10 random layouts" in said(shown, some)


def test_every_sigma_on_the_page_has_a_name_and_a_denominator(full):
    """claimed, smoothed, expected or steady-state; of a true value, an RMS or an amplitude."""
    text = words(page(full()))
    named = "claimed|[Ee]xpected|steady-state|smoothed|±2σ|one standard deviation|lower σ|where σ holds"
    for at in re.finditer("σ", text):
        around = text[max(0, at.start() - 60) : at.end() + 60]
        assert re.search(named, around), around
    first = words(first_screen(page(full())))
    assert "± claimed σ of its RMS" in first
    assert "± claimed σ of its true value" in first


def test_what_the_model_assumes_is_a_table_of_its_own(full):
    rows = (("card GRID", "20", "read"), ("differs", "", "mass is <consistent>"))
    assert "What this model assumes" not in page(full())
    text = page(replace(full(), assumes=rows))
    table = text[text.index('id="assumes"') : text.index('id="warnings"')]
    assert "card GRID" in table
    assert "mass is &lt;consistent&gt;" in table
