"""Whether a hand gets at a place: what stands over it and beside it."""

from __future__ import annotations

import numpy as np

from strainsight.sensors.candidates import Candidates
from strainsight.sensors.misplaced import installation_axes
from strainsight.sensors.opposite import room_over
from strainsight.sensors.walk import Skin

SLANT = np.deg2rad(45.0)
"""From the normal: rays that look for walls beside a place."""
OFF = 1e-6
"""Of the reach: how far below the surface the rays begin, so that they meet what lies on it, and to which the room is known. The
facet that they leave is none that they could enter."""


def room(skin: Skin, candidates: Candidates, reach: float) -> np.ndarray:
    """The room over gauges (gauges,) [m], inf where there is more than the reach [m] of it:

        min( h(n),  max(h(n + e₁), h(n − e₁)),  max(h(n + e₂), h(n − e₂)) )

    h(r): how far a ray along r goes from the centre of the gauge before it meets the part, 0 below a part that lies on it. n is
    the outward normal, so that h(n) is the width of a bore or a gap; n ± e are slanted by 45° to both sides along and across the
    gauge, so that two walls beside it, of a groove, count where both are met, and one wall does not: a hand comes from the other
    side. Bridges are given by their arms, each a gauge here (`Candidates.grids`).
    """
    first = candidates.take(candidates.first)
    n, axes = first.normal, installation_axes(candidates)
    start = first.position - OFF * reach * n

    def height(ahead: np.ndarray) -> np.ndarray:
        return room_over(skin, start, ahead, reach)

    found = height(n)
    for e in axes:
        one, other = (height(np.cos(SLANT) * n + way * np.sin(SLANT) * e) for way in (1.0, -1.0))
        found = np.minimum(found, np.maximum(one, other))
    return np.asarray(np.where(found <= 2 * OFF * reach, 0.0, found))
