"""Body forces, tractions and forces on nodes that are consistent with them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from strainsight.errors import UserError
from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.equations import joined
from strainsight.fem.mass import element_mass_parts
from strainsight.fem.patch import Patch
from strainsight.fem.shells_and_beams import thin_mass
from strainsight.mesh.facets import CODE, Facets, by_kind, consistent_forces, facets_of_face
from strainsight.mesh.joins import BodyForce, NodalForces
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.kinds.kind import with_midsides
from strainsight.mesh.model import FloatArray, Mesh
from strainsight.mesh.subdivision import Refined


def body_forces(mesh: Mesh, body: BodyForce) -> NodalForces:
    """f_a = Σ_b m_ab a(x_b) on the nodes of solids, m_ab = ∫ ρ N_a N_b dV: as a(x) is linear in x, the same work as ∫ ρ a dV.
    On shells and beams M a, forces and moments.

        a = g + (ω × (x − c)) × ω,     of a point mass m a and r × m a − ω × Jω on the rotations of its node

    r offset of the centre of the mass, J its inertia; for a mass matrix from its momentum P and H, rotating with the body:

        force = m_uu g − ω × P,   moment = m_θu g − ω × H − v × P,   (P, H) = M (v, ω),   v = ω × (x − c)

    Where the node has no rotations, all of the mass is at the node.
    Raises UserError for a region without a material, and so without density."""
    lacking = [region for region in mesh.regions.values() if mesh.density_of(region.id) is None]
    if lacking:
        raise UserError(
            f"{lacking[0]} has no density, but a gravity or rotation load requires mass",
            remedy="Specify the density under mesh.materials.",
        )
    force, moment = np.zeros_like(mesh.position), np.zeros_like(mesh.position)
    a, regions = body.factor * acceleration(body, mesh.position), set()
    for part, m in element_mass_parts(mesh):
        selected = np.ones(len(part.ids), bool) if body.elements is None else np.isin(part.ids, body.elements)
        i, j = np.triu_indices(part.nodes.shape[1])
        m, nodes = m[selected], part.nodes[selected]
        np.add.at(force, nodes[:, i], m[:, :, None] * a[nodes[:, j]])
        off = i != j
        np.add.at(force, nodes[:, j[off]], m[:, off, None] * a[nodes[:, i[off]]])
        regions |= set(np.unique(part.region[selected]).tolist())
    if mesh.thin:
        M, named = thin_mass(mesh, body.elements)
        on_thin = mesh.thin_nodes
        f = (M @ np.hstack([a[on_thin], np.zeros((len(on_thin), 3))]).ravel()).reshape(-1, 6)
        force[on_thin] += f[:, :3]
        moment[on_thin] += f[:, 3:]
        regions |= set(named)
    turning = joined(mesh) | {*mesh.turned_by_springs.tolist()}
    for point in mesh.point_masses:
        if body.elements is not None and point.id not in body.elements:
            continue
        if point.matrix is not None:
            pull, twist = _on_matrix(point.matrix, body, mesh.position[point.node], turns=point.node in turning)
            force[point.node] += pull
            moment[point.node] += twist
            continue
        arm = point.offset if point.node in turning else np.zeros(3)
        pull = body.factor * point.mass * acceleration(body, mesh.position[point.node] + arm)
        force[point.node] += pull
        if point.node in turning:
            spin = -np.cross(body.rotation, np.asarray(point.inertia) @ body.rotation)
            moment[point.node] += np.cross(arm, pull) + body.factor * spin
    nodes = np.flatnonzero(force.any(axis=1) | moment.any(axis=1))
    return NodalForces(nodes, force[nodes], moment[nodes] if moment.any() else None, regions=tuple(sorted(regions)))


def _on_matrix(M: FloatArray, body: BodyForce, x: np.ndarray, *, turns: bool) -> tuple[np.ndarray, np.ndarray]:
    """Force and moment (3,) on the node at x of a mass matrix; only of its translations if the node has no rotations.
    Source: Lamb, Hydrodynamics, §124: a solid with a different mass along each axis."""
    if not turns:
        M = M * np.outer(np.repeat([1, 0], 3), np.repeat([1, 0], 3))
    v, omega = np.cross(body.rotation, x - body.centre), body.rotation
    P, H = np.split(M @ np.concatenate([v, omega]), 2)
    force = M[:3, :3] @ body.acceleration - np.cross(omega, P)
    moment = M[3:, :3] @ body.acceleration - np.cross(omega, H) - np.cross(v, P)
    return body.factor * force, body.factor * moment * turns


def acceleration(body: BodyForce, x: np.ndarray) -> np.ndarray:
    """a = g + (ω × (x − c)) × ω at points x (..., 3) [m/s²], without the factor."""
    return np.asarray(body.acceleration + np.cross(np.cross(body.rotation, x - body.centre), body.rotation))


def gravity_warnings(mesh: Mesh, loads: Collection[str] | None = None) -> list[str]:
    """A warning for every load of the file whose acceleration is that of gravity in another unit of length.

    The acceleration is used without the factor of the load combination. cm is not checked: 9.81 times 100 is 100 g. loads:
    names of the loads to check."""
    warnings = []
    for name, load in mesh.loads.items():
        for body in load.body if loads is None or name in loads else ():
            size = float(np.linalg.norm(body.acceleration))
            for unit, factor in OTHER_UNITS.items():
                if abs(size * factor / 9.81 - 1) < 0.01:
                    warnings.append(
                        f"load {name} has an acceleration of {size:.4g} m/s² instead of 9.81 m/s²: the deck appears to use "
                        f"{unit}/s². Check mesh.length_unit"
                    )
    return warnings


OTHER_UNITS = {"m": 1e3, "mm": 1e-3, "in": 0.0254}
"""Unit that a gravity of 9.81 or 9810 seems to have → the factor that converts it to 9.81 m/s²."""


def with_body_forces(mesh: Mesh) -> Mesh:
    """The mesh with the body forces of its loads converted to nodal forces, at its present densities."""
    loads = {}
    for name, load in mesh.loads.items():
        parts = [replace(load, body=()), *(body_forces(mesh, body) for body in load.body)]
        loads[name] = summed(parts) if load.body else load
    return replace(mesh, loads=loads)


def summed(parts: list[NodalForces]) -> NodalForces:
    """Combine loads into one force and one moment a node."""
    nodes, place = np.unique(np.concatenate([part.nodes for part in parts]), return_inverse=True)
    force, moment, start = np.zeros((len(nodes), 3)), np.zeros((len(nodes), 3)), 0
    for part in parts:
        rows = place[start : start + len(part.nodes)]
        np.add.at(force, rows, part.force)
        if part.moment is not None:
            np.add.at(moment, rows, part.moment)
        start += len(part.nodes)
    regions = tuple(sorted({number for part in parts for number in part.regions}))
    return NodalForces(nodes, force, moment if moment.any() else None, regions=regions)


Traction = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""x (q, 3) [m] and outward unit normal n (q, 3) → t (q, 3) [Pa]."""


