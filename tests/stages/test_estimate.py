"""estimate on a file of a test: what it finds and writes, and files that are refused."""

from __future__ import annotations

import re

import numpy as np
import pytest
import pyvista
from vtkmodules.vtkIOHDF import vtkHDFReader

from strainsight import memory
from strainsight.runner.artefact import Artefact

from ..measurements.written import mdf, signal
from ..shared import slowly
from .tested_beam import (
    ALONE,
    BLIND,
    COMPARED,
    KNOWN,
    STUDIED,
    H,
    as_written,
    changed,
    estimated,
    result,
    table,
    write,
)

pytestmark = pytest.mark.usefixtures("no_hot_spots")


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    folder = tmp_path_factory.mktemp("test")
    changed(folder, "test", {})
    return folder


@pytest.fixture(scope="module")
def plain(project):
    return as_written(project)


@pytest.fixture(scope="module")
def known(tmp_path_factory):
    """The modulus under the known load alone."""
    folder = tmp_path_factory.mktemp("known")
    changed(folder, "test", KNOWN)
    return folder


def test_estimate_finds_what_validate_found(project, plain):
    """The same channels, noise and filter: the same numbers, but for the known load, which is straight between samples."""
    validate = Artefact(project / "results" / "test" / "validate.h5")
    _, arrays = plain
    truth = validate["/truth/side"]
    error = np.linalg.norm(arrays["/smoothed/side"] - truth) / np.linalg.norm(truth)
    assert error == pytest.approx(validate.summary["smoothed.side"], rel=0.3)
    assert abs(arrays["/smoothed/E"][-1] / 2.1e11 - 1) < 3 * validate.summary["std.E"]
    assert plain[0]["trusted"]
    assert plain[0]["verdict"].endswith("consistent with the claimed σ")


def test_the_field_of_the_surface_plays_in_time(project, plain):
    """On the flank of a bent beam the axial strain is that of the virtual gauge there, and the stress E times it."""
    found = result(project)
    reader = vtkHDFReader()
    reader.SetFileName(str(found.path))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == 5
    reader.SetStep(3)
    reader.Update()
    grid = pyvista.wrap(reader.GetOutput())
    centre = grid.cell_centers().points
    near = np.flatnonzero((np.abs(centre[:, 2] - 0.095) < 1e-9) & (np.abs(centre[:, 0] - 1.0) < 0.11))
    plane = np.column_stack([np.ones(len(near)), centre[near, 0] - 1.0, centre[near, 1] - 0.02])
    axial = np.linalg.lstsq(plane, grid.cell_data["strain"][near, 0], rcond=None)[0][0]
    assert axial == pytest.approx(found["/virtual/strain"][150, 0], rel=0.02)
    E = found["/smoothed/E"][150]
    stress = grid.cell_data["stress"][near, 0]
    np.testing.assert_allclose(stress, E * grid.cell_data["strain"][near, 0], rtol=0.05)
    assert np.all(grid.cell_data["von_mises_std"] > 0)


def test_a_virtual_gauge_reads_the_true_strain_where_none_is(project, plain):
    """Against the truth's own strain at the nearest candidates: straight over x on the flank of a beam."""
    train, validate = (Artefact(project / "results" / "test" / f"{s}.h5") for s in ("train", "validate"))
    position = train["/gauges/position"]
    near = np.flatnonzero((np.abs(position[:, 2] - 0.095) < 1e-9) & (np.abs(position[:, 0] - 1.0) < 0.11))
    instant = round(validate["/field/instant"] / H)
    # Linear in x and y there: the plane through the neighbours' true strains.
    plane = np.column_stack([np.ones(len(near)), position[near, 0] - 1.0, position[near, 1] - 0.02])
    expected = np.linalg.lstsq(plane, validate["/field/true"][near], rcond=None)[0][0]
    virtual = result(project)["/virtual/strain"][instant, 0]
    assert virtual == pytest.approx(expected, rel=0.02)


def test_without_a_known_load_it_finds_what_validate_found_to_the_digits_of_the_file(tmp_path):
    """Nothing between samples is guessed then: the filter sees what that of validate saw."""
    results = changed(tmp_path, "blind", BLIND)
    code, said = estimated(tmp_path, results / "measured.csv", config="blind.yaml")
    assert code == 0, said
    validate, found = (Artefact(results / f"{stage}.h5") for stage in ("validate", "estimate"))
    for path in ("/estimate/side", "/std/side", "/smoothed/side"):
        np.testing.assert_allclose(found[path], validate[path], rtol=1e-6, atol=1e-6)


def shares(artefact):
    source, root = [str(name) for name in artefact["/budget/source"]], "/budget/share/"
    return {
        path.removeprefix(root): dict(zip(source, artefact[path].tolist(), strict=True))
        for path in artefact.paths()
        if path.startswith(root)
    }


