"""estimate on files of a test, written from what the simulator measured: read right, or refused with the line."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
import pyvista
from typer.testing import CliRunner
from vtkmodules.vtkIOHDF import vtkHDFReader

from strainsight.fem import memory
from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from .conftest import ROOT
from .test_artefacts import UNITS_OF, rows

CONFIG = """
kind: placement
name: test
mesh: {file: MESH}
parameters:
  E: {property: youngs_modulus, region: 1, guess: 1.89e+11, range: [1.6e+11, 2.4e+11]}
loads:
  tip: {node: 2, direction: [0, 0, 1], known: true, signal: {type: sine, frequency: 20.0, amplitude: 1.0e+4}}
  side:
    node: 2
    direction: [0, 1, 0]
    known: false
    signal: {type: sine, frequency: 10.0, amplitude: 2.0e+3}
    process_noise: {model: integrated_random_walk}
damping: {type: modal, ratio: 0.01}
train: {duration: 0.3, time_step: 5.0e-4}
gauges:
  direction: {type: axis, axis: [1, 0, 0]}
  noise_std: {relative_to_strongest: 0.01}
tolerances: {load_angle: 0, load_position: 0}
screen: {keep: 40}
place: {estimate: [side, E], keep: 4, instants: 2, minimum_spacing: 0.1}
validate:
  truth: {model: modes, parameters: {E: 2.1e+11}, modes: 20}
  time_step: 5.0e-4
  duration: 0.3
  initial_std: {side: 0.1, E: 0.1}
  random_sets: 12
  repeats: 2
  sweeps: {time_steps: [1.0e-3], process_noise: [10]}
estimate:
  time: {channel: time}
  channels:
    - {channel: G1, gauge: G1, unit: m/m}
    - {channel: G2, gauge: G2, unit: m/m}
    - {channel: G3, gauge: G3, unit: m/m}
    - {channel: G4, gauge: G4, unit: m/m}
  inputs: {tip: {channel: tip, unit: N}}
  virtual: [{position: [1.0, 0.02, 0.095], direction: [1, 0, 0]}]
