"""docs/artefacts.md has the tables of the records and every number of the summaries."""

from __future__ import annotations

import re

import pytest

from ..shared import ROOT, script

DOC = ROOT / "docs" / "artefacts.md"
STAGES = ("import", "modes", "rom", "train", "screen", "observe", "place", "validate", "report", "reduce", "bearing",
          "simulate")  # fmt: skip


def section(heading: str) -> str:
    """What the page says of an artefact."""
    return DOC.read_text(encoding="utf-8").split(f"## {heading}\n")[1].split("\n## ")[0]


def assert_summary_is_listed(artefact, heading: str) -> None:
    listed = re.findall(r"`([^`]+)`", section(heading).split("Summary:")[1])
    patterns = [
        re.escape(name).replace("<name>", r"[\w-]+").replace("<case>", r"[\w+]+").replace("<i>", r"\d+")
        for name in listed
    ]
    for name in artefact.summary:
        assert any(re.fullmatch(pattern, name) for pattern in patterns), name


def test_the_tables_are_those_of_the_records():
    text = DOC.read_text(encoding="utf-8")
    assert script("docs/artefact_reference.py").renewed(text) == text, "python docs/artefact_reference.py writes the tables anew"


@pytest.mark.parametrize("stage", STAGES)
def test_every_number_of_a_summary_is_listed(artefacts, bench, stage):
    """Of a placement and of a bench; both have an `import`, that of the placement is meant."""
    assert_summary_is_listed({**bench, **artefacts}[stage], f"{stage}.h5")


def test_datasets_of_a_report_are_listed(artefacts):
    """No record stands behind them."""
    listed = re.findall(r"^\| `([^`]+)` \|", section("report.h5"), flags=re.MULTILINE)
    patterns = [re.escape(path).replace("<name>", r"[\w-]+") for path in listed]
    paths = artefacts["report"].paths()
    assert paths
    assert all(any(re.fullmatch(pattern, path) for pattern in patterns) for path in paths)
