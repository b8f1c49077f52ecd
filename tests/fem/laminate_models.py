"""Plates of plies for tests, and what they resist by other means than the product's: tensors, sums over thin slices, Navier."""

from __future__ import annotations

import numpy as np

from strainsight.mesh.model import Material, Region
from strainsight.mesh.thin import Lamina, Laminate, Ply

from .shell_models import sheet

CARBON = Lamina(1, e1=1.4e11, e2=1.0e10, nu12=0.3, g12=5.0e9, g1z=4.5e9, g2z=3.0e9, density=1600.0)
STEEL = Material(2, 2.0e11, 0.3, 7800.0)
FOAM = Material(3, 7.0e7, 0.3, 80.0)


def stack(angles, thickness, material=1):
    """A laminate of equal plies, or of plies of thicknesses and materials (n,), from the lower face up."""
    t = np.broadcast_to(thickness, len(angles)).tolist()
    of = np.broadcast_to(material, len(angles)).tolist()
    return Laminate(tuple(Ply(int(m), own, float(a)) for m, own, a in zip(of, t, angles, strict=True)))


def plate(laminate, n, m, a, b, kind="quad4", fixed=(), **more):
    """A plate a × b of one laminate."""
    return sheet(
        *(kind, n, m, lambda x, y: np.column_stack([a * x, b * y, 0 * x]), laminate, STEEL),
        regions={1: Region(1, "PCOMP 1", 0)},
        materials={2: STEEL, 3: FOAM},
        laminae={1: CARBON},
        fixed=np.array(fixed, dtype=int).reshape(-1, 2),
        **more,
    )


def tensor_stiffness(own, angle):
    """Q̄ (3, 3), xx yy xy, and Ḡ (2, 2), xz yz, of a ply: the tensor C of its plane stress, turned index by index."""
    if isinstance(own, Material):
        E, nu = own.youngs_modulus, own.poisson_ratio
        G = E / (2 + 2 * nu)
        own = Lamina(0, E, E, nu, G, G, G, own.density)
    compliance = np.array([[1 / own.e1, -own.nu12 / own.e1], [-own.nu12 / own.e1, 1 / own.e2]])
    Q = np.linalg.inv(compliance)
    C = np.zeros((2, 2, 2, 2))
    for i in range(2):
        for j in range(2):
            C[i, i, j, j] = Q[i, j]
    for i, j in ((0, 1), (1, 0)):
        C[i, j, 0, 1] = C[i, j, 1, 0] = own.g12
    c, s = np.cos(angle), np.sin(angle)
    e = np.array([[c, -s], [s, c]])  # e[:, k] is axis k of the ply
    C = np.einsum("ai,bj,ck,dl,ijkl->abcd", e, e, e, e, C)
    pairs = ((0, 0), (1, 1), (0, 1))
    return np.array([[C[*p, *q] for q in pairs] for p in pairs]), e @ np.diag([own.g1z, own.g2z]) @ e.T


def by_slices(laminate, mesh, count=4000):
    """A, B, D and S of a laminate by sums over slices (midpoint rule) and shear stress summed up from the lower face."""
    t = np.array([ply.thickness for ply in laminate.plies])
    top = np.cumsum(t) - t.sum() / 2
    A, B, D, parts = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3)), []
    for ply, high, own in zip(laminate.plies, top, t, strict=True):
        Q, G = tensor_stiffness((mesh.laminae | mesh.materials)[ply.material], np.radians(ply.angle))
        dz = own / count
        z = high - own + dz * (np.arange(count) + 0.5)
        A, B = A + own * Q, B + dz * z.sum() * Q
        D = D + (dz * (z**2).sum() + own * dz**2 / 12) * Q
        parts.append((z, dz, Q, np.linalg.inv(G)))
    unit = np.linalg.solve(np.block([[A, B], [B, D]]), np.vstack([np.zeros((3, 3)), np.eye(3)]))
    f, energy = np.zeros((2, 2)), np.zeros((2, 2))
    for z, dz, Q, flexible in parts:
        F = np.einsum("ij,zjk->zik", Q, unit[:3] + z[:, None, None] * unit[3:])
        change = -dz * np.array([[F[:, 0, 0], F[:, 2, 1]], [F[:, 2, 0], F[:, 1, 1]]]).transpose(2, 0, 1)
        middle = f + np.cumsum(change, axis=0) - 0.5 * change
        energy += dz * np.einsum("zij,ik,zkl->jl", middle, flexible, middle)
        f = f + change.sum(axis=0)
    assert np.abs(f).max() < 1e-9  # no shear stress at the upper face
    return A, B, D, np.linalg.inv(energy)


