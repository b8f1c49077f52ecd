"""Modes against closed forms and published values."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse
from scipy.linalg import eigh

from strainsight import memory
from strainsight.errors import UserError
from strainsight.fem import factorisation
from strainsight.fem import modes as own
from strainsight.fem.factorisation import factorise, factorise_and_keep, factorise_or_reuse
from strainsight.fem.model import build_model, nodal
from strainsight.fem.modes import REPEATED, combine_repeated, largest, modes
from strainsight.fem.modes import _orthonormalise as orthonormalise


def chain(n, stiffness=1.0, mass=1.0):
    """Masses and springs in a row, one end held: ω_k = 2√(k/m) sin((2k − 1)π / (4n + 2))."""
    K = sparse.diags_array([np.append(np.full(n - 1, 2.0), 1.0), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1])
    k = np.arange(1, n + 1)
    exact = 2 * np.sqrt(stiffness / mass) * np.sin((2 * k - 1) * np.pi / (4 * n + 2)) / (2 * np.pi)
    return sparse.csr_array(stiffness * K), sparse.csr_array(mass * sparse.eye_array(n)), exact


@pytest.mark.parametrize(("n", "stiffness", "mass"), [(40, 1.0, 1.0), (40, 1e12, 1e-6), (2000, 1e-9, 1e3)])
def test_chain_of_masses(n, stiffness, mass):
    K, M, exact = chain(n, stiffness, mass)
    frequency, shapes = modes(K, M, 12)
    assert np.allclose(frequency, exact[:12], rtol=1e-9)
    assert np.allclose(shapes.T @ (M @ shapes), np.eye(12), atol=1e-9)
    assert np.allclose(
        shapes.T @ (K @ shapes), np.diag((2 * np.pi * frequency) ** 2), atol=1e-9 * (2 * np.pi * frequency[-1]) ** 2
    )
    first = np.argmax(np.abs(shapes) > (1 - 1e-6) * np.abs(shapes).max(axis=0), axis=0)
    assert np.all(shapes[first, np.arange(12)] > 0)


def test_the_same_model_gives_the_same_bits():
    K, M, _ = chain(2000)
    first, *others = (modes(K, M, 5)[1] for _ in range(4))
    assert all(np.array_equal(first, other) for other in others)


@pytest.mark.parametrize("n", [60, 900])
def test_unknowns_without_mass_are_condensed(n):
    K = chain(n, 2.0)[0]
    diagonal = np.tile([0.0, 1.0], n // 2)
    frequency, _ = modes(K, sparse.csr_array(sparse.diags_array(diagonal)), 4)
    assert np.allclose(frequency, chain(n // 2)[2][:4], rtol=1e-9)
    with pytest.raises(UserError, match=f"{n // 2 + 1} modes are requested, but the .* with mass allow only {n // 2}"):
        modes(K, sparse.csr_array(sparse.diags_array(diagonal)), n // 2 + 1)


def test_too_little_memory_for_the_lanczos_vectors_is_refused(monkeypatch):
    K, M, _ = chain(2000)
    factor = factorise(K)
    monkeypatch.setattr(memory, "available_memory", lambda: 1e5)
    with pytest.raises(UserError, match=r"computing 5 modes with 2000 degrees of freedom: .* GiB of memory are needed"):
        modes(K, M, 5, factor=factor)


def plate(box, kind, counts):
    """NAFEMS FV52: 10 × 10 × 1 m, w = 0 along the four lower edges; free in its plane."""
    mesh = box(kind, counts, size=(10.0, 10.0, 1.0), material=(200e9, 0.3, 8000.0))
    x, y, z = mesh.position.T
    edge = np.isclose(z, 0) & (np.isclose(x, 0) | np.isclose(x, 10) | np.isclose(y, 0) | np.isclose(y, 10))
    return replace(mesh, fixed=np.column_stack([np.flatnonzero(edge), np.full(edge.sum(), 2)]))


@pytest.mark.parametrize(
    ("kind", "counts", "published", "within"),
    [
        # code_aster V2.03.502 (NAFEMS' own finite-element values), and CalculiX 2.20 on the same mesh
        ("hex20", (4, 4, 1), (44.762, 110.52, 110.52, 169.08, 193.93, 206.64, 206.64), 1e-3),
        ("hex20", (4, 4, 1), (44.796, 110.543, 110.543, 169.095, 193.925, 206.638, 206.638), 1e-5),
        # OptiStruct CHEXA8 (help page OS-V 0455): its normalised results times the closed form 45.897 … 206.19 Hz
        ("hex8", (8, 8, 3), (45.319, 113.96, 113.96, 173.30, 196.77, 209.57, 209.57), 1e-4),
    ],
)
def test_simply_supported_solid_plate_fv52(box, kind, counts, published, within):
    mesh = plate(box, kind, counts)
    with pytest.raises(UserError, match="translation x, translation y, rotation about z"):
        build_model(mesh)
    model = build_model(mesh, supported=False)
    frequency, shapes = modes(model.stiffness.constant, model.mass.constant, 10, shift=-1e3)
    assert np.all(frequency[:3] < 1e-2)
    assert np.allclose(frequency[3:], published, rtol=within)
    # the rigid motions keep the plate's shape in plane and leave w at zero
    assert np.abs(nodal(model, shapes[:, :3])[2::3]).max() < 1e-6 * np.abs(shapes[:, :3]).max()


def octant(midsides, mesh_of, layers, inner, outer):
    """An eighth of a hollow sphere in wedge15, graded geometrically in radius; mid-side nodes on their spheres."""
    corner, triangles = np.eye(3), [(0, 1, 2)]
    for _ in range(2):
        finer = []
        for a, b, c in triangles:
            ab, bc, ca = (corner[p] + corner[q] for p, q in ((a, b), (b, c), (c, a)))
            start = len(corner)
            corner = np.vstack([corner, ab, bc, ca])
            finer += [
                (a, start, start + 2),
                (start, b, start + 1),
                (start + 2, start + 1, c),
                (start, start + 1, start + 2),
            ]
        triangles = finer
    corner /= np.linalg.norm(corner, axis=1)[:, None]
    corner, index = np.unique(np.round(corner, 12), axis=0, return_inverse=True)
    triangles = index[np.array(triangles)]
    radii = np.linspace(inner, outer, layers + 1)
    position = np.vstack([r * corner for r in radii])
    cells = np.vstack(
        [np.hstack([triangles + i * len(corner), triangles + (i + 1) * len(corner)]) for i in range(layers)]
    )
    straight, cells = midsides(position, cells, "wedge15")
    at = np.linalg.norm(straight, axis=1)
    radius = np.empty(len(straight))
    radius[: len(position)] = np.repeat(radii, len(corner))
    grid = np.sort(np.concatenate([radii, 0.5 * (radii[1:] + radii[:-1])]))
    for pair in cells.reshape(-1, 15):
        low, high = radius[pair[0]], radius[pair[3]]
        radius[pair[6:9]], radius[pair[9:12]], radius[pair[12:]] = low, high, 0.5 * (low + high)
    position = straight / at[:, None] * radius[:, None]
    return mesh_of(position, [("wedge15", cells, 1)], material=(200e9, 0.3, 8000.0)), radius, grid


def test_breathing_of_a_thick_hollow_sphere_fv42(midsides, mesh_of):
    """NAFEMS FV42: radii 1.8 and 6 m, E 200 GPa, ν 0.3, ρ 8000 kg/m³, against its closed form.

    The octant's matrices are restricted to radial motions u = f(r) e_r, so that only the breathing modes are left.
    """
    mesh, radius, grid = octant(midsides, mesh_of, 12, 1.8, 6.0)
    model = build_model(mesh, supported=False)
    level = np.argmin(np.abs(radius[:, None] - grid), axis=1)
    radial = np.zeros((3 * len(radius), len(grid)))
    for node, direction in enumerate(mesh.position / radius[:, None]):
        radial[3 * node : 3 * node + 3, level[node]] = direction
    K, M = model.stiffness.constant, model.mass.constant
    frequency, _ = modes(sparse.csr_array(radial.T @ (K @ radial)), sparse.csr_array(radial.T @ (M @ radial)), 5)
    assert np.allclose(frequency, [369.91, 838.03, 1451.2, 2117.0, 2795.8], rtol=2e-3)


@pytest.mark.parametrize("length", [40, 400])
def test_repeated_modes_do_not_depend_on_rounding(length):
    K, M, exact = chain(length)
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    K = sparse.csr_array(sparse.kron(K, turn @ np.diag([1.0, 1.0, 2.0]) @ turn.T))
    M = sparse.csr_array(sparse.kron(M, np.eye(3)))
    rng, count = np.random.default_rng(0), 6
    repeated = np.sort(np.concatenate([exact[:6], exact[:6], np.sqrt(2) * exact[:6]]))[:count]
    assert np.allclose(modes(K, M, count)[0], repeated, rtol=1e-9)
    first = modes(K, M, count)[1]
    assert np.allclose(first.T @ (M @ first), np.eye(count), atol=1e-9)
    for _ in range(3):
        noise = sparse.random_array(K.shape, density=3 / len(first), rng=rng)
        shaken = sparse.csr_array(K + 1e-14 * (noise + noise.T))
        assert np.abs(modes(shaken, M, count)[1] - first).max() < 1e-8 * np.abs(first).max()


@pytest.mark.parametrize(("length", "count"), [(20, 1), (20, 10), (50, 8)])
def test_no_copy_of_the_last_frequency_is_cut_off(length, count):
    K, M, exact = chain(length)
    K, M = sparse.csr_array(sparse.kron(sparse.eye_array(8), K)), sparse.csr_array(sparse.eye_array(8 * length))
    frequency, first = modes(K, M, count)
    assert np.allclose(frequency, np.repeat(exact[:2], 8)[:count], rtol=1e-9)
    assert np.allclose(first.T @ first, np.eye(count), atol=1e-9)
    # each chain on its own, in their order
    assert np.allclose(np.abs(first).reshape(8, length, count).sum(axis=1).argmax(axis=0), np.arange(count) % 8)
    rng = np.random.default_rng(0)
    for _ in range(3):
        noise = sparse.random_array(K.shape, density=3 / len(first), rng=rng)
        shaken = sparse.csr_array(K + 1e-14 * (noise + noise.T))
        assert np.abs(modes(shaken, M, count)[1] - first).max() < 1e-8


def test_missed_copy_is_found_in_the_complement(monkeypatch):
    K, M, exact = chain(50)
    K, M = sparse.csr_array(sparse.kron(sparse.eye_array(8), K)), sparse.csr_array(sparse.eye_array(400))
    own = np.linalg.eigh(chain(50)[0].toarray())
    module = sys.modules[modes.__module__]
    complement = module._complement_modes

    def first(A, M, count, factor, shapes, tolerance=0.0):
        if shapes.shape[1]:
            return complement(A, M, count, factor, shapes, tolerance)
        found = [np.kron(np.eye(8)[chain], own.eigenvectors[:, mode]) for mode, chain in ((0, 1), (0, 4), (0, 5), (1, 2))]
        return 1.0 / own.eigenvalues[[0, 0, 0, 1]], np.array(found).T

    monkeypatch.setattr(module, "_complement_modes", first)
    inverse, _ = module._lanczos(K, M, 4, 4, factorise(K))
    np.testing.assert_allclose(np.sqrt(1 / inverse) / (2 * np.pi), np.repeat(exact[0], 4), rtol=1e-9)


@pytest.mark.parametrize("n", [60, 400])
def test_any_number_of_modes_up_to_that_of_unknowns_with_mass(n):
    at = np.linspace(2, n - 1, 30).astype(int)
    mass = np.zeros(n)
    mass[at] = np.linspace(1, 2, 30)
    # one spring after another: the flexibility between two is that of the springs they share
    shared = np.minimum.outer(at + 1.0, at + 1.0)
    root = np.sqrt(mass[at])
    exact = np.linalg.eigvalsh(root[:, None] * shared * root)[::-1]
    for count in (1, 10, 29, 30):
        frequency, shapes = modes(chain(n)[0], sparse.csr_array(sparse.diags_array(mass)), count)
        assert np.allclose((2 * np.pi * frequency) ** -2, exact[:count], rtol=1e-9)
        assert np.allclose((shapes.T * mass) @ shapes, np.eye(count), atol=1e-9)
        one = sparse.csr_array(sparse.diags_array((mass > 0).astype(float)))
        frequency, shapes = modes(sparse.csr_array(sparse.eye_array(n)), one, count)
        assert np.allclose(2 * np.pi * frequency, 1.0, rtol=1e-12)
        assert np.allclose(shapes, np.eye(n)[:, at[:count]], atol=1e-9)


@pytest.mark.parametrize("sign", [1, -1])
def test_values_that_chain_are_not_one_frequency(sign):
    values = (1 + 0.9 * REPEATED * np.arange(60))[::sign]
    T = combine_repeated(values, np.random.default_rng(0).standard_normal((200, 60)))
    assert np.allclose(T.T @ T, np.eye(60), atol=1e-12)
    apart = np.abs(values[:, None] - values) > 1.01 * REPEATED
    assert np.all(T[apart] == 0)
    assert np.count_nonzero(T) > 60


N, COUNT = 400, 4
ROUNDING = 1e-10
"""Of a frequency: K has a condition of 1e5."""


def of_chain(n: int, numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies [Hz] and shapes (n, k) of its modes 1, 2, …, in closed form."""
    angle = (2 * numbers - 1) * np.pi / (2 * n + 1)
    shapes = np.sin(angle * np.arange(1, n + 1)[:, None])
    return 2 * np.sin(angle / 2) / (2 * np.pi), shapes / np.linalg.norm(shapes, axis=0)


