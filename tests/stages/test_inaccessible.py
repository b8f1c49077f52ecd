"""Places that no hand reaches, on parts whose geometry is known (`parts`): no candidates by default, and back by a key."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight import api
from strainsight.errors import InfeasibleError
from strainsight.experiment.structure.exclusions import exclusions_in_words
from strainsight_cli.main import app

from .. import parts

LOAD = ("--estimate", "load", "--amplitude", "500", "--frequency", "5")
PIN = ("--load", "0.185, 0, 0.02", "--direction", "1, 0, 0")
FORCE = ("--load", "deck_load FORCE-2")
DECKS = {"knuckle": (parts.knuckle, PIN), "frame": (parts.frame, FORCE), "crane_arm": (parts.crane_arm, FORCE)}
ALL = "gauges.allow=[enclosed, bores, loaded]"


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    """Name of a part → config that `init` writes for it, the pin of the knuckle as a bearing load."""

    @cache
    def path(name: str) -> Path:
        folder = tmp_path_factory.mktemp(name)
        deck, options = DECKS[name]
        (folder / "part.bdf").write_text(deck(), encoding="ascii")
        done = CliRunner().invoke(app, ["init", str(folder / "part.bdf"), "-o", str(folder / "part.yaml"), *LOAD, *options])
        assert done.exit_code == 0, done.output
        text = (folder / "part.yaml").read_text(encoding="utf-8")
        (folder / "part.yaml").write_text(text.replace("direction: [1.0, 0.0, 0.0]", "bearing: [1, 0, 0]"), encoding="utf-8")
        return folder / "part.yaml"

    return path


@pytest.fixture(scope="module")
def screened(config):
    """(name, *overrides) → gauges (their first channels) and the screening."""

    @cache
    def reduced(name: str):
        case = api.load(config(name), ["rom.modes=2", "train.duration=0.2"])
        mesh = api.mesh(case)
        return mesh, api.reduce(case, mesh)

    def screening(name: str, *overrides: str):
        case = api.load(config(name), ["rom.modes=2", "train.duration=0.2", "screen.keep=all", *overrides])
        training = api.train(case, *reduced(name))
        pool = training.candidates
        return pool.take(pool.first), api.screen(case, *reduced(name), training)

    return screening


def expected(name: str, x: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Reasons at centres x (m, 3) [m], by the geometry of the part."""
    match name:
        case "knuckle":
            return np.where(parts.in_eye(x), "bore", "")
        case "frame":
            return np.where(parts.in_box(x, normal), "enclosed", "")
    return np.where(parts.in_lug(x), "bore", np.where(parts.in_void(x), "enclosed", ""))


@pytest.mark.parametrize("name", DECKS)
def test_candidates_are_excluded_by_geometry_and_nowhere_else(screened, name):
    gauges, found = screened(name)
    reason = expected(name, gauges.position, gauges.normal)
    assert 0.1 * len(reason) < np.count_nonzero(reason) < 0.6 * len(reason)
    np.testing.assert_array_equal(np.where(np.isin(found.reason, ("bore", "enclosed", "loaded")), found.reason, ""), reason)
    assert not np.any(reason[found.kept] != "")


def test_a_key_keeps_each_kind_of_places(screened):
    gauges, found = screened("crane_arm")
    reason = expected("crane_arm", gauges.position, gauges.normal)
    bores, enclosed = (np.count_nonzero(reason == code) for code in ("bore", "enclosed"))
    words = f"inaccessible: {bores} in bores, {enclosed} on enclosed surfaces (gauges.allow: [bores, enclosed] keeps them)"
    assert exclusions_in_words(found, gauges) == words
    _, kept = screened("crane_arm", "gauges.allow=[bores]")
    np.testing.assert_array_equal(kept.reason == "enclosed", reason == "enclosed")
    assert not np.any(kept.reason == "bore")
    _, every = screened("crane_arm", ALL)
    assert exclusions_in_words(every, gauges) == ""


def test_bonded_gauges_are_not_excluded_and_a_config_without_other_places_is_refused(screened):
    here = "gauges.fixed=[{position: [0.54, -0.015, 0.03], direction: [0, 0, 1]}]"
    gauges, found = screened("crane_arm", here)
    assert found.reason[0] == ""
    assert parts.in_lug(gauges.position[:1]).all()
    with pytest.raises(InfeasibleError, match=r"gauges\.allow: no candidate remains: \d+ on enclosed surfaces"):
        screened("crane_arm", "gauges.include=[{box: [[0.05, -0.045, 0.015], [0.42, 0.045, 0.065]]}]")


@pytest.mark.slow
@pytest.mark.parametrize("name", DECKS)
def test_gauges_of_a_run_are_accessible_and_clear_of_edges(config, name):
    """The carrier of 3/350 reaches 6.4 mm; edges of the parts are lines where their sides meet."""
    path = config(name)
    done = CliRunner().invoke(app, ["run", str(path), "--results", str(path.parent / "results")], env={"COLUMNS": "500"})
    assert done.exit_code == 0, done.output
    assert "gauges.allow: [" in done.output
    folder = path.parent / "results" / "part"
    with open(folder / "gauges.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    x, normal = (np.array([[float(row[f"{what}_{axis}"]) for axis in "xyz"] for row in rows]) for what in ("position", "normal"))
    assert len(x) == 4
    assert not np.any(expected(name, x, normal) != "")
    assert min(float(row["edge_mm"]) for row in rows) > 6.36
    assert "gauges.allow: [" in (folder / "report.html").read_text(encoding="utf-8")
    for sheet in folder.glob("sheet-*.svg"):
        assert "View from outside, along the normal" in sheet.read_text(encoding="utf-8")
