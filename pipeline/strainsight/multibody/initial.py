"""States to start from: poses, consistent positions and velocities, and static equilibrium."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import qr

from strainsight.compiled import inner, kept
from strainsight.errors import InfeasibleError, NumericalError, did_you_mean
from strainsight.multibody.accelerations import TINY, Balance, balance, mass_at, saddle, unit_rows
from strainsight.multibody.bodies import cross_matrix
from strainsight.multibody.compiled.arrays import compile_system
from strainsight.multibody.joints import drive, drive_relations
from strainsight.multibody.relations import Relations, carried_vectors, relation_rows, rows
from strainsight.multibody.system import System

DEPENDENT = 1e-9
"""Share of a constraint's gradient (unit rows, in the metric) outside the others below which it depends on them."""

CONSISTENT = 1e-6
"""Share of a state that may violate its constraints: what a person writes down is rounded."""
NEAREST = 20
"""Iterations of `nearest_state`."""
AT_REST = 1e-15
"""A smaller correction, relative to the state in the metric, is zero."""


@dataclass(frozen=True)
class Pose:
    """Where a body is and how it moves: r (3,) [m], R (3, 3), ṙ (3,) [m/s], ω (3,) [rad/s] in global axes, η, η̇ (n,)."""

    position: np.ndarray = field(default_factory=lambda: np.zeros(3))
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    velocity: np.ndarray = field(default_factory=lambda: np.zeros(3))
    spin: np.ndarray = field(default_factory=lambda: np.zeros(3))
    modal: np.ndarray | None = None
    modal_velocity: np.ndarray | None = None


def state(system: System, poses: Mapping[str, Pose]) -> tuple[np.ndarray, np.ndarray]:
    """q, v (n,) of bodies in these poses, Ṙ = [ω]×R; a body without one sits at the origin at rest."""
    for name in poses:
        if name not in system.of:
            raise InfeasibleError(
                f"body {name} not found", remedy=did_you_mean(name, system.of, f"bodies: {', '.join(system.of)}")
            )
    q, v = np.zeros(system.size), np.zeros(system.size)
    for body in system.bodies:
        pose, at = poses.get(body.name, Pose()), system.of[body.name].start
        if body.moves:
            R = np.asarray(pose.rotation, dtype=float)
            q[at : at + 3], v[at : at + 3] = pose.position, pose.velocity
            q[at + 3 : at + 12] = R.T.ravel()
            v[at + 3 : at + 12] = (cross_matrix(np.asarray(pose.spin, dtype=float)) @ R).T.ravel()
        eta = system.modal(body.name)
        q[eta] = 0.0 if pose.modal is None else pose.modal
        v[eta] = 0.0 if pose.modal_velocity is None else pose.modal_velocity
    return q, v


