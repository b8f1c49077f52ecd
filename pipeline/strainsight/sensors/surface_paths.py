"""Nearest points of a surface, and straight paths over it from facet to facet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from strainsight.errors import UserError
from strainsight.mesh.facets import Facets, by_kind, facet_key
from strainsight.mesh.kinds.kind import Kind
from strainsight.sensors.edges import edges_of
from strainsight.sensors.surface import facet_centres, facet_frames, facet_points, on_reference

TURNS = 60.0
"""Largest rotation [deg] of the surface normal along a path; it ends there as at an edge."""
SLACK = 1e-8
"""Largest distance of a point on an edge, as a share of the facet size."""
MAX_STEPS = 10_000


@dataclass(frozen=True)
class Skin:
    """A surface with the connectivity of its facets: position (n, 3) [m] of the nodes; facets, f of them; beyond (f, 4) the facet
    across each edge, −1 if the edge is sharp (over 30°) or the surface ends; side (f, 4) the number of the edge there; curve
    (f, 4, 3, 3) [m] the edges x(t) = c₀ + c₁ t + c₂ t², −1 ≤ t ≤ 1, NaN without such an edge; size (f,) [m]; normal (f, 3) at
    the centres."""

    position: np.ndarray
    facets: Facets
    neighbour: np.ndarray
    side: np.ndarray
    curve: np.ndarray
    size: np.ndarray
    normal: np.ndarray

    def frames(self, facet: np.ndarray, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (p, 3) [m] and outward unit normals (p, 3) at ξ (p, 2) of the facets (p,)."""
        return facet_frames(self.position, self.facets.kind[facet], self.facets.nodes[facet], local)

    def index_of(self, element: np.ndarray, facet: np.ndarray) -> np.ndarray:
        """Indices of the facets with these element ids and local numbers (m,). Raises UserError if one does not exist."""
        known, wanted = self.facets.key, facet_key(element, facet)
        order = np.argsort(known, kind="stable")
        index = order[np.minimum(np.searchsorted(known, wanted, sorter=order), len(order) - 1)]
        if np.any(known[index] != wanted):
            first = int(np.argmax(known[index] != wanted))
            raise UserError(
                f"element {element[first]} has no facet {facet[first]} on this surface",
                remedy="Use the mesh for which the gauges were defined: each gauge must lie on an exterior facet.",
            )
        return index


def skin_of(position: np.ndarray, facets: Facets) -> Skin:
    """The surface of the facets; position (n, 3) [m]."""
    f = len(facets.element_id)
    neighbour, side = np.full((f, 4), -1), np.full((f, 4), -1)
    curve, size = np.full((f, 4, 3, 3), np.nan), np.zeros(f)
    edges = edges_of(position, facets)
    smooth = edges.start[(edges.count == 2) & ~edges.sharp]
    for a, b in ((smooth, smooth + 1), (smooth + 1, smooth)):
        neighbour[edges.facet[a], edges.side[a]] = edges.facet[b]
        side[edges.facet[a], edges.side[a]] = edges.side[b]
    for kind, which, nodes in by_kind(facets.kind, facets.nodes):
        x = position[nodes]
        size[which] = np.linalg.norm(x.max(axis=1) - x.min(axis=1), axis=1)
        for a in range(kind.corners):
            left, right = x[:, a], x[:, (a + 1) % kind.corners]
            mean = 0.5 * (left + right)
            middle = x[:, kind.corners + a] if kind.edges else mean
            curve[which, a] = np.stack([middle, 0.5 * (right - left), mean - middle], axis=1)
    _, normal = facet_centres(position, facets.kind, facets.nodes)
    return Skin(position, facets, neighbour, side, curve, size, normal)


@dataclass(frozen=True)
class Trail:
    """Paths of w walkers in s pieces, each on one facet: walker (s,), facet (s,) index, begin and end (s,) [m] along the path;
    reached (w,) whether it reached its end; last (w,) facet and length (w,) [m] where it stopped."""

    walker: np.ndarray
    facet: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    reached: np.ndarray
    last: np.ndarray
    length: np.ndarray


