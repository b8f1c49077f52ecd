"""How far a gauge stays from edges, supports and loads, and what that leaves."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from strainsight.mesh.facets import Facets
from strainsight.mesh.model import Mesh
from strainsight.sensors.edges import edges_of, near_segments, sharp_edges

USUAL_GRID = 0.003
"""[m] of a gauge whose grid is not stated. This and the three below are assumptions of ours, of what is typical."""
ENDS = 0.005
"""[m] by which a carrier is longer than the grid: end loops, solder tabs and margin, both ends together."""
SIDES = 0.003
"""[m] by which a carrier is wider than the grid, both sides together."""
SLIM = 0.5
"""Width of a grid over its length."""


def carrier(grid: float) -> tuple[float, float]:
    """Length and width [m] of the foil that carries a linear gauge, of the length of its grid [m]; 0: `USUAL_GRID`.

        l = L + 5 mm,     w = L/2 + 3 mm

    3 mm: 8 × 4.5 mm. An assumption of ours, taken from no catalogue. A rosette, or a gauge with cables or cover, needs more.
    """
    own = grid if grid > 0 else USUAL_GRID
    return own + ENDS, SLIM * own + SIDES


def carrier_clearance(grid: float) -> float:
    """½ √(l² + w²) [m]: from the centre, the carrier turned as it may reaches no farther. 3 mm: 4.6 mm."""
    return half_diagonal(*carrier(grid))


def half_diagonal(length: float, width: float) -> float:
    """½ √(l² + w²) [m] of a carrier of this length and width [m]."""
    return 0.5 * float(np.hypot(length, width))


def obstacles(mesh: Mesh, facets: Facets, loaded: np.ndarray) -> dict[str, np.ndarray]:
    """What a gauge is to stay clear of, each as segments (s, 2, 3) [m], a point as one without length:

        edges      where exterior facets meet at more than 30°
        supports   nodes of solids that are held, on springs, or tied by a rigid or averaging element or a relation, and the edges
                   between two of them
        loads      nodes (l,) on which a load acts, and the edges between two of them

    facets: exterior ones. What touches a body without being tied to it is not in the mesh.
    """
    held = np.zeros(len(mesh.position), dtype=bool)
    held[mesh.held] = True
    ties = (*(own.nodes for own in mesh.rigid), *(own.nodes for own in mesh.averaging))
    for tied in (*ties, *(own.node for own in mesh.relations if own.ties), *(own.node for own in mesh.springs)):
        held[tied] = True
    acting = np.zeros(len(mesh.position), dtype=bool)
    acting[loaded] = True
    return {
        "edges": sharp_edges(mesh.position, facets),
        "supports": _patches(mesh, facets, mesh.above(held)),
        "loads": _patches(mesh, facets, mesh.above(acting)),
    }


def _patches(mesh: Mesh, facets: Facets, chosen: np.ndarray) -> np.ndarray:
    """Chosen nodes (n,) of the surface, and edges of facets between two of them."""
    edges = edges_of(mesh.position, facets)
    ends = edges.ends[edges.start]
    between = mesh.position[ends[np.all(chosen[ends], axis=1)]].reshape(-1, 2, 3)
    on = np.unique(facets.nodes[facets.nodes >= 0])
    single = mesh.position[on[chosen[on]]]
    return np.concatenate([between, np.stack([single, single], axis=1)])


def crowded(points: np.ndarray, segments: Mapping[str, np.ndarray], distance: float) -> dict[str, np.ndarray]:
    """Which points (m, 3) [m] are nearer than the distance [m] to each of the obstacles, in a straight line: name → (m,)."""
    return {name: near_segments(points, own, distance) for name, own in segments.items()}


def room_for(points: np.ndarray, spacing: float, count: int) -> bool:
    """Whether `count` of the points (m, 3) [m] can be taken one after the other, each at least the spacing [m] from those before
    it; points in one place count once."""
    if len(points) < count:
        return False
    tree, free, found = cKDTree(points), np.ones(len(points), dtype=bool), 0
    for i in range(len(points)):
        if found >= count:
            break
        if free[i]:
            found += 1
            free[tree.query_ball_point(points[i], spacing * (1 - 1e-9))] = False
    return found >= count
