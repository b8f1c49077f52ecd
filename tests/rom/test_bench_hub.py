"""The hub of the bench, reduced."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from strainsight.decks.reader import read_mesh
from strainsight.fem.factorisation import factorise
from strainsight.fem.model import build_model
from strainsight.fem.modes import modes as lowest_modes
from strainsight.rom.craig_bampton import craig_bampton

from .bars import MESHES, frequencies, inertia_of, pick, rigid


def test_the_deck_is_the_one_in_the_list_of_checksums():
    digest, name = (MESHES / "hub-bench.sha256").read_text().split()
    assert hashlib.sha256((MESHES / name).read_bytes()).hexdigest() == digest


@pytest.mark.slow
def test_the_hub_is_the_full_one_in_statics_and_in_its_modes_below_half_the_cut_off():
    model = build_model(read_mesh(MESHES / "hub-bench.bdf.gz"))
    body = craig_bampton(model, [2], cutoff=550.0)
    K, M = model.stiffness.constant, model.mass.constant
    factor = factorise(K)
    B = pick(model, 2)
    exact = factor.solve(B.T)
    reduced = np.linalg.solve(body.stiffness.constant, np.eye(body.size)[:, :6])
    assert np.allclose(body.basis @ reduced, exact, rtol=0, atol=1e-10 * np.abs(exact).max(axis=0))
    flexibility = B @ exact
    assert np.allclose(reduced[:6], flexibility, rtol=0, atol=1e-10 * np.abs(flexibility).max())
    f = inertia_of(model, rigid(model.mesh.position)[:, :3])
    exact = factor.solve(f)
    found = body.basis @ np.linalg.solve(body.stiffness.constant, body.basis.T @ f)
    assert np.allclose(found, exact, rtol=0, atol=1e-10 * np.abs(exact).max(axis=0))
    frequency, _ = lowest_modes(K, M, 9, factor=factor)
    assert frequency[-1] < 0.5 * body.cut
    ratio = frequencies(body.stiffness.constant, body.mass)[:9] / frequency
    assert np.all((ratio > 1 - 1e-9) & (ratio < 1.005))
