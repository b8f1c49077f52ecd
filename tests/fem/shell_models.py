"""Models of flat shells for tests: sections, meshes of a square, a plain assembler, statics and frequencies."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import eigsh, spsolve

from strainsight.fem.shells import shell_masses, shell_stiffnesses

KINDS = ("quad4", "tri3")


def isotropic(E: float, nu: float, t: float, count: int) -> tuple[np.ndarray, ...]:
    """A, B, D, S of a homogeneous plate with a shear factor of 5/6, `count` times."""
    C = E / (1 - nu**2) * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
    S = 5 / 6 * E / (2 + 2 * nu) * t * np.eye(2)
    return tuple(np.repeat(X[None], count, axis=0) for X in (t * C, 0 * C, t**3 / 12 * C, S))


def unit_square(n: int, m: int, kind: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """a, b in 0 … 1 of (n + 1)(m + 1) nodes, b fastest, and cells anticlockwise about a × b; quads halved for triangles."""
    a, b = np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1), indexing="ij")
    node = np.arange(a.size).reshape(a.shape)
    quads = np.stack([node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]], axis=-1).reshape(-1, 4)
    return a.ravel(), b.ravel(), halved(quads) if kind == "tri3" else quads


def halved(quads: np.ndarray) -> np.ndarray:
    """Two triangles of every quad."""
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def rows_of(cells: np.ndarray) -> np.ndarray:
    """Rows 6·node + component (e, 6k) of elements."""
    return (6 * cells[:, :, None] + np.arange(6)).reshape(len(cells), -1)


def rows(nodes: np.ndarray, components: tuple[int, ...] = (0, 1, 2, 3, 4, 5)) -> np.ndarray:
    """Rows of these components of nodes (indices or a mask)."""
    nodes = np.flatnonzero(nodes) if nodes.dtype == bool else nodes
    return (6 * nodes[:, None] + np.array(components)).ravel()


def summed(blocks: np.ndarray, cells: np.ndarray, nodes: int) -> sparse.csc_array:
    """The matrix (6n, 6n) of element matrices (e, 6k, 6k)."""
    at = rows_of(cells)
    size = at.shape[1]
    places = np.repeat(at, size, axis=1).ravel(), np.tile(at, (1, size)).ravel()
    return sparse.csc_array((blocks.ravel(), places), shape=(6 * nodes, 6 * nodes))


def stiffness(x: np.ndarray, cells: np.ndarray, E: float, nu: float, t: float, offset: float = 0.0) -> sparse.csc_array:
    """K of shells of one thickness."""
    e = len(cells)
    K = shell_stiffnesses(x[cells], *isotropic(E, nu, t, e), np.full(e, offset), np.arange(e))
    return summed(K, cells, len(x))


def mass(x: np.ndarray, cells: np.ndarray, rho: float, t: float, offset: float = 0.0) -> sparse.csc_array:
    """M of shells of one thickness."""
    e = len(cells)
    M = shell_masses(x[cells], np.full(e, rho * t), np.full(e, rho * t**3 / 12), np.full(e, offset), np.arange(e))
    return summed(M, cells, len(x))


def solved(K: sparse.csc_array, held: np.ndarray, force: np.ndarray) -> np.ndarray:
    """The motions under a force, with rows that are held at zero."""
    free = np.setdiff1d(np.arange(K.shape[0]), held)
    u = np.zeros(K.shape[0])
    u[free] = spsolve(K[free][:, free], force[free])
    return u


def frequencies(K: sparse.csc_array, M: sparse.csc_array, held: np.ndarray, count: int, shift: float) -> np.ndarray:
    """The lowest frequencies [Hz]; the shift [1/s²] is below them."""
    free = np.setdiff1d(np.arange(K.shape[0]), held)
    start = np.random.default_rng(0).standard_normal(len(free))
    w2 = eigsh(K[free][:, free], count, M[free][:, free], sigma=shift, v0=start, return_eigenvectors=False)
    return np.sqrt(np.maximum(np.sort(w2), 0.0)) / (2 * np.pi)


def rigid_motions(x: np.ndarray) -> np.ndarray:
    """Three translations and three rotations (6n, 6) of nodes at x (n, 3)."""
    u = np.zeros((len(x), 6, 6))
    u[:, [0, 1, 2], [0, 1, 2]] = u[:, [3, 4, 5], [3, 4, 5]] = 1.0
    for axis in range(3):
        u[:, :3, 3 + axis] = np.cross(np.eye(3)[axis], x)
    return u.reshape(-1, 6)
