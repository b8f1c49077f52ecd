"""Beams of two and three nodes: frequencies by NAFEMS and closed forms, statics of curved ones, and strains of their sides."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy import optimize
from scipy.sparse.linalg import spsolve

from strainsight.decks.reader import read_mesh
from strainsight.errors import DeckError
from strainsight.fem.beam_matrices import (
    beam_masses,
    curved_beam_masses,
    curved_beam_stiffnesses,
    rod_masses,
    rod_stiffnesses,
)
from strainsight.fem.checks import check_mesh
from strainsight.fem.model import build_model, nodal
from strainsight.fem.recovery import facet_strain
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.thin_faces import with_sides

from ..beams import Arch, Frame, axes_of, line, properties, rectangle, threes
from .shell_models import rigid_motions
from .strain_rows import beam_strain_rows

E, DENSITY = 200e9, 8000.0
SHEAR = (5 / 6, 5 / 6)


def timoshenko_pinned(n, length, E, G, density, area, second, k):
    """Frequencies [Hz] of a simply supported Timoshenko beam: v = V sin(nπx/L), θ = Θ cos(nπx/L), the lower branch."""
    a = n * np.pi / length
    K = np.array([[k * G * area * a**2, -k * G * area * a], [-k * G * area * a, k * G * area + E * second * a**2]])
    M = np.diag([density * area, density * second])
    return np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).min()) / (2 * np.pi)


@pytest.mark.parametrize(("kind", "count"), [(Frame, 4), (Arch, 5)])
def test_pin_ended_double_cross_fv2(kind, count):
    """NAFEMS FV2: eight arms of 5 m, 0.125 m square, in their plane; elements an arm (with four of three nodes 1.2 %)."""
    nodes, cells, fixed, steps = [np.zeros(3)], [], {}, count if kind is Frame else 2 * count
    for arm in range(8):
        along = np.array([np.cos(arm * np.pi / 4), np.sin(arm * np.pi / 4), 0.0])
        own = [0, *range(len(nodes), len(nodes) + steps)]
        nodes += [5 * step / steps * along for step in range(1, steps + 1)]
        cells += list(pairwise(own)) if kind is Frame else threes(own).tolist()
        fixed[own[-1]] = (0, 1)
    for node in range(len(nodes)):
        fixed[node] = (*fixed.get(node, ()), 2, 3, 4)
    section = rectangle(8 * count, 0.125, 0.125, (0.0, 0.0) if kind is Frame else SHEAR)
    target = np.array([11.336, *[17.709] * 7, 45.345, *[57.390] * 7])
    found = kind(nodes, cells, (0.0, 0.0, 1.0), section, E, DENSITY).frequencies(fixed, 16)
    np.testing.assert_allclose(found, target, rtol=0.01)


def straight(kind, count, section, **more):
    """Elements along x over 10 m."""
    nodes, pairs = line(count if kind is Frame else 2 * count, 10.0)
    return kind(nodes, pairs if kind is Frame else threes(range(len(nodes))), (0.0, 1.0, 0.0), section, E, DENSITY, **more)


@pytest.mark.parametrize("kind", [Frame, Arch])
def test_cantilever_with_masses_off_its_centre_fv4(kind):
    """NAFEMS FV4: 10 m, 0.5 m round, 10 t and 1 t at ±2 m beside its tip, five elements."""
    second = np.pi * 0.25**4 / 4
    shear = (0.0, 0.0) if kind is Frame else (0.9, 0.9)
    frame = straight(kind, 5, properties(5, np.pi * 0.25**2, np.diag([second] * 2), 2 * second, shear))
    for mass, y in ((10_000.0, 2.0), (1_000.0, -2.0)):
        G = np.zeros((3, 6))  # u + θ × r
        G[:, :3] = np.eye(3)
        G[:, 3:] = np.array([[0, 0, -y], [0, 0, 0], [y, 0, 0]])
        frame.M[-6:, -6:] += mass * G.T @ G
    target = np.array([1.723, 1.727, 7.413, 9.972, 18.155, 26.957])
    np.testing.assert_allclose(frame.frequencies({0: range(6)}, 6), target, rtol=0.01)


@pytest.mark.parametrize(("kind", "count", "within"), [(Frame, 20, 1e-3), (Arch, 5, 2e-3)])
def test_deep_simply_supported_beam_fv5(kind, count, within):
    """NAFEMS FV5, 10 m, 2 m square, J of its polar moment as the target of its torsion has it: within 1 %; with twice as many
    elements it is Timoshenko's."""

    def frequencies(count):
        section = rectangle(count, 2.0, 2.0, SHEAR, torsion=2 * 16 / 12)
        beam = straight(kind, count, section, **({"rotary": True} if kind is Frame else {}))
        return beam.frequencies({0: (0, 1, 2, 3), len(beam.nodes) - 1: (1, 2)}, 9)

    target = np.array([42.649, 42.649, 77.542, 125.0, 148.31, 148.31, 233.10, 284.55, 284.55])
    np.testing.assert_allclose(frequencies(count), target, rtol=0.01)
    exact = [timoshenko_pinned(n, 10.0, E, E / 2.6, DENSITY, 4.0, 16 / 12, 5 / 6) for n in (1, 2, 3)]
    np.testing.assert_allclose(frequencies(2 * count)[[0, 4, 7]], exact, rtol=within)


