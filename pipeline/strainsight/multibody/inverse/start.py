"""What is known at the start, and how strong a disturbance is, as covariances that the constraints allow."""

from __future__ import annotations

import numpy as np
from scipy.linalg import block_diag

from strainsight.errors import InfeasibleError
from strainsight.multibody.bodies import RigidBody
from strainsight.multibody.equations import input_slopes, parameter_slopes
from strainsight.multibody.inverse.parameters import ParameterCoordinates
from strainsight.multibody.spectrum import tangent_space
from strainsight.multibody.static import FREE
from strainsight.multibody.system import System


def start_covariance(
    system: System,
    q: np.ndarray,
    u: np.ndarray,
    theta: np.ndarray,
    coordinates: ParameterCoordinates,
    inputs: np.ndarray,
    std_u: np.ndarray,
    std_xi: np.ndarray,
    spread: float | tuple[float, float] = 0.0,
) -> np.ndarray:
    """P (2n + nu + p square) of (q, v, u, ξ) for a start in equilibrium under loads and parameters badly known:

        P = J diag(std²) Jᵀ + T_q σ_q² T_qᵀ + T_v σ_v² T_vᵀ,     J = ∂(q, 0, u, ξ)/∂(u, ξ),     K ∂q = −∂f on B ∂q = 0

    q (n,) in equilibrium under all inputs u and θ (nθ,); inputs (nu,): places of the unknown ones; std_u (nu,) [N, N m];
    std_xi (p,) [-], or the covariance (p, p) of ξ; spread: σ_q [m √kg], σ_v [m √kg/s] of further motions (one number: both)
    in the metric of the mass, along all that the constraints leave (T). P has its range in the tangent space.
    Raises InfeasibleError for deviations of the wrong number, and where nothing holds a motion of the system.
    """
    n, inputs = system.size, np.asarray(inputs, dtype=int)
    std_u, std_xi = np.atleast_1d(np.asarray(std_u, dtype=float)), np.asarray(std_xi, dtype=float)
    if std_u.shape != inputs.shape or std_xi.shape[:1] != (coordinates.size,):
        raise InfeasibleError(
            f"{std_u.size} deviations for {inputs.size} inputs, {len(np.atleast_1d(std_xi))} for {coordinates.size} parameters"
        )
    by_u, by_theta = static_response(system, q, u, theta)
    response = np.concatenate([by_u[:, inputs], by_theta @ coordinates.theta(coordinates.xi(theta))[1]], axis=1)
    J = np.concatenate([response, np.zeros((n, response.shape[1])), np.eye(response.shape[1])])
    known = block_diag(np.diag(std_u**2), np.diag(std_xi**2) if std_xi.ndim == 1 else std_xi)
    P = J @ known @ J.T
    along_q, along_v = spread if isinstance(spread, tuple) else (spread, spread)
    T = tangent_space(system, q, np.zeros(n), u, theta).T
    TT = T @ T.T
    P[:n, :n] += along_q**2 * TT
    P[n : 2 * n, n : 2 * n] += along_v**2 * TT
    return 0.5 * (P + P.T)


def static_response(system: System, q: np.ndarray, u: np.ndarray, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """∂q/∂u (n, all inputs) and ∂q/∂θ (n, nθ) of an equilibrium q (n,):  K ∂q = −∂f  on  B ∂q = 0.

    Raises InfeasibleError where nothing holds a motion of the system.
    """
    found = tangent_space(system, q, np.zeros(system.size), u, theta)
    by_u = input_slopes(system, found.at, np.asarray(q, dtype=float))
    by_theta = parameter_slopes(system, found.at, q, np.zeros(system.size))
    pulls = np.concatenate([by_u, by_theta], axis=1)
    K = found.project(found.at.stiffness)
    if len(K) and not np.linalg.cond(K) < 1 / FREE:
        raise InfeasibleError(
            "nothing holds a motion of the system at the start", remedy="hold it with a joint or a spring"
        )
    response = -found.T @ np.linalg.solve(K, found.T.T @ pulls)
    return response[:, : by_u.shape[1]], response[:, by_u.shape[1] :]


def white_force(system: System, acceleration: float) -> np.ndarray:
    """Variances Q_w (n,) of the white generalised force that stands for a white acceleration a [m/s²] of every body:

    (d √m a)², m the mass of the body [kg], d the metric of its coordinates: √kg for r, m √kg for R, √M_kk for η.
    """
    variance = np.empty(system.size)
    for body in system.bodies:
        mass = body.mass if isinstance(body, RigidBody) else body.invariants.mass
        own = system.of[body.name]
        variance[own] = (system.metric[own] * acceleration) ** 2 * mass
    return variance
