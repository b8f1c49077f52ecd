"""Unknown parameters as numbers without bounds; what is known at the start, and of sensors that were zeroed there."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from strainsight.errors import InfeasibleError, NumericalError, did_you_mean
from strainsight.multibody.accelerations import at_rest, balance, input_slopes, parameter_slopes, saddle
from strainsight.multibody.bearing.geometry import PARAMETERS
from strainsight.multibody.bodies import RigidBody
from strainsight.multibody.coupled import tangent_space
from strainsight.multibody.initial import CONVERGED, FREE, ROUNDING, in_the_metric, refuse_free, static_equilibrium
from strainsight.multibody.sensors import CompiledSensors
from strainsight.multibody.system import System

MICROMETRE = 1e-6
RADII = range(1, 5)


@dataclass(frozen=True, eq=False)
class _Unknown:
    """One free parameter: place in θ and in ξ; kind "log", "preload", "diameter" or "radius"; smallest: the least groove
    radius less the preload that bounds a diameter [m]; ball: place in ξ of a radius' diameter (−1: it is known) and its
    known value [m]; oversize: known positive preload [m]."""

    name: str
    at: int
    kind: str
    smallest: float = 0.0
    ball: int = -1
    diameter: float = 0.0
    oversize: float = 0.0


@dataclass(frozen=True, eq=False)
class ParameterCoordinates:
    """ξ (p,) for the free ones of the parameters θ (nθ,) of a system; made by `parameter_coordinates`.

        modulus:    ξ = ln θ                     preload:  ξ = θ / 1 µm
        radius:     ξ = ln(2(r − s)/D − 1)       so that r > D/2 + s
        diameter:   ξ = ln(2(r_min − s)/D − 1)   r_min the least radius that is known; ξ = ln D where none is

    s: a known preload above zero, else 0. names (p,): the free ones in the order of ξ; reference (nθ,): values of the others.
    """

    names: tuple[str, ...]
    reference: np.ndarray
    unknowns: tuple[_Unknown, ...]

    @property
    def size(self) -> int:
        """p."""
        return len(self.names)

    @property
    def free(self) -> np.ndarray:
        """Places (p,) of the free parameters in θ."""
        return np.array([unknown.at for unknown in self.unknowns], dtype=int)

    def theta(self, xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """θ (nθ,) and ∂θ/∂ξ (nθ, p) at ξ (p,); a diameter moves the radii that are free with it."""
        theta = self.reference.copy()
        slopes = np.zeros((len(theta), self.size))
        for k, unknown in enumerate(self.unknowns):
            if unknown.kind == "preload":
                theta[unknown.at], slopes[unknown.at, k] = MICROMETRE * xi[k], MICROMETRE
            elif unknown.kind == "log":
                theta[unknown.at] = slopes[unknown.at, k] = np.exp(xi[k])
            elif unknown.kind == "diameter":
                play = np.exp(xi[k])
                theta[unknown.at] = 2 * unknown.smallest / (1 + play)
                slopes[unknown.at, k] = -theta[unknown.at] * play / (1 + play)
        for k, unknown in enumerate(self.unknowns):
            if unknown.kind == "radius":
                play = np.exp(xi[k])
                ball = unknown.diameter if unknown.ball < 0 else theta[self.unknowns[unknown.ball].at]
                theta[unknown.at] = unknown.oversize + 0.5 * ball * (1 + play)
                slopes[unknown.at, k] = 0.5 * ball * play
                if unknown.ball >= 0:
                    slopes[unknown.at, unknown.ball] = (
                        0.5 * (1 + play) * slopes[self.unknowns[unknown.ball].at, unknown.ball]
                    )
        return theta, slopes

    def xi(self, theta: np.ndarray) -> np.ndarray:
        """ξ (p,) of θ (nθ,). Raises InfeasibleError for a value that has none: a modulus, a diameter or a play ≤ 0."""
        theta, xi = np.asarray(theta, dtype=float), np.empty(self.size)
        for k, unknown in enumerate(self.unknowns):
            value = float(theta[unknown.at])
            if unknown.kind == "preload":
                xi[k] = value / MICROMETRE
                continue
            inside, bound = value, "not positive"
            if unknown.kind == "diameter":
                inside = 2 * unknown.smallest / value - 1 if value > 0 else value
                bound = f"not between 0 and {2 * unknown.smallest:.6g} m, the largest diameter that fits the grooves"
            elif unknown.kind == "radius":
                ball = unknown.diameter if unknown.ball < 0 else float(theta[self.unknowns[unknown.ball].at])
                inside = 2 * (value - unknown.oversize) / ball - 1
                bound = f"not above {0.5 * ball + unknown.oversize:.6g} m, the ball radius plus preload"
            if not inside > 0:
                raise InfeasibleError(
                    f"the value {value:.6g} of the parameter {unknown.name} is {bound}",
                    remedy="correct `guess` or `starts` of this parameter in estimate.parameters",
                )
            xi[k] = np.log(inside)
        return xi

    def with_std(self, xi: np.ndarray, P: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """θ and σ = √(s P sᵀ), s = ∂θ/∂ξ, of the free parameters (p,) at ξ (p,) of covariance P (p, p)."""
        theta, slopes = self.theta(xi)
        s = slopes[self.free]
        return theta[self.free], np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", s, P, s), 0.0))

    def covariance(self, theta: np.ndarray, std_of_theta: np.ndarray) -> np.ndarray:
        """Covariance (p, p) of ξ, to first order, of free parameters that are independent in θ with these deviations (p,).
        Not diagonal where a ball's diameter and a groove of it are free together."""
        slopes = self.theta(self.xi(theta))[1][self.free]
        factor = np.linalg.inv(slopes) * np.asarray(std_of_theta, dtype=float)
        return factor @ factor.T


