"""Faces of a part that probably lie on another: bolted ones, and those that are held in places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.mesh.facets import Facets
from strainsight.mesh.model import Mesh
from strainsight.sensors.faces import Faces

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
        said = [f"by {bores} bore{'s' * (bores != 1)}"] * (bores > 0)
        said += [f"on {places} of its facets"] * (places > 0)
        return f"held {' and '.join(said)}"


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
    ties = [(own.reference, own.nodes) for own in mesh.rigid] + [(own.reference, own.nodes) for own in mesh.averaging]
    for reference, nodes in ties:
        if held[reference]:
            held[nodes] = True
    for relation in mesh.relations:
        held[relation.node[0]] |= bool(held[relation.node[1:]].all())
    return mesh.above(held)


def _split(rows: np.ndarray, of: np.ndarray, count: int) -> list[np.ndarray]:
    """Rows (f, ...) of each of the groups."""
    return np.split(rows[np.argsort(of, kind="stable")], np.cumsum(np.bincount(of, minlength=count))[:-1])
