"""What is known of loads and parameters before a run, and how they change in it, as a placement beside parameters needs it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag

from strainsight.config.bench.bench import BenchConfig, StrainSensor
from strainsight.experiment.bench.bench import Bench
from strainsight.experiment.bench.inverse.unknowns import Unknowns, asked
from strainsight.experiment.bench.layout.strained import Known


def known_of(
    config: BenchConfig, unknowns: Unknowns, bench: Bench, loads: Sequence[str], h: float, time: np.ndarray
) -> tuple[Known | None, np.ndarray]:
    """What parameters add to a placement, None without any; and σ (unknowns,) of the change in a step h [s] that gauges are
    ranked with, loads in the order given before ξ: as stated, of a constant one as much as leads to σ of its guess over the run.

    The run is in each pose from half-way to the one before until half-way to the next; time (poses,) [s].
    """
    order = [list(asked(config).inputs).index(name) for name in loads]
    of_loads = unknowns.increment_u[order]
    if not unknowns.free:
        return None, of_loads
    coordinates, theta = unknowns.coordinates, bench.theta
    length = float(asked(config).duration or config.simulate.duration)
    between = np.concatenate([[0.0], 0.5 * (time[1:] + time[:-1]), [length]])
    steps = np.maximum(1, np.diff(np.round(between / h).astype(int)))
    covariance = coordinates.covariance(theta, unknowns.std)
    moved = np.sqrt(np.diag(coordinates.covariance(theta, unknowns.increment)))
    known = Known(
        block_diag(np.diag(unknowns.std_u[order]), np.linalg.cholesky(covariance)),
        np.concatenate([of_loads, moved]),
        coordinates.theta(coordinates.xi(theta))[1][coordinates.free],
        tuple(int(count) for count in steps),
    )
    stand_in = np.sqrt(np.diag(covariance) / steps.sum())
    return known, np.concatenate([of_loads, np.where(moved > 0, moved, stand_in)])


def parameter_units(config: BenchConfig, names: Sequence[str]) -> list[str]:
    """Pa of a modulus, m of what a bearing has."""
    return ["Pa" if asked(config).parameters[name].bearing is None else "m" for name in names]


def zeroed(config: BenchConfig) -> bool:
    """Whether the filter has the layout by a sensor that is zeroed at a start at rest: it tells nothing of what deformed the
    bench then."""
    own = (config.sensors[name] for name in asked(config).sensors)
    takes = any(isinstance(sensor, StrainSensor) and sensor.layout == "place" and sensor.zeroed for sensor in own)
    return takes and config.simulate.start == "equilibrium"
