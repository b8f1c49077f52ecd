"""Whether the strain at a gauge is that of the part or that of its mesh."""

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
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.kinds.kind import Kind, with_midsides
from strainsight.mesh.model import Mesh
from strainsight.mesh.subdivision import Refined, refined
from strainsight.sensors.candidates import STRAIN, Candidates
from strainsight.sensors.rows import ChannelPoints, matrix_of, points_within, surface_of
from strainsight.sensors.surface import by_kind, on_reference


@dataclass(frozen=True)
class Submodel:
    """A patch in equilibrium: its mesh; field z (3k, r); held (k, 3): what is given; force (3k, r) at nodes, zero where held;
    applied: tractions, which make some of it."""

    mesh: Mesh
    field: np.ndarray
    held: np.ndarray
    force: np.ndarray
    applied: Tractions

    def part(self, patch: Patch) -> Submodel:
        """Some of its elements by themselves, moved at their cut boundary as it is."""
        held = self.held[patch.nodes] | patch.cut[:, None]
        rows = translation_rows(patch.nodes)
        force = np.where(held.reshape(-1, 1), 0.0, self.force[rows])
        return Submodel(patch.mesh, self.field[rows], held, force, self.applied.within(patch))

    @property
    def concentrated(self) -> np.ndarray:
        """What no traction makes of the forces (3k, r) at nodes, zero where held."""
        return np.where(self.held.reshape(-1, 1), 0.0, self.force - self.applied.forces(self.mesh.position))


def submodel(patch: Patch, field: np.ndarray, held: np.ndarray, forced: np.ndarray, applied: Tractions) -> Submodel:
    """The patch for the motion of what is cut or held, under the forces that the field needs at forced nodes:

        K_ii z_i = f − K_ib z_b,     f = (K z)_i at forced nodes, zero elsewhere

    so that inertia within the patch is left out, which on the scale of a few elements bends nothing.
    field z (3k, r) of the whole model at the nodes of the patch; held (k, 3) and forced (k,) of its nodes; applied: `tractions`
    of the whole mesh. Raises NumericalError where a part of it hangs on nothing.
    """
    prescribed = held | patch.cut[:, None]
    K = assemble_stiffness(patch.mesh)
    acting = forced[:, None] & ~prescribed
    force = np.where(acting.reshape(-1, 1), K @ field, 0.0) if acting.any() else np.zeros_like(field)
    return Submodel(patch.mesh, _solved(K, prescribed, field, force), prescribed, force, applied.within(patch))


def with_spread_forces(own: Submodel, facets: Facets) -> Submodel:
    """The same with the concentrated force of each node as a traction of its resultant and moment over the facets around.

    facets: exterior ones of the whole mesh that lie in it, with its node numbers.
    """
    f = own.concentrated
    forced = np.asarray(np.any(f.reshape(-1, 3 * f.shape[1]) != 0, axis=1))
    force = spread_forces(own.mesh.position, facets, forced) @ f + own.applied.forces(own.mesh.position)
    K = assemble_stiffness(own.mesh)
    return replace(own, field=_solved(K, own.held, own.field, force), force=force)


def refined_submodel(own: Submodel) -> tuple[Submodel, Refined]:
    """The same on a mesh of parts of its elements: what is held moves as its shape functions say, x_b = P z, tractions act on
    the parts of their facets, other forces stay at their nodes. A new node is held where all nodes that it is a mean of are."""
    fine = refined(own.mesh)
    P = sparse.csr_array(sparse.kron(fine.interpolation, sparse.eye_array(3), format="csr"))
    free = (~own.held).ravel().astype(float)
    prescribed = (np.asarray(abs(P) @ free) == 0).reshape(-1, 3)
    force = np.zeros((P.shape[0], own.field.shape[1]))
    force[translation_rows(_fine_of_coarse(fine))] = own.concentrated
    applied = own.applied.cut(fine)
    force = np.where(prescribed.reshape(-1, 1), 0.0, force + applied.forces(fine.mesh.position))
    K = assemble_stiffness(fine.mesh)
    return Submodel(fine.mesh, _solved(K, prescribed, P @ own.field, force), prescribed, force, applied), fine


