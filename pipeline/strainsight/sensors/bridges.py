"""Candidate bridges: arms on both sides of a body, by a pattern."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from strainsight.sensors.access import opposite
from strainsight.sensors.candidates import STEEPEST, Arms, Candidates, concatenate
from strainsight.sensors.points import normals_at
from strainsight.sensors.surface import turned
from strainsight.sensors.walk import Skin

HERE, BEHIND = 0, 1
PATTERNS: Mapping[str, tuple[tuple[int, float, int], ...]] = {
    "half-bending": ((HERE, 0.0, 1), (BEHIND, 0.0, -1)),
    "full-bending": ((HERE, 0.0, 1), (BEHIND, 0.0, -1), (HERE, 0.0, 1), (BEHIND, 0.0, -1)),
    "half-axial": ((HERE, 0.0, 1), (BEHIND, 0.0, 1)),
    "full-torsion": ((HERE, 45.0, 1), (HERE, -45.0, -1), (BEHIND, 45.0, 1), (BEHIND, -45.0, -1)),
}
"""Arms of each pattern: the side that it is on, its angle [deg] from d, right-handed about the outward normal of its side, sign.
The sign of the first is 1."""
ALIKE = 1e-6
"""Of the surface's extent: places nearer than this to one another are one."""
ASKEW = 0.1
"""Degrees by which the directions of one bridge seen from its two sides may differ."""


@dataclass(frozen=True)
class StrainGauges:
    """candidates; alone: places without a bridge, as no facet behind them takes its arms; twice: bridges that were another one,
    seen from its other side; left_out: places where a grid would run over a sharp edge."""

    candidates: Candidates
    alone: int = 0
    twice: int = 0
    left_out: int = 0


def bridges(skin: Skin, pool: Candidates, pattern: str, admitted: np.ndarray) -> StrainGauges:
    """A bridge for every gauge of the pool, with arms at its place p and at the opposite one p′, the first exit of the line from
    p along −n:

        half-bending    ε(p) − ε(p′)            full-bending    2 [ε(p) − ε(p′)], of four grids
        half-axial      ε(p) + ε(p′)            full-torsion    ε₊₄₅(p) − ε₋₄₅(p) + ε₊₄₅(p′) − ε₋₄₅(p′)

    along d at p and d′ ∥ d − (d·n′) n′ at p′, ±45° right-handed about the outward normal of each place.
    pool: gauges of one channel; admitted: indices of the facets that may carry gauges. Left out are bridges whose p′ lies on none
    of these or where d is within 10° of the normal, and of bridges that are one the later ones. All may be.
    """
    found = opposite(skin, pool.position, pool.normal)
    well = np.isin(found.facet, admitted)
    normal = np.zeros((len(pool), 3))
    normal[well] = normals_at(skin, found.facet[well], found.local[well])
    steep = np.abs(np.sum(pool.direction * normal, axis=1)) > np.cos(np.deg2rad(STEEPEST))
    index = np.flatnonzero(well & ~steep)
    own, at, n = pool.take(index), found.facet[index], normal[index]
    d = own.direction - np.sum(own.direction * n, axis=1)[:, None] * n
    behind = replace(
        own,
        **skin.facets.columns(at),
        position=found.point[index],
        normal=n,
        direction=d / np.linalg.norm(d, axis=1)[:, None],
        angle=-own.angle,
        local=found.local[index],
    )
    near = ALIKE * float(np.ptp(skin.position, axis=0).max())
    kept = _once(own, behind, near, quarter=any(turn for _, turn, _ in PATTERNS[pattern]))
    sides = own.take(kept), behind.take(kept)
    (_, first, _), *further = PATTERNS[pattern]
    # By bridge, and within one by arm.
    each, m = np.repeat(np.arange(len(kept)), len(further)), len(kept)
    arms = [_turned(sides[side], turn) for side, turn, _ in further]
    grid = _interleaved(arms, m)
    sign = np.tile([float(sign) for _, _, sign in further], m)
    made = replace(_turned(sides[HERE], first), arms=Arms(each, sign, grid)) if m else sides[HERE]
    return StrainGauges(made, len(pool) - len(index), len(index) - len(kept))


def _once(one: Candidates, other: Candidates, near: float, quarter: bool) -> np.ndarray:
    """Which of bridges (k,) with their two sides are not an earlier one: the same two places, either way round, and the same
    direction up to sign; quarter: or one across it, which turns signs of ±45° alone."""
    if not len(one):
        return np.zeros(0, dtype=np.int64)
    tree = cKDTree(one.position)
    pairs = []
    for there, back in ((other.position, True), (one.position, False)):
        found = tree.query_ball_point(there, near)
        i = np.repeat(np.arange(len(one)), [len(own) for own in found])
        j = np.array([int(own) for near_ones in found for own in near_ones], dtype=np.int64)
        returns = np.linalg.norm(other.position[j] - (one if back else other).position[i], axis=1) <= near
        # A direction is compared on the side where both are tangent.
        d = (other if back else one).direction[i]
        along = np.linalg.norm(np.cross(d, one.direction[j]), axis=1) < np.sin(np.deg2rad(ASKEW))
        across = np.abs(np.sum(d * one.direction[j], axis=1)) < np.sin(np.deg2rad(ASKEW))
        alike = returns & (along | (across & quarter)) & (i != j)
        pairs.append(np.column_stack([i[alike], j[alike]]))
    i, j = np.concatenate(pairs).T
    graph = coo_array((np.ones(len(i)), (i, j)), shape=(len(one), len(one)))
    _, group = connected_components(graph, directed=False)
    return np.sort(np.unique(group, return_index=True)[1])


def _turned(side: Candidates, angle: float) -> Candidates:
    if angle == 0:
        return side
    each = np.full(len(side), angle)
    return replace(side, direction=turned(side.direction, side.normal, each), angle=side.angle + angle)


def _interleaved(arms: list[Candidates], m: int) -> Candidates:
    """The first entries (m) of all arms, then their second ones, and so on, each a gauge of its own."""
    order = np.arange(len(arms) * m).reshape(len(arms), m).T.ravel()
    return replace(concatenate(arms), gauge=np.arange(len(arms) * m)).take(order)