def walk(
    skin: Skin, facet: np.ndarray, origin: np.ndarray, normal: np.ndarray, ahead: np.ndarray, length: np.ndarray
) -> Trail:
    """Follow the surface above the straight line x₀ + u e, 0 ≤ u ≤ L, of the tangent plane of n at x₀:

        (x − x₀)·(n × e) = 0,     u = (x − x₀)·e

    so that the line leaves a facet where one of its edges, a parabola in t, meets the first equation at the smallest u ahead.
    facet (w,) index at the start; origin x₀ (w, 3) [m] on it; normal n (w, 3); ahead e (w, 3) unit, perpendicular to n; length
    L (w,) [m]. A path stops at a sharp edge, and where the surface normal has rotated by 60°."""
    w = len(facet)
    across = np.cross(normal, ahead)
    here, came, u = facet.copy(), np.full(w, -1), np.zeros(w)
    reached = np.zeros(w, dtype=bool)
    pieces: list[tuple[np.ndarray, ...]] = []
    active = np.arange(w)
    for _ in range(MAX_STEPS):
        if not len(active):
            break
        g = here[active]
        out, edge = _exit(skin, g, origin[active], ahead[active], across[active], u[active], came[active])
        target, slack = length[active], SLACK * skin.size[g]
        arrives = target <= out + slack
        end = np.minimum(np.maximum(out, u[active]), target)
        pieces.append((active, g, u[active], end))
        u[active] = end
        reached[active[arrives]] = True
        following = skin.neighbour[g, edge]
        too_steep = np.sum(skin.normal[following] * normal[active], axis=1) < np.cos(np.deg2rad(TURNS))
        on = ~arrives & (edge >= 0) & (following >= 0) & ~too_steep
        onward = active[on]
        here[onward], came[onward] = following[on], skin.side[g[on], edge[on]]
        active = onward
    columns = [np.concatenate(column) for column in zip(*pieces, strict=True)] if pieces else [np.zeros(0, int)] * 4
    return Trail(columns[0], columns[1], columns[2], columns[3], reached, here, u)


