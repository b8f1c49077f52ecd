"""Frequencies of plates and membranes of shells: the exact ones of Mindlin plates, and the targets of NAFEMS.

NAFEMS, Selected benchmarks for natural frequency analysis (R0015): FV12, FV16, FV22, FV32, E = 200 GPa, ν = 0.3, 8000 kg/m³. Some
targets are themselves off: the exact frequencies of the plate, here by Ritz, are in FV12 1.1 % below targets 7 and 8 (4.233 Hz;
Leissa, J. Sound Vib. 31 (1973) 257-293, has 4.19) and 0.8 % below target 9, in FV22 1.0 % below target 4 (283.68 Hz).
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import legendre
from scipy.linalg import eigh

from ..shared import slowly
from .shell_models import KINDS, SECOND, frequencies, mass, rows, stiffness, unit_square

E, NU, RHO = 200e9, 0.3, 8000.0

FREE = np.ones(1), np.ones(1)
CLAMPED = np.array([1.0, 0, -1]), np.array([1.0, 0, -1])
"""Polynomials of ξ and η that stand before all others: zero where the plate is held."""
CANTILEVER = np.array([1.0, 1.0]), np.ones(1)

SQUARE = np.diag([10.0, 10.0])
RHOMBUS = 10 * np.array([[1.0, 0.0], [np.sqrt(0.5), np.sqrt(0.5)]])

PLATES: dict[str, tuple[np.ndarray, float, tuple[np.ndarray, np.ndarray], int, tuple[float, ...]]] = {
    "FV12": (SQUARE, 0.05, FREE, 3, (1.622, 2.360, 2.922, 4.233, 4.233, 7.416)),
    "FV16": (SQUARE, 0.05, CANTILEVER, 0, (0.421, 1.029, 2.582, 3.306, 3.753, 6.555)),
    "FV22": (RHOMBUS, 1.0, CLAMPED, 0, (133.95, 201.41, 265.81, 283.68, 334.45)),
}
"""Sides, thickness, supports, rigid motions, targets [Hz]."""

TAPERED = (44.623, 130.03, 162.70, 246.05, 379.90, 391.44)


def ritz(sides: np.ndarray, t: float, before: tuple[np.ndarray, np.ndarray], skip: int, count: int) -> np.ndarray:
    """Frequencies of a Mindlin plate on a parallelogram: w and both rotations are polynomials of degree 10 in ξ and η each."""
    degree = 10
    g, weight = legendre.leggauss(degree + 6)

    def along(factor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        polynomials = [
            np.polynomial.Polynomial(factor) * np.polynomial.Legendre.basis(i).convert(kind=np.polynomial.Polynomial)
            for i in range(degree + 1)
        ]
        return np.array([p(g) for p in polynomials]).T, np.array([p.deriv()(g) for p in polynomials]).T

    (f, df), (h, dh) = along(before[0]), along(before[1])
    N, N_xi, N_eta = (np.einsum("ai,bj->abij", p, q).reshape(len(g) ** 2, -1) for p, q in ((f, h), (df, h), (f, dh)))
    J = sides / 2
    W = np.outer(weight, weight).ravel() * np.linalg.det(J)
    slopes = np.linalg.inv(J)
    x, y = (slopes[c, 0] * N_xi + slopes[c, 1] * N_eta for c in range(2))

    def integral(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return a.T @ (W[:, None] * b)

    D, S = E * t**3 / (12 * (1 - NU**2)), 5 / 6 * E * t / (2 + 2 * NU)
    G = D * (1 - NU) / 2
    m, xx, yy, xy = integral(N, N), integral(x, x), integral(y, y), integral(x, y)
    wx, wy = S * integral(x, N), S * integral(y, N)
    cross = D * NU * xy + G * xy.T
    K = np.block(
        [[S * (xx + yy), wx, wy], [wx.T, D * xx + G * yy + S * m, cross], [wy.T, cross.T, D * yy + G * xx + S * m]]
    )
    M = np.kron(np.diag([RHO * t, RHO * t**3 / 12, RHO * t**3 / 12]), m)
    w2 = eigh(K, M, eigvals_only=True, subset_by_index=[skip, skip + count - 1])
    return np.sqrt(w2) / (2 * np.pi)


def plate(kind: str, n: int, name: str) -> np.ndarray:
    """The frequencies of an n × n mesh; motions in the plane are held, as NAFEMS has it."""
    sides, t, supports, skip, targets = PLATES[name]
    a, b, cells = unit_square(n, n, kind)
    x = np.column_stack([np.stack([a, b], axis=1) @ sides, 0 * a])
    edge = {id(FREE): a > 2, id(CANTILEVER): a == 0, id(CLAMPED): (a % 1 == 0) | (b % 1 == 0)}[id(supports)]
    held = np.union1d(rows(np.arange(len(x)), (0, 1, 5)), rows(edge))
    K, M = stiffness(x, cells, E, NU, t), mass(x, cells, RHO, t)
    return frequencies(K, M, held, skip + len(targets), -1.0)[skip:]


@pytest.fixture(scope="module")
def exact() -> dict[str, np.ndarray]:
    """Frequencies of Mindlin theory of all plates."""
    return {name: ritz(*model[:4], len(model[4])) for name, model in PLATES.items()}


@pytest.mark.parametrize(
    ("name", "kind"), [*((name, "quad4") for name in PLATES), ("FV16", "tri3"), *slowly(("FV12", "tri3"), ("FV22", "tri3"))]
)
def test_plates_have_the_frequencies_of_mindlin_theory(name, kind, exact):
    """Errors with h²: what is left by extrapolation from 16 and 32 elements a side (24 and 48 of the rhombus with triangles) is
    below 0.1 % with quads and 0.2 % with triangles."""
    n = 24 if (kind, name) == ("tri3", "FV22") else 16
    coarse, fine = plate(kind, n, name), plate(kind, 2 * n, name)
    np.testing.assert_allclose((4 * fine - coarse) / 3, exact[name], rtol=1e-3 if kind == "quad4" else 2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", PLATES)
def test_fine_plates_have_the_frequencies_of_mindlin_theory(name, kind, exact):
    """With 48 elements a side they are off by up to 0.7 % and 2.0 %, in the rhombus (its fifth mode)."""
    np.testing.assert_allclose(plate(kind, 48, name), exact[name], rtol=8e-3 if kind == "quad4" else 2e-2)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", PLATES)
def test_plates_have_the_frequencies_of_nafems(name, kind, exact):
    """Within 1 % of every target that Mindlin theory itself has within 1 %, and of that theory where it has not;
    64 × 64 elements, of the rhombus with triangles 112 × 112."""
    targets = np.array(PLATES[name][4])
    off = np.abs(exact[name] / targets - 1) > 0.01
    assert np.flatnonzero(off).tolist() == {"FV12": [3, 4], "FV16": [], "FV22": [3]}[name]
    found = plate(kind, 112 if (kind, name) == ("tri3", "FV22") else 64, name)
    np.testing.assert_allclose(found, np.where(off, exact[name], targets), rtol=0.01)
    np.testing.assert_allclose(found, targets, rtol=0.011)


LARGEST = {("quad8", False): 4e-3, ("tri6", False): 5e-3, ("quad8", True): 0.012, ("tri6", True): 0.033}
"""Error of frequencies of 8 × 8 elements of the second order, and of the rhombus, whose corners are singular (its fifth mode)."""


@pytest.mark.parametrize("kind", SECOND)
@pytest.mark.parametrize("name", PLATES)
def test_plates_of_the_second_order_have_the_frequencies_of_mindlin_theory(name, kind, exact):
    np.testing.assert_allclose(plate(kind, 8, name), exact[name], rtol=LARGEST[kind, name == "FV22"])


MEMBRANES = [("quad4", 16, 0.01), ("tri3", 32, 0.01), ("quad8", 4, 5e-3), ("tri6", 4, 0.01)]


@pytest.mark.parametrize(("kind", "n", "within"), MEMBRANES)
def test_the_tapered_membrane_has_the_frequencies_of_nafems(kind, n, within):
    """FV32: 10 m long, 5 m to 1 m wide, 0.05 m thick, held at the wide end; motions in its plane. Within 1 %: of quads 0.01 to
    0.74 %, of triangles half as large."""
    a, b, cells = unit_square(2 * n, n, kind)
    x = np.column_stack([10 * a, (5 - 4 * a) * (b - 0.5), 0 * a])
    held = np.union1d(rows(np.arange(len(x)), (2, 3, 4)), rows(a == 0))
    found = frequencies(stiffness(x, cells, E, NU, 0.05), mass(x, cells, RHO, 0.05), held, 6, -1.0)
    np.testing.assert_allclose(found, TAPERED, rtol=within)
