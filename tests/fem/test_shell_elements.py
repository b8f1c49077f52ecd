"""Shells: rigid motions, sections and masses, and patches of them; bending and curved surfaces of those of the second order."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from strainsight.errors import DeckError
from strainsight.fem.shells import shell_axes, shell_masses, shell_stiffnesses
from strainsight.fem.shells.matrices import Resistance

from .shell_models import (
    KINDS,
    MIDDLES,
    SECOND,
    halved,
    isotropic,
    mass,
    rigid_motions,
    rows,
    rows_of,
    stiffness,
    unit_square,
)
from .strain_rows import shell_strain_rows

ONE = np.array([1])
NONE = np.zeros(1)
ALL = (*KINDS, *SECOND)


def with_middles(x: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nodes in the middle of every side of cells (e, 3 or 4) of corners x (n, c)."""
    k = cells.shape[1]
    ends = np.array(MIDDLES[2 * k])
    sides = np.sort(cells[:, ends].reshape(-1, 2), axis=1)
    unique, where = np.unique(sides, axis=0, return_inverse=True)
    return np.vstack([x, x[unique].mean(axis=1)]), np.hstack([cells, len(x) + where.reshape(-1, k)])


def bent(kind: str) -> np.ndarray:
    """One element of a surface that is curved both ways, its nodes anywhere near their places."""
    a, b, cells = unit_square(1, 1, kind)
    x = np.column_stack([1.3 * a, b + 0.2 * a, 0.2 * a**2 - 0.15 * b**2 + 0.1 * a * b])[cells[0]]
    return x + np.random.default_rng(0).uniform(-0.04, 0.04, x.shape)


SHAPES = {
    "square": np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]),
    "skewed": np.array([[0.0, 0, 0], [1.3, 0.2, 0], [1.7, 1.1, 0], [0.3, 0.7, 0]]),
    "warped": np.array([[0.0, 0, 0.1], [1.3, 0.2, -0.2], [1.7, 1.1, 0.15], [0.3, 0.7, -0.1]]),
    "triangle": np.array([[0.1, 0, 0.4], [1.3, 0.2, 0], [0.3, 0.9, 0.2]]),
    "sliver": np.array([[0.0, 0, 0], [1.0, 0, 0], [0.9, 0.15, 0]]),
} | {f"{shape} {kind}": x for kind in SECOND for shape, x in (("flat", bent(kind) * [1, 1, 0]), ("bent", bent(kind)))}


def general_section(seed: int) -> tuple[np.ndarray, ...]:
    """A, B, D, S that couple everything, of a shell of a thickness of about 0.1 m."""
    rng = np.random.default_rng(seed)
    root = rng.uniform(-1, 1, (6, 6)) + 2 * np.eye(6)
    root[:, 3:] *= 0.03
    C = root.T @ root
    S = 0.3 * np.eye(2) + 0.05 * np.ones((2, 2))
    return C[None, :3, :3], C[None, :3, 3:], C[None, 3:, 3:], S[None]


def stiff(x: np.ndarray, section: tuple[np.ndarray, ...], offset: float = 0.0) -> np.ndarray:
    return shell_stiffnesses(x[None], Resistance(*section), np.array([offset]), ONE)[0]


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
    both, K = np.kron(np.eye(2 * len(x)), R), stiff(x, section, 0.02)
    turned = stiff(x @ R.T + [3.0, -1.0, 2.0], section, 0.02)
    np.testing.assert_allclose(turned, both @ K @ both.T, atol=(1e-13 if len(x) < 6 else 1e-12) * np.abs(K).max())


@pytest.mark.parametrize("name", SHAPES)
def test_whichever_corner_comes_first_it_is_the_same(name):
    x, section = SHAPES[name], isotropic(1.0, 0.3, 0.1, 1)
    K, sides = stiff(x, section, 0.02), MIDDLES.get(len(x), ())
    c = len(x) - len(sides)
    middle = {frozenset(ends): c + i for i, ends in enumerate(sides)}
    for corners, offset in ((np.roll(np.arange(c), 1), 0.02), (np.arange(c)[::-1], -0.02)):
        order = np.array([*corners, *(middle[frozenset((int(corners[i]), int(corners[j])))] for i, j in sides)])
        at = (6 * order[:, None] + np.arange(6)).ravel()
        np.testing.assert_allclose(stiff(x[order], section, offset), K[np.ix_(at, at)], atol=1e-12 * np.abs(K).max())


