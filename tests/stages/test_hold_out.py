"""Gauges left out of a test in turn: the prediction is that of a virtual gauge, its σ that of what the gauge may read."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from strainsight.workflow.artefact import Artefact

from .tested_beam import KNOWN, changed, estimated, result, table, write

pytestmark = pytest.mark.usefixtures("no_hot_spots")

EACH = "estimate.hold_out=each"
SAMPLES = 120


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """The beam with its modulus unknown under a known load, validated."""
    folder = tmp_path_factory.mktemp("held")
    results = changed(folder, "test", {**KNOWN, "name: test\n": "name: test\n"})
    # Other tolerances would rank the gauges anew: bonded ones stay what they are.
    (folder / "bonded.csv").write_bytes((results.parent / "test" / "gauges.csv").read_bytes())
    return folder


def record(project):
    """The first samples of the record."""
    head, values = table(project)
    return head, values[: SAMPLES + 1]


def run(project, *settings, values=None):
    head, sound = record(project)
    file = write(project / "record.csv", head, sound if values is None else values)
    bonded = ("gauges.fixed_file=bonded.csv", "estimate.as_placed=false")
    code, said = estimated(project, file, *bonded, *settings)
    assert code == 0, said
    return result(project), " ".join(said.split())


@pytest.mark.slow
def test_a_gauge_is_predicted_as_a_virtual_one_in_its_place_by_the_others(project):
    """And the reading is off by the noise of a sample and by its own gain, which no virtual strain is."""
    gain = 0.03
    exact = dict.fromkeys(("position", "angle", "transverse", "load_gain", "load_angle", "load_position"), 0)
    stated = ", ".join(f"{name}: {value}" for name, value in {**exact, "gain": gain, "damping": 1}.items())
    tolerances = f"tolerances={{{stated}}}"
    whole, _ = run(project, tolerances, EACH)
    predicted, std = whole["/hold_out/predicted"][:, 3], whole["/hold_out/std"][:, 3]
    channel = whole["/gauge/channel"][3]
    with (project / "bonded.csv").open(encoding="utf-8") as lines:
        row = list(csv.DictReader(lines))[3]
    place, along = ([float(row[f"{vector}_{x}"]) for x in "xyz"] for vector in ("position", "direction"))
    channels = ", ".join(f"{{channel: G{i}, gauge: G{i}, unit: m/m}}" for i in (1, 2, 3))
    virtual = f"estimate.virtual=[{{position: {place}, direction: {along}}}]"
    three, _ = run(project, tolerances, f"estimate.channels=[{channels}]", virtual)
    np.testing.assert_allclose(predicted, three["/virtual/strain"][1:, 0], rtol=1e-6, atol=1e-12)
    noise = Artefact(project / "results" / "test" / "screen.h5")["/noise_std"][channel]
    variance = three["/virtual/std"][1:, 0] ** 2 + noise**2 + (gain * predicted) ** 2
    np.testing.assert_allclose(std**2, variance, rtol=1e-6)


def test_sound_gauges_agree_with_the_others(project):
    found, said = run(project, EACH)
    error = found["/hold_out/predicted"] - found["/gauge/measured"]
    scaled = error / found["/hold_out/std"]
    assert found.summary["hold_out.inside"] == pytest.approx(np.mean(np.abs(scaled) < 2))
    assert found.summary["hold_out.inside"] > 0.9
    assert "contradict" not in said
    assert found["/hold_out/left_in"].tolist() == [""] * 4


@pytest.mark.slow
def test_a_gauge_that_reads_too_much_is_found(project):
    head, values = record(project)
    at = [h.startswith("G3") for h in head].index(True)
    values[:, at] *= 1.15
    found, said = run(project, EACH, values=values)
    ratio = {f"G{i}": found.summary[f"hold_out.ratio.G{i}"] for i in range(1, 5)}
    assert max(ratio, key=ratio.get) == "G3"
    assert "the other gauges contradict G3" in said


def test_a_gauge_that_the_others_cannot_do_without_stays_in_with_the_reason(project):
    found, said = run(project, EACH, "estimate.channels=[{channel: G1, gauge: G1, unit: m/m}]")
    assert np.isnan(found["/hold_out/predicted"]).all()
    assert "the others cannot tell anything" in said
    assert "hold_out.inside" not in found.summary


@pytest.mark.slow
def test_samples_that_are_missing_are_predicted_and_not_judged(project):
    head, values = record(project)
    at = [h.startswith("G2") for h in head].index(True)
    values[50:80, at] = np.nan
    found, _ = run(project, EACH, values=values)
    assert np.isfinite(found["/hold_out/predicted"]).all()
    assert np.isnan(found["/gauge/measured"][49:79, 1]).all()
    assert np.isfinite(found.summary["hold_out.inside"])
