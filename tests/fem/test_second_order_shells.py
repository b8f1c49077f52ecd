"""Second-order shells by themselves: rigid motions, symmetries, patches in states of constant strain, mass, their errors."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from strainsight.errors import DeckError
from strainsight.fem.shells import shell_masses, shell_stiffnesses, shell_strain_rows

from .second_order import KINDS, MIDDLES, square
from .shell_models import frequencies, isotropic, mass, rigid_motions, rows, rows_of, stiffness, summed, unit_square
from .test_shell_elements import AREA, OUTER, QUADS, STATES, XY, along, coupled, general_section, motions, stiff
from .test_shell_frequencies import CANTILEVER, CLAMPED, FREE, NU, PLATES, RHO, TAPERED, E, ritz

LARGEST = {("quad8", False): 4e-3, ("tri6", False): 5e-3, ("quad8", True): 0.012, ("tri6", True): 0.033}
"""Error of frequencies, and of the rhombus."""
CENTRE = {"quad8": (0.0, 0.0), "tri6": (1 / 3, 1 / 3)}
ONE = np.array([1])


def with_middles(x: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes in the middle of every side of cells (e, 3 or 4) of corners x (n, c)."""
    k = cells.shape[1]
    ends = np.array(MIDDLES[2 * k])
    sides = np.sort(cells[:, ends].reshape(-1, 2), axis=1)
    unique, where = np.unique(sides, axis=0, return_inverse=True)
    return np.vstack([x, x[unique].mean(axis=1)]), np.hstack([cells, len(x) + where.reshape(-1, k)])