"""
BLIND = {
    "name: test\n": "name: blind\n",
    "  tip: {node: 2, direction: [0, 0, 1], known: true, signal: {type: sine, frequency: 20.0, amplitude: 1.0e+4}}\n": "",
    "[side, E]": "[side]",
    "{side: 0.1, E: 0.1}": "{side: 0.1}",
    "  random_sets: 12\n  repeats: 2\n  sweeps: {time_steps: [1.0e-3], process_noise: [10]}\n": "  repeats: 1\n",
    "  inputs: {tip: {channel: tip, unit: N}}\n": "",
}
"""The changes that leave the one unknown load."""
ALONE = {old: new for old, new in BLIND.items() if ", E" not in old} | {"name: test\n": "name: alone\n"}
"""Those that leave it with the modulus."""


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """A folder with test.yaml, its results up to validate, and measured.csv beside them."""
    folder = tmp_path_factory.mktemp("test")
    (folder / "test.yaml").write_text(CONFIG.replace("MESH", str(ROOT / "meshes" / "cantilever.bdf")))
    done = CliRunner().invoke(app, ["validate", str(folder / "test.yaml"), "--results", str(folder / "results")])
    assert done.exit_code == 0, done.output
    return folder


def changed(folder: Path, name: str, changes: dict[str, str]) -> Path:
    """Results of `validate` of the config with these changes."""
    text = CONFIG.replace("MESH", str(ROOT / "meshes" / "cantilever.bdf"))
    for old, new in changes.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    (folder / f"{name}.yaml").write_text(text)
    done = CliRunner().invoke(app, ["validate", str(folder / f"{name}.yaml"), "--results", str(folder / "results")])
    assert done.exit_code == 0, done.output
    return folder / "results" / name


def table(folder: Path) -> tuple[list[str], np.ndarray]:
    with (folder / "results" / "test" / "measured.csv").open(encoding="utf-8") as lines:
        rows = list(csv.reader(lines))
    return rows[0], np.array([[float(cell or "nan") for cell in row] for row in rows[1:]])


def write(path: Path, head: list[str], values: np.ndarray) -> Path:
    lines = [",".join(head), *(",".join("" if np.isnan(x) else f"{x:.12g}" for x in row) for row in values)]
    path.write_text("\n".join(lines) + "\n")
    return path


def estimated(folder: Path, file: Path, *settings: str, config: str = "test.yaml") -> tuple[int, str]:
    options = [f"--set={text}" for text in settings if not text.startswith("--")]
    flags = [text for text in settings if text.startswith("--")]
    done = CliRunner().invoke(
        app,
        [
            "estimate",
            str(folder / config),
            "--results",
            str(folder / "results"),
            "--measurements",
            str(file),
            *options,
            *flags,
        ],
    )
    assert "Traceback" not in done.output
    return done.exit_code, done.output + (done.stderr or "")


def result(folder: Path) -> Artefact:
    return Artefact(folder / "results" / "test" / "estimate.h5")


@pytest.fixture(scope="module")
def plain(project):
    """What the file as it was written gives: summary, arrays by name."""
    code, said = estimated(project, project / "results" / "test" / "measured.csv")
    assert code == 0, said
    found = result(project)
    return dict(found.summary), {
        name: found[name].copy() for name in ("/smoothed/side", "/smoothed/E", "/compared/estimate/E", "/virtual/strain")
    }


def test_estimate_finds_what_validate_found(project, plain):
    """The same channels, noise and filter: the same numbers, but for the known load, which is straight between samples."""
    validate = Artefact(project / "results" / "test" / "validate.h5")
    _, arrays = plain
    truth = validate["/truth/side"]
    error = np.linalg.norm(arrays["/smoothed/side"] - truth) / np.linalg.norm(truth)
    assert error == pytest.approx(validate.summary["smoothed.side"], rel=0.3)
    assert abs(arrays["/smoothed/E"][-1] / 2.1e11 - 1) < 3 * validate.summary["std.E"]
    assert plain[0]["consistent"]


def test_without_a_known_load_it_finds_what_validate_found_to_the_digits_of_the_file(project):
    """Nothing between samples is guessed then: the filter sees what that of validate saw."""
    results = changed(project, "blind", BLIND)
    code, said = estimated(project, results / "measured.csv", config="blind.yaml")
    assert code == 0, said
    validate, found = (Artefact(results / f"{stage}.h5") for stage in ("validate", "estimate"))
    for path in ("/estimate/side", "/std/side", "/smoothed/side"):
        np.testing.assert_allclose(found[path], validate[path], rtol=1e-6, atol=1e-6)


def test_a_virtual_gauge_reads_the_true_strain_where_none_is(project, plain):
    """Against the truth's own strain at the nearest candidates: straight over x on the flank of a beam."""
    train, validate = (Artefact(project / "results" / "test" / f"{s}.h5") for s in ("train", "validate"))
    position = train["/gauges/position"]
    near = np.flatnonzero((np.abs(position[:, 2] - 0.095) < 1e-9) & (np.abs(position[:, 0] - 1.0) < 0.06))
    instant = round(validate["/field/instant"] / 5e-4)
    # Linear in x and y there: the plane through the neighbours' true strains.
    plane = np.column_stack([np.ones(len(near)), position[near, 0] - 1.0, position[near, 1] - 0.02])
    expected = np.linalg.lstsq(plane, validate["/field/true"][near], rcond=None)[0][0]
    virtual = result(project)["/virtual/strain"][instant, 0]
    assert virtual == pytest.approx(expected, rel=0.02)


def test_columns_may_stand_in_any_order_and_units_in_any_way(project, plain, tmp_path):
    head, values = table(project)
    order = np.roll(np.arange(len(head)), 2)
    values = values.copy()
    column = {h.split(" ")[0]: i for i, h in enumerate(head)}
    values[:, column["G2"]] *= 1e6
    head = [h.replace("G2 [m/m]", "G2 [um/m]").replace("time [s]", "time [ms]") for h in head]
    values[:, column["time"]] *= 1e3
    file = write(tmp_path / "shuffled.csv", [head[i] for i in order], values[:, order])
    code, said = estimated(project, file, "estimate.channels.1.unit=um/m", "estimate.time.unit=ms")
    assert code == 0, said
    np.testing.assert_allclose(result(project)["/smoothed/side"], plain[1]["/smoothed/side"], rtol=1e-6, atol=1e-6)


