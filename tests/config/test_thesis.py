"""configs/thesis/suite.yaml has a row for every figure and table of chapters 2 to 6, and each is measured or says why not."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from strainsight.config.load import load_config
from strainsight.config.suite_runs import runs_of

SUITE = Path(__file__).parents[2] / "configs" / "thesis" / "suite.yaml"
FIGURES = {2: 8, 3: 9, 4: 6, 5: 1, 6: 15}
TABLES = {2: 1, 3: 2, 6: 2}
"""Chapter → how many it has."""


@pytest.fixture(scope="module")
def suite():
    return load_config(SUITE)


@pytest.fixture(scope="module")
def runs(suite):
    return [run.config for run in runs_of(suite)]


def named(rows, kind):
    """Numbers of the figures or tables that sources name, as in "table 6.2, figure 6.9"."""
    return {
        number
        for row in rows
        for words in re.findall(rf"{kind}s? ((?:\d\.\d+(?:, )?)+)", row.source)
        for number in re.findall(r"\d\.\d+", words)
    }


@pytest.mark.parametrize(("kind", "counts"), [("figure", FIGURES), ("table", TABLES)])
def test_none_is_missing(suite, kind, counts):
    wanted = {f"{chapter}.{i}" for chapter, count in counts.items() for i in range(1, count + 1)}
    assert named(suite.model.comparisons, kind) == wanted


def test_they_stand_in_the_order_of_the_thesis(suite):
    first = [tuple(map(int, re.search(r"(\d)\.(\d+)", row.source).groups())) for row in suite.model.comparisons]
    chapters = [chapter for chapter, _ in first]
    assert chapters == sorted(chapters)


def test_every_run_is_the_side_of_a_row(suite, runs):
    """None is computed for nothing, but for what other runs take from it."""
    sides = [side for row in suite.model.comparisons for side in (row.as_printed, row.ours) if side is not None]
    used = {name for side in sides for name in ((side.run,) if isinstance(side.run, str) else side.run)}
    used |= {side.against for side in sides if side.against is not None}
    text = SUITE.read_text(encoding="utf-8")
    taken = set(re.findall(r"from: ([\w-]+)", text))
    assert {run.model.name for run in runs} == used | taken


def test_the_settings_of_the_thesis_are_its_own(runs):
    """Of placements: the printed noise and columns, the plain trace, one instant, no tolerances, its own model as the truth."""
    placements = [run for run in runs if run.data["kind"] == "placement"]
    printed = [run.model for run in placements if run.model.name.startswith("thesis-")]
    assert len(printed) == len(placements) / 2
    for own in printed:
        assert (own.process_noise.rule, own.process_noise.model_error) == ("as_printed", 0.0)
        assert (own.place.instants, own.place.weights, own.place.damping_slope) == (1, "thesis", False)
        assert (own.filter.method, own.validation.truth.model) == ("extended", "rom")


def test_the_benches_of_chapter_2_have_its_update_and_its_noise(runs):
    """Algorithm 1: one update a step, Q* after it, its own step as the truth; but for the one that shows what Q* costs."""
    benches = {run.model.name: run.model for run in runs if run.data["kind"] == "bench"}
    estimates = {name: own.estimate for name, own in benches.items() if own.estimate is not None}
    printed = {name: own for name, own in estimates.items() if name.startswith("thesis-") and own.measured is None}
    assert all(own.method.update in ("one_shot", "as_printed") and own.truth.model == "own" for own in printed.values())
    second = [name for name in printed if re.match(r"thesis-(loads|step|noise|wrong)", name)]
    assert {name for name in second if printed[name].method.noise != "as_printed"} == {"thesis-loads-before"}
    ours = [own.method for name, own in estimates.items() if name.startswith("ours-")]
    assert {(own.update, own.noise) for own in ours} == {("iterated", "before_step")}


def test_what_does_not_hold_says_why_in_the_manual():
    """A row of the manual whose verdict is more than "holds" goes on after it."""
    page = (SUITE.parents[2] / "docs" / "reproduction.md").read_text(encoding="utf-8").split("## Figure by figure")[1]
    verdicts = [line.strip("| ").rsplit(" | ", 1)[1] for line in page.splitlines() if line.startswith("| ")][2:]
    assert [own for own in verdicts if re.fullmatch(r"\*\*(?!holds\*\*)[^*]*\*\*", own)] == []


def test_the_page_of_the_manual_has_every_row(suite):
    """docs/reproduction.md is made by `python docs/reproduction.py` from the numbers of this suite as it stands."""
    page = (SUITE.parents[2] / "docs" / "reproduction.md").read_text(encoding="utf-8").split("## Figure by figure")[1]
    rows = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| ")][2:]
    said = [(row.source, row.says, row.printed) for row in suite.model.comparisons]
    assert [tuple(cell.strip() for cell in row[:3]) for row in rows] == said