def _fine_of_coarse(fine: Refined) -> np.ndarray:
    """The fine node (k,) at every coarse one."""
    P = fine.interpolation
    alone = np.flatnonzero(np.diff(P.indptr) == 1)
    at = np.full(P.shape[1], -1)
    at[P.indices[P.indptr[alone]]] = alone
    return at


def _solved(K: sparse.csr_array, held: np.ndarray, z: np.ndarray, force: np.ndarray) -> np.ndarray:
    """z (3k, r) where it is held (k, 3), in equilibrium with the force (3k, r) elsewhere."""
    prescribed = held.ravel()
    found, free = z.copy(), np.flatnonzero(~prescribed)
    if len(free):
        rows = sparse.csr_array(K[free])
        pushed = force[free] - rows[:, np.flatnonzero(prescribed)] @ z[prescribed]
        found[free] = factorise(sparse.csr_array(rows[:, free])).solve(pushed)
    return found


DEPTH = 2
"""How often the elements around a gauge are cut at the middle of their edges. Once is not enough: in the first element of a
corner the strain then hardly changes, because the mean of the parts that meet at the gauge hides how far they are apart."""
LAYERS = 2
"""Of elements around a gauge that are refined; beyond, what a finer mesh would change decays."""
ON = 1e-9
"""[-] How far outside a part of a facet a point still counts as on it."""


@dataclass(frozen=True)
class HotSpots:
    """How the reading of every gauge changes, over its RMS in a motion [-], positive where it grows: refined (gauges, DEPTH),
    when the elements around it are cut once, twice; spread (gauges,), when forces at nodes there are spread over the facets
    around. NaN where it could not be tested."""

    refined: np.ndarray
    spread: np.ndarray

    @property
    def change(self) -> np.ndarray:
        """The largest change by refinement (gauges,), with its sign."""
        most = np.argmax(np.abs(self.refined), axis=1)
        return np.asarray(np.take_along_axis(self.refined, most[:, None], axis=1)[:, 0])


def hot_spots(
    mesh: Mesh,
    gauges: Candidates,
    field: np.ndarray,
    moment: np.ndarray,
    loaded: np.ndarray,
    pressed: np.ndarray,
) -> HotSpots:
    """The submodel of every strain gauge as it is, refined, and with its forces spread, each moved at its cut as the model is:

        change = ± rms(ε′ − ε)/rms ε,     of the channel that changes most over the largest RMS of its gauge

    with the sign of Δ C εᵀ. The second refinement is of the parts around the gauge alone, a submodel of the first. Sensors of
    motion do not change. What a finer mesh changes in the motion of the boundary is not seen: the test is of what is local,
    such as corners, ends of supports, loads at nodes, holes and fillets in large elements. Loads on faces are tractions, and stay
    that on their parts.

    mesh with the moduli at which the field is a solution; gauges: m channels; field (3n, r) displacements per coordinate; moment
    C (r, r) of the coordinates, mean q qᵀ; loaded: nodes (indices) on which loads act; pressed: those of
    them on which a traction does.
    """
    facets = exterior_facets(mesh)
    skin, incidence = surface_of(mesh.position, gauges, facets), Incidence.of(mesh)
    held, forced = held_components(mesh), forced_nodes(mesh)
    under, otherwise = np.zeros(len(mesh.position), dtype=bool), forced | held.any(axis=1)
    under[pressed] = True
    forced[loaded] = True
    motion = field @ _root(moment)
    refined, spread = np.zeros((gauges.gauges, DEPTH)), np.zeros(gauges.gauges)
    for g in range(gauges.gauges):
        own = gauges.take(np.flatnonzero(gauges.gauge == g))
        if own.quantity[0] != STRAIN:
            continue
        points = points_within(mesh.position, own, skin)
        try:
            readings, apart = _readings(
                mesh, facets, incidence, held, forced, (under, otherwise), points, len(own), motion
            )
        except (NumericalError, DeckError):  # all of a body that nothing holds; parts of an element at its limits
            refined[g] = spread[g] = np.nan
            continue
        reading = matrix_of(mesh.position, points, len(own)) @ motion
        refined[g] = [_relative(finer - readings[0], reading) for finer in readings[1:]]
        spread[g] = 0.0 if apart is None else _relative(apart - readings[0], reading)
    return HotSpots(refined, spread)