@pytest.fixture
def no_lanczos(monkeypatch):
    """A search in the complement is an error."""

    def refused(*_):
        raise AssertionError("the block iterations were not enough")

    monkeypatch.setattr(own, "_lanczos", refused)
    monkeypatch.setattr(own, "_no_lower_mode", refused)


@pytest.mark.parametrize("count", [1, 6, 60])
def test_block_iterations_agree_with_closed_form(count, no_lanczos):
    exact, shapes = of_chain(N, np.arange(1, count + 1))
    frequency, found = modes(chain(N)[0], sparse.eye_array(N, format="csr"), count)
    assert np.allclose(frequency, exact, rtol=ROUNDING, atol=0)
    assert np.allclose(np.abs(np.einsum("ij,ij->j", found, shapes)), 1.0, rtol=0, atol=1e-12)


@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-6, 1e-4, 1e-2])
@pytest.mark.parametrize("copies", [2, 3, own.WIDTH - 1, own.WIDTH, own.WIDTH + 3, 3 * own.WIDTH])
@pytest.mark.parametrize("cut", [0, 1])
def test_no_mode_of_a_cluster_is_missing(copies, off, cut):
    """Equal chains, or nearly equal ones; the last frequency of each cluster is cut off, or not."""
    factors = 1 + off * np.arange(copies) / copies
    K = sparse.block_diag([factor * chain(50)[0] for factor in factors], format="csr")
    exact = np.sqrt(factors[None, :]) * chain(50)[2][:2, None]
    count = 2 * copies - cut
    frequency, shapes = modes(sparse.csr_array(K), sparse.eye_array(K.shape[0], format="csr"), count)
    assert np.allclose(frequency, exact.ravel()[:count], rtol=ROUNDING, atol=0)
    assert np.allclose(shapes.T @ shapes, np.eye(count), atol=1e-9)