def parameter_coordinates(
    system_parameters: Sequence[str], free: Sequence[str], theta: np.ndarray, bearings: Mapping[str, np.ndarray]
) -> ParameterCoordinates:
    """Coordinates of the free ones among a system's parameters. system_parameters (nθ,): names, a bearing's "<bearing>.<one
    of PARAMETERS>", anything else a modulus; free (p,): the unknown ones; theta (nθ,): values of all; bearings: of every
    bearing that has a free parameter its six values [m] in the order of PARAMETERS, for those that are no parameter of the
    system. Raises InfeasibleError for an unknown name or bearing, a name twice, a value that has no ξ."""
    names, reference = list(system_parameters), np.array(theta, dtype=float)
    if twice := sorted({name for name in free if list(free).count(name) > 1}):
        raise InfeasibleError(f"parameter listed twice: {', '.join(twice)}", remedy="list each parameter once")
    unknowns: list[_Unknown] = []
    for name in free:
        if name not in names:
            known = f"parameters: {', '.join(names) or 'none'}"
            raise InfeasibleError(f"the bench has no parameter {name}", remedy=did_you_mean(name, names, known))
        bearing, _, part = name.rpartition(".")
        if not bearing or part not in PARAMETERS:
            unknowns.append(_Unknown(name, names.index(name), "log"))
            continue
        if bearing not in bearings:
            raise InfeasibleError(
                f"the parameter {name} is estimated, but the dimensions of bearing {bearing} are missing",
                remedy=f"add the six dimensions of {bearing} to the argument `bearings`",
            )
        unknowns.append(_of_bearing(bearing, part, names, free, reference, np.asarray(bearings[bearing], dtype=float)))
    coordinates = ParameterCoordinates(tuple(free), reference, tuple(unknowns))
    coordinates.xi(reference)
    return coordinates


def _of_bearing(
    bearing: str, part: str, names: list[str], free: Sequence[str], theta: np.ndarray, values: np.ndarray
) -> _Unknown:
    values, parameter_names = values.copy(), [f"{bearing}.{each}" for each in PARAMETERS]
    for k, name in enumerate(parameter_names):
        if name in names:
            values[k] = theta[names.index(name)]
    at, name = names.index(f"{bearing}.{part}"), f"{bearing}.{part}"
    oversize = 0.0 if parameter_names[-1] in free else max(float(values[-1]), 0.0)
    if part == "preload":
        return _Unknown(name, at, "preload")
    if part == "ball_diameter":
        known = [float(values[k]) for k in RADII if parameter_names[k] not in free]
        return _Unknown(name, at, "diameter", smallest=min(known) - oversize) if known else _Unknown(name, at, "log")
    ball = list(free).index(parameter_names[0]) if parameter_names[0] in free else -1
    return _Unknown(name, at, "radius", ball=ball, diameter=float(values[0]), oversize=oversize)


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
    Raises InfeasibleError for deviations of the wrong number, and where nothing holds a motion of the system."""
    n, inputs = system.size, np.asarray(inputs, dtype=int)
    std_u, std_xi = np.atleast_1d(np.asarray(std_u, dtype=float)), np.asarray(std_xi, dtype=float)
    if std_u.shape != inputs.shape or std_xi.shape[:1] != (coordinates.size,):
        raise InfeasibleError(
            f"there are {std_u.size} initial standard deviations for {inputs.size} unknown loads, and "
            f"{len(np.atleast_1d(std_xi))} for {coordinates.size} estimated parameters",
            remedy="specify one standard deviation for each load and each parameter",
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
    """∂q/∂u (n, all inputs) and ∂q/∂θ (n, nθ) of an equilibrium q (n,):  K ∂q = −∂f  on  B ∂q = 0. Raises InfeasibleError
    where nothing holds a motion of the system."""
    still = np.zeros(system.size)
    tangent = tangent_space(system, q, still, u, theta)
    by_u = input_slopes(system, tangent.at, np.asarray(q, dtype=float))
    slopes = np.concatenate([by_u, parameter_slopes(system, tangent.at, q, still)], axis=1)
    *_, K = tangent.matrices
    if len(K) and not np.linalg.cond(K) < 1 / FREE:
        raise InfeasibleError(
            "the bench can move freely in its initial state",
            remedy="restrain every motion of every body with a joint or a spring",
        )
    response = tangent.T @ np.linalg.solve(K, tangent.pushes(slopes))
    return response[:, : by_u.shape[1]], response[:, by_u.shape[1] :]


def white_force(system: System, acceleration: float) -> np.ndarray:
    """Variances Q_w (n,) of the white generalised force that stands for a white acceleration a [m/s²] of every body: (d √m
    a)², m the mass of the body [kg], d the metric of its coordinates: √kg for r, m √kg for R, √M_kk for η."""
    variance = np.empty(system.size)
    for body in system.bodies:
        mass = body.mass if isinstance(body, RigidBody) else body.invariants.mass
        coordinates = system.of[body.name]
        variance[coordinates] = (system.metric[coordinates] * acceleration) ** 2 * mass
    return variance


Zero = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
REMEMBERED = 64
STEPS = 8
"""Of Newton's iteration; one that has not ended by then began too far away."""


