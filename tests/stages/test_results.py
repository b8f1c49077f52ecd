"""Placement from modes and static responses of another program, or over MPI: the same layout and σ as from the deck."""

from __future__ import annotations

import shutil
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.config.load import load_config
from strainsight.decks.reader import read_mesh
from strainsight.errors import StrainsightError
from strainsight.experiment.structure.results import model_of_results
from strainsight.foreign.results.reader import READERS, frd_responses
from strainsight.records.placed import Placed
from strainsight.records.record import read
from strainsight.records.reduced import Reduced

from ..frd import calculix, solved, write_frd
from ..mpi import needs_slepc, over
from ..shared import stages_of
from .conftest import ROOT, SHORT, UNSTUDIED, finished, job_of
from .tested_beam import changed, estimated, result

pytestmark = pytest.mark.usefixtures("no_hot_spots")

DECK = ROOT / "meshes" / "cantilever-coarse.bdf"
TIP, MODES = 2, 12
FORCES = [[(TIP, (0.0, 0.0, 1.0))]]
EXACT = ("tolerances.load_angle=0", "tolerances.load_position=0")
"""Of a load that acts beside its place, results have what their own coordinates hold, and a deck all."""
FEW = (*SHORT, *UNSTUDIED, *EXACT, "screen.keep=20", "place.certificate=false")
OF_RESULTS = "mesh.results={file: found.frd, loads: {tip: {step: 1}}}"


@pytest.fixture(scope="module")
def mesh():
    return read_mesh(DECK)


@pytest.fixture(scope="module")
def response(mesh):
    """Modes and the response of the tip that SciPy found, in double precision."""
    return solved(mesh, FORCES, MODES)


def project_in(folder, config, deck):
    (folder / "beam.yaml").write_text(config.read_text().replace("../meshes/cantilever.bdf", "beam.bdf"))
    (folder / "beam.bdf").write_text(deck)
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory, config, mesh, response):
    """A config beside its deck and its results."""
    place = project_in(tmp_path_factory.mktemp("beam"), config, DECK.read_text())
    write_frd(place / "found.frd", mesh, response, form=3)
    return place


def placed(folder, name, *overrides, until="place", results="results"):
    """stage → artefact of a run; nothing is taken over from one in another results folder."""
    job = job_of(folder / "beam.yaml", folder / results, *FEW, *overrides, f"name={name}")
    return {stage: own[2] for stage, own in finished(job, stages_of(job, until)).items()}


@pytest.fixture(scope="module")
def of_deck(folder):
    return placed(folder, "deck")


def test_the_damping_is_free_of_results_too(folder, of_deck):
    """It is no property of the deck, and multiplies what the config has."""
    free = "parameters.zeta={property: damping_factor, guess: 1.5, range: [0.5, 2.0]}"
    damped = placed(folder, "damped", OF_RESULTS, free, until="rom")
    own, known = (read(Reduced, found["rom"]).model for found in (damped, of_deck))
    assert own.parameters == ("E", "zeta")
    c, of_config = (model.damping.at(model.reference).viscous(np.ones(1))[0] for model in (own, known))
    assert c == pytest.approx(1.5 * of_config)


def same(a, b, digits):
    """The same places of gauges, and σ to these digits: of E by the criterion over its guess, and expected along the run."""
    one, other = (read(Placed, own["place"]) for own in (a, b))
    for part in ("element", "facet", "nodes"):
        assert np.array_equal(getattr(other.final, part), getattr(one.final, part))
    assert b["place"].summary["std.E"] == pytest.approx(a["place"].summary["std.E"], rel=digits)
    assert other.expected_std["E"] == pytest.approx(one.expected_std["E"], rel=digits)


