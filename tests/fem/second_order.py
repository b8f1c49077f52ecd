"""Meshes of second-order shells for tests: a square, loads on lines and areas, the standard problems."""

from __future__ import annotations

import numpy as np
from numpy.polynomial.legendre import leggauss

from .shell_models import rows, solved, stiffness

KINDS = ("quad8", "tri6")
MIDDLES = {8: ((0, 1), (1, 2), (2, 3), (3, 0)), 6: ((0, 1), (1, 2), (2, 0))}


def square(n: int, m: int, kind: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """a, b in 0 … 1 of the nodes of n × m quads of eight nodes, or of two triangles of six in each, and cells."""
    i, j = np.meshgrid(np.arange(2 * n + 1), np.arange(2 * m + 1), indexing="ij")
    node = np.arange(i.size).reshape(i.shape)
    places = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1), (1, 1))
    nine = np.stack([node[di : di + 2 * n - 1 : 2, dj : dj + 2 * m - 1 : 2].ravel() for di, dj in places], axis=-1)
    cells = nine[:, :8] if kind == "quad8" else np.concatenate([nine[:, [0, 1, 2, 4, 5, 8]], nine[:, [0, 2, 3, 8, 6, 7]]])
    used, where = np.unique(cells, return_inverse=True)
    return i.ravel()[used] / (2 * n), j.ravel()[used] / (2 * m), where.reshape(cells.shape)


