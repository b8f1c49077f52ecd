"""What a mesh file does not say, stated beside it: materials, supports, rigid and averaging elements.

All in SI units, positions in m too, whatever the unit of the file.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from strainsight.errors import UserError, did_you_mean
from strainsight.mesh.anisotropic import Anisotropic, Layer, Orientation
from strainsight.mesh.facets import Facets, all_facets, facet_key
from strainsight.mesh.joins import AveragingElement, RigidElement, Springs
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.model import MATERIAL_FIELDS, FloatArray, IntArray, Material, Mesh
from strainsight.mesh.thin import Lamina, Ply
from strainsight.mesh.units import rescaled


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


def spring_names(mesh: Mesh, wanted: Sequence[str]) -> tuple[str, ...]:
    """Names of springs, "CELAS2 12" or a pattern of names as "CELAS2 *". Raises UserError for one that no spring has."""
    known = list(dict.fromkeys(own.name for own in mesh.springs))
    found: dict[str, None] = {}
    for name in wanted:
        fitting = [own for own in known if own == name or fnmatchcase(own, name)]
        if not fitting:
            more = [f"and {len(known) - 8} more"] if len(known) > 8 else []
            listed = f"it has {', '.join([*known[:8], *more])}" if known else "it has none"
            raise UserError(f"the mesh has no spring {name!r}", remedy=did_you_mean(name, known, listed))
        found |= dict.fromkeys(fitting)
    return tuple(found)


def with_material(
    mesh: Mesh, regions: Sequence[int | str] | None, E: float, nu: float, rho: float, name: str = ""
) -> Mesh:
    """A mesh whose regions (None: all) are of the material E [Pa], ν [-], ρ [kg/m³].

    Raises UserError for a region that the mesh does not have, and for one whose section has materials of its own.
    """
    number = mesh.free_material()
    changed = _assigned(mesh, regions, number)
    return replace(changed, materials={**changed.materials, number: Material(number, E, nu, rho, name)})


def with_anisotropic(
    mesh: Mesh,
    regions: Sequence[int | str] | None,
    stiffness: FloatArray,
    orientation: Orientation,
    rho: float,
    name: str = "",
) -> Mesh:
    """A mesh whose regions (None: all) of solids are of the stiffness (6, 6) [Pa], see `Anisotropic`, along those axes, and of
    the density ρ [kg/m³]. Raises UserError for a region that the mesh does not have, and for one of shells or beams."""
    number = mesh.free_material()
    changed = _assigned(mesh, regions, number)
    chosen = [i for i, own in changed.regions.items() if own.material == number]
    for block in mesh.thin:
        if len(found := np.intersect1d(block.region, chosen)):
            raise UserError(
                f"{mesh.regions[int(found[0])]} has {block.kind} elements, and only solids are of an anisotropic material",
                remedy="name the regions of solids; state orthotropic plies of shells in the deck",
            )
    return replace(
        changed,
        anisotropic={**changed.anisotropic, number: Anisotropic(number, stiffness, rho, name)},
        orientations={**changed.orientations, **dict.fromkeys(chosen, orientation)},
    )


def _assigned(mesh: Mesh, regions: Sequence[int | str] | None, number: int) -> Mesh:
    """A mesh whose regions (None: all) refer to the material of that number, without materials that nothing refers to."""
    chosen = set(mesh.regions if regions is None else region_ids(mesh, regions))
    several: dict[str, tuple[Callable[[int], object], str]] = {
        "a shell whose membrane, bending and shear": (
            mesh.general_shell,
            "its materials in the deck (MAT1, MAT2, MAT8)",
        ),
        "a laminate, whose plies": (mesh.laminate, "materials of plies in the deck (MAT8, MAT1)"),
        "a composite solid, whose layers": (mesh.composites.get, "materials of layers in the deck"),
    }
    for words, (part_of, where) in several.items():
        if own := sorted(i for i in chosen if part_of(i)):
            raise UserError(
                f"{mesh.regions[own[0]]} is {words} have materials of their own",
                remedy=f"name the regions that are none, and state {where}",
            )
    altered = {i: replace(r, material=number) if i in chosen else r for i, r in mesh.regions.items()}
    stacks: list[tuple[Ply | Layer, ...]] = [
        laminate.plies for region in mesh.regions if (laminate := mesh.laminate(region))
    ]
    stacks += [composite.layers for composite in mesh.composites.values()]
    used = {region.material for region in altered.values()} | {part.material for parts in stacks for part in parts}
    return replace(
        mesh,
        regions=altered,
        materials={i: own for i, own in mesh.materials.items() if i in used},
        anisotropic={i: own for i, own in mesh.anisotropic.items() if i in used},
        orientations={i: own for i, own in mesh.orientations.items() if i not in chosen},
    )


def with_properties(
    mesh: Mesh,
    regions: Sequence[int],
    youngs_modulus: float | None = None,
    density: float | None = None,
    stiffness_factor: float = 1.0,
) -> Mesh:
    """A mesh whose regions (ids) have this modulus [Pa] and density [kg/m³], each in a material of its own; None: as before;
    and whose moduli are multiplied by a factor. Of a laminate or composite solid, density is the mean over its thickness, and its
    plies keep their ratios; its moduli, and those of any region that has several, go by a factor alone."""
    for region in regions:
        if mesh.laminate(region) or region in mesh.composites:
            assert youngs_modulus is None
            mesh = _with_parts(mesh, region, density, stiffness_factor)
        elif (shell := mesh.general_shell(region)) is not None:
            assert youngs_modulus is None
            shell = replace(shell, density=shell.density if density is None else density)
            shell = rescaled(shell, pressure=stiffness_factor)
            mesh = replace(mesh, sections={**mesh.sections, region: shell})
        else:
            old = mesh.anisotropic_of(region) or mesh.materials[mesh.regions[region].material]
            if youngs_modulus is not None:
                assert isinstance(old, Material)
                old = replace(old, youngs_modulus=youngs_modulus)
            mesh, number = _with_altered(mesh, old, old.density if density is None else density, stiffness_factor)
            mesh = replace(mesh, regions={**mesh.regions, region: replace(mesh.regions[region], material=number)})
    return mesh


def _with_parts(mesh: Mesh, region: int, density: float | None, stiffness: float) -> Mesh:
    """A mesh whose laminate or composite solid (region id) has plies or layers of materials of their own."""
    laminate, mean = mesh.laminate(region), mesh.density_of(region)
    parts: tuple[Any, ...] = laminate.plies if laminate else mesh.composites[region].layers
    materials = mesh.ply_materials(region) if laminate else mesh.layer_materials(region)
    changed = []
    for part, old in zip(parts, materials, strict=True):
        assert old is not None
        assert mean is not None
        rho = old.density if density is None else density if mean == 0 else density / mean * old.density
        mesh, number = _with_altered(mesh, old, rho, stiffness)
        changed.append(replace(part, material=number))
    return with_layers(mesh, region, changed)


def _with_altered(
    mesh: Mesh, old: Material | Lamina | Anisotropic, density: float, stiffness: float
) -> tuple[Mesh, int]:
    """A mesh with a material more, of another density and of moduli that are multiplied, and its id."""
    number = mesh.free_material()
    return with_added_material(mesh, rescaled(replace(old, id=number, density=density), pressure=stiffness)), number


def with_added_material(mesh: Mesh, material: Material | Lamina | Anisotropic) -> Mesh:
    """A mesh with a material more, of an id that no other has."""
    field = MATERIAL_FIELDS[type(material)]
    changes: dict[str, Any] = {field: {**getattr(mesh, field), material.id: material}}
    return replace(mesh, **changes)


def with_layers(mesh: Mesh, region: int, layers: Sequence[Any]) -> Mesh:
    """A mesh whose laminate or composite solid (region id) has other plies or layers."""
    if laminate := mesh.laminate(region):
        return replace(mesh, sections={**mesh.sections, region: replace(laminate, plies=tuple(layers))})
    composite = replace(mesh.composites[region], layers=tuple(layers))
    return replace(mesh, composites={**mesh.composites, region: composite})


def with_support(mesh: Mesh, nodes: IntArray, components: Sequence[int]) -> Mesh:
    """A mesh whose nodes (k,) (indices) are held in components 0-5 too."""
    pairs = np.array([(node, c) for node in nodes for c in components], dtype=np.int64).reshape(-1, 2)
    return replace(mesh, fixed=np.unique(np.vstack([mesh.fixed.reshape(-1, 2), pairs]), axis=0))


def with_node(mesh: Mesh, node_id: int, position: Sequence[float]) -> Mesh:
    """A mesh with one node more, at position (3,) [m]. Raises UserError for an id that is taken."""
    if node_id in mesh.node_ids:
        raise UserError(f"node {node_id} is in the mesh already", remedy="take another id, or leave its position out")
    own = mesh.own_nodes
    ids = np.insert(mesh.node_ids, own, node_id)
    return replace(
        mesh,
        node_ids=ids,
        position=np.insert(mesh.position, own, position, axis=0),
        arms=mesh.arms + np.array([1, 0]),
        shells=tuple(replace(block, on_faces=block.on_faces + 1) for block in mesh.shells),
        beams=tuple(replace(block, on_sides=block.on_sides + (block.on_sides >= 0)) for block in mesh.beams),
    )


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
    found = np.flatnonzero(np.isin(mesh.node_ids[: mesh.own_nodes], mesh.node_sets[name]))
    if not found.size:
        raise UserError(f"node set {name!r} is empty", remedy="name another set")
    return found


def _next_tie(mesh: Mesh) -> int:
    return max([0, *(e.id for e in mesh.rigid), *(e.id for e in mesh.averaging)]) + 1


def _suggestion(word: str, known: list[str]) -> str:
    return did_you_mean(word, known, f"it has {', '.join(sorted(set(known)))}" if known else "it has none")


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
    parts, count = [], 0
    for number in np.unique(facets.kind[chosen]):
        kind = FACETS[number]
        nodes = facets.nodes[chosen & (facets.kind == number), : len(kind.nodes)]
        xi, w = kind.mass
        N, dN = kind.functions(xi)
        J = np.einsum("qad,fac->fqcd", dN, mesh.position[nodes])
        dA = np.linalg.norm(np.cross(J[..., 0], J[..., 1]), axis=-1)
        f, q, a = (part.ravel() for part in np.meshgrid(*map(np.arange, (len(nodes), *N.shape)), indexing="ij"))
        parts.append(((w * dA).ravel(), count + f * len(w) + q, nodes[f, a], N[q, a]))
        count += len(nodes) * len(w)
    share, spring, node, value = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    share = share / share.sum()
    components = np.flatnonzero(stiffness)
    return Springs(
        name,
        np.concatenate([stiffness[c] * share for c in components.tolist()]),
        np.concatenate([i * count + spring for i in range(len(components))]),
        np.tile(node, len(components)),
        np.repeat(components, len(node)),
        np.tile(value, len(components)),
    )
