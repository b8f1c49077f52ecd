"""The mesh of a config: its file, what the config adds, and whether all of it is sound."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from strainsight.config.mesh import ElementSection, Face, Material, MaterialAxes, MeshFile, Support
from strainsight.decks.effects import LINEAR, PRELOAD, short, spelt
from strainsight.decks.numbers import LARGEST_ID
from strainsight.decks.reader import read_mesh
from strainsight.errors import ConfigError, DeckError, UserError, blame
from strainsight.experiment.structure.grounds import grounding_warnings, heavy_points, loose_warnings
from strainsight.fem.body_forces import odd_gravity, with_body_forces
from strainsight.fem.checks import check_geometry, check_mesh
from strainsight.fem.constraints import constraint_transform
from strainsight.fem.hinges import hinge_warnings
from strainsight.fem.mass import mass_properties
from strainsight.fem.mass_product import has_mass
from strainsight.fem.quality import Quality, check_inverted, element_quality
from strainsight.fem.springs import spring_rows
from strainsight.fem.turning import turning_nodes
from strainsight.mesh.additions import (
    node_index,
    node_indices,
    with_anisotropic,
    with_averaging_element,
    with_face,
    with_material,
    with_node,
    with_rigid_element,
    with_support,
)
from strainsight.mesh.anisotropic import Orientation, constants_fault, orthotropic
from strainsight.mesh.beam_sides import with_sides
from strainsight.mesh.connectivity import check_doubled, connectivity_warnings
from strainsight.mesh.coordinates import BASIC, CoordinateSystem
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.given_sections import GivenSection
from strainsight.mesh.joins import Springs
from strainsight.mesh.merging import merged
from strainsight.mesh.model import Mesh
from strainsight.mesh.sanity import leading_warnings, sanity_warnings, without_loose_masses
from strainsight.mesh.shell_faces import with_faces
from strainsight.mesh.surface_ties import with_surface_tie, without_held
from strainsight.mesh.suspension import face_springs, node_springs
from strainsight.mesh.thin import BeamSection, ShellSection
from strainsight.sensors.faces import Pick, faces_of, picked


def mesh_of(
    config: MeshFile,
    path: Path,
    key: str = "mesh",
    base: Path | None = None,
    loads: Collection[str] | None = None,
) -> Mesh:
    """The mesh of a file and of what the config (its section at `key`) says beside it; base: the folder that paths start from;
    loads: names of those of the deck that are used, whose gravity is looked at, None for all."""
    include = [(base or Path()) / name for name in config.include_dirs]
    for folder in include:
        if not folder.is_dir():
            raise ConfigError(
                f"no such folder: {folder}",
                key=f"{key}.include_dirs",
                remedy="name folders that are there; paths start from the folder of the config file",
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
            given=given_sections(config, key),
            include=include,
            contact=config.contact or ("open" if config.matrices or config.results else None),
        )
        if config.matrices is None and config.results is None:
            mesh = _all_supported(mesh, config.ignore)
    mesh = _with_mass(mesh, config, key)
    if config.merge is not None:
        with blame(f"{key}.merge"):
            mesh = merged(mesh, config.merge)
            exterior_facets(mesh)  # so that elements that do not fit together now show here
    # shells and beams that matrices stand for are in them
    mesh = with_sides(with_faces(mesh)) if config.matrices is None else replace(mesh, shells=(), beams=())
    mesh = with_additions(mesh, config, key)
    if config.matrices is None:
        mesh = without_loose_masses(mesh)
    with blame(f"{key}.file"), mesh.located():
        mesh = replace(mesh, doubts=(*mesh.doubts, *odd_gravity(mesh, loads)))
        weighs = config.matrices is None and (config.results is None or has_mass(mesh))
        return with_body_forces(mesh) if weighs else mesh


def _with_mass(mesh: Mesh, config: MeshFile, key: str) -> Mesh:
    """The mesh with the mass of solids that the config chooses, or the deck, and a note where it is lumped."""
    if config.mass == "lumped" and mesh.thin:
        raise ConfigError(
            "the mesh has shells, beams or rods, whose mass is not lumped here",
            key=f"{key}.mass",
            remedy="remove the key: mass is consistent",
        )
    chosen = mesh.lumped if config.mass is None else config.mass == "lumped"
    by = "PARAM,COUPMASS" if config.mass is None else f"{key}.mass"
    note = f"mass of solids is lumped, as {by} says: the diagonal, scaled to the mass of each element"
    return replace(mesh, lumped=chosen, notes=(*mesh.notes, *[note] * chosen))


def _all_supported(mesh: Mesh, ignore: Sequence[str]) -> Mesh:
    """The mesh, with a note on names in `ignore` that the deck does not have. Raises DeckError for elements, ties and loads that
    are not supported and not named there."""
    named = {spelt(card) for card in ignore}
    missing = [card for card in mesh.unsupported if spelt(card) not in named]
    if missing:
        names = ", ".join(dict.fromkeys(map(short, missing)))
        listed = [f"{mesh.ignored[card]} × {_named(card)} (first at {mesh.unsupported[card]})" for card in missing]
        linear = [f"{name} with {LINEAR[name]}" for name in map(short, missing) if name in LINEAR]
        instead = f"mesh {', '.join(linear)}; " if linear else ""
        more = f" and {len(listed) - 6} more kinds" if len(listed) > 6 else ""
        raise DeckError(
            f"not supported, and the model is not the same without: {', '.join(listed[:6])}{more}",
            where=mesh.unsupported[missing[0]],
            remedy=f"{instead}if they do not matter, leave them out: mesh.ignore: [{names}]",
        )
    idle = [card for card in ignore if spelt(card) not in {spelt(own) for own in mesh.ignored}]
    notes = (f"mesh.ignore names {', '.join(idle)}, of which the deck has none",) if idle else ()
    return replace(mesh, notes=(*mesh.notes, *notes))


def _named(card: str) -> str:
    return card if card.startswith(PRELOAD) else short(card)


def checked(
    mesh: Mesh, config: MeshFile, key: str = "mesh"
) -> tuple[tuple[float, np.ndarray] | None, tuple[Quality, ...]]:
    """Mass [kg] with centre (3,) [m], where solids carry the model, and the shapes of the elements, once all is sound."""
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
            # so that ties and supports that contradict each other, and springs on rotations that are not there, show here
            constraint = constraint_transform(mesh, rotations=turning_nodes(mesh))
            spring_rows(mesh, constraint.reference_rows)
        else:
            check_geometry(mesh)
            quality = element_quality(mesh)
        return weight, quality


def model_warnings(mesh: Mesh, length_unit: str = "m", mass_unit: str = "kg", free: bool = False) -> tuple[str, ...]:
    """What is more likely a mistake than meant: cards that change the structure and are not used, what is not joined, what moves
    freely or resists a rigid motion, and the rest of `sanity_warnings`."""
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


def _with_material(mesh: Mesh, own: Material, name: str) -> Mesh:
    regions = None if own.regions == "all" else own.regions
    E, nu, G = own.youngs_modulus, own.poisson_ratio, own.shear_modulus
    if isinstance(E, float) and isinstance(nu, float):
        return with_material(mesh, regions, E, nu, own.density, name)
    assert isinstance(E, tuple)
    assert isinstance(nu, tuple)
    assert G is not None
    if fault := constants_fault(E, nu, G):
        raise UserError(fault[0], key=name, remedy=fault[1])
    stiffness, orientation = orthotropic(E, nu, G), _orientation(own.axes)
    return with_anisotropic(mesh, regions, stiffness, orientation, own.density, name)


def _orientation(axes: MaterialAxes | None) -> Orientation:
    if axes is None:
        return Orientation(BASIC, np.eye(3))
    x, beside = np.array(axes.x), np.array(axes.y)
    z = np.cross(x, beside)
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    directions = np.column_stack([x, np.cross(z, x), z])
    return Orientation(CoordinateSystem(axes.system, np.array(axes.origin), directions), np.eye(3))


def with_additions(mesh: Mesh, config: MeshFile, key: str = "mesh") -> Mesh:
    """The mesh with the materials, ties and supports that the config states beside the file."""
    for name, material in config.materials.items():
        with blame(f"{key}.materials.{name}.regions"):
            mesh = _with_material(mesh, material, f"{key}.materials.{name}")
    if config.faces and not mesh.has_surface:
        raise UserError(
            "the mesh has no solids, shells or sides of beams, and so no faces",
            key=f"{key}.faces",
            remedy="name sets of nodes instead",
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
                what = f"{tie.reference} is too large for the number of a node"
                raise DeckError(what, key=f"{key}.ties.{i}.reference", remedy="give one below 10^12")
            if tie.at is not None:
                mesh = with_node(mesh, tie.reference, tie.at)
            reference = node_index(mesh, tie.reference)
            if tie.type == "rigid":
                mesh = with_rigid_element(
                    mesh, reference, nodes, _components(tie.components or (1, 2, 3)), f"{key}.ties.{i}"
                )
            else:
                components = _components(tie.components or (1, 2, 3, 4, 5, 6))
                mesh = with_averaging_element(mesh, reference, nodes, components, f"{key}.ties.{i}")
    for i, support in enumerate(config.supports):
        with blame(f"{key}.supports.{i}"):
            if support.node is not None:
                nodes = np.array([node_index(mesh, support.node)])
            else:
                nodes = node_indices(mesh, str(support.set))  # the config asks for one of the two
            if support.stiffness is None:
                mesh = with_support(mesh, nodes, _components(support.components))
            else:
                own = _springs(mesh, f"{key}.supports.{i}", support, nodes)
                mesh = replace(mesh, springs=(*mesh.springs, own))
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
    """An error about a tie of the config belongs to its key there, not to a line of the deck."""
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


def given_sections(config: MeshFile, key: str = "mesh") -> dict[str, GivenSection]:
    """Key → section, of the config's section at `key`."""
    return {f"{key}.sections.{name}": _given(own) for name, own in config.sections.items()}


def _given(own: ElementSection) -> GivenSection:
    regions = None if own.regions == "all" else own.regions
    if own.thickness is not None:
        return GivenSection(regions, ShellSection(own.thickness), own.offset)
    yy, zz, yz = (*(own.second_moments or (0.0, 0.0)), 0.0)[:3]
    half = [(-0.5 * side, 0.5 * side) for side in own.size or ()]
    section = BeamSection(
        float(own.area or 0.0),  # the config asks for one of the two
        np.array([[yy, yz], [yz, zz]]),
        own.torsion or 0.0,
        points=np.array(list(product(*half)) if half else np.zeros((0, 2))),
    )
    return GivenSection(regions, section, direction=own.direction)
