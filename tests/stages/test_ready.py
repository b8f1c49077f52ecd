"""Ready matrices through the whole pipeline, and modes of another program as such matrices."""

from __future__ import annotations

import csv
import re

import numpy as np
import pytest
from scipy import sparse
from scipy.io import mmwrite
from scipy.sparse.linalg import eigsh, splu
from typer.testing import CliRunner

from strainsight import api
from strainsight.decks.reader import read_mesh
from strainsight.errors import StrainsightError
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.records.record import read
from strainsight.records.training import Training
from strainsight.runner.artefact import Artefact
from strainsight.sensors.strain_operator import channel_matrix
from strainsight_cli.main import app

from ..foreign.test_ready import AREA, HEIGHT, IY, LENGTH, RHO, E, beam_matrices, closed_form
from ..shared import PLACED_EXACTLY, stages_of, strains
from .conftest import ROOT, SHORT, UNSTUDIED, finished, job_of, made


def changed(text, *changes):
    for old, new in changes:
        text, count = re.subn(old, new, text, flags=re.MULTILINE)
        assert count == 1, old
    return text


def numbering(path, node, component):
    lines = [f"{n},{c + 1}" for n, c in zip(node.tolist(), component.tolist(), strict=True)]
    path.write_text("\n".join(["node,component", *lines]) + "\n")


ELEMENTS = 10
BEAM = """\
kind: placement
name: beam
seed: 1
mesh:
  file: beam.bdf
  length_unit: mm
  mass_unit: t
  matrices:
    numbering: rows.csv
    stiffness: [{file: k.npz, parameter: E, at: 2.1e+11}]
    mass: [{file: m.npz}]
parameters: {E: {property: youngs_modulus, guess: 1.9e+11, range: [1.6e+11, 2.4e+11]}}
loads: {tip: {node: 11, direction: [0, 0, 1], known: true, signal: {type: sine, frequency: 3.0, amplitude: 100.0}}}
damping: {type: modal, ratio: 0.01}
rom: {modes: 4, parameter_samples: 2, tolerance: 1.0e-8}
train: {duration: 0.4, time_step: 1.0e-3}
gauges:
  strain_operator: {rows: strain.mtx, table: gauges.csv}
  noise_std: {relative_to_strongest: 0.01}
  exclude: [{box: [[-0.01, -1, -1], [0.15, 1, 1]]}]
screen: {keep: 6, minimum_spacing: 0.05}
place: {estimate: [E], keep: 3, instants: 2, certificate: false}
validate:
  truth: {model: perturbed, modes: 4, parameters: {E: 2.1e+11}}
  time_step: 1.0e-3
  duration: 0.4
  initial_std: {E: 0.1}
  random_sets: 0
  noise_factors: [0.1]
  repeats: 1
report: {format: html}
"""