def test_euler_beam_without_shear_or_rotary_inertia():
    """A clamped-free beam: cos βL cosh βL = −1."""
    own = rectangle(12, 0.02, 0.05)
    frame = Frame(*line(12, 2.0, (0.6, 0.0, 0.8)), (0.0, 1.0, 0.0), own, E, DENSITY)
    found = frame.frequencies({0: range(6)}, 4)
    beta = [optimize.brentq(lambda b: np.cos(b) + 1 / np.cosh(b), x - 0.5, x + 0.5) for x in (1.875, 4.694, 7.855)]
    root = np.sqrt(E / DENSITY / 12) / (2 * np.pi * 2.0**2)
    exact = np.sort([b**2 * h * root for b in beta for h in (0.02, 0.05)])[:4]
    np.testing.assert_allclose(found, exact, rtol=1e-4)


def test_mass_of_a_rigid_motion_is_that_of_the_body():
    """Tᵀ M T of the six rigid motions against the integral over the line, tapered and with offsets."""
    rng = np.random.default_rng(4)
    position, offset = rng.normal(size=(3, 2, 3)), 0.2 * rng.normal(size=(3, 2, 3))
    ends = position + offset
    axes, m = axes_of(ends, (0.3, 0.2, 0.9)), rng.uniform(1, 3, (3, 2))
    half = rng.normal(size=(3, 2, 2, 2))
    rotary = half @ half.swapaxes(2, 3)
    M = beam_masses(position, axes, m, offset, np.arange(3), rotary)
    cross = lambda r: np.array([[0, r[2], -r[1]], [-r[2], 0, r[0]], [r[1], -r[0], 0]])  # noqa: E731  θ × r
    simpson = {0.0: 1 / 6, 0.5: 4 / 6, 1.0: 1 / 6}  # exact: the integrand is cubic
    for e in range(3):
        rigid = rigid_motions(position[e])
        L, exact = np.linalg.norm(ends[e, 1] - ends[e, 0]), np.zeros((6, 6))
        for t, w in simpson.items():
            G = np.hstack([np.eye(3), cross((1 - t) * ends[e, 0] + t * ends[e, 1])])
            exact += w * L * ((1 - t) * m[e, 0] + t * m[e, 1]) * G.T @ G
            S = (1 - t) * rotary[e, 0] + t * rotary[e, 1]
            inertia = np.zeros((3, 3))  # ∫ ρ (r² I − r rᵀ) of r = (0, y, z)
            inertia[0, 0], inertia[1:, 1:] = np.trace(S), np.trace(S) * np.eye(2) - S
            exact[3:, 3:] += w * L * axes[e] @ inertia @ axes[e].T
        np.testing.assert_allclose(rigid.T @ M[e] @ rigid, exact, rtol=1e-12, atol=1e-12)
        assert np.linalg.eigvalsh(M[e]).min() > 0


def test_rod_in_a_line_rings_at_a_quarter_of_its_wave():
    count, L = 40, 3.0
    nodes, pairs = line(count, L, (0.48, 0.6, 0.64))
    ones = np.ones(count)
    k = E * rod_stiffnesses(nodes[pairs], 1e-4 * ones, 0 * ones, 0.3 * ones, np.arange(count))
    m = rod_masses(nodes[pairs], DENSITY * 1e-4 * ones, np.arange(count))
    K, M = np.zeros((3 * count + 3,) * 2), np.zeros((3 * count + 3,) * 2)
    own = np.array([0, 1, 2, 6, 7, 8])
    for i in range(count):
        K[3 * i : 3 * i + 6, 3 * i : 3 * i + 6] += k[i][np.ix_(own, own)]
        M[3 * i : 3 * i + 6, 3 * i : 3 * i + 6] += m[i][np.ix_(own, own)]
    along = np.kron(np.eye(count + 1), np.array([[0.48], [0.6], [0.64]]))[:, 1:]
    squares = np.linalg.eigvals(np.linalg.solve(along.T @ M @ along, along.T @ K @ along))
    assert np.sqrt(squares.real.min()) / (2 * np.pi) == pytest.approx(np.sqrt(E / DENSITY) / (4 * L), rel=1e-4)
    assert m[0].sum(axis=1)[0] == pytest.approx(DENSITY * 1e-4 * L / count / 2)


