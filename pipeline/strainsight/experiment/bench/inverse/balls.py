"""What the balls of a bearing carry by the estimate, with σ: from a few gauges to every contact."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from strainsight.config.bench.connections import BearingForce
from strainsight.errors import UserError
from strainsight.estimation.update import covariance_factor
from strainsight.experiment.bench.bench import Bench
from strainsight.multibody.bearing.element import BallLoads, ball_loads
from strainsight.multibody.bearing.geometry import PARAMETERS, Bearing
from strainsight.multibody.inverse.model import AugmentedStep
from strainsight.multibody.inverse.parameters import ParameterCoordinates
from strainsight.multibody.relations import relation_rows
from strainsight.ordering import first_of_largest
from strainsight.records.bench import BallsThen, RingEstimate

INSTANTS = 100
"""Instants, evenly from start to end, at which balls are looked at."""

Carried = Callable[[np.ndarray], BallLoads]
"""(d, ξ) (5 + p,), five displacements of the inner ring and the parameters → what the balls carry."""


@dataclass(eq=False)
class RingWatch:
    """Gathers, of the first run of a filter, the displacements d = ρ(q) of every bearing with the parameters ξ, and their
    covariance J P Jᵀ, J = [∇ρ on q, 1 on ξ].

    mean (T + 1, 5 + p), covariance (T + 1, 5 + p, 5 + p) by the name of the force.
    """

    model: AugmentedStep
    rows: Mapping[str, slice]
    steps: int
    mean: dict[str, np.ndarray] = field(default_factory=dict)
    covariance: dict[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        k = 5 + self.model.coordinates.size
        for name in self.rows:
            self.mean[name] = np.full((self.steps + 1, k), np.nan)
            self.covariance[name] = np.full((self.steps + 1, k, k), np.nan)

    def __call__(self, k: int, x: np.ndarray, P: np.ndarray) -> None:
        first = x[0]
        if not np.isfinite(first).all():
            return
        model, p = self.model, self.model.coordinates.size
        rho, G, *_ = relation_rows(model.system.products, first[model.q], first[model.v])
        for name, rows in self.rows.items():
            J = np.zeros((5 + p, model.size))
            # one that takes from motion feels its turn, too
            J[:5, model.q], J[5:, model.xi] = G[rows][:5], np.eye(p)
            self.mean[name][k] = np.concatenate([rho[rows][:5], first[model.xi]])
            self.covariance[name][k] = J @ P[0] @ J.T


def ring_watch(bench: Bench, model: AugmentedStep, steps: int) -> RingWatch:
    """Of all bearings of the bench."""
    elements = bench.system.elements
    rows = {e.force.name: e.rows for e in elements if isinstance(bench.config.forces[e.force.name], BearingForce)}
    return RingWatch(model, rows, steps)


def rings_estimated(bench: Bench, watch: RingWatch) -> dict[str, RingEstimate]:
    """Every bearing by the estimate; none of one whose run diverged."""
    time = watch.model.h * np.arange(watch.steps + 1)
    rings = {}
    for name, mean in watch.mean.items():
        if np.isfinite(mean).all():
            carried = _carried(bench, watch.model.coordinates, name)
            rings[name] = _ring(time, mean, watch.covariance[name], carried)
    return rings


def _ring(time: np.ndarray, mean: np.ndarray, covariance: np.ndarray, carried: Carried) -> RingEstimate:
    at = np.unique(np.linspace(0, len(time) - 1, min(INSTANTS, len(time))).round().astype(int))
    balls = [carried(mean[k]) for k in at]
    pressure = np.array([ball.pressure.max() for ball in balls])
    std = np.empty(len(at))
    for i, k in enumerate(at):
        where = np.unravel_index(np.argmax(balls[i].pressure), balls[i].pressure.shape)
        std[i] = spread(mean[k], covariance[k], carried)[1][where]
    worst = first_of_largest(pressure)
    force_std, pressure_std = spread(mean[at[worst]], covariance[at[worst]], carried)
    return RingEstimate(
        displacement=mean[:, :5],
        std=np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2)[:, :5], 0.0)),
        instants=time[at],
        pressure=pressure,
        pressure_std=std,
        worst=BallsThen(
            time=float(time[at[worst]]),
            station=balls[worst].angle,
            force=balls[worst].force,
            force_std=force_std,
            pressure=balls[worst].pressure,
            pressure_std=pressure_std,
        ),
    )


def spread(mean: np.ndarray, covariance: np.ndarray, carried: Carried) -> tuple[np.ndarray, np.ndarray]:
    """σ (z, 4) of force [N] and pressure [Pa] of every contact,

        σ² = Σ_k ¼ (g(m + s_k) − g(m − s_k))²,     Σ_k s_k s_kᵀ = P

    exact where g is straight; by differences as long as the σ of d and ξ, so that a contact that opens within them counts.
    mean (5 + p,), covariance P (5 + p, 5 + p). NaN where a displaced bearing cannot be.
    """
    force, pressure = 0.0, 0.0
    for s in covariance_factor(covariance).T:
        try:
            ahead, back = carried(mean + s), carried(mean - s)
        except UserError:
            nothing = np.full_like(carried(mean).force, np.nan)
            return nothing, nothing
        force = force + 0.25 * (ahead.force - back.force) ** 2
        pressure = pressure + 0.25 * (ahead.pressure - back.pressure) ** 2
    return np.sqrt(force), np.sqrt(pressure)


def _carried(bench: Bench, coordinates: ParameterCoordinates, name: str) -> Carried:
    """Of one bearing, with the parameters of it that are free."""
    stated = bench.config.forces[name]
    assert isinstance(stated, BearingForce)
    bearing: Bearing = bench.bearings[stated.bearing]
    element = next(e for e in bench.system.elements if e.force.name == name)
    properties = [bench.system.parameters[at].split(".")[-1] for at in element.parameters]
    places = [PARAMETERS.index(key) for key in properties]

    def carried(z: np.ndarray) -> BallLoads:
        values = bearing.parameters
        values[places] = coordinates.theta(z[5:])[0][element.parameters]
        return ball_loads(bearing.with_parameters(values) if places else bearing, z[:5])

    return carried
