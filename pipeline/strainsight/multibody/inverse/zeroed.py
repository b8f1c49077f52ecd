"""What a zeroed sensor was taken to read when it was zeroed, which depends on the parameters that are estimated."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from strainsight.errors import NumericalError
from strainsight.multibody.accelerations import at_rest
from strainsight.multibody.equations import balance, parameter_slopes
from strainsight.multibody.inverse.parameters import ParameterCoordinates
from strainsight.multibody.inverse.start import static_response
from strainsight.multibody.sensors import Readings
from strainsight.multibody.static import CONVERGED, ROUNDING, in_the_metric, refuse_free, static_equilibrium
from strainsight.multibody.system import System

Zero = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
REMEMBERED = 64
STEPS = 8
"""Of Newton's iteration; one that has not ended by then began too far away."""


def zero_at_rest(
    system: System,
    sensors: Readings,
    zeroed: np.ndarray,
    q: np.ndarray,
    u: np.ndarray,
    coordinates: ParameterCoordinates,
) -> Zero:
    """ξ (p,) → offset (m,) and ∂offset/∂ξ (m, p): the readings h(q₀(ξ)) of the zeroed channels (m,) of bool, 0 of the others,

        f(q₀, 0, u, θ(ξ)) = Bᵀλ,   φ(q₀) = 0,   from q (n,), under the loads u (all inputs,) at which they were zeroed.

    A sensor that was zeroed at rest tells nothing of what deformed the bench then, whatever its stiffness. The last answers
    are remembered, and every equilibrium is followed from the nearest.
    """
    still = np.zeros(system.size)
    answers: OrderedDict[bytes, tuple[Rest, np.ndarray, np.ndarray]] = OrderedDict()

    def at(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = xi.tobytes()
        if key not in answers:
            theta, by_xi = coordinates.theta(xi)
            if answers:
                near = min(answers, key=lambda known: float(np.abs(np.frombuffer(known) - xi).max(initial=0.0)))
                rest = followed(system, answers[near][0], u, theta)
            else:
                rest = rest_at(system, q, u, theta)
            y, H, _ = sensors.read(rest.q, still, at_rest(system, u))
            answers[key] = rest, np.where(zeroed, y, 0.0), np.where(zeroed[:, None], H @ rest.by_theta @ by_xi, 0.0)
            if len(answers) > REMEMBERED:
                answers.popitem(last=False)
        return answers[key][1:]

    return at


@dataclass(frozen=True, eq=False)
class Rest:
    """q (n,), λ (m,) in equilibrium at θ (nθ,), and by_theta (n, nθ) = ∂q/∂θ."""

    theta: np.ndarray
    q: np.ndarray
    lam: np.ndarray
    by_theta: np.ndarray


def rest_at(system: System, q: np.ndarray, u: np.ndarray, theta: np.ndarray) -> Rest:
    """The equilibrium under u near q (n,). Raises what `static_equilibrium` and `static_response` raise."""
    q, lam = static_equilibrium(system, q, u, theta, near=True)
    return Rest(theta, q, lam, static_response(system, q, u, theta)[1])


def followed(system: System, known: Rest, u: np.ndarray, theta: np.ndarray) -> Rest:
    """The equilibrium at θ (nθ,), from one that is known under the same loads u, by

        [K  −Bᵀ] [Δq  ∂q]     [f  ∂f/∂θ]
        [B   0 ] [λ'  ∂λ] = − [φ  0    ]

    from q + ∂q Δθ; where that does not end it is sought as by `rest_at`. Raises InfeasibleError, as
    that does, where nothing holds some motion at θ.
    """
    return _newton(system, known, u, theta) or rest_at(system, known.q, u, theta)


def _newton(system: System, known: Rest, u: np.ndarray, theta: np.ndarray) -> Rest | None:
    d, n, m = system.metric, system.size, system.constrained
    q, lam = known.q + known.by_theta @ (theta - known.theta), known.lam
    still, none, before = np.zeros(n), np.zeros(m), np.inf
    right = np.zeros((n + m, 1 + len(theta)))
    for _ in range(STEPS):
        try:
            at = balance(system, q, still, still, none, lam, u, theta)
            K, B, s = in_the_metric(at, d)
            right[:n, 0], right[n:, 0] = -at.load / d, -s * at.phi
            right[:n, 1:] = -parameter_slopes(system, at, q, still) / d[:, None]
            z = np.linalg.solve(np.block([[K, -B.T], [B, np.zeros((m, m))]]), right)
        except (NumericalError, np.linalg.LinAlgError):
            return None
        size, whole = float(np.linalg.norm(z[:n, 0])), float(np.linalg.norm(d * q)) or 1.0
        q, lam = q + z[:n, 0] / d, z[n:, 0] * s
        if size <= CONVERGED * whole or (size < ROUNDING * whole and size > 0.3 * before):
            refuse_free(system, K, B)
            return Rest(theta, q, lam, z[:n, 1:] / d[:, None])
        if not size < before:
            return None
        before = size
    return None
