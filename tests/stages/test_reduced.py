"""Modes of another program as ready matrices, by the script of docs/scaling.md: the same layout as on the whole model."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh, splu

from strainsight.decks.reader import read_mesh
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import build_model, nodal
from strainsight.gauges.rows import channel_matrix
from strainsight.records.record import read
from strainsight.records.training import Training
from strainsight.stages.placement import PLACEMENT

from ..shared import PLACED_EXACTLY, strains
from .conftest import ROOT, SHORT, finished, job_of, made

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


def edited(text, *changes):
    for old, new in changes:
        text, count = re.subn(old, new, text, flags=re.MULTILINE)
        assert count == 1, old
    return text


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
    text = edited(
        config.read_text(),
        (r"^mesh: .*\n", MESH),
        (r"region: 1, ", ""),
        (r"node: 2, direction: \[0, 0, 1\]", "node: 1, direction: [1, 0, 0]"),
        (r"^  surface: all\n", "  given: {rows: strain.npz, table: gauges.csv}\n"),
        (r"^  direction: .*\n", ""),
    )
    (tmp_path / "own.yaml").write_text(text)
    stages = [stage for stage in PLACEMENT if stage.name in ("import", "modes", "rom", "train", "screen", "place")]
    job = job_of(tmp_path / "own.yaml", tmp_path / "results", *SHORT, *PLACED_EXACTLY, *LOADED_EXACTLY)
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
        assert f"σ holds no such error as tolerances.{key} states of tip: no motion of the model follows it" in advised
