"""Records that contradict the model, known loads as loggers write them, and gauges left out in turn."""

from __future__ import annotations

import csv
import re

import numpy as np
import pytest

from strainsight.runner.artefact import Artefact

from ..shared import slowly
from .tested_beam import BLIND, KNOWN, changed, estimated, result, table, write

pytestmark = pytest.mark.usefixtures("no_hot_spots")


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """Four gauges and one unknown load."""
    folder = tmp_path_factory.mktemp("wrong")
    changed(folder, "blind", BLIND)
    return folder


def found_of(project, file, *settings):
    code, said = estimated(project, file, *settings, config="blind.yaml")
    return code, " ".join(said.split()), Artefact(project / "results" / "blind" / "estimate.h5")


def wrong(project, name, change):
    """The record with G2 changed."""
    head, values = table(project, "blind")
    at = head.index("G2 [m/m]")
    values[:, at] = change(values[:, at])
    return write(project / f"{name}.csv", head, values)


def test_a_record_that_agrees_ends_with_0_and_its_channels_are_listed(project):
    code, said, found = found_of(project, project / "results" / "blind" / "measured.csv")
    assert code == 0
    assert "not reliable" not in said
    assert found["/trusted"]
    assert not found["/channel_check/by_others"]
    assert np.all(found["/channel_check/correlation"] > 0.99)
    assert np.all(np.abs(found["/channel_check/residual"] - 1) < 0.15)
    assert set(found["/channel_check/fault"]) == {""}


@pytest.mark.slow
def test_a_heavier_structure_is_named_by_the_mode_that_it_moves(tmp_path):
    """Density 30 % above that of the model under an unknown load through resonance: f ∝ 1/√ρ is 12 % lower."""
    heavy = BLIND | {
        "guess: 1.89e+11": "guess: 2.1e+11",
        "loads:\n": "  rho: {property: density, region: 1, guess: 7850, range: [6000, 12000]}\nloads:\n",
        "type: sine, frequency: 10.0, amplitude: 2.0e+3": "type: multisine, lowest: 5, highest: 70, count: 14, amplitude: 2.0e+3",
        "{model: integrated_random_walk}": "{model: integrated_random_walk, frequency: 70}",
        "relative_to_strongest: 0.01": "relative_to_strongest: 0.001",
        "{E: 2.1e+11}, modes": "{E: 2.1e+11, rho: 10200}, modes",
        "frequency: 0, damping: 1": "frequency: 0.01",
        "duration: 0.2, time_step: 1.0e-3": "duration: 0.3, time_step: 5.0e-4",
        "  time_step: 1.0e-3\n  duration: 0.2\n": "  time_step: 5.0e-4\n  duration: 0.3\n",
    }
    results = changed(tmp_path, "blind", heavy)
    code, said, found = found_of(tmp_path, results / "measured.csv")
    modelled = Artefact(results / "rom.h5")["/frequency"]
    mode, best = re.search(r"mode (\d) is measured at ([\d.]+) Hz", said).groups()
    assert code == 3
    assert not found["/trusted"]
    assert float(best) == pytest.approx(modelled[int(mode) - 1] * np.sqrt(7850 / 10200), rel=0.05)
    assert "consistent with the claimed" not in said


def test_a_wrong_sign_is_named_with_its_key_and_takes_the_sigma_away(project):
    file = wrong(project, "sign", lambda y: -y)
    code, said, found = found_of(project, file)
    assert code == 3
    assert "G2 has the opposite sign: check the wiring, or set estimate.channels.1.sign: -1" in said
    assert "raise process_noise" not in said
    assert "raise noise_std" not in said
    assert not found["/trusted"]
    assert np.isnan(found["/std/side"]).all()
    assert np.isfinite(found["/estimate/side"]).all()
    assert found["/channel_check/correlation"][1] < -0.99
    assert "std.side" not in found.summary
    again, said, _ = found_of(project, file)
    assert again == 3
    assert "up to date" in said


@pytest.mark.slow
def test_what_is_accepted_has_its_sigma_and_ends_with_0(project):
    file = wrong(project, "sign", lambda y: -y)
    code, said, found = found_of(project, file, "--accept")
    assert code == 0
    assert "accepted: the measurements are inconsistent with the model: G2 has the opposite sign" in said
    assert np.all(found["/std/side"] > 0)
    assert not found["/trusted"]
    assert found_of(project, file, "estimate.accept_inconsistent=true")[0] == 0


@pytest.mark.slow
def test_noise_is_spoken_of_where_no_channel_is_to_blame(project):
    """All channels five times as noisy as stated."""
    head, values = table(project, "blind")
    rng = np.random.default_rng(1)
    values[:, 1:] += 2e-7 * rng.standard_normal(values[:, 1:].shape)
    code, said, found = found_of(project, write(project / "noisy.csv", head, values))
    assert code == 3
    assert "no single fault of a channel, a known load or the model explains the inconsistency" in said
    assert "noise_std" in said
    assert found["/channel_check/candidate"].size == 0


TRUE = 2.1e11


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """The beam with its modulus unknown under a known load, validated, and the file of where its gauges are bonded."""
    folder = tmp_path_factory.mktemp("known")
    changed(folder, "test", KNOWN)
    # Other tolerances would rank the gauges anew: bonded ones stay what they are.
    (folder / "bonded.csv").write_bytes((folder / "results" / "test" / "gauges.csv").read_bytes())
    return folder


def with_load(known, name, change):
    head, values = table(known)
    values[:, -1] = change(values[:, -1])
    return write(known / f"{name}.csv", head, values)