def test_the_layout_and_sigma_of_the_deck(folder, of_deck):
    """From results in double precision, which SciPy made; measured: 3e-11."""
    own = placed(folder, "results", OF_RESULTS)
    same(of_deck, own, 1e-6)
    reduced, whole = read(Reduced, own["rom"]), read(Reduced, of_deck["rom"])
    assert reduced.results.modes == MODES
    assert whole.results is None
    assert reduced.model.size == whole.model.size
    assert np.allclose(reduced.frequency, whole.frequency, rtol=1e-8)


@pytest.mark.slow
def test_six_digits_and_no_deck(folder, mesh, response, of_deck):
    """A text file of results alone: nodes, solids and motions with six digits, no ties, supports, materials or densities, the
    load on a node that leads the end. Its residual is quasi-static, E of the results is stated, and the held face is named for
    gauges to keep off it."""
    path = folder / "text.frd"
    write_frd(path, mesh, response)
    own = placed(
        folder,
        "text",
        "mesh.file=text.frd",
        "mesh.faces={end: {near: [2.0, 0.0, 0.0]}, root: {near: [0.0, 0.0, 0.0]}}",
        "mesh.supports=[{set: root}]",
        "mesh.ties=[{type: rigid, reference: 2, set: end}]",
        "mesh.results={file: text.frd, loads: {tip: {step: 1}}, at: {E: 2.1e+11}}",
    )
    same(of_deck, own, 1e-5)
    notes = read(Reduced, own["rom"]).results.notes
    assert any("These follow the loads" in text for text in notes)


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("ccx"), reason="CalculiX is not installed")
@pytest.mark.parametrize(("output", "digits"), [("NODE OUTPUT", 1e-6), ("NODE FILE", 1e-5)])
def test_the_file_that_calculix_writes(folder, mesh, of_deck, output, digits, tmp_path):
    """Its text has six digits, its binary files single precision; measured: 2e-6 and 2e-8."""
    shutil.copy(calculix(tmp_path, mesh, FORCES, MODES, output), folder / "calculix.frd")
    own = placed(folder, "calculix", OF_RESULTS.replace("found", "calculix"))
    same(of_deck, own, digits)


@pytest.mark.slow
def test_a_truth_has_as_many_modes_as_there_are(folder):
    """`perturbed` asks for 20 modes, the file has 12, and the truth says so."""
    own = placed(folder, "validated", OF_RESULTS, until="validate")
    assert own["spectrum"].summary["modes"] == MODES
    assert "12 modes of the imported results (12 of 20 modes available)" in own["validate"].summary["description"]


@pytest.mark.parametrize(
    ("overrides", "key", "said"),
    [
        (("mesh.results={file: found.frd, loads: {top: {step: 1}}}",), "mesh.results.loads.top", "no load"),
        (("mesh.results={file: found.frd, modes: {step: 7}}",), "mesh.results.modes", "no modes of step 7 in the file"),
        ((OF_RESULTS.replace("step: 1", "step: 1, magnitude: 0.9"),), "mesh.results.loads.tip", "mode 1 with the amplitude"),
        (("mesh.results={file: found.frd, modal_mass: mesh, at: {E: 2.0e+12}}",), "parameters.E.guess", "the results"),
        ((OF_RESULTS, "rom.modes=15"), "rom.modes", "allow only 12\n *Request 1 to 12 modes"),
        ((OF_RESULTS, "mesh.free=true"), "mesh.free", "stiffness, mass and supports"),
        # springs of the deck do not change with E, and one set of results does not say what they add
        ((OF_RESULTS, "mesh.file=sprung.bdf"), "parameters.E", "does not scale the springs of the deck"),
        ((OF_RESULTS, "mesh.file=parts.bdf", "parameters.E.region=1"), "parameters.E", "E does not scale all regions"),
    ],
)
def test_what_the_results_lack_or_disagree_with(folder, overrides, key, said):
    text = (folder / "beam.bdf").read_text()
    (folder / "sprung.bdf").write_text(text.replace("ENDDATA", "CELAS2,77,1.+5,101,2,702,2\nENDDATA"))
    (folder / "parts.bdf").write_text(in_two(text))
    with pytest.raises(StrainsightError, match=said) as caught:
        placed(folder, "wrong", *overrides, until="rom")
    assert key in str(caught.value)
    assert caught.value.remedy


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (lambda mesh: replace(mesh, node_ids=mesh.node_ids[::-1].copy()), "do not have the same position in mesh and results"),
        (lambda mesh: replace(mesh, position=1e3 * mesh.position), "mesh.length_unit applies to both files"),
    ],
    ids=["numbered otherwise", "in millimetres"],
)
def test_results_of_another_mesh(folder, mesh, response, other, said):
    write_frd(folder / "other.frd", other(mesh), response, form=3)
    with pytest.raises(StrainsightError, match=said) as caught:
        model_of(folder, mesh, "other.frd")
    assert "other.frd" in str(caught.value)
    assert caught.value.remedy


