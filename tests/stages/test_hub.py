"""The coarse hub and the lug bracket end to end, from the mesh to one estimate."""

from __future__ import annotations

import csv
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.runner.artefact import Artefact
from strainsight_cli.main import app

from ..shared import HUB, ROOT, UNSTUDIED, made

pytestmark = pytest.mark.slow

CONFIG = ROOT / "configs" / "hub" / "hub-youngs-modulus.yaml"
QUICK = ("place.instants=3", "validate.truth.modes=20", *UNSTUDIED)
CHANNELS = ", ".join(f"{{channel: G{i}, gauge: G{i}, unit: m/m}}" for i in (1, 2, 3, 4))
ESTIMATE = (
    "estimate={as_placed: true, start: settled, time: {channel: time}, inputs: {x: {channel: x, unit: N}}, "
    f"channels: [{CHANNELS}]}}"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Results of the shortened run up to validate, and of estimate on what it measured."""
    results = tmp_path_factory.mktemp("hub") / "hub-youngs-modulus"
    shutil.copytree(made(CONFIG, *QUICK, until="validate", beside=HUB)["validate"].path.parent, results)
    words = ["estimate", str(CONFIG), "--no-page", "--measurements", str(results / "measured.csv")]
    options = ["--results", str(results.parent), *(word for value in (*QUICK, ESTIMATE) for word in ("--set", value))]
    done = CliRunner().invoke(app, [*words, *options])
    assert done.exit_code == 0, done.output
    return results


def test_first_mode_is_that_of_calculix(folder):
    """485 Hz: ten frequencies of this mesh were compared with CalculiX once (docs/measured.md)."""
    assert Artefact(folder / "rom.h5")["/frequency"][0] == pytest.approx(484.72, abs=0.01)


def test_gauges_are_on_the_outer_surface_away_from_the_flanges(folder):
    """The zone of meshes/README.md: a sphere of 0.5 m, 50 mm along the surface from every flange."""
    position = positions(folder).T
    assert len(position) == 4
    assert np.linalg.norm(position, axis=1) == pytest.approx(0.5, rel=0.01)
    assert np.all(position[:, 2] > -0.315)
    for angle in 2 * np.pi * np.arange(3) / 3:
        assert np.all(position @ [np.cos(angle), np.sin(angle), 0] < 0.43)


def test_sigma_of_the_modulus_is_below_two_per_cent_and_allows_for_its_error(folder):
    """The truth is 10 % above the guess, with other damping, and gauges and the load off their places."""
    summary = Artefact(folder / "validate.h5").summary
    assert summary["std.E"] <= 0.02
    assert summary["error.E"] <= 3.2 * summary["std.E"]


def test_the_file_of_the_test_gives_the_same_modulus(folder):
    """Estimated from the digits of the file, with the known load straight between samples: to a tenth of σ."""
    with (folder / "estimate.csv").open(encoding="utf-8") as lines:
        table = list(csv.reader(line for line in lines if not line.startswith("#")))
    column = next(i for i, name in enumerate(table[0]) if re.match(r"E\b", name))
    validate = Artefact(folder / "validate.h5").summary
    assert float(table[-1][column]) == pytest.approx(validate["estimate.E"], rel=0.1 * validate["std.E"])


@pytest.fixture(scope="module")
def lug_folder():
    """Results up to validate."""
    exact = "tolerances=none", "validate.truth.model=modes", *UNSTUDIED
    return made(ROOT / "configs" / "lug" / "lug-input.yaml", *exact, until="validate")["validate"].path.parent


def positions(folder):
    """Places of the gauges (3, n) [m]."""
    with (folder / "gauges.csv").open(encoding="utf-8") as lines:
        table = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    return np.array([[float(row[f"position_{axis}"]) for row in table] for axis in "xyz"])


def test_three_loads_are_those_of_the_config(lug_folder):
    """1 kN at 25 Hz along y and 5 kN at 1 Hz along z, to 1 % of their amplitudes, RMS; along x nine sines in whole cycles, with
    the power of one of 5 kN."""
    validated = Artefact(lug_folder / "validate.h5")
    time = validated["/time"]
    for name, amplitude, frequency in (("y", 1e3, 25), ("z", 5e3, 1)):
        error = validated[f"/smoothed/{name}"] - amplitude * np.sin(2 * np.pi * frequency * time)
        assert np.sqrt(np.mean(error**2)) < 0.01 * amplitude
    power = np.mean(validated["/smoothed/x"][:-1] ** 2)
    assert np.sqrt(power) == pytest.approx(5e3 / np.sqrt(2), rel=0.01)


def test_gauges_are_on_the_bracket_and_not_on_its_weld(lug_folder):
    """The outside of meshes/README.md: not under it, not in its holes, and 6 mm from the fillet weld."""
    x, y, z = 1e3 * positions(lug_folder)
    assert len(x) == 6
    assert np.all(z > 0)
    assert np.all(np.hypot(np.abs(x) - 78, np.abs(y) - 36)[z < 12.1] > 9)
    assert np.all(np.hypot(x, z - 90)[z > 12.1] > 15)
    beside = np.hypot(np.maximum(np.abs(x) - 50, 0), np.maximum(np.abs(y) - 6, 0))
    assert np.all((beside > 6) | (z > 18))