def by_known_load(known, file, *settings):
    code, message = estimated(known, file, *settings)
    return code, " ".join(message.split())


def right(known):
    """E within 2σ of the truth, which is known to 1 %."""
    value, std = (float(result(known)[f"/{name}/E"][-1]) for name in ("smoothed", "std"))
    return abs(value - TRUE) < 2 * std < 0.02 * TRUE


def blanks(u):
    return np.where(np.arange(len(u)) % 5 == 0, u, np.nan)


def repeated(u):
    return u[np.arange(len(u)) // 4 * 4]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        *slowly((lambda u: u, ""), (blanks, "missing samples of the load")),
        (repeated, "tip: the file contains every sample 4 times, so the channel was sampled at 250 Hz"),
    ],
)
def test_a_slower_load_gives_the_modulus(known, change, says):
    code, said = by_known_load(known, with_load(known, "slower", change))
    assert code == 0, said
    assert says in said
    assert right(known)


def rough(u):
    return u + 5e3 * np.random.default_rng(1).standard_normal(len(u))


def with_a_gap(u):
    return np.where((np.arange(len(u)) >= 100) & (np.arange(len(u)) < 120), np.nan, u)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (rough, "of the RMS of the load 'tip' is due to frequencies above 300 Hz (0.3 times its sampling rate)"),
        (with_a_gap, "the known load 'tip' has missing samples: 20 in total, 20 in a row, the first at 0.1 s"),
    ],
)
def test_a_load_that_its_samples_do_not_show_is_refused(known, change, says):
    code, said = by_known_load(known, with_load(known, "unfit", change))
    assert code == 2
    assert says in said
    assert "estimate.inputs.tip" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "says", "settings"),
    [
        (lambda u: 1e-3 * u, "set estimate.inputs.tip.scale: 1000", ["estimate.inputs.tip.scale=1000"]),
        (
            lambda u: np.concatenate([[0, 0], u[:-2]]),
            "tip is 2 samples (0.002 s) late: set estimate.inputs.tip.delay: {samples: 2}",
            ["estimate.inputs.tip.delay={samples: 2}"],
        ),
    ],
    ids=["unit", "late"],
)
def test_what_is_printed_undoes_the_fault_of_a_load(known, change, says, settings):
    file = with_load(known, "wrong", change)
    code, said = by_known_load(known, file)
    assert code == 3
    assert says in said
    code, said = by_known_load(known, file, *settings)
    assert code == 0, said
    assert right(known)


EACH = "estimate.hold_out=each"
SAMPLES = 120


def run(known, *settings):
    """The estimate of the first samples of the record, by gauges that are bonded."""
    head, values = table(known)
    file = write(known / "record.csv", head, values[: SAMPLES + 1])
    code, said = estimated(known, file, "gauges.fixed_file=bonded.csv", "estimate.as_placed=false", *settings)
    assert code == 0, said
    return result(known), " ".join(said.split())


@pytest.mark.slow
def test_a_gauge_is_predicted_as_a_virtual_one_in_its_place_by_the_others(known):
    """And the reading is off by the noise of a sample and by its own gain, which no virtual strain is."""
    gain = 0.03
    exact = dict.fromkeys(("position", "angle", "common_gain", "transverse", "load_gain", "load_angle", "load_position"), 0)
    stated = ", ".join(f"{name}: {value}" for name, value in {**exact, "gain": gain, "damping": 1}.items())
    tolerances = f"tolerances={{{stated}}}"
    whole, _ = run(known, tolerances, EACH)
    predicted, std = whole["/hold_out/predicted"][:, 3], whole["/hold_out/std"][:, 3]
    channel = whole["/gauge/channel"][3]
    with (known / "bonded.csv").open(encoding="utf-8") as lines:
        row = list(csv.DictReader(lines))[3]
    place, along = ([float(row[f"{vector}_{x}"]) for x in "xyz"] for vector in ("position", "direction"))
    channels = ", ".join(f"{{channel: G{i}, gauge: G{i}, unit: m/m}}" for i in (1, 2, 3))
    virtual = f"estimate.virtual=[{{position: {place}, direction: {along}}}]"
    three, _ = run(known, tolerances, f"estimate.channels=[{channels}]", virtual)
    np.testing.assert_allclose(predicted, three["/virtual/strain"][1:, 0], rtol=1e-6, atol=1e-12)
    noise = Artefact(known / "results" / "test" / "screen.h5")["/noise_std"][channel]
    variance = three["/virtual/std"][1:, 0] ** 2 + noise**2 + (gain * predicted) ** 2
    np.testing.assert_allclose(std**2, variance, rtol=1e-6)


def test_sound_gauges_agree_with_the_others(known):
    found, said = run(known, EACH)
    error = found["/hold_out/predicted"] - found["/gauge/measured"]
    scaled = error / found["/hold_out/std"]
    assert found.summary["hold_out.inside"] == pytest.approx(np.mean(np.abs(scaled) < 2))
    assert found.summary["hold_out.inside"] > 0.9
    assert "inconsistent" not in said
    assert "disagree" not in said
    assert found["/hold_out/left_in"].tolist() == [""] * 4


def test_a_gauge_that_the_others_cannot_do_without_stays_in_with_the_reason(known):
    found, said = run(known, EACH, "estimate.channels=[{channel: G1, gauge: G1, unit: m/m}]")
    assert np.isnan(found["/hold_out/predicted"]).all()
    assert "the other gauges cannot determine any unknown" in said
    assert "hold_out.inside" not in found.summary
