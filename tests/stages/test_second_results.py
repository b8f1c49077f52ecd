"""The modulus of a part from two sets of results: layout and σ as from the deck, and second sets of something else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.errors import StrainsightError
from strainsight.records.record import read
from strainsight.records.reduced import Reduced

from ..frd import solved, write_frd
from ..shared import stages_of
from .conftest import ROOT, finished, job_of
from .test_results import FEW, FORCES, MODES, layout_of

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
def folder(tmp_path_factory, config):
    place = tmp_path_factory.mktemp("parts")
    (place / "beam.yaml").write_text(config.read_text().replace("../meshes/cantilever.bdf", "beam.bdf"))
    (place / "beam.bdf").write_text(in_two((ROOT / "meshes" / "cantilever-coarse.bdf").read_text()))
    mesh = read_mesh(place / "beam.bdf")
    for name, value in (("first", FIRST), ("second", SECOND)):
        write_frd(place / f"{name}.frd", mesh, solved(of(mesh, value), FORCES, MODES), form=3)
    return place


def of(mesh, value):
    """With this modulus of the half at the root."""
    return replace(mesh, materials={**mesh.materials, 1: replace(mesh.materials[1], youngs_modulus=value)})


def placed(folder, name, *overrides, until="place"):
    job = job_of(folder / "beam.yaml", folder / "results", *FEW, PARTS, *overrides, f"name={name}")
    return {stage: own[2] for stage, own in finished(job, stages_of(job, until)).items()}


@pytest.mark.slow
def test_the_layout_and_sigma_of_the_deck(folder):
    """At a guess that neither set has, for E of the root alone; measured: frequencies to 2e-7, σ to 3e-5."""
    whole, own = placed(folder, "deck"), placed(folder, "results", RESULTS)
    (where, std, expected), (where_own, std_own, expected_own) = layout_of(whole), layout_of(own)
    assert np.array_equal(where, where_own)
    assert std_own == pytest.approx(std, rel=1e-4)
    assert expected_own == pytest.approx(expected, rel=1e-4)
    reduced, known = read(Reduced, own["rom"]), read(Reduced, whole["rom"])
    assert np.allclose(reduced.frequency, known.frequency, rtol=1e-5)


@pytest.mark.parametrize(
    ("change", "key", "said"),
    [
        (("second: {parameter: E", "second: {parameter: F"), "mesh.results.second.parameter", "'F' is no parameter"),
        (("at: 2.4e+11", "at: 1.8e+11"), "mesh.results.second.at", "both sets were made with E"),
        (("file: second.frd", "file: first.frd"), "mesh.results.second", "has the frequencies of the first"),
        (("at: 2.4e+11", "at: 2.0e+11"), "mesh.results.second", "can only move it by a factor"),
        (("file: second.frd", "file: none.frd"), "mesh.results.second.file", "none.frd"),
        (("file: second.frd", "file: other.frd"), "mesh.results.second.file", "none of its"),
        (("second.frd", "second.frd, loads: {top: {step: 1}}"), "mesh.results.second.loads.top", "no load"),
        (("second.frd", "second.frd, modes: {step: 7}"), "mesh.results.second.modes", "no modes step 7"),
        ((", second: {parameter: E, at: 2.4e+11, file: second.frd}", ""), "parameters.E", "it is of some regions only"),
    ],
)
def test_a_second_set_of_something_else(folder, change, key, said):
    if "other.frd" in change[1] and not (folder / "other.frd").exists():
        mesh = read_mesh(folder / "beam.bdf")
        other = replace(mesh, node_ids=mesh.node_ids + 100000)
        write_frd(folder / "other.frd", other, solved(mesh, FORCES, MODES), form=3)
    assert change[0] in RESULTS
    with pytest.raises(StrainsightError, match=said) as caught:
        placed(folder, "wrong", RESULTS.replace(*change), until="rom")
    assert caught.value.key == key
    assert caught.value.remedy


def test_a_parameter_of_all_regions_needs_no_second_set(folder):
    with pytest.raises(StrainsightError, match="one of all needs none") as caught:
        placed(folder, "all", RESULTS, "parameters.E.region=null", until="rom")
    assert caught.value.key == "mesh.results.second.parameter"