def test_of_two_equal_chains_no_copy_of_the_last_frequency_is_cut_off():
    K, M = sparse.block_diag([chain(N)[0]] * 2, format="csr"), sparse.eye_array(2 * N, format="csr")
    exact, _ = of_chain(N, np.arange(1, 4))
    assert np.allclose(modes(sparse.csr_array(K), M, 3)[0], exact[[0, 0, 1]], rtol=ROUNDING, atol=0)


@pytest.mark.parametrize("massive", [60, 9])
@pytest.mark.parametrize("most", [24, 60])
def test_block_iterations_agree_with_dense_solution(massive, most):
    """A triple eigenvalue, motions without mass, restarts after 24 vectors, and a range that is used up after 9."""
    rng = np.random.default_rng(5)
    n, count = 60, 5
    V = np.linalg.qr(rng.standard_normal((n, n)))[0]
    A = V @ np.diag(np.r_[1.0, 2.0, 2.0, 2.0, np.geomspace(3, 300, n - 4)]) @ V.T
    m = np.zeros(n)
    m[:massive] = 1.0
    M = V @ np.diag(m) @ V.T
    inverse = np.linalg.inv(A)
    start = inverse @ (M @ rng.standard_normal((n, 4)))
    mu, phi, left = largest(lambda X: inverse @ X, sparse.csr_array(M), count, start, most, 1e-11, extra=1)
    exact = eigh(M, A, eigvals_only=True)[::-1][: count + 1]
    assert np.allclose(mu[:count], exact[:count], rtol=1e-12, atol=0)
    assert np.abs(mu[count] - exact[count]) <= left[count] + 1e-12
    assert np.allclose(phi.T @ M @ phi, np.eye(count + 1), rtol=0, atol=1e-12)
    assert np.all(np.linalg.norm(M @ (inverse @ (M @ phi) - mu * phi), axis=0)[:count] <= 2e-11)


def test_orthonormalisation_recovers_small_components():
    rng = np.random.default_rng(2)
    Q = np.linalg.qr(rng.standard_normal((50, 6)))[0]
    W = rng.standard_normal((50, 3)) + 100 * Q @ rng.standard_normal((6, 3))
    M = sparse.eye_array(50, format="csr")
    q, Mq, R, C = orthonormalise(Q, M, W)
    assert q.shape == (50, 3)
    assert np.allclose(q.T @ Mq, np.eye(3), atol=1e-12)
    assert np.allclose(Q.T @ Mq, 0, atol=1e-12)
    assert np.allclose(q @ R, W - Q @ (Q.T @ W), atol=1e-11)
    assert np.allclose(Q @ C + q @ R, W, atol=1e-11)


def test_kept_factor_is_reused_once_and_for_the_same_matrix_only():
    K, other = chain(N)[0], chain(N, 2.0)[0]
    kept = factorise_and_keep(K)
    assert factorise_or_reuse(sparse.csr_array(K.copy())) is kept
    assert factorise_or_reuse(K) is not kept
    factorise_and_keep(K)
    b = np.arange(1.0, N + 1)
    assert np.allclose(other @ factorise_or_reuse(other).solve(b), b)
    assert not factorisation._KEPT
