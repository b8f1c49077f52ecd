"""Gauges of a bench that sit elsewhere, turned, with another gauge factor: σ of loads covers it, seed after seed."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from ..robustness.small import write_project
from .test_bench_indistinct import RIG

LOOSE = "estimate.tolerances={position: 0.004, angle: 3.0, gain: 0.03, transverse: 0.01}"
GAUGES = "sensors.gauges.gauges=[" + ", ".join(
    f"{{position: [{at}], direction: [1, 0, 0]}}" for at in ("0.1875, 0.025, 0.08", "0.1875, 0.1, 0.06", "0.5625, 0.025, 0.08")
) + "]"  # fmt: skip


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    folder = tmp_path_factory.mktemp("installed")
    write_project(folder)
    (folder / "bench.yaml").write_text(RIG.replace("std: 1.0e+2", "std: 1.0"))
    return folder


def run(folder, *changes):
    words = [f"--set={change}" for change in changes]
    done = CliRunner().invoke(app, ["estimate", str(folder / "bench.yaml"), "--results", str(folder / "results"), *words])
    return done.exit_code, " ".join((done.output + (done.stderr or "")).split())


@pytest.mark.parametrize("zeroed", ["false", "true"])
def test_sigma_of_loads_covers_gauges_that_are_drawn_anew_for_every_seed(rig, zeroed):
    """Read where and how they are drawn, without linearisation; on the filter's own step, so that nothing else is wrong. Gauges
    taken for exact claim half of that σ or less."""
    noise = "estimate.sensors={gauges: {noise: 1.0e-8}}"
    how = (GAUGES, noise, "estimate.truth={model: own}", f"sensors.gauges.zeroed={zeroed}", "forces.side.signal.phase=1.0")
    assert run(rig, *how, LOOSE, "estimate.runs=60")[0] == 0
    found = Artefact(rig / "results" / "bench" / "estimate.h5")
    assert run(rig, *how)[0] == 0
    exact = Artefact(rig / "results" / "bench" / "estimate.h5")
    for name in ("side", "down"):
        assert 0.8 < found.summary[f"ratio.{name}"] < 1.2
        assert found.summary[f"std.{name}"] > 2 * exact.summary[f"std.{name}"]


def test_what_a_gain_leaves_of_a_load_is_its_share(rig):
    """One gauge, one load, a factor of 3 %: a linear filter scales with it, so σ² is 3 % of the estimate squared and what it is
    of an exact gauge, whatever the record."""
    one = "sensors.gauges.gauges=[{position: [0.1875, 0.025, 0.08], direction: [1, 0, 0]}]"
    none = [f"forces.{name}.signal={{type: constant, value: 0.0}}" for name in ("side", "again")]
    how = (
        one, *none, "estimate.inputs={down: {std: 1.0, increment: 10.0}}",
        "estimate.sensors={gauges: {noise: 1.0e-8}}", "estimate.truth={model: own, noise: false}",
    )  # fmt: skip
    found = []
    for tolerances in ("{position: 0.0, angle: 0.0, gain: 0.03, transverse: 0.0}", "null"):
        assert run(rig, *how, f"estimate.tolerances={tolerances}")[0] == 0
        own = Artefact(rig / "results" / "bench" / "estimate.h5")
        found.append((own["/inputs/down/estimate"], own["/inputs/down/std"]))
    (load, std), (_, exact) = found
    np.testing.assert_allclose(np.sqrt(std**2 - exact**2), 0.03 * np.abs(load), atol=5e-4 * 0.03 * np.abs(load).max())


def test_a_truth_of_the_filter_s_own_model_has_exact_gauges_and_is_refused(rig):
    code, said = run(rig, LOOSE, "estimate.truth={model: walk}")
    assert code == 2
    assert "a truth of the filter's own model has exact gauges" in said
