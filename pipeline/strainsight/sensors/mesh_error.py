"""Error of the strain operator by the mesh, from the jumps of strain between facets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import sparse

from strainsight.mesh.facets import Facets
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.properties import Thickness
from strainsight.sensors.candidates import STRAIN
from strainsight.sensors.edges import SHARP
from strainsight.sensors.strain_operator import ChannelPoints, matrix_of
from strainsight.sensors.surface import carried, facet_frames

CORNERS = np.array([kind.corners for kind in FACETS])
AT_CORNERS = np.array([np.pad(kind.nodes[: kind.corners], [(0, 4 - kind.corners), (0, 0)]) for kind in FACETS])
"""ξ of the corners of every kind of facet (kinds, 4, 2)."""


def mesh_error_matrix(
    position: np.ndarray, points: ChannelPoints, channels: int, facets: Facets, thickness: Thickness | None = None
) -> sparse.csr_array:
    """Estimated errors (channels, 3n) of the strain operator by the mesh: nodally averaged minus element strain at the corners c
    of the facet f, interpolated to the gauge with the linear shape functions L of the corners:

        e = Σ_c L_c(ξ) (ε̄_c − ε_f(ξ_c)),     ε̄_c = mean of ε_g(ξ_c) over the facets g around c

    g are facets of the same region whose normal differs by at most 30°; the direction follows the surface. The error does not
    depend on the axes, and is zero if the strain has no jumps, as a linear strain field on quadratic elements. It does not
    include errors of the motion by the mesh elsewhere, which neighbouring gauges have in common.

    position (n, 3) [m]; points of the channels, as in `matrix_of`; facets of the whole surface.
    Source: Zienkiewicz and Zhu, Int. J. Numer. Methods Eng. 24 (1987) 337-357."""
    points = points.take(points.quantity == STRAIN)
    point, corner = np.nonzero(np.arange(4) < CORNERS[points.kind][:, None])
    share = _linear_shapes(points.kind, points.local)[point, corner]
    around, facet, at = _around(facets, points.nodes[point, corner], len(position))
    normal = facet_frames(position, points.kind, points.nodes, points.local)[1]
    kind, nodes, local = facets.kind[facet], facets.nodes[facet], AT_CORNERS[facets.kind[facet], at]
    corner_normal = facet_frames(position, kind, nodes, local)[1]
    # the facet of the gauge is one of those around each of its corners
    itself = np.all(nodes[:, :4] == points.nodes[point[around], :4], axis=1)
    region, own_normal = np.zeros(len(point), dtype=np.int64), np.zeros((len(point), 3))
    region[around[itself]], own_normal[around[itself]] = facets.region[facet[itself]], corner_normal[itself]
    smooth = np.sum(corner_normal * own_normal[around], axis=1) >= np.cos(SHARP)
    used = itself | (smooth & (facets.region[facet] == region[around]))
    around, itself = around[used], itself[used]
    owner = point[around]
    jump = share[around] * (1 / np.bincount(around, minlength=len(point))[around] - itself)
    averaged = replace(
        points.take(owner),
        element=facets.element_id[facet[used]],
        kind=kind[used],
        nodes=nodes[used],
        local=local[used],
        direction=carried(points.direction[owner], normal[owner], corner_normal[used]),
        weight=points.weight[owner] * jump,
    )
    return matrix_of(position, averaged, channels, thickness)


def _linear_shapes(kind: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """Linear shape functions (p, 4) of the corners of facets at ξ (p, 2)."""
    triangle = np.column_stack([1 - xi.sum(axis=1), xi, np.zeros(len(xi))])
    square = np.prod(0.5 * (1 + xi[:, None] * AT_CORNERS[SQUARE]), axis=2)
    return np.where(CORNERS[kind][:, None] == 3, triangle, square)


SQUARE = int(np.argmax(CORNERS == 4))


def _around(facets: Facets, nodes: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Facets around corner nodes (k,): index of the node, facet, and number of its corner (s,) each; count: of all nodes."""
    facet, corner = np.nonzero(np.arange(4) < CORNERS[facets.kind][:, None])
    common = np.arange(count)  # nodes on sides of beams that meet have one identifier
    common[facets.nodes[facet, corner]] = facets.corners[facet, corner]
    at = facets.corners[facet, corner]
    order = np.argsort(at, kind="stable")
    first, last = (np.searchsorted(at[order], common[nodes], side=side) for side in ("left", "right"))
    several = last - first
    index = np.repeat(np.arange(len(nodes)), several)
    place = np.arange(len(index)) - np.repeat(np.cumsum(several) - several, several) + first[index]
    return index, facet[order[place]], corner[order[place]]