def traction_forces(mesh: Mesh, face: str, traction: Traction) -> NodalForces:
    """f_a = ∫ N_a t dA over a face of the mesh, on all its nodes; with the quadrature rule of the facets' N Nᵀ."""
    force, on_face = np.zeros_like(mesh.position), np.zeros(len(mesh.position), dtype=bool)
    facets = facets_of_face(mesh, face)
    for kind, _, nodes in by_kind(facets.kind, facets.nodes):
        facet_forces = consistent_forces(
            mesh.position, kind, nodes, lambda x, n, _: traction(x.reshape(-1, 3), n.reshape(-1, 3)).reshape(x.shape)
        )
        np.add.at(force, nodes, facet_forces)
        on_face[nodes] = True
    loaded = np.flatnonzero(on_face)
    return NodalForces(loaded, force[loaded])


def evenly(mesh: Mesh, face: str, direction: np.ndarray) -> NodalForces:
    """A unit force along the unit direction (3,), t = d/A."""
    forces = traction_forces(mesh, face, lambda x, n: np.broadcast_to(direction, x.shape))
    return _scale_to_unit(forces, direction)


def bearing(mesh: Mesh, face: str, direction: np.ndarray) -> NodalForces:
    """Bearing pressure of a pin on a bore along the unit direction (3,):  t = −n p,  p ∝ max(0, −n·d),  a unit force along d.

    The force is zero if no part of the face is turned against d."""
    forces = traction_forces(mesh, face, lambda x, n: -n * np.maximum(0.0, -(n @ direction))[:, None])
    return _scale_to_unit(forces, direction)


def pressure(mesh: Mesh, face: str) -> NodalForces:
    """A pressure of 1 Pa, t = −n."""
    return traction_forces(mesh, face, lambda x, n: -n)