def test_a_membrane_and_a_plate_alone_leave_the_rest_free():
    A, B, D, S = isotropic(1.0, 0.3, 0.1, 1)
    for name, kept in (("skewed", 12), ("sliver", 9)):
        x = SHAPES[name]
        membrane, plate = stiff(x, (A, B, 0 * D, 0 * S)), stiff(x, (0 * A, B, D, S))
        assert np.linalg.matrix_rank(membrane, 1e-9) == kept - 3
        flat = np.setdiff1d(np.arange(6 * len(x)), [6 * i + c for i in range(len(x)) for c in (2, 3, 4)])
        across = np.setdiff1d(np.arange(6 * len(x)), flat)
        assert not membrane[across].any()
        assert np.linalg.matrix_rank(plate[np.ix_(across, across)], 1e-9) == kept - 3


@pytest.mark.parametrize("kind", ALL)
@pytest.mark.parametrize("offset", [0.0, 0.3])
def test_the_mass_of_rigid_motions_is_that_of_the_body(kind, offset):
    """Of a rectangle a × b of thickness t, with its middle surface `offset` above the nodes: m, its first moments, and
    m(b² + t²)/12, m(a² + t²)/12 about its own axes, m(a² + b²)/12 about the normal."""
    a, b, t, rho = 2.0, 1.0, 0.2, 5.0
    s, r, cells = unit_square(4, 3, {"quad8": "quad4", "tri6": "tri3"}.get(kind, kind))
    inner = (s > 0) & (s < 1) & (r > 0) & (r < 1)
    rng = np.random.default_rng(1)
    x = np.column_stack([a * (s - 0.5), b * (r - 0.5), 0 * s])
    x[inner, :2] += rng.uniform(-0.1, 0.1, (inner.sum(), 2))
    x, cells = with_middles(x, cells) if kind in SECOND else (x, cells)
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


def test_axes_follow_the_nodes():
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
        ([[0, 0], [2, 0], [0.3, 1.5], [1, 1]], "corner of more than 180°"),  # crossed
        ([[0, 0], [1, 0], [0.2, 0.2], [0, 1]], "corner of more than 180°"),  # re-entrant
        ([[0, 0], [1, 0], [0.5, 0.5], [0, 1]], "corner of more than 180°"),  # a straight corner
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


