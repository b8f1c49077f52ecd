"""Models of shells for tests: sections, meshes of a square, loads on lines and areas, a plain assembler, statics, frequencies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy import sparse
from scipy.sparse.linalg import eigsh, spsolve

from strainsight.fem.shells import shell_masses, shell_stiffnesses
from strainsight.fem.shells.matrices import Resistance
from strainsight.mesh.model import Mesh, Region
from strainsight.mesh.thin import ShellBlock

KINDS = ("quad4", "tri3")
SECOND = ("quad8", "tri6")
MIDDLES = {8: ((0, 1), (1, 2), (2, 3), (3, 0)), 6: ((0, 1), (1, 2), (2, 0))}


def isotropic(E: float, nu: float, t: float, count: int) -> tuple[np.ndarray, ...]:
    """A, B, D, S of a homogeneous plate with a shear factor of 5/6, `count` times."""
    C = E / (1 - nu**2) * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
    S = 5 / 6 * E / (2 + 2 * nu) * t * np.eye(2)
    return tuple(np.repeat(X[None], count, axis=0) for X in (t * C, 0 * C, t**3 / 12 * C, S))


def unit_square(n: int, m: int, kind: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """a, b in 0 … 1 of nodes, b fastest, and n × m quads anticlockwise about a × b, or two triangles in each."""
    step = 2 if kind in SECOND else 1
    i, j = np.meshgrid(np.arange(step * n + 1), np.arange(step * m + 1), indexing="ij")
    node = np.arange(i.size).reshape(i.shape)
    places = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1))
    if step == 1:
        quads = np.stack([node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]], axis=-1).reshape(-1, 4)
        return i.ravel() / n, j.ravel() / m, halved(quads) if kind == "tri3" else quads
    nine = np.stack([node[di : di + 2 * n - 1 : 2, dj : dj + 2 * m - 1 : 2].ravel() for di, dj in places], axis=-1)
    cells = nine[:, :8] if kind == "quad8" else np.concatenate([nine[:, [0, 1, 2, 4, 5, 8]], nine[:, [0, 2, 3, 8, 6, 7]]])
    used, where = np.unique(cells, return_inverse=True)
    return i.ravel()[used] / (2 * n), j.ravel()[used] / (2 * m), where.reshape(cells.shape)


def shells(kind, x, cells, section, material, offset=0.0, axis=(np.nan,) * 3, **more) -> Mesh:
    """Shells of one section on nodes at x (n, 3)."""
    e, region = len(cells), Region(1, "PSHELL 1", 1)
    offset, axes = np.broadcast_to(offset, e).astype(float), np.tile(np.array(axis, float), (e, 1))
    block = ShellBlock(kind, np.arange(1, e + 1), np.asarray(cells), np.ones(e, int), offset, axes)
    mesh = Mesh(np.arange(1, len(x) + 1), np.array(x, float), (), shells=(block,), sections={1: section})
    return replace(mesh, regions={1: region}, materials={1: material}, **more)


def sheet(kind, n, m, place, section, material, clamped=True, offset=0.0, axis=(np.nan,) * 3, turned=0, **more) -> Mesh:
    """Shells over 0 … 1 squared; place: a, b → x (n, 3); clamped at a = 0; turned: by how many corners the first node of an
    element is moved on."""
    a, b, cells = unit_square(n, m, kind)
    fixed = [(node, c) for node in np.flatnonzero(a == 0) for c in range(6)] if clamped else []
    mesh = shells(kind, place(a, b), np.roll(cells, -turned, axis=1), section, material, offset, axis)
    return replace(mesh, **{"fixed": np.array(fixed, int).reshape(-1, 2)} | more)


def halved(quads: np.ndarray) -> np.ndarray:
    """Two triangles of every quad."""
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def on_line(on: np.ndarray, along: np.ndarray, kind: str) -> np.ndarray:
    """Shares of the nodes `on` (mask) of a constant load on their line: 1, 4, 1 of six on every side of the second order, or 1, 1
    of two."""
    at = np.flatnonzero(on)
    at = at[np.argsort(along[at])]
    share = np.array([1, 4, 1]) / 6 if kind in SECOND else np.array([1, 1]) / 2
    found, step = np.zeros(len(on)), len(share) - 1
    for side in range(0, len(at) - 1, step):
        found[at[side : side + step + 1]] += share * step / (len(at) - 1)
    return found


def shapes(k: int, r: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(k, …) written out: bilinear, serendipity, or area coordinates."""
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    if k == 4:
        return np.array([(1 + a * r) * (1 + b * s) / 4 for a, b in signs])
    if k == 6:
        t = 1 - r - s
        return np.array([t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * t * r, 4 * r * s, 4 * s * t])
    corners = [(1 + a * r) * (1 + b * s) * (a * r + b * s - 1) / 4 for a, b in signs]
    sides = [(1 - r**2) * (1 - s) / 2, (1 + r) * (1 - s**2) / 2, (1 - r**2) * (1 + s) / 2, (1 - r) * (1 - s**2) / 2]
    return np.array([*corners, *sides])


def rule(k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """r, s, weight: sixteen points of Gauss, of triangles those of a square that is drawn to a corner."""
    g, w = leggauss(4)
    r, s = (part.ravel() for part in np.meshgrid(g, g, indexing="ij"))
    weight = np.outer(w, w).ravel()
    if k != 6:
        return r, s, weight
    u, v = (1 + r) / 2, (1 + s) / 2
    return u, v * (1 - u), weight / 4 * (1 - u)


def on_area(x: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """∫ N dA (n,) of every node; of quads, or triangles of six nodes."""
    k = cells.shape[1]
    r, s, weight = rule(k)
    h = 1e-20
    N = shapes(k, r, s)
    one = np.einsum("kq,ekc->eqc", shapes(k, r + 1j * h, s).imag / h, x[cells])
    two = np.einsum("kq,ekc->eqc", shapes(k, r, s + 1j * h).imag / h, x[cells])
    dA = np.linalg.norm(np.cross(one, two), axis=2) * weight
    found = np.zeros(len(x))
    np.add.at(found, cells, np.einsum("eq,kq->ek", dA, N))
    return found


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
    K = shell_stiffnesses(x[cells], Resistance(*isotropic(E, nu, t, e)), np.full(e, offset), np.arange(e))
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