def turning(mesh: Mesh, face: str, moment: np.ndarray) -> NodalForces:
    """A moment (3,) [N m] about the centre of the face, without resultant:  t = ω × r,  Jω = M,  J = ∫ (r·r I − r rᵀ) dA."""
    each = traction_forces(mesh, face, lambda x, n: np.ones_like(x))
    place, area = mesh.position[each.nodes], each.force[:, 0]
    centre = area @ place / area.sum()

    def about(axis: np.ndarray) -> NodalForces:
        return traction_forces(mesh, face, lambda x, n: np.cross(axis, x - centre))

    J = np.column_stack([np.cross(place - centre, about(axis).force).sum(axis=0) for axis in np.eye(3)])
    return about(np.linalg.solve(J, moment))


def _scale_to_unit(forces: NodalForces, direction: np.ndarray) -> NodalForces:
    """Forces divided by the component of their resultant along the direction, if it is positive."""
    along = forces.force.sum(axis=0) @ direction
    return NodalForces(forces.nodes, forces.force / along if along > 0 else np.zeros_like(forces.force))


@dataclass(frozen=True)
class Tractions:
    """Tractions on facets: kind (f,) indices into FACETS, nodes (f, 8) padded with −1, value (f, 8, 3, r) [Pa] at them."""

    kind: np.ndarray
    nodes: np.ndarray
    value: np.ndarray

    def within(self, patch: Patch) -> Tractions:
        """Tractions on the facets that have all their nodes in a patch, with its node numbers."""
        nodes = patch.local(self.nodes)
        inside = np.all((nodes >= 0) | (self.nodes < 0), axis=1)
        return Tractions(self.kind[inside], np.where(self.nodes[inside] < 0, -1, nodes[inside]), self.value[inside])

    def cut(self, fine: Refined) -> Tractions:
        """The same tractions on the parts of the facets in a finer mesh."""
        parts = [(self.kind[:0], self.nodes[:0], self.value[:0])]
        for kind, which, around in by_kind(self.kind, self.nodes):
            for name, corners in kind.split:
                number = CODE[name]
                xi = with_midsides(corners, FACETS[number].edges)
                nodes, value = np.full((len(which), 8), -1), np.zeros((len(which), *self.value.shape[1:]))
                nodes[:, : len(xi)] = fine.nodes_at(kind, around, xi)
                value[:, : len(xi)] = np.einsum(
                    "qa,eacr->eqcr", kind.shape(xi), self.value[which][:, : len(kind.nodes)]
                )
                parts.append((np.full(len(which), number), nodes, value))
        return Tractions(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def forces(self, position: np.ndarray) -> np.ndarray:
        """f_a = ∫ N_a p dA at nodes (k,): (3k, r) [N]."""
        f = np.zeros((len(position), *self.value.shape[2:]))
        for rule in _quadrature(position, self.kind, self.nodes):
            p = np.einsum("qa,eacr->eqcr", rule.shape, self.value[rule.which][:, : rule.nodes.shape[1]])
            np.add.at(f, rule.nodes, np.einsum("eq,qa,eqcr->eacr", rule.area, rule.shape, p))
        return f.reshape(3 * len(position), -1)


def tractions(patch: Patch, field: np.ndarray, facets: Facets, loaded: np.ndarray, otherwise: np.ndarray) -> Tractions:
    """The tractions τ on facets whose nodes are all loaded, equivalent to the forces f = K z at their nodes:

        M τ = f,     M_ab = ∫ N_a N_b dA,     τ = t + M⁺(f − M t)

    with the rows of the nodes that elements outside of the patch do not share, t the uniform traction of the same resultant.
    A uniform traction is recovered exactly. field z (3k, r) at the nodes of the patch; facets, loaded (n,) of the whole mesh;
    otherwise (n,): nodes with other forces. Valid one layer away from the cut; nodes numbered as in the whole mesh."""
    nodes = patch.local(facets.nodes)
    on_patch = np.all(((nodes >= 0) & loaded[facets.nodes]) | (facets.nodes < 0), axis=1)
    kind, nodes = facets.kind[on_patch], np.where(facets.nodes[on_patch] < 0, -1, nodes[on_patch])
    value = np.zeros((on_patch.sum(), 8, 3, field.shape[1]))
    on = np.unique(nodes[nodes >= 0])
    if (known := ~patch.cut[on] & ~otherwise[patch.nodes[on]]).any():
        position = patch.mesh.position
        f = (assemble_stiffness(patch.mesh) @ field).reshape(len(position), -1)[on[known]]
        M = np.zeros((len(on), len(on)))
        for rule in _quadrature(position, kind, nodes):
            at = np.searchsorted(on, rule.nodes)
            np.add.at(
                M, (at[:, :, None], at[:, None, :]), np.einsum("eq,qa,qb->eab", rule.area, rule.shape, rule.shape)
            )
        M = M[known]
        uniform = np.tile(f.sum(axis=0) / M.sum(), (len(on), 1))
        tau = uniform + np.linalg.lstsq(M, f - M @ uniform, rcond=1e-9)[0]
        value = np.where((nodes >= 0)[:, :, None], tau[np.searchsorted(on, np.maximum(nodes, on[0]))], 0.0)
        value = value.reshape(len(nodes), 8, 3, -1)
    return Tractions(kind, facets.nodes[on_patch], value)


def spread_forces(position: np.ndarray, facets: Facets, forced: np.ndarray) -> sparse.csr_array:
    """(3k, 3k): forces at nodes x₀ → nodal forces of tractions p(x) spread over the facets around each node; the force on a
    node without a facet is unchanged.

        p = α + β·(x − x₀),    ∫ p dA = 1,    ∫ p (x − x₀) dA = 0,

    so that resultant and moment are kept: without β, a force at the end of a beam would shift along it."""
    near = np.any(forced[facets.nodes] & (facets.nodes >= 0), axis=1)
    rules, entries = list(_quadrature(position, facets.kind[near], facets.nodes[near])), []
    for node in np.flatnonzero(forced).tolist():
        if not (around := _facets_around(position, rules, node)):
            entries.append((np.array([node]), np.array([node]), np.ones(1)))
        for rule, on, factor, size in around:
            base = _linear(rule.points[on], position[node], size)
            share = np.einsum("eqi,i,eq,qa->ea", base, factor, rule.area[on], rule.shape)
            entries.append((rule.nodes[on].ravel(), np.full(share.size, node), share.ravel()))
    target, source, value = (np.concatenate(column) for column in zip(*entries, strict=True))
    S = sparse.coo_array((value, (target, source)), shape=(len(position), len(position)))
    return sparse.csr_array(sparse.kron(S, sparse.eye_array(3), format="csr"))


@dataclass(frozen=True)
class _Rule:
    """Quadrature of facets of one kind: their numbers which (e,), nodes (e, a), points (e, q, 3) [m] with area (e, q) [m²],
    shape functions (q, a)."""

    which: np.ndarray
    nodes: np.ndarray
    points: np.ndarray
    area: np.ndarray
    shape: np.ndarray


def _quadrature(position: np.ndarray, kinds: np.ndarray, nodes: np.ndarray) -> Iterator[_Rule]:
    """Quadrature of facets by kind: kinds (f,), nodes (f, 8)."""
    for kind, which, facet_nodes in by_kind(kinds, nodes):
        xi, w = kind.mass
        N, J = kind.shape(xi), np.einsum("qka,ekc->eqca", kind.gradient(xi), position[facet_nodes])
        area = w * np.linalg.norm(np.cross(J[..., 0], J[..., 1]), axis=-1)
        yield _Rule(which, facet_nodes, np.einsum("qk,ekc->eqc", N, position[facet_nodes]), area, N)


def _facets_around(
    position: np.ndarray, rules: list[_Rule], node: int
) -> list[tuple[_Rule, np.ndarray, np.ndarray, float]]:
    """The facets around a node by rule: their numbers (e,), (α, β size) of `spread_forces`, and the length that scales x − x₀."""
    around = [(rule, on) for rule in rules if (on := np.any(rule.nodes == node, axis=1)).any()]
    if not around:
        return []
    size = max(float(np.abs(rule.points[on] - position[node]).max()) for rule, on in around)
    gram = np.zeros((4, 4))
    for rule, on in around:
        base = _linear(rule.points[on], position[node], size)
        gram += np.einsum("eqi,eq,eqj->ij", base, rule.area[on], base)
    factor = np.linalg.pinv(gram, rcond=1e-9, hermitian=True)[:, 0]
    return [(rule, on, factor, size) for rule, on in around]


def _linear(x: np.ndarray, about: np.ndarray, size: float) -> np.ndarray:
    """(1, (x − x₀)/size) of points (..., 3)."""
    return np.concatenate([np.ones((*x.shape[:-1], 1)), (x - about) / size], axis=-1)
