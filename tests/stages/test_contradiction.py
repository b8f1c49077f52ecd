"""estimate on records that contradict the model: what is named, what is withheld, and how the command ends."""

from __future__ import annotations

import re

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from .tested_beam import BLIND, changed, estimated, table, write

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
    assert "not to be trusted" not in said
    assert found["/trusted"]
    assert not found["/channel_check/by_others"]
    assert np.all(found["/channel_check/correlation"] > 0.99)
    assert np.all(np.abs(found["/channel_check/residual"] - 1) < 0.15)
    assert set(found["/channel_check/fault"]) == {""}


def test_a_heavier_structure_is_named_by_the_mode_that_it_moves(tmp_path):
    """Density 30 % above that of the model under an unknown load through resonance: f ∝ 1/√ρ is 12 % lower."""
    heavy = BLIND | {
        "name: test\n": "name: blind\n",
        "guess: 1.89e+11": "guess: 2.1e+11",
        "loads:\n": "  rho: {property: density, region: 1, guess: 7850, range: [6000, 12000]}\nloads:\n",
        "type: sine, frequency: 10.0, amplitude: 2.0e+3": "type: multisine, lowest: 5, highest: 70, count: 14, amplitude: 2.0e+3",
        "{model: integrated_random_walk}": "{model: integrated_random_walk, frequency: 70}",
        "relative_to_strongest: 0.01": "relative_to_strongest: 0.001",
        "{E: 2.1e+11}, modes": "{E: 2.1e+11, rho: 10200}, modes",
    }
    results = changed(tmp_path, "blind", heavy)
    code, said, found = found_of(tmp_path, results / "measured.csv")
    modelled = Artefact(results / "rom.h5")["/frequency"]
    mode, best = re.search(r"mode (\d) fits best at ([\d.]+) Hz", said).groups()
    assert code == 3
    assert not found["/trusted"]
    assert float(best) == pytest.approx(modelled[int(mode) - 1] * np.sqrt(7850 / 10200), rel=0.05)
    assert "nothing speaks against" not in said


def test_a_wrong_sign_is_named_with_its_key_and_takes_the_sigma_away(project):
    file = wrong(project, "sign", lambda y: -y)
    code, said, found = found_of(project, file)
    assert code == 3
    assert "G2 fits with sign −1: check the wiring, or set estimate.channels.1.sign: -1" in said
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
def test_run_ends_with_3_where_the_record_contradicts_the_model(project):
    file = wrong(project, "sign", lambda y: -y)
    run = CliRunner().invoke(
        app,
        [
            "run",
            str(project / "blind.yaml"),
            "--results",
            str(project / "results"),
            f"--set=estimate.file={file.name}",
            "--set=validate.random_sets=0",
        ],
    )
    assert run.exit_code == 3, run.output


@pytest.mark.slow
def test_what_is_accepted_has_its_sigma_and_ends_with_0(project):
    file = wrong(project, "sign", lambda y: -y)
    code, said, found = found_of(project, file, "--accept")
    assert code == 0
    assert "accepted: the record contradicts the model: G2 fits with sign −1" in said
    assert np.all(found["/std/side"] > 0)
    assert not found["/trusted"]
    assert found_of(project, file, "estimate.accept=true")[0] == 0


@pytest.mark.slow
def test_the_key_that_is_named_undoes_the_fault(project):
    sign = "estimate.channels.1.sign=-1"
    code, _, found = found_of(project, wrong(project, "sign", lambda y: -y), sign)
    assert code == 0
    straight = found_of(project, project / "results" / "blind" / "measured.csv")[2]["/smoothed/side"].copy()
    np.testing.assert_allclose(found["/smoothed/side"], straight, rtol=1e-9)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda y: 1e3 * y, "G2 reads 1000 times what fits: check estimate.channels.1.unit (now m/m)"),
        (lambda y: y + 3e-4, "G2 fits with an offset of 300"),
        (lambda y: np.clip(y, -4e-6, 4e-6), "G2 is clipped"),
    ],
)
@pytest.mark.slow
def test_other_faults_are_named_in_words_that_an_engineer_can_act_on(project, change, says):
    code, said, _ = found_of(project, wrong(project, "other", change))
    assert code == 3
    assert says in said


@pytest.mark.slow
def test_noise_is_spoken_of_where_no_channel_is_to_blame(project):
    """All channels five times as noisy as stated."""
    head, values = table(project, "blind")
    rng = np.random.default_rng(1)
    values[:, 1:] += 2e-7 * rng.standard_normal(values[:, 1:].shape)
    code, said, found = found_of(project, write(project / "noisy.csv", head, values))
    assert code == 3
    assert "no single fault of a channel or a known load explains it" in said
    assert "noise_std" in said
    assert found["/channel_check/candidate"].size == 0


@pytest.mark.slow
def test_a_clock_in_other_units_is_asked_about(project):
    head, values = table(project, "blind")
    values[:, 0] *= 1e3
    _, said, _ = found_of(project, write(project / "ms.csv", head, values))
    assert "check estimate.time.unit" in said


def test_the_estimate_of_a_bench_has_nothing_to_accept(tmp_path):
    (tmp_path / "bench.yaml").write_text("kind: bench\n")
    done = CliRunner().invoke(app, ["estimate", str(tmp_path / "bench.yaml"), "--accept"])
    assert done.exit_code == 2
