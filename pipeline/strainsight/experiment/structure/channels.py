"""What every candidate measures, channel by channel, and the channels and the list of a set of gauges."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from strainsight.experiment.layout.gauge_list import GaugeList, gauge_list
from strainsight.fem.affine import AffineOperator
from strainsight.loads.measurement import Sensed
from strainsight.records.training import Screened, Training
from strainsight.rom.model import ReducedModel, accelerations
from strainsight.sensors.candidates import ACCELERATION, DISPLACEMENT, STRAIN, UNITS, channels_of_gauges, grouped


@dataclass(frozen=True)
class Channels:
    """All candidates, one row a channel, those of one gauge one behind the other.

    rows (m, n): strain, or displacement of the point, per reduced coordinate, at the references, and change, what θ adds to them
    where a thickness of shells is free; quantity (m,): 0 strain, 1 acceleration,
    2 displacement; noise_std (m,) of one sample at the training time step [unit of the quantity]; gauge (m,): number of the
    gauge; bridged (m,): which are bridges of several arms.
    """

    rows: np.ndarray
    change: AffineOperator
    quantity: np.ndarray
    noise_std: np.ndarray
    gauge: np.ndarray
    bridged: np.ndarray

    def sensed(self, channels: np.ndarray) -> Sensed:
        """What some channels (k,) read."""
        return Sensed(self.rows[channels], self.quantity[channels], self.change.of_terms(lambda X: X[channels]))

    @property
    def gauges(self) -> int:
        """How many gauges there are."""
        return int(self.gauge[-1]) + 1

    def of(self, gauges: np.ndarray) -> np.ndarray:
        """Channels (..., c) of gauges (...), −1 where a gauge has fewer than the c of the largest."""
        return channels_of_gauges(self.gauge, gauges)


def units_in_words(quantity: np.ndarray) -> str:
    """The unit of an array over channels of these quantities: "strain", or "strain or m/s^2" where they differ."""
    return " or ".join(UNITS[kind] for kind in np.unique(quantity))


def training_units(quantity: np.ndarray) -> dict[str, str]:
    """Of what is written of channels of these quantities (m,), a row of which is strain or displacement per coordinate."""
    still = np.where(quantity == STRAIN, STRAIN, DISPLACEMENT)
    unit, row = units_in_words(quantity), f"{grouped(units_in_words(still))}/(kg^1/2 m)"
    return {"the channel": unit, "the variance": f"{grouped(unit)}^2", "the row": row}


def channels_of(training: Training, screened: Screened) -> Channels:
    """All channels of the training run, with their noise."""
    pool = training.candidates
    return Channels(training.rows, training.change, pool.quantity, screened.noise_std, pool.gauge, pool.bridged)


def listed_gauges(gauges: np.ndarray, training: Training, screened: Screened) -> GaugeList:
    """Gauges (k,) by their numbers, as a layout lists them, with what they read in the training run."""
    candidates = training.candidates
    used = candidates.channels(gauges)
    peak, most = np.full((2, len(candidates)), np.nan)
    peak[used], most[used] = training.peak[used], training.strained[used]
    return gauge_list(candidates, training.name, gauges, screened.family, peak, screened.range, most)


def readings(
    model: ReducedModel,
    theta: Mapping[str, float],
    rows: np.ndarray,
    quantity: np.ndarray,
    x: np.ndarray,
    u: np.ndarray,
) -> np.ndarray:
    """What channels read in a motion without noise: row·q of strain and displacement, row·q̈ of acceleration.

    theta: all parameters [SI]; rows (m, n); quantity (m,); x (s, 2n) = [q, q̇]; u (s, n_u) [N] at the same instants.
    Returns (s, m) [strain, m/s² or m].
    """
    n = model.size
    reading = x[:, :n] @ rows.T
    moving = quantity == ACCELERATION
    if moving.any():
        reading[:, moving] = accelerations(model, theta, x, u) @ rows[moving].T
    return reading


def largest_of_quantity(peak: np.ndarray, quantity: np.ndarray) -> np.ndarray:
    """For every channel the largest reading of any channel of its quantity (m,); peak (m,) of each, quantity (m,)."""
    return np.array([peak[quantity == q].max() for q in quantity])
