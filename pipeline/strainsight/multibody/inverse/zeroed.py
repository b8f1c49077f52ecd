"""What a zeroed sensor was taken to read when it was zeroed, which depends on the parameters that are estimated."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable

import numpy as np

from strainsight.multibody.accelerations import at_rest
from strainsight.multibody.inverse.followed import Rest, followed, rest_at
from strainsight.multibody.inverse.parameters import ParameterCoordinates
from strainsight.multibody.sensors import Readings
from strainsight.multibody.system import System

Zero = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
REMEMBERED = 64


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
