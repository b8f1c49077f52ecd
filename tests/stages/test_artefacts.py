"""docs/artefacts.md lists every dataset with its rank and unit, and nothing else."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

DOC = Path(__file__).parents[2] / "docs" / "artefacts.md"
STAGES = ("import", "modes", "rom", "train", "screen", "observe", "place", "validate", "report")
BELOW_KIND = {
    "<kind>": r"(tet4|tet10|hex8|hex20|wedge6|wedge15)",
    "<name>": r"[\w-]+",
    "<parameter>": r"(?!constant$)[\w-]+",
    "<case>": r"[\w+]+",
}
ONLY_SOMETIMES = r"/reduced/mass/\(\?|/matrices/|/gauges/given/|/glued/|/sweep/"
"""Where a density is a parameter; where stiffness and mass, or strain rows, come from files (test_ready.py); where gauges
are glued already (test_sensors.py); where sweeps are asked for (test_estimate.py)."""


def rows(stage: str) -> list[tuple[str, int, str]]:
    """(pattern of the path, rank, unit) of every row under the stage's heading."""
    text = DOC.read_text(encoding="utf-8").split(f"## {stage}.h5\n")[1].split("\n## ")[0]
    found = []
    for path, shape, unit in re.findall(r"^\| `([^`]+)` \| ([^|]+) \| ([^|]+) \|", text, flags=re.MULTILINE):
        pattern = re.escape(path)
        for placeholder, meaning in {**BELOW_KIND, "<i>": r"\d+"}.items():
            pattern = pattern.replace(re.escape(placeholder), meaning)
        found.append((pattern, 0 if shape.strip() == "scalar" else shape.count("×") + 1, unit.strip()))
    return found


@pytest.mark.parametrize("stage", STAGES)
def test_every_dataset_is_listed_with_its_rank_and_unit(artefacts, stage):
    listed = rows(stage)
    for path in artefacts[stage].paths():
        if path.startswith("/VTKHDF"):
            continue
        matching = [(rank, unit) for pattern, rank, unit in listed if re.fullmatch(pattern, path)]
        assert len(matching) == 1, path
        rank, unit = matching[0]
        assert artefacts[stage][path].ndim == rank, path
        attributes = artefacts[stage].attributes(path)
        assert attributes["description"]
        assert unit in (attributes["units"], "unit of the unknown"), path


@pytest.mark.parametrize("stage", STAGES)
def test_every_listed_dataset_is_in_the_file(artefacts, stage):
    paths = artefacts[stage].paths()
    for pattern, _, _ in rows(stage):
        if re.match(ONLY_SOMETIMES, pattern):
            continue
        assert any(re.fullmatch(pattern, path) for path in paths), pattern


@pytest.mark.parametrize("stage", STAGES)
def test_every_summary_scalar_is_listed(artefacts, stage):
    text = DOC.read_text(encoding="utf-8").split(f"## {stage}.h5\n")[1].split("\n## ")[0]
    listed = re.findall(r"`([^`]+)`", text.split("Summary:")[1])
    for name in artefacts[stage].summary:
        assert any(
            re.fullmatch(re.escape(entry).replace("<name>", r"[\w-]+").replace("<case>", r"[\w+]+"), name)
            for entry in listed
        ), name