@pytest.fixture
def beam(tmp_path):
    """A cantilever of two-node elements in mm and t with a gauge at the middle of every element's upper and lower fibre."""
    n, h = ELEMENTS + 1, 1e3 * LENGTH / ELEMENTS
    K, M = beam_matrices(ELEMENTS, 1e3 * LENGTH, E * 1e-6, RHO * 1e-12, AREA * 1e6, IY * 1e12, IY * 1e12)
    sparse.save_npz(tmp_path / "k.npz", K)
    sparse.save_npz(tmp_path / "m.npz", M)
    numbering(tmp_path / "rows.csv", np.repeat(np.arange(1, n + 1), 6), np.tile(np.arange(6), n))
    grids = "".join(f"GRID,{i + 1},,{h * i:.1f},0.,0.\n" for i in range(n))
    (tmp_path / "beam.bdf").write_text(f"BEGIN BULK\n{grids}SPC1,1,123456,1\nENDDATA\n")
    # ε = −z w″, and at the middle of an element w″ = (w′₂ − w′₁)/h with w′ = −θ_y
    R, lines = np.zeros((2 * ELEMENTS, 6 * n)), ["gauge,x,y,z,dx,dy,dz"]
    for e in range(ELEMENTS):
        for side in (1, -1):
            z = side * 0.5e3 * HEIGHT
            g = 2 * e + (side < 0)
            R[g, 6 * e + 10], R[g, 6 * e + 4] = z / h, -z / h
            lines.append(f"{101 + g},{h * (e + 0.5)},0,{z}," + (",," if g == 2 else "1,0,0"))
    mmwrite(tmp_path / "strain.mtx", sparse.coo_array(R))
    (tmp_path / "gauges.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "beam.yaml").write_text(BEAM)
    return tmp_path


def test_a_beam_of_ready_matrices_has_its_closed_form_and_finds_its_modulus(beam):
    case = api.load(beam / "beam.yaml", UNSTUDIED)
    mesh = api.mesh(case)
    reduced = api.reduce(case, mesh)
    training = api.train(case, mesh, reduced)
    run = case, mesh, reduced, training, api.screen(case, mesh, reduced, training)
    found = api.validate(*run, api.place(*run).gauges)
    # both planes are alike, so the frequencies come in pairs; at the guess
    expected = np.repeat(closed_form(IY)[:2], 2) * np.sqrt(1.9e11 / 2.1e11)
    assert np.allclose(reduced.frequency, expected, rtol=1e-4)
    # 20 gauges but the two of the excluded root element
    pool, model = training.candidates, reduced.model
    assert pool.element.tolist() == list(range(103, 121))
    assert np.allclose(pool.position[0], [0.3, 0, HEIGHT / 2])
    # a constant force F: ε = −z F (L − x)/(E I), which these elements have exactly in their middle
    x, z = pool.position[:, 0], pool.position[:, 2]
    q = np.linalg.solve(model.stiffness.at(model.reference), model.input_shape[:, 0])
    assert np.allclose(training.rows @ q, -z * (LENGTH - x) / (1.9e11 * IY), rtol=1e-8)
    assert pool.direction[:2].tolist() == [[0, 0, 0], [1, 0, 0]]  # the first is left blank in the table
    assert found.accuracy["E"].error < 0.05
    assert "cannot be moved" in found.trial.truth.description


@pytest.mark.slow
def test_a_given_gauge_is_called_by_its_number_in_the_table(beam):
    """In layout, measured.csv, channels and records; 101 and 102 are excluded, so that no number is a place in train.h5."""
    config, folder = beam / "beam.yaml", beam / "results" / "beam"

    def run(command, *more):
        done = CliRunner().invoke(app, [command, str(config), "--results", str(beam / "results"), *more])
        return done.exit_code, " ".join((done.output + (done.stderr or "")).split())

    code, said = run("validate", *(f"--set={own}" for own in UNSTUDIED))
    assert code == 0, said
    with (folder / "gauges.csv").open(encoding="utf-8") as lines:
        gauges = [row["gauge"] for row in csv.DictReader(lines)]
    assert {int(gauge) for gauge in gauges} <= set(range(103, 121))
    channels = ", ".join(f'{{channel: "{gauge}", gauge: {gauge}, unit: m/m}}' for gauge in gauges)
    inputs = "inputs: {tip: {channel: tip, unit: N}}"
    config.write_text(BEAM + f"estimate: {{time: {{channel: time}}, {inputs}, channels: [{channels}]}}")
    code, said = run("estimate", "--no-page", "--measurements", str(folder / "measured.csv"))
    assert code == 0, said
    found = Artefact(folder / "estimate.h5")
    assert found["/gauge/label"].tolist() == gauges
    measured = Artefact(folder / "train.h5")["/gauges/element"][found["/gauge/channel"]]
    assert [str(number) for number in measured] == gauges
    for gauge in (0, 102, "G1"):
        code, said = run("estimate", f"--set=estimate.channels.0.gauge={gauge}", "--set=estimate.file=results/beam/measured.csv")
        assert code == 2
        assert f"unknown gauge '{gauge}'" in said


def shrunk(folder):
    sparse.save_npz(folder / "m.npz", sparse.load_npz(folder / "m.npz")[:-6, :-6])


def triangle(folder):
    sparse.save_npz(folder / "k.npz", sparse.tril(sparse.load_npz(folder / "k.npz"), format="csr"))


def edited(name, old, new):
    def edit(folder):
        (folder / name).write_text(changed((folder / name).read_text(), (re.escape(old), new)))

    return edit


@pytest.mark.parametrize(
    ("spoil", "key", "says"),
    [
        (shrunk, "mesh.matrices.mass.0.file", "60 rows and 60 columns, but rows.csv has 66 degrees of freedom"),
        (triangle, "mesh.matrices.stiffness.0.file", "only the lower triangle"),
        (edited("rows.csv", "\n11,1\n", "\n10,1\n"), "mesh.matrices.numbering", "rows.csv:62"),
        (edited("beam.yaml", "at: 2.1e+11", "at: 2.1e+5"), "mesh.matrices.stiffness.0.at", "computed with 2.1e+05"),
        (edited("beam.bdf", "SPC1,1,123456,1\n", ""), "mesh.matrices", "can move freely (translation x"),
        (edited("beam.yaml", "rows: strain.mtx", "rows: k.npz"), "gauges.strain_operator", "66 rows, but gauges.csv has 20"),
    ],
)
def test_matrices_that_do_not_fit_are_a_message_with_key_and_file(beam, spoil, key, says):
    spoil(beam)
    job = job_of(beam / "beam.yaml", beam / "results")
    with pytest.raises(StrainsightError) as caught:
        finished(job, stages_of(job, "train"))
    assert key in str(caught.value)
    assert says in str(caught.value)


MODES = 30
LOADED_EXACTLY = ("tolerances.load_angle=0", "tolerances.load_position=0")
"""For comparisons with models whose loads act on coordinates, which have neither direction nor place."""
MESH = """mesh:
  file: reduced.bdf
  matrices: {numbering: rows.csv, stiffness: [{file: k.npz, parameter: E, at: 2.1e+11}], mass: [{file: m.npz}]}
"""


def write_reduced():
    """The function that the manual prints."""
    page = (ROOT / "docs" / "scaling.md").read_text(encoding="utf-8")
    (code,) = (block for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "def write_reduced" in block)
    found: dict = {}
    exec(compile(code, "docs/scaling.md", "exec"), found)
    return found["write_reduced"]


@pytest.mark.slow
def test_modes_of_another_program_give_the_layout_of_the_whole_model(config, tmp_path, monkeypatch):
    artefacts = made(config, *SHORT, *PLACED_EXACTLY, *LOADED_EXACTLY, until="place")
    mesh = read_mesh(ROOT / "meshes" / "cantilever.bdf")
    model = build_model(mesh)
    K, M = (X.at({}).tocsc() for X in (model.stiffness, model.mass))
    S = input_shape(model, (PointLoad("tip", (0.0, 0.0, 1.0), 2, None, None),))
    lam, Phi = eigsh(K, MODES, M=M, sigma=0.0)
    X = splu(K).solve(S)
    pool = read(Training, artefacts["train"]).candidates
    strain = channel_matrix(mesh.position, pool) @ nodal(model, np.hstack([Phi, X]))
    monkeypatch.chdir(tmp_path)
    place = np.hstack([pool.position, pool.direction])
    write_reduced()(np.sqrt(lam), Phi, S, X, M @ X, strain, place)
    text = changed(
        config.read_text(),
        (r"^mesh: .*\n", MESH),
        (r"region: 1, ", ""),
        (r"node: 2, direction: \[0, 0, 1\]", "node: 1, direction: [1, 0, 0]"),
        (r"^  surface: all\n", "  strain_operator: {rows: strain.npz, table: gauges.csv}\n"),
        (r"^  direction: .*\n", ""),
    )
    (tmp_path / "own.yaml").write_text(text)
    job = job_of(tmp_path / "own.yaml", tmp_path / "results", *SHORT, *PLACED_EXACTLY, *LOADED_EXACTLY)
    stages = [stage for stage in stages_of(job, "place") if stage.name != "observe"]
    found = {stage: artefact for stage, (_, _, artefact) in finished(job, stages).items()}
    assert found["rom"].summary["unknowns"] == MODES + 1
    assert np.allclose(found["rom"]["/frequency"], artefacts["rom"]["/frequency"], rtol=1e-9)
    theirs = strains(artefacts["train"])
    assert np.allclose(strains(found["train"]), theirs, rtol=1e-6, atol=1e-6 * np.abs(theirs).max())
    chosen = found["place"]["/selected/final/element"] - 1
    for key in ("element", "facet"):
        assert sorted(getattr(pool, key)[chosen]) == sorted(artefacts["place"][f"/selected/final/{key}"]), key
    for key in ("trace_final", "lower_bound", "std.E"):
        assert found["place"].summary[key] == pytest.approx(artefacts["place"].summary[key], rel=1e-6), key
    job = job_of(tmp_path / "own.yaml", tmp_path / "results", *SHORT, *PLACED_EXACTLY)
    advised = " ".join(finished(job, stages)["place"][2]["/advice"].tolist())
    for key in ("load_angle", "load_position"):
        assert f"tolerances.{key} has no effect on σ for tip: this error does not change the response of the model" in advised