def patch(kind: str, bow: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The patch of MacNeal & Harder (1985) with nodes on its sides: xy, cells, and which nodes lie on its outline; bow: how far
    those inside are moved, of the largest side."""
    corners = QUADS if kind == "quad8" else np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])
    xy, cells = with_middles(XY, corners)
    low, high = OUTER.min(axis=0), OUTER.max(axis=0)
    outline = ((np.abs(xy - low) < 1e-12) | (np.abs(xy - high) < 1e-12)).any(axis=1)
    moved = ~outline & (np.arange(len(xy)) >= len(XY))
    xy[moved] += bow * np.random.default_rng(1).uniform(-1, 1, (moved.sum(), 2))
    return xy, cells, outline


def bent(kind: str, seed: int = 0) -> np.ndarray:
    """One element of a surface that is curved both ways, its nodes anywhere near their places."""
    a, b, cells = square(1, 1, kind)
    x = np.column_stack([1.3 * a, b + 0.2 * a, 0.2 * a**2 - 0.15 * b**2 + 0.1 * a * b])[cells[0]]
    return x + np.random.default_rng(seed).uniform(-0.04, 0.04, x.shape)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("offset", [0.0, 0.07])
def test_only_the_six_rigid_motions_are_free(kind, offset):
    """K R = 0 to rounding of flat and curved ones, with couplings of all kinds, and no other motion is free."""
    flat = bent(kind) * [1, 1, 0]
    for x in (flat, bent(kind), bent(kind, 1)):
        for section in (isotropic(1.0, 0.3, 0.1, 1), general_section(3)):
            K = stiff(x, section, offset)
            assert np.abs(K @ rigid_motions(x)).max() < 1e-13 * np.abs(K).max()
            np.testing.assert_allclose(K, K.T, atol=1e-14 * np.abs(K).max())
            values = np.linalg.eigvalsh(K)
            assert np.abs(values[:6]).max() < 1e-14 * values[-1]
            assert values[6] > 1e-8 * values[-1]


@pytest.mark.parametrize("kind", KINDS)
def test_rigid_motions_have_no_strain(kind):
    for at in (CENTRE[kind], (0.3, 0.2)):
        found = shell_strain_rows(bent(kind)[None], np.array([at]), np.array([0.3]), np.array([-0.1]), ONE)[0]
        assert np.abs(found @ rigid_motions(bent(kind))).max() < 1e-13


@pytest.mark.parametrize("kind", KINDS)
def test_turned_in_space_it_is_the_same(kind):
    x, section = bent(kind), general_section(5)
    R = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    both, K = np.kron(np.eye(2 * len(x)), R), stiff(x, section, 0.02)
    turned = stiff(x @ R.T + [3.0, -1.0, 2.0], section, 0.02)
    np.testing.assert_allclose(turned, both @ K @ both.T, atol=1e-12 * np.abs(K).max())


@pytest.mark.parametrize("kind", KINDS)
def test_whichever_corner_comes_first_it_is_the_same(kind):
    """Of an isotropic section; from the other side, which turns the normal, with the offset turned too."""
    x, section = bent(kind), isotropic(1.0, 0.3, 0.1, 1)
    K, c = stiff(x, section, 0.02), len(x) // 2
    rolled, back = np.roll(np.arange(c), 1), np.arange(c)[::-1]
    for corners, offset in ((rolled, 0.02), (back, -0.02)):
        name = {frozenset(ends): c + i for i, ends in enumerate(MIDDLES[len(x)])}
        middles = [name[frozenset((int(corners[i]), int(corners[j])))] for i, j in MIDDLES[len(x)]]
        order = np.array([*corners, *middles])
        at = (6 * order[:, None] + np.arange(6)).ravel()
        np.testing.assert_allclose(stiff(x[order], section, offset), K[np.ix_(at, at)], atol=1e-12 * np.abs(K).max())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(("state", "bow"), [*((state, 0.0) for state in STATES), ("stretched", 0.003)])
def test_a_patch_holds_constant_strain(kind, state, bow):
    """With the outer nodes held in the state, inner ones are in it, strain at every point is that, to 1e-10; of a membrane with
    curved sides too. Bent, w is quadratic in x and y, which curved sides cannot hold: there see the next test."""
    xy, cells, outline = patch(kind, bow)
    R = Rotation.from_rotvec([0.4, -0.8, 1.3]).as_matrix()
    x = np.column_stack([xy, 0 * xy[:, 0]]) @ R.T
    count = len(cells)
    K = stiffness(x, cells, 1e6, 0.25, 1e-3)
    exact = (motions(xy, *STATES[state]).reshape(-1, 2, 3) @ R.T).ravel()
    held, free = rows(outline), rows(~outline)
    u = exact.copy()
    u[free] = spsolve(K[free][:, free], -K[free][:, held] @ exact[held])
    np.testing.assert_allclose(u, exact, atol=1e-9 * np.abs(exact).max())
    strain, kappa = map(np.array, STATES[state])
    # along the sides of the corners
    one = x[cells[:, 1]] - x[cells[:, 0]]
    axes = np.stack([one / np.linalg.norm(one, axis=1)[:, None]] * 3, axis=2)
    for at in (CENTRE[kind], (0.3, 0.5)):
        for z in (0.0, 5e-4, -5e-4):
            read = shell_strain_rows(x[cells], np.tile(at, (count, 1)), np.full(count, z), np.zeros(count), np.arange(count))
            found = np.einsum("eij,ej->ei", read, u[rows_of(cells)])
            expected = along(axes, R) @ (strain + z * kappa)
            np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(strain + 5e-4 * kappa).max())


@pytest.mark.parametrize("kind", KINDS)
def test_bent_patches_with_curved_sides_tend_to_constant_curvature(kind):
    """Energy of bending and twist with every side inside bowed by a tenth of it, however thin the plate is, the outline held in
    the state: 6e-4 too large at most with 4 × 4, 1e-4 with 16 × 16 elements."""

    def error(n: int, t: float) -> float:
        a, b, cells = square(n, n, kind)
        middle = ((2 * n * a) % 2 == 1) | ((2 * n * b) % 2 == 1)
        outline = (a % 1 == 0) | (b % 1 == 0)
        bow = np.where(middle & ~outline, 0.1 / n, 0.0)
        xy = np.column_stack([a + bow * np.sin(31 * b), b + bow * np.cos(17 * a)])
        kappa = np.array([0.02, -0.05, 0.06])
        K = stiffness(np.column_stack([xy, 0 * a]), cells, 1.0, 0.25, t)
        u = motions(xy, np.zeros(3), kappa).ravel()
        held, free = rows(outline), rows(~outline)
        u[free] = spsolve(K[free][:, free], -K[free][:, held] @ u[held])
        D = isotropic(1.0, 0.25, t, 1)[2][0]
        return float(u @ K @ u / (kappa @ D @ kappa) - 1)

    assert 0 <= error(4, 1e-2) < 6e-4
    assert 0 <= error(4, 1e-3) < 7e-4
    assert 0 <= error(16, 1e-2) < 1e-4


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("offset", [0.0, 2e-3])
def test_constant_strain_has_the_energy_of_its_section(kind, offset):
    """½ (ε, κ)ᵀ [A B; B D] (ε, κ) area, with all couplings; the middle surface may lie off the nodes."""
    xy, cells, _ = patch(kind)
    x, count = np.column_stack([xy, 0 * xy[:, 0]]), len(cells)
    one = x[cells[:, 1]] - x[cells[:, 0]]
    axes = np.stack([one / np.linalg.norm(one, axis=1)[:, None]] * 3, axis=2)
    section, both = coupled(4), np.zeros((count, 6, 6))
    both[:, :3, :3] = both[:, 3:, 3:] = along(axes, np.eye(3))
    own = np.linalg.inv(both)
    C = own.swapaxes(1, 2) @ section @ own
    S = np.repeat(1e-3 * np.eye(2)[None], count, axis=0)
    K = shell_stiffnesses(x[cells], C[:, :3, :3], C[:, :3, 3:], C[:, 3:, 3:], S, np.full(count, offset), np.arange(count))
    rng = np.random.default_rng(2)
    strain, kappa = rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3) / 0.3e-3
    u = motions(xy, strain, kappa)
    u[:, 0] -= offset * u[:, 4]
    u[:, 1] += offset * u[:, 3]
    q, state = u.ravel()[rows_of(cells)], np.concatenate([strain, kappa])
    energy = np.einsum("ei,eij,ej->", q, K, q) / 2
    assert energy == pytest.approx(state @ section @ state / 2 * AREA, rel=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_constant_shear_has_the_energy_of_its_section(kind):
    """½ γᵀSγ area of w and θ that give γ = (w,x + θ_y, w,y − θ_x) without curvature, with curved sides; of a plate that does not
    bend, by extrapolation, as rotation may differ from that of the nodes within an element."""
    xy, cells, _ = patch(kind, 0.003)
    x, count = np.column_stack([xy, 0 * xy[:, 0]]), len(cells)
    A, B, D, _ = isotropic(1e6, 0.25, 1e-3, count)
    S = np.repeat(np.diag([3.0, 3.0])[None], count, axis=0)
    u = np.zeros((len(xy), 6))
    u[:, 2], u[:, 3], u[:, 4] = 0.3 * xy[:, 0] - 0.7 * xy[:, 1], 0.4, -0.8
    q = u.ravel()[rows_of(cells)]

    def energy(stiffer: float) -> float:
        K = shell_stiffnesses(x[cells], A, B, stiffer * D, S, np.zeros(count), np.arange(count))
        return float(np.einsum("ei,eij,ej->", q, K, q))

    gamma = np.array([0.3 - 0.8, -0.7 - 0.4])
    assert (10 * energy(1e8) - energy(1e7)) / 9 == pytest.approx(3 * gamma @ gamma * AREA, rel=1e-8)


def test_quads_bend_in_their_plane_as_a_beam_whatever_their_corners():
    """u = κ x y, v = −κ(x² + ν y²)/2 on trapezoids: ε_xx = κ y, and inner nodes follow those of the outline."""
    a, b, cells = square(4, 2, "quad8")
    x = np.column_stack([4 * a + np.interp(4 * a, range(5), [0, 0.3, -0.3, 0.3, 0]) * (1 - 2 * b), 2 * b - 1, 0 * a])
    nu, kappa = 0.3, 0.2
    K = stiffness(x, cells, 1.0, nu, 0.01)
    X, Y = x[:, 0], x[:, 1]
    exact = np.zeros((len(x), 6))
    exact[:, 0], exact[:, 1], exact[:, 5] = kappa * X * Y, -kappa * (X**2 + nu * Y**2) / 2, -kappa * X
    outline = (a % 1 == 0) | (b % 1 == 0)
    held, free = rows(outline), rows(~outline)
    u = exact.ravel().copy()
    u[free] = spsolve(K[free][:, free], -K[free][:, held] @ u[held])
    np.testing.assert_allclose(u, exact.ravel(), atol=1e-9)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("offset", [0.0, 0.3])
def test_the_mass_of_rigid_motions_is_that_of_the_body(kind, offset):
    """Of a rectangle a × b of thickness t, with its middle surface `offset` above the nodes."""
    a, b, t, rho = 2.0, 1.0, 0.2, 5.0
    s, r, corners = unit_square(4, 3, "quad4" if kind == "quad8" else "tri3")
    inner = (s > 0) & (s < 1) & (r > 0) & (r < 1)
    x = np.column_stack([a * (s - 0.5), b * (r - 0.5), 0 * s])
    x[inner, :2] += np.random.default_rng(1).uniform(-0.1, 0.1, (inner.sum(), 2))
    x, cells = with_middles(x, corners)
    R = rigid_motions(x)
    M = R.T @ (mass(x, cells, rho, t, offset) @ R)
    m, arm = rho * a * b * t, np.cross(np.eye(3), [0, 0, offset])
    inertia = m / 12 * np.diag([b**2 + t**2, a**2 + t**2, a**2 + b**2]) + m * arm @ arm.T
    np.testing.assert_allclose(M, np.block([[m * np.eye(3), m * arm.T], [m * arm, inertia]]), atol=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_masses_are_positive_but_for_the_rotation_about_the_normal(kind):
    values = np.linalg.eigvalsh(shell_masses(bent(kind)[None], np.ones(1), np.full(1, 0.01), np.zeros(1), ONE)[0])
    assert np.abs(values[: len(bent(kind))]).max() < 1e-15
    assert values[len(bent(kind))] > 1e-6


@pytest.mark.parametrize("kind", KINDS)
def test_nothing_locks_however_thin_it_is(kind):
    """Deflections times t³ of a clamped cylinder's panel under a moment along its end, which bends without stretch."""
    a, b, cells = square(4, 2, kind)
    x = np.column_stack([np.sin(a), 0.5 * b, np.cos(a)])
    found = []
    for t in (1e-2, 1e-3, 1e-4):
        K = stiffness(x, cells, 1.0, 0.0, t)
        f = np.zeros((len(x), 6))
        f[a == 1, 4] = 1.0
        free = np.setdiff1d(np.arange(6 * len(x)), rows(a == 0))
        found.append(t**3 * f.ravel()[free] @ spsolve(K[free][:, free], f.ravel()[free]))
    np.testing.assert_allclose(found, found[0], rtol=2e-2)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", PLATES)
def test_plates_have_the_frequencies_of_mindlin_theory(name, kind):
    """FV12, FV16 and FV22 with 8 × 8 elements, each as two triangles: off by 0.4 and 0.5 % at most; in the rhombus, whose corners
    are singular, by 1.2 and 3.3 % (its fifth mode)."""
    sides, t, supports, skip, targets = PLATES[name]
    a, b, cells = square(8, 8, kind)
    x = np.column_stack([np.stack([a, b], axis=1) @ sides, 0 * a])
    edge = {id(FREE): a > 2, id(CANTILEVER): a == 0, id(CLAMPED): (a % 1 == 0) | (b % 1 == 0)}[id(supports)]
    held = np.union1d(rows(np.arange(len(x)), (0, 1, 5)), rows(edge))
    K, M = stiffness(x, cells, E, NU, t), mass(x, cells, RHO, t)
    found = frequencies(K, M, held, skip + len(targets), -1.0)[skip:]
    np.testing.assert_allclose(found, ritz(*PLATES[name][:4], len(targets)), rtol=LARGEST[kind, name == "FV22"])


@pytest.mark.parametrize("kind", KINDS)
def test_the_tapered_membrane_has_the_frequencies_of_nafems(kind):
    """FV32 with 8 × 4 elements, as NAFEMS has it: within 0.5 %, with twice as many triangles within 1 %."""
    a, b, cells = square(8, 4, kind)
    x = np.column_stack([10 * a, (5 - 4 * a) * (b - 0.5), 0 * a])
    held = np.union1d(rows(np.arange(len(x)), (2, 3, 4)), rows(a == 0))
    found = frequencies(stiffness(x, cells, E, NU, 0.05), mass(x, cells, RHO, 0.05), held, 6, -1.0)
    np.testing.assert_allclose(found, TAPERED, rtol=5e-3 if kind == "quad8" else 1e-2)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_folded_is_refused_by_its_id(kind):
    """A node of a side that stands beyond the other side turns the surface over."""
    good = bent(kind) * [1, 1, 0]
    x = good.copy()
    x[len(x) // 2] = x[: len(x) // 2].mean(axis=0) * 2 - x[len(x) // 2]
    with pytest.raises(DeckError, match="folded: 12") as error:
        shell_stiffnesses(np.stack([good, x]), *isotropic(1.0, 0.3, 0.1, 2), np.zeros(2), np.array([11, 12]))
    assert error.value.entity == ("element", 12)


def test_quads_and_triangles_have_the_mass_of_a_half_cylinder():
    """ρ t π R L to 1e-4 with six along the arc."""
    for kind in KINDS:
        a, b, cells = square(6, 1, kind)
        x = np.column_stack([np.cos(np.pi * a), np.sin(np.pi * a), 2 * b])
        R = rigid_motions(x)[:, :3]
        e = len(cells)
        M = summed(shell_masses(x[cells], np.ones(e), np.zeros(e), np.zeros(e), np.arange(e)), cells, len(x))
        np.testing.assert_allclose(R.T @ (M @ R), 2 * np.pi * np.eye(3), atol=6e-4)