@pytest.mark.slow
def test_the_variance_of_an_estimate_is_made_of_what_place_expects(tmp_path):
    """Of a constant under one known load: by place along the training simulation, by validate and estimate along what
    they found."""
    results = changed(tmp_path, "test", KNOWN | {"frequency: 0": "frequency: 0.01"})
    code, said = estimated(tmp_path, results / "measured.csv", "estimate.start=settled")
    assert code == 0, said
    assert "budget of the filtered estimates" in said
    place, validate, estimate = (shares(Artefact(results / f"{s}.h5"))["E"] for s in ("place", "validate", "estimate"))
    assert sum(estimate.values()) == pytest.approx(1.0, rel=1e-6)
    assert place["load gain"] == pytest.approx(place["gain"], rel=0.1)
    for own, modulus in ((place, 1.89e11), (validate, 2.1e11), (estimate, 2.1e11)):
        # one mode, f ∝ √E: E is off by 2r² δf/f, and by (1 − r²) of a gain
        squared = (20.0 / Artefact(results / "rom.h5")["/frequency"][0]) ** 2 * 1.89e11 / modulus
        by_frequency, by_gain = 2 * squared * 0.01 * np.hypot(1, 0.5), (1 - squared) * 0.01 / np.sqrt(4)
        assert own["frequency"] / own["gain"] == pytest.approx((by_frequency / by_gain) ** 2, rel=0.25)
        for source in place.keys() - {"frequency"}:
            share = own[source] / (1 - own["frequency"])
            assert share == pytest.approx(place[source] / (1 - place["frequency"]), abs=0.03), source


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ((), "90 % of the recorded load 'tip' is outside"),
        *slowly((("filter.method=extended",), "not available with filter.method: extended")),
    ],
)
def test_a_start_that_cannot_have_settled_is_refused(known, tmp_path, settings, says):
    head, values = table(known)
    at = [name.startswith("tip") for name in head].index(True)
    # a tone of 61.7 Hz that the config does not state, 2.065 times as large as those that it does
    values[:, at] += 2.065 * np.sqrt(2) * np.std(values[:, at]) * np.sin(2 * np.pi * 61.7 * values[:, 0])
    file = write(tmp_path / "rough.csv", head, values)
    code, said = estimated(known, file, "estimate.start=settled", *settings)
    assert code == 2
    assert "estimate.start" in said
    assert says in " ".join(said.split())


def test_a_motion_under_an_unknown_load_is_not_known_to_have_settled(project):
    code, said = estimated(project, project / "results" / "test" / "measured.csv", "estimate.start=settled")
    assert code == 2
    assert "with an unknown load (side)" in " ".join(said.split())


@pytest.mark.slow
def test_a_modulus_with_unknown_loads_alone_has_no_sigma_but_for_loads_that_are_as_stated(project):
    sigmas = "/std/E", "/std/side", "/smoothed_std/E", "/smoothed_std/side", "/virtual/std"
    estimates = "/estimate/E", "/smoothed/side", "/virtual/strain"
    results, found = changed(project, "alone", ALONE), {}
    for stated in ("false", "true"):
        settings = f"estimate.loads_follow_model={stated}", "estimate.field={every: 0.1}", COMPARED
        code, said = estimated(project, results / "measured.csv", *settings, config="alone.yaml")
        assert code == 0, said
        own = Artefact(results / "estimate.h5")
        found[stated] = {path: own[path].copy() for path in own.paths()}, dict(own.summary), said
    (withheld, numbers, words), (given, all_numbers, other) = found["false"], found["true"]
    assert "no load is known, so the estimates of E depend on the process_noise of side" in " ".join(words.split())
    assert "σ is withheld, so filters are not compared" in " ".join(words.split())
    assert "/compared/ratio/E" in given
    assert not any(path.startswith("/compared") for path in withheld)
    assert "withheld" not in other
    assert "±" not in words
    assert "std.E" in all_numbers
    assert not any(name.startswith("std.") for name in numbers)
    for path in sigmas:
        assert np.isnan(withheld[path]).all()
        assert (given[path] > 0).any()
    field = "/VTKHDF/CellData/"
    assert {path for path in given if path.startswith(field)} - {path for path in withheld if path.startswith(field)} == {
        f"{field}strain_std", f"{field}von_mises_std"
    }
    for path in estimates:
        np.testing.assert_array_equal(withheld[path], given[path])


@pytest.mark.slow
def test_a_modulus_beyond_the_range_of_the_reduced_model_has_no_sigma_and_leads_with_that(project, plain):
    """2.1e11 Pa is the truth."""
    file = project / "results" / "test" / "measured.csv"
    narrow = "parameters.E.range=[1.6e+11, 2.0e+11]", "validate.truth.parameters.E=1.9e+11"
    code, said = estimated(project, file, *narrow, "name=beyond")
    assert code == 0, said
    words = " ".join(said.split())
    assert re.search(
        r"σ is withheld: E was estimated as 2\.\d+e\+11 Pa, but the stage `rom` built the reduced model for values "
        r"from 1\.6e\+11 to 2e\+11: widen "
        r"parameters\.E\.",
        words,
    )
    own = Artefact(project / "results" / "beyond" / "estimate.h5")
    assert own["/smoothed/E"][-1] == pytest.approx(2.1e11, rel=0.03)
    for path in ("/std/E", "/std/side", "/smoothed_std/E", "/smoothed_std/side", "/virtual/std"):
        assert np.isnan(own[path]).all()
    assert own.message.startswith("σ is withheld: E was estimated as 2.")
    assert not any(name.startswith("std.") for name in own.summary)