def test_millivolts_become_strain_by_the_exact_bridge(project, plain, tmp_path):
    """A quarter bridge of one active arm R(1 + GF ε): output over excitation GF ε/(4 + 2 GF ε), here in mV/V."""
    head, values = table(project)
    at = [h.startswith("G3") for h in head].index(True)
    strain = values[:, at].copy()
    values[:, at] = 1e3 * 2.05 * strain / (4 + 2 * 2.05 * strain)
    head[at] = "G3 [mV/V]"
    file = write(tmp_path / "bridge.csv", head, values)
    change = (
        "estimate.channels.2={channel: G3, gauge: G3, unit: mV/V, bridge: {arrangement: quarter, gauge_factor: 2.05}}"
    )
    code, said = estimated(project, file, change)
    assert code == 0, said
    np.testing.assert_allclose(result(project)["/smoothed/side"], plain[1]["/smoothed/side"], rtol=1e-6, atol=1e-6)


def test_a_tenth_of_the_samples_may_be_missing(project, plain, tmp_path):
    head, values = table(project)
    rng = np.random.default_rng(1)
    gauges = [i for i, h in enumerate(head) if h.startswith("G")]
    for i in gauges:
        values[rng.random(len(values)) < 0.1, i] = np.nan
    code, said = estimated(project, write(tmp_path / "missing.csv", head, values))
    assert code == 0, said
    assert "samples are missing" in said
    found = result(project)["/smoothed/side"]
    assert np.linalg.norm(found - plain[1]["/smoothed/side"]) < 0.02 * np.linalg.norm(found)


