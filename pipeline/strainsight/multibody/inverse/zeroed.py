"""What a zeroed sensor was taken to read when it was zeroed, which depends on the parameters that are estimated."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np

from strainsight.multibody.accelerations import at_rest
from strainsight.multibody.inverse.parameters import ParameterCoordinates
from strainsight.multibody.inverse.start import static_response
from strainsight.multibody.sensors import Readings
from strainsight.multibody.static import static_equilibrium
from strainsight.multibody.system import System

Zero = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


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
    are remembered.
    """
    still = np.zeros(system.size)

    @lru_cache(maxsize=256)
    def at(xi: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
        theta, slopes = coordinates.theta(np.array(xi))
        rest, _ = static_equilibrium(system, q, u, theta, near=True)
        y, H, _ = sensors.read(rest, still, at_rest(system, u))
        by_theta = static_response(system, rest, u, theta)[1]
        return np.where(zeroed, y, 0.0), np.where(zeroed[:, None], H @ by_theta @ slopes, 0.0)

    return lambda xi: at(tuple(xi.tolist()))
