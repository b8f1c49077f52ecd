"""The pool of a placement: what is placed and removed as one, and what a layout of it may be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from strainsight.config.layout import LayoutSettings
from strainsight.errors import blame
from strainsight.experiment.layout.zones import zone_of
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.placement.limits import FIXED, Limits, limits_of
from strainsight.sensors.candidates import STRAIN, Candidates
from strainsight.sensors.zones import inside


@dataclass(frozen=True)
class PoolRows:
    """Pool rows, each a gauge or a mirrored pair of them.

    gauges (p, 1 or 2): numbers of the gauges of every row, −1 where it has one only; channels (p, c): their channels, rows of
    the candidates, −1 where it has fewer; alone: gauges that were left out because they have no mirror image.
    """

    gauges: np.ndarray
    channels: np.ndarray
    alone: int = 0

    @property
    def first(self) -> np.ndarray:
        """The first channel of every row (p,)."""
        return self.channels[:, 0]

    @property
    def flat(self) -> tuple[np.ndarray, np.ndarray]:
        """Every gauge of the pool, and the pool row it belongs to."""
        which, column = np.nonzero(self.gauges >= 0)
        return self.gauges[which, column], which

    def gauges_of(self, rows: np.ndarray) -> np.ndarray:
        """Numbers of the gauges of some pool rows, in their order."""
        found = self.gauges[rows].ravel()
        return found[found >= 0]

    def summed(self, values: np.ndarray) -> np.ndarray:
        """For every row the sum over its gauges (p,); values: of every gauge of `flat`."""
        return np.bincount(self.flat[1], weights=values, minlength=len(self.gauges))


def layout_limits(
    place: LayoutSettings, pool: PoolRows, mesh: Mesh, candidates: Candidates, price: np.ndarray, key: str = FIXED
) -> Limits:
    """What a layout may be, as `place` says: its size, bonded gauges, spacing, zones, budget.

    price (p,) of every pool row; key: config key of the bonded gauges.
    """
    gauge, which = pool.flat
    first = candidates.first[gauge]
    part = candidates.take(first)
    places, zones = part.grids, []
    apart = (part.facet > 0) | (part.quantity == STRAIN)
    facets = exterior_facets(mesh) if mesh.has_surface and place.at_most else None
    for i, limit in enumerate(place.at_most):
        name = f"place.at_most.{i}"
        with blame(f"{name}.zone"):
            within = inside(zone_of(limit.zone), mesh, facets, places.position, places.normal)
        zones.append((name, pool.summed(part.any_grid(within)), limit.count))
    return limits_of(
        len(pool.gauges),
        place.keep,
        fixed=np.flatnonzero(pool.summed(candidates.bonded[first]) > 0).tolist(),
        size=(pool.gauges >= 0).sum(axis=1),
        price=price if place.budget is not None else None,
        budget=place.budget,
        near=_near(places.position, part.channel_of_grid, which, place.minimum_spacing, apart),
        zones=zones,
        key=key,
    )


def _near(
    position: np.ndarray, owner: np.ndarray, which: np.ndarray, spacing: float, apart: np.ndarray
) -> np.ndarray | None:
    """Pairs of pool rows (q, 2) with gauges nearer to each other than the spacing [m].

    position (g, 3) of grids; owner (g,): the gauge of each, whose arms may be as near to one another as they are; which: the
    pool row of every gauge; apart: of every gauge whether it keeps a spacing, as sensors that are not on the surface do not.
    """
    if spacing <= 0:
        return None
    pairs = owner[cKDTree(position).query_pairs(spacing * (1 - 1e-9), output_type="ndarray")]
    pairs = pairs[apart[pairs].all(axis=1)]
    return np.unique(np.sort(which[pairs[pairs[:, 0] != pairs[:, 1]]], axis=1), axis=0)