def model_of(folder, mesh, file, *overrides):
    config = load_config(folder / "beam.yaml", overrides or (OF_RESULTS,)).model
    return model_of_results(config.mesh, mesh, (), {"mesh.results.file": folder / file}, config.loads).model


def test_six_digits_far_from_the_origin_are_of_the_same_mesh(folder, mesh, response):
    """At 10 km a text has metres to 0.05, which is 0.025 of the beam."""
    far = replace(mesh, position=mesh.position + np.array([1e4, 0.0, 0.0]))
    write_frd(folder / "far.frd", far, response, form=1)
    model_of(folder, far, "far.frd")


def test_motion_along_the_axes_of_a_node(folder, mesh, monkeypatch):
    """A reader that gives it along CD, as Nastran writes it: on the basic axes it is the same model."""
    turned = {k: Rotation.from_rotvec([0.1 * k, 0.7, -0.3 * k]).as_matrix() for k in range(0, len(mesh.node_ids), 7)}

    def along_axes(path):
        for own in frd_responses(folder / "found.frd"):
            motion = own.motion.copy()
            for node, axes in turned.items():
                motion[node] = axes.T @ motion[node]
            yield replace(own, motion=motion, along_node_axes=True)

    monkeypatch.setitem(READERS, ".axes", along_axes)
    plain = model_of(folder, mesh, "found.frd")
    own = model_of(folder, replace(mesh, axes=turned), "found.axes")
    difference = abs(own.constraint.transform - plain.constraint.transform).max()
    assert difference < 1e-12 * abs(plain.constraint.transform).max()
    assert np.allclose(own.mass.at({}).toarray(), plain.mass.at({}).toarray(), rtol=1e-12)


def test_units_of_the_mesh_and_size_of_the_load(folder, mesh, response):
    """In mm and t a mode of unit mass is √1000 times as large a number, and the motion under 250 N 250 000 times."""
    in_mm = replace(response, shapes=np.sqrt(1000.0) * response.shapes, static=250.0 * 1000.0 * response.static)
    write_frd(folder / "mm.frd", replace(mesh, position=1000.0 * mesh.position), in_mm, form=3)
    results = OF_RESULTS.replace("step: 1", "magnitude: 250.0")
    a = model_of(folder, mesh, "found.frd")
    b = model_of(folder, mesh, "mm.frd", results, "mesh.length_unit=mm", "mesh.mass_unit=t")
    assert np.allclose(b.constraint.transform.toarray(), a.constraint.transform.toarray(), rtol=1e-9, atol=1e-14)
    assert np.allclose(b.stiffness.at({}).toarray(), a.stiffness.at({}).toarray(), rtol=1e-9)


