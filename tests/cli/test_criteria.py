"""Layouts by every criterion and over some of the unknowns, from the command line to the page."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are
from typer.testing import CliRunner

from strainsight.config.load import load_config
from strainsight.errors import ConfigError
from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

pytestmark = pytest.mark.slow

CONFIG = Path(__file__).parents[2] / "configs" / "cantilever-input-youngs-modulus.yaml"
SUITE = """\
kind: suite
name: all
title: One beam by every criterion
set: {train.duration: 0.1, screen.keep: 24, place.instants: 2, validate.duration: 0.02, validate.random_sets: 1,
      validate.repeats: 2, validate.noise_factors: [], validate.truth.modes: 20, rom.parameter_samples: 1, filter.compare: false}
runs:
  - {config: CONFIG, name: trace-E, label: trace-E, set: {place.metric_over: [E]}}
  - {config: CONFIG, name: log_determinant, label: log, set: {place.criterion: log_determinant}}
  - {config: CONFIG, name: worst_eigenvalue, label: worst,
     set: {place.criterion: worst_eigenvalue, place.aggregate: worst}}
  - {config: CONFIG, name: failure-tip, label: failure, until: place,
     set: {place.criterion: worst_eigenvalue, place.metric_over: [tip], place.optimise: worst_failure}}
"""
RUNS = {
    "trace-E": ("trace", ["E"], "tr(W P)", np.mean),
    "log_determinant": ("metric", ["tip", "E"], "det(P)^(1/n)", np.mean),
    "worst_eigenvalue": ("metric", ["tip", "E"], "λ₁(P)", np.max),
    "failure-tip": ("metric", ["tip"], "λ₁(P)", np.mean),
}
CRITERION = {
    "tr(W P)": np.trace,
    "det(P)^(1/n)": lambda M: np.linalg.det(M) ** (1 / len(M)),
    "λ₁(P)": lambda M: np.linalg.norm(M, 2),
}


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of the suite; what it said is in the file `said`."""
    folder = tmp_path_factory.mktemp("criteria")
    path = folder / "all.yaml"
    path.write_text(SUITE.replace("CONFIG", str(CONFIG)), encoding="utf-8")
    done = CliRunner().invoke(app, ["run", str(path), "--results", str(folder)])
    assert done.exit_code == 0, done.output
    (folder / "said").write_text(done.output, encoding="utf-8")
    return folder


def metric(place, rows, symbol, combine):
    """The metric of some pool rows from the stored F, H, Q, R, scale and weight alone, by scipy's solver."""
    own, values = np.isin(place["/pool/row"], rows), []
    stored = (place[f"/augmented/{key}"] for key in ("F", "H", "Q", "R", "weight"))
    for F, H, Q, R, weight in zip(*stored, strict=True):
        rows_at_unit_noise = H[own] / np.sqrt(R[own])[:, None]
        P = solve_continuous_are(F.T, rows_at_unit_noise.T, Q, np.eye(len(rows_at_unit_noise)))
        at, root = weight > 0, np.sqrt(weight[weight > 0])
        values.append(CRITERION[symbol](P[np.ix_(at, at)] * np.outer(root, root)))
    return combine(values)


@pytest.mark.parametrize("run", RUNS)
def test_the_artefact_says_what_the_criterion_of_the_config_is_worth(results, run):
    key, over, symbol, combine = RUNS[run]
    place = Artefact(results / run / "place.h5")
    said, final = place.summary, place["/selected/final/gauge"]
    expected = metric(place, final, symbol, combine)
    assert said[f"{key}_final"] == pytest.approx(expected, rel=1e-5)
    assert place[f"/elimination/{key}"][0] == pytest.approx(
        metric(place, np.arange(said["pool"]), symbol, combine), rel=1e-5
    )
    assert place["/elimination/unknowns"].tolist() == over
    assert place["/elimination/blocks"].shape == (len(place["/elimination/rise"]) + 1, len(over))
    assert said["lower_bound"] <= said[f"{key}_final"] * (1 + 1e-12)
    assert said["gap"] == pytest.approx(1 - said["lower_bound"] / said[f"{key}_final"], abs=1e-9)
    assert place["/criteria/value"][0, 0] == pytest.approx(expected, rel=1e-5)
    without = [metric(place, final[final != g], symbol, combine) for g in final]
    np.testing.assert_allclose(place["/failure/loss"], without, rtol=1e-4)
    # of the criteria, the one it was chosen by makes no layout of its own beside this one
    assert place["/criteria/name"][0] == said["criterion"]
    assert set(place["/criteria/rule"].tolist()) > set(place["/criteria/name"][1:].tolist())
    assert said["criterion"] not in place["/criteria/rule"]


@pytest.mark.parametrize(
    ("asked", "key"),
    [
        ("place.criterion=determinant", "place.criterion"),
        ("place.metric_over=[E, tipp]", "place.metric_over[1]"),
        ("place.metric_over=[E, E]", "place.metric_over[1]"),
        ("place.optimise=trace", "place.optimise"),
    ],
)
def test_what_is_no_criterion_is_refused_with_its_key(asked, key):
    with pytest.raises(ConfigError) as refused:
        load_config(CONFIG, [asked])
    assert refused.value.key == key
