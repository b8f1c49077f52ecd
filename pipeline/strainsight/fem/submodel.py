"""A part of a mesh by itself, moved at its cut boundary as the whole model moves there."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.factorisation import factorise
from strainsight.mesh.facets import Facets
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.kinds.kind import with_midsides
from strainsight.mesh.model import Mesh
from strainsight.mesh.subdivision import Refined, refined


@dataclass(frozen=True)
class Incidence:
    """Which node (n,) is in which element (e,), CSR both ways; elements in the order of the blocks."""

    elements_of: sparse.csr_array
    nodes_of: sparse.csr_array

    @classmethod
    def of(cls, mesh: Mesh) -> Incidence:
        nodes = [block.nodes.ravel() for block in mesh.blocks]
        width = np.concatenate([np.full(len(block.ids), block.nodes.shape[1]) for block in mesh.blocks])
        indptr, columns = np.r_[0, np.cumsum(width)], np.concatenate(nodes)
        shape = (len(width), len(mesh.position))
        own = sparse.csr_array((np.ones(len(columns), dtype=np.int8), columns, indptr), shape=shape)
        return cls(sparse.csr_array(own.T.tocsr()), own)


@dataclass(frozen=True)
class Patch:
    """Some elements of a mesh: a mesh of them alone; nodes (k,) their indices in the whole mesh, ascending; cut (k,): nodes that
    elements outside share."""

    mesh: Mesh
    nodes: np.ndarray
    cut: np.ndarray

    def local(self, nodes: np.ndarray) -> np.ndarray:
        """Indices here of nodes of the whole mesh, −1 for padding and for those that are not here."""
        at = np.minimum(np.searchsorted(self.nodes, nodes), len(self.nodes) - 1)
        return np.where(self.nodes[at] == nodes, at, -1)


def patch_around(mesh: Mesh, incidence: Incidence, nodes: np.ndarray, layers: int) -> Patch:
    """Elements that hold the nodes (s,), those that touch these, and so on for so many layers."""
    chosen = np.zeros(incidence.nodes_of.shape[0], dtype=bool)
    within = np.zeros(len(mesh.position), dtype=bool)
    within[nodes] = True
    for _ in range(layers):
        chosen[incidence.elements_of[np.flatnonzero(within)].indices] = True
        within[incidence.nodes_of[np.flatnonzero(chosen)].indices] = True
    own = np.flatnonzero(within)
    inside = np.asarray(incidence.nodes_of[np.flatnonzero(chosen)].sum(axis=0)).ravel()[own]
    number = np.full(len(mesh.position), -1)
    number[own] = np.arange(len(own))
    blocks, start = [], 0
    for block in mesh.blocks:
        part = np.flatnonzero(chosen[start : start + len(block.ids)])
        start += len(block.ids)
        if len(part):
            region = block.region[part]
            blocks.append(replace(block, ids=block.ids[part], nodes=number[block.nodes[part]], region=region))
    alone = Mesh(
        mesh.node_ids[own],
        mesh.position[own],
        tuple(blocks),
        mesh.regions,
        mesh.materials,
        np.zeros((0, 2), dtype=np.int64),
        source=mesh.source,
    )
    return Patch(alone, own, inside < np.diff(incidence.elements_of.indptr)[own])


def held_components(mesh: Mesh) -> np.ndarray:
    """Which translations (n, 3) of the nodes are given from elsewhere: supports, and what rigid and averaging elements prescribe.

    A node with axes of its own counts as held whole.
    """
    held = np.zeros((len(mesh.position), 3), dtype=bool)
    fixed = mesh.fixed.reshape(-1, 2)
    moving = fixed[fixed[:, 1] < 3]
    held[moving[:, 0], moving[:, 1]] = True
    for rigid in mesh.rigid:
        for component in rigid.components:
            held[rigid.nodes, component % 3] |= component < 3
    for averaging in mesh.averaging:
        if averaging.dependent is None:
            held[averaging.reference] |= [c in averaging.components for c in range(3)]
        else:
            own = averaging.dependent[averaging.dependent[:, 1] < 3]
            held[own[:, 0], own[:, 1]] = True
    for node in mesh.axes:
        held[node] = held[node].any()
    return held


def forced_nodes(mesh: Mesh) -> np.ndarray:
    """Nodes (n,) bool on which ties, springs and point masses put forces that are concentrated there."""
    found = np.zeros(len(mesh.position), dtype=bool)
    for averaging in mesh.averaging:
        found[averaging.nodes] = True
    for own in mesh.springs:
        found[own.node] = True
    for node in (*(rigid.reference for rigid in mesh.rigid), *(point.node for point in mesh.point_masses)):
        found[node] = True
    return found


@dataclass(frozen=True)
class Tractions:
    """What acts on facets: kind (f,) indices into FACETS, nodes (f, 8) padded with −1, value (f, 8, 3, r) [Pa] at them."""

    kind: np.ndarray
    nodes: np.ndarray
    value: np.ndarray

    def within(self, patch: Patch) -> Tractions:
        """On the facets that have all their nodes in a patch, with its node numbers."""
        nodes = patch.local(self.nodes)
        own = np.all((nodes >= 0) | (self.nodes < 0), axis=1)
        return Tractions(self.kind[own], np.where(self.nodes[own] < 0, -1, nodes[own]), self.value[own])

    def cut(self, fine: Refined) -> Tractions:
        """The same on the parts of the facets in a finer mesh."""
        found = [(self.kind[:0], self.nodes[:0], self.value[:0])]
        for code in np.unique(self.kind):
            own, kind = self.kind == code, FACETS[code]
            for name, corners in kind.split:
                number = next(i for i, each in enumerate(FACETS) if each.name == name)
                xi = with_midsides(corners, FACETS[number].edges)
                nodes, value = np.full((own.sum(), 8), -1), np.zeros((own.sum(), *self.value.shape[1:]))
                nodes[:, : len(xi)] = fine.nodes_at(kind, self.nodes[own][:, : len(kind.nodes)], xi)
                value[:, : len(xi)] = np.einsum("qa,eacr->eqcr", kind.shape(xi), self.value[own][:, : len(kind.nodes)])
                found.append((np.full(own.sum(), number), nodes, value))
        return Tractions(*(np.concatenate(column) for column in zip(*found, strict=True)))

    def forces(self, position: np.ndarray) -> np.ndarray:
        """f_a = ∫ N_a p dA at nodes (k,): (3k, r) [N]."""
        f = np.zeros((len(position), *self.value.shape[2:]))
        for rule in _quadrature(position, self.kind, self.nodes):
            p = np.einsum("qa,eacr->eqcr", rule.shape, self.value[rule.which][:, : rule.nodes.shape[1]])
            np.add.at(f, rule.nodes, np.einsum("eq,qa,eqcr->eacr", rule.area, rule.shape, p))
        return f.reshape(3 * len(position), -1)


def tractions(patch: Patch, field: np.ndarray, facets: Facets, loaded: np.ndarray, otherwise: np.ndarray) -> Tractions:
    """The tractions τ that make the forces f = K z at nodes, on facets of which all nodes are loaded:

        M τ = f,     M_ab = ∫ N_a N_b dA,     τ = t + M⁺(f − M t)

    by rows of the nodes that elements outside of the patch do not share, t the uniform traction of the same resultant: of a
    uniform one it is that. field z (3k, r) at the nodes of the patch; facets, loaded (n,) of the whole mesh; otherwise (n,):
    nodes on which other forces act. Valid a layer away from the cut; nodes numbered as in the whole mesh.
    """
    nodes = patch.local(facets.nodes)
    own = np.all(((nodes >= 0) & loaded[facets.nodes]) | (facets.nodes < 0), axis=1)
    kind, nodes = facets.kind[own], np.where(facets.nodes[own] < 0, -1, nodes[own])
    value = np.zeros((own.sum(), 8, 3, field.shape[1]))
    on = np.unique(nodes[nodes >= 0])
    known = ~patch.cut[on] & ~otherwise[patch.nodes[on]]
    if known.any():
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
    return Tractions(kind, facets.nodes[own], value)


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
        rows = (3 * patch.nodes[:, None] + np.arange(3)).ravel()
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
    given = held | patch.cut[:, None]
    K = assemble_stiffness(patch.mesh)
    acting = forced[:, None] & ~given
    force = np.where(acting.reshape(-1, 1), K @ field, 0.0) if acting.any() else np.zeros_like(field)
    return Submodel(patch.mesh, _solved(K, given, field, force), given, force, applied.within(patch))


def with_spread_forces(own: Submodel, facets: Facets) -> Submodel:
    """The same with the concentrated force of each node as a traction of its resultant and moment over the facets around.

    facets: exterior ones of the whole mesh that lie in it, with its node numbers.
    """
    f = own.concentrated
    forced = np.asarray(np.any(f.reshape(-1, 3 * f.shape[1]) != 0, axis=1))
    force = _spread(own.mesh.position, facets, forced) @ f + own.applied.forces(own.mesh.position)
    K = assemble_stiffness(own.mesh)
    return replace(own, field=_solved(K, own.held, own.field, force), force=force)


def refined_submodel(own: Submodel) -> tuple[Submodel, Refined]:
    """The same on a mesh of parts of its elements: what is held moves as its shape functions say, x_b = P z, tractions act on
    the parts of their facets, other forces stay at their nodes. A new node is held where all nodes that it is a mean of are."""
    fine = refined(own.mesh)
    P = sparse.csr_array(sparse.kron(fine.interpolation, sparse.eye_array(3), format="csr"))
    free = (~own.held).ravel().astype(float)
    given = (np.asarray(abs(P) @ free) == 0).reshape(-1, 3)
    force = np.zeros((P.shape[0], own.field.shape[1]))
    force[(3 * _fine_of_coarse(fine)[:, None] + np.arange(3)).ravel()] = own.concentrated
    applied = own.applied.cut(fine)
    force = np.where(given.reshape(-1, 1), 0.0, force + applied.forces(fine.mesh.position))
    K = assemble_stiffness(fine.mesh)
    return Submodel(fine.mesh, _solved(K, given, P @ own.field, force), given, force, applied), fine


def _fine_of_coarse(fine: Refined) -> np.ndarray:
    """The fine node (k,) at every coarse one."""
    P = fine.interpolation
    alone = np.flatnonzero(np.diff(P.indptr) == 1)
    at = np.full(P.shape[1], -1)
    at[P.indices[P.indptr[alone]]] = alone
    return at


def _solved(K: sparse.csr_array, held: np.ndarray, z: np.ndarray, force: np.ndarray) -> np.ndarray:
    """z (3k, r) where it is held (k, 3), in equilibrium with the force (3k, r) elsewhere."""
    given = held.ravel()
    found, free = z.copy(), np.flatnonzero(~given)
    if len(free):
        rows = sparse.csr_array(K[free])
        pushed = force[free] - rows[:, np.flatnonzero(given)] @ z[given]
        found[free] = factorise(sparse.csr_array(rows[:, free])).solve(pushed)
    return found


def _spread(position: np.ndarray, facets: Facets, forced: np.ndarray) -> sparse.csr_array:
    """(3k, 3k): what forces at nodes x₀ are when each is a traction p(x) over the facets around its node; of a node with no facet
    they stay.

        p = α + β·(x − x₀),    ∫ p dA = 1,    ∫ p (x − x₀) dA = 0,

    so that resultant and moment stay: without β a force at the end of a beam would move along it.
    """
    near = np.any(forced[facets.nodes] & (facets.nodes >= 0), axis=1)
    rules, entries = list(_quadrature(position, facets.kind[near], facets.nodes[near])), []
    for node in np.flatnonzero(forced).tolist():
        around = _around(position, rules, node)
        if not around:
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
    """Facets of one kind, by their numbers which (e,): nodes (e, a), points (e, q, 3) [m] with their area (e, q) [m²], shape
    functions (q, a)."""

    which: np.ndarray
    nodes: np.ndarray
    points: np.ndarray
    area: np.ndarray
    shape: np.ndarray


def _quadrature(position: np.ndarray, kinds: np.ndarray, nodes: np.ndarray) -> Iterator[_Rule]:
    """Of facets, kinds (f,), nodes (f, 8), kind by kind."""
    for code in np.unique(kinds):
        kind, which = FACETS[code], np.flatnonzero(kinds == code)
        own = nodes[which][:, : len(kind.nodes)]
        xi, w = kind.mass
        N, J = kind.shape(xi), np.einsum("qka,ekc->eqca", kind.gradient(xi), position[own])
        area = w * np.linalg.norm(np.cross(J[..., 0], J[..., 1]), axis=-1)
        yield _Rule(which, own, np.einsum("qk,ekc->eqc", N, position[own]), area, N)


def _around(position: np.ndarray, rules: list[_Rule], node: int) -> list[tuple[_Rule, np.ndarray, np.ndarray, float]]:
    """The facets around a node, rule by rule: which of them (e,), (α, β size) of `_spread`, and the size that x − x₀ is over."""
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
