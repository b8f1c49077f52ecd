"""Edges of a surface: clearance from them, dimensions to them, and the curvature of the surface."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from strainsight.mesh.coincident import component_labels
from strainsight.mesh.facets import Facets, by_kind, facet_key
from strainsight.mesh.joins import AveragingElement, RigidElement
from strainsight.mesh.model import Mesh
from strainsight.sensors.surface import angle_between, facet_centres, facet_points, farthest_axis, normals

SHARP = np.deg2rad(30.0)


@dataclass(frozen=True)
class Edges:
    """The edges of all facets, once for every facet, h in total, those of one edge adjacent.

    facet (h,) index; side (h,) number of the edge within the facet, from its node `side` to the next; ends (h, 2) corners of the
    facets, ascending; middle (h, 3) [m]; start (e,) first row of each of the e edges; count (e,) of facets at the edge; sharp
    (e,): whether they meet at more than 30°, or are not two."""

    facet: np.ndarray
    side: np.ndarray
    ends: np.ndarray
    middle: np.ndarray
    start: np.ndarray
    count: np.ndarray
    sharp: np.ndarray


def edges_of(position: np.ndarray, facets: Facets) -> Edges:
    """Every edge of the facets; position (n, 3) [m].

    The normals are those at the middle of the edge, so that a coarsely meshed curved surface is smooth if its facets are
    quadratic."""
    rows: list[tuple[np.ndarray, ...]] = []
    for kind, which, nodes in by_kind(facets.kind, facets.nodes):
        for a in range(kind.corners):
            b = (a + 1) % kind.corners
            xi = 0.5 * (kind.nodes[a] + kind.nodes[b])
            x, J = facet_points(kind, position[nodes], np.tile(xi, (len(nodes), 1)))
            ends = np.sort(facets.corners[which][:, [a, b]], axis=1)
            rows.append((which, np.full(len(which), a), ends, x, normals(J)))
    if not rows:
        none = np.zeros(0, dtype=np.int64)
        return Edges(none, none, np.zeros((0, 2), dtype=np.int64), np.zeros((0, 3)), none, none, np.zeros(0, bool))
    facet, side, ends, middle, normal = (np.concatenate(column) for column in zip(*rows, strict=True))
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    facet, side, ends, middle, normal = (column[order] for column in (facet, side, ends, middle, normal))
    start = np.flatnonzero(np.any(np.diff(ends, axis=0, prepend=-1) != 0, axis=1))
    count = np.diff(start, append=len(ends))
    two = count == 2
    angle = np.full(len(start), np.pi)
    angle[two] = angle_between(normal[start[two]], normal[start[two] + 1])
    return Edges(facet, side, ends, middle, start, count, angle > SHARP)


def sharp_edges(position: np.ndarray, facets: Facets) -> np.ndarray:
    """Edges between exterior facets that meet at more than 30°, of more than two facets, and of one: segments (s, 2, 3) [m].

    A quadratic edge gives two segments. position (n, 3) [m]."""
    edges = edges_of(position, facets)
    return _through_middle(position, edges, edges.start[edges.sharp])


def _through_middle(position: np.ndarray, edges: Edges, rows: np.ndarray) -> np.ndarray:
    """Both halves of edges by their rows: segments (s, 2, 3) [m]."""
    a, b = position[edges.ends[rows, 0]], position[edges.ends[rows, 1]]
    m = edges.middle[rows]
    return np.concatenate([np.stack([a, m], axis=1), np.stack([m, b], axis=1)])


def near_segments(points: np.ndarray, segments: np.ndarray, distance: float) -> np.ndarray:
    """Which points (m, 3) [m] are nearer than `distance` [m] to one of the segments (s, 2, 3) [m]: (m,) bool."""
    near = np.zeros(len(points), dtype=bool)
    if not len(segments) or not len(points):
        return near
    a, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(along, axis=1)
    hits = cKDTree(points).query_ball_point(a + 0.5 * along, distance + 0.5 * length)
    for i, hit in enumerate(hits):
        arm = points[hit] - a[i]
        share = np.clip(arm @ along[i] / max(length[i] ** 2, np.finfo(float).tiny), 0, 1)
        near[hit] |= np.linalg.norm(arm - share[:, None] * along[i], axis=1) < distance
    return near


USUAL_GRID = 0.003
"""[m] of a gauge without a specified grid. This and the three constants below are typical values, assumed here."""
ENDS = 0.005
"""[m] Difference of the lengths of carrier and grid: end loops, solder tabs and margin, both ends together."""
SIDES = 0.003
"""[m] Difference of the widths of carrier and grid, both sides together."""
SLIM = 0.5
"""Ratio of width to length of a grid."""


def carrier(grid: float) -> tuple[float, float]:
    """Length and width [m] of the carrier foil of a linear gauge from the length of its grid [m]; 0: `USUAL_GRID`.

        l = L + 5 mm,     w = L/2 + 3 mm

    For 3 mm: 8 × 4.5 mm. An assumption, not from a catalogue. A rosette, or a gauge with cables or cover, needs more space."""
    length = grid if grid > 0 else USUAL_GRID
    return length + ENDS, SLIM * length + SIDES


def carrier_clearance(grid: float) -> float:
    """½ √(l² + w²) [m]: largest distance of the carrier from its centre, in any orientation. For 3 mm: 4.6 mm."""
    return half_diagonal(*carrier(grid))


def half_diagonal(length: float, width: float) -> float:
    """½ √(l² + w²) [m] of a carrier of this length and width [m]."""
    return 0.5 * float(np.hypot(length, width))


def obstacles(mesh: Mesh, facets: Facets, loaded: np.ndarray) -> dict[str, np.ndarray]:
    """Obstacles that gauges must stay clear of, each as segments (s, 2, 3) [m], points as segments of zero length:

        edges      where exterior facets meet at more than 30°
        supports   supported nodes of solids, nodes on springs, or tied by a rigid or averaging element or a relation, and the
        edges
                   between two of them
        loads      nodes (l,) under a load, and the edges between two of them

    facets: exterior ones. Parts that touch without a tie are not in the mesh."""
    acting = np.zeros(len(mesh.position), dtype=bool)
    acting[loaded] = True
    return {
        "edges": sharp_edges(mesh.position, facets),
        "supports": _patches(mesh, facets, constrained_nodes(mesh)),
        "loads": _patches(mesh, facets, mesh.above(acting)),
    }


def constrained_nodes(mesh: Mesh, references: bool = False) -> np.ndarray:
    """Nodes (n,) bool with supports, springs, rigid or averaging elements (optionally with their reference nodes), or relations;
    on surfaces of shells and beams the nodes that follow these."""
    constrained = np.zeros(len(mesh.position), dtype=bool)
    constrained[mesh.held] = True
    ties: list[RigidElement | AveragingElement] = [*mesh.rigid, *mesh.averaging]
    for tie in ties:
        constrained[tie.nodes] = True
        constrained[tie.reference] |= references
    for relation in mesh.relations:
        constrained[relation.node] |= relation.ties
    for spring in mesh.springs:
        constrained[spring.node] = True
    return mesh.above(constrained)


def _patches(mesh: Mesh, facets: Facets, chosen: np.ndarray) -> np.ndarray:
    """Selected nodes (n,) of the surface, and edges of facets between two of them."""
    edges = edges_of(mesh.position, facets)
    ends = edges.ends[edges.start]
    between = mesh.position[ends[np.all(chosen[ends], axis=1)]].reshape(-1, 2, 3)
    on = np.unique(facets.nodes[facets.nodes >= 0])
    single = mesh.position[on[chosen[on]]]
    return np.concatenate([between, np.stack([single, single], axis=1)])


def crowded(points: np.ndarray, segments: Mapping[str, np.ndarray], distance: float) -> dict[str, np.ndarray]:
    """Which points (m, 3) [m] are nearer than the distance [m] to each of the obstacles, in a straight line: name → (m,)."""
    return {name: near_segments(points, segment, distance) for name, segment in segments.items()}


def spaced(points: np.ndarray, distance: float, most: int | None = None) -> np.ndarray:
    """Indices of points (m, 3) [m], at most `most`, each at least `distance` [m] away from all earlier ones."""
    tree, free = cKDTree(points), np.ones(len(points), dtype=bool)
    selected: list[int] = []
    for i in range(len(points)):
        if len(selected) == most:
            break
        if free[i]:
            selected.append(i)
            free[tree.query_ball_point(points[i], distance * (1 - 1e-9))] = False
    return np.array(selected, dtype=np.int64)


EQUAL = 1e-6
"""Largest relative difference of equal distances."""
ACROSS = np.cos(np.deg2rad(45.0))
"""The second edge differs from the first by more than 45° in direction."""
OFF = np.sin(np.deg2rad(30.0))
"""The direction to it is within 30° of the tangent plane; otherwise it would go through the body."""


@dataclass(frozen=True)
class EdgeDimensions:
    """For k positions the nearest edge of the face, and the nearest one across it; NaN without any.

    distance (k, 2) [m] in a straight line; foot (k, 2, 3) [m] nearest point of the edge; along (k, 2, 3) unit vector of the edge,
    projected on the surface, NaN if along the normal; angle (k, 2) [deg] from the edge to the measuring direction, right-handed
    about the outward normal, in (−90, 90], NaN for a direction along the normal."""

    distance: np.ndarray
    foot: np.ndarray
    along: np.ndarray
    angle: np.ndarray


def edge_dimensions(
    position: np.ndarray,
    facets: Facets,
    on: np.ndarray,
    points: np.ndarray,
    directions: np.ndarray,
    normals: np.ndarray,
) -> EdgeDimensions:
    """The two nearest edges of the face of each position.

    A face ends at sharp edges, where facets meet at more than 30° or the number of facets is not two (`edges_of`). With t the
    edge, n the normal, d the direction:

        α = atan2((t × d)·n, t·d)   in (−90°, 90°], because an edge has no orientation

    The second edge contains the foot of the perpendicular from the position, differs from the first by more than 45° and is at
    most 30° out of the tangent plane.
    position (n, 3) [m] of nodes; facets: exterior ones; on (k,): key of the facet of each position, an unknown one has no edges;
    points (k, 3) [m]; directions, normals (k, 3) unit."""
    edges = edges_of(position, facets)
    smooth = edges.start[~edges.sharp]
    face = component_labels(len(facets.kind), edges.facet[smooth], edges.facet[smooth + 1])
    index = {int(key): i for i, key in enumerate(facets.key)}
    of = np.array([face[index[int(key)]] if int(key) in index else -1 for key in on], dtype=np.int64)
    dimensions = no_edges(len(points))
    for number in np.unique(of[of >= 0]):
        rim = np.repeat(edges.sharp, edges.count) & (face == number)[edges.facet]
        segments = _through_middle(position, edges, rim)
        for i in np.flatnonzero(of == number):
            for j, (d, x, t) in enumerate(_nearest_two(segments, points[i], normals[i])):
                dimensions.distance[i, j], dimensions.foot[i, j], dimensions.along[i, j] = d, x, t
                dimensions.angle[i, j] = angle_from(t, directions[i], normals[i])
    return dimensions


def no_edges(count: int) -> EdgeDimensions:
    """Dimensions of positions without any edges."""
    nothing = (np.full((count, 2), np.nan), np.full((count, 2, 3), np.nan))
    return EdgeDimensions(nothing[0], nothing[1], nothing[1].copy(), nothing[0].copy())


def facet_keys(element: np.ndarray, facet: np.ndarray) -> np.ndarray:
    """Keys (k,) of facets by element ids and local numbers (k,), −1 without a facet (facet 0)."""
    return np.where(np.asarray(facet) > 0, facet_key(np.asarray(element), np.asarray(facet)), -1)


def angle_from(t: np.ndarray, d: np.ndarray, n: np.ndarray) -> float:
    """Angle from the line t to the line d [deg], right-handed about n, in (−90, 90]; NaN for t NaN, and for a d along n or of
    zero length, which has no angle on the surface."""
    if np.linalg.norm(np.cross(d, n)) <= EQUAL:
        return float("nan")
    angle = float(np.rad2deg(np.arctan2(np.cross(t, d) @ n, t @ d)))
    rounded = round(angle, 9)
    return angle + 180.0 * (rounded <= -90.0) - 180.0 * (rounded > 90.0)


def _nearest_two(
    segments: np.ndarray, point: np.ndarray, normal: np.ndarray
) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """(distance, foot, unit vector along the edge on the surface) of the nearest edge and of the nearest edge across it."""
    if not len(segments):
        return []
    a, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    length = np.linalg.norm(along, axis=1)
    share = np.sum((point - a) * along, axis=1) / np.maximum(length**2, np.finfo(float).tiny)
    foot = a + np.clip(share, 0, 1)[:, None] * along
    distance = np.linalg.norm(foot - point, axis=1)
    flat = along - np.outer(along @ normal, normal)
    size = np.linalg.norm(flat, axis=1)
    # if a corner is nearest, use the edge there that is closest to the surface
    lying = size / np.maximum(length, np.finfo(float).tiny)
    with np.errstate(invalid="ignore", divide="ignore"):
        t = np.where(lying[:, None] > EQUAL, flat / size[:, None], np.nan)

    def best(allowed: np.ndarray) -> int:
        near = allowed & (distance <= distance[allowed].min() * (1 + EQUAL))
        return int(np.flatnonzero(near & (lying >= lying[near].max() - EQUAL))[0])

    first = best(np.ones(len(segments), dtype=bool))
    indices = [first]
    with np.errstate(invalid="ignore"):
        is_across = np.abs(t @ t[first]) < ACROSS
    lies = np.abs((foot - point) @ normal) <= OFF * distance
    if (across := is_across & lies & (share >= -EQUAL) & (share <= 1 + EQUAL)).any():
        indices.append(best(across))
    return [(float(distance[i]), foot[i], t[i]) for i in indices]


def bend_radius(position: np.ndarray, facets: Facets) -> np.ndarray:
    """The smallest radius of curvature (f,) [m] of every facet, inf for flat facets:

        dn = S dx,     R = 1 / max |eig S|

    S (2, 2), symmetric, from the normals at the corners of the facet by least squares. Each is the mean of the normals of all
    facets at the corner that are within 30° of that of the facet; sharper corners are edges (Rusinkiewicz, Estimating curvatures
    and their derivatives on triangle meshes, 3DPVT 2004). A flat facet next to a curved surface gets part of its curvature,
    which is spread over one facet on either side. position (n, 3) [m]."""
    corners = _corners(position, facets)
    mean = _smooth(corners.node, corners.normal)
    radius = np.full(len(facets.kind), np.inf)
    _, normal = facet_centres(position, facets.kind, facets.nodes)
    e1 = np.cross(normal, farthest_axis(normal))
    length = np.linalg.norm(e1, axis=1, keepdims=True)
    e1 = e1 / np.where(length > 0, length, 1.0)
    plane = np.stack([e1, np.cross(normal, e1)], axis=2)
    for which, rows in corners.of_facets:
        at_corners = (values[rows] for values in (corners.position, mean))
        u, v = ((values - values.mean(axis=1, keepdims=True)) @ plane[which] for values in at_corners)
        S = np.linalg.pinv(u) @ v
        bend = np.abs(np.linalg.eigvalsh(0.5 * (S + S.transpose(0, 2, 1)))).max(axis=1)
        size = np.linalg.norm(u, axis=(1, 2))
        bent = bend * size > 1e-6  # below that it is rounding of the nodes
        radius[which[bent]] = 1 / bend[bent]
    return radius


@dataclass(frozen=True)
class _Corners:
    """The h corners of all facets: node (h,), position (h, 3) [m], normal (h, 3) of the facet there; of_facets: for every kind
    the facets (m,) and their corners (m, c)."""

    node: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    of_facets: tuple[tuple[np.ndarray, np.ndarray], ...]


def _corners(position: np.ndarray, facets: Facets) -> _Corners:
    node, normal, of_facets, start = [np.zeros(0, dtype=np.int64)], [np.zeros((0, 3))], [], 0
    for kind, which, nodes in by_kind(facets.kind, facets.nodes):
        of_facets.append((which, start + np.arange(len(which) * kind.corners).reshape(kind.corners, -1).T))
        for a in range(kind.corners):
            _, J = facet_points(kind, position[nodes], np.tile(kind.nodes[a], (len(nodes), 1)))
            node.append(nodes[:, a])
            normal.append(normals(J))
        start += len(which) * kind.corners
    every = np.concatenate(node)
    return _Corners(every, position[every], np.concatenate(normal), tuple(of_facets))


def _smooth(node: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The mean normal (h, 3) at every corner, over the corners at the same node within 30° of it."""
    h = len(node)
    at = csr_array((np.ones(h), (np.arange(h), node)), shape=(h, int(node.max(initial=-1)) + 1))
    pair = (at @ at.T).tocoo()
    one, other = pair.row, pair.col
    is_smooth = np.sum(normal[one] * normal[other], axis=1) > np.cos(SHARP)
    total = np.zeros((h, 3))
    np.add.at(total, one[is_smooth], normal[other[is_smooth]])
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(total / np.where(length > 0, length, 1.0))


def tight(position: np.ndarray, facets: Facets, radius: float) -> np.ndarray:
    """Which facets (f,) have a radius of curvature below a limit [m]."""
    return np.asarray(bend_radius(position, facets) < radius * (1 - 1e-6))


def sides(position: np.ndarray, facets: Facets, chosen: np.ndarray) -> np.ndarray:
    """The straight sides and diagonals of the selected facets (f,): segments (s, 2, 3) [m]. Points of a facet are at most about a
    quarter of its size away from them."""
    segments = [np.zeros((0, 2, 3))]
    for kind, which, nodes in by_kind(facets.kind, facets.nodes):
        x = position[nodes[chosen[which], : kind.corners]]
        pairs = [(a, b) for a in range(kind.corners) for b in range(a)]
        segments += [np.stack([x[:, a], x[:, b]], axis=1) for a, b in pairs]
    return np.concatenate(segments)
