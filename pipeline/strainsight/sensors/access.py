"""Access to gauges: clearance above and next to them, contact faces, bores, and the opposite side of a wall."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from strainsight.mesh.facets import Facets, by_kind
from strainsight.mesh.model import Mesh
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.edges import constrained_nodes
from strainsight.sensors.faces import Faces, facet_vectors
from strainsight.sensors.strain_operator import installation_axes
from strainsight.sensors.surface import facet_centres, farthest_axis, on_reference
from strainsight.sensors.surface_paths import Located, Skin, local_at, radius_of

ON = 1e-7
"""How far outside a facet a point still counts as on it, as a share of the local range, so that no point between two is lost."""


def opposite(skin: Skin, points: np.ndarray, normals: np.ndarray) -> Located:
    """The first exit of the rays x = p − t n, t > 0, through the surface: `_first`.

    points p (k, 3) [m] on the surface; normals n (k, 3) outward there. facet −1 if a ray meets no facet."""
    return _first(skin, points, normals, 1.0, np.inf)


def _first(skin: Skin, points: np.ndarray, normals: np.ndarray, way: float, reach: float) -> Located:
    """Where the rays x = p − t n, t > 0, first leave the body (way 1), or enter it (−1):

        (x(ξ) − p)·[e₁, e₂] = 0,   e₁, e₂ across n,     way n′·n < 0,     the least t

    Rays advance in steps of the size of the largest facet, among the facets whose bounding spheres are close to that step, up to
    the first step past the reach [m]. Of facets met at the same t (a common edge) the first counts."""
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
        of = np.repeat(active, [len(facets_near) for facets_near in near])
        tested = np.concatenate([np.sort(np.asarray(facets_near, dtype=np.int64)) for facets_near in near])
        away = centre[tested] - points[of]
        aside = np.linalg.norm(away - np.sum(away * normals[of], axis=1)[:, None] * normals[of], axis=1)
        worth = aside <= radius[tested] * (1 + ON)
        xi, at, leaves = _ray_hits(skin, points, normals, of[worth], tested[worth], way)
        of, tested = of[worth], tested[worth]
        # facets farther than this step are tested in their step, among all candidates there
        order = np.flatnonzero(leaves & (at > 0) & (at <= (number + 1) * step))
        order = order[np.lexsort((tested[order], np.round(at[order] / (1e-9 * step)), of[order]))]
        first = order[np.flatnonzero(np.diff(of[order], prepend=-1) != 0)]
        facet[of[first]], local[of[first]], t[of[first]] = tested[first], xi[first], at[first]
        active = active[facet[active] < 0]
    on_facet = facet >= 0
    x = np.full((k, 3), np.nan)
    x[on_facet], _ = skin.frames(facet[on_facet], local[on_facet])
    return Located(facet, local, x, t)


def _ray_hits(
    skin: Skin, points: np.ndarray, normals: np.ndarray, of: np.ndarray, facet: np.ndarray, way: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """ξ (q, 2) and t (q,) [m] at which rays `of` (q,) meet facets (q,), and whether they leave the body there (q,), or for way −1
    enter it."""
    n = normals[of]
    e1 = np.cross(n, farthest_axis(n))
    e1 /= np.linalg.norm(e1, axis=1)[:, None]
    plane = np.stack([e1, np.cross(n, e1)], axis=1)
    xi, is_hit = local_at(skin, facet, points[of], plane, np.zeros((len(of), 2)))
    x, outward = skin.frames(facet, xi)
    for kind, which, _ in by_kind(skin.facets.kind[facet], skin.facets.nodes[facet]):
        is_hit[which] &= on_reference(kind, xi[which], ON)
    is_hit &= way * np.sum(outward * n, axis=1) < -1e-9
    return xi, np.sum((points[of] - x) * n, axis=1), is_hit


HAND = 0.06
"""Free height [m] needed for bonding by hand with pad and clamp."""
SLANT = np.deg2rad(45.0)
"""Angle from the normal of the rays that detect walls next to a gauge."""
OFF = 1e-6
"""Depth below the surface at which the rays begin, as a share of the reach: so that they meet parts on the surface. It is also
the resolution of the clearance. They cannot enter the facet that they leave."""


def room(skin: Skin, candidates: Candidates, reach: float) -> np.ndarray:
    """Clearance above gauges (gauges,) [m], inf if it exceeds the reach [m]:

        min( h(n),  max(h(n + e₁), h(n − e₁)),  max(h(n + e₂), h(n − e₂)) )

    h(r): length of a ray along r from the centre of the gauge to the part, 0 below a part that lies on it. n is the outward
    normal, so that h(n) is the width of a bore or a gap. n ± e are inclined by 45° to both sides along and across the gauge: two
    walls, as of a groove, count if both are met; a single wall does not, because a hand reaches from the other side. Arms of
    bridges are separate gauges here (`Candidates.grids`)."""
    first = candidates.take(candidates.first)
    n, axes = first.normal, installation_axes(candidates)
    start = first.position - OFF * reach * n

    def height(ahead: np.ndarray) -> np.ndarray:
        """Distance of rays outside the body before they enter it; inf if not within the reach."""
        distance = _first(skin, start, -ahead, -1.0, reach).distance
        return np.asarray(np.where(distance <= reach, distance, np.inf))

    clearance = height(n)
    for e in axes:
        one, other = (height(np.cos(SLANT) * n + way * np.sin(SLANT) * e) for way in (1.0, -1.0))
        clearance = np.minimum(clearance, np.maximum(one, other))
    return np.asarray(np.where(clearance <= 2 * OFF * reach, 0.0, clearance))


ALONG = np.cos(np.deg2rad(5.0))
"""Cosine of the largest angle between the axis of a bore and the normal of a face that it meets at a right angle."""
RIM = 3
"""Least number of nodes shared by a bore and the face that it meets, and of supported nodes of a supported bore (a circle)."""
LEVEL = 1e-6
"""Largest relative difference of equal lengths; of heights, as a share of the size of the part."""


@dataclass(frozen=True)
class ContactFaces:
    """Faces (c,) that are probably in contact with another part, by their numbers in `Faces`, ascending; bores (c,): number of
    supported bores that end in each; places (c,): number of its supported facets; instead_of (c,): the face at the other end of
    its bores, if only one of the two is in contact and it is unknown which, for the later one of them; −1 otherwise."""

    face: np.ndarray
    bores: np.ndarray
    places: np.ndarray
    instead_of: np.ndarray

    def support_in_words(self, i: int) -> str:
        """Why face i is a contact face."""
        bores, places = int(self.bores[i]), int(self.places[i])
        reasons = [f"{bores} supported bore{'s' * (bores != 1)}"] * (bores > 0)
        reasons += [f"{places} supported facet{'s' * (places != 1)}"] * (places > 0)
        return " and ".join(reasons)


def contact_faces(mesh: Mesh, facets: Facets, faces: Faces) -> ContactFaces:
    """Flat faces of exterior facets that are probably in contact with another part:

    - faces with some facets, but not all, whose nodes are all supported: the support is in contact with the face. Shells and
      beams do not count, because their nodes do not show on which side the support is;
    - faces that a bore with supported nodes meets at a right angle, as for a bolt. Among the faces of such a bore it is the one
      above which the part rises least, max n·(x − c) over its nodes, n the outward normal: a part stands on the face without
      projections. For a plate both faces are found, although probably only one is in contact.

    A node is supported if it has a support or a spring, or is tied to a supported reference node. Bores are those of `Faces`.
    A face that is supported as a whole has no room for a gauge, and its nodes do not make a bore supported, because symmetry
    planes cut bores."""
    supported = _supported_nodes(mesh)
    has_node = facets.nodes >= 0
    facet_supported = np.all(supported[facets.nodes] | ~has_node, axis=1) & ~facets.of(mesh.thin)
    places = np.bincount(faces.of[facet_supported], minlength=len(faces.area))
    flat = faces.normal.any(axis=1)
    whole = flat & (places == np.bincount(faces.of, minlength=len(faces.area)))
    fixed = np.zeros(len(supported), dtype=bool)
    on_whole_face = has_node & whole[faces.of][:, None]
    fixed[facets.nodes[on_whole_face]] = True

    ends_of_faces = np.cumsum(np.bincount(faces.of, minlength=len(faces.area)))[:-1]
    by_face = np.split(facets.nodes[np.argsort(faces.of, kind="stable")], ends_of_faces)
    nodes = [np.unique(each[each >= 0]) for each in by_face]
    bores = np.zeros(len(faces.area), dtype=int)
    sides: list[tuple[int, int]] = []
    certain = whole | (places > 0)
    used = np.unique(facets.nodes[has_node])
    size = float(np.linalg.norm(np.ptp(mesh.position[used], axis=0)))
    for bore in np.flatnonzero(faces.hollow):
        if np.count_nonzero(supported[nodes[bore]] & ~fixed[nodes[bore]]) < RIM:
            continue
        across = flat & (np.abs(faces.normal @ faces.axis[bore]) > ALONG)
        ends = [f for f in np.flatnonzero(across) if len(np.intersect1d(nodes[f], nodes[bore])) >= RIM]
        above = np.array([np.max((mesh.position[used] - faces.centre[f]) @ faces.normal[f]) for f in ends])
        lowest = [int(f) for f, h in zip(ends, above, strict=True) if h <= above.min() + LEVEL * size]
        bores[lowest] += 1
        sides += [(lowest[0], f) for f in lowest[1:]]
        certain[lowest] |= len(lowest) == 1
    instead_of = np.full(len(faces.area), -1)
    for one, other in sides:
        if not certain[other]:
            instead_of[other] = one
        elif not certain[one]:
            instead_of[one] = other
    chosen = np.flatnonzero(flat & ~whole & ((bores > 0) | (places > 0)))
    return ContactFaces(chosen, bores[chosen], places[chosen], instead_of[chosen])


def _supported_nodes(mesh: Mesh) -> np.ndarray:
    supported = np.zeros(len(mesh.position), dtype=bool)
    supported[mesh.held] = True
    for spring in mesh.springs:
        supported[spring.node] = True
    for tie in mesh.ties:
        if supported[tie.reference]:
            supported[tie.nodes] = True
    for relation in mesh.relations:
        supported[relation.node[0]] |= bool(supported[relation.node[1:]].all())
    return mesh.above(supported)


def on_bores(mesh: Mesh, facets: Facets, faces: Faces, loaded: np.ndarray) -> np.ndarray:
    """Which facets (f,) lie on a bore that is narrower than `HAND`, or holds a pin or a bolt: all nodes of one of its facets, or
    one node inside its rims, are loaded (l,), supported, tied or on springs.

    Bores are those of `Faces` that go around their axis: their normals leave no gap of 180°, unlike those of a fillet or a
    groove."""
    holding = np.append(constrained_nodes(mesh), True)  # for −1, no node
    holding[loaded] = True
    full = np.all(holding[facets.nodes], axis=1)
    vector = facet_vectors(mesh.position, facets)
    bore = np.zeros(len(faces.area), dtype=bool)
    for face in np.flatnonzero(faces.hollow):
        on = faces.of == face
        axis = faces.axis[face]
        e1 = np.cross(axis, farthest_axis(axis[None])[0])
        angle = np.sort(np.arctan2(vector[on] @ np.cross(axis, e1), vector[on] @ e1))
        around = np.diff(angle, append=angle[0] + 2 * np.pi).max() < np.pi - ON
        inside = np.setdiff1d(facets.nodes[on], np.append(facets.nodes[~on], -1))
        bore[face] = around and (2 * faces.radius[face] < HAND * (1 - LEVEL) or full[on].any() or holding[inside].any())
    return bore[faces.of]
