"""Parts of the surface: boxes, cylinders, normals, surroundings of edges and sets; facets that may carry a gauge."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from strainsight.errors import InfeasibleError, UserError, blame, did_you_mean
from strainsight.mesh.facets import Facets, facet_key
from strainsight.mesh.model import Mesh
from strainsight.mesh.projection import covered
from strainsight.sensors.edges import constrained_nodes, near_segments, sharp_edges
from strainsight.sensors.surface import facet_centres, unit_vector

Vector = tuple[float, float, float]
TOUCHING = 1e-9
"""Of the size of the mesh: centres of facets that are no farther apart are in one place."""


@dataclass(frozen=True)
class Box:
    """Every centre within minimum ≤ x ≤ maximum, both (3,) [m]."""

    minimum: Vector
    maximum: Vector


@dataclass(frozen=True)
class Cylinder:
    """Every centre nearer than radius [m] to the line through point (3,) [m] along axis (3,), endless both ways."""

    point: Vector
    axis: Vector
    radius: float


@dataclass(frozen=True)
class NormalCone:
    """Every facet whose normal is within angle [deg] of axis (3,), or of its opposite."""

    axis: Vector
    angle: float


@dataclass(frozen=True)
class NearEdges:
    """Every centre nearer than distance [m] to a sharp edge (over 30°)."""

    distance: float


@dataclass(frozen=True)
class NearSet:
    """Every centre nearer than distance [m] to a node of a set, of nodes or of elements."""

    name: str
    distance: float


@dataclass(frozen=True)
class On:
    """Every facet of a face, a set of elements or a set of nodes (with all its nodes), and what lies on it."""

    name: str


@dataclass(frozen=True)
class ShellFace:
    """Every facet of shells with this local number, UPPER or LOWER."""

    facet: int


@dataclass(frozen=True)
class OnElements:
    """Every facet of elements of a kind: "solids", "shells" or "beams"."""

    kind: str


Zone = Box | Cylinder | NormalCone | NearEdges | NearSet | On | ShellFace | OnElements


def inside(zone: Zone, mesh: Mesh, facets: Facets | None, centre: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Which gauges a zone takes in: (m,) bool for their centre (m, 3) [m] and normal (m, 3), zero where they have none.

    Without facets there are no edges to be near to; a point is on the face whose facet's centre is nearest of all, of two that
    touch back to back the one that faces as it does. Raises UserError for a set that is not there, an axis of no length, and a
    face where there are no facets.
    """
    if isinstance(zone, On | ShellFace | OnElements):
        if facets is None:
            raise UserError(
                "the mesh has no solids, shells or beams, and so no surface that a zone could be on",
                remedy="give a near_set, or a box",
            )
        match zone:
            case On():
                on = on_surface(mesh, facets, zone.name)
            case ShellFace():
                on = facets.of(mesh.shells) & (facets.facet == zone.facet)
            case OnElements():
                on = facets.of(mesh.of_kind(zone.kind))
        return on[_facets_below(mesh, facets, centre, normal)]
    match zone:
        case Box():
            return np.all((centre >= np.asarray(zone.minimum)) & (centre <= np.asarray(zone.maximum)), axis=1)
        case Cylinder():
            arm = centre - np.asarray(zone.point)
            return np.linalg.norm(np.cross(arm, unit_vector(zone.axis, "the axis")), axis=1) < zone.radius
        case NormalCone():
            return np.abs(normal @ unit_vector(zone.axis, "the axis")) > np.cos(np.deg2rad(zone.angle))
        case NearEdges():
            edges = np.zeros((0, 2, 3)) if facets is None else sharp_edges(mesh.position, facets)
            return near_segments(centre, edges, zone.distance)
        case NearSet():
            distance, _ = cKDTree(mesh.position[_nodes(mesh, zone.name)]).query(centre)
            return np.asarray(distance < zone.distance)


