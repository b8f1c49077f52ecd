"""Beams of three nodes: rigid motions, closed forms of straight and curved beams, and what gauges read on their sides."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve

from strainsight.decks.reader import read_mesh
from strainsight.errors import DeckError
from strainsight.fem.beam_curved import curved_beam_masses, curved_beam_stiffnesses
from strainsight.fem.checks import check_mesh
from strainsight.fem.model import build_model, nodal
from strainsight.fem.recovery import facet_strain
from strainsight.mesh.beam_sides import with_sides
from strainsight.mesh.facets import exterior_facets

from ..beams import Arch, axes_of, properties, threes
from .shell_models import rigid_motions
from .test_beam_frequencies import SHEAR, E


def test_only_the_six_rigid_motions_are_free_and_have_the_mass_of_the_body():
    position = np.array([[[0.0, 0, 0], [1, 0.3, 0.2], [0.5, 0.25, 0.05]]])
    offset = np.random.default_rng(0).uniform(-0.1, 0.1, (1, 3, 3))
    second = np.array([[4e-4, 1e-4], [1e-4, 9e-4]])
    own = properties(1, 2e-2, second, 6e-4, (0.8, 0.7))
    axes = axes_of((position + offset)[:, :2], (0.0, 1.0, 0.0))
    K = curved_beam_stiffnesses(position, axes, own, offset, np.ones(1))[0]
    R, values = rigid_motions(position[0]), np.linalg.eigvalsh(K)
    assert np.abs(K @ R).max() < 1e-13 * np.abs(K).max()
    assert np.abs(values[:6]).max() < 1e-14 * values[-1]
    assert values[6] > 1e-6 * values[-1]
    M = curved_beam_masses(position, axes, np.full((1, 2), 3.0), offset, np.ones(1), np.tile(second, (1, 2, 1, 1)))[0]
    s = np.linspace(-1, 1, 20001)[:, None]
    a, b, middle = (position + offset)[0]
    x = s * (s - 1) / 2 * a + s * (s + 1) / 2 * b + (1 - s**2) * middle
    length = np.linalg.norm(np.diff(x, axis=0), axis=1)
    np.testing.assert_allclose((R.T @ M @ R)[:3, :3], 3 * length.sum() * np.eye(3), rtol=2e-4, atol=1e-12)
    assert np.linalg.eigvalsh(M).min() > -1e-15


def test_a_straight_beam_is_exact_under_a_force_at_its_end():
    """One element: v = F L³/(3 E I) + F L/(k G A), θ = F L²/(2 E I), and twist T L/(G J)."""
    L, own = 2.0, properties(1, 2e-3, np.diag([4e-7, 9e-7]), 6e-7, (5 / 6, 0.7))
    beam = Arch([[0, 0, 0], [L / 2, 0, 0], [L, 0, 0]], [[0, 2, 1]], (0.0, 1.0, 0.0), own, E)
    for component, I, k, sign in ((1, 4e-7, 5 / 6, 1), (2, 9e-7, 0.7, -1)):
        u = beam.solve({0: range(6)}, {(2, component): 1.0})
        assert u[2, component] == pytest.approx(L**3 / (3 * E * I) + L / (k * E / 2.6 * 2e-3), rel=1e-10)
        assert u[2, 6 - component] == pytest.approx(sign * L**2 / (2 * E * I), rel=1e-10)
    assert beam.solve({0: range(6)}, {(2, 3): 1.0})[2, 3] == pytest.approx(L * 2.6 / E / 6e-7)


def quarter(R, section):
    """Four elements on a quarter of a ring about z."""
    angle = np.linspace(0, np.pi / 2, 9)
    x = np.column_stack([R * np.cos(angle), R * np.sin(angle), 0 * angle])
    return Arch(x, threes(range(9)), (0.0, 0.0, 1.0), section, E)


@pytest.mark.parametrize("slender", [20, 2000])
def test_a_ring_that_is_pinched(slender):
    """Two forces W across a ring: its diameters change by −W R³/(E I) (π k₁/4 − 2 k₂²/π) and W R³/(E I) (2 k₂²/π − k₂ + k₁/2),
    k₁ = 1 − α + β, k₂ = 1 − α, α = I/(A R²), β = 1.2 E I/(G A R²) (Roark's Formulas, table of rings, case 1). Four elements a
    quarter: within 0.1 %, however slender it is."""
    R, h = 1.0, 1.0 / slender
    I, A = h**4 / 12, h**2
    ring = quarter(R, properties(4, A, np.diag([I, I]), 2 * I, SHEAR))
    u = ring.solve({0: (1, 2, 3, 4, 5), 8: (0, 2, 3, 4, 5)}, {(8, 1): -0.5})
    alpha, beta = I / (A * R**2), 1.2 * 2.6 * I / (A * R**2)
    k1, k2 = 1 - alpha + beta, 1 - alpha
    vertical = -(R**3) / (E * I) * (np.pi * k1 / 4 - 2 * k2**2 / np.pi)
    across = R**3 / (E * I) * (2 * k2**2 / np.pi - k2 + k1 / 2)
    assert 2 * u[8, 1] == pytest.approx(vertical, rel=1e-3)
    assert 2 * u[0, 0] == pytest.approx(across, rel=1e-3)


def test_a_quarter_of_a_ring_under_a_force_across_its_plane():
    """w = F R³ (π/4/(E I) + (3π/4 − 2)/(G J)) of a slender one (Castigliano)."""
    R, I, J, A = 2.0, 3e-8, 5e-8, 4e-2
    u = quarter(R, properties(4, A, np.diag([I, I]), J, SHEAR)).solve({0: range(6)}, {(8, 2): 1.0})
    expected = R**3 * (np.pi / 4 / (E * I) + (3 * np.pi / 4 - 2) * 2.6 / (E * J))
    assert u[8, 2] == pytest.approx(expected, rel=1e-3)


DECK = """*NODE
1, 0., 0., 0.
2, .25, 0., 0.
3, .5, 0., 0.
4, .75, 0., 0.
5, 1., 0., 0.
*ELEMENT, TYPE=B32, ELSET=BAR
11, 1, 2, 3
12, 3, 4, 5
*BEAM SECTION, ELSET=BAR, SECTION=RECT, MATERIAL=STEEL
.02, .03
0., 1., 0.
*MATERIAL, NAME=STEEL
*ELASTIC
2.E11, .3
*DENSITY
7800.
*BOUNDARY
1, 1, 6
"""


@pytest.fixture
def bar(tmp_path):
    def made(text=DECK):
        (tmp_path / "bar.inp").write_text(text)
        return with_sides(read_mesh(tmp_path / "bar.inp"))

    return made


@pytest.mark.parametrize(("component", "force"), [(0, 1e3), (1, 1e3), (2, 1e3), (3, 10.0)])
def test_sides_have_the_strain_of_beam_theory(bar, component, force):
    """In the middle of each element N/(E A) − M_z y/(E I_z) + …, −ν of it across, no shear but that of twist, T out/(G J)."""
    mesh = bar()
    model = build_model(mesh)
    f = np.zeros(model.constraint.transform.shape[0])
    f[12 + component if component < 3 else model.constraint.rotations(np.array([4]))[0, 0]] = force
    z = nodal(model, spsolve(model.stiffness.constant.tocsc(), model.constraint.transform.T @ f)[:, None])
    facets = exterior_facets(mesh)
    assert len(facets.kind) == 8
    strain = (facet_strain(mesh, facets).matrix @ z[:, 0]).reshape(-1, 6)
    x, y, out = mesh.position[facets.nodes].mean(axis=1).T
    b, h = 0.02, 0.03
    along = {
        0: force / (b * h) + 0 * x,
        1: -force * (1 - x) * y / (h * b**3 / 12),
        2: -force * (1 - x) * out / (b * h**3 / 12),
        3: 0 * x,
    }[component] / 2e11
    np.testing.assert_allclose(strain[:, 0], along, atol=1e-10 * np.abs(strain).max())
    np.testing.assert_allclose(strain[:, 1:3], -0.3 * along[:, None].repeat(2, axis=1), atol=1e-10 * np.abs(strain).max())
    shear = np.linalg.norm(strain[:, 3:], axis=1)
    J = next(iter(mesh.sections.values())).torsion
    expected = force * np.maximum(np.abs(y), np.abs(out)) / (2e11 / 2.6 * J) if component == 3 else 0 * x
    np.testing.assert_allclose(shear, expected, atol=1e-9 * np.abs(strain).max())


def test_a_node_outside_of_the_middle_half_is_refused_with_its_line(bar):
    mesh = bar(DECK.replace("2, .25, 0., 0.", "2, .4, 0., 0."))
    with pytest.raises(DeckError, match=r"node 2 of beam3 element 11 lies at 0.8 of its side") as error, mesh.located():
        check_mesh(mesh)
    assert error.value.where.endswith("bar.inp:8")