def navier(A, B, D, S, moments, a, b, m, n, angle_ply):
    """K, M (5, 5) of u, v, w, θx', θy' (rotations of the normal along x and y) with m and n half waves, per q₀ a b/4 of w: the
    sums that solve a plate on simple supports exactly, of a cross-ply (u ∝ cos sin) or an antisymmetric angle-ply (u ∝ sin cos).
    """
    alpha, beta = m * np.pi / a, n * np.pi / b
    points, weights = np.polynomial.legendre.leggauss(12)
    x, y = np.meshgrid(0.5 * a * (points + 1), 0.5 * b * (points + 1), indexing="ij")
    area = np.outer(weights, weights) * a * b / 4
    sx, cx, sy, cy = np.sin(alpha * x), np.cos(alpha * x), np.sin(beta * y), np.cos(beta * y)
    zero = 0 * x
    functions = [
        # value, along x, along y
        (sx * cy, alpha * cx * cy, -beta * sx * sy) if angle_ply else (cx * sy, -alpha * sx * sy, beta * cx * cy),
        (cx * sy, -alpha * sx * sy, beta * cx * cy) if angle_ply else (sx * cy, alpha * cx * cy, -beta * sx * sy),
        (sx * sy, alpha * cx * sy, beta * sx * cy),
        (cx * sy, -alpha * sx * sy, beta * cx * cy),
        (sx * cy, alpha * cx * cy, -beta * sx * sy),
    ]
    (u, v, w, p, r) = functions
    rows = [
        [u[1], zero, zero, zero, zero],
        [zero, v[2], zero, zero, zero],
        [u[2], v[1], zero, zero, zero],
        [zero, zero, zero, p[1], zero],
        [zero, zero, zero, zero, r[2]],
        [zero, zero, zero, p[2], r[1]],
        [zero, zero, w[1], p[0], zero],
        [zero, zero, w[2], zero, r[0]],
    ]
    G = np.array(rows)
    C = np.zeros((8, 8))
    C[:3, :3], C[:3, 3:6], C[3:6, :3], C[3:6, 3:6], C[6:, 6:] = A, B, B, D, S
    K = np.einsum("ripq,rs,sjpq,pq->ij", G, C, G, area)
    value = np.array([own[0] for own in functions])
    M = np.zeros((5, 5))
    for i, j, inertia in (
        *((i, i, moments[0]) for i in range(3)),
        *((i, i, moments[2]) for i in (3, 4)),
        *((i, i + 3, moments[1]) for i in (0, 1)),
        *((i + 3, i, moments[1]) for i in (0, 1)),
    ):
        M[i, j] += inertia * (area * value[i] * value[j]).sum()
    load = np.array([0.0, 0.0, (area * (sx * sy) * value[2]).sum(), 0.0, 0.0])
    return K, M, load


def assert_made_anew(operators, anew, theta, value=5e-8, slope=1e-6, step=1e-4):
    """Affine operators at θ, and their slopes by central differences, are those that are made anew, over √(X_ii X_jj)."""
    for which, X in enumerate(operators):
        at = X.at(theta).toarray()
        d = np.sqrt(np.diag(at))
        scale = np.outer(d, d) + (np.outer(d, d) == 0)
        assert np.abs((at - anew(theta)[which].toarray()) / scale).max() < value
        for name, own in theta.items():
            up, down = (anew({**theta, name: own * (1 + k * step)})[which] for k in (1, -1))
            assert np.abs((own * X.derivative(name, theta) - (up - down) / (2 * step)).toarray() / scale).max() < slope