def _facets_below(mesh: Mesh, facets: Facets, point: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The facet (m,) whose centre is nearest to a point (m, 3) [m]; of two whose centres are in one place, as of parts that touch
    and are meshed alike, the one that faces more along its normal (m, 3)."""
    centre, outward = facet_centres(mesh.position, facets.kind, facets.nodes)
    distance, near = map(np.asarray, cKDTree(centre).query(point, k=[1, 2][: len(centre)]))
    twice = distance[:, -1] - distance[:, 0] <= TOUCHING * np.ptp(mesh.position, axis=0).max()
    along = np.sum(outward[near] * normal[:, None], axis=2)
    return np.asarray(np.where(twice & (along[:, -1] > along[:, 0]), near[:, -1], near[:, 0]))


def on_surface(mesh: Mesh, facets: Facets, name: str) -> np.ndarray:
    """The facets (f,) bool of a face, of elements of a set, or those all nodes of which are in a set.

    Raises UserError for a name that is not there, and for one that is both a set of elements and one of nodes.
    """
    if name in mesh.faces:
        return np.isin(facets.key, facet_key(*mesh.faces[name].T))
    elements, nodes = name in mesh.element_sets, name in mesh.node_sets
    if elements and nodes:
        raise UserError(f"{name!r} is both an element set and a node set", remedy="rename one of them in the mesh file")
    if elements:
        return np.isin(facets.element_id, mesh.element_sets[name])
    if nodes:
        chosen = np.isin(mesh.node_ids, mesh.node_sets[name])
        return np.all(chosen[facets.nodes] | (facets.nodes < 0), axis=1)
    known = sorted({*mesh.element_sets, *mesh.node_sets})
    remedy = did_you_mean(name, known, f"its faces and sets: {', '.join(known) or 'none'}; mesh.faces names a face")
    raise UserError(f"the set {name!r} is not in the mesh", remedy=remedy)


def _nodes(mesh: Mesh, name: str) -> np.ndarray:
    """Indices of the nodes of a set of nodes, or of the elements of a set."""
    found = np.zeros(len(mesh.position), dtype=bool)
    if name in mesh.node_sets:
        found |= np.isin(mesh.node_ids, mesh.node_sets[name])
    if name in mesh.element_sets:
        for block in mesh.elements:
            found[block.nodes[np.isin(block.ids, mesh.element_sets[name])]] = True
        found = mesh.above(found)
    if not found.any():
        known = sorted({*mesh.node_sets, *mesh.element_sets})
        remedy = did_you_mean(name, known, f"sets: {', '.join(known) or 'none'}")
        raise UserError(f"the set {name!r} is not in the mesh, or is empty", remedy=remedy)
    return np.flatnonzero(found)


def admissible(
    mesh: Mesh,
    facets: Facets,
    *,
    surface: str = "all",
    include: Sequence[Zone] = (),
    exclude: Sequence[Zone] = (),
    on_constraints: bool = False,
    key: str = "gauges",
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Indices (k,) of the facets that may carry gauges; centre (f, 3) [m] and outward normal (f, 3) of all facets.

    surface "all" or the name of a face, an element or node set (a facet belongs to a node set with all its nodes); facets on
    which another element lies that does not have their nodes are left out, and unless on_constraints those that touch an SPC,
    RBE2 or RBE3 node; include: in at least one of these zones, none: everywhere; exclude: in none of these. key: the section of
    the config that asks, to name what leaves no facet.
    Raises UserError for a set that is not there, InfeasibleError where no facet is left.
    """
    centre, normal = facet_centres(mesh.position, facets.kind, facets.nodes)
    left = np.ones(len(facets.element_id), dtype=bool)
    trail = [f"{len(left)} exterior"]

    def steps() -> Iterator[tuple[str, str, np.ndarray]]:
        with blame(f"{key}.surface"):
            every = np.ones(len(left), dtype=bool)
            chosen = every if surface == "all" else on_surface(mesh, facets, surface)
        yield f"{key}.surface", f"on the surface {surface!r}", chosen
        yield f"{key}.surface", "with an area", np.any(normal != 0, axis=1)
        if (lies := covered(mesh, facets)).any():
            yield "mesh.file", "that nothing lies on", ~lies
        if not on_constraints:
            tied = constrained_nodes(mesh, references=True)[facets.nodes] & (facets.nodes >= 0)
            yield f"{key}.surface", "away from constrained nodes", ~np.any(tied, axis=1)
        if include:
            with blame(f"{key}.include"):
                zones = [inside(zone, mesh, facets, centre, normal) for zone in include]
            yield f"{key}.include", "in zones to include", np.any(zones, axis=0)
        for i, zone in enumerate(exclude):
            with blame(f"{key}.exclude.{i}"):
                taken = inside(zone, mesh, facets, centre, normal)
            yield f"{key}.exclude.{i}", f"outside exclude.{i}", ~taken

    for where, what, mask in steps():
        before, left = left, left & mask
        trail.append(f"{np.count_nonzero(left)} {what}")
        if not left.any():
            raise InfeasibleError(
                f"no facet is left for a gauge, {where} takes the last {np.count_nonzero(before)}: {', '.join(trail)}",
                key=where,
                remedy="choose another surface, larger zones to include or smaller zones to exclude",
            )
    return np.flatnonzero(left), centre, normal
