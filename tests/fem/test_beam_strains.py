"""Strain of a point of a beam's section from the motions of its nodes, against ε = N/(E A) − M y/(E I)."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.fem.beam_matrices import beam_strain_rows

from ..beams import Frame, line, properties, rectangle

E, L, H = 70e9, 2.0, 0.05
CLAMP = {0: range(6)}


def strains(frame, u, at, y, z):
    """At the same place of every beam of a frame."""
    full = np.ones(len(frame.pairs))
    rows = beam_strain_rows(
        frame.position, frame.axes, frame.own, frame.offset, frame.released, at * full, y * full, z * full
    )
    return np.einsum("en,en->e", rows, u.ravel()[frame.rows])


@pytest.mark.parametrize("shear", [(0.0, 0.0), (5 / 6, 5 / 6)])
@pytest.mark.parametrize("at", [0.0, 0.3, 1.0])
def test_strain_of_a_loaded_cantilever(shear, at):
    b, P, Q, N, y, z = 0.03, 120.0, -40.0, 900.0, 0.02, -0.01
    frame = Frame(*line(4, L), (0, 1, 0), rectangle(4, H, b, shear), E)
    u = frame.solve(CLAMP, {(4, 0): N, (4, 1): P, (4, 2): Q})
    x = (np.arange(4) + at) * L / 4
    # E I v″ = P (L − x), E I w″ = Q (L − x)
    I1, I2 = b * H**3 / 12, H * b**3 / 12
    exact = N / (E * b * H) - y * P * (L - x) / (E * I1) - z * Q * (L - x) / (E * I2)
    np.testing.assert_allclose(strains(frame, u, at, y, z), exact, rtol=1e-9, atol=1e-9 * np.abs(exact).max())


def test_strain_of_a_tapered_cantilever_with_I12():
    S = np.array([[[3e-8, 9e-9], [9e-9, 8e-9]], [[2e-9, -4e-10], [-4e-10, 9e-10]]])
    A, P, N, y, z = np.array([2e-3, 4e-4]), 30.0, 500.0, 0.02, -0.01
    frame = Frame(*line(1, L, (0, 0.6, 0.8)), (1, 0, 0), properties(1, A, S, [1e-8, 1e-9]), E)
    pull = N * np.array([0, 0.6, 0.8])
    u = frame.solve(CLAMP, {(1, 0): P, (1, 1): pull[1], (1, 2): pull[2]})  # P along y of the beam
    for at in (0.0, 0.25, 0.9):
        (Iy, Iyz), (_, Iz) = (1 - at) * S[0] + at * S[1]
        M = P * (1 - at) * L  # E(Iy v″ + Iyz w″) = M, E(Iyz v″ + Iz w″) = 0
        v, w = np.array([Iz, -Iyz]) * M / (E * (Iy * Iz - Iyz**2))
        exact = N / (E * ((1 - at) * A[0] + at * A[1])) - y * v - z * w
        assert strains(frame, u, at, y, z)[0] == pytest.approx(exact, rel=1e-9)


def test_strain_of_an_offset_beam_beside_a_pin():
    """Clamped at A, pinned to its node at B, 0.1 above both: a force at the node reaches the beam without a moment."""
    offset, released = np.tile([0.0, 0.1, 0.0], (1, 2, 1)), np.zeros((1, 2, 6), bool)
    released[0, 1, 5] = True
    frame = Frame(*line(1, L), (0, 1, 0), rectangle(1, H, 0.03), E, offset=offset, released=released)
    u = frame.solve({0: range(6), 1: (5,)}, {(1, 1): 50.0, (1, 0): 300.0})
    exact = 300.0 / (E * H * 0.03) - 0.02 * 50.0 * 0.6 * L / (E * 0.03 * H**3 / 12)
    assert strains(frame, u, 0.4, 0.02, 0.0)[0] == pytest.approx(exact, rel=1e-9)


def test_rigid_motions_and_absent_bending_leave_no_strain():
    frame = Frame(*line(1, L, (0, 0.6, 0.8)), (1, 0, 0), properties(1, 1e-3, np.zeros((2, 2)), 0.0), E)
    u = np.zeros((2, 6))
    u[1] = [0.1, 1e-3 * 0.6, 1e-3 * 0.8, 0.1, 0.2, 0.3]
    assert strains(frame, u, 0.5, 0.02, 0.03)[0] == pytest.approx(1e-3 / L)
    full = Frame(*line(1, L, (0, 0.6, 0.8)), (1, 0, 0), rectangle(1, H, 0.03), E)
    turn = np.array([0.3, -0.2, 0.5])
    rigid = np.array([[*np.cross(turn, node), *turn] for node in full.nodes])
    assert abs(strains(full, rigid, 0.2, 0.02, 0.03)[0]) < 1e-15