def test_validate_ranks_the_layout_and_sweeps_the_filter(tmp_path):
    found = changed(tmp_path, "ranked", {**BLIND, "name: test\n": "name: ranked\n", **STUDIED})
    validate = Artefact(found / "validate.h5")
    assert 1 <= validate.summary["rank_claimed.side"] <= 10
    assert -1 <= validate.summary["rank_correlation.side"] <= 1
    assert validate["/sweep/key"].tolist() == ["time_step", "process_noise"]
    # More process noise: more noise in the estimate, and said so.
    assert validate["/sweep/std/side"][1] > 1.5 * validate.summary["std.side"]


@pytest.mark.slow
def test_a_biased_time_step_reports_what_it_does(project):
    """The trapezoidal rule lengthens the period by (ωh)²/12: E comes out about twice that too large, and the notes say so."""
    file = project / "results" / "test" / "measured.csv"
    assert estimated(project, file, COMPARED)[0] == 0
    exact = result(project)["/compared/estimate/E"][0]
    code, said = estimated(project, file, "filter.scheme=trapezoidal", COMPARED)
    assert code == 0, said
    lam = (2 * np.pi * Artefact(project / "results" / "test" / "rom.h5")["/frequency"][0]) ** 2
    longer = 100 * lam * H**2 / 12
    stated = float(re.search(r"first mode by ([\d.e+-]+) %", said.replace("\n", " ")).group(1))
    assert stated == pytest.approx(longer, rel=0.1)
    # by the grid filter without tolerances: with them the damping is open, and E is what the gauges read rather than the period
    assert result(project)["/compared/estimate/E"][0] > exact


@pytest.mark.slow
def test_a_tenth_of_the_samples_may_be_missing(project, plain, tmp_path):
    head, values = table(project)
    rng = np.random.default_rng(1)
    gauges = [i for i, h in enumerate(head) if h.startswith("G")]
    for i in gauges:
        values[rng.random(len(values)) < 0.1, i] = np.nan
    code, said = estimated(project, write(tmp_path / "missing.csv", head, values))
    assert code == 0, said
    assert "missing samples in the file" in said
    found = result(project)["/smoothed/side"]
    assert np.linalg.norm(found - plain[1]["/smoothed/side"]) < 0.02 * np.linalg.norm(found)


def test_a_record_too_long_for_the_memory_is_refused_before_it_is_filtered(project, monkeypatch):
    """200 steps: mean and σ of filter and smoother with copies of them, and a dozen numbers for each of four channels."""
    monkeypatch.setattr(memory, "available_memory", lambda: 1e5)
    code, said = estimated(project, project / "results" / "test" / "measured.csv", "--force")
    assert code == 2
    states, needed = re.search(
        r"200 time steps of (\d+) states: (\S+) GiB .*, but 9\.31e-05 GiB", said
    ).groups()
    assert float(needed) == pytest.approx(8 * 200 * (8 * int(states) + 12 * 4) / 2**30, rel=0.01)
    assert "Estimate parts of the record" in said


@pytest.mark.parametrize(
    ("settings", "key", "says"),
    [
        (["estimate.channels.0.gauge=G9"], "estimate.channels.0.gauge", "G9"),
        (["estimate.channels.1.gauge=G1"], "estimate.channels", "the same measuring grid of a gauge"),
        (["estimate.channels.0.unit=mV/V"], "estimate.channels.0", "bridge"),
        (["estimate.inputs={}"], "estimate.inputs", "tip"),
        (["estimate.channels=[{channel: G1, gauge: G1, unit: m/m}]"], "estimate.channels", "cannot determine"),
        (["estimate.virtual=[{position: [1, 1, 1], direction: [1, 0, 0]}]"], "estimate.virtual.0", "surface"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_key(project, settings, key, says):
    code, said = estimated(project, project / "results" / "test" / "measured.csv", *settings)
    assert code == 2, said
    assert key in said
    assert says in said


def columns(project):
    """Name → values, unit, of the file that validate writes."""
    head, values = table(project)
    names, units = zip(*(column.rstrip("]").split(" [") for column in head), strict=True)
    return {name: (values[:, i], unit) for i, (name, unit) in enumerate(zip(names, units, strict=True))}


def recorded(path, found):
    """The same as MDF, missing samples marked as such."""
    t = found.pop("time")[0]
    signals = [
        signal(name, np.nan_to_num(values), t, unit, invalidation_bits=np.isnan(values)) for name, (values, unit) in found.items()
    ]
    return mdf(path, ("rig", signals))


@pytest.mark.slow
def test_the_estimate_is_that_of_the_csv_file(project, plain, tmp_path):
    file = recorded(tmp_path / "a.mf4", columns(project))
    code, said = estimated(project, file, "estimate.time.channel=null")
    assert code == 0, said
    found = result(project)
    for dataset, values in plain[1].items():
        np.testing.assert_allclose(found[dataset], values, rtol=1e-6, atol=1e-9 * np.abs(values).max())
