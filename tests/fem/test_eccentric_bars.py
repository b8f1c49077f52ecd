"""A plate with a bar below its middle that tilts with it: the bar bends sideways, and its sections turn about the normal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from strainsight.fem.model import build_model
from strainsight.fem.modes import modes
from strainsight.fem.shells import shell_stiffnesses
from strainsight.mesh.model import Material, Region
from strainsight.mesh.thin import BeamBlock, BeamSection, ShellSection

from ..beams import axes_of
from ..shared import slowly
from .shell_models import isotropic, sheet, summed, unit_square

L, B, T = 432.0, 108.0, 3.0
"""Of the plate [mm]."""
E, NU, RHO = 7.1e4, 0.33, 2.81e-9
AREA, I1, I2, J, BELOW = 96.0, 4608.0, 128.0, 458.0, -13.5
"""Of a blade of 4 × 24 mm on its lower side; in mm."""


SHAPES = {
    "quad4": [[0, 0, 0], [9, 1, 0], [8, 7, 0], [-1, 6, 0]],
    "tri3": [[0, 0, 0], [9, 1, 0], [2, 7, 0]],
    "quad8": [[0, 0, 0], [9, 1, 0], [8, 7, 0], [-1, 6, 0]],
    "tri6": [[0, 0, 0], [9, 1, 0], [2, 7, 0]],
}
"""Corners [mm]."""


def by_ritz(highest=4, terms=60):
    """Frequencies [Hz] of the plate, simply supported, ends of the bar likewise, of up to so many half waves along it.

    u = cos kx Σ u_n sin p_n y, v = sin kx Σ v_n cos p_n y, w = sin kx Σ w_n sin p_n y; the bar in the middle, e off the plate,
    moves by u − e w,x, v − e w,y and w and twists by w,y. Kirchhoff's plate, Euler's bar.
    """
    n = np.arange(terms)
    p, i, none = n * np.pi / B, np.arange(terms), np.zeros(terms)
    s, c = np.sin(p * B / 2), np.cos(p * B / 2)
    stretch, shear = E * T / (1 - NU**2), E * T / 2 / (1 + NU)
    area = L * B / 4 * np.where(n == 0, 2.0, 1.0)
    found = []
    for k in np.arange(1, highest + 1) * np.pi / L:
        K, M = np.zeros((2, 3, terms, 3, terms))
        K[0, i, 0, i] = area * (stretch * k**2 + shear * p**2)
        K[1, i, 1, i] = area * (stretch * p**2 + shear * k**2)
        K[0, i, 1, i] = K[1, i, 0, i] = area * (NU * stretch + shear) * k * p
        K[2, i, 2, i] = area * stretch * T**2 / 12 * (k**2 + p**2) ** 2
        for own in range(3):
            M[own, i, own, i] = area * RHO * T
        M[2, i, 2, i] += area * RHO * T**3 / 12 * (k**2 + p**2)
        K, M = (X.reshape(3 * terms, -1) for X in (K, M))
        u, v, w, twist = (
            np.concatenate(parts)
            for parts in ((s, none, -BELOW * k * s), (none, c, -BELOW * p * c), (none, none, s), (none, none, p * c))
        )
        stiff = ((u, E * AREA * k**2), (w, E * I1 * k**4), (v, E * I2 * k**4), (twist, E / 2 / (1 + NU) * J * k**2))
        heavy = ((u, AREA), (v, AREA + I2 * k**2), (w, AREA + I1 * k**2), (twist, I1 + I2))
        K += sum(L / 2 * factor * np.outer(a, a) for a, factor in stiff)
        M += sum(L / 2 * RHO * factor * np.outer(a, a) for a, factor in heavy)
        there = np.flatnonzero(np.tile(n > 0, 3) | (np.arange(3 * terms) // terms == 1))
        found.append(np.sqrt(eigh(K[np.ix_(there, there)], M[np.ix_(there, there)], eigvals_only=True)[:4]) / 2 / np.pi)
    return np.sort(np.concatenate(found))


def plate(kind, across):
    """So many elements across, and bars along the sides of those in the middle, of the second order along their halves."""
    mesh = sheet(
        kind,
        4 * across,
        across,
        lambda a, b: np.column_stack([L * a, B * (b - 0.5), 0 * a]),
        ShellSection(T),
        Material(1, E, NU, RHO),
    )
    x, y, _ = mesh.position.T
    middle = np.flatnonzero(y == 0)
    ends = np.column_stack([middle[:-1], middle[1:]])
    e = len(ends)
    axes = axes_of(mesh.position[ends], (0.0, 0.0, 1.0))
    offset, released = np.tile([0.0, 0.0, BELOW], (e, 2, 1)), np.zeros((e, 2, 6), bool)
    held = [(node, c) for node in np.flatnonzero((x == 0) | (x == L)) for c in (1, 2, 3)]
    held += [(node, c) for node in np.flatnonzero(np.abs(y) == B / 2) for c in (0, 2, 4)]
    return replace(
        mesh,
        fixed=np.array(sorted(set(held))),
        beams=(BeamBlock("beam", 10**6 + np.arange(e), ends, np.full(e, 2), axes, offset, released),),
        sections={**mesh.sections, 2: BeamSection(AREA, np.diag([I1, I2]), J)},
        regions={**mesh.regions, 2: Region(2, "PBAR 2", 1)},
    )


@pytest.mark.parametrize(("kind", "across"), [("quad4", 18), *slowly(("tri3", 18), ("quad8", 6)), ("tri6", 6)])
def test_a_plate_tilts_with_its_bar_as_by_ritz(kind, across):
    """In mm and t."""
    model = build_model(plate(kind, across))
    found = modes(model.stiffness.constant, model.mass.constant, 6)[0]
    np.testing.assert_allclose(found, by_ritz()[:6], rtol=0.0065)


@pytest.mark.parametrize("kind", SHAPES)
def test_what_is_let_go_stays_free_of_rigid_motions(kind):
    x = np.array(SHAPES[kind], float)
    if kind in ("quad8", "tri6"):
        x = np.concatenate([x, (x + np.roll(x, -1, axis=0)) / 2])
    beside = np.arange(len(x))[None] % 2 == 0
    K = shell_stiffnesses(x[None], *isotropic(E, NU, T, 1), np.full(1, 2.0), np.ones(1, int), beside)[0]
    values = np.linalg.eigvalsh(K)
    assert (np.abs(values[:6]) < 1e-9 * values[-1]).all()
    assert values[6] > 0


@pytest.mark.parametrize("kind", ["quad4", "tri3"])
def test_constant_stress_passes_where_rotations_are_let_go(kind):
    a, b, cells = unit_square(4, 4, kind)
    x = np.column_stack([a + 0.1 * a * b, b - 0.15 * a * b + 0.1 * a**2, 0 * a])
    beside = np.isin(cells, [6, 7, 12, 13])
    own = shell_stiffnesses(
        x[cells], *isotropic(1.0, NU, 0.05, len(cells)), np.zeros(len(cells)), np.arange(len(cells)), beside
    )
    G = np.array([[0.3, 0.7], [-0.2, 0.5]])
    u = np.zeros((len(x), 6))
    u[:, :2], u[:, 5] = x[:, :2] @ G.T, (G[1, 0] - G[0, 1]) / 2
    force = (summed(own, cells, len(x)) @ u.ravel()).reshape(-1, 6)
    inner = (a > 0) & (a < 1) & (b > 0) & (b < 1)
    assert np.abs(force[inner]).max() < 1e-12 * np.abs(force).max()
