"""Gauges that are bonded off the place and direction that were meant."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.mesh.facets import Facets
from strainsight.sensors.candidates import STEEPEST, Candidates, tangents
from strainsight.sensors.points import stays, surface_of
from strainsight.sensors.surface import by_kind, carried, facet_points, normals, turned
from strainsight.sensors.walk import Skin, local_at, walk

HALVINGS = 12


def misplaced(
    position: np.ndarray,
    candidates: Candidates,
    facets: Facets | Skin | None,
    offset: np.ndarray | None = None,
    rotation: np.ndarray | None = None,
) -> tuple[Candidates, np.ndarray]:
    """The gauges moved over the surface and turned, and which of them (gauges,) were held back by a sharp edge.

    offset (gauges, 2) [m] along the `installation_axes` of each gauge, in its tangent plane;
    rotation (gauges,) [deg], right-handed about the normal. All channels of a gauge move as one, and their directions are
    carried along without turning about the normal. A point gauge stops at a sharp edge; one with a grid, or several, is moved
    and turned by the largest share of what was asked for that leaves its grids on the surface.
    position (n, 3) [m]; candidates: grids of bridges are gauges here (`Candidates.grids`); facets of the whole surface (None:
    those that carry candidates).
    """
    gauges = candidates.gauges
    offset = np.zeros((gauges, 2)) if offset is None else np.asarray(offset, dtype=float)
    rotation = np.zeros(gauges) if rotation is None else np.asarray(rotation, dtype=float)
    skin = surface_of(position, candidates, facets)
    moved, held = _moved(skin, candidates, offset, rotation)
    spread = np.zeros(gauges, dtype=bool)
    spread[candidates.gauge[candidates.length > 0]] = True
    if not spread.any():
        return moved, held
    stuck = np.flatnonzero((held | ~stays(skin, moved)) & spread)
    if not len(stuck):
        return moved, held
    part = candidates.take(candidates.channels(stuck))
    low, high = np.zeros(len(stuck)), np.ones(len(stuck))
    for _ in range(HALVINGS):
        share = 0.5 * (low + high)
        tried, blocked = _moved(skin, part, share[:, None] * offset[stuck], share * rotation[stuck])
        well = ~blocked & stays(skin, tried)
        low, high = np.where(well, share, low), np.where(well, high, share)
    share = np.ones(gauges)
    share[stuck] = low
    moved, held = _moved(skin, candidates, share[:, None] * offset, share * rotation)
    held[stuck] = True
    return moved, held


def installation_axes(candidates: Candidates) -> tuple[np.ndarray, np.ndarray]:
    """Unit tangents e₁ and e₂ = n × e₁ (gauges, 3) that offsets of a gauge are along: e₁ ∥ d − (d·n) n of its first channel,
    along `tangents` where d is within 10° of n."""
    first = candidates.take(candidates.first)
    n = first.normal
    e1 = first.direction - np.sum(first.direction * n, axis=1)[:, None] * n
    upright = np.linalg.norm(e1, axis=1) < np.sin(np.deg2rad(STEEPEST))
    e1 = np.where(upright[:, None], tangents(n), e1)
    e1 /= np.linalg.norm(e1, axis=1)[:, None]
    return e1, np.cross(n, e1)


def _moved(
    skin: Skin, candidates: Candidates, offset: np.ndarray, rotation: np.ndarray
) -> tuple[Candidates, np.ndarray]:
    first = candidates.take(candidates.first)
    n = first.normal
    e1, e2 = installation_axes(candidates)
    distance = np.linalg.norm(offset, axis=1)
    ahead = (offset[:, :1] * e1 + offset[:, 1:] * e2) / np.where(distance > 0, distance, 1.0)[:, None]
    go = np.flatnonzero(distance > 0)
    start = skin.index_of(first.element, first.facet)
    trail = walk(skin, start[go], first.position[go], n[go], ahead[go], distance[go])
    plane = np.stack([ahead[go], np.cross(n[go], ahead[go])], axis=1)
    target = np.column_stack([trail.length, np.zeros(len(go))])
    local, facet = first.local.copy(), start
    found, ok = local_at(skin, trail.last, first.position[go], plane, target)
    local[go[ok]], facet[go[ok]] = found[ok], trail.last[ok]
    held = np.zeros(len(first), dtype=bool)
    held[go] = ~(trail.reached & ok)
    x, after = first.position.copy(), n.copy()
    for kind, which, nodes in by_kind(skin.facets.kind[facet], skin.facets.nodes[facet]):
        x[which], J = facet_points(kind, skin.position[nodes], local[which])
        after[which] = normals(J)
    g = candidates.gauge
    return replace(
        candidates,
        **skin.facets.columns(facet[g]),
        position=x[g],
        normal=after[g],
        direction=turned(carried(candidates.direction, n[g], after[g]), after[g], rotation[g]),
        local=local[g],
    ), held
