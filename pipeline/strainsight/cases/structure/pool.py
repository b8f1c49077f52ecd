"""The pool of a placement: what is placed and removed as one, and what a layout of it may be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from strainsight.cases.structure.candidates import zone_of
from strainsight.cases.structure.channels import Channels
from strainsight.cases.structure.settings import families
from strainsight.config.placement import PlacementConfig, Symmetry
from strainsight.errors import InfeasibleError, blame
from strainsight.gauges.candidates import Candidates
from strainsight.gauges.symmetry import mirror_partners
from strainsight.gauges.zones import inside
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import Mesh
from strainsight.placement.limits import Limits, limits_of


@dataclass(frozen=True)
class PoolRows:
    """Pool rows, each a gauge or a mirrored pair of them.

    gauges (p, 1 or 2): numbers of the gauges of every row, −1 where it has one only; channels (p, c): their channels, rows of
    train.h5, −1 where it has fewer; alone: gauges that were left out because they have no mirror image.
    """

    gauges: np.ndarray
    channels: np.ndarray
    alone: int

    @property
    def first(self) -> np.ndarray:
        """The first channel of every row (p,)."""
        return self.channels[:, 0]

    def gauges_of(self, rows: np.ndarray) -> np.ndarray:
        """Numbers of the gauges of some pool rows, in their order."""
        found = self.gauges[rows].ravel()
        return found[found >= 0]


def pool_of(kept: np.ndarray, channels: Channels, candidates: Candidates, symmetry: Symmetry | None) -> PoolRows:
    """The kept gauges as pool rows: each alone, or with a plane of symmetry in mirrored pairs.

    kept (k,) gauge numbers. Those on the plane that are their own mirror image are alone, as are glued ones; others without
    a mirror image in the pool are left out. Raises InfeasibleError where nothing is left.
    """
    if symmetry is None:
        return PoolRows(kept[:, None], channels.of(kept), 0)
    with blame("place.symmetry"):
        partner = mirror_partners(candidates, symmetry.point, symmetry.normal)
    glued = np.zeros(channels.gauges, dtype=bool)
    glued[candidates.gauge[candidates.glued]] = True
    there = np.zeros(channels.gauges, dtype=bool)
    there[kept] = True
    pairs = []
    for gauge in kept:
        other = int(partner[gauge])
        if glued[gauge] or other == gauge:
            pairs.append((int(gauge), -1))
        elif other > gauge and there[other] and not glued[other]:
            pairs.append((int(gauge), other))
    if not pairs:
        raise InfeasibleError(
            f"none of the {len(kept)} gauges of the pool has a mirror image in it",
            key="place.symmetry",
            remedy="check the plane, keep more candidates (screen.keep: all), or mirror the mesh",
        )
    gauges = np.array(pairs)
    first, second = channels.of(gauges[:, 0]), channels.of(np.maximum(gauges[:, 1], 0))
    second[gauges[:, 1] < 0] = -1
    return PoolRows(gauges, _left_aligned(np.hstack([first, second])), len(kept) - int((gauges >= 0).sum()))


def limits_of_config(
    config: PlacementConfig, pool: PoolRows, mesh: Mesh, channels: Channels, candidates: Candidates
) -> Limits:
    """What a layout may be, as `place` says: its size, glued gauges, spacing, zones, budget."""
    place = config.place
    gauge, which = _flat(pool)
    first = np.searchsorted(channels.gauge, gauge)
    position, normal = candidates.position[first], candidates.normal[first]
    near = _near(position, which, place.minimum_spacing)
    zones = []
    facets = exterior_facets(mesh) if mesh.blocks and place.at_most else None
    for i, limit in enumerate(place.at_most):
        key = f"place.at_most.{i}"
        with blame(f"{key}.zone"):
            within = inside(zone_of(limit.zone), mesh, facets, position, normal)
        zones.append((key, np.bincount(which, weights=within, minlength=len(pool.gauges)), limit.count))
    price = np.bincount(which, weights=_prices(config, candidates, first), minlength=len(pool.gauges))
    return limits_of(
        len(pool.gauges),
        place.keep,
        fixed=np.flatnonzero(
            np.bincount(which, weights=candidates.glued[first], minlength=len(pool.gauges)) > 0
        ).tolist(),
        size=(pool.gauges >= 0).sum(axis=1),
        price=price if place.budget is not None else None,
        budget=place.budget,
        near=near,
        zones=zones,
    )


def layout_cost(config: PlacementConfig, candidates: Candidates, gauges: np.ndarray) -> tuple[float, float] | None:
    """What the gauges (k,) of a layout cost and may cost; None without a budget."""
    if config.place.budget is None:
        return None
    return float(_prices(config, candidates, candidates.first[gauges]).sum()), config.place.budget


def _prices(config: PlacementConfig, candidates: Candidates, first: np.ndarray) -> np.ndarray:
    """Price of the gauges whose first channels these are; those already glued cost nothing."""
    family = np.array([float(entry.price) for entry in families(config).values()])
    return np.where(candidates.glued[first], 0.0, family[candidates.array[first]])


def _flat(pool: PoolRows) -> tuple[np.ndarray, np.ndarray]:
    """Every gauge of the pool, and the pool row it belongs to."""
    which, column = np.nonzero(pool.gauges >= 0)
    return pool.gauges[which, column], which


def _near(position: np.ndarray, which: np.ndarray, spacing: float) -> np.ndarray | None:
    """Pairs of pool rows (q, 2) with gauges nearer to each other than the spacing [m]."""
    if spacing <= 0:
        return None
    pairs = cKDTree(position).query_pairs(spacing * (1 - 1e-9), output_type="ndarray")
    rows = np.sort(which[pairs], axis=1)
    return np.unique(rows, axis=0)


def _left_aligned(channels: np.ndarray) -> np.ndarray:
    """The channels of every row in front, −1 behind them, without columns that no row needs."""
    order = np.argsort(channels < 0, axis=1, kind="stable")
    moved = np.take_along_axis(channels, order, axis=1)
    return moved[:, (moved >= 0).any(axis=0)]
