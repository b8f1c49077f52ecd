"""Accelerometers beside the gauges of a bench: what they add, that σ holds, and what is refused."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from ..robustness.small import write_project
from .test_bench_from_outside import BENCH as ARM

SIDE = "side: {type: force, frame: end, direction: [0, 1, 0], signal: "
DOWN = "down: {type: force, frame: end, direction: [0, 0, 1], signal: "
STILL = "{type: constant, value: 0.0}}"
BENCH = (
    ARM[: ARM.index("estimate:")]
    .replace(SIDE + STILL, SIDE + "{type: sine, frequency: 1.3, amplitude: 300.0}}")
    .replace(DOWN + STILL, DOWN + "{type: sine, frequency: 0.7, amplitude: 200.0}}")
    .replace("zeroed: true", "zeroed: false")
    .replace("  end: {type: motion, frame: end}", "  hinge: {type: reaction, joint: hinge}")
    .replace("sensors:", "sensors:\n  felt: {type: acceleration, frame: end}")
    .replace("duration: 0.8", "duration: 0.5")
) + """estimate:
  sensors: {gauges: {noise: 1.0e-6}, felt: {noise: 0.02}}
  truth: {model: other, step: 0.005, histories: 4, within: 10.0}
  runs: 4
  inputs: {side: {std: 1.0, increment: 24.0}, down: {std: 1.0, increment: 9.0}}
"""  # fmt: skip


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    folder = tmp_path_factory.mktemp("felt")
    write_project(folder)
    (folder / "bench.yaml").write_text(BENCH)
    return folder


def run(folder, *changes):
    words = [f"--set={change}" for change in changes]
    done = CliRunner().invoke(
        app, ["estimate", str(folder / "bench.yaml"), "--results", str(folder / "results"), *words]
    )
    return done.exit_code, " ".join((done.output + (done.stderr or "")).split())


def test_loads_from_gauges_and_an_accelerometer_keep_to_their_sigma_by_another_integrator(bench):
    """Radau's truth, four histories. Gauges alone know the load across the hinge's spring four times worse."""
    assert run(bench)[0] == 0
    found = Artefact(bench / "results" / "bench" / "estimate.h5").summary
    for name in ("side", "down"):
        assert 0.7 < found[f"ratio.{name}"] < 1.3
    assert found["mismatch.felt"] < 0.01
    assert run(bench, "estimate.sensors={gauges: {noise: 1.0e-6}}", "estimate.runs=1", "estimate.truth.histories=1")[0] == 0
    alone = Artefact(bench / "results" / "bench" / "estimate.h5")
    assert alone.summary["std.down"] > 3 * found["std.down"]
    # by the estimate, beside what it is
    assert alone["/sensors/felt/expected"].shape == alone["/sensors/felt/measured"].shape
    assert not alone["/sensors/felt/used"]


def test_a_filter_refuses_what_it_has_no_equations_for(bench):
    code, said = run(bench, "estimate.disturbance=1.0e-3")
    assert code == 2
    assert "felt would feel the white acceleration" in said
    assert "set it to 0, and put what the model has wrong into the noise of felt" in said
    code, said = run(bench, "estimate.sensors={hinge: {noise: 1.0}}")
    assert code == 2
    assert "it is simulated only" in said
