"""A bench whose sensors were read in a test: what another run's sensors read gives the same loads from a file."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from ..robustness.small import BENCH, write_project

GAUGES = "[{position: [0.1, 0.0, 0.01], direction: [1, 0, 0]}, {position: [0.1, 0.01, 0.0], direction: [1, 0, 0]}]"
RIG = (
    BENCH[: BENCH.index("place:\n")]
    .replace("{type: strain, body: beam, layout: place}", f"{{type: strain, body: beam, gauges: {GAUGES}}}")
    .replace("simulate:", "  tip: {type: motion, frame: tip}\nsimulate:")
)
CHANNELS = {
    "gauges": [{"channel": "upper", "unit": "um/m"}, {"channel": "side", "unit": "m/m"}],
    "tip": [None, {"channel": "y", "unit": "mm"}, {"channel": "z", "unit": "mm"}],
}


def run(folder, *words):
    done = CliRunner().invoke(app, [words[0], str(folder / "bench.yaml"), "--results", str(folder / "results"), *words[1:]])
    return done.exit_code, " ".join((done.output + (done.stderr or "")).split())


def measured(sensors=("gauges",), **changes):
    """The setting that takes the file."""
    stated = {"file": "test.csv", "time": {"channel": "t", "unit": "ms"}, "channels": {n: CHANNELS[n] for n in sensors}}
    return f"--set=estimate.measured={json.dumps({**stated, **changes})}"


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    """A simulated bench, and a file of what its sensors read, in the units of a data logger."""
    folder = tmp_path_factory.mktemp("rig")
    write_project(folder)
    (folder / "bench.yaml").write_text(RIG)
    code, said = run(folder, "simulate", "--set=name=rig")
    assert code == 0, said
    found = Artefact(folder / "results" / "rig" / "simulate.h5")
    strain, tip = found["/sensors/gauges"], found["/sensors/tip"]
    table = np.column_stack([1e3 * found["/time"], 1e6 * strain[:, 0], strain[:, 1], 1e3 * tip[:, 1:]])
    lines = ["t,upper [um/m],side,y,z", *(",".join(f"{x:.15g}" for x in row) for row in table)]
    (folder / "test.csv").write_text("\n".join(lines) + "\n")
    return folder


def histories(folder):
    found = Artefact(folder / "results" / "bench" / "estimate.h5")
    return {name: found[f"/inputs/{name}/estimate"] for name in ("side", "down")}, found


def test_a_file_gives_the_loads_that_the_run_gives_it_was_written_from(rig):
    code, said = run(rig, "estimate", "--set=estimate.measured={from: rig}", "--set=estimate.truth.noise=false")
    assert code == 0, said
    by_run, _ = histories(rig)
    code, said = run(rig, "estimate", measured())
    assert code == 0, said
    by_file, found = histories(rig)
    for name in by_run:
        np.testing.assert_allclose(by_file[name], by_run[name], rtol=1e-6, atol=1e-6)
    assert "measured in test.csv" in said
    assert "side RMS" in said
    assert found.summary["rms.down"] == pytest.approx(np.sqrt(np.mean(by_file["down"][3:] ** 2)), rel=1e-6)


def test_samples_are_taken_as_they_are(rig):
    """A test has the noise that it has: none is added, and a component that nobody measured stays missing."""
    code, said = run(rig, "estimate", measured(("gauges", "tip")), "--set=estimate.sensors.tip={noise: 1.0e-6}")
    assert code == 0, said
    _, found = histories(rig)
    there = Artefact(rig / "results" / "rig" / "simulate.h5")
    np.testing.assert_allclose(found["/sensors/gauges/measured"], there["/sensors/gauges"][1:], rtol=1e-12, atol=1e-18)
    tip = found["/sensors/tip/measured"]
    assert np.isnan(tip[:, 0]).all()
    np.testing.assert_allclose(tip[:, 1:], there["/sensors/tip"][1:, 1:], rtol=1e-12, atol=1e-15)
    assert found.summary["mismatch.tip"] < 0.01


def test_a_file_with_a_finer_clock_is_thinned_to_the_steps_of_the_filter(rig):
    rows = np.loadtxt(rig / "test.csv", delimiter=",", skiprows=1)
    fine = np.linspace(0, rows[-1, 0], 2 * len(rows) - 1)
    table = np.column_stack([fine, *(np.interp(fine, rows[:, 0], column) for column in rows[:, 1:].T)])
    np.savetxt(rig / "fine.csv", table, delimiter=",", header="t,upper [um/m],side,y,z", comments="", fmt="%.15g")
    assert run(rig, "estimate", measured())[0] == 0
    coarse, _ = histories(rig)
    code, said = run(rig, "estimate", measured(file="fine.csv"))
    assert code == 0, said
    for name, history in histories(rig)[0].items():
        np.testing.assert_allclose(history, coarse[name], rtol=1e-6, atol=1e-6)


def test_a_load_that_only_a_component_feels_that_nobody_measured_is_refused_by_name(rig):
    along = [CHANNELS["tip"][1] | {"channel": "y"}, None, CHANNELS["tip"][2]]
    code, said = run(rig, "estimate", measured(channels={"tip": along}), "--set=estimate.sensors={tip: {noise: 1.0e-6}}")
    assert code == 2
    assert "no sensor feels it" in said
    assert "estimate.inputs.side" in said


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ([measured(channels={"gauges": CHANNELS["gauges"][:1]})], "1 channels for 2 components"),
        ([measured(channels={"gauges": [None, None]})], "no component is measured"),
        ([measured(channels={"gauges": [CHANNELS["gauges"][0], None]})], "1 channels for 2 unknown loads"),
        ([measured(channels={"tip": CHANNELS["tip"]})], "tip"),
        ([measured(channels={"gauges": [CHANNELS["tip"][1], CHANNELS["gauges"][1]]})], "is of the kind strain"),
        ([measured(channels={"gauges": [{"channel": "uper", "unit": "um/m"}, CHANNELS["gauges"][1]]})], "upper"),
        ([measured(), "--set=estimate.duration=0.3", "--set=simulate.duration=0.3"], "the file ends after 0.2 s"),
        ([measured(), "--set=estimate.runs=3"], "a test is one run"),
        ([measured(**{"from": "rig"})], "give exactly one of 'from', 'file'"),
        ([measured(), "--set=estimate.time_step=0.004"], "estimate.measured"),
    ],
)
def test_a_file_that_does_not_fit_is_refused(rig, settings, says):
    code, said = run(rig, "estimate", *settings)
    assert code == 2, said
    assert says in said
    assert "estimate." in said
