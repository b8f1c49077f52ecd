"""A steel cantilever of 2 × 0.25 × 0.19 m against beam theory: modes matched by their shapes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from strainsight.decks.reader import read_mesh
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import modes

L, B, H = 2.0, 0.25, 0.19
E, NU, RHO = 2.1e11, 0.3, 7850.0
G, AREA, POLAR = E / (2 * (1 + NU)), B * H, B * H * (B**2 + H**2) / 12


def timoshenko(inertia, count):
    """Roots of the clamped-free determinant of w′ = ψ + Q/kGA, ψ′ = M/EI, M′ = −Q − ρIω²ψ, Q′ = −ρAω²w.

    Shear coefficient of a rectangle after Cowper (1966): k = 10(1 + ν)/(12 + 11ν).
    """
    k = 10 * (1 + NU) / (12 + 11 * NU)

    def determinant(omega):
        s = E * inertia
        A = np.array(
            [
                [0, 1, 0, s / (k * G * AREA)],
                [0, 0, 1, 0],
                [0, -RHO * inertia * omega**2 / s, 0, -1],
                [-RHO * AREA * omega**2 / s, 0, 0, 0],
            ]
        )
        return np.linalg.det(expm(A * L)[2:, 2:])

    grid = 2 * np.pi * np.arange(5.0, 1500.0, 5.0)
    value = [determinant(omega) for omega in grid]
    roots = [
        brentq(determinant, a, b) for a, b, fa, fb in zip(grid, grid[1:], value, value[1:], strict=False) if fa * fb < 0
    ]
    return np.array(roots[:count]) / (2 * np.pi)


def saint_venant():
    """f = √(GJ/ρI_p)/4L with the torsion series of a rectangle."""
    n = np.arange(1, 60, 2)
    J = B * H**3 * (1 / 3 - 64 / np.pi**5 * H / B * np.sum(np.tanh(n * np.pi * B / (2 * H)) / n**5))
    return np.sqrt(G * J / (RHO * POLAR)) / (4 * L)


def rayleigh_love():
    """f = √(E/ρ)/4L / √(1 + ν² I_p/A (π/2L)²): the lateral inertia of the Poisson contraction."""
    return np.sqrt(E / RHO) / (4 * L) / np.sqrt(1 + NU**2 * POLAR / AREA * (np.pi / (2 * L)) ** 2)


def families(mesh, count=10):
    """Frequencies by family: which of bending z, bending y, torsion and stretching has most of a mode's motion."""
    model = build_model(mesh)
    frequency, shapes = modes(model.stiffness.constant, model.mass.constant, count)
    x, y, z = (mesh.position - 0.5 * (mesh.position.min(axis=0) + mesh.position.max(axis=0))).T
    fields = nodal(model, shapes).reshape(len(x), 3, count)
    station = np.unique(np.round(x, 9), return_inverse=True)[1]
    size = np.bincount(station)

    def mean(values):
        return (np.bincount(station, values) / size)[station]

    found = {"z": [], "y": [], "torsion": [], "axial": []}
    for f, field in zip(frequency, np.moveaxis(fields, 2, 0), strict=True):
        twist = mean(y * field[:, 2] - z * field[:, 1]) / mean(y**2 + z**2)
        share = {
            "z": np.sum(mean(field[:, 2]) ** 2),
            "y": np.sum(mean(field[:, 1]) ** 2),
            "torsion": np.sum(twist**2 * (y**2 + z**2)),
            "axial": np.sum(mean(field[:, 0]) ** 2),
        }
        kind = max(share, key=lambda k: share[k])
        assert share[kind] > 0.8 * sum(share.values())
        found[kind].append(f)
    return {kind: np.array(values) for kind, values in found.items()}


def test_the_example_deck_within_one_percent_of_theory_the_axial_mode_within_a_thousandth():
    mesh = read_mesh(Path(__file__).parents[2] / "meshes" / "cantilever.bdf")
    assert mass_properties(mesh)[0] == pytest.approx(RHO * L * AREA, rel=1e-12)
    found = families(mesh)
    assert np.allclose(found["z"][:3], timoshenko(B * H**3 / 12, 3), rtol=7e-3)
    assert np.allclose(found["y"][:3], timoshenko(H * B**3 / 12, 3), rtol=7e-3)
    assert found["torsion"][0] == pytest.approx(saint_venant(), rel=7e-3)
    assert found["axial"][0] == pytest.approx(rayleigh_love(), rel=1e-3)


def test_axial_mode_within_a_thousandth_where_the_root_may_contract(box):
    """The root held along the axis only (and, on its two symmetry lines, across them): Rayleigh-Love to 1e-4."""
    mesh = box("hex20", (20, 2, 2), (L, B, H), material=(E, NU, RHO))
    x, y, z = mesh.position.T
    root = np.isclose(x, 0)
    held = [(root, 0), (root & np.isclose(y, B / 2), 1), (root & np.isclose(z, H / 2), 2)]
    fixed = np.vstack([np.column_stack([np.flatnonzero(where), np.full(where.sum(), c)]) for where, c in held])
    assert families(replace(mesh, fixed=fixed))["axial"][0] == pytest.approx(rayleigh_love(), rel=1e-4)


def test_slender_cantilever_reaches_the_textbook_roots(box):
    """L/h = 100, ν = 0: f = (βL)² √(EI/ρA)/2πL², βL = 1.8751, 4.6941, 7.8548; one layer of hex8 does not lock."""
    length, h = 10.0, 0.1
    for kind, counts, within in (("hex20", (40, 1, 1), 2e-3), ("hex8", (100, 1, 1), 2e-3)):
        mesh = box(kind, counts, (length, 0.2, h), clamp_root=True, material=(E, 0.0, RHO))
        model = build_model(mesh)
        frequency, shapes = modes(model.stiffness.constant, model.mass.constant, 6)
        vertical = [
            f
            for f, field in zip(frequency, nodal(model, shapes).T, strict=True)
            if np.sum(field[2::3] ** 2) > 0.9 * np.sum(field**2)
        ]
        exact = np.array([1.8751, 4.6941, 7.8548]) ** 2 * np.sqrt(E * h**2 / 12 / RHO) / (2 * np.pi * length**2)
        assert np.allclose(vertical[:3], exact, rtol=within)
