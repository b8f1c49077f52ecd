"""The page of a test, its figures, views and status: what they show is what estimate.h5 holds, and they say what it is of."""

from __future__ import annotations

import hashlib
import json
import re

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.errors import UserError
from strainsight.experiment.structure.surface import largest_principal, largest_reading
from strainsight.fem.elasticity import SHEARS
from strainsight.records.estimated import Estimated
from strainsight.records.record import read
from strainsight.runner.artefact import Artefact
from strainsight.stages.view.views import view_of
from strainsight_cli.main import app

from ..shared import strains
from .conftest import ROOT, job_of
from .tested_beam import COMPARED, CONFIG, PLAIN, estimated

NOISE = 0.5e-6
DATED = "estimate.date=2025-03-14 10:20"


def call(project, command, *words):
    done = CliRunner().invoke(app, [command, str(project / "test.yaml"), "--results", str(project / "results"), *words])
    assert "Traceback" not in done.output
    return done


def options_of(folder):
    return json.loads((folder / "options.json").read_text())


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """Placed gauges and the record of a training simulation that they would have made, in µm/m and wired the wrong way
    round at G2, with its estimate; nothing of it was validated."""
    folder = tmp_path_factory.mktemp("tested")
    channels = CONFIG[CONFIG.index("    - {channel: G1") : CONFIG.index("  inputs:")]
    text = CONFIG.replace("MESH", str(ROOT / "meshes" / "cantilever.bdf")).replace(
        channels,
        "    - {channel: G1, gauge: G1, unit: um/m, bias: 1.0e-5}\n"
        "    - {channel: G2, gauge: G2, unit: um/m, sign: -1, offset: 12.0}\n"
        "    - {channel: G3, gauge: G3, unit: um/m}\n",
    )
    (folder / "test.yaml").write_text(text)
    assert call(folder, "place").exit_code == 0
    train, place = (Artefact(folder / "results" / "test" / f"{name}.h5") for name in ("train", "place"))
    strain = strains(train)[:, place["/selected/final/number"][:3]]
    rng = np.random.default_rng(5)
    readings = 1e6 * (strain + NOISE * rng.standard_normal((len(strain), 3)))
    readings[:, 0] += 9.0
    readings[:, 1] = 12.0 - readings[:, 1]
    time = train["/time"]
    force = 1e4 * np.sin(2 * np.pi * 20 * time)
    rows = np.column_stack([time, readings, force])
    lines = ["time,G1,G2,G3,tip", *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    lines[40] = re.sub(r"^([^,]*),[^,]*", r"\1,", lines[40])  # one sample of G1 is missing
    (folder / "shaken.csv").write_text("\n".join(lines) + "\n")
    # a picture at the instant of the largest strain, and at its multiples
    strain = np.abs(readings / 1e6 - [9e-6, 12e-6, 0])
    field = f"estimate.field={{every: {time[strain.max(axis=1).argmax()]:.6g}}}"
    damage = "estimate.damage={curve: {slope: 5, stress: 3.0e+7}, draws: 40, points: 10}"
    (folder / "options.json").write_text(json.dumps([DATED, field, damage]))
    code, said = estimated(folder, folder / "shaken.csv", *options_of(folder), COMPARED, "--page")
    assert code == 0, said
    return folder


@pytest.fixture(scope="module")
def found(project):
    return Artefact(project / "results" / "test" / "estimate.h5")


@pytest.mark.slow
def test_the_file_and_what_was_done_to_it_are_in_the_artefact(project, found):
    own, file = read(Estimated, found).source, project / "shaken.csv"
    assert own.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()
    assert (own.file, own.bytes, own.format, own.date) == ("shaken.csv", file.stat().st_size, "csv", "2025-03-14 10:20")
    assert own.channel == own.measures == ("G1", "G2", "G3", "tip")
    assert own.sign.tolist() == [1, -1, 1, 1]
    assert own.offset.tolist() == [0, 12, 0, 0]
    assert np.isnan(own.zero).all()
    np.testing.assert_allclose(
        read(Estimated, found).known["tip"], 1e4 * np.sin(40 * np.pi * found["/time"]), atol=1e-2
    )


@pytest.mark.slow
def test_the_moment_is_that_of_the_largest_reading_without_its_offset_and_its_surface_is_that_in_time(found):
    own = read(Estimated, found)
    measured = own.gauge.measured.copy()
    measured[:, 0] -= own.bias.mean[0]
    assert own.bias.mean[0] == pytest.approx(9e-6, abs=1e-6)
    k, i = np.unravel_index(np.nanargmax(np.abs(measured)), measured.shape)
    moment = own.moment
    assert (moment.time, moment.label) == (own.gauge.time[k], own.gauge.label[i])
    time = found["/VTKHDF/Steps/Values"] + found["/time"][0]
    k = int(np.argmin(np.abs(time - moment.time)))
    assert time[k] == pytest.approx(moment.time, abs=1e-9)
    stress = found["/VTKHDF/CellData/von_mises"].reshape(len(time), -1)[k]
    np.testing.assert_allclose(np.sort(stress), np.sort(moment.von_mises), rtol=1e-6)


@pytest.mark.slow
def test_status_has_the_estimate_whether_it_is_up_to_date_and_a_file_that_is_gone(project):
    def lines(*words):
        options = [f"--set={text}" for text in (*options_of(project), COMPARED)]
        done = call(project, "status", *options, *words)
        return {line.split()[0]: line for line in done.stdout.splitlines() if line.split()}, done.stderr

    found, _ = lines()
    assert "up to date" in found["estimate"]
    assert "from shaken.csv" in found["estimate"]
    assert "up to date" in found["test"]
    assert "will run" in lines("--set=seed=4")[0]["estimate"]
    hidden = (project / "shaken.csv").rename(project / "away.csv")
    try:
        found, said = lines()
        assert "shaken.csv is missing" in said
        assert "estimate" not in found
    finally:
        hidden.rename(project / "shaken.csv")


@pytest.mark.slow
def test_the_field_is_that_of_the_test_and_reports_it(project, found):
    def view(*overrides, **asked):
        job = job_of(project / "test.yaml", project / "results", *overrides)
        return view_of(job.model, ("import", "place"), job.folder, "own.yaml", "field", **asked)[0]

    shown = view()
    assert shown.title == "test: estimate from the test shaken.csv"
    stress = found["/VTKHDF/CellData/von_mises"]
    assert shown.panels[0].values.max() == pytest.approx(stress.max() / 1e6, rel=1e-6)
    time = found["/VTKHDF/Steps/Values"]
    assert f"t = {time[1]:.4g}" in view(at=float(time[1])).panels[0].title
    with pytest.raises(UserError, match=r"validate\.h5 is missing"):
        view(of="validation")


@pytest.mark.slow
def test_without_a_surface_in_time_the_field_is_that_of_the_moment(project):
    """And the page holds one channel, which tells but one of the unknowns."""
    options = ("name=short", "estimate.channels=[{channel: G3, gauge: G3, unit: um/m}]")
    code, said = estimated(project, project / "shaken.csv", *options, "--allow-unobservable", "--page")
    assert code == 0, said
    job = job_of(project / "test.yaml", project / "results", *options)
    shown, stages = view_of(job.model, ("import", "place"), job.folder, "own.yaml", "field")
    own = read(Estimated, Artefact(job.folder / "estimate.h5")).moment
    assert stages[-1] == "estimate"
    np.testing.assert_allclose(shown.panels[0].values, own.von_mises / 1e6, rtol=1e-6)
    assert f"{own.time:.4g} s (largest reading, G3)" in shown.panels[0].title
    with pytest.raises(UserError, match="does not depend on time"):
        view_of(job.model, ("import", "place"), job.folder, "own.yaml", "field", at=0.1)
    # the option that let it pass is taken from the artefact, too
    lines = call(project, "status", *(f"--set={text}" for text in (*options, PLAIN))).stdout.splitlines()
    assert all("up to date" in line for line in lines if line.startswith(("estimate", "test ")))


def test_the_principal_strain_of_largest_size_is_that_of_its_tensor():
    strain = np.random.default_rng(7).standard_normal((50, 6))
    strain[0] = [1.0, 0, 0, 0, 0, 0]
    strain[1] = [0, 0, 0, 4.0, 0, 0]  # shear alone: γ/2 to either side, the positive one of equals
    tensor = np.einsum("ka,ab->kab", strain[:, :3], np.eye(3))
    for pair, shear in zip(SHEARS, strain[:, 3:].T, strict=True):
        tensor[(slice(None), *pair)] = tensor[(slice(None), *pair[::-1])] = shear / 2
    least, _, most = np.linalg.eigvalsh(tensor).T
    found = largest_principal(strain)
    np.testing.assert_allclose(found, np.where(-least > most + 1e-9, least, most), rtol=1e-9)
    assert found[:2].tolist() == pytest.approx([1.0, 2.0])


def test_the_largest_reading_passes_over_what_is_missing_and_over_offsets():
    values = np.array([[1.0, np.nan], [-3.0, 100.0], [np.nan, np.nan]])
    assert largest_reading(values, np.zeros(2), np.ones(2)) == (1, 1)
    assert largest_reading(values, np.array([0.0, 99.0]), np.ones(2)) == (1, 0)
    assert largest_reading(values, np.zeros(2), np.array([1.0, np.inf])) == (1, 0)
    assert largest_reading(np.full((3, 2), np.nan), np.zeros(2), np.ones(2)) == (0, 0)
