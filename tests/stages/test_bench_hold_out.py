"""Channels of a bench left out of its filter in turn: σ of what the others say covers the reading, a wrong channel is named."""

from __future__ import annotations

import io
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.experiment.bench.inverse.estimation import BenchEstimation
from strainsight.runner.artefact import Artefact
from strainsight_cli.main import app

from ..models import ended, project
from .test_bench_sensors import RIG as STRAINS

GAUGES = [[0.1875, 0.025, 0.08], [0.1875, 0.1, 0.06], [0.5625, 0.025, 0.08], [0.5625, 0.1, 0.06]]
RIG = (
    STRAINS[: STRAINS.index("  again:")]
    + "sensors:\n"
    + "  gauges: {type: strain, body: beam, gauges: ["
    + ", ".join(f"{{position: {place}, direction: [1, 0, 0]}}" for place in GAUGES)
    + "]}\n  tip: {type: motion, frame: tip}\n"
    + STRAINS[STRAINS.index("simulate:") :]
)
SENSORS = {"gauges": {"noise": 2e-8}, "tip": {"noise": 1e-6}}
BESIDE = "hold-out"
EACH = "estimate.hold_out=each"
CHANNELS = [f"gauges.{i}" for i in (1, 2, 3, 4)] + [f"tip.{i}" for i in (1, 2, 3)]


@pytest.fixture(scope="module")
def record():
    """Readings of a run with noise: a line an instant, time, four gauges, three displacements."""
    simulated = ended("simulate", RIG, beside=BESIDE).artefact("simulate")
    noise = np.random.default_rng(3).standard_normal((len(simulated["/time"]), 7)) * ([2e-8] * 4 + [1e-6] * 3)
    read = np.column_stack([simulated["/sensors/gauges"], simulated["/sensors/tip"]]) + noise
    return np.column_stack([simulated["/time"], read])


def scaled(record, factor=1.2):
    """The record with its second gauge off by a factor."""
    return record * [1, 1, factor, 1, 1, 1, 1, 1]


def estimated(*changes, sensors=SENSORS, ends=0, files=None):
    end = ended("estimate", RIG, f"estimate.sensors={json.dumps(sensors)}", *changes, files=files, beside=BESIDE)
    assert end.code == ends, end.text
    return end.artefact("estimate") if ends in (0, 3) else None, end.text


def csv(record):
    stream = io.StringIO()
    np.savetxt(stream, record, delimiter=",", header="t,a,b,c,d,x,y,z", comments="", fmt="%.15g")
    return {"test.csv": stream.getvalue()}


UNITS = {"gauges": [{"channel": c, "unit": "m/m"} for c in "abcd"], "tip": [{"channel": c, "unit": "m"} for c in "xyz"]}
MEASURED = {"file": "test.csv", "time": {"channel": "t"}, "channels": UNITS}


def of_test(record, *changes, ends=0):
    """A record as a test of this bench."""
    return estimated(f"estimate.measured={json.dumps(MEASURED)}", EACH, *changes, ends=ends, files=csv(record))


def ratios(found):
    return {name: found.summary[f"hold_out.ratio.{name}"] for name in CHANNELS}


def test_the_others_report_of_a_gauge_what_a_filter_reports_that_has_never_had_it():
    exact = "estimate.truth={model: filter_step, noise: false}"
    held, _ = estimated(exact, EACH)
    predicted = held["/sensors/gauges/predicted"][:, 3]
    assert held["/sensors/gauges/left_in"].tolist() == [""] * 4
    three, last = GAUGES[:3], GAUGES[3]
    listed = json.dumps([{"position": place, "direction": [1, 0, 0]} for place in three])
    beside = json.dumps({"type": "strain", "body": "beam", "gauges": [{"position": last, "direction": [1, 0, 0]}]})
    other, _ = estimated(exact, f"sensors.gauges.gauges={listed}", f"sensors.beside={beside}")
    expected = other["/sensors/beside/expected"][:, 0]
    np.testing.assert_allclose(predicted, expected, rtol=1e-7, atol=1e-7 * abs(expected).max())


@pytest.mark.slow
def test_sigma_covers_readings_of_truths_that_the_filter_could_have_made_offsets_and_all():
    offsets = {"gauges": {"noise": 2e-8, "bias": 5e-8, "drift": 1e-7}, "tip": {"noise": 1e-6, "bias": 2e-6}}
    found, _ = estimated(EACH, "estimate.truth={model: sampled}", "estimate.runs=16", sensors=offsets)
    assert all(0.8 < ratio < 1.2 for ratio in ratios(found).values())


@pytest.mark.slow
def test_sigma_covers_gauges_that_are_installed_anew_for_every_seed():
    loose = "estimate.tolerances={position: 0.004, angle: 3.0, gain: 0.03, transverse: 0.01}"
    how = "estimate.truth={model: filter_step}", "estimate.runs=40", "forces.side.signal.phase=1.0"
    small = "estimate.inputs={side: {std: 1.0, increment: 20.0}, down: {std: 1.0, increment: 10.0}}"
    found, _ = estimated(EACH, loose, small, *how, sensors={"gauges": {"noise": 1e-8}})
    held = [found.summary[f"hold_out.ratio.gauges.{i}"] for i in (1, 2, 3, 4)]
    assert all(0.8 < ratio < 1.2 for ratio in held)


