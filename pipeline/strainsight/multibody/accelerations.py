"""Accelerations at an instant, and what joints and drives carry there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dgecon, dgetrf, dgetrs

from strainsight.multibody.drives import DrivenRelation
from strainsight.multibody.equations import balance
from strainsight.multibody.frames import Carried, Frame
from strainsight.multibody.joints import Joint
from strainsight.multibody.relations import Relation
from strainsight.multibody.system import System


@dataclass(frozen=True)
class Instant:
    """v̇ (n,), λ (m,), and of every drive the force or torque (nd,) [N or N m] that does the work force · ṗ on the bench."""

    acceleration: np.ndarray
    lam: np.ndarray
    drive: np.ndarray


def instant(
    system: System, q: np.ndarray, v: np.ndarray, u: np.ndarray, theta: np.ndarray, p_second: np.ndarray
) -> Instant:
    """What (1.3) says of a state on the constraints, free of any time step:

        [M  −Bᵀ] [v̇]     [c + f                                  ]
        [B   0 ] [λ ] = − [B_rate v + ṗ (B_p v + ∂φ_t/∂p) + φ_p p̈]

    q, v (n,) with φ = 0, Bv = −φ_t; u as in `advance`; p_second (nd,) p̈ of the drives. Where constraints become dependent, the
    smallest λ. The force of a drive is −Σ λ φ_p.
    """
    n, m, d, drives = system.size, system.constrained, system.metric, system.drives
    none = np.zeros(m)
    at = balance(system, q, v, np.zeros(n), none, none, u, theta, system.at(theta))
    bend = at.B_rate @ v
    if at.driven is not None:
        p_rate = u[drives.at + len(drives.names) :]
        for i, (row, k) in enumerate(zip(drives.row, drives.which, strict=True)):
            bend[row] += p_rate[k] * (at.driven.gradient[i] @ v + at.driven.bend[i]) + at.driven.slope[i] * p_second[k]
    B = at.B / d
    s = 1 / np.maximum(np.linalg.norm(B, axis=1), np.finfo(float).tiny)
    B *= s[:, None]
    A = np.block([[at.mass / np.outer(d, d), -B.T], [B, np.zeros((m, m))]])
    z = _solved(A, -np.concatenate([at.load / d, s * bend]))
    lam, force = z[n:] * s, np.zeros(len(drives.names))
    if at.driven is not None:
        np.add.at(force, drives.which, -lam[drives.row] * at.driven.slope)
    return Instant(z[:n] / d, lam, force)


def _solved(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """A⁻¹b, the smallest of the nearest where A is singular: by LU factors where these say that it is regular."""
    lu, order, failed = dgetrf(A)
    if failed == 0 and dgecon(lu, np.abs(A).sum(axis=0).max())[0] > 1e-9:
        return np.asarray(dgetrs(lu, order, b)[0])
    return np.asarray(np.linalg.lstsq(A, b, rcond=1e-12)[0])


def reaction(
    system: System, joint: Joint, i: Frame, j: Frame, q: np.ndarray, lam: np.ndarray, u: np.ndarray
) -> np.ndarray:
    """Force [N] and moment [N m] about p_j (6,), in the axes of i, that the joint exerts on the body of j:

        F = Σ λ t y,    M = Σ λ (b − t p_j) × y     over the products b·y of its relations, b = t r + R c carried by that body

    for δ(b·y) = t δp_j·y + δθ·((b − t p_j) × y) in a virtual motion of that body about p_j. λ (m,) as of `instant`.
    """
    first = _first_row(system, joint)
    side, sign = (j.body, 1.0) if j.body is not None else (i.body, -1.0)
    p, F, M = _vector(system, j.point, q), np.zeros(3), np.zeros(3)
    for k, own in enumerate(joint.relations):
        for relation, share in _products(system, own, u):
            weight = sign * share * lam[first + k]
            x, y = (sum(_vector(system, b, q) for b in side_of) for side_of in (relation.x, relation.y))
            for vectors, other in ((relation.x, y), (relation.y, x)):
                for b in vectors:
                    if b.body == side:
                        F += weight * b.t * other
                        M += weight * np.cross(_vector(system, b, q) - b.t * p, other)
    axes = np.stack([_vector(system, i.axis(k), q) for k in range(3)])
    return np.concatenate([axes @ F, axes @ M])


def _first_row(system: System, joint: Joint) -> int:
    """Row of the joint's first constraint: those of the rigid motions stand before all joints."""
    return system.constrained - sum(len(own.relations) for own in system.joints[system.joints.index(joint) :])


def _products(system: System, own: Relation | DrivenRelation, u: np.ndarray) -> list[tuple[Relation, float]]:
    """The relations of a constraint, each with its factor."""
    if isinstance(own, Relation):
        return [(own, 1.0)]
    p = u[system.drives.at + system.drives.names.index(own.drive)]
    if own.across is None:
        return [(own.relation, 1.0)]
    return [(own.relation, float(np.cos(p))), (own.across, -float(np.sin(p)))]


def _vector(system: System, b: Carried, q: np.ndarray) -> np.ndarray:
    """b (3,) at q."""
    if b.body is None:
        return np.asarray(b.c)
    own, eta = system.of[b.body], q[system.modal(b.body)]
    c = b.c + b.C @ eta if b.C.shape[1] else b.c
    if own.stop - own.start == len(eta):
        return np.asarray(c)
    r, R = q[own][:3], q[own][3:12].reshape(3, 3).T
    return np.asarray(b.t * r + R @ c)
