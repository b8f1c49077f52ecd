"""Mesh sensitivity of the strain at a gauge: submodels with a refined mesh and with spread forces."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from strainsight.errors import DeckError, NumericalError
from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.equations import translation_rows
from strainsight.fem.factorisation import factorise
from strainsight.fem.nodal_forces import Tractions, spread_forces, tractions
from strainsight.fem.patch import Incidence, Patch, forced_nodes, held_components, patch_around
from strainsight.mesh.facets import Facets, by_kind, exterior_facets
from strainsight.mesh.kinds import FACETS, facet_of
from strainsight.mesh.kinds.kind import Kind, with_midsides
from strainsight.mesh.model import Mesh
from strainsight.mesh.subdivision import Refined, refined
from strainsight.sensors.candidates import STRAIN, Candidates
from strainsight.sensors.strain_operator import ChannelPoints, matrix_of, points_within, surface_of
from strainsight.sensors.surface import on_reference


@dataclass(frozen=True)
class Submodel:
    """A patch in equilibrium: its mesh; field z (3k, r); held (k, 3): prescribed motions; force (3k, r) at nodes, zero where
    prescribed; applied: tractions, which cause some of the forces."""

    mesh: Mesh
    field: np.ndarray
    prescribed: np.ndarray
    force: np.ndarray
    applied: Tractions

    def part(self, patch: Patch) -> Submodel:
        """Some of its elements as a submodel, with the motion of their cut boundary prescribed."""
        prescribed = self.prescribed[patch.nodes] | patch.cut[:, None]
        rows = translation_rows(patch.nodes)
        force = np.where(prescribed.reshape(-1, 1), 0.0, self.force[rows])
        return Submodel(patch.mesh, self.field[rows], prescribed, force, self.applied.within(patch))

    @property
    def concentrated(self) -> np.ndarray:
        """The part of the forces (3k, r) at nodes that tractions do not cause, zero where prescribed."""
        return np.where(self.prescribed.reshape(-1, 1), 0.0, self.force - self.applied.forces(self.mesh.position))


def submodel(
    patch: Patch, field: np.ndarray, supported: np.ndarray, forced: np.ndarray, applied: Tractions
) -> Submodel:
    """The patch with prescribed motion where it is cut or supported, under the forces that the field requires at forced nodes:

        K_ii z_i = f − K_ib z_b,     f = (K z)_i at forced nodes, zero elsewhere

    Inertia within the patch is neglected, which is irrelevant on the scale of a few elements.
    field z (3k, r) of the whole model at the nodes of the patch; supported (k, 3) and forced (k,) of its nodes; applied:
    `tractions` of the whole mesh. Raises NumericalError if a part of it is unsupported."""
    prescribed = supported | patch.cut[:, None]
    K = assemble_stiffness(patch.mesh)
    acting = forced[:, None] & ~prescribed
    force = np.where(acting.reshape(-1, 1), K @ field, 0.0) if acting.any() else np.zeros_like(field)
    return Submodel(patch.mesh, _solve(K, prescribed, field, force), prescribed, force, applied.within(patch))


def with_spread_forces(patch_model: Submodel, facets: Facets) -> Submodel:
    """The submodel with the concentrated force of each node as a traction of equal resultant and moment over the facets around
    it.

    facets: exterior ones of the whole mesh within it, with its node numbers."""
    f = patch_model.concentrated
    forced = np.asarray(np.any(f.reshape(-1, 3 * f.shape[1]) != 0, axis=1))
    force = spread_forces(patch_model.mesh.position, facets, forced) @ f + patch_model.applied.forces(
        patch_model.mesh.position
    )
    K = assemble_stiffness(patch_model.mesh)
    return replace(patch_model, field=_solve(K, patch_model.prescribed, patch_model.field, force), force=force)


def refined_submodel(coarse: Submodel) -> tuple[Submodel, Refined]:
    """The submodel on a subdivided mesh: prescribed motions follow the shape functions, x_b = P z, tractions act on the parts of
    their facets, other forces stay at their nodes. A new node is prescribed if all nodes that it is a mean of are."""
    fine = refined(coarse.mesh)
    P = sparse.csr_array(sparse.kron(fine.interpolation, sparse.eye_array(3), format="csr"))
    free = (~coarse.prescribed).ravel().astype(float)
    prescribed = (np.asarray(abs(P) @ free) == 0).reshape(-1, 3)
    force = np.zeros((P.shape[0], coarse.field.shape[1]))
    force[translation_rows(_fine_of_coarse(fine))] = coarse.concentrated
    applied = coarse.applied.cut(fine)
    force = np.where(prescribed.reshape(-1, 1), 0.0, force + applied.forces(fine.mesh.position))
    K = assemble_stiffness(fine.mesh)
    return Submodel(fine.mesh, _solve(K, prescribed, P @ coarse.field, force), prescribed, force, applied), fine


def _fine_of_coarse(fine: Refined) -> np.ndarray:
    """The fine node (k,) at every coarse one."""
    P = fine.interpolation
    alone = np.flatnonzero(np.diff(P.indptr) == 1)
    at = np.full(P.shape[1], -1)
    at[P.indices[P.indptr[alone]]] = alone
    return at


def _solve(K: sparse.csr_array, supported: np.ndarray, z: np.ndarray, force: np.ndarray) -> np.ndarray:
    """z (3k, r) where prescribed (k, 3), in equilibrium with the force (3k, r) elsewhere."""
    prescribed = supported.ravel()
    solution, free = z.copy(), np.flatnonzero(~prescribed)
    if len(free):
        rows = sparse.csr_array(K[free])
        pushed = force[free] - rows[:, np.flatnonzero(prescribed)] @ z[prescribed]
        solution[free] = factorise(sparse.csr_array(rows[:, free])).solve(pushed)
    return solution


DEPTH = 2
"""Number of subdivisions of the elements around a gauge. A single one is not enough. In the first element at a corner the strain
then hardly changes, because the mean of the parts at the gauge hides how much they differ."""
LAYERS = 2
"""Layers of refined elements around a gauge; changes by a finer mesh decay beyond."""
ON = 1e-9
"""[-] How far outside a part of a facet a point still counts as on it."""


@dataclass(frozen=True)
class HotSpots:
    """Change of the reading of every gauge, over its RMS in a motion [-], positive if it grows: refined (gauges, DEPTH), with the
    elements around it subdivided once, twice; spread (gauges,), with forces at nodes nearby spread over the facets around. NaN
    if it could not be tested."""

    refined: np.ndarray
    spread: np.ndarray

    @property
    def change(self) -> np.ndarray:
        """The largest change by refinement (gauges,), with its sign."""
        most = np.argmax(np.abs(self.refined), axis=1)
        return np.asarray(np.take_along_axis(self.refined, most[:, None], axis=1)[:, 0])


def hot_spots(
    mesh: Mesh, gauges: Candidates, field: np.ndarray, moment: np.ndarray, loaded: np.ndarray, pressed: np.ndarray
) -> HotSpots:
    """Change of the reading of every strain gauge on its submodel, if refined, and if forces are spread:

        change = ± rms(ε′ − ε)/rms ε,     of the channel that changes most over the largest RMS of its gauge

    with the sign of Δ C εᵀ. The cut boundary moves as in the model. The second refinement is a submodel of the first, with the
    parts around the gauge only. Motion sensors do not change. Changes of the boundary motion by a finer mesh are not covered:
    the test detects local effects of corners, ends of supports, loads at nodes, holes and fillets in large elements. Loads on
    faces stay tractions on their parts.

    mesh with the moduli of the field; gauges: m channels; field (3n, r) displacements per coordinate; moment C (r, r) of the
    coordinates, mean q qᵀ; loaded: nodes (indices) with loads; pressed: those of them with a traction."""
    facets = exterior_facets(mesh)
    skin, incidence = surface_of(mesh.position, gauges, facets), Incidence.of(mesh)
    supported, forced = held_components(mesh), forced_nodes(mesh)
    under_traction, otherwise = np.zeros(len(mesh.position), dtype=bool), forced | supported.any(axis=1)
    under_traction[pressed] = True
    forced[loaded] = True
    motion = field @ _root(moment)
    refined, spread = np.zeros((gauges.gauges, DEPTH)), np.zeros(gauges.gauges)
    for g in range(gauges.gauges):
        gauge_channels = gauges.take(np.flatnonzero(gauges.gauge == g))
        if gauge_channels.quantity[0] != STRAIN:
            continue
        points = points_within(mesh.position, gauge_channels, skin)
        try:
            readings, with_spread = _readings(
                mesh,
                facets,
                incidence,
                supported,
                forced,
                (under_traction, otherwise),
                points,
                len(gauge_channels),
                motion,
            )
        except (NumericalError, DeckError):  # unsupported body, or degenerate parts of an element
            refined[g] = spread[g] = np.nan
            continue
        reading = matrix_of(mesh.position, points, len(gauge_channels)) @ motion
        refined[g] = [_relative(finer - readings[0], reading) for finer in readings[1:]]
        spread[g] = 0.0 if with_spread is None else _relative(with_spread - readings[0], reading)
    return HotSpots(refined, spread)


def _readings(
    mesh: Mesh,
    facets: Facets,
    incidence: Incidence,
    supported: np.ndarray,
    forced: np.ndarray,
    pressed: tuple[np.ndarray, np.ndarray],
    points: ChannelPoints,
    channels: int,
    z: np.ndarray,
) -> tuple[list[np.ndarray], np.ndarray | None]:
    """Readings of the channels of one gauge in a field (c, r): on the submodel, refined once, twice; and with spread forces, None
    without forces. pressed: nodes (n,) under a traction, and those with other forces."""
    nodes = np.unique(points.nodes[points.nodes >= 0])
    patch, around = (patch_around(mesh, incidence, nodes, count) for count in (LAYERS, LAYERS + 1))
    field, more = (
        z.reshape(len(mesh.position), 3, -1)[part.nodes].reshape(3 * len(part.nodes), -1) for part in (patch, around)
    )
    applied = tractions(around, more, facets, *pressed)
    current = submodel(patch, field, supported[patch.nodes], forced[patch.nodes], applied)
    at = replace(points, nodes=patch.local(points.nodes))
    rows = matrix_of(patch.mesh.position, at, channels)
    readings, spread = [rows @ current.field], None
    if current.force.any():
        outside = facets.some(facets.of(patch.mesh.blocks))
        local = patch.local(outside.nodes)
        spread = rows @ with_spread_forces(current, replace(outside, nodes=local, corners=local[:, :4])).field
    for level in range(DEPTH):
        if level:
            part = patch_around(current.mesh, Incidence.of(current.mesh), np.unique(at.nodes[at.nodes >= 0]), LAYERS)
            current, at = current.part(part), replace(at, nodes=part.local(at.nodes))
        current, fine = refined_submodel(current)
        at = _on_parts(fine, at)
        readings.append(matrix_of(current.mesh.position, at, channels) @ current.field)
    return readings, spread


def _relative(change: np.ndarray, reading: np.ndarray) -> float:
    """RMS of the change over the largest RMS of the channels, for the channel that changes most, with its sign; columns of (c,
    r) are independent and of unit mean square."""
    size = np.linalg.norm(reading, axis=1).max(initial=0.0)
    most = int(np.argmax(np.linalg.norm(change, axis=1)))
    if size == 0:
        return 0.0
    return float(np.copysign(np.linalg.norm(change[most]), change[most] @ reading[most]) / size)


def _root(moment: np.ndarray) -> np.ndarray:
    """R with R Rᵀ = C, without negligible columns."""
    value, vector = np.linalg.eigh(moment)
    significant = value > 1e-14 * value.max(initial=0.0)
    return np.asarray(vector[:, significant] * np.sqrt(value[significant]))


def _on_parts(fine: Refined, points: ChannelPoints) -> ChannelPoints:
    """The same points on the parts of their facets; where several parts meet, in equal shares on each."""
    pieces: list[ChannelPoints] = []
    for kind, which, nodes in by_kind(points.kind, points.nodes):
        share, parts = np.zeros(len(which)), []
        for name, corners in kind.split:
            part = facet_of(name)
            local = _within(part, corners, points.local[which])
            on = np.flatnonzero(on_reference(part, local, ON))
            share[on] += 1
            at = np.full((len(on), 8), -1)
            at[:, : len(part.nodes)] = fine.nodes_at(kind, nodes[on], with_midsides(corners, part.edges))
            code = np.full(len(on), FACETS.index(part))
            parts.append((on, replace(points.take(which[on]), kind=code, nodes=at, local=local[on])))
        pieces += [replace(piece, weight=piece.weight / share[on]) for on, piece in parts]
    return ChannelPoints.joined(pieces)


def _within(part: Kind, corners: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """Local coordinates (m, 2) on a part of points ξ (m, 2) of the whole facet: parts are affine images of their domain."""
    home = part.nodes[: len(corners)]
    A = np.linalg.lstsq(np.column_stack([home, np.ones(len(home))]), corners, rcond=None)[0]
    return np.asarray(np.linalg.solve(A[:2].T, (xi - A[2]).T).T)