def test_a_gauge_that_drops_out_for_good_is_survived(project, plain, tmp_path):
    head, values = table(project)
    at = [h.startswith("G4") for h in head].index(True)
    values[len(values) // 2 :, at] = np.nan
    code, said = estimated(project, write(tmp_path / "torn.csv", head, values))
    assert code == 0, said
    assert np.isfinite(result(project)["/smoothed/side"]).all()


def test_an_unknown_offset_is_found(project, plain, tmp_path):
    head, values = table(project)
    at = [h.startswith("G1") for h in head].index(True)
    offset = 20 * np.nanstd(np.diff(values[:, at]))
    values[:, at] += offset
    file = write(tmp_path / "offset.csv", head, values)
    code, said = estimated(
        project, file, f"estimate.channels.0={{channel: G1, gauge: G1, unit: m/m, bias: {2 * offset:.3e}}}"
    )
    assert code == 0, said
    found = result(project)
    assert found["/bias/mean"][0] == pytest.approx(offset, abs=4 * found["/bias/std"][0])
    assert found["/bias/std"][0] < 0.1 * offset
    assert np.linalg.norm(found["/smoothed/side"] - plain[1]["/smoothed/side"]) < 0.1 * np.linalg.norm(
        found["/smoothed/side"]
    )


def test_a_clock_that_jumps_back_is_refused_with_its_line(project, tmp_path):
    head, values = table(project)
    at = [h.startswith("time") for h in head].index(True)
    values[200:, at] -= 0.05
    code, said = estimated(project, write(tmp_path / "jump.csv", head, values))
    assert code == 2
    assert "jump.csv:202" in said


def test_a_record_too_long_for_the_memory_is_refused_before_it_is_filtered(project, plain, monkeypatch):
    """600 steps, with a covariance of the filter, one of the smoother and a Jacobian for each."""
    monkeypatch.setattr(memory, "available_memory", lambda: 1e5)
    code, said = estimated(project, project / "results" / "test" / "measured.csv", "--force")
    assert code == 2
    states, needed = re.search(
        r"600 steps of (\d+) states: (\S+) GiB of memory are needed, 9.31e-05 GiB", said
    ).groups()
    assert float(needed) == pytest.approx(3 * 8 * 600 * int(states) ** 2 / 2**30, rel=0.01)
    assert "give a part of the record at a time" in said


def test_whole_samples_that_are_missing_are_filled_and_reported(project, plain, tmp_path):
    head, values = table(project)
    gone = np.r_[0:100, 105 : len(values)]
    code, said = estimated(project, write(tmp_path / "gap.csv", head, values[gone]))
    assert code == 0, said
    assert "5" in said
    assert len(result(project)["/smoothed/side"]) == len(values)


@pytest.mark.parametrize(
    ("settings", "key", "says"),
    [
        (["estimate.channels.0.gauge=G9"], "estimate.channels.0.gauge", "G9"),
        (["estimate.channels.0.gauge=608"], "estimate.channels.0.gauge", "or a number: 0 to 607"),
        (["estimate.channels.0.grid=2"], "estimate.channels.0.grid", "grid 2"),
        (["estimate.channels.1.gauge=G1"], "estimate.channels", "one grid"),
        (["estimate.channels.0.channel=Gx"], "Gx", "no"),
        (["estimate.channels.0.unit=um/m"], "estimate.channels.0", "um/m"),
        (["estimate.channels.0.unit=mV/V"], "estimate.channels.0", "bridge"),
        (["estimate.inputs={}"], "estimate.inputs", "tip"),
        (["estimate.time_step=3.0e-4"], "estimate.time_step", "sampling interval"),
        (["estimate.channels=[{channel: G1, gauge: G1, unit: m/m}]"], "estimate.channels", "cannot tell"),
        (["estimate.virtual=[{position: [1, 1, 1], direction: [1, 0, 0]}]"], "estimate.virtual.0", "surface"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_key(project, settings, key, says):
    code, said = estimated(project, project / "results" / "test" / "measured.csv", *settings)
    assert code == 2, said
    assert key in said
    assert says in said


def test_an_unobservable_case_is_estimated_on_request_and_reported(project):
    file = project / "results" / "test" / "measured.csv"
    one = "estimate.channels=[{channel: G1, gauge: G1, unit: m/m}]"
    code, said = estimated(project, file, one, "--allow-unobservable")
    assert code == 0, said
    assert "cannot tell" in said


def test_a_modulus_beside_unknown_loads_alone_has_no_sigma_but_for_loads_that_are_as_stated(project):
    """Everything that rests on them is NaN, and the estimates are those that have it otherwise."""
    sigmas = "/std/E", "/std/side", "/smoothed_std/E", "/smoothed_std/side", "/virtual/std"
    estimates = "/estimate/E", "/smoothed/side", "/virtual/strain"
    results, found = changed(project, "alone", ALONE), {}
    for stated in ("false", "true"):
        settings = f"estimate.loads_as_stated={stated}", "estimate.field={every: 0.1}", "filter.compare=true"
        code, said = estimated(project, results / "measured.csv", *settings, config="alone.yaml")
        assert code == 0, said
        own = Artefact(results / "estimate.h5")
        found[stated] = {path: own[path].copy() for path in own.paths()}, dict(own.summary), said
    (withheld, numbers, words), (given, all_numbers, other) = found["false"], found["true"]
    assert "σ is withheld: no load is known: E rests on what process_noise states of side" in " ".join(words.split())
    assert "other filters are not compared where σ is withheld" in " ".join(words.split())
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


def test_a_finer_step_of_the_filter_changes_little(project, plain):
    file = project / "results" / "test" / "measured.csv"
    code, said = estimated(project, file, "estimate.time_step=2.5e-4")
    assert code == 0, said
    found = result(project)
    assert len(found["/time"]) == 2 * (len(plain[1]["/smoothed/side"]) - 1) + 1
    error = np.linalg.norm(found["/smoothed/side"][::2] - plain[1]["/smoothed/side"])
    assert error < 0.02 * np.linalg.norm(plain[1]["/smoothed/side"])


def test_validate_ranks_the_layout_and_sweeps_the_filter(project):
    validate = Artefact(project / "results" / "test" / "validate.h5")
    assert 1 <= validate.summary["rank_claimed.side"] <= 13
    assert -1 <= validate.summary["rank_correlation.side"] <= 1
    assert validate["/sweep/key"].tolist() == ["time_step", "process_noise"]
    # More process noise: more noise in the estimate, and said so.
    assert validate["/sweep/std/side"][1] > 1.5 * validate.summary["std.side"]


def test_every_dataset_of_estimate_is_listed(project, plain):
    listed = rows("estimate")
    found = result(project)
    assert "/compared/ratio/E" in found
    for path in found.paths():
        if path.startswith("/VTKHDF"):
            continue
        matching = [(rank, unit) for pattern, rank, unit in listed if re.fullmatch(pattern, path)]
        assert len(matching) == 1, path
        assert found[path].ndim == matching[0][0], path
        assert found.attributes(path)["units"] in UNITS_OF.get(matching[0][1], (matching[0][1],)), path


def test_the_field_of_the_surface_plays_in_time(project, plain):
    """On the flank of a bent beam the axial strain is that of the virtual gauge there, and the stress E times it."""
    file = project / "results" / "test" / "measured.csv"
    code, said = estimated(project, file, "estimate.field={every: 0.05}")
    assert code == 0, said
    found = result(project)
    reader = vtkHDFReader()
    reader.SetFileName(str(found.path))
    reader.UpdateInformation()
    assert reader.GetNumberOfSteps() == 7
    reader.SetStep(3)
    reader.Update()
    grid = pyvista.wrap(reader.GetOutput())
    centre = grid.cell_centers().points
    near = np.flatnonzero((np.abs(centre[:, 2] - 0.095) < 1e-9) & (np.abs(centre[:, 0] - 1.0) < 0.06))
    plane = np.column_stack([np.ones(len(near)), centre[near, 0] - 1.0, centre[near, 1] - 0.02])
    axial = np.linalg.lstsq(plane, grid.cell_data["strain"][near, 0], rcond=None)[0][0]
    assert axial == pytest.approx(found["/virtual/strain"][300, 0], rel=0.02)
    E = found["/smoothed/E"][300]
    stress = grid.cell_data["stress"][near, 0]
    np.testing.assert_allclose(stress, E * grid.cell_data["strain"][near, 0], rtol=0.05)
    assert np.all(grid.cell_data["von_mises_std"] > 0)


@pytest.mark.slow
def test_the_whole_model_in_time_may_be_the_truth(project, tmp_path):
    """Sixty modes with static terms and all degrees of freedom agree, so do the estimates from them."""
    settings = ["validate.truth.model=full", "validate.duration=0.1", "validate.random_sets=0", "validate.sweeps={}"]
    options = [f"--set={text}" for text in settings]
    done = CliRunner().invoke(
        app, ["validate", str(project / "test.yaml"), "--results", str(tmp_path / "results"), *options]
    )
    assert done.exit_code == 0, done.output
    full = Artefact(tmp_path / "results" / "test" / "validate.h5")
    modes = Artefact(project / "results" / "test" / "validate.h5")
    ours, theirs = full["/gauge/true"], modes["/gauge/true"][: len(full["/gauge/true"])]
    assert np.abs(ours - theirs).max() < 2e-3 * np.abs(theirs).max()


def test_a_biased_time_step_says_what_it_does(project, plain):
    """The trapezoidal rule lengthens the period by (ωh)²/12: E comes out about twice that too large, and the notes say so."""
    file = project / "results" / "test" / "measured.csv"
    code, said = estimated(project, file, "filter.scheme=trapezoidal")
    assert code == 0, said
    lam = (2 * np.pi * Artefact(project / "results" / "test" / "rom.h5")["/frequency"][0]) ** 2
    longer = 100 * lam * 5e-4**2 / 12
    stated = float(re.search(r"first mode by ([\d.e+-]+) %", said.replace("\n", " ")).group(1))
    assert stated == pytest.approx(longer, rel=0.1)
    # by the bank without tolerances: with them the damping is open, and E is what the gauges read rather than the period
    assert result(project)["/compared/estimate/E"][0] > plain[1]["/compared/estimate/E"][0]


def test_the_square_root_form_gives_the_same_estimate(project, plain):
    code, said = estimated(project, project / "results" / "test" / "measured.csv", "filter.form=square_root")
    assert code == 0, said
    np.testing.assert_allclose(result(project)["/smoothed/side"], plain[1]["/smoothed/side"], rtol=1e-6, atol=1e-4)