def constraints_at(
    system: System, q: np.ndarray, u: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """φ (m,), B (m, n) and φ_t (m,), the rate of φ at rest; u: the loads with p and ṗ behind them, of a system with driven
    joints."""
    rho, G, *_ = relation_rows(system.products, q, np.zeros_like(q))
    m = system.constrained
    if not system.drives.names:
        return rho[:m], G[:m], np.zeros(m)
    if u is None:
        raise ValueError(
            "constraints of a system with driven joints depend on time: pass the inputs u (loads, driven motions and rates)"
        )
    driven = drive(system.drives, m, u, rho, G)
    assert driven is not None
    return rho[:m], G[:m], driven.rate


def driven_slopes(system: System, q: np.ndarray, u: np.ndarray) -> list[tuple[str, float]]:
    """Drive and φ_p of every driven angle: −1 where the angle is p, 1 where it is p + π."""
    rho, G, *_ = relation_rows(system.products, q, np.zeros_like(q))
    driven, drives = drive(system.drives, system.constrained, u, rho, G), system.drives
    if driven is None:
        return []
    angles = drives.power == 0
    return [
        (drives.names[k], float(slope)) for k, slope in zip(drives.which[angles], driven.slope[angles], strict=True)
    ]


def project_position(system: System, q: np.ndarray, u: np.ndarray | None = None) -> np.ndarray:
    """The nearest q with φ(q) = 0, in the metric of the mass: Gauss-Newton, q ← q − D⁻²Bᵀ(BD⁻²Bᵀ)⁺φ. Raises InfeasibleError
    if no configuration nearby satisfies the joints (the worst are named), if they are redundant there (the dependent ones are
    named), or if an unconstrained motion has no mass."""
    q = np.array(q, dtype=float)
    d = system.metric
    if not system.constrained:
        return q
    for _ in range(50):
        phi, B, _ = constraints_at(system, q, u)
        unit, s = unit_rows(B, 1 / d)
        # pseudo-inverse: redundant joints are permitted, inconsistent ones are not
        x = np.linalg.lstsq(unit, -s * phi, rcond=1e-10)[0]
        size, whole = np.linalg.norm(x), np.linalg.norm(d * q)
        if size > 0.5 * whole:
            x *= 0.5 * whole / size
        q += x / d
        if size <= 1e-15 * whole:
            break
    phi, B, _ = constraints_at(system, q, u)
    violation = np.abs(phi) * unit_rows(B, 1 / d)[1] / np.linalg.norm(d * q)
    if np.max(violation) > 1e-9:
        worst = [i for i in np.argsort(-violation)[:4] if violation[i] > 1e-2 * np.max(violation)]
        listed = "; ".join(f"residual {phi[i]:.3g} in the position constraint '{system.constraints[i]}'" for i in worst)
        raise InfeasibleError(
            f"the joints cannot all be satisfied near the current positions of the bodies: {listed}",
            remedy="correct the positions of the frames of the joints, or set poses of the bodies closer to the assembled bench",
        )
    check_regular(system, q, u)
    return q


def project_velocity(system: System, q: np.ndarray, v: np.ndarray, u: np.ndarray | None = None) -> np.ndarray:
    """The nearest v with B(q)v = −φ_t, in the metric of the mass; q (n,) on the constraints; u as in `constraints_at`."""
    d = system.metric
    _, B, rate = constraints_at(system, q, u)
    if not len(B):
        return np.array(v, dtype=float)
    unit, s = unit_rows(B, 1 / d)
    y = d * v
    for _ in range(2):
        y = y - np.linalg.lstsq(unit, unit @ y + s * rate, rcond=1e-10)[0]
    return y / d


def nearest_state(
    system: System, q: np.ndarray, v: np.ndarray, u: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """q, v (n,) with φ(q) = 0 and B(q)v = −φ_t, nearest in the metric of the mass:

        q ← q − D⁻²Bᵀ(BD⁻²Bᵀ)⁻¹φ(q) until it rests,     v ← v − D⁻²Bᵀ(BD⁻²Bᵀ)⁻¹(Bv + φ_t)

    as `project_position` and `project_velocity`, without their questions whether the joints are independent: that is for
    the start. u as of `constraints_at`. Raises InfeasibleError as `project_position` does, where no configuration nearby
    satisfies the joints."""
    q, v = np.array(q, dtype=float), np.array(v, dtype=float)
    if not system.constrained:
        return q, v
    s = compile_system(system).natural
    loads = np.zeros(0) if u is None else np.ascontiguousarray(u, dtype=float)
    if _nearest(s.relations, s.body, s.d, s.drive, s.drive_at, s.drives, system.constrained, loads, q, v):
        return q, v
    project_position(system, q, u)
    raise InfeasibleError(
        "the joints cannot be satisfied near the current positions of the bodies",
        remedy="use a smaller time step; in a filter run, set estimate.method.update: iterated",
    )


@kept("multibody/bodies.py", "multibody/joints.py", "multibody/relations.py")
def _nearest(
    r: Relations,
    body: np.ndarray,
    d: np.ndarray,
    drive: np.ndarray,
    at: int,
    drives: int,
    m: int,
    u: np.ndarray,
    q: np.ndarray,
    v: np.ndarray,
) -> bool:
    """`nearest_state` in place; drive, at, drives as in `Arrays`. Whether it rests."""
    n, before = len(q), np.inf
    still, none, rate, s = np.zeros(n), np.zeros((0, n)), np.zeros(m), np.empty(m)
    for _ in range(NEAREST):
        rho, rho_dot, g, _, _ = rows(r, body, carried_vectors(r, body, q, still), n, n < 0)
        by = np.zeros((len(drive), n + 2))
        drive_relations(drive, at, drives, u, rho, rho_dot, g, none, by)
        for k in range(len(drive)):
            rate[drive[k, 0]] = by[k, n] * u[at + drives + drive[k, 2]]
        for i in range(m):
            g[i] /= d
            s[i] = 1 / max(np.sqrt(np.sum(g[i] ** 2)), TINY)
            g[i] *= s[i]
        unit = g[:m]
        lower = unit @ unit.T
        if not _cholesky(lower):
            return False
        x = _across(unit, lower, s * rho[:m])
        q -= x / d
        size, whole = np.sqrt(np.sum(x**2)), np.sqrt(np.sum((d * q) ** 2))
        if not np.isfinite(size):
            return False
        if size <= AT_REST * whole or (size < 1e-12 * whole and size > 0.3 * before):
            y = d * v
            for _ in range(2):
                y -= _across(unit, lower, unit @ y + s * rate)
            v[:] = y / d
            return True
        before = size
    return False


@inner
def _cholesky(A: np.ndarray) -> bool:
    """A = L Lᵀ (m, m), L in its lower half; whether A is positive definite."""
    for j in range(len(A)):
        for i in range(j, len(A)):
            for k in range(j):
                A[i, j] -= A[i, k] * A[j, k]
            if i == j and not A[j, j] > 0.0:
                return False
            A[i, j] = np.sqrt(A[j, j]) if i == j else A[i, j] / A[j, j]
    return True


@inner
def _across(B: np.ndarray, lower: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Bᵀ(BBᵀ)⁻¹ value (m,) of B (m, n), lower Cholesky's factor of BBᵀ; value is overwritten."""
    m = len(value)
    for i in range(m):
        for k in range(i):
            value[i] -= lower[i, k] * value[k]
        value[i] /= lower[i, i]
    for i in range(m - 1, -1, -1):
        for k in range(i + 1, m):
            value[i] -= lower[k, i] * value[k]
        value[i] /= lower[i, i]
    return value @ B


def check_consistent(system: System, q: np.ndarray, v: np.ndarray, u: np.ndarray | None = None) -> None:
    """Raise InfeasibleError naming the constraints that a state violates, φ(q) ≠ 0 or B(q)v ≠ −φ_t, relative to its size."""
    d = system.metric
    phi, B, rate = constraints_at(system, q, u)
    if not len(phi):
        return
    s = unit_rows(B, 1 / d)[1]
    for what, off, whole in (("position", phi, d * q), ("velocity", B @ v + rate, d * v)):
        share = np.abs(off) * s / max(float(np.linalg.norm(whole)), TINY)
        worst = np.argsort(-share)[:3]
        if share[worst[0]] > CONSISTENT:
            listed = "; ".join(
                f"residual {off[i]:.3g} in the {what} constraint '{system.constraints[i]}'"
                for i in worst
                if share[i] > CONSISTENT
            )
            raise InfeasibleError(
                f"the state does not satisfy the joints: {listed}",
                remedy="compute the initial state with `project_position` and `project_velocity`",
            )


def check_regular(system: System, q: np.ndarray, u: np.ndarray | None = None) -> None:
    """Raise InfeasibleError naming constraints that depend on others at q, a body that can move without mass, or one whose
    inertia is out of all proportion.

    Pivoted QR of the joints' gradients after those of the rigid motions, unit rows in the metric of the mass."""
    d, rigid = system.metric, system.rigid
    _, B, _ = constraints_at(system, q, u)
    if not len(B):
        return
    B = B / d
    norms = np.linalg.norm(B, axis=1)
    unconstrained = [system.constraints[i] for i in range(len(B)) if norms[i] <= DEPENDENT * norms.max()]
    heavy = np.flatnonzero(norms[:rigid] <= DEPENDENT * norms.max())
    if len(heavy):
        # a body's rigidity always changes with its coordinates: only its weight in the metric can hide that
        body = [b.name for b in system.bodies if b.moves][heavy[0] // 6]
        raise InfeasibleError(
            f"the inertia of body {body} is about {(norms.max() / norms[heavy[0]]) ** 2:.0e} times the smallest inertia of the "
            "bench: too large to solve the constraints",
            remedy="check the masses [kg] and moments of inertia [kg m²] of the bodies",
        )
    if unconstrained:
        raise InfeasibleError(
            f"the constraint '{'; '.join(unconstrained)}' restrains no motion at the current positions of the bodies",
            remedy="remove the constraint, or rotate the axes of a frame of the joint",
        )
    B = B / norms[:, None]
    basis = np.linalg.qr(B[:rigid].T)[0]
    joints = B[rigid:].T - basis @ (basis.T @ B[rigid:].T)
    if joints.shape[1]:
        _, T, order = qr(joints, mode="economic", pivoting=True)
        diagonal = np.abs(np.diag(T))
        rank = int(np.sum(diagonal > DEPENDENT * max(diagonal[0], 1.0)))
        if rank < joints.shape[1]:
            raise InfeasibleError(
                _dependence(system, T, order + rigid, rank),
                remedy="use a joint type with fewer constraints: cylindrical, spherical, pin, perpendicular or coincidence",
            )
    null = np.linalg.svd(B)[2][len(B) :].T
    if null.shape[1]:
        mass = mass_at(system, q) / np.outer(d, d)
        values, vectors = np.linalg.eigh(null.T @ mass @ null)
        if values[0] < 1e-10 * values[-1]:
            raise InfeasibleError(
                f"body {system.most_in(null @ vectors[:, 0])} can move without inertia (smallest eigenvalue of the mass "
                f"matrix of the free motions: {values[0] / values[-1]:.1e} times the largest)",
                remedy="specify mass and inertia of this body, or constrain the motion with a joint",
            )


def _dependence(system: System, T: np.ndarray, order: np.ndarray, rank: int) -> str:
    """Message about columns beyond the rank, and those on which each depends."""
    names = system.constraints
    shares = np.linalg.solve(T[:rank, :rank], T[:rank, rank:])
    dependent = []
    for k, share in zip(order[rank:], shares.T, strict=True):
        others = [names[order[i]] for i in np.argsort(-np.abs(share)) if abs(share[i]) > 1e-6][:4]
        dependent.append(f"'{names[k]}' follows from {', '.join(others) or 'rigid-body constraints'}")
    listed = "; ".join(dependent[:6])
    return (
        f"{len(dependent)} of {len(names)} constraints are redundant at the current positions of the bodies ({listed})"
    )


ITERATIONS = 200
CONVERGED = 1e-12
ROUNDING = 1e-8
"""A correction below this that no longer shrinks is rounding."""
NEAR = 1e-11
"""Shift of the first step, relative to the stiffness, if q is nearly in equilibrium: a Newton step."""
FIRMEST = 1e6
"""Largest shift, relative to the stiffness, to avoid a trial state that a force does not permit."""
FREE = 1e-12
"""Stiffness of a motion, relative to the largest (in the metric of the mass), below which it is unrestrained."""


def static_equilibrium(
    system: System, q: np.ndarray, u: np.ndarray, theta: np.ndarray, near: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """q (n,) and λ (m,) with  f(q, 0, u, θ) = Bᵀλ,  φ(q) = 0,  from the configuration q.

        [K + D²/τ²   −Bᵀ] [Δq]     [f − Bᵀλ]
        [B            0 ] [λ'] = − [φ      ],     τ grows as the imbalance falls: at last Newton's own steps

    the motion of the system under heavy damping with ever longer time steps, which goes downhill in the potential (from
    the very top of it, it stays there). near: q is an equilibrium of nearly the same loads and parameters.
    Raises NumericalError where it does not settle, InfeasibleError where nothing holds some motion of a body (named).
    Source: pseudo-transient continuation, Kelley and Keyes, SIAM J. Numer. Anal. 35 (1998)."""
    q, u, theta = np.array(q, dtype=float), np.asarray(u, dtype=float), np.asarray(theta, dtype=float)
    d, m, n = system.metric, system.constrained, system.size
    still, lam = np.zeros(n), np.zeros(m)
    at = balance(system, q, still, u, theta)
    K, B, s = in_the_metric(at, d)
    if m:
        lam = np.linalg.lstsq(B.T, at.load / d, rcond=None)[0] * s
    stiffness = float(np.linalg.norm(K, 2)) or 1.0
    before, shift, whole, good = np.inf, NEAR * stiffness if near else stiffness, 1.0, (q, lam)
    for _ in range(ITERATIONS):
        try:
            at = balance(system, q, still, u, theta, lam=lam)
        except NumericalError:
            # a force that cannot be had at a trial state: go there in smaller steps
            shift = max(10 * shift, 1e-3 * stiffness)
            if shift > FIRMEST * stiffness:
                raise
            q, lam = good
            continue
        good = q, lam
        K, B, s = in_the_metric(at, d)
        try:
            z = np.linalg.solve(saddle(K + shift * np.eye(n), B), -np.concatenate([at.load / d, s * at.phi]))
        except np.linalg.LinAlgError:
            if before < 1e-6 * whole:
                refuse_free(system, K, B)
            shift = max(4 * shift, 1e-6 * stiffness)
            continue
        x, whole = z[:n], float(np.linalg.norm(d * q)) or 1.0
        size = float(np.linalg.norm(x))
        if m and size > 0.3 * whole:
            x *= 0.3 * whole / size
        q, lam = q + x / d, z[n:] * s
        if shift < 1e-10 * stiffness and (
            size <= CONVERGED * whole or (size < ROUNDING * whole and size > 0.3 * before)
        ):
            at = balance(system, q, still, u, theta, lam=lam)
            refuse_free(system, *in_the_metric(at, d)[:2])
            return q, lam
        shift *= 0.2 if size < before or size < ROUNDING * whole else 2.0
        before = size
    raise NumericalError(
        f"no static equilibrium was found in {ITERATIONS} iterations (last change of the mass-weighted coordinates: "
        f"{before:.2g}; limit {CONVERGED * whole:.2g})",
        remedy="set poses of the bodies closer to the equilibrium, or restrain the free motion with a joint or a spring",
    )


def in_the_metric(at: Balance, d: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """D⁻¹K D⁻¹ (n, n), S B D⁻¹ (m, n) of unit rows, and S (m,), by which λ = S λ'."""
    return at.stiffness / np.outer(d, d), *unit_rows(at.B, 1 / d)


def refuse_free(system: System, K: np.ndarray, B: np.ndarray) -> None:
    """Raise InfeasibleError, with the body, where nothing holds a motion on B x = 0; K (n, n), B (m, n) as of `in_the_metric`."""
    null = np.linalg.svd(B)[2][len(B) :].T if len(B) else np.eye(system.size)
    if not null.shape[1]:
        return
    _, sigma, V = np.linalg.svd(null.T @ K @ null)
    if sigma[-1] < FREE * max(sigma[0], TINY):
        share = sigma[-1] / max(sigma[0], 1e-300)
        raise InfeasibleError(
            f"no stiffness restrains body {system.most_in(null @ V[-1])} in one motion "
            f"(stiffness against this motion: {share:.1e} of the largest stiffness of the bench)",
            remedy="restrain this motion of the body with a joint or a spring",
        )
