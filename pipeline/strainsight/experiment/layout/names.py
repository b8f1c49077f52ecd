"""What the gauges of a layout are called."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count

import numpy as np


def layout_labels(names: Sequence[str], gauges: np.ndarray) -> tuple[str, ...]:
    """The name that the config gives a gauge, else G1, G2, … in the order of the layout, without those that it gives.

    names: of every candidate, empty where it has none; gauges (k,): numbers of those of the layout.
    """
    taken = {name for name in names if name}
    free = (label for label in (f"G{i}" for i in count(1)) if label not in taken)
    return tuple(names[gauge] or next(free) for gauge in gauges)
