"""Springs between nodes or a face and the ground, as a config states them: bungees, rubber, soft mounts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.mesh.facets import all_facets, facet_key
from strainsight.mesh.joins import Springs
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.model import IntArray, Mesh


def node_springs(name: str, nodes: IntArray, stiffness: Sequence[float]) -> Springs:
    """Springs to the ground on nodes (k,) (indices), each with 1/k of the stiffness (6,) [N/m, N m/rad] along the basic axes."""
    k = np.asarray(stiffness, dtype=float)
    components = np.flatnonzero(k)
    node, component = (part.ravel() for part in np.meshgrid(nodes, components, indexing="ij"))
    count = len(node)
    return Springs(name, k[component] / len(nodes), np.arange(count), node, component, np.ones(count))


def face_springs(mesh: Mesh, name: str, face: str, stiffness: Sequence[float]) -> Springs:
    """A bed of springs to the ground that is evenly spread over a face: K = Σ k_c/A ∫ N Nᵀ dA of each component c.

    One spring at each point of the facets' rule and component, that the motion Σ N_a z_a there stretches; stiffness (3,) [N/m] of
    the whole bed along the basic axes.
    """
    facets, own = all_facets(mesh), mesh.faces[face]
    chosen = np.isin(facets.key, facet_key(*own.T))
    weight, spring, node, value = [], [], [], []
    count = 0
    for number in np.unique(facets.kind[chosen]):
        kind = FACETS[number]
        nodes = facets.nodes[chosen & (facets.kind == number), : len(kind.nodes)]
        xi, w = kind.mass
        N, dN = kind.functions(xi)
        J = np.einsum("qad,fac->fqcd", dN, mesh.position[nodes])
        dA = np.linalg.norm(np.cross(J[..., 0], J[..., 1]), axis=-1)
        f, q, a = (part.ravel() for part in np.meshgrid(*map(np.arange, (len(nodes), *N.shape)), indexing="ij"))
        weight.append((w * dA).ravel())
        spring.append(count + f * len(w) + q)
        node.append(nodes[f, a])
        value.append(N[q, a])
        count += len(nodes) * len(w)
    share = np.concatenate(weight)
    share /= share.sum()
    components = np.flatnonzero(stiffness)
    return Springs(
        name,
        np.concatenate([stiffness[c] * share for c in components.tolist()]),
        np.concatenate([i * count + at for i in range(len(components)) for at in spring]),
        np.tile(np.concatenate(node), len(components)),
        np.repeat(components, sum(map(len, node))),
        np.tile(np.concatenate(value), len(components)),
    )
