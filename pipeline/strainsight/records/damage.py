"""/damage of estimate.h5: fatigue damage with its interval."""

from __future__ import annotations

import numpy as np

from strainsight.records.record import dataset, group, record


@record
class DamageAt:
    """Of some places."""

    position: np.ndarray = dataset("m", "place × 3", "where")
    element: np.ndarray = dataset("1", "place", "element of the file whose surface it is")
    of_mean: np.ndarray = dataset("1", "place", "damage of the smoothed history, without what σ leaves open")
    damage: np.ndarray = dataset("1", "place", "median of the draws' damage, NaN where none were drawn")
    low: np.ndarray = dataset("1", "place", "2.5 % of the draws' damage are smaller")
    high: np.ndarray = dataset("1", "place", "2.5 % are larger")
    range_of_mean: np.ndarray = dataset("Pa", "place", "equivalent range of the smoothed history")
    range: np.ndarray = dataset("Pa", "place", "median of the draws' equivalent range")
    range_low: np.ndarray = dataset("Pa", "place", "2.5 % of them are smaller")
    range_high: np.ndarray = dataset("Pa", "place", "2.5 % are larger")


@record
class Damaged:
    """Damage in a test."""

    surface: DamageAt | None = group(default=None)
    virtual: DamageAt | None = group(default=None)
    hot_spot: np.ndarray | None = dataset(
        "1", "hot spot", "places of /surface, the most damaged first, none near another", default=None
    )
    hours: float = dataset("h", "", "duration of the record, all repetitions")
