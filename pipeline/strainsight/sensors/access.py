"""What stands over a place, beside it and opposite: room for a hand, faces that lie on another, the other side of a wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from strainsight.mesh.facets import Facets
from strainsight.mesh.model import Mesh
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.faces import Faces
from strainsight.sensors.rows import installation_axes
from strainsight.sensors.surface import by_kind, facet_centres, farthest_axis, on_reference
from strainsight.sensors.walk import Located, Skin, local_at, radius_of

ON = 1e-7
"""Of the local range: how far outside a facet a point still counts as on it, so that none is lost between two."""


def opposite(skin: Skin, points: np.ndarray, normals: np.ndarray) -> Located:
    """The first exit of the rays x = p − t n, t > 0, through the surface: `_first`.

    points p (k, 3) [m] on the surface; normals n (k, 3) outward there. facet −1 where a ray meets none.
    """
    return _first(skin, points, normals, 1.0, np.inf)


def _first(skin: Skin, points: np.ndarray, normals: np.ndarray, way: float, reach: float) -> Located:
    """Where the rays x = p − t n, t > 0, first leave the body (way 1), or enter it (−1):

        (x(ξ) − p)·[e₁, e₂] = 0,   e₁, e₂ across n,     way n′·n < 0,     the least t

    Rays go on step by step, each of the size of the largest facet, among the facets whose spheres come near to that step, up to
    the first step beyond the reach [m]. Of facets met at one t (a common edge) the first counts.
    """
    k = len(points)
    centre, _ = facet_centres(skin.position, skin.facets.kind, skin.facets.nodes)
    radius, tree = radius_of(skin, centre), cKDTree(centre)
    step = float(radius.max())
    far = float(np.linalg.norm(np.ptp(skin.position, axis=0))) + step
    facet, local, t = np.full(k, -1), np.zeros((k, 2)), np.full(k, np.inf)
    active = np.arange(k)
    for number in range(int(np.ceil(min(far, reach) / step))):
        if not len(active):
            break
        middle = points[active] - (number + 0.5) * step * normals[active]
        near = tree.query_ball_point(middle, np.full(len(middle), 1.5 * step * (1 + ON)))
        of = np.repeat(active, [len(own) for own in near])
        asked = np.concatenate([np.sort(np.asarray(own, dtype=np.int64)) for own in near])
        away = centre[asked] - points[of]
        aside = np.linalg.norm(away - np.sum(away * normals[of], axis=1)[:, None] * normals[of], axis=1)
        worth = aside <= radius[asked] * (1 + ON)
        xi, at, leaves = _met(skin, points, normals, of[worth], asked[worth], way)
        of, asked = of[worth], asked[worth]
        # What is farther than this step is asked again in its own, among all that may be there.
        order = np.flatnonzero(leaves & (at > 0) & (at <= (number + 1) * step))
        order = order[np.lexsort((asked[order], np.round(at[order] / (1e-9 * step)), of[order]))]
        first = order[np.flatnonzero(np.diff(of[order], prepend=-1) != 0)]
        facet[of[first]], local[of[first]], t[of[first]] = asked[first], xi[first], at[first]
        active = active[facet[active] < 0]
    on_facet = facet >= 0
    x = np.full((k, 3), np.nan)
    x[on_facet], _ = skin.frames(facet[on_facet], local[on_facet])
    return Located(facet, local, x, t)


def _met(
    skin: Skin, points: np.ndarray, normals: np.ndarray, of: np.ndarray, facet: np.ndarray, way: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """ξ (q, 2) and t (q,) [m] at which rays `of` (q,) meet facets (q,), and whether they leave the body there (q,), or, way −1,
    enter it."""
    n = normals[of]
    e1 = np.cross(n, farthest_axis(n))
    e1 /= np.linalg.norm(e1, axis=1)[:, None]
    plane = np.stack([e1, np.cross(n, e1)], axis=1)
    xi, found = local_at(skin, facet, points[of], plane, np.zeros((len(of), 2)))
    x, outward = skin.frames(facet, xi)
    for kind, which, _ in by_kind(skin.facets.kind[facet], skin.facets.nodes[facet]):
        found[which] &= on_reference(kind, xi[which], ON)
    found &= way * np.sum(outward * n, axis=1) < -1e-9
    return xi, np.sum((points[of] - x) * n, axis=1), found


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
        """How far rays go outside the body before they enter it; inf where they do not within the reach."""
        distance = _first(skin, start, -ahead, -1.0, reach).distance
        return np.asarray(np.where(distance <= reach, distance, np.inf))

    found = height(n)
    for e in axes:
        one, other = (height(np.cos(SLANT) * n + way * np.sin(SLANT) * e) for way in (1.0, -1.0))
        found = np.minimum(found, np.maximum(one, other))
    return np.asarray(np.where(found <= 2 * OFF * reach, 0.0, found))


ALONG = np.cos(np.deg2rad(5.0))
"""Of the angle between the axis of a bore and the normal of a face into which it runs straight."""
RIM = 3
"""Nodes that two faces share where one runs into the other, and held ones that make a bore a held one: a circle has as many."""
LEVEL = 1e-6
"""Of the size of the part: heights that are the same."""


@dataclass(frozen=True)
class ContactFaces:
    """Faces (c,) that probably lie on something, by their numbers in `Faces`, ascending; bores (c,): how many held bores run into
    each; places (c,): how many of its facets are held themselves; instead_of (c,): the face at the other end of its bores, where
    it is one of the two that the part lies on and nothing says which, of the later one of them; −1 otherwise."""

    face: np.ndarray
    bores: np.ndarray
    places: np.ndarray
    instead_of: np.ndarray

    def in_words(self, i: int) -> str:
        """What holds face i of these."""
        bores, places = int(self.bores[i]), int(self.places[i])
        reasons = [f"by {bores} bore{'s' * (bores != 1)}"] * (bores > 0)
        reasons += [f"on {places} of its facets"] * (places > 0)
        return f"held {' and '.join(reasons)}"


def contact_faces(mesh: Mesh, facets: Facets, faces: Faces) -> ContactFaces:
    """Flat faces of exterior facets that something probably lies on:

    - where some facets of it, but not all, have all their nodes held: what holds them lies on the face. Those of shells and
      beams do not count: their nodes are held, whichever side what holds them is on;
    - where a bore runs into it at a right angle, and nodes of that are held, as by a bolt. Of the faces into which such a bore
      runs it is the one over which the least of the part rises, max n·(x − c) over its nodes, n the outward normal: a part stands
      on the face from which nothing sticks out. Of a plate both are found, of which it is probably one.

    Held is a node with a support, on a spring, or tied to a reference node that is held. A bore is one as `Faces` finds it.
    A face that is held as a whole has no place for a gauge, and its nodes make no bore held: a plane of symmetry cuts bores.
    """
    held = _held(mesh)
    on = facets.nodes >= 0
    facet_held = np.all(held[facets.nodes] | ~on, axis=1) & ~facets.of(mesh.thin)
    places = np.bincount(faces.of[facet_held], minlength=len(faces.area))
    flat = faces.normal.any(axis=1)
    whole = flat & (places == np.bincount(faces.of, minlength=len(faces.area)))
    fixed = np.zeros(len(held), dtype=bool)
    own = on & whole[faces.of][:, None]
    fixed[facets.nodes[own]] = True

    nodes = [np.unique(each[each >= 0]) for each in _split(facets.nodes, faces.of, len(faces.area))]
    bores = np.zeros(len(faces.area), dtype=int)
    sides: list[tuple[int, int]] = []
    sure = whole | (places > 0)
    used = np.unique(facets.nodes[on])
    size = float(np.linalg.norm(np.ptp(mesh.position[used], axis=0)))
    for bore in np.flatnonzero(faces.hollow):
        if np.count_nonzero(held[nodes[bore]] & ~fixed[nodes[bore]]) < RIM:
            continue
        across = flat & (np.abs(faces.normal @ faces.axis[bore]) > ALONG)
        ends = [f for f in np.flatnonzero(across) if len(np.intersect1d(nodes[f], nodes[bore])) >= RIM]
        above = np.array([np.max((mesh.position[used] - faces.centre[f]) @ faces.normal[f]) for f in ends])
        lowest = [int(f) for f, h in zip(ends, above, strict=True) if h <= above.min() + LEVEL * size]
        bores[lowest] += 1
        sides += [(lowest[0], f) for f in lowest[1:]]
        sure[lowest] |= len(lowest) == 1
    instead_of = np.full(len(faces.area), -1)
    for one, other in sides:
        if not sure[other]:
            instead_of[other] = one
        elif not sure[one]:
            instead_of[one] = other
    chosen = np.flatnonzero(flat & ~whole & ((bores > 0) | (places > 0)))
    return ContactFaces(chosen, bores[chosen], places[chosen], instead_of[chosen])


def _held(mesh: Mesh) -> np.ndarray:
    held = np.zeros(len(mesh.position), dtype=bool)
    held[mesh.held] = True
    for own in mesh.springs:
        held[own.node] = True
    for tie in mesh.ties:
        if held[tie.reference]:
            held[tie.nodes] = True
    for relation in mesh.relations:
        held[relation.node[0]] |= bool(held[relation.node[1:]].all())
    return mesh.above(held)


def _split(rows: np.ndarray, of: np.ndarray, count: int) -> list[np.ndarray]:
    """Rows (f, ...) of each of the groups."""
    return np.split(rows[np.argsort(of, kind="stable")], np.cumsum(np.bincount(of, minlength=count))[:-1])