@pytest.mark.slow
def test_a_load_and_a_modulus_from_a_record(tmp_path, mesh):
    """One record, estimated with the deck and with results in double precision, to the page of the test; measured: force and its
    σ 7e-8, E 1e-9, its σ 2e-8, strain where no gauge is 1e-8."""
    names = ("/smoothed/side", "/smoothed_std/side", "/smoothed/E", "/smoothed_std/E", "/virtual/strain")
    write_frd(tmp_path / "found.frd", mesh, solved(mesh, [*FORCES, [(TIP, (0.0, 1.0, 0.0))]], 24), form=3)
    loads = "{tip: {step: 1}, side: {step: 2}}"
    estimates = []
    for section in (f"file: {DECK}", f"file: {DECK}, results: {{file: found.frd, loads: {loads}}}"):
        changed(tmp_path, "test", {"file: MESH": section}, alone=True)
        record = tmp_path / "record.csv"
        if not record.exists():
            shutil.copy(tmp_path / "results" / "test" / "measured.csv", record)
        code, said = estimated(tmp_path, record, "--page")
        assert code == 0, said
        found = result(tmp_path)
        estimates.append({name: found[name].copy() for name in names})
    whole, own = estimates
    for name in names:
        off = np.abs(own[name] - whole[name]).max() / np.abs(whole[name]).max()
        assert off < 1e-6, name
    assert (tmp_path / "results" / "test" / "test.html").is_file()


@needs_slepc
@pytest.mark.slow
@pytest.mark.parametrize("processes", [1, 2, 4])
def test_over_mpi_frequencies_and_gauges_are_those_of_pardiso(folder, of_deck, monkeypatch, processes):
    for name, value in over(processes).items():
        monkeypatch.setenv(name, value)
    own = placed(folder, f"slepc-{processes}", "solver=slepc", results=f"slepc-{processes}")
    same(of_deck, own, 1e-6)
    reduced, known = read(Reduced, own["rom"]), read(Reduced, of_deck["rom"])
    assert np.allclose(reduced.frequency, known.frequency, rtol=1e-9, atol=0)
    assert np.allclose(reduced.static, known.static, rtol=0, atol=1e-9 * np.abs(known.static).max())


FIRST, SECOND = 1.8e11, 2.4e11
PARTS = "parameters.E.region=1"
RESULTS = (
    "mesh.results={file: first.frd, loads: {tip: {step: 1}}, at: {E: 1.8e+11}, "
    "second: {parameter: E, at: 2.4e+11, file: second.frd}}"
)


def in_two(text: str) -> str:
    """The half at the root keeps material 1, the other has material 2, of 90 % of the modulus."""
    lines = text.splitlines(keepends=True)
    hexahedra = [i for i, line in enumerate(lines) if line.startswith("CHEXA")]
    for i in hexahedra[len(hexahedra) // 2 :]:
        lines[i] = f"{lines[i][:16]}{2:8d}{lines[i][24:]}"
    at = next(i for i, line in enumerate(lines) if line.startswith("PSOLID"))
    lines.insert(at, "MAT1           2 1.89E11             0.3   7850.\nPSOLID         2       2\n")
    return "".join(lines)


@pytest.fixture(scope="module")
def folder_in_parts(tmp_path_factory, config):
    place = project_in(tmp_path_factory.mktemp("parts"), config, in_two(DECK.read_text()))
    mesh = read_mesh(place / "beam.bdf")
    for name, value in (("first", FIRST), ("second", SECOND)):
        root = replace(mesh.materials[1], youngs_modulus=value)
        softer = replace(mesh, materials={**mesh.materials, 1: root})
        write_frd(place / f"{name}.frd", mesh, solved(softer, FORCES, MODES), form=3)
    return place


@pytest.mark.slow
def test_second_results_give_the_layout_and_sigma_of_the_deck(folder_in_parts):
    """At a guess that neither set has, for E of the root alone; measured: frequencies to 2e-7, σ to 3e-5."""
    whole = placed(folder_in_parts, "deck", PARTS)
    own = placed(folder_in_parts, "results", PARTS, RESULTS)
    same(whole, own, 1e-4)
    assert np.allclose(own["rom"]["/frequency"], whole["rom"]["/frequency"], rtol=1e-5)
