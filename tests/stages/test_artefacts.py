"""docs/artefacts.md includes the table of every record and lists every number of the summaries."""

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
    listed = re.findall(r"`([^`]+)`", re.split(r"Summary[\w ]*:", section(heading), maxsplit=1)[1])
    patterns = [
        re.escape(name).replace("<name>", r"[\w-]+").replace("<case>", r"[\w+]+").replace("<i>", r"\d+")
        for name in listed
    ]
    for name in artefact.summary:
        assert any(re.fullmatch(pattern, name) for pattern in patterns), name


def test_page_includes_every_generated_table_once():
    included = re.findall(r"^```\{include\} artefacts/(\S+)$", DOC.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert sorted(included) == sorted(script("docs/artefact_reference.py").tables())


def test_generated_table_lists_every_dataset_of_an_artefact(artefacts):
    table = script("docs/artefact_reference.py").tables()["place.txt"]
    patterns = [re.sub(r"<\w+>", r"[^/]+", path) for path in re.findall(r"^\| `([^`]+)`", table, flags=re.MULTILINE)]
    paths = [path for path in artefacts["place"].paths() if not path.startswith("/VTKHDF")]
    assert len(paths) > 40
    assert not [path for path in paths if not any(re.fullmatch(pattern, path) for pattern in patterns)]


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
