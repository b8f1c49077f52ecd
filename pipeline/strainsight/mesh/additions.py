"""Additions to a mesh from the config: materials, supports, rigid and averaging elements.

All in SI units, including positions in m, whatever the unit of the file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from strainsight.errors import UserError, did_you_mean
from strainsight.mesh.anisotropic import Anisotropic, Layer, Orientation
from strainsight.mesh.facets import Facets, by_kind, facets_of_face
from strainsight.mesh.joins import AveragingElement, PointMass, RigidElement, Springs
from strainsight.mesh.model import MATERIAL_FIELDS, FloatArray, IntArray, Material, Mesh
from strainsight.mesh.thin import Lamina, Ply
from strainsight.mesh.units import rescaled


def region_ids(mesh: Mesh, wanted: Sequence[int | str]) -> tuple[int, ...]:
    """Ids of regions specified by id or name. Raises UserError for a region that does not exist."""
    by_name = {region.name: region.id for region in mesh.regions.values()}
    numbers = []
    for entry in wanted:
        if entry in mesh.regions:
            numbers.append(int(entry))
        elif entry in by_name:
            numbers.append(by_name[str(entry)])
        else:
            known = [str(name) for name in (*mesh.regions, *by_name)]
            raise UserError(f"the mesh has no region {entry!r}", remedy=_suggestion(str(entry), known))
    return tuple(numbers)


def spring_names(mesh: Mesh, wanted: Sequence[str]) -> tuple[str, ...]:
    """Names of springs, "CELAS2 12", or of a pattern such as "CELAS2 *". Raises UserError if no spring has the name."""
    known = list(dict.fromkeys(spring.name for spring in mesh.springs))
    names: dict[str, None] = {}
    for name in wanted:
        fitting = [spring for spring in known if spring == name or fnmatchcase(spring, name)]
        if not fitting:
            more = [f"and {len(known) - 8} more"] if len(known) > 8 else []
            listed = f"Use one of {', '.join([*known[:8], *more])}." if known else "Add springs to the mesh."
            raise UserError(f"the mesh has no spring {name!r}", remedy=did_you_mean(name, known, listed))
        names |= dict.fromkeys(fitting)
    return tuple(names)


def with_material(
    mesh: Mesh, regions: Sequence[int | str] | None, E: float, nu: float, rho: float, name: str = ""
) -> Mesh:
    """A mesh whose regions (None: all) have the material E [Pa], ν [-], ρ [kg/m³].

    Raises UserError for a region that does not exist, and for a section that defines its materials itself."""
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
    """A mesh whose regions (None: all) of solids have the stiffness (6, 6) [Pa] along the axes of `orientation` (`Anisotropic`)
    and the density ρ [kg/m³]. Raises UserError for a region that does not exist, and for one of shells or beams."""
    number = mesh.free_material()
    changed = _assigned(mesh, regions, number)
    chosen = [i for i, region in changed.regions.items() if region.material == number]
    for block in mesh.thin:
        if len(thin_regions := np.intersect1d(block.region, chosen)):
            raise UserError(
                f"{mesh.regions[int(thin_regions[0])]} has {block.kind} elements, but anisotropic materials require solids",
                remedy="Specify regions of solids; define orthotropic plies of shells in the deck.",
            )
    return replace(
        changed,
        anisotropic={**changed.anisotropic, number: Anisotropic(number, stiffness, rho, name)},
        orientations={**changed.orientations, **dict.fromkeys(chosen, orientation)},
    )


def _assigned(mesh: Mesh, regions: Sequence[int | str] | None, number: int) -> Mesh:
    """A mesh whose regions (None: all) refer to the material of that number, without unused materials."""
    chosen = set(mesh.regions if regions is None else region_ids(mesh, regions))
    several: dict[str, tuple[Callable[[int], object], str]] = {
        "membrane, bending and shear": (mesh.general_shell, " (MAT1, MAT2, MAT8)"),
        "the plies": (mesh.laminate, " (MAT8, MAT1)"),
        "the layers": (mesh.composites.get, ""),
    }
    for parts, (part_of, cards) in several.items():
        if layered := sorted(i for i in chosen if part_of(i)):
            raise UserError(
                f"a single material cannot be assigned to {mesh.regions[layered[0]]}: {parts} have separate materials",
                remedy="Set `regions` of the material in mesh.materials without this region, and define the materials "
                f"of {parts} in the deck{cards}.",
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
        materials={i: entry for i, entry in mesh.materials.items() if i in used},
        anisotropic={i: entry for i, entry in mesh.anisotropic.items() if i in used},
        orientations={i: entry for i, entry in mesh.orientations.items() if i not in chosen},
    )


def with_properties(
    mesh: Mesh,
    regions: Sequence[int],
    youngs_modulus: float | None = None,
    density: float | None = None,
    stiffness_factor: float = 1.0,
) -> Mesh:
    """A mesh whose regions (ids) have this modulus [Pa] and density [kg/m³] (None: unchanged), each in a separate material, and
    whose moduli are multiplied by a factor. For a laminate or composite solid, density is the mean over its thickness and the
    ratios of its plies are kept; regions with several moduli accept a factor only."""
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
    """A mesh whose laminate or composite solid (region id) has plies or layers with separate materials."""
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
    """A mesh with an added material, of another density and with multiplied moduli, and its id."""
    number = mesh.free_material()
    return with_added_material(mesh, rescaled(replace(old, id=number, density=density), pressure=stiffness)), number


def with_added_material(mesh: Mesh, material: Material | Lamina | Anisotropic) -> Mesh:
    """A mesh with an added material of an unused id."""
    field = MATERIAL_FIELDS[type(material)]
    changes: dict[str, Any] = {field: {**getattr(mesh, field), material.id: material}}
    return replace(mesh, **changes)


def with_layers(mesh: Mesh, region: int, layers: Sequence[Any]) -> Mesh:
    """A mesh whose laminate or composite solid (region id) has other plies or layers."""
    if laminate := mesh.laminate(region):
        return replace(mesh, sections={**mesh.sections, region: replace(laminate, plies=tuple(layers))})
    composite = replace(mesh.composites[region], layers=tuple(layers))
    return replace(mesh, composites={**mesh.composites, region: composite})


def nodes_at(mesh: Mesh, node: int | None, set_name: str | None) -> IntArray:
    """Index of a node (id), or the indices of a node set or face if there is no node."""
    return node_indices(mesh, str(set_name)) if node is None else np.array([mesh.node_index(node)])


def with_support(mesh: Mesh, nodes: IntArray, components: Sequence[int]) -> Mesh:
    """A mesh with nodes (k,) (indices) clamped in components 0-5."""
    pairs = np.array([(node, c) for node in nodes for c in components], dtype=np.int64).reshape(-1, 2)
    return replace(mesh, fixed=np.unique(np.vstack([mesh.fixed.reshape(-1, 2), pairs]), axis=0))


def with_mass(mesh: Mesh, nodes: IntArray, mass: float) -> Mesh:
    """A mesh with an added mass [kg], in equal shares of nodes (k,) (indices)."""
    first = max((point.id for point in mesh.point_masses), default=0) + 1
    added = tuple(PointMass(first + i, int(node), mass / len(nodes)) for i, node in enumerate(nodes))
    return replace(mesh, point_masses=(*mesh.point_masses, *added))


def with_node(mesh: Mesh, node_id: int, position: Sequence[float]) -> Mesh:
    """A mesh with an added node at position (3,) [m]. Raises UserError for an existing id."""
    if node_id in mesh.node_ids:
        raise UserError(
            f"node {node_id} already exists in the mesh", remedy="Set `reference` to an unused node id, or remove `at`."
        )
    last = mesh.own_nodes
    return replace(
        mesh,
        node_ids=np.insert(mesh.node_ids, last, node_id),
        position=np.insert(mesh.position, last, position, axis=0),
        arms=mesh.arms + np.array([1, 0]),
        shells=tuple(replace(block, on_faces=block.on_faces + 1) for block in mesh.shells),
        beams=tuple(replace(block, on_sides=block.on_sides + (block.on_sides >= 0)) for block in mesh.beams),
    )


def with_rigid_element(mesh: Mesh, reference: int, nodes: IntArray, components: Sequence[int], name: str = "") -> Mesh:
    """A mesh with an added rigid element: components 0-5 of nodes (k,) follow node reference (indices)."""
    element = RigidElement(_next_tie(mesh), reference, nodes[nodes != reference], tuple(components), name)
    return replace(mesh, rigid=(*mesh.rigid, element))


def with_averaging_element(
    mesh: Mesh, reference: int, nodes: IntArray, components: Sequence[int], name: str = ""
) -> Mesh:
    """A mesh with an added averaging element: components 0-5 of node reference are the mean motion of nodes (k,)."""
    others = nodes[nodes != reference]
    element = AveragingElement(_next_tie(mesh), reference, others, np.ones(len(others)), tuple(components), name=name)
    return replace(mesh, averaging=(*mesh.averaging, element))


def with_face(mesh: Mesh, name: str, facets: Facets, chosen: IntArray) -> Mesh:
    """A mesh with an added named face, the chosen (k,) of its facets. Raises UserError for the name of a set."""
    if name in mesh.node_sets or name in mesh.element_sets:
        raise UserError(
            f"the mesh already has a node set or element set {name!r}",
            remedy="Rename the face in mesh.faces, or use the existing set.",
        )
    nodes = facets.nodes[chosen]
    members = np.sort(mesh.node_ids[np.unique(nodes[nodes >= 0])])
    members_of_face = np.column_stack([facets.element_id[chosen], facets.facet[chosen]])
    return replace(mesh, faces={**mesh.faces, name: members_of_face}, node_sets={**mesh.node_sets, name: members})


def node_indices(mesh: Mesh, name: str) -> IntArray:
    """Indices of the nodes of a set, ascending. Raises UserError for a set that does not exist or is empty."""
    if name not in mesh.node_sets:
        raise UserError(f"the mesh has no node set {name!r}", remedy=_suggestion(name, list(mesh.node_sets)))
    indices = np.flatnonzero(np.isin(mesh.node_ids[: mesh.own_nodes], mesh.node_sets[name]))
    if not indices.size:
        raise UserError(f"node set {name!r} is empty", remedy="Specify a node set that contains nodes.")
    return indices


def _next_tie(mesh: Mesh) -> int:
    return max([0, *(e.id for e in mesh.rigid), *(e.id for e in mesh.averaging)]) + 1


def _suggestion(word: str, known: list[str]) -> str:
    return did_you_mean(
        word,
        known,
        f"Use one of {', '.join(sorted(set(known)))}." if known else "Define the node set in the mesh file.",
    )


def node_springs(name: str, nodes: IntArray, stiffness: Sequence[float]) -> Springs:
    """Springs to the ground on nodes (k,) (indices), each with 1/k of the stiffness (6,) [N/m, N m/rad] along the basic axes."""
    k = np.asarray(stiffness, dtype=float)
    node, component = (part.ravel() for part in np.meshgrid(nodes, np.flatnonzero(k), indexing="ij"))
    count = len(node)
    return Springs(name, k[component] / len(nodes), np.arange(count), node, component, np.ones(count))


def face_springs(mesh: Mesh, name: str, face: str, stiffness: Sequence[float]) -> Springs:
    """A bed of springs to the ground, evenly distributed over a face: K = Σ k_c/A ∫ N Nᵀ dA of each component c.

    One spring at each quadrature point of the facets and component, stretched by the motion Σ N_a z_a there; stiffness (3,)
    [N/m] of the whole bed along the basic axes."""
    parts, count = [], 0
    facets = facets_of_face(mesh, face)
    for kind, _, nodes in by_kind(facets.kind, facets.nodes):
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
