"""A model condensed elsewhere: loaded nodes and modal coordinates come in as ready matrices, gauges as strain rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import block_diag
from scipy.sparse.linalg import eigsh, splu

from strainsight.decks.reader import read_mesh
from strainsight.fem.model import build_model, nodal
from strainsight.mesh.facets import exterior_facets
from strainsight.records.record import read
from strainsight.records.training import Training
from strainsight.sensors.strain_operator import channel_rows
from strainsight.stages.placement import PLACEMENT

from ..shared import PLACED_EXACTLY, strains
from .conftest import ROOT, SHORT, UNSTUDIED, finished, job_of, made
from .test_ready import numbering

DECK = ROOT / "meshes" / "cantilever.bdf"
TIP, FIRST = 2, 9001
MODES = 24


def condensed(folder: Path, pool) -> None:
    """Craig and Bampton's model as another program makes it, here SciPy: the tip's six motions b and modes of the rest i.

    z_i = −K_ii⁻¹K_ib z_b + Φ q,   K̂ = diag(K_bb − K_bi K_ii⁻¹ K_ib, Λ),   M̂ = ΨᵀMΨ
    """
    mesh = read_mesh(DECK)
    model = build_model(mesh)
    K, M = (sparse.csc_array(X.at({})) for X in (model.stiffness, model.mass))
    tip = int(np.flatnonzero(mesh.node_ids == TIP)[0])
    at = {int(row): free for free, row in enumerate(model.constraint.free_rows)}
    turns = model.constraint.reference_rows[tip]
    b = np.array([at[3 * tip + k] for k in range(3)] + [at[turns + k] for k in range(3)])
    i = np.setdiff1d(np.arange(K.shape[0]), b)
    lam, phi = eigsh(K[i][:, i], MODES, M=M[i][:, i], sigma=0.0)
    static = -splu(K[i][:, i]).solve(K[i][:, b].toarray())
    basis = np.zeros((K.shape[0], 6 + MODES))
    basis[i], basis[b, :6] = np.hstack([static, phi]), np.eye(6)
    held = K[b][:, b].toarray() + K[b][:, i] @ static
    sparse.save_npz(folder / "k.npz", sparse.csr_array(block_diag((held + held.T) / 2, np.diag(lam))))
    mass = basis.T @ (M @ basis)
    sparse.save_npz(folder / "m.npz", sparse.csr_array((mass + mass.T) / 2))
    rows = channel_rows(mesh.position, pool, nodal(model, basis), facets=exterior_facets(mesh))
    sparse.save_npz(folder / "strain.npz", sparse.csr_array(rows))
    modal = FIRST + np.arange(MODES)
    numbering(folder / "rows.csv", np.r_[np.full(6, TIP), modal], np.r_[np.arange(6), np.zeros(MODES, int)])
    grid = [f"GRID,{TIP},,{','.join(f'{x:.6f}' for x in mesh.position[tip])}", *(f"GRID,{q},,0.,0.,0." for q in modal)]
    (folder / "condensed.bdf").write_text("\n".join(grid) + "\n")
    place = np.hstack([pool.position, pool.direction])
    lines = [f"{k},{','.join(f'{x:.9f}' for x in at)}" for k, at in enumerate(place, start=1)]
    (folder / "gauges.csv").write_text("\n".join(["gauge,x,y,z,dx,dy,dz", *lines]) + "\n")


@pytest.mark.slow
def test_a_condensed_model_gives_the_layout_of_the_whole(config, tmp_path):
    artefacts = made(config, *SHORT, *PLACED_EXACTLY, *UNSTUDIED, until="validate")
    pool = read(Training, artefacts["train"]).candidates
    condensed(tmp_path, pool)
    text = (
        config.read_text().replace("file: ../meshes/cantilever.bdf", "file: condensed.bdf").replace("region: 1, ", "")
    )
    matrices = "numbering: rows.csv, stiffness: [{file: k.npz, parameter: E, at: 2.1e+11}], mass: [{file: m.npz}]"
    text = text.replace("mass_unit: kg}", f"mass_unit: kg, matrices: {{{matrices}}}}}")
    text = text.replace("  surface: all\n", "").replace(
        "  direction: {type: axis, axis: [1, 0, 0], angles: [0]}\n", "  strain_operator: {rows: strain.npz, table: gauges.csv}\n"
    )
    (tmp_path / "condensed.yaml").write_text(text)
    job = job_of(tmp_path / "condensed.yaml", tmp_path / "results", *SHORT, *PLACED_EXACTLY, *UNSTUDIED)
    found = {stage: artefact for stage, (_, _, artefact) in finished(job, PLACEMENT[:-1]).items()}
    assert np.allclose(found["rom"]["/frequency"], artefacts["rom"]["/frequency"], rtol=1e-3)
    strain = strains(artefacts["train"])
    assert np.allclose(strains(found["train"]), strain, atol=2e-3 * np.abs(strain).max())
    path = "/selected/final/position"
    assert np.allclose(*(np.unique(run["place"][path].round(6), axis=0) for run in (found, artefacts)))
    # the lattice of a grid filter makes its σ right to 1e-2
    for stage, key, right in (("place", "std.E", 2e-3), ("validate", "estimate.E", 2e-3), ("validate", "std.E", 1e-2)):
        assert found[stage].summary[key] == pytest.approx(artefacts[stage].summary[key], rel=right), key
