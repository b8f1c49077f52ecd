"""Read the mesh of a config, apply its additions and check the model."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from strainsight.config.mesh import ElementSection, Face, MaterialAxes, MaterialSection, MeshFile, Support
from strainsight.config.placement import PlacementConfig
from strainsight.decks.faults import LINEAR, PRELOAD, short, spelt
from strainsight.decks.reader import read_mesh
from strainsight.decks.text import LARGEST_ID
from strainsight.errors import ConfigError, DeckError, InfeasibleError, StrainsightError, UserError, blame
from strainsight.experiment.layout.gauge_list import sites_of
from strainsight.fem.checks import Quality, check_geometry, check_inverted, check_mesh, element_quality
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.equations import turning_nodes
from strainsight.fem.mass import has_mass, mass_properties
from strainsight.fem.nodal_forces import gravity_warnings, with_body_forces
from strainsight.fem.springs import spring_rows
from strainsight.fem.stiff_pieces import hinge_warnings
from strainsight.fem.support import EXACT, links, rigid_body_motions
from strainsight.mesh.additions import (
    face_springs,
    node_indices,
    node_springs,
    nodes_at,
    with_anisotropic,
    with_averaging_element,
    with_face,
    with_mass,
    with_material,
    with_node,
    with_rigid_element,
    with_support,
)
from strainsight.mesh.anisotropic import Orientation, constants_fault, orthotropic
from strainsight.mesh.assigned_sections import GivenSection
from strainsight.mesh.connectivity import check_doubled, connectivity_warnings, merged
from strainsight.mesh.coordinates import BASIC, CoordinateSystem
from strainsight.mesh.facets import Facets, exterior_facets, facet_key
from strainsight.mesh.joins import Springs
from strainsight.mesh.model import Mesh
from strainsight.mesh.sanity import leading_warnings, sanity_warnings, without_loose_masses
from strainsight.mesh.surface_ties import with_surface_tie, without_held
from strainsight.mesh.thin import BeamSection, ShellSection
from strainsight.mesh.thin_faces import with_faces, with_sides
from strainsight.sensors.access import contact_faces
from strainsight.sensors.candidates import Candidates
from strainsight.sensors.faces import Faces, Pick, faces_of, picked, pointed_at
from strainsight.sensors.zones import admissible

HEAVY = 100.0
"""Ratio of point masses to element mass from which the unit of mass is checked."""
STEEL = 7850.0
"""Density [kg/m³] for the plausibility of point masses: a steel ball should not exceed the structure."""
SHOWN = 3
"""Most springs and constraint equations that are listed."""


def free_motions(mesh: Mesh) -> tuple[str, ...]:
    """Names of the rigid-body motions that supports and ties allow; raises the errors of `rigid_body_motions`."""
    return rigid_body_motions(mesh, constraint_transform(mesh, rotations=turning_nodes(mesh)))


def loose_warnings(mesh: Mesh) -> tuple[str, ...]:
    """Warning about a supported structure that can still move freely, which `modes` would refuse."""
    if not mesh.elements or not (mesh.held.size or mesh.springs or mesh.relations):
        return ()
    try:
        motions = free_motions(mesh)
    except StrainsightError as error:
        return (f"{error.what}: {error.remedy}" if error.remedy else error.what,)
    if not motions:
        return ()
    more = f" and {len(motions) - 8} more" if len(motions) > 8 else ""
    return (
        f"the structure can move freely: {', '.join(motions[:8])}{more}. Add supports or ties for these motions "
        "(mesh.supports, mesh.ties), or set mesh.free",
    )


def grounding_warnings(mesh: Mesh) -> tuple[str, ...]:
    """Warning about springs and constraint equations that resist a rigid-body motion."""
    grounding = links(mesh, EXACT)
    if not grounding:
        return ()
    named = "; ".join(f"{link.name} ({link.motion}, nodes {link.apart:.3g} m apart)" for link in grounding[:SHOWN])
    more = f" and {len(grounding) - SHOWN} more" if len(grounding) > SHOWN else ""
    return (
        f"springs or constraint equations between nodes resist a rigid-body motion like a support: {named}{more}. Move their "
        "end nodes to the same point, or align the springs and equations with the line between their end nodes",
    )


def heavy_points(mesh: Mesh) -> tuple[str, ...]:
    """Warning if point masses outweigh the elements and, as a steel ball of diameter 2 (3m/4πρ)^⅓, exceed the structure."""
    points = sum(point.mass for point in mesh.point_masses)
    if points <= 0 or any(mesh.density_of(number) is None for number in mesh.regions):
        return ()
    elements = mass_properties(mesh)[0] - points
    ball = 2 * float(np.cbrt(3 * points / (4 * np.pi * STEEL)))
    long = float(np.linalg.norm(np.ptp(mesh.position[mesh.nodes_of_elements], axis=0)))
    if elements <= 0 or points <= HEAVY * elements or ball <= long:
        return ()
    return (
        f"point masses ({points:.4g} kg) are {points / elements:.3g} times as heavy as the elements ({elements:.4g} kg). "
        f"A steel ball of this mass has a diameter of {ball:.3g} m, the structure a length of {long:.3g} m. "
        "Check mesh.mass_unit; ignore this warning for a large mass that drives the base",
    )


def mesh_of(
    config: MeshFile, path: Path, key: str = "mesh", base: Path | None = None, loads: Collection[str] | None = None
) -> Mesh:
    """Read the mesh file of a config section `key` and apply its additions; base: folder for relative paths; loads: names of the
    deck loads that are used (gravity is checked), None for all."""
    include = [(base or Path()) / name for name in config.include_dirs]
    for folder in include:
        if not folder.is_dir():
            raise ConfigError(
                f"folder not found: {folder}",
                key=f"{key}.include_dirs",
                remedy="Paths are relative to the config file.",
            )
    with blame(f"{key}.file"):
        mesh = read_mesh(
            path,
            config.length_unit,
            config.mass_unit,
            format=config.format,
            region_data=config.region_data,
            solids=config.matrices is None,
            materials=not config.materials and config.results is None,
            ignore=config.ignore,
            spc=config.spc,
            step=config.step,
            sections={
                f"{key}.sections.{name}": _assigned_section(section) for name, section in config.sections.items()
            },
            include=include,
            contact=config.contact or ("open" if config.matrices or config.results else None),
        )
        if config.matrices is None and config.results is None:
            mesh = _all_supported(mesh, config.ignore)
    mesh = _with_mass(mesh, config, key)
    if config.merge is not None:
        with blame(f"{key}.merge"):
            mesh = merged(mesh, config.merge)
            exterior_facets(mesh)  # raises for elements that do not match after merging
    # with matrices, shells and beams are part of them
    mesh = with_sides(with_faces(mesh)) if config.matrices is None else replace(mesh, shells=(), beams=())
    mesh = with_additions(mesh, config, key)
    if config.matrices is None:
        mesh = without_loose_masses(mesh)
    with blame(f"{key}.file"), mesh.located():
        mesh = replace(mesh, doubts=(*mesh.doubts, *gravity_warnings(mesh, loads)))
        weighs = config.matrices is None and (config.results is None or has_mass(mesh))
        return with_body_forces(mesh) if weighs else mesh


def _with_mass(mesh: Mesh, config: MeshFile, key: str) -> Mesh:
    """Set consistent or lumped mass of solids from config or deck, with a note if lumped."""
    if config.mass == "lumped" and mesh.thin:
        raise ConfigError(
            "lumped mass is not supported for shells, beams and rods",
            key=f"{key}.mass",
            remedy="Remove the key to use consistent mass.",
        )
    chosen = mesh.lumped if config.mass is None else config.mass == "lumped"
    by = "PARAM,COUPMASS" if config.mass is None else f"{key}.mass"
    note = f"the mass matrix of solids is lumped ({by}): diagonal of the consistent matrix, scaled to the mass of each element"
    return replace(mesh, lumped=chosen, notes=(*mesh.notes, *[note] * chosen))


def _all_supported(mesh: Mesh, ignore: Sequence[str]) -> Mesh:
    """Add a note on unused names in `ignore`. Raises DeckError for unsupported elements, ties and loads not named there."""
    named = {spelt(card) for card in ignore}
    missing = [card for card in mesh.unsupported if spelt(card) not in named]
    if missing:
        names = ", ".join(dict.fromkeys(map(short, missing)))
        listed = [f"{mesh.ignored[card]} × {_named(card)} (first at {mesh.unsupported[card]})" for card in missing]
        linear = [f"Replace {name} by {LINEAR[name]}. " for name in map(short, missing) if name in LINEAR]
        more = f" and {len(listed) - 6} more kinds" if len(listed) > 6 else ""
        raise DeckError(
            f"unsupported cards that affect the model: {', '.join(listed[:6])}{more}",
            where=mesh.unsupported[missing[0]],
            remedy=f"{''.join(linear)}If their effect is negligible, set mesh.ignore: [{names}]",
        )
    unused = [card for card in ignore if spelt(card) not in {spelt(existing) for existing in mesh.ignored}]
    notes = (f"the deck does not contain these cards of mesh.ignore: {', '.join(unused)}",) if unused else ()
    return replace(mesh, notes=(*mesh.notes, *notes))


def _named(card: str) -> str:
    return card if card.startswith(PRELOAD) else short(card)


def checked(
    mesh: Mesh, config: MeshFile, key: str = "mesh"
) -> tuple[tuple[float, np.ndarray] | None, tuple[Quality, ...]]:
    """Check the model; returns mass [kg] with centre (3,) [m] (None for imported models), and element quality."""
    weight = None
    with blame(f"{key}.file"), mesh.located(), _config_ties(mesh, key):
        if config.results is not None and not has_mass(mesh):
            check_geometry(mesh)
            quality = element_quality(mesh)
            check_inverted(quality)
        elif config.matrices is None:
            check_mesh(mesh)
            check_doubled(mesh)
            quality = element_quality(mesh)
            check_inverted(quality)
            weight = mass_properties(mesh)
            # raises for conflicting ties and supports, and for springs on missing rotations
            constraint = constraint_transform(mesh, rotations=turning_nodes(mesh))
            spring_rows(mesh, constraint.reference_rows)
        else:
            check_geometry(mesh)
            quality = element_quality(mesh)
        return weight, quality


def model_warnings(mesh: Mesh, length_unit: str = "m", mass_unit: str = "kg", free: bool = False) -> tuple[str, ...]:
    """Warnings about probable mistakes: ignored cards, unconnected parts, free motions, springs to ground, `sanity_warnings`."""
    sane, first = sanity_warnings(mesh, length_unit, mass_unit, free), len(leading_warnings(mesh))
    return (
        *sane[:first],
        *connectivity_warnings(mesh),
        *hinge_warnings(mesh),
        *(() if free else loose_warnings(mesh)),
        *grounding_warnings(mesh),
        *sane[first:],
        *heavy_points(mesh),
    )


def _with_material(mesh: Mesh, material: MaterialSection, name: str) -> Mesh:
    regions = None if material.regions == "all" else material.regions
    E, nu, G = material.youngs_modulus, material.poisson_ratio, material.shear_modulus
    if isinstance(E, float) and isinstance(nu, float):
        return with_material(mesh, regions, E, nu, material.density, name)
    assert isinstance(E, tuple)
    assert isinstance(nu, tuple)
    assert G is not None
    if fault := constants_fault(E, nu, G):
        raise UserError(fault[0], key=name, remedy=fault[1])
    stiffness, orientation = orthotropic(E, nu, G), _orientation(material.axes)
    return with_anisotropic(mesh, regions, stiffness, orientation, material.density, name)


def _orientation(axes: MaterialAxes | None) -> Orientation:
    if axes is None:
        return Orientation(BASIC, np.eye(3))
    x, in_plane = np.array(axes.x), np.array(axes.y)
    z = np.cross(x, in_plane)
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    directions = np.column_stack([x, np.cross(z, x), z])
    return Orientation(CoordinateSystem(axes.system, np.array(axes.origin), directions), np.eye(3))


def with_additions(mesh: Mesh, config: MeshFile, key: str = "mesh") -> Mesh:
    """Add materials, faces, ties and supports of the config to the mesh."""
    for name, material in config.materials.items():
        with blame(f"{key}.materials.{name}.regions"):
            mesh = _with_material(mesh, material, f"{key}.materials.{name}")
    if config.faces and not mesh.has_surface:
        raise UserError(
            "the mesh has no faces, because it has no solids, shells or beams with a cross-section",
            key=f"{key}.faces",
            remedy="Remove this key, and use node sets of the mesh file instead.",
        )
    if config.faces:
        facets = exterior_facets(mesh)
        faces = faces_of(mesh.position, facets)
        for name, face in config.faces.items():
            with blame(f"{key}.faces.{name}"):
                mesh = with_face(mesh, name, facets, picked(_pick(face), faces, mesh.position, facets))
    for i, tie in enumerate(config.ties):
        with blame(f"{key}.ties.{i}"):
            nodes = node_indices(mesh, tie.set)
            if tie.reference is None:  # a surface, see `Tie`
                onto = node_indices(mesh, str(tie.to))
                mesh = with_surface_tie(mesh, nodes, onto, tie.within, f"{key}.ties.{i}")
                continue
            if tie.reference >= LARGEST_ID:
                what = f"{tie.reference} is too large for a node number"
                raise DeckError(what, key=f"{key}.ties.{i}.reference", remedy="Use a number below 10^12.")
            if tie.at is not None:
                mesh = with_node(mesh, tie.reference, tie.at)
            reference = mesh.node_index(tie.reference)
            if tie.type == "rigid":
                mesh = with_rigid_element(
                    mesh, reference, nodes, _components(tie.components or (1, 2, 3)), f"{key}.ties.{i}"
                )
            else:
                components = _components(tie.components or (1, 2, 3, 4, 5, 6))
                mesh = with_averaging_element(mesh, reference, nodes, components, f"{key}.ties.{i}")
    for i, support in enumerate(config.supports):
        with blame(f"{key}.supports.{i}"):
            nodes = nodes_at(mesh, support.node, support.set)
            if support.stiffness is None:
                mesh = with_support(mesh, nodes, _components(support.components))
            else:
                springs = _springs(mesh, f"{key}.supports.{i}", support, nodes)
                mesh = replace(mesh, springs=(*mesh.springs, springs))
    for name, added in config.point_masses.items():
        with blame(f"{key}.point_masses.{name}"):
            mesh = with_mass(mesh, nodes_at(mesh, added.node, added.set), added.mass)
    return without_held(mesh)


def _springs(mesh: Mesh, name: str, support: Support, nodes: np.ndarray) -> Springs:
    k = np.zeros(6)
    if isinstance(support.stiffness, tuple):
        k[:3] = support.stiffness
    else:
        k[list(_components(support.components))] = support.stiffness
    if support.set in mesh.faces:
        return face_springs(mesh, name, str(support.set), k[:3].tolist())
    return node_springs(name, nodes, k.tolist())


def _pick(face: Face) -> Pick:
    near = face.near or ()
    points = near if not near or isinstance(near[0], tuple) else (near,)
    return Pick(points, face.normal, face.angle, face.box, face.radius)


@contextmanager
def _config_ties(mesh: Mesh, key: str) -> Iterator[None]:
    """Assign errors about ties of the config to their config key."""
    named = [(e.id, e.name) for e in mesh.rigid] + [(e.id, e.name) for e in mesh.averaging]
    keys = {("tie", number): name for number, name in named if name.startswith(f"{key}.ties.")}
    try:
        yield
    except DeckError as error:
        if error.key is None and error.entity in keys:
            error.key, error.entity = keys[error.entity], None
        raise


def _components(numbers: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(sorted({number - 1 for number in numbers}))


def _assigned_section(entry: ElementSection) -> GivenSection:
    regions = None if entry.regions == "all" else entry.regions
    if entry.thickness is not None:
        return GivenSection(regions, ShellSection(entry.thickness), entry.offset)
    yy, zz, yz = (*(entry.second_moments or (0.0, 0.0)), 0.0)[:3]
    half = [(-0.5 * side, 0.5 * side) for side in entry.size or ()]
    section = BeamSection(
        float(entry.area or 0.0),  # area or thickness is required by the config
        np.array([[yy, yz], [yz, zz]]),
        entry.torsion or 0.0,
        points=np.array(list(product(*half)) if half else np.zeros((0, 2))),
    )
    return GivenSection(regions, section, direction=entry.direction)


def contact_warnings(config: PlacementConfig, mesh: Mesh, facets: Facets, faces: Faces) -> Iterator[str]:
    """Warnings about faces that are probably in contact but admissible for gauges, with the exclusion for the config."""
    gauges = config.gauges
    if gauges.strain_operator is not None:
        return
    free = np.zeros(0, dtype=int)
    with suppress(InfeasibleError):  # no facet at all: reported by `train`
        free, _, _ = admissible(mesh, facets, **sites_of(gauges))
    contact = contact_faces(mesh, facets, faces)
    named = {name: {*facet_key(*face.T).tolist()} for name, face in mesh.faces.items()}
    for i, face in enumerate(contact.face):
        if not (faces.of[free] == face).any():
            continue
        keys = {*facets.key[faces.of == face].tolist()}
        name = next((name for name, its in named.items() if its == keys), "")
        lines = [f"gauges.exclude: [{name or 'seat'}]"]
        if not name:
            lines.insert(0, f"mesh.faces: {{seat: {{{pointed_at(int(face), faces, mesh.position, facets)}}}}}")
        yield (
            f"the flat face of {faces.area[face]:.3g} m² at {_point(faces.centre[face])} has {contact.support_in_words(i)}. If "
            f"it is a contact face, exclude it from gauges by {' and '.join(lines)}"
        )


def held_below(mesh: Mesh, facets: Facets, grids: Candidates) -> tuple[str, ...]:
    """Describe the contact face below every grid (g,), "" for grids on other faces; facets: exterior facets."""
    faces = faces_of(mesh.position, facets)
    contact = contact_faces(mesh, facets, faces)
    of = dict(zip(facets.key.tolist(), faces.of.tolist(), strict=True))
    words = {
        int(face): f"the face at {_point(faces.centre[face])} has {contact.support_in_words(i)}"
        for i, face in enumerate(contact.face)
    }
    return tuple(words.get(of.get(key, -1), "") for key in facet_key(grids.element, grids.facet).tolist())


def _point(x: np.ndarray) -> str:
    return "({:.3g}, {:.3g}, {:.3g}) m".format(*(x.round(6) + 0.0))