MODULUS, L, H = 70e9, 2.0, 0.05
CLAMP = {0: range(6)}


def strains(frame, u, at, y, z):
    """At the same place of every beam of a frame."""
    full = np.ones(len(frame.cells))
    rows = beam_strain_rows(
        frame.position, frame.axes, frame.own, frame.offset, frame.released, at * full, y * full, z * full
    )
    return np.einsum("en,en->e", rows, u.ravel()[frame.rows])


@pytest.mark.parametrize("shear", [(0.0, 0.0), SHEAR])
@pytest.mark.parametrize("at", [0.0, 0.3, 1.0])
def test_strain_of_a_loaded_cantilever(shear, at):
    b, P, Q, N, y, z = 0.03, 120.0, -40.0, 900.0, 0.02, -0.01
    frame = Frame(*line(4, L), (0, 1, 0), rectangle(4, H, b, shear), MODULUS)
    u = frame.solve(CLAMP, {(4, 0): N, (4, 1): P, (4, 2): Q})
    x = (np.arange(4) + at) * L / 4
    # E I v″ = P (L − x), E I w″ = Q (L − x)
    I1, I2 = b * H**3 / 12, H * b**3 / 12
    exact = N / (MODULUS * b * H) - y * P * (L - x) / (MODULUS * I1) - z * Q * (L - x) / (MODULUS * I2)
    np.testing.assert_allclose(strains(frame, u, at, y, z), exact, rtol=1e-9, atol=1e-9 * np.abs(exact).max())


def test_strain_of_a_tapered_cantilever_with_I12():
    S = np.array([[[3e-8, 9e-9], [9e-9, 8e-9]], [[2e-9, -4e-10], [-4e-10, 9e-10]]])
    A, P, N, y, z = np.array([2e-3, 4e-4]), 30.0, 500.0, 0.02, -0.01
    frame = Frame(*line(1, L, (0, 0.6, 0.8)), (1, 0, 0), properties(1, A, S, [1e-8, 1e-9]), MODULUS)
    pull = N * np.array([0, 0.6, 0.8])
    u = frame.solve(CLAMP, {(1, 0): P, (1, 1): pull[1], (1, 2): pull[2]})  # P along y of the beam
    for at in (0.0, 0.25, 0.9):
        (Iy, Iyz), (_, Iz) = (1 - at) * S[0] + at * S[1]
        M = P * (1 - at) * L  # E(Iy v″ + Iyz w″) = M, E(Iyz v″ + Iz w″) = 0
        v, w = np.array([Iz, -Iyz]) * M / (MODULUS * (Iy * Iz - Iyz**2))
        exact = N / (MODULUS * ((1 - at) * A[0] + at * A[1])) - y * v - z * w
        assert strains(frame, u, at, y, z)[0] == pytest.approx(exact, rel=1e-9)


def test_strain_of_an_offset_beam_with_a_pin():
    """Clamped at A, pinned to its node at B, 0.1 above both: a force at the node reaches the beam without a moment."""
    offset, released = np.tile([0.0, 0.1, 0.0], (1, 2, 1)), np.zeros((1, 2, 6), bool)
    released[0, 1, 5] = True
    frame = Frame(*line(1, L), (0, 1, 0), rectangle(1, H, 0.03), MODULUS, offset=offset, released=released)
    u = frame.solve({0: range(6), 1: (5,)}, {(1, 1): 50.0, (1, 0): 300.0})
    exact = 300.0 / (MODULUS * H * 0.03) - 0.02 * 50.0 * 0.6 * L / (MODULUS * 0.03 * H**3 / 12)
    assert strains(frame, u, 0.4, 0.02, 0.0)[0] == pytest.approx(exact, rel=1e-9)


def test_rigid_motions_and_absent_bending_leave_no_strain():
    frame = Frame(*line(1, L, (0, 0.6, 0.8)), (1, 0, 0), properties(1, 1e-3, np.zeros((2, 2)), 0.0), MODULUS)
    u = np.zeros((2, 6))
    u[1] = [0.1, 1e-3 * 0.6, 1e-3 * 0.8, 0.1, 0.2, 0.3]
    assert strains(frame, u, 0.5, 0.02, 0.03)[0] == pytest.approx(1e-3 / L)
    full = Frame(*line(1, L, (0, 0.6, 0.8)), (1, 0, 0), rectangle(1, H, 0.03), MODULUS)
    turn = np.array([0.3, -0.2, 0.5])
    rigid = np.array([[*np.cross(turn, node), *turn] for node in full.nodes])
    assert abs(strains(full, rigid, 0.2, 0.02, 0.03)[0]) < 1e-15


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
    with pytest.raises(DeckError, match=r"node 2 of beam3 element 11 lies at 0.8 of the side") as error, mesh.located():
        check_mesh(mesh)
    assert error.value.where.endswith("bar.inp:8")
