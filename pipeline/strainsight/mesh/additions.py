"""What a mesh file does not say, stated beside it: materials, supports, rigid and averaging elements.

All in SI units, positions in m too, whatever the unit of the file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from strainsight.errors import UserError, did_you_mean
from strainsight.mesh.facets import Facets
from strainsight.mesh.model import AveragingElement, IntArray, Material, Mesh, RigidElement


def region_ids(mesh: Mesh, wanted: Sequence[int | str]) -> tuple[int, ...]:
    """Ids of regions given by id or name. Raises UserError for one that the mesh does not have."""
    by_name = {region.name: region.id for region in mesh.regions.values()}
    found = []
    for entry in wanted:
        if entry in mesh.regions:
            found.append(int(entry))
        elif entry in by_name:
            found.append(by_name[str(entry)])
        else:
            known = [str(name) for name in (*mesh.regions, *by_name)]
            raise UserError(f"the mesh has no region {entry!r}", remedy=_suggestion(str(entry), known))
    return tuple(found)


def with_material(
    mesh: Mesh, regions: Sequence[int | str] | None, E: float, nu: float, rho: float, name: str = ""
) -> Mesh:
    """A mesh whose regions (None: all) are of the material E [Pa], ν [-], ρ [kg/m³].

    Raises UserError for a region that the mesh does not have.
    """
    number = max([0, *mesh.materials]) + 1
    chosen = set(mesh.regions if regions is None else region_ids(mesh, regions))
    altered = {i: replace(r, material=number) if i in chosen else r for i, r in mesh.regions.items()}
    used = {region.material for region in altered.values()}
    materials = {i: m for i, m in mesh.materials.items() if i in used} | {number: Material(number, E, nu, rho, name)}
    return replace(mesh, regions=altered, materials=materials)


def with_properties(
    mesh: Mesh, regions: Sequence[int], youngs_modulus: float | None = None, density: float | None = None
) -> Mesh:
    """A mesh whose regions (ids) have this modulus [Pa] and density [kg/m³], each in a material of its own; None: as before."""
    altered, materials = dict(mesh.regions), dict(mesh.materials)
    for region in regions:
        number, own = max(materials) + 1, mesh.materials[mesh.regions[region].material]
        E = own.youngs_modulus if youngs_modulus is None else youngs_modulus
        rho = own.density if density is None else density
        materials[number] = replace(own, id=number, youngs_modulus=E, density=rho)
        altered[region] = replace(altered[region], material=number)
    return replace(mesh, regions=altered, materials=materials)


def with_support(mesh: Mesh, nodes: IntArray, components: Sequence[int]) -> Mesh:
    """A mesh whose nodes (k,) (indices) are held in components 0-5 too."""
    pairs = np.array([(node, c) for node in nodes for c in components], dtype=np.int64).reshape(-1, 2)
    return replace(mesh, fixed=np.unique(np.vstack([mesh.fixed.reshape(-1, 2), pairs]), axis=0))


def with_node(mesh: Mesh, node_id: int, position: Sequence[float]) -> Mesh:
    """A mesh with one node more, at position (3,) [m]. Raises UserError for an id that is taken."""
    if node_id in mesh.node_ids:
        raise UserError(f"node {node_id} is in the mesh already", remedy="take another id, or leave its position out")
    ids = np.append(mesh.node_ids, np.int64(node_id))
    return replace(mesh, node_ids=ids, position=np.vstack([mesh.position, np.asarray(position, dtype=float)]))


def with_rigid_element(mesh: Mesh, reference: int, nodes: IntArray, components: Sequence[int], name: str = "") -> Mesh:
    """A mesh with one rigid element more: components 0-5 of nodes (k,) follow node reference (indices)."""
    element = RigidElement(_next_tie(mesh), reference, nodes[nodes != reference], tuple(components), name)
    return replace(mesh, rigid=(*mesh.rigid, element))


def with_averaging_element(
    mesh: Mesh, reference: int, nodes: IntArray, components: Sequence[int], name: str = ""
) -> Mesh:
    """A mesh with one averaging element more: components 0-5 of node reference are the mean motion of nodes (k,)."""
    others = nodes[nodes != reference]
    element = AveragingElement(_next_tie(mesh), reference, others, np.ones(len(others)), tuple(components), name=name)
    return replace(mesh, averaging=(*mesh.averaging, element))


def with_face(mesh: Mesh, name: str, facets: Facets, chosen: IntArray) -> Mesh:
    """A mesh with one named face more, the chosen (k,) of its facets. Raises UserError for a name that a set has."""
    if name in mesh.node_sets or name in mesh.element_sets:
        raise UserError(f"the mesh has a set {name!r}", remedy="give the face another name, or use the set")
    nodes = facets.nodes[chosen]
    members = np.sort(mesh.node_ids[np.unique(nodes[nodes >= 0])])
    own = np.column_stack([facets.element_id[chosen], facets.facet[chosen]])
    return replace(mesh, faces={**mesh.faces, name: own}, node_sets={**mesh.node_sets, name: members})


def node_indices(mesh: Mesh, name: str) -> IntArray:
    """Indices of the nodes of a set, ascending. Raises UserError for a set that is not there or is empty."""
    if name not in mesh.node_sets:
        raise UserError(f"the mesh has no node set {name!r}", remedy=_suggestion(name, list(mesh.node_sets)))
    found = np.flatnonzero(np.isin(mesh.node_ids, mesh.node_sets[name]))
    if not found.size:
        raise UserError(f"node set {name!r} is empty", remedy="name another set")
    return found


def node_index(mesh: Mesh, node_id: int) -> int:
    """Index of the node with this id. Raises UserError where there is none."""
    try:
        return mesh.node_index(node_id)
    except KeyError:
        raise UserError(f"the mesh has no node {node_id}", remedy="node numbers are the ids of the mesh file") from None


def _next_tie(mesh: Mesh) -> int:
    return max([0, *(e.id for e in mesh.rigid), *(e.id for e in mesh.averaging)]) + 1


def _suggestion(word: str, known: list[str]) -> str:
    return did_you_mean(word, known, f"it has {', '.join(sorted(set(known)))}" if known else "it has none")
