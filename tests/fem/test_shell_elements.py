"""A shell element by itself: rigid motions, symmetries, mass, its errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.errors import DeckError
from strainsight.fem.shells import shell_axes, shell_masses, shell_stiffnesses, shell_strain_rows

from .shell_models import KINDS, halved, isotropic, mass, rigid_motions, stiffness, unit_square

ONE = np.array([1])
NONE = np.zeros(1)

SHAPES = {
    "square": np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]),
    "skewed": np.array([[0.0, 0, 0], [1.3, 0.2, 0], [1.7, 1.1, 0], [0.3, 0.7, 0]]),
    "warped": np.array([[0.0, 0, 0.1], [1.3, 0.2, -0.2], [1.7, 1.1, 0.15], [0.3, 0.7, -0.1]]),
    "triangle": np.array([[0.1, 0, 0.4], [1.3, 0.2, 0], [0.3, 0.9, 0.2]]),
    "sliver": np.array([[0.0, 0, 0], [1.0, 0, 0], [0.9, 0.15, 0]]),
}


def general_section(seed: int) -> tuple[np.ndarray, ...]:
    """A, B, D, S that couple everything, of a shell of a thickness of about 0.1 m."""
    rng = np.random.default_rng(seed)
    root = rng.uniform(-1, 1, (6, 6)) + 2 * np.eye(6)
    root[:, 3:] *= 0.03
    C = root.T @ root
    S = 0.3 * np.eye(2) + 0.05 * np.ones((2, 2))
    return C[None, :3, :3], C[None, :3, 3:], C[None, 3:, 3:], S[None]


def stiff(x: np.ndarray, section: tuple[np.ndarray, ...], offset: float = 0.0) -> np.ndarray:
    return shell_stiffnesses(x[None], *section, np.array([offset]), ONE)[0]


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("offset", [0.0, 0.07])
def test_only_the_six_rigid_motions_are_free(name, offset):
    """K R = 0 to rounding, and the seventh eigenvalue is a million times the sixth: with couplings of all kinds."""
    x = SHAPES[name]
    for section in (isotropic(1.0, 0.3, 0.1, 1), general_section(3)):
        K = stiff(x, section, offset)
        assert np.abs(K @ rigid_motions(x)).max() < 1e-13 * np.abs(K).max()
        np.testing.assert_allclose(K, K.T, atol=1e-14 * np.abs(K).max())
        values = np.linalg.eigvalsh(K)
        assert np.abs(values[:6]).max() < 1e-14 * values[-1]
        assert values[6] > 1e-8 * values[-1]


@pytest.mark.parametrize("name", SHAPES)
def test_rigid_motions_have_no_strain(name):
    x = SHAPES[name]
    for at in ([0.0, 0.0], [0.4, 0.2]):
        found = shell_strain_rows(x[None], np.array([at]), np.array([0.3]), np.array([-0.1]), ONE)[0]
        assert np.abs(found @ rigid_motions(x)).max() < 1e-13


@pytest.mark.parametrize("name", SHAPES)
def test_turned_in_space_it_is_the_same(name):
    x, section = SHAPES[name], general_section(5)
    R = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    both = np.kron(np.eye(2 * len(x)), R)
    K = stiff(x, section, 0.02)
    turned = stiff(x @ R.T + [3.0, -1.0, 2.0], section, 0.02)
    np.testing.assert_allclose(turned, both @ K @ both.T, atol=1e-13 * np.abs(K).max())


@pytest.mark.parametrize("name", SHAPES)
def test_whichever_node_comes_first_it_is_the_same(name):
    """Of an isotropic section; from the other side, which turns the normal, with the offset turned too."""
    x, section = SHAPES[name], isotropic(1.0, 0.3, 0.1, 1)
    K = stiff(x, section, 0.02)
    k = len(x)
    for order, offset in ((np.roll(np.arange(k), 1), 0.02), (np.arange(k)[::-1], -0.02)):
        at = (6 * order[:, None] + np.arange(6)).ravel()
        found = stiff(x[order], section, offset)
        np.testing.assert_allclose(found, K[np.ix_(at, at)], atol=1e-12 * np.abs(K).max())


@pytest.mark.parametrize("name", SHAPES)
def test_it_scales_with_its_section(name):
    x, section = SHAPES[name], general_section(7)
    np.testing.assert_allclose(
        stiff(x, tuple(7.5e10 * X for X in section)), 7.5e10 * stiff(x, section), rtol=1e-12, atol=1e-3
    )


def test_a_membrane_and_a_plate_alone_leave_the_rest_free():
    """Without D and S a quad holds two translations and the drilling rotation, without A the other three motions."""
    A, B, D, S = isotropic(1.0, 0.3, 0.1, 1)
    for name, kept in (("skewed", 12), ("sliver", 9)):
        x = SHAPES[name]
        membrane, plate = stiff(x, (A, B, 0 * D, 0 * S)), stiff(x, (0 * A, B, D, S))
        assert np.linalg.matrix_rank(membrane, 1e-9) == kept - 3
        flat = np.setdiff1d(np.arange(6 * len(x)), [6 * i + c for i in range(len(x)) for c in (2, 3, 4)])
        across = np.setdiff1d(np.arange(6 * len(x)), flat)
        assert not membrane[across].any()
        assert np.linalg.matrix_rank(plate[np.ix_(across, across)], 1e-9) == kept - 3


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("offset", [0.0, 0.3])
def test_the_mass_of_rigid_motions_is_that_of_the_body(kind, offset):
    """Of a rectangle a × b of thickness t, with its middle surface `offset` above the nodes: m, its first moments, and
    m(b² + t²)/12, m(a² + t²)/12 about its own axes, m(a² + b²)/12 about the normal."""
    a, b, t, rho = 2.0, 1.0, 0.2, 5.0
    s, r, cells = unit_square(4, 3, kind)
    inner = (s > 0) & (s < 1) & (r > 0) & (r < 1)
    rng = np.random.default_rng(1)
    x = np.column_stack([a * (s - 0.5), b * (r - 0.5), 0 * s])
    x[inner, :2] += rng.uniform(-0.1, 0.1, (inner.sum(), 2))
    motions = rigid_motions(x)
    M = motions.T @ (mass(x, cells, rho, t, offset) @ motions)
    m, arm = rho * a * b * t, np.cross(np.eye(3), [0, 0, offset])  # u = φ × (0, 0, d)
    inertia = m / 12 * np.diag([b**2 + t**2, a**2 + t**2, a**2 + b**2]) + m * arm @ arm.T
    expected = np.block([[m * np.eye(3), m * arm.T], [m * arm, inertia]])
    np.testing.assert_allclose(M, expected, atol=1e-12)


def test_masses_are_positive_but_for_the_rotation_about_the_normal():
    for x in SHAPES.values():
        M = shell_masses(x[None], np.ones(1), np.full(1, 0.01), NONE, ONE)[0]
        values = np.linalg.eigvalsh(M)
        assert np.abs(values[: len(x)]).max() < 1e-15
        assert values[len(x)] > 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_a_pull_beside_the_middle_surface_bends(kind):
    """F at nodes that lie d off it, ν = 0: u = F L/(E A) + F d² L/(E I), φ = F d L/(E I), as a beam is."""
    L, b, t, E, d, F = 3.0, 0.5, 0.1, 2.0e5, 0.08, 7.0
    s, r, cells = unit_square(6, 2, kind)
    x = np.column_stack([L * s, b * r, 0 * s])
    K = stiffness(x, cells, E, 0.0, t, offset=-d)
    I = b * t**3 / 12
    u = np.zeros((len(x), 6))
    # middle surface at z = −d: strain F/(E A) there and constant curvature of the moment F d about it
    kappa, strain = F * d / (E * I), F / (E * b * t)
    u[:, 0] = (strain + d * kappa) * x[:, 0]
    u[:, 2] = -kappa * x[:, 0] ** 2 / 2
    u[:, 4] = kappa * x[:, 0]
    force = np.zeros_like(u)
    tip = x[:, 0] == L
    force[tip, 0] = F * np.where((r[tip] == 0) | (r[tip] == 1), 0.25, 0.5)
    inside = x[:, 0] > 0
    residual = (K @ u.ravel()).reshape(-1, 6) - force
    assert np.abs(residual[inside][:, [0, 2, 4]]).max() < 1e-10 * F


def test_axes_follow_the_nodes():
    """z along the cross product of the diagonals, x along the first side as seen along z."""
    x = SHAPES["warped"]
    axes = shell_axes(x[None], ONE)[0]
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert abs(axes[:, 2] @ (x[2] - x[0])) < 1e-15 > abs(axes[:, 2] @ (x[3] - x[1]))
    assert abs(axes[:, 1] @ (x[1] - x[0])) < 1e-15 < axes[:, 0] @ (x[1] - x[0])
    np.testing.assert_allclose(shell_axes(SHAPES["square"][None], ONE)[0], np.eye(3), atol=1e-15)


@pytest.mark.parametrize(
    ("nodes", "word"),
    [
        ([[0, 0], [1, 0], [1, 0], [0, 0]], "no area"),
        ([[0, 0], [1, 0], [0, 1], [1, 1]], "no area"),  # crossed: its diagonals are parallel
        ([[0, 0], [2, 0], [0.3, 1.5], [1, 1]], "turns back"),  # crossed
        ([[0, 0], [1, 0], [0.2, 0.2], [0, 1]], "turns back"),  # re-entrant
        ([[0, 0], [1, 0], [0.5, 0.5], [0, 1]], "turns back"),  # a straight corner
        ([[0, 0], [1, 0], [2, 0]], "no area"),
    ],
)
def test_what_is_no_shell_is_refused_by_its_id(nodes, word):
    x = np.column_stack([np.array(nodes, float), np.zeros(len(nodes))])
    good = SHAPES["square"][: len(nodes)]
    with pytest.raises(DeckError, match=word) as error:
        shell_axes(np.stack([good, x]), np.array([11, 12]))
    assert error.value.entity == ("element", 12)
    assert "12" in str(error.value)
    assert "11" not in str(error.value)


def test_two_triangles_have_the_mass_of_their_quad():
    x, quad = SHAPES["skewed"], np.array([[0, 1, 2, 3]])
    motions = rigid_motions(x)[:, :3]
    one, two = (motions.T @ (mass(x, cells, 3.0, 0.1) @ motions) for cells in (quad, halved(quad)))
    np.testing.assert_allclose(one, two, rtol=1e-13, atol=1e-15)