OUTER = np.array([[0.0, 0.0], [0.24, 0.0], [0.24, 0.12], [0.0, 0.12]])
INNER = np.array([[0.04, 0.02], [0.18, 0.03], [0.16, 0.08], [0.08, 0.08]])
XY = np.vstack([OUTER, INNER])
"""The patch of MacNeal & Harder (1985)."""
QUADS = np.array([[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [4, 5, 6, 7]])
AREA = 0.24 * 0.12
CENTRE = {"quad4": (0.0, 0.0), "tri3": (1 / 3, 1 / 3), "quad8": (0.0, 0.0), "tri6": (1 / 3, 1 / 3)}
WITHIN = dict.fromkeys(KINDS, 1e-10) | dict.fromkeys(SECOND, 1e-9)

STATES = {
    "stretched": ((1.0e-3, -0.4e-3, 0.7e-3), (0, 0, 0)),
    "bent": ((0, 0, 0), (0.02, -0.05, 0.0)),
    "twisted": ((0, 0, 0), (0, 0, 0.06)),
    "all": ((1.0e-3, -0.4e-3, 0.7e-3), (0.02, -0.05, 0.06)),
}


def motions(xy: np.ndarray, strain, kappa) -> np.ndarray:
    """(n, 6): u, v, w, θ_x = w,y, θ_y = −w,x and θ_z = ½(v,x − u,y) of constant ε and κ = −(w,xx, w,yy, 2 w,xy)."""
    x, y = xy.T
    spin = 0.9e-3
    u = np.zeros((len(xy), 6))
    u[:, 0] = strain[0] * x + (strain[2] / 2 - spin) * y
    u[:, 1] = (strain[2] / 2 + spin) * x + strain[1] * y
    u[:, 2] = -(kappa[0] * x**2 + kappa[1] * y**2 + kappa[2] * x * y) / 2
    u[:, 3] = -(kappa[1] * y + kappa[2] * x / 2)
    u[:, 4] = kappa[0] * x + kappa[2] * y / 2
    u[:, 5] = spin
    return u


def patch(kind: str, bow: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes (n, 3) of the patch, cells, and which nodes lie on its outline; bow: how far inner nodes on sides are moved."""
    cells, xy = halved(QUADS) if kind.startswith("tri") else QUADS, XY.copy()
    if kind in SECOND:
        xy, cells = with_middles(xy, cells)
    low, high = OUTER.min(axis=0), OUTER.max(axis=0)
    outline = ((np.abs(xy - low) < 1e-12) | (np.abs(xy - high) < 1e-12)).any(axis=1)
    moved = ~outline & (np.arange(len(xy)) >= len(XY))
    xy[moved] += bow * np.random.default_rng(1).uniform(-1, 1, (moved.sum(), 2))
    return np.column_stack([xy, 0 * xy[:, 0]]), cells, outline


def first_sides(x: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Directions (e, 3, 1) of the first sides of elements, along which their sections are stated."""
    one = x[cells[:, 1]] - x[cells[:, 0]]
    return (one / np.linalg.norm(one, axis=1)[:, None])[:, :, None]


def along(axes: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Voigt strain along x, y of the patch → that along the axes of elements (e, 3, 3)."""
    c, s = (R.T @ axes[:, :, 0].T)[:2]
    rows = [[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]]
    return np.array(rows).transpose(2, 0, 1)


def coupled(seed: int) -> np.ndarray:
    """A positive [A B; B D] with all couplings, of a shell 1 mm thick."""
    rng = np.random.default_rng(seed)
    root = rng.uniform(-1, 1, (6, 6)) + 2 * np.eye(6)
    root[:, 3:] *= 0.3e-3
    return root.T @ root


@pytest.mark.parametrize("kind", ALL)
@pytest.mark.parametrize(("state", "bow"), [*((state, 0.0) for state in STATES), ("stretched", 0.003)])
def test_a_patch_holds_constant_strain(kind, state, bow):
    """With the outer nodes held in the state, inner ones are in it, and strain at every point is that; t/L = 1/240, turned in
    space; of a membrane with curved sides too. Bent, w is quadratic in x and y, which curved sides cannot hold."""
    flat, cells, outline = patch(kind, bow)
    R = Rotation.from_rotvec([0.4, -0.8, 1.3]).as_matrix()
    x, count = flat @ R.T, len(cells)
    K = stiffness(x, cells, 1e6, 0.25, 1e-3)
    exact = (motions(flat[:, :2], *STATES[state]).reshape(-1, 2, 3) @ R.T).ravel()
    held, free = rows(outline), rows(~outline)
    u = exact.copy()
    u[free] = spsolve(K[free][:, free], -K[free][:, held] @ exact[held])
    np.testing.assert_allclose(u, exact, atol=WITHIN[kind] * np.abs(exact).max())
    strain, kappa = map(np.array, STATES[state])
    for at in (CENTRE[kind], (0.3, 0.5)):
        for z in (0.0, 5e-4, -5e-4):
            read = shell_strain_rows(
                x[cells], np.tile(at, (count, 1)), np.full(count, z), np.zeros(count), np.arange(count)
            )
            found = np.einsum("eij,ej->ei", read, u[rows_of(cells)])
            expected = along(first_sides(x, cells), R) @ (strain + z * kappa)
            np.testing.assert_allclose(found, expected, atol=WITHIN[kind] * np.abs(strain + 5e-4 * kappa).max())


@pytest.mark.parametrize("kind", ALL)
@pytest.mark.parametrize("offset", [0.0, 2e-3])
def test_constant_strain_has_the_energy_of_its_section(kind, offset):
    """½ (ε, κ)ᵀ [A B; B D] (ε, κ) area, with all couplings, each element with the section along its own axes; the middle
    surface may lie off the nodes: u of the nodes is then that of the surface less φ × d z."""
    x, cells, _ = patch(kind)
    count, section = len(cells), coupled(4)
    both = np.zeros((count, 6, 6))  # strain along the patch's axes → along the element's
    both[:, :3, :3] = both[:, 3:, 3:] = along(first_sides(x, cells), np.eye(3))
    own = np.linalg.inv(both)
    C = own.swapaxes(1, 2) @ section @ own
    S = np.repeat(1e-3 * np.eye(2)[None], count, axis=0)
    resistance = Resistance(C[:, :3, :3], C[:, :3, 3:], C[:, 3:, 3:], S)
    K = shell_stiffnesses(x[cells], resistance, np.full(count, offset), np.arange(count))
    for seed in range(3):
        rng = np.random.default_rng(seed)
        strain, kappa = rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3) / 0.3e-3
        u = motions(x[:, :2], strain, kappa)
        u[:, 0] -= offset * u[:, 4]
        u[:, 1] += offset * u[:, 3]
        q, state = u.ravel()[rows_of(cells)], np.concatenate([strain, kappa])
        energy = np.einsum("ei,eij,ej->", q, K, q) / 2
        assert energy == pytest.approx(state @ section @ state / 2 * AREA, rel=WITHIN[kind])


@pytest.mark.parametrize("kind", ALL)
def test_constant_shear_has_the_energy_of_its_section(kind):
    """½ γᵀSγ area of w and θ that give γ = (w,x + θ_y, w,y − θ_x) without curvature; with curved sides where there are any.
    In all but quads of four nodes rotation may differ within an element from that at its nodes, which takes up a part of S L²/D
    of the energy: there it is that of a plate that does not bend, by extrapolation from 1e7 and 1e8 times D of the section."""
    x, cells, _ = patch(kind, 0.003)
    count = len(cells)
    A, B, D, _ = isotropic(1e6, 0.25, 1e-3, count)
    S = np.diag([3.0, 3.0]) if kind in SECOND else np.array([[3.0, 0.5], [0.5, 2.0]])
    one = first_sides(x, cells)[:, :2]
    axes = np.concatenate([one, one[:, ::-1] * [[-1], [1]]], axis=2)
    u = np.zeros((len(x), 6))
    u[:, 2], u[:, 3], u[:, 4] = 0.3 * x[:, 0] - 0.7 * x[:, 1], 0.4, -0.8
    q = u.ravel()[rows_of(cells)]

    def energy(stiffer: float) -> float:
        own = axes.swapaxes(1, 2) @ S @ axes
        K = shell_stiffnesses(x[cells], Resistance(A, B, stiffer * D, own), np.zeros(count), np.arange(count))
        return float(np.einsum("ei,eij,ej->", q, K, q))

    gamma = np.array([0.3 - 0.8, -0.7 - 0.4])
    found = energy(1.0) if kind == "quad4" else (10 * energy(1e8) - energy(1e7)) / 9
    within = {"quad4": 1e-10, "tri3": 1e-9}.get(kind, 1e-8)
    assert found == pytest.approx(gamma @ S @ gamma * AREA, rel=within)


@pytest.mark.parametrize("slender", [1.0, 8.0])
def test_a_rectangle_bends_in_its_plane_as_a_beam(slender):
    """u = κ x y, v = −κ(x² + ν y²)/2: ε_xx = κ y, ε_yy = −νκ y, γ = 0 at every point, whatever the aspect, and the energy is
    ½ κ² E t b³L/12 (the nodes turn with θ_z = v,x = −κ x)."""
    L, b, E, nu, t, kappa = slender, 1.0, 1.0, 0.3, 0.01, 0.2
    corners = np.array([[-L / 2, -b / 2, 0], [L / 2, -b / 2, 0], [L / 2, b / 2, 0], [-L / 2, b / 2, 0]])
    x, y = corners[:, 0], corners[:, 1]
    u = np.zeros((4, 6))
    u[:, 0], u[:, 1], u[:, 5] = kappa * x * y, -kappa * (x**2 + nu * y**2) / 2, -kappa * x
    K = shell_stiffnesses(corners[None], Resistance(*isotropic(E, nu, t, 1)), np.zeros(1), np.ones(1))[0]
    assert u.ravel() @ K @ u.ravel() / 2 == pytest.approx(kappa**2 * E * t * b**3 * L / 24, rel=1e-10)
    for at in ([0.0, 0.0], [0.9, -0.8], [-1.0, 1.0]):
        read = shell_strain_rows(corners[None], np.array([at]), np.zeros(1), np.zeros(1), np.ones(1), nu=nu)[0]
        found, expected = read @ u.ravel(), kappa * at[1] * b / 2 * np.array([1, -nu, 0])
        np.testing.assert_allclose(found, expected, atol=1e-14)