def zero_at_rest(
    system: System,
    sensors: CompiledSensors,
    zeroed: np.ndarray,
    q: np.ndarray,
    u: np.ndarray,
    coordinates: ParameterCoordinates,
) -> Zero:
    """ξ (p,) → offset (m,) and ∂offset/∂ξ (m, p): the readings h(q₀(ξ)) of the zeroed channels (m,) of bool, 0 of the others,

        f(q₀, 0, u, θ(ξ)) = Bᵀλ,   φ(q₀) = 0,   from q (n,), under the loads u (all inputs,) at which they were zeroed.

    A sensor that was zeroed at rest tells nothing of what deformed the bench then, whatever its stiffness. The last answers
    are remembered, and every equilibrium is followed from the nearest."""
    still = np.zeros(system.size)
    answers: OrderedDict[bytes, tuple[Equilibrium, np.ndarray, np.ndarray]] = OrderedDict()

    def at(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        key = xi.tobytes()
        if key not in answers:
            theta, by_xi = coordinates.theta(xi)
            if answers:
                near = min(answers, key=lambda known: float(np.abs(np.frombuffer(known) - xi).max(initial=0.0)))
                rest = follow_equilibrium(system, answers[near][0], u, theta)
            else:
                rest = rest_at(system, q, u, theta)
            y, H, _ = sensors.read(rest.q, still, at_rest(system, u))
            answers[key] = rest, np.where(zeroed, y, 0.0), np.where(zeroed[:, None], H @ rest.by_theta @ by_xi, 0.0)
            if len(answers) > REMEMBERED:
                answers.popitem(last=False)
        return answers[key][1:]

    return at


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """q (n,), λ (m,) in equilibrium at θ (nθ,), and by_theta (n, nθ) = ∂q/∂θ."""

    theta: np.ndarray
    q: np.ndarray
    lam: np.ndarray
    by_theta: np.ndarray


def rest_at(system: System, q: np.ndarray, u: np.ndarray, theta: np.ndarray) -> Equilibrium:
    """The equilibrium under u near q (n,). Raises what `static_equilibrium` and `static_response` raise."""
    q, lam = static_equilibrium(system, q, u, theta, near=True)
    return Equilibrium(theta, q, lam, static_response(system, q, u, theta)[1])


def follow_equilibrium(system: System, known: Equilibrium, u: np.ndarray, theta: np.ndarray) -> Equilibrium:
    """The equilibrium at θ (nθ,), from one that is known under the same loads u, by

        [K  −Bᵀ] [Δq  ∂q]     [f  ∂f/∂θ]
        [B   0 ] [λ'  ∂λ] = − [φ  0    ]

    from q + ∂q Δθ; where that does not end it is sought as by `rest_at`. Raises InfeasibleError, as
    that does, where nothing holds some motion at θ."""
    return _newton(system, known, u, theta) or rest_at(system, known.q, u, theta)


def _newton(system: System, known: Equilibrium, u: np.ndarray, theta: np.ndarray) -> Equilibrium | None:
    d, n, m = system.metric, system.size, system.constrained
    q, lam = known.q + known.by_theta @ (theta - known.theta), known.lam
    still, before = np.zeros(n), np.inf
    right = np.zeros((n + m, 1 + len(theta)))
    for _ in range(STEPS):
        try:
            at = balance(system, q, still, u, theta, lam=lam)
            K, B, s = in_the_metric(at, d)
            right[:n, 0], right[n:, 0] = -at.load / d, -s * at.phi
            right[:n, 1:] = -parameter_slopes(system, at, q, still) / d[:, None]
            z = np.linalg.solve(saddle(K, B), right)
        except (NumericalError, np.linalg.LinAlgError):
            return None
        size, whole = float(np.linalg.norm(z[:n, 0])), float(np.linalg.norm(d * q)) or 1.0
        q, lam = q + z[:n, 0] / d, z[n:, 0] * s
        if size <= CONVERGED * whole or (size < ROUNDING * whole and size > 0.3 * before):
            refuse_free(system, K, B)
            return Equilibrium(theta, q, lam, z[:n, 1:] / d[:, None])
        if not size < before:
            return None
        before = size
    return None
