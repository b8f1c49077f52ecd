"""Beams of three nodes: rigid motions, closed forms of straight and curved beams, NAFEMS, and what gauges read on their sides."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import linalg
from scipy.sparse.linalg import spsolve

from strainsight.decks.reader import read_mesh
from strainsight.errors import DeckError
from strainsight.fem.beam_curved import curved_beam_masses, curved_beam_stiffnesses
from strainsight.fem.checks import check_mesh
from strainsight.fem.model import build_model, nodal
from strainsight.fem.recovery import facet_strain
from strainsight.mesh.beam_sides import with_sides
from strainsight.mesh.facets import exterior_facets

from ..beams import axes_of, properties, rectangle
from .shell_models import rigid_motions
from .test_beam_frequencies import DENSITY, E, timoshenko_pinned

SHEAR = (5 / 6, 5 / 6)


class Arch:
    """Beams through points x (2n + 1, 3), of which every second lies between ends: dense K and M."""

    def __init__(self, x, towards, own, density=0.0, more=()):
        self.x = np.asarray(x, float)
        n = (len(self.x) - 1) // 2
        cells = [[2 * i, 2 * i + 2, 2 * i + 1] for i in range(n)] if not len(more) else more
        self.cells = np.array(cells)
        position = self.x[self.cells]
        axes, e = axes_of(position[:, :2], towards), len(self.cells)
        offset, ids = np.zeros((e, 3, 3)), np.arange(1, e + 1)
        K = E * curved_beam_stiffnesses(position, axes, own, offset, ids)
        M = curved_beam_masses(position, axes, density * own.area, offset, ids, density * own.second)
        self.K, self.M = np.zeros((2, 6 * len(self.x), 6 * len(self.x)))
        for rows, k, m in zip((6 * self.cells[:, :, None] + np.arange(6)).reshape(e, 18), K, M, strict=True):
            self.K[np.ix_(rows, rows)] += k
            self.M[np.ix_(rows, rows)] += m

    def free(self, fixed):
        held = [6 * node + c for node, components in fixed.items() for c in components]
        return np.setdiff1d(np.arange(len(self.K)), held)

    def moved(self, fixed, force):
        free, u = self.free(fixed), np.zeros(len(self.K))
        u[free] = np.linalg.solve(self.K[np.ix_(free, free)], force[free])
        return u.reshape(-1, 6)

    def frequencies(self, fixed, count):
        free = self.free(fixed)
        values = linalg.eigh(self.K[np.ix_(free, free)], self.M[np.ix_(free, free)], eigvals_only=True)
        return np.sqrt(values[:count]) / (2 * np.pi)


def line(count, length):
    return np.column_stack([np.linspace(0, length, 2 * count + 1), np.zeros((2 * count + 1, 2))])


def test_only_the_six_rigid_motions_are_free_and_have_the_mass_of_the_body():
    """Curved in space, with offsets and a section whose axes are not principal. Its mass is m L, L by many chords."""
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
    for component, I, k, sign in ((1, 4e-7, 5 / 6, 1), (2, 9e-7, 0.7, -1)):
        force = np.zeros(18)
        force[12 + component] = 1.0
        u = Arch(line(1, L), (0.0, 1.0, 0.0), own).moved({0: range(6)}, force)
        assert u[2, component] == pytest.approx(L**3 / (3 * E * I) + L / (k * E / 2.6 * 2e-3), rel=1e-10)
        assert u[2, 6 - component] == pytest.approx(sign * L**2 / (2 * E * I), rel=1e-10)
    force = np.zeros(18)
    force[15] = 1.0
    assert Arch(line(1, L), (0.0, 1.0, 0.0), own).moved({0: range(6)}, force)[2, 3] == pytest.approx(L * 2.6 / E / 6e-7)


@pytest.mark.parametrize("slender", [20, 2000])
def test_a_ring_that_is_pinched(slender):
    """Two forces W across a ring: its diameters change by −W R³/(E I) (π k₁/4 − 2 k₂²/π) and W R³/(E I) (2 k₂²/π − k₂ + k₁/2),
    k₁ = 1 − α + β, k₂ = 1 − α, α = I/(A R²), β = 1.2 E I/(G A R²) (Roark's Formulas, table of rings, case 1). Four elements a
    quarter: within 0.1 %, however slender it is."""
    R, h = 1.0, 1.0 / slender
    I, A = h**4 / 12, h**2
    angle = np.linspace(0, np.pi / 2, 9)
    x = np.column_stack([R * np.cos(angle), R * np.sin(angle), 0 * angle])
    ring = Arch(x, (0.0, 0.0, 1.0), properties(4, A, np.diag([I, I]), 2 * I, SHEAR))
    force = np.zeros(54)
    force[49] = -0.5
    u = ring.moved({0: (1, 2, 3, 4, 5), 8: (0, 2, 3, 4, 5)}, force)
    alpha, beta = I / (A * R**2), 1.2 * 2.6 * I / (A * R**2)
    k1, k2 = 1 - alpha + beta, 1 - alpha
    vertical = -(R**3) / (E * I) * (np.pi * k1 / 4 - 2 * k2**2 / np.pi)
    across = R**3 / (E * I) * (2 * k2**2 / np.pi - k2 + k1 / 2)
    assert 2 * u[8, 1] == pytest.approx(vertical, rel=1e-3)
    assert 2 * u[0, 0] == pytest.approx(across, rel=1e-3)


def test_a_quarter_of_a_ring_under_a_force_across_its_plane():
    """w = F R³ (π/4/(E I) + (3π/4 − 2)/(G J)) of a slender one (Castigliano)."""
    R, I, J, A = 2.0, 3e-8, 5e-8, 4e-2
    angle = np.linspace(0, np.pi / 2, 9)
    x = np.column_stack([R * np.cos(angle), R * np.sin(angle), 0 * angle])
    force = np.zeros(54)
    force[50] = 1.0
    u = Arch(x, (0.0, 0.0, 1.0), properties(4, A, np.diag([I, I]), J, SHEAR)).moved({0: range(6)}, force)
    expected = R**3 * (np.pi / 4 / (E * I) + (3 * np.pi / 4 - 2) * 2.6 / (E * J))
    assert u[8, 2] == pytest.approx(expected, rel=1e-3)


def test_pin_ended_double_cross_fv2():
    """NAFEMS FV2 with five elements an arm: within 1 % (with four 1.2 %)."""
    nodes, cells, fixed = [np.zeros(3)], [], {}
    for arm in range(8):
        along = np.array([np.cos(arm * np.pi / 4), np.sin(arm * np.pi / 4), 0.0])
        first = len(nodes)
        nodes += [0.5 * step * along for step in range(1, 11)]
        cells += [[first + 2 * i - 1 if i else 0, first + 2 * i + 1, first + 2 * i] for i in range(5)]
        fixed[first + 9] = (0, 1)
    for node in range(len(nodes)):
        fixed[node] = (*fixed.get(node, ()), 2, 3, 4)
    frame = Arch(nodes, (0.0, 0.0, 1.0), rectangle(40, 0.125, 0.125, SHEAR), DENSITY, cells)
    target = np.array([11.336, *[17.709] * 7, 45.345, *[57.390] * 7])
    np.testing.assert_allclose(frame.frequencies(fixed, 16), target, rtol=0.01)


def test_cantilever_with_masses_off_its_centre_fv4():
    """NAFEMS FV4 with five elements: within 1 %."""
    second = np.pi * 0.25**4 / 4
    own = properties(5, np.pi * 0.25**2, np.diag([second] * 2), 2 * second, (0.9, 0.9))
    frame = Arch(line(5, 10.0), (0.0, 1.0, 0.0), own, DENSITY)
    for mass, y in ((10_000.0, 2.0), (1_000.0, -2.0)):
        G = np.zeros((3, 6))
        G[:, :3] = np.eye(3)
        G[:, 3:] = np.array([[0, 0, -y], [0, 0, 0], [y, 0, 0]])
        frame.M[60:, 60:] += mass * G.T @ G
    target = np.array([1.723, 1.727, 7.413, 9.972, 18.155, 26.957])
    np.testing.assert_allclose(frame.frequencies({0: range(6)}, 6), target, rtol=0.01)


def test_deep_simply_supported_beam_fv5():
    """NAFEMS FV5 with five elements: within 1 % of its targets; with ten within 0.2 % of Timoshenko's theory."""

    def frequencies(count):
        own = rectangle(count, 2.0, 2.0, shear=SHEAR, torsion=2 * 16 / 12)
        beam = Arch(line(count, 10.0), (0.0, 1.0, 0.0), own, DENSITY)
        return beam.frequencies({0: (0, 1, 2, 3), 2 * count: (1, 2)}, 9)

    target = np.array([42.649, 42.649, 77.542, 125.0, 148.31, 148.31, 233.10, 284.55, 284.55])
    np.testing.assert_allclose(frequencies(5), target, rtol=0.01)
    exact = [timoshenko_pinned(n, 10.0, E, E / 2.6, DENSITY, 4.0, 16 / 12, 5 / 6) for n in (1, 2, 3)]
    np.testing.assert_allclose(frequencies(10)[[0, 4, 7]], exact, rtol=2e-3)


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