def _readings(
    mesh: Mesh,
    facets: Facets,
    incidence: Incidence,
    held: np.ndarray,
    forced: np.ndarray,
    pressed: tuple[np.ndarray, np.ndarray],
    points: ChannelPoints,
    channels: int,
    z: np.ndarray,
) -> tuple[list[np.ndarray], np.ndarray | None]:
    """What the channels of one gauge read of a field (c, r): on the submodel, refined once, twice; with forces spread, None where
    there are none. pressed: nodes (n,) under a traction, and those on which other forces act."""
    nodes = np.unique(points.nodes[points.nodes >= 0])
    patch, around = (patch_around(mesh, incidence, nodes, count) for count in (LAYERS, LAYERS + 1))
    field, more = (
        z.reshape(len(mesh.position), 3, -1)[part.nodes].reshape(3 * len(part.nodes), -1) for part in (patch, around)
    )
    applied = tractions(around, more, facets, *pressed)
    own = submodel(patch, field, held[patch.nodes], forced[patch.nodes], applied)
    at = replace(points, nodes=patch.local(points.nodes))
    rows = matrix_of(patch.mesh.position, at, channels)
    found, spread = [rows @ own.field], None
    if own.force.any():
        spread = rows @ with_spread_forces(own, _facets_of(patch, facets)).field
    for level in range(DEPTH):
        if level:
            part = patch_around(own.mesh, Incidence.of(own.mesh), np.unique(at.nodes[at.nodes >= 0]), LAYERS)
            own, at = own.part(part), replace(at, nodes=part.local(at.nodes))
        own, fine = refined_submodel(own)
        at = _on_parts(fine, at)
        found.append(matrix_of(own.mesh.position, at, channels) @ own.field)
    return found, spread


def _relative(change: np.ndarray, reading: np.ndarray) -> float:
    """RMS of the change over the largest RMS of the channels, of the channel that changes most, with its sign; columns of (c, r)
    are independent and of unit mean square."""
    size = np.linalg.norm(reading, axis=1).max(initial=0.0)
    most = int(np.argmax(np.linalg.norm(change, axis=1)))
    if size == 0:
        return 0.0
    return float(np.copysign(np.linalg.norm(change[most]), change[most] @ reading[most]) / size)


def _root(moment: np.ndarray) -> np.ndarray:
    """R with R Rᵀ = C, without columns that say nothing."""
    value, vector = np.linalg.eigh(moment)
    kept = value > 1e-14 * value.max(initial=0.0)
    return np.asarray(vector[:, kept] * np.sqrt(value[kept]))


def _facets_of(patch: Patch, facets: Facets) -> Facets:
    """The exterior facets of the whole mesh that belong to elements of the patch, with its node numbers."""
    ids = np.concatenate([block.ids for block in patch.mesh.blocks])
    own = np.isin(facets.element_id, ids)
    found = facets.some(own)
    return Facets(found.element_id, found.facet, found.kind, patch.local(found.nodes), found.region)


def _on_parts(fine: Refined, points: ChannelPoints) -> ChannelPoints:
    """The same points on the parts of their facets; where several parts meet, in equal shares on each."""
    taken: list[ChannelPoints] = []
    for kind, which, nodes in by_kind(points.kind, points.nodes):
        share, parts = np.zeros(len(which)), []
        for name, corners in kind.split:
            part = next(own for own in FACETS if own.name == name)
            local = _within(part, corners, points.local[which])
            on = np.flatnonzero(on_reference(part, local, ON))
            share[on] += 1
            at = np.full((len(on), 8), -1)
            at[:, : len(part.nodes)] = fine.nodes_at(kind, nodes[on], with_midsides(corners, part.edges))
            code = np.full(len(on), FACETS.index(part))
            parts.append((on, replace(points.take(which[on]), kind=code, nodes=at, local=local[on])))
        taken += [replace(own, weight=own.weight / share[on]) for on, own in parts]
    return ChannelPoints.joined(taken)


def _within(part: Kind, corners: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """Local coordinates (m, 2) on a part of points ξ (m, 2) of the whole: parts are affine images of their reference domain."""
    home = part.nodes[: len(corners)]
    A = np.linalg.lstsq(np.column_stack([home, np.ones(len(home))]), corners, rcond=None)[0]
    return np.asarray(np.linalg.solve(A[:2].T, (xi - A[2]).T).T)
