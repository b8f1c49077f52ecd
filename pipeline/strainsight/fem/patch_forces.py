"""Forces at nodes as tractions on the facets around them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from strainsight.fem.assembly import assemble_stiffness
from strainsight.fem.patch import Patch
from strainsight.mesh.facets import Facets
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.kinds.kind import with_midsides
from strainsight.mesh.subdivision import Refined


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


def spread_forces(position: np.ndarray, facets: Facets, forced: np.ndarray) -> sparse.csr_array:
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
    """The facets around a node, rule by rule: which of them (e,), (α, β size) of `spread_forces`, and the size x − x₀ is over."""
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