def on_line(on: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Shares of the nodes `on` (mask) of a constant load on their line, Simpson's: 1, 4, 1 of six on every side."""
    at = np.flatnonzero(on)
    at = at[np.argsort(along[at])]
    found, sides = np.zeros(len(on)), (len(at) - 1) // 2
    for side in range(sides):
        found[at[2 * side : 2 * side + 3]] += np.array([1, 4, 1]) / 6 / sides
    return found


def shapes(k: int, r: np.ndarray, s: np.ndarray) -> np.ndarray:
    """(k, …) written out: serendipity, or area coordinates."""
    if k == 6:
        t = 1 - r - s
        return np.array([t * (2 * t - 1), r * (2 * r - 1), s * (2 * s - 1), 4 * t * r, 4 * r * s, 4 * s * t])
    corners = [(1 + a * r) * (1 + b * s) * (a * r + b * s - 1) / 4 for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    sides = [(1 - r**2) * (1 - s) / 2, (1 + r) * (1 - s**2) / 2, (1 - r**2) * (1 + s) / 2, (1 - r) * (1 - s**2) / 2]
    return np.array([*corners, *sides])


def rule(k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """r, s, weight: sixteen points of Gauss, of a triangle those of a square that is drawn to a corner."""
    g, w = leggauss(4)
    r, s = (part.ravel() for part in np.meshgrid(g, g, indexing="ij"))
    weight = np.outer(w, w).ravel()
    if k == 8:
        return r, s, weight
    u, v = (1 + r) / 2, (1 + s) / 2
    return u, v * (1 - u), weight / 4 * (1 - u)


def on_area(x: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """∫ N dA (n,) of every node."""
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


def tip(K, a: np.ndarray, b: np.ndarray, component: int) -> float:
    """Work a unit load of a constant one on the line a = 1, held at a = 0."""
    share = on_line(a == 1, b)
    force = np.zeros((len(a), 6))
    force[:, component] = share
    return float(share @ solved(K, rows(a == 0), force.ravel()).reshape(-1, 6)[:, component])


def straight(kind: str, shape: str, n: int = 6, m: int = 1) -> list[float]:
    """6 × 0.2 × 0.1, E = 1e7, ν = 0.3: extension, bending in the plane, across it, twist."""
    a, b, cells = square(n, m, kind)
    place = np.arange(n + 1)
    lean = {"regular": 0.0 * place, "trapezoids": 0.1 * (-1.0) ** place, "parallelograms": np.full(n + 1, 0.1)}[shape]
    lean[[0, -1]] = 0
    x = np.column_stack([6 * a + np.interp(n * a, place, lean) * (1 - 2 * b), 0.2 * b - 0.1, 0 * a])
    K = stiffness(x, cells, 1e7, 0.3, 0.1)
    return [tip(K, a, b, c) / of for c, of in ((0, 3e-5), (1, 0.1081), (2, 0.4321), (3, 0.03208))]


def curved(kind: str, n: int = 6, m: int = 1) -> list[float]:
    """A quarter of a ring, radii 4.12 and 4.32, 0.1 thick, E = 1e7, ν = 0.25: bending in its plane and across it."""
    a, b, cells = square(n, m, kind)
    r, phi = 4.32 - 0.2 * b, np.pi / 2 * a
    K = stiffness(np.column_stack([r * np.cos(phi), r * np.sin(phi), 0 * a]), cells, 1e7, 0.25, 0.1)
    return [tip(K, a, b, c) / of for c, of in ((1, 0.08734), (2, 0.5022))]


def twisted(kind: str, n: int = 12, m: int = 2) -> list[float]:
    """12 × 1.1 × 0.32 turned by 90°, E = 29e6, ν = 0.22: forces in and out of the plane at the end."""
    a, b, cells = square(n, m, kind)
    s, phi = 1.1 * (b - 0.5), np.pi / 2 * a
    K = stiffness(np.column_stack([12 * a, s * np.cos(phi), s * np.sin(phi)]), cells, 29e6, 0.22, 0.32)
    return [tip(K, a, b, c) / of for c, of in ((2, 0.005424), (1, 0.001754))]


def plate(kind: str, n: int, long: float, support: str, load: str) -> float:
    """The centre of a plate 2 × long, a quarter of it, 1e-4 thick, E = 1.7472e7, ν = 0.3."""
    s, r, cells = square(n, n, kind)
    x = np.column_stack([s, long / 2 * r, 0 * s])
    force, centre = np.zeros((len(x), 6)), (s == 0) & (r == 0)
    force[:, 2] = 1e-4 * (on_area(x, cells) if load == "uniform" else centre)
    held = [rows(s == 1, (2, 3)), rows(r == 1, (2, 4)), rows(s == 0, (4,)), rows(r == 0, (3,))]
    held += [rows(s == 1, (4,)), rows(r == 1, (3,))] if support == "clamped" else []
    held.append(rows(np.arange(len(x)), (0, 1, 5)))
    K = stiffness(x, cells, 1.7472e7, 0.3, 1e-4)
    return float(solved(K, np.unique(np.concatenate(held)), force.ravel()).reshape(-1, 6)[centre, 2][0])


def roof(kind: str, n: int) -> float:
    """Scordelis-Lo: a quarter of a roof of radius 25, 50 long, 80° wide, 0.25 thick under 90 a unit area; the free edge."""
    a, b, cells = square(n, n, kind)
    phi = np.radians(40) * b
    x = np.column_stack([25 * np.sin(phi), 25 * (1 - a), 25 * np.cos(phi)])
    force = np.zeros((len(x), 6))
    force[:, 2] = -90 * on_area(x, cells)
    held = np.concatenate([rows(a == 1, (1, 3, 5)), rows(b == 0, (0, 4, 5)), rows(a == 0, (0, 2))])
    u = solved(stiffness(x, cells, 4.32e8, 0.0, 0.25), held, force.ravel()).reshape(-1, 6)
    return float(-u[(a == 1) & (b == 1), 2][0] / 0.3024)


def hemisphere(kind: str, n: int) -> float:
    """A quarter of a hemisphere of radius 10 with a hole of 18°, 0.04 thick, pulled and pushed by forces of one (2 in all)."""
    a, b, cells = square(n, n, kind)
    phi, psi = np.pi / 2 * a, np.radians(72) * b
    x = 10 * np.column_stack([np.cos(psi) * np.cos(phi), np.cos(psi) * np.sin(phi), np.sin(psi)])
    force = np.zeros((len(x), 6))
    start, end = np.flatnonzero((b == 0) & (a == 0))[0], np.flatnonzero((b == 0) & (a == 1))[0]
    force[start, 0], force[end, 1] = 1, -1
    held = np.concatenate([rows(a == 0, (1, 3, 5)), rows(a == 1, (0, 4, 5)), [6 * start + 2]])
    u = solved(stiffness(x, cells, 6.825e7, 0.3, 0.04), held, force.ravel()).reshape(-1, 6)
    return float((u[start, 0] - u[end, 1]) / 2 / 0.094)


def cylinder(kind: str, n: int) -> float:
    """An eighth of a cylinder of radius 300, 600 long, 3 thick, ends held in their planes, pinched by two forces of one."""
    a, b, cells = square(n, n, kind)
    phi = np.pi / 2 * b
    x = np.column_stack([300 * np.sin(phi), 300 * (1 - a), 300 * np.cos(phi)])
    force = np.zeros((len(x), 6))
    top = np.flatnonzero((a == 1) & (b == 0))[0]
    force[top, 2] = -0.25
    symmetric = [rows(a == 1, (1, 3, 5)), rows(b == 0, (0, 4, 5)), rows(b == 1, (2, 3, 4))]
    u = solved(stiffness(x, cells, 3e6, 0.3, 3.0), np.concatenate([*symmetric, rows(a == 0, (0, 2))]), force.ravel())
    return float(-u[6 * top + 2] / 1.8248e-5)
