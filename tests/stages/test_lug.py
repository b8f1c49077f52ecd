"""The lug bracket end to end: three unknown loads from six gauges, where structure and gauges are as the model says."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from strainsight.stages.placement import PLACEMENT
from strainsight.workflow.artefact import Artefact

from ..shared import ROOT, UNSTUDIED, job_of
from .conftest import finished

pytestmark = pytest.mark.slow

EXACT = ("tolerances=none", "validate.truth.model=modes", *UNSTUDIED)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Results up to validate."""
    results = tmp_path_factory.mktemp("lug")
    finished(job_of(ROOT / "configs" / "lug" / "lug-input.yaml", results, *EXACT), PLACEMENT[:-1])
    return results / "lug-input"


def test_three_loads_are_those_of_the_config(folder):
    """1 kN at 25 Hz along y and 5 kN at 1 Hz along z, to 1 % of their amplitudes, RMS; along x nine sines in whole cycles, with
    the power of one of 5 kN."""
    validated = Artefact(folder / "validate.h5")
    time = validated["/time"]
    for name, amplitude, frequency in (("y", 1e3, 25), ("z", 5e3, 1)):
        error = validated[f"/smoothed/{name}"] - amplitude * np.sin(2 * np.pi * frequency * time)
        assert np.sqrt(np.mean(error**2)) < 0.01 * amplitude
    power = np.mean(validated["/smoothed/x"][:-1] ** 2)
    assert np.sqrt(power) == pytest.approx(5e3 / np.sqrt(2), rel=0.01)


def test_gauges_are_on_the_bracket_and_not_on_its_weld(folder):
    """The outside of meshes/README.md: not under it, not in its holes, and 6 mm from the fillet weld."""
    with (folder / "gauges.csv").open(encoding="utf-8") as lines:
        table = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    x, y, z = np.array([[1e3 * float(row[f"position_{axis}"]) for row in table] for axis in "xyz"])
    assert len(x) == 6
    assert np.all(z > 0)
    assert np.all(np.hypot(np.abs(x) - 78, np.abs(y) - 36)[z < 12.1] > 9)
    assert np.all(np.hypot(x, z - 90)[z > 12.1] > 15)
    beside = np.hypot(np.maximum(np.abs(x) - 50, 0), np.maximum(np.abs(y) - 6, 0))
    assert np.all((beside > 6) | (z > 18))
