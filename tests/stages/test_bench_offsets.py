"""Channels of a bench that read too much: a constant or a drift beside loads, drawn anew for every seed."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.cases.bench.inverse.offsets import Offsets
from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from ..robustness.small import write_project
from .test_bench_accelerometers import BENCH

BIAS = "estimate.sensors={gauges: {noise: 1.0e-6, bias: 2.0e-5}, felt: {noise: 0.02, bias: [0.05, 0.05, 0.5]}}"


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp("offsets")
    write_project(folder)
    (folder / "bench.yaml").write_text(BENCH)
    return folder


def run(folder, *changes):
    words = [f"--set={change}" for change in changes]
    done = CliRunner().invoke(app, ["estimate", str(folder / "bench.yaml"), "--results", str(folder / "results"), *words])
    return done.exit_code, " ".join((done.output + (done.stderr or "")).split())


def test_loads_beside_constant_offsets_keep_to_their_sigma_and_offsets_to_theirs(bench):
    """Eight histories by Radau's method, offsets of twenty times the noise, which the loads at the start tell from loads."""
    truth = "estimate.truth={model: other, step: 0.01, histories: 8, within: 10.0}"
    code, said = run(bench, BIAS, truth, "estimate.runs=8", "simulate.duration=0.3")
    assert code == 0
    assert "offsets at the end sensor component offset σ unit gauges 1" in said
    found = Artefact(bench / "results" / "bench" / "estimate.h5")
    for name in ("side", "down"):
        assert 0.6 < found.summary[f"ratio.{name}"] < 1.4
    # what the estimate says that channels read has their offsets in it
    assert found.summary["mismatch.gauges"] < 0.3
    drawn = Offsets(np.arange(6), np.array([2e-5] * 3 + [0.05, 0.05, 0.5]), np.zeros(6)).drawn(1, 1, 6, 0)[0, 0]
    own = [found[f"/sensors/{sensor}/{what}"] for what in ("bias", "bias_std") for sensor in ("gauges", "felt")]
    score = (np.concatenate(own[:2]) - drawn) / np.concatenate(own[2:])
    assert np.abs(score).max() < 3.5
    assert np.all(own[2] < 0.5 * 2e-5)


@pytest.mark.parametrize("update", ["iterated", "one_shot"])
def test_drifting_offsets_beside_loads_that_walk_are_estimated_as_well_as_claimed(bench, update):
    """Truths of the filter's own model, with offsets that walk."""
    sensors = "estimate.sensors={gauges: {noise: 1.0e-6, bias: 1.0e-5, drift: 2.0e-5}, felt: {noise: 0.02}}"
    how = ("estimate.truth={model: walk}", "estimate.runs=10", "simulate.duration=0.2", f"estimate.method.update={update}")
    assert run(bench, sensors, *how)[0] == 0
    found = Artefact(bench / "results" / "bench" / "estimate.h5").summary
    assert found["nis"] == pytest.approx(1.0, abs=0.15)
    for name in ("side", "down"):
        assert 0.65 < found[f"ratio.{name}"] < 1.4


def test_an_offset_for_every_component_or_one_for_all(bench):
    code, said = run(bench, "estimate.sensors={gauges: {noise: 1.0e-6, bias: [1.0e-6, 2.0e-6]}}")
    assert code == 2
    assert "estimate.sensors.gauges.bias: 2 offsets for 3 components" in said


def test_offsets_are_drawn_anew_for_every_seed_and_walk_as_stated():
    drawn = Offsets(np.array([1, 2]), np.array([1.0, 0.0]), np.array([0.0, 0.1])).drawn(100, 400, 3, 7)
    assert not drawn[:, :, 0].any()
    assert np.ptp(drawn[:, :, 1], axis=0).max() == 0
    assert np.std(drawn[0, :, 1]) == pytest.approx(1.0, abs=0.1)
    assert np.std(drawn[-1, :, 2]) == pytest.approx(1.0, abs=0.1)
