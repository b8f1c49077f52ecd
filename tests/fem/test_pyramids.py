"""The pyramid against the hexahedron that it is a limit of, finer rules, closed volumes, and bodies of hexahedra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.sparse.linalg import eigsh

from strainsight.fem.assembly import assemble
from strainsight.fem.elasticity import element_masses, element_stiffnesses
from strainsight.fem.mass import mass_properties
from strainsight.fem.model import build_model
from strainsight.mesh.kinds.solids import HEX8, PYRA5

from ..mesh.test_kinds import volume

ONE = np.array([1])


def distorted(seed: int, warp: float) -> np.ndarray:
    """(1, 5, 3): the reference pyramid sheared, the corners of its base off their places by up to `warp`."""
    rng = np.random.default_rng(seed)
    x = PYRA5.nodes @ (np.eye(3) + 0.3 * rng.uniform(-1, 1, (3, 3)))
    x[:4] += warp * rng.uniform(-1, 1, (4, 3))
    return x[None]


def collapsed_rule(across: int, along: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre in u, v and ζ, ξ = (1 − ζ)u, η = (1 − ζ)v."""
    x, w = np.polynomial.legendre.leggauss(across)
    z, wz = np.polynomial.legendre.leggauss(along)
    u, v, z = (g.ravel() for g in np.meshgrid(x, x, (1 + z) / 2, indexing="ij"))
    weight = np.einsum("i,j,k->ijk", w, w, wz / 2).ravel() * (1 - z) ** 2
    return np.column_stack([u * (1 - z), v * (1 - z), z]), weight


def test_pyramid_is_degenerate_hexahedron():
    u, v, w = np.random.default_rng(0).uniform(-1, 1, (3, 50))
    z = (1 + w) / 2
    hexahedron = HEX8.shape(np.column_stack([u, v, w]))
    expected = np.column_stack([hexahedron[:, :4], hexahedron[:, 4:].sum(axis=1)])
    found = PYRA5.shape(np.column_stack([u * (1 - z), v * (1 - z), z]))
    np.testing.assert_allclose(found, expected, atol=1e-15)


@pytest.mark.parametrize(("warp", "rule"), [(0.0, collapsed_rule(12, 12)), (0.3, collapsed_rule(2, 12))])
def test_one_point_along_the_axis_is_enough_for_the_stiffness(warp, rule):
    """Whatever the shape; on a pyramid with a parallelogram as its base the four points are enough for the integral."""
    x, nu = distorted(1, warp), np.array([0.3])
    found, finer = (element_stiffnesses(kind, x, nu, ONE) for kind in (PYRA5, replace(PYRA5, stiffness=rule)))
    np.testing.assert_allclose(found, finer, atol=1e-14 * np.abs(finer).max())


def test_the_mass_is_the_integral_on_a_pyramid_with_a_parallelogram_as_its_base():
    x = distorted(2, 0.0)
    found, finer = (element_masses(kind, x, ONE) for kind in (PYRA5, replace(PYRA5, mass=collapsed_rule(12, 12))))
    np.testing.assert_allclose(found, finer, atol=1e-14 * np.abs(finer).max())


@pytest.mark.parametrize("seed", range(3))
def test_the_volume_is_that_of_the_hexahedron_with_its_upper_facet_in_a_point(mesh_of, seed):
    x = distorted(seed, 0.4)[0]
    mesh = mesh_of(x, [("pyra5", np.arange(5)[None], 1)], material=(1.0, 0.3, 1.0))
    assert mass_properties(mesh)[0] == pytest.approx(volume(PYRA5, x), rel=1e-14)


def test_it_joins_a_hexahedron_to_tetrahedra(mesh_of):
    """Two cells, distorted: a hexahedron, and a pyramid on its facet with tetrahedra on the other five of the second cell.

    A linear field has the energy ½ σ:ε V, and no force on the node inside.
    """
    grid = np.array([(x, y, z) for x in (0, 1, 2) for y in (0, 1) for z in (0, 1)], float)
    x = np.vstack([grid + 0.15 * np.random.default_rng(4).uniform(-1, 1, grid.shape), [1.5, 0.4, 0.6]])
    number = {tuple(p): i for i, p in enumerate(grid.astype(int).tolist())}
    loop = [(0, 0), (1, 0), (1, 1), (0, 1)]
    first = np.array([[number[a, b, c] for c in (0, 1) for a, b in loop]])
    cell = [number[a + 1, b, c] for c in (0, 1) for a, b in loop]
    pyramid = [[cell[i] for i in (7, 4, 0, 3)] + [12]]
    quadrangles = [(0, 1, 2, 3), (7, 6, 5, 4), (4, 5, 1, 0), (5, 6, 2, 1), (6, 7, 3, 2)]
    tetrahedra = [[cell[i] for i in three] + [12] for a, b, c, d in quadrangles for three in ((a, b, c), (a, c, d))]
    mesh = mesh_of(x, [("hex8", first, 1), ("pyra5", np.array(pyramid), 1), ("tet4", np.array(tetrahedra), 1)])
    K, mass = assemble(mesh)[0].constant, mass_properties(mesh)[0]
    G = np.random.default_rng(5).normal(size=(3, 3))
    strain = 0.5 * (G + G.T)
    stress = 2.1e11 / 1.3 * (strain + 0.3 / 0.4 * np.trace(strain) * np.eye(3))
    u = (x @ G.T).ravel()
    assert u @ K @ u == pytest.approx(np.sum(stress * strain) * mass / 7850.0, rel=1e-12)
    assert np.abs((K @ u)[36:]).max() < 1e-12 * np.abs(K @ u).max()


@pytest.mark.slow
def test_a_cantilever_of_pyramids_tends_to_that_of_hexahedra(box):
    """From above, with the square of the element's size; a hexahedron in six pyramids is softer than in six tetrahedra."""

    def frequencies(kind: str, n: int) -> np.ndarray:
        model = build_model(box(kind, (8 * n, 2 * n, 2 * n), (1.0, 0.1, 0.15), clamp_root=True))
        K, M = (operator.constant.tocsc() for operator in (model.stiffness, model.mass))
        return np.sqrt(eigsh(K, 3, M, sigma=0.0, return_eigenvectors=False, v0=np.ones(K.shape[0])))[::-1]

    hexahedra = frequencies("hex20", 2)
    coarse, middle, fine = (frequencies("pyra5", n) for n in (1, 2, 4))
    assert np.all((coarse > middle) & (middle > fine) & (fine > hexahedra))
    np.testing.assert_allclose(fine, hexahedra, rtol=0.035)
    np.testing.assert_allclose(fine - (middle - fine) / 3, hexahedra, rtol=5e-3)
    assert np.all(middle < frequencies("tet4", 2))
