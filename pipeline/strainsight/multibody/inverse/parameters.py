"""Unknown parameters as numbers without bounds, so that every trial value is one that can be built."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.errors import InfeasibleError, did_you_mean
from strainsight.multibody.bearing.geometry import PARAMETERS

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
        for k, own in enumerate(self.unknowns):
            if own.kind == "preload":
                theta[own.at], slopes[own.at, k] = MICROMETRE * xi[k], MICROMETRE
            elif own.kind == "log":
                theta[own.at] = slopes[own.at, k] = np.exp(xi[k])
            elif own.kind == "diameter":
                play = np.exp(xi[k])
                theta[own.at] = 2 * own.smallest / (1 + play)
                slopes[own.at, k] = -theta[own.at] * play / (1 + play)
        for k, own in enumerate(self.unknowns):
            if own.kind == "radius":
                play = np.exp(xi[k])
                ball = own.diameter if own.ball < 0 else theta[self.unknowns[own.ball].at]
                theta[own.at] = own.oversize + 0.5 * ball * (1 + play)
                slopes[own.at, k] = 0.5 * ball * play
                if own.ball >= 0:
                    slopes[own.at, own.ball] = 0.5 * (1 + play) * slopes[self.unknowns[own.ball].at, own.ball]
        return theta, slopes

    def xi(self, theta: np.ndarray) -> np.ndarray:
        """ξ (p,) of θ (nθ,). Raises InfeasibleError for a value that has none: a modulus, a diameter or a play ≤ 0."""
        theta, xi = np.asarray(theta, dtype=float), np.empty(self.size)
        for k, own in enumerate(self.unknowns):
            value = float(theta[own.at])
            if own.kind == "preload":
                xi[k] = value / MICROMETRE
                continue
            inside, bound = value, "0"
            if own.kind == "diameter":
                inside = 2 * own.smallest / value - 1 if value > 0 else value
                bound = f"0 or not below the {2 * own.smallest:.6g} m that the grooves leave"
            elif own.kind == "radius":
                ball = own.diameter if own.ball < 0 else float(theta[self.unknowns[own.ball].at])
                inside = 2 * (value - own.oversize) / ball - 1
                bound = f"not above the ball's radius of {0.5 * ball + own.oversize:.6g} m"
            if not inside > 0:
                raise InfeasibleError(
                    f"{own.name} of {value:.6g} is {bound}", remedy="start from a value that can be built"
                )
            xi[k] = np.log(inside)
        return xi

    def std(self, theta: np.ndarray, std_of_theta: np.ndarray) -> np.ndarray:
        """Standard deviation (p,) of ξ, to first order, from that of the free parameters (p,) at θ (nθ,)."""
        return np.sqrt(np.diag(self.covariance(theta, std_of_theta)))

    def covariance(self, theta: np.ndarray, std_of_theta: np.ndarray) -> np.ndarray:
        """Covariance (p, p) of ξ, to first order, of free parameters that are independent in θ with these deviations (p,).

        Not diagonal where a ball's diameter and a groove of it are free together.
        """
        slopes = self.theta(self.xi(theta))[1][self.free]
        factor = np.linalg.inv(slopes) * np.asarray(std_of_theta, dtype=float)
        return factor @ factor.T


def parameter_coordinates(
    system_parameters: Sequence[str],
    free: Sequence[str],
    theta: np.ndarray,
    bearings: Mapping[str, np.ndarray],
) -> ParameterCoordinates:
    """Coordinates of the free ones among a system's parameters.

    system_parameters (nθ,): names, a bearing's "<bearing>.<one of PARAMETERS>", anything else a modulus; free (p,): the
    unknown ones; theta (nθ,): values of all; bearings: of every bearing that has a free parameter its six values [m] in the
    order of PARAMETERS, for those that are no parameter of the system.
    Raises InfeasibleError for an unknown name or bearing, a name twice, a value that has no ξ.
    """
    names, reference = list(system_parameters), np.array(theta, dtype=float)
    twice = sorted({name for name in free if list(free).count(name) > 1})
    if twice:
        raise InfeasibleError(f"{', '.join(twice)} is free twice", remedy="name every parameter once")
    unknowns: list[_Unknown] = []
    for name in free:
        if name not in names:
            known = f"the parameters are {', '.join(names) or 'none'}"
            raise InfeasibleError(f"there is no parameter {name}", remedy=did_you_mean(name, names, known))
        bearing, _, part = name.rpartition(".")
        if not bearing or part not in PARAMETERS:
            unknowns.append(_Unknown(name, names.index(name), "log"))
            continue
        if bearing not in bearings:
            raise InfeasibleError(
                f"{name} is free, but nothing tells the size of bearing {bearing}", remedy="give its six values"
            )
        unknowns.append(_of_bearing(bearing, part, names, free, reference, np.asarray(bearings[bearing], dtype=float)))
    found = ParameterCoordinates(tuple(free), reference, tuple(unknowns))
    found.xi(reference)
    return found


def _of_bearing(
    bearing: str, part: str, names: list[str], free: Sequence[str], theta: np.ndarray, values: np.ndarray
) -> _Unknown:
    values, own = values.copy(), [f"{bearing}.{each}" for each in PARAMETERS]
    for k, name in enumerate(own):
        if name in names:
            values[k] = theta[names.index(name)]
    at, name = names.index(f"{bearing}.{part}"), f"{bearing}.{part}"
    oversize = 0.0 if own[-1] in free else max(float(values[-1]), 0.0)
    if part == "preload":
        return _Unknown(name, at, "preload")
    if part == "ball_diameter":
        known = [float(values[k]) for k in RADII if own[k] not in free]
        return _Unknown(name, at, "diameter", smallest=min(known) - oversize) if known else _Unknown(name, at, "log")
    ball = list(free).index(own[0]) if own[0] in free else -1
    return _Unknown(name, at, "radius", ball=ball, diameter=float(values[0]), oversize=oversize)
