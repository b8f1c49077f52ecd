"""The coarse hub and the lug bracket end to end, from the mesh to one estimate."""

from __future__ import annotations

import csv
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight.config.suite_runs import runs_of
from strainsight.stages.placement import PLACEMENT
from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from ..shared import HUB as SHARED
from ..shared import ROOT as lug_ROOT
from ..shared import UNSTUDIED as lug_UNSTUDIED
from ..shared import job_of, made
from .conftest import ROOT, UNSTUDIED, finished

pytestmark = pytest.mark.slow

HUB = ROOT / "configs" / "hub"
CONFIG = HUB / "hub-youngs-modulus.yaml"
QUICK = ("place.instants=3", "validate.truth.modes=20", *UNSTUDIED)
CHANNELS = ", ".join(f"{{channel: G{i}, gauge: G{i}, unit: m/m}}" for i in (1, 2, 3, 4))
ESTIMATE = (
    f"estimate={{as_placed: true, time: {{channel: time}}, channels: [{CHANNELS}], inputs: {{x: {{channel: x, unit: N}}}}}}"
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Results of the shortened run up to validate, and of estimate on what it measured."""
    results = tmp_path_factory.mktemp("hub") / "hub-youngs-modulus"
    shutil.copytree(made(CONFIG, *QUICK, until="validate", beside=SHARED)["validate"].path.parent, results)
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
    with (folder / "gauges.csv").open(encoding="utf-8") as lines:
        table = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    position = np.array([[float(row[f"position_{axis}"]) for axis in "xyz"] for row in table])
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


@pytest.mark.parametrize("path", sorted(HUB.glob("hub-*.yaml")), ids=lambda path: path.stem)
def test_every_config_is_valid_and_shares_what_is_reduced(path):
    """One name a file, and the same mesh, parameters and reduction everywhere, so that runs take stages over."""
    own, first = load_config(path, ()).data, load_config(CONFIG, ()).data
    assert own["name"] == path.stem
    for key in ("mesh", "parameters", "rom", "damping"):
        assert own[key] == first[key]


def test_the_suite_runs_every_config_on_either_mesh():
    """make hub and make hub-fine: all nine, under names of their own."""
    fine = ("name=hub-fine", "suffix=-fine", "set.mesh.file=../../meshes/hub.bdf.gz")
    for options, mesh, suffix in (((), "hub-coarse.bdf.gz", ""), (fine, "hub.bdf.gz", "-fine")):
        runs = runs_of(load_config(HUB / "suite.yaml", options))
        assert {run.entry.config for run in runs} == {path.name for path in HUB.glob("hub-*.yaml")}
        for run in runs:
            assert run.config.data["mesh"]["file"] == f"../../meshes/{mesh}"
            assert run.config.data["name"].endswith(suffix)
            assert (HUB / run.config.data["mesh"]["file"]).is_file()


def test_blade_load_is_what_the_script_writes():
    """Once and three times a turn stand out of Fx and Fz; the file starts from zero and is read at every step."""
    with (HUB / "blade-load.csv").open(encoding="ascii") as lines:
        table = np.array([[float(cell) for cell in row] for row in list(csv.reader(lines))[1:]])
    time, force = table[:, 0], table[:, 1:]
    assert np.allclose(np.diff(time), 0.002, atol=1e-9)
    assert np.all(force[0] == 0)
    whole = force[time >= 1.0][:3500]  # seven turns
    spectrum = np.abs(np.fft.rfft(whole - whole.mean(axis=0), axis=0)) * 2 / len(whole)
    assert spectrum[7, 0] == pytest.approx(1000, rel=0.3)
    assert spectrum[21, 2] == pytest.approx(600, rel=0.3)


EXACT = ("tolerances=none", "validate.truth.model=modes", *lug_UNSTUDIED)


@pytest.fixture(scope="module")
def lug_folder(tmp_path_factory):
    """Results up to validate."""
    results = tmp_path_factory.mktemp("lug")
    finished(job_of(lug_ROOT / "configs" / "lug" / "lug-input.yaml", results, *EXACT), PLACEMENT[:-1])
    return results / "lug-input"


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
    with (lug_folder / "gauges.csv").open(encoding="utf-8") as lines:
        table = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    x, y, z = np.array([[1e3 * float(row[f"position_{axis}"]) for row in table] for axis in "xyz"])
    assert len(x) == 6
    assert np.all(z > 0)
    assert np.all(np.hypot(np.abs(x) - 78, np.abs(y) - 36)[z < 12.1] > 9)
    assert np.all(np.hypot(x, z - 90)[z > 12.1] > 15)
    beside = np.hypot(np.maximum(np.abs(x) - 50, 0), np.maximum(np.abs(y) - 6, 0))
    assert np.all((beside > 6) | (z > 18))
