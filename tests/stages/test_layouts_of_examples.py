"""The layout of an example config is the one that docs/measured.md states: checks of models leave numbers alone."""

from __future__ import annotations

import re

import pytest

from strainsight.stages.placement import PLACEMENT

from .conftest import ROOT, finished, job_of


@pytest.mark.slow
def test_the_cantilevers_gauges_for_a_force_are_those_that_are_stated(tmp_path):
    text = (ROOT / "docs" / "measured.md").read_text(encoding="utf-8")
    said = re.search(r"cantilever-input\.yaml`, E at its guess of ([\d.e]+) Pa, ([\d, ]+) with σ ([\d.]+);", text)
    config = ROOT / "configs" / "cantilever-input.yaml"
    job = job_of(config, tmp_path, f"parameters.E.guess={said[1]}", "place.certificate=false")
    stages = PLACEMENT[: [stage.name for stage in PLACEMENT].index("place") + 1]
    place = finished(job, stages)["place"][2]
    assert sorted(place["/selected/final/gauge"].ravel().tolist()) == [int(own) for own in said[2].split(",")]
    assert place.summary["std.tip"] == pytest.approx(float(said[3]), abs=5e-4)
