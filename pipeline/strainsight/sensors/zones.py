"""Zones of a surface: boxes, cylinders, normals, distances from edges and sets; admissible facets for gauges."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from strainsight.errors import InfeasibleError, UserError, blame, did_you_mean
from strainsight.mesh.facets import Facets, facet_key
from strainsight.mesh.model import Mesh
from strainsight.mesh.projection import covered
from strainsight.mesh.thin_faces import NO_SIDES, WITH_SIDES, lines_without_sides
from strainsight.sensors.edges import constrained_nodes, near_segments, sharp_edges
from strainsight.sensors.surface import facet_centres, unit_vector

Vector = tuple[float, float, float]
TOUCHING = 1e-9
"""Distance of coincident facet centres, as a share of the size of the mesh."""


@dataclass(frozen=True)
class Box:
    """Every centre within minimum ≤ x ≤ maximum, both (3,) [m]."""

    minimum: Vector
    maximum: Vector


@dataclass(frozen=True)
class Cylinder:
    """Every centre nearer than radius [m] to the infinite line through point (3,) [m] along axis (3,)."""

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
    """Every facet of a face, an element set or a node set (with all its nodes), and gauges on it."""

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
    """Which gauges are in a zone: (m,) bool for their centre (m, 3) [m] and normal (m, 3), zero if unknown.

    Without facets there are no edges; a point belongs to the facet with the nearest centre, of two back to back the one with the
    same orientation. Raises UserError for a set that does not exist, an axis of zero length, and a face without facets."""
    if isinstance(zone, On | ShellFace | OnElements):
        if facets is None:
            raise UserError(
                "the mesh has no solids, shells or beams, so a zone on a surface is not possible",
                remedy="Use a `near_set` or `box` zone instead.",
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
    """The facet (m,) whose centre is nearest to a point (m, 3) [m]; of two coincident centres, as of matching meshes in contact,
    the one whose orientation agrees with its normal (m, 3)."""
    centre, outward = facet_centres(mesh.position, facets.kind, facets.nodes)
    distance, near = map(np.asarray, cKDTree(centre).query(point, k=[1, 2][: len(centre)]))
    twice = distance[:, -1] - distance[:, 0] <= TOUCHING * np.ptp(mesh.position, axis=0).max()
    along = np.sum(outward[near] * normal[:, None], axis=2)
    return np.asarray(np.where(twice & (along[:, -1] > along[:, 0]), near[:, -1], near[:, 0]))


def on_surface(mesh: Mesh, facets: Facets, name: str) -> np.ndarray:
    """The facets (f,) bool of a face, of an element set, or with all nodes in a node set.

    Raises UserError for a name that does not exist, and for a name of both an element set and a node set."""
    if name in mesh.faces:
        return np.isin(facets.key, facet_key(*mesh.faces[name].T))
    elements, nodes = name in mesh.element_sets, name in mesh.node_sets
    if elements and nodes:
        raise UserError(
            f"{name!r} is both an element set and a node set", remedy="Rename one of the two sets in the mesh file."
        )
    if elements:
        return np.isin(facets.element_id, mesh.element_sets[name])
    if nodes:
        chosen = np.isin(mesh.node_ids, mesh.node_sets[name])
        return np.all(chosen[facets.nodes] | (facets.nodes < 0), axis=1)
    known = sorted({*mesh.element_sets, *mesh.node_sets})
    remedy = did_you_mean(
        name,
        known,
        f"Use one of the element or node sets {', '.join(known)}, or define a face in mesh.faces."
        if known
        else "Define a face in mesh.faces.",
    )
    raise UserError(f"the mesh has no face, element set or node set {name!r}", remedy=remedy)


def _nodes(mesh: Mesh, name: str) -> np.ndarray:
    """Indices of the nodes of a node set, or of the elements of an element set."""
    in_set = np.zeros(len(mesh.position), dtype=bool)
    if name in mesh.node_sets:
        in_set |= np.isin(mesh.node_ids, mesh.node_sets[name])
    if name in mesh.element_sets:
        for block in mesh.elements:
            in_set[block.nodes[np.isin(block.ids, mesh.element_sets[name])]] = True
        in_set = mesh.above(in_set)
    if not in_set.any():
        known = sorted({*mesh.node_sets, *mesh.element_sets})
        remedy = did_you_mean(
            name,
            known,
            f"Use one of the node or element sets {', '.join(known)}." if known else "Define the set in the mesh file.",
        )
        raise UserError(f"the mesh has no node or element set {name!r}, or this set is empty", remedy=remedy)
    return np.flatnonzero(in_set)


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

    surface "all" or the name of a face, an element or node set (a facet needs all its nodes in the node set). Facets under
    another element with separate nodes are left out, and unless on_constraints those with an SPC, RBE2 or RBE3 node. include: in
    at least one of these zones, empty: everywhere; exclude: in none of these. key: section of the config, for errors.
    Raises UserError for a set that does not exist, InfeasibleError if no facet remains."""
    centre, normal = facet_centres(mesh.position, facets.kind, facets.nodes)
    remaining = np.ones(len(facets.element_id), dtype=bool)
    trail = [f"{len(remaining)} exterior facets"]

    def steps() -> Iterator[tuple[str, str, np.ndarray]]:
        with blame(f"{key}.surface"):
            every = np.ones(len(remaining), dtype=bool)
            chosen = every if surface == "all" else on_surface(mesh, facets, surface)
        yield f"{key}.surface", f"facets on the surface {surface!r}", chosen
        yield f"{key}.surface", "facets with a nonzero area", np.any(normal != 0, axis=1)
        if (lies := covered(mesh, facets)).any():
            yield "mesh.file", "facets not covered by another part", ~lies
        if not on_constraints:
            tied = constrained_nodes(mesh, references=True)[facets.nodes] & (facets.nodes >= 0)
            yield f"{key}.surface", "facets without constrained nodes", ~np.any(tied, axis=1)
        if include:
            with blame(f"{key}.include"):
                zones = [inside(zone, mesh, facets, centre, normal) for zone in include]
            yield f"{key}.include", f"facets in the zones of {key}.include", np.any(zones, axis=0)
        for i, zone in enumerate(exclude):
            with blame(f"{key}.exclude.{i}"):
                in_zone = inside(zone, mesh, facets, centre, normal)
            yield f"{key}.exclude.{i}", f"facets outside {key}.exclude.{i}", ~in_zone

    for where, what, mask in steps():
        before, remaining = remaining, remaining & mask
        trail.append(f"{np.count_nonzero(remaining)} {what}")
        if not remaining.any():
            lines = lines_without_sides(mesh, mesh.element_sets.get(surface))
            raise InfeasibleError(
                f"no admissible facet remains for a gauge: {where} removes the last {np.count_nonzero(before)} facets. "
                f"Facets remaining after each step: {', '.join(trail)}"
                f"{f'. No facets on {lines}, because {NO_SIDES}' * bool(lines)}",
                key=where,
                remedy="Choose another surface, larger included zones or smaller excluded zones, or use smaller elements at "
                f"supports and ties.{f' {WITH_SIDES}.' * bool(lines)}",
            )
    return np.flatnonzero(remaining), centre, normal
