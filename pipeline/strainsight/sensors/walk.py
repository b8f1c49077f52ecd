"""The nearest point of a surface, and straight ahead over it from facet to facet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from strainsight.errors import UserError
from strainsight.mesh.facets import Facets, facet_key
from strainsight.mesh.kinds.kind import Kind
from strainsight.sensors.edges import edges_of
from strainsight.sensors.surface import by_kind, facet_centres, facet_frames, facet_points, on_reference

TURNS = 60.0
"""Degrees: a surface that has turned by more than this away from where the walk began ends it as an edge would."""
SLACK = 1e-8
"""Share of a facet's size within which a point lies on its edge."""
MOST_STEPS = 10_000


@dataclass(frozen=True)
class Skin:
    """A surface whose facets know one another: position (n, 3) [m] of the nodes; facets, f of them; beyond (f, 4) the facet
    across each edge, −1 where the edge is sharp (over 30°) or the surface ends; side (f, 4) the edge's number there;
    curve (f, 4, 3, 3) [m] the edges x(t) = c₀ + c₁ t + c₂ t², −1 ≤ t ≤ 1, nan where a facet has no such edge; size (f,) [m];
    normal (f, 3) at the centres."""

    position: np.ndarray
    facets: Facets
    beyond: np.ndarray
    side: np.ndarray
    curve: np.ndarray
    size: np.ndarray
    normal: np.ndarray

    def frames(self, facet: np.ndarray, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (p, 3) [m] and outward unit normals (p, 3) at ξ (p, 2) of the facets (p,)."""
        return facet_frames(self.position, self.facets.kind[facet], self.facets.nodes[facet], local)

    def index_of(self, element: np.ndarray, facet: np.ndarray) -> np.ndarray:
        """Indices of the facets with these element ids and local numbers (m,). Raises UserError for one that is not there."""
        known, wanted = self.facets.key, facet_key(element, facet)
        order = np.argsort(known, kind="stable")
        index = order[np.minimum(np.searchsorted(known, wanted, sorter=order), len(order) - 1)]
        if np.any(known[index] != wanted):
            first = int(np.argmax(known[index] != wanted))
            raise UserError(
                f"element {element[first]} has no facet {facet[first]} on this surface",
                remedy="take the exterior facets of the mesh that the gauges lie on",
            )
        return index


def skin_of(position: np.ndarray, facets: Facets) -> Skin:
    """The surface that the facets make; position (n, 3) [m]."""
    f = len(facets.element_id)
    beyond, side = np.full((f, 4), -1), np.full((f, 4), -1)
    curve, size = np.full((f, 4, 3, 3), np.nan), np.zeros(f)
    edges = edges_of(position, facets)
    smooth = edges.start[(edges.count == 2) & ~edges.sharp]
    for a, b in ((smooth, smooth + 1), (smooth + 1, smooth)):
        beyond[edges.facet[a], edges.side[a]] = edges.facet[b]
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
    return Skin(position, facets, beyond, side, curve, size, normal)


@dataclass(frozen=True)
class Trail:
    """Where w walkers went, in s pieces, each on one facet: walker (s,), facet (s,) index, begin and end (s,) [m] along the
    way; reached (w,) whether it got to its end; last (w,) facet and length (w,) [m] where it stopped."""

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
    """Walk over the surface above the straight line x₀ + u e, 0 ≤ u ≤ L, of the tangent plane of n at x₀:

        (x − x₀)·(n × e) = 0,     u = (x − x₀)·e

    so that the line leaves a facet where one of its edges, a parabola in t, meets the first equation at the least u ahead.
    facet (w,) index where it begins; origin x₀ (w, 3) [m] on it; normal n (w, 3); ahead e (w, 3) unit, across n;
    length L (w,) [m]. It stops at a sharp edge, and where the surface has turned away by 60°.
    """
    w = len(facet)
    across = np.cross(normal, ahead)
    here, came, u = facet.copy(), np.full(w, -1), np.zeros(w)
    reached = np.zeros(w, dtype=bool)
    pieces: list[tuple[np.ndarray, ...]] = []
    active = np.arange(w)
    for _ in range(MOST_STEPS):
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
        following = skin.beyond[g, edge]
        turned = np.sum(skin.normal[following] * normal[active], axis=1) < np.cos(np.deg2rad(TURNS))
        on = ~arrives & (edge >= 0) & (following >= 0) & ~turned
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
    """Where the line leaves each facet g (k,): u (k,) [m] and the edge's number (k,), −1 (at the old u) for nowhere."""
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
    # Through a corner the line only touches a facet: it goes on over the other edge that meets there.
    near = (np.abs(gap) <= slack[:, None]) & (number != came[:, None])
    first = np.argmin(far, axis=1)
    some_far, some_near = np.isfinite(far.min(axis=1)), near.any(axis=1)
    chosen = np.where(some_far, first, np.argmax(near, axis=1))
    edge = np.where(some_far | some_near, number[chosen], -1)
    step = np.where(some_far, far[np.arange(len(g)), first], 0.0)
    return u + step, edge


def _roots(p: np.ndarray, slack: np.ndarray) -> np.ndarray:
    """Real roots of p₀ + p₁ t + p₂ t², nan where there are none or the line runs along the edge: p (k, 4, 3), slack (k,)."""
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

    facet (p,) index; origin x₀ (p, 3) [m]; plane (p, 2, 3) unit e₁, e₂; target (p, 2) [m]. Returns ξ and found (p,).
    """
    xi, found = np.zeros((len(facet), 2)), np.zeros(len(facet), dtype=bool)
    for kind, which, nodes in by_kind(skin.facets.kind[facet], skin.facets.nodes[facet]):
        corners, own = skin.position[nodes], plane[which]
        xi[which], found[which] = _newton(kind, corners, origin[which], own, target[which], skin.size[facet[which]])
    return xi, found


def _newton(
    kind: Kind, corners: np.ndarray, origin: np.ndarray, plane: np.ndarray, target: np.ndarray, size: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    xi = np.tile(kind.centre, (len(corners), 1))
    enough = 1e-11 * size + 4e-16 * np.abs(origin).max(axis=1, initial=0.0)
    left = np.arange(len(corners))
    for _ in range(25):
        x, J = facet_points(kind, corners[left], xi[left])
        miss = target[left] - np.einsum("mac,mc->ma", plane[left], x - origin[left])
        off = np.abs(miss).max(axis=1, initial=0.0) >= enough[left]
        left, J, miss = left[off], J[off], miss[off]
        if not len(left):
            break
        A = plane[left] @ J
        det = A[:, 0, 0] * A[:, 1, 1] - A[:, 0, 1] * A[:, 1, 0]
        inverse = 1 / np.where(np.abs(det) > 1e-12 * size[left] ** 2, det, np.inf)
        step = inverse[:, None] * np.column_stack(
            [A[:, 1, 1] * miss[:, 0] - A[:, 0, 1] * miss[:, 1], A[:, 0, 0] * miss[:, 1] - A[:, 1, 0] * miss[:, 0]]
        )
        # A step of at most half the local range: a bad start must not throw the search out of the facet for good.
        xi[left] = np.clip(xi[left] + np.clip(step, -0.5, 0.5), -1.5, 1.5)
    found = np.ones(len(corners), dtype=bool)
    found[left] = False
    return xi, found


FIRST = 6
"""Facets by their centres that give a first bound on the distance."""
REACH = 1.3
"""How far a bent facet may reach beyond its nodes, as a share of their distance from its centre."""


@dataclass(frozen=True)
class Located:
    """facet (p,) index; local (p, 2) ξ there; point (p, 3) [m] of the surface; distance (p,) [m] to it."""

    facet: np.ndarray
    local: np.ndarray
    point: np.ndarray
    distance: np.ndarray


def locate(skin: Skin, points: np.ndarray) -> Located:
    """The point of the surface nearest to each of the points (p, 3) [m].

    The nearest of a few facets bounds the distance from above; every facet whose sphere comes nearer is then projected onto,
    so that a large facet beside small ones is not missed. Of facets equally near (to 1e-9 of their size) the first counts.
    """
    centre, _ = facet_centres(skin.position, skin.facets.kind, skin.facets.nodes)
    radius = radius_of(skin, centre)
    tree = cKDTree(centre)
    _, some = tree.query(points, k=min(FIRST, len(centre)))
    pair_point = np.repeat(np.arange(len(points)), some.size // max(1, len(points)))
    best = _nearest(skin, points, pair_point, some.ravel())
    # Twice the rounding of the bound, so that the facet which gave it stays among those asked.
    bound = best.distance * (1 + 1e-9) + 1e-12 * radius.max()
    near = tree.query_ball_point(points, bound + radius.max())
    pair_point = np.repeat(np.arange(len(points)), [len(facets) for facets in near])
    pair_facet = np.concatenate([np.sort(np.asarray(facets, dtype=np.int64)) for facets in near])
    apart = np.linalg.norm(points[pair_point] - centre[pair_facet], axis=1)
    worth = apart - radius[pair_facet] <= bound[pair_point]
    return _nearest(skin, points, pair_point[worth], pair_facet[worth])


def radius_of(skin: Skin, centre: np.ndarray) -> np.ndarray:
    """Radius (f,) [m] of a sphere about the centre (f, 3) of each facet that all of it lies in."""
    radius = np.zeros(len(centre))
    for kind, which, nodes in by_kind(skin.facets.kind, skin.facets.nodes):
        far = np.linalg.norm(skin.position[nodes] - centre[which, None], axis=2).max(axis=1)
        radius[which] = far * (REACH if kind.edges else 1.0)
    return radius


def _nearest(skin: Skin, points: np.ndarray, of: np.ndarray, facet: np.ndarray) -> Located:
    """The best facet of every point among pairs of a point (k,) and a facet (k,)."""
    local, x = np.zeros((len(of), 2)), np.zeros((len(of), 3))
    for kind, which, nodes in by_kind(skin.facets.kind[facet], skin.facets.nodes[facet]):
        local[which], x[which] = project(kind, skin.position[nodes], points[of[which]])
    distance = np.linalg.norm(x - points[of], axis=1)
    step = 1e-9 * skin.size[facet].max(initial=1e-300)
    order = np.lexsort((facet, np.round(distance / step), of))
    first = order[np.flatnonzero(np.diff(of[order], prepend=-1) != 0)]
    return Located(facet[first], local[first], x[first], distance[first])


def project(kind: Kind, corners: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ξ (k, 2) and x(ξ) (k, 3) of the point of each facet, its edges included, that is nearest to its point (k, 3).

    Inside, Newton's method for min |x(ξ) − p|² from the nearest of a few samples; on every edge, a parabola in t, the same in
    one dimension. corners (k, n, 3) [m] all nodes of the facets.
    """
    local, best = _inside(kind, corners, points)
    x, _ = facet_points(kind, corners, local)
    least = np.linalg.norm(x - points, axis=1)
    least[~best] = np.inf
    reference, count = kind.nodes, kind.corners
    for a in range(count):
        b = (a + 1) % count
        left, right = corners[:, a], corners[:, b]
        mean = 0.5 * (left + right)
        middle = corners[:, count + a] if kind.edges else mean
        t = _along(middle - points, 0.5 * (right - left), mean - middle)
        xi = 0.5 * (reference[a] + reference[b]) + 0.5 * t[:, None] * (reference[b] - reference[a])
        at, _ = facet_points(kind, corners, xi)
        apart = np.linalg.norm(at - points, axis=1)
        nearer = apart < least
        local[nearer], x[nearer], least[nearer] = xi[nearer], at[nearer], apart[nearer]
    return local, x


def _along(c: np.ndarray, b: np.ndarray, a: np.ndarray) -> np.ndarray:
    """t (k,) in [−1, 1] that minimises |c + b t + a t²|, all (k, 3): Newton from the least of nine samples."""
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


def _inside(kind: Kind, corners: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ξ (k, 2) of the nearest point of the facet's interior, and whether it is one (k,)."""
    simplex, line = kind.corners == 3, (np.arange(4) + 0.5) / 4
    if simplex:
        samples = np.array([(u, v) for u in line for v in line if u + v < 1])
    else:
        samples = np.array([(u, v) for u in 2 * line - 1 for v in 2 * line - 1])
    apart = np.stack([facet_points(kind, corners, np.tile(s, (len(corners), 1)))[0] - points for s in samples], axis=1)
    xi = samples[np.argmin(np.sum(apart**2, axis=2), axis=1)]
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