def test_a_sound_record_is_borne_out_by_what_was_left_out(record):
    found, said = of_test(record)
    assert found.summary["verdict.side"] == found.summary["verdict.down"] == "confirmed by held-out sensors"
    assert found.summary["hold_out.inside"] > 0.9
    assert found.summary["trusted"] is True
    assert "inconsistent" not in said
    assert "disagree" not in said


def test_a_record_that_disagrees_with_the_model_ends_with_3_and_has_no_sigma_until_it_is_accepted(record):
    record = scaled(record, 1.1)
    found, said = of_test(record, ends=3)
    assert (found.summary["trusted"], found.summary["accepted"]) == (False, False)
    assert "inconsistent with the model: the estimates of side and down are inconsistent with the sensors. Check channels" in said
    assert "the prediction from the other channels disagrees with gauges.2 (error" in said
    assert max(ratios(found), key=ratios(found).__getitem__) == "gauges.2"
    assert all(np.isnan(found[f"/inputs/{name}/std"]).all() for name in ("side", "down"))
    assert not any(key.startswith("rms_std") for key in found.summary)
    # the claim that was tested
    assert np.isfinite(found["/sensors/gauges/predicted_std"]).any()
    accepted, said = of_test(record, "estimate.accept_inconsistent=true")
    assert "accepted: the measurements are inconsistent with the model" in said
    assert all(np.isfinite(accepted[f"/inputs/{name}/std"]).all() for name in ("side", "down"))
    np.testing.assert_array_equal(accepted["/inputs/side/estimate"], found["/inputs/side/estimate"])
    for name in ("side", "down"):
        assert accepted.summary[f"verdict.{name}"] == found.summary[f"verdict.{name}"] == "inconsistent with the sensors"


@pytest.mark.slow
def test_a_suite_with_such_a_record_ends_with_3_too(record):
    changes = {"estimate.sensors": SENSORS, "estimate.measured": MEASURED}
    one = {"config": "bench.yaml", "name": "one", "label": "One", "set": changes}
    suite = json.dumps({"kind": "suite", "name": "all", "title": "All", "runs": [one]})
    end = ended("run", suite, files={"bench.yaml": RIG, **csv(scaled(record))})
    assert end.code == 3, end.text
    assert (end.folder / "report.html").exists()


def test_what_leaves_its_range_does_not_hide_that_the_record_disagrees_with_the_model(record, tmp_path, monkeypatch):
    beyond = "E was estimated as 2 Pa, but the stage `reduce` built the reduced model for values from 0 to 1"
    monkeypatch.setattr(BenchEstimation, "outside_range", {"E": beyond})
    sensors = json.dumps(SENSORS | {"tip": {"noise": 1e-6, "bias": 1e-6}})
    changes = (f"estimate.sensors={sensors}", f"estimate.measured={json.dumps(MEASURED)}", EACH)
    words = ["estimate", str(project(RIG, csv(scaled(record)))), "--results", str(tmp_path), *(f"--set={own}" for own in changes)]
    done = CliRunner().invoke(app, words, env={"COLUMNS": "200"})
    said, found = " ".join((done.output + done.stderr).split()), Artefact(tmp_path / "bench" / "estimate.h5")
    assert done.exit_code == 3, said
    assert found.summary["trusted"] is False
    assert str(found.summary["withheld"]).endswith(beyond)
    assert found.summary["verdict.side"] == "σ is withheld"
    assert beyond in said
    against = "the estimates of side and down are inconsistent with the sensors"
    assert f"the measurements are inconsistent with the model: {against}" in said
    assert np.isnan(found["/sensors/tip/bias_std"]).all()
    assert "final offsets" in said
    assert "withheld" in said[said.index("final offsets") :]


def test_there_is_nothing_to_accept_where_the_truth_is_simulated():
    _, said = estimated("estimate.accept_inconsistent=true", ends=2)
    assert "estimate.accept_inconsistent: has no effect without the measurements of a test" in said


@pytest.mark.slow
def test_channels_that_were_exchanged_are_named(record):
    found, said = of_test(record[:, [0, 1, 2, 4, 3, 5, 6, 7]], ends=3)
    worst = max(ratios(found), key=ratios(found).__getitem__)
    assert worst in ("gauges.3", "gauges.4")
    assert f"the prediction from the other channels disagrees with {worst} (error" in said
    assert found.summary["verdict.side"] == "inconsistent with the sensors"


def test_a_channel_that_the_others_cannot_do_without_stays_in_with_the_reason():
    two = json.dumps([{"position": place, "direction": [1, 0, 0]} for place in GAUGES[:2]])
    found, said = estimated(EACH, f"sensors.gauges.gauges={two}", sensors={"gauges": {"noise": 2e-8}})
    assert np.isnan(found["/sensors/gauges/predicted"]).all()
    assert "the filter without gauges.1 failed: estimate.inputs: the sensors cannot determine side and down together" in said
    assert "hold_out.inside" not in found.summary


def test_a_grid_filter_refuses():
    _, said = estimated(EACH, "estimate.method.parameters=grid", ends=2)
    assert "does not support hold_out" in said