def _exit(
    skin: Skin,
    g: np.ndarray,
    origin: np.ndarray,
    ahead: np.ndarray,
    across: np.ndarray,
    u: np.ndarray,
    came: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Exit of the line from each facet g (k,): u (k,) [m] and number of the edge (k,), −1 (at the old u) without an exit."""
    curve = skin.curve[g].copy()
    curve[:, :, 0] -= origin[:, None]
    aside = np.einsum("kepc,kc->kep", curve, across)
    slack = SLACK * skin.size[g]
    t = _roots(aside, slack)
    forward = np.einsum("kepc,kc->kep", curve, ahead)[..., None]
    at = forward[:, :, 0] + t * (forward[:, :, 1] + t * forward[:, :, 2])
    gap = at - u[:, None, None]
    gap = np.where(np.abs(t) <= 1 + 1e-7, gap, np.nan).reshape(len(g), -1)
    far = np.where(gap > slack[:, None], gap, np.inf)
    number = np.repeat(np.arange(4), 2)
    # through a corner the line only touches a facet and continues over the other edge there
    near = (np.abs(gap) <= slack[:, None]) & (number != came[:, None])
    first = np.argmin(far, axis=1)
    some_far, some_near = np.isfinite(far.min(axis=1)), near.any(axis=1)
    chosen = np.where(some_far, first, np.argmax(near, axis=1))
    edge = np.where(some_far | some_near, number[chosen], -1)
    step = np.where(some_far, far[np.arange(len(g)), first], 0.0)
    return u + step, edge


def _roots(p: np.ndarray, slack: np.ndarray) -> np.ndarray:
    """Real roots of p₀ + p₁ t + p₂ t², NaN without any or if the line runs along the edge: p (k, 4, 3), slack (k,)."""
    c, b, a = p[..., 0], p[..., 1], p[..., 2]
    with np.errstate(all="ignore"):
        q = -0.5 * (b + np.where(b < 0, -1.0, 1.0) * np.sqrt(b * b - 4 * a * c))
        t = np.stack([q / a, c / q], axis=-1)
        along = np.abs(p).sum(axis=-1) <= slack[:, None]
    return np.where(along[..., None] | ~np.isfinite(t), np.nan, t)


def local_at(
    skin: Skin, facet: np.ndarray, origin: np.ndarray, plane: np.ndarray, target: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """ξ (p, 2) of the point of each facet above a point of a plane, (x(ξ) − x₀)·[e₁, e₂] = target, by Newton's method.

    facet (p,) index; origin x₀ (p, 3) [m]; plane (p, 2, 3) unit e₁, e₂; target (p, 2) [m]. Returns ξ and converged (p,)."""
    xi, converged = np.zeros((len(facet), 2)), np.zeros(len(facet), dtype=bool)
    for kind, which, nodes in by_kind(skin.facets.kind[facet], skin.facets.nodes[facet]):
        corners, facet_plane = skin.position[nodes], plane[which]
        xi[which], converged[which] = _newton(
            kind, corners, origin[which], facet_plane, target[which], skin.size[facet[which]]
        )
    return xi, converged


def _newton(
    kind: Kind, corners: np.ndarray, origin: np.ndarray, plane: np.ndarray, target: np.ndarray, size: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    xi = np.tile(kind.centre, (len(corners), 1))
    enough = 1e-11 * size + 4e-16 * np.abs(origin).max(axis=1, initial=0.0)
    remaining = np.arange(len(corners))
    for _ in range(25):
        x, J = facet_points(kind, corners[remaining], xi[remaining])
        miss = target[remaining] - np.einsum("mac,mc->ma", plane[remaining], x - origin[remaining])
        off = np.abs(miss).max(axis=1, initial=0.0) >= enough[remaining]
        remaining, J, miss = remaining[off], J[off], miss[off]
        if not len(remaining):
            break
        A = plane[remaining] @ J
        det = A[:, 0, 0] * A[:, 1, 1] - A[:, 0, 1] * A[:, 1, 0]
        inverse = 1 / np.where(np.abs(det) > 1e-12 * size[remaining] ** 2, det, np.inf)
        step = inverse[:, None] * np.column_stack(
            [A[:, 1, 1] * miss[:, 0] - A[:, 0, 1] * miss[:, 1], A[:, 0, 0] * miss[:, 1] - A[:, 1, 0] * miss[:, 0]]
        )
        # limited to half the local range, so that a bad start cannot leave the facet for good
        xi[remaining] = np.clip(xi[remaining] + np.clip(step, -0.5, 0.5), -1.5, 1.5)
    converged = np.ones(len(corners), dtype=bool)
    converged[remaining] = False
    return xi, converged


FIRST = 6
"""Number of facets by their centres that give a first bound of the distance."""
REACH = 1.3
"""Factor of the sphere about a curved facet relative to the distance of its nodes from its centre."""


@dataclass(frozen=True)
class Located:
    """facet (p,) index; local (p, 2) ξ there; point (p, 3) [m] of the surface; distance (p,) [m] to it."""

    facet: np.ndarray
    local: np.ndarray
    point: np.ndarray
    distance: np.ndarray


def locate(skin: Skin, points: np.ndarray) -> Located:
    """The point of the surface nearest to each of the points (p, 3) [m].

    The nearest of a few facets bounds the distance; then the points are projected on every facet whose sphere is nearer, so that
    a large facet next to small ones is found. Of equally near facets (to 1e-9 of their size) the first counts."""
    centre, _ = facet_centres(skin.position, skin.facets.kind, skin.facets.nodes)
    radius = radius_of(skin, centre)
    tree = cKDTree(centre)
    _, some = tree.query(points, k=min(FIRST, len(centre)))
    pair_point = np.repeat(np.arange(len(points)), some.size // max(1, len(points)))
    best = _nearest(skin, points, pair_point, some.ravel())
    # larger than the rounding of the bound, so that its facet stays among the candidates
    bound = best.distance * (1 + 1e-9) + 1e-12 * radius.max()
    near = tree.query_ball_point(points, bound + radius.max())
    pair_point = np.repeat(np.arange(len(points)), [len(facets) for facets in near])
    pair_facet = np.concatenate([np.sort(np.asarray(facets, dtype=np.int64)) for facets in near])
    distance = np.linalg.norm(points[pair_point] - centre[pair_facet], axis=1)
    worth = distance - radius[pair_facet] <= bound[pair_point]
    return _nearest(skin, points, pair_point[worth], pair_facet[worth])


def radius_of(skin: Skin, centre: np.ndarray) -> np.ndarray:
    """Radius (f,) [m] of a bounding sphere about the centre (f, 3) of each facet."""
    radius = np.zeros(len(centre))
    for kind, which, nodes in by_kind(skin.facets.kind, skin.facets.nodes):
        far = np.linalg.norm(skin.position[nodes] - centre[which, None], axis=2).max(axis=1)
        radius[which] = far * (REACH if kind.edges else 1.0)
    return radius


def _nearest(skin: Skin, points: np.ndarray, of: np.ndarray, facet: np.ndarray) -> Located:
    """The nearest facet of every point, among pairs of a point (k,) and a facet (k,)."""
    local, x = np.zeros((len(of), 2)), np.zeros((len(of), 3))
    for kind, which, nodes in by_kind(skin.facets.kind[facet], skin.facets.nodes[facet]):
        local[which], x[which] = project(kind, skin.position[nodes], points[of[which]])
    distance = np.linalg.norm(x - points[of], axis=1)
    step = 1e-9 * skin.size[facet].max(initial=1e-300)
    order = np.lexsort((facet, np.round(distance / step), of))
    first = order[np.flatnonzero(np.diff(of[order], prepend=-1) != 0)]
    return Located(facet[first], local[first], x[first], distance[first])


def project(kind: Kind, corners: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ξ (k, 2) and x(ξ) (k, 3) of the point of each facet, including its edges, nearest to its point (k, 3).

    In the interior, Newton's method for min |x(ξ) − p|² from the nearest of a few samples; on every edge, a parabola in t, the
    same in one dimension. corners (k, n, 3) [m] all nodes of the facets."""
    local, best = _nearest_in_facet(kind, corners, points)
    x, _ = facet_points(kind, corners, local)
    least = np.linalg.norm(x - points, axis=1)
    least[~best] = np.inf
    reference, count = kind.nodes, kind.corners
    for a in range(count):
        b = (a + 1) % count
        left, right = corners[:, a], corners[:, b]
        mean = 0.5 * (left + right)
        middle = corners[:, count + a] if kind.edges else mean
        t = _nearest_on_edge(middle - points, 0.5 * (right - left), mean - middle)
        xi = 0.5 * (reference[a] + reference[b]) + 0.5 * t[:, None] * (reference[b] - reference[a])
        at, _ = facet_points(kind, corners, xi)
        distance = np.linalg.norm(at - points, axis=1)
        nearer = distance < least
        local[nearer], x[nearer], least[nearer] = xi[nearer], at[nearer], distance[nearer]
    return local, x


def _nearest_on_edge(c: np.ndarray, b: np.ndarray, a: np.ndarray) -> np.ndarray:
    """t (k,) in [−1, 1] that minimises |c + b t + a t²|, all (k, 3): Newton's method from the least of nine samples."""
    samples = np.linspace(-1, 1, 9)
    value = c[:, None] + b[:, None] * samples[:, None] + a[:, None] * samples[:, None] ** 2
    t = samples[np.argmin(np.sum(value**2, axis=2), axis=1)]
    for _ in range(15):
        x, dx = c + b * t[:, None] + a * t[:, None] ** 2, b + 2 * a * t[:, None]
        slope, flat = np.sum(x * dx, axis=1), np.sum(dx * dx, axis=1)
        bend = flat + 2 * np.sum(x * a, axis=1)
        bend = np.where(bend > 0.1 * flat, bend, flat)
        t = np.clip(t - slope / np.where(bend > 0, bend, 1.0), -1, 1)
    return t


def _nearest_in_facet(kind: Kind, corners: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ξ (k, 2) of the nearest point in the interior of the facet, and whether it is inside (k,)."""
    simplex, line = kind.corners == 3, (np.arange(4) + 0.5) / 4
    if simplex:
        samples = np.array([(u, v) for u in line for v in line if u + v < 1])
    else:
        samples = np.array([(u, v) for u in 2 * line - 1 for v in 2 * line - 1])
    offset = np.stack([facet_points(kind, corners, np.tile(s, (len(corners), 1)))[0] - points for s in samples], axis=1)
    xi = samples[np.argmin(np.sum(offset**2, axis=2), axis=1)]
    for _ in range(20):
        x, J = facet_points(kind, corners, xi)
        miss = x - points
        slope = np.einsum("kca,kc->ka", J, miss)
        flat = np.swapaxes(J, 1, 2) @ J
        H = flat + _bend(kind, corners, xi, miss)
        trace, det = np.trace(H, axis1=1, axis2=2), np.linalg.det(H)
        sound = (trace > 0) & (det > 1e-3 * np.linalg.det(flat))
        H = np.where(sound[:, None, None], H, flat)
        H = np.where((np.abs(np.linalg.det(H)) > 1e-300)[:, None, None], H, np.eye(2))
        step = np.clip(np.linalg.solve(H, -slope[..., None])[..., 0], -0.5, 0.5)
        xi = np.clip(xi + step, -0.05 if simplex else -1.05, 1.05)
    return xi, on_reference(kind, xi)


def _bend(kind: Kind, corners: np.ndarray, xi: np.ndarray, miss: np.ndarray) -> np.ndarray:
    """(x − p)·∂²x/∂ξ∂ξ (k, 2, 2); central differences of the gradients, which are polynomials of degree 2, are exact."""
    second = []
    for b in np.eye(2):
        ahead, behind = kind.gradient(xi + 0.5 * b), kind.gradient(xi - 0.5 * b)
        second.append(np.einsum("kna,knc,kc->ka", ahead - behind, corners, miss))
    H = np.stack(second, axis=2)
    return 0.5 * (H + np.swapaxes(H, 1, 2))
