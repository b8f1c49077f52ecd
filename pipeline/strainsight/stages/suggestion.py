"""Properties of a deck for the config of `strainsight init`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import ValidationError

from strainsight.config.checks import problems
from strainsight.config.deck_properties import CandidateLocation, MissingMaterial, Suggestion
from strainsight.config.gauge_types import fitting_type
from strainsight.config.placement import PlacementConfig
from strainsight.config.yaml_text import parse
from strainsight.decks.faults import MISSING_END, short
from strainsight.decks.reader import format_of, read_mesh
from strainsight.errors import ChoiceError, ContactError, StrainsightError, UserError
from strainsight.experiment.structure.mesh import free_motions, mesh_of
from strainsight.experiment.structure.reduction import modes_of
from strainsight.experiment.structure.references import without_surface
from strainsight.experiment.system import silent
from strainsight.mesh.anisotropic import Anisotropic
from strainsight.mesh.assigned_sections import GivenSection
from strainsight.mesh.facets import Facets, exterior_facets
from strainsight.mesh.joins import AveragingElement, BodyForce, RigidElement
from strainsight.mesh.model import Mesh
from strainsight.mesh.properties import without_modulus
from strainsight.mesh.thin import GeneralShell, Lamina, ShellSection
from strainsight.mesh.thin_faces import with_faces, with_sides
from strainsight.mesh.units import to_si, usual_units
from strainsight.runner.stage import Context
from strainsight.sensors.access import contact_faces
from strainsight.sensors.faces import Faces, Pick, faces_of, picked, pointed_at
from strainsight.stages.import_mesh import looked_at
from strainsight.text import listed

CHOICES: tuple[Literal["bonded", "open"], ...] = ("bonded", "open")


def suggestion(path: Path, chosen: int | None = None) -> Suggestion:
    """Suitable units, largest region, missing data, and possible locations of loads and supports.
    chosen: active support set or step of a deck that does not select one; default: the first. Raises DeckError for an unreadable
    deck."""
    sets: tuple[int, ...] = ()
    key: Literal["spc", "step"] = "spc"
    by_which = ""
    contact: Literal["bonded", "open"] | None = None
    pairs: tuple[str, ...] = ()
    mesh, spc, step = None, None, None
    while mesh is None:
        try:  # in the deck's own numbers
            mesh = read_mesh(
                path, solids=False, materials=False, ignore=(MISSING_END,), spc=spc, step=step, contact=contact
            )
        except ContactError as error:
            contact, pairs = _contact(path, step), error.choices
        except ChoiceError as error:
            sets, key = error.choices, "step" if error.key == "step" else "spc"
            number = sets[0] if chosen is None else chosen
            by_which = f", supports of {'SPC set' if key == 'spc' else 'step'} {number}"
            spc, step = (number, step) if key == "spc" else (spc, number)
    mesh, thin = (mesh, ()) if mesh.elements else _shells(path, mesh)
    count = {number: sum(int(np.sum(b.region == number)) for b in mesh.elements) for number in mesh.regions}
    region = max(count, key=lambda number: count[number]) if count else 1
    material = mesh.material_of(region) if count else None
    stiff = _modulus_and_density(mesh, region) if count else None
    large = np.ptp(mesh.position, axis=0).max(initial=0.0) > 20  # tens of metres: the unit is probably the millimetre
    units = usual_units(*stiff) if stiff else ("mm", "t") if large else ("m", "kg")
    converted = to_si(mesh, *units) if units else mesh
    if not thin:  # faces of shells whose thickness nobody has said lie nowhere yet
        converted = with_sides(with_faces(converted))
    facets = exterior_facets(converted) if converted.has_surface and not thin else None
    faces = None if facets is None else faces_of(converted.position, facets)
    return Suggestion(
        *(units or ("", "")),
        odd=f"E = {stiff[0]:.4g} and ρ = {stiff[1]:.4g} are implausible in all common units"
        if stiff and not units
        else "",
        region=region,
        several_moduli=bool(count) and bool(without_modulus(mesh, region)),
        youngs_modulus=converted.materials[material.id].youngs_modulus if material and units else None,
        lacking=tuple(_lacking(converted)),
        supports=len(mesh.held) > 0,
        no_surface="" if converted.has_surface else "{0.what}. {0.remedy}".format(without_surface(converted)),
        places=tuple(_places(converted, facets, faces, by_which)) if units else (),
        support_sets=sets,
        support_key=key,
        unsupported=tuple(
            (short(card), mesh.ignored[card], where.rpartition("/")[2]) for card, where in mesh.unsupported.items()
        ),
        set_names=(*mesh.node_sets, *mesh.element_sets),
        gauge_type=fitting_type(float(np.sqrt(faces.area.max()))) if units and faces is not None else None,
        thin=thin,
        contact=contact,
        pairs=pairs,
        matrices=all(path.with_suffix(ending).is_file() for ending in (".sti", ".mas", ".dof")),
        nodes=len(mesh.position),
        facets=0 if facets is None else len(facets.nodes),
        face_at=str if facets is None or faces is None else _face_at(converted, facets, faces),
        facts=tuple(_facts(converted)) if units else (),
    )


def _facts(mesh: Mesh) -> Iterator[tuple[str, str]]:
    """Size, elements, materials and supports in words."""
    size = " × ".join(f"{1000 * length:.4g}" for length in np.ptp(mesh.position[: mesh.own_nodes], axis=0))
    yield "size", f"{size} mm"
    kinds = ", ".join(f"{len(block.ids)} {block.kind}" for block in mesh.elements)
    yield "elements", ", ".join(part for part in (f"{mesh.own_nodes} nodes", kinds) if part)
    for material in mesh.materials.values():
        regions = [region.name for region in mesh.regions.values() if region.material == material.id]
        values = f"E {1e-9 * material.youngs_modulus:.4g} GPa, ν {material.poisson_ratio:g}"
        density = "" if material.density is None else f", ρ {material.density:.4g} kg/m³"
        if regions:
            yield f"material {material.id}", f"{values}{density}: {listed(regions[:4])}{', …' * (len(regions) > 4)}"
    held = np.unique(mesh.held)
    yield "supports", f"{held.size} nodes, {_centre(mesh, held)}" if held.size else "none"


def _centre(mesh: Mesh, nodes: np.ndarray) -> str:
    """Position of a node, or the centre of several."""
    x = ", ".join(f"{x:.4g}" for x in (1000 * mesh.position[nodes].mean(axis=0)).round(3) + 0.0)
    return f"{'centre ' * (len(nodes) > 1)}({x}) mm"


def _load_place(mesh: Mesh, nodes: np.ndarray) -> str:
    """Node, set with exactly these nodes, or number of nodes, and their centre."""
    ids = {*mesh.node_ids[nodes].tolist()}
    sets = (name for name, members in mesh.node_sets.items() if {*np.asarray(members).tolist()} == ids)
    name = f"node {min(ids)}" if len(ids) == 1 else next((f"set {name}" for name in sets), f"{len(ids)} nodes")
    return f"{name}, {_centre(mesh, nodes)}"


def _deck_loads(mesh: Mesh, is_supported: np.ndarray) -> Iterator[CandidateLocation]:
    """Loads of the deck with size, direction and place."""
    for name, load in mesh.loads.items():
        total, moment = load.force.sum(axis=0), load.moment
        force = float(np.linalg.norm(total))
        if force > 1e-9 * np.abs(load.force).sum():
            loaded = load.nodes[load.force.any(axis=1)]
            what = f"{force:.4g} N along {_unit(total)} at {_load_place(mesh, loaded)}"
            yield CandidateLocation("deck_load", name, what, bool(is_supported[loaded].all()), force)
        elif load.body:
            yield CandidateLocation("deck_load", name, _of_mass(load.body), force=1.0, factor=True, body=True)
        elif len(load.nodes):
            arm = mesh.position[load.nodes] - mesh.position[load.nodes].mean(axis=0)
            couple = np.cross(arm, load.force).sum(axis=0) + (0.0 if moment is None else moment.sum(axis=0))
            size = float(np.linalg.norm(couple))
            what = f"{size:.4g} N m about {_unit(couple)}" if size else "forces without resultant"
            what = f"{what} at {_load_place(mesh, load.nodes)}"
            yield CandidateLocation("deck_load", name, what, bool(is_supported[load.nodes].all()), 1.0, factor=True)


COUNT = 3
"""Number of natural frequencies."""


def first_frequencies(text: str, folder: Path) -> tuple[float, ...]:
    """Lowest natural frequencies [Hz] of the model in the text of a config; folder: that of the config.

    Raises UserError for blank lines in `mesh`, and the errors of the stages import and modes."""
    data = {key: value for key, value in parse(text).data.items() if key in ("kind", "name", "mesh")}
    try:
        config = PlacementConfig.model_validate_json(json.dumps(data | {"rom": {"modes": COUNT}}))
    except ValidationError:
        config = None
    if config is None or list(problems(config)):
        raise UserError("the section `mesh` has blank lines")
    path = folder / config.mesh.file
    mesh = mesh_of(config.mesh, path, base=folder)
    looked_at(config, mesh)
    context = Context(config, {}, {"mesh.file": path}, silent)
    return tuple(modes_of(config, mesh, context).frequency.tolist())


def _contact(path: Path, step: int | None) -> Literal["bonded", "open"]:
    """Open, as CalculiX has contact in a frequency analysis, unless something moves freely then, and less of it when bonded."""
    left: dict[str, int] = {}
    for choice in CHOICES:
        try:
            left[choice] = len(free_motions(read_mesh(path, solids=False, materials=False, step=step, contact=choice)))
        except StrainsightError:  # `import` reports the fault
            continue
    return "bonded" if left.get("bonded", 0) < left.get("open", 0) else "open"


def _shells(path: Path, mesh: Mesh) -> tuple[Mesh, tuple[str, ...]]:
    """A file of triangles and quadrangles alone, as shells of any thickness, and the names of their regions."""
    if format_of(path) in ("nastran", "abaqus"):
        return mesh, ()
    try:
        shells = read_mesh(path, solids=False, sections={"mesh.sections.shells": GivenSection(None, ShellSection(1.0))})
    except UserError:  # without shells, or with quadratic ones: `import` reports it
        return mesh, ()
    return shells, tuple(region.name for region in shells.regions.values())


def _face_at(mesh: Mesh, facets: Facets, faces: Faces) -> Callable[[str], str]:
    def at(point: str) -> str:
        try:
            facet = picked(Pick(near=(json.loads(point),)), faces, mesh.position, facets)[0]
        except UserError:  # `import` names what is wrong with it
            return point
        return faces.near(int(faces.of[facet]))

    return at


def _modulus_and_density(mesh: Mesh, region: int) -> tuple[float, float] | None:
    """E and ρ of a region, of a laminate or composite solid those of its first ply, along it, of an anisotropic one its largest;
    None where the deck has no material."""
    if (shell := mesh.general_shell(region)) is not None:
        return shell.modulus, shell.density
    if (solid := mesh.anisotropic_of(region)) is not None:
        return max(solid.moduli), solid.density
    first = (*mesh.ply_materials(region), *mesh.layer_materials(region), mesh.material_of(region))[0]
    if first is None:
        return None
    if isinstance(first, Anisotropic):
        return max(first.moduli), first.density
    return (first.e1 if isinstance(first, Lamina) else first.youngs_modulus), first.density


def _lacking(mesh: Mesh) -> Iterator[MissingMaterial]:
    """Regions without a material, and in a deck without mass those of each material."""
    of = {number: region.material for number, region in mesh.regions.items()}
    plies = {number for number in of if mesh.laminate(number) is not None or mesh.general_shell(number) is not None}
    plies |= {*mesh.composites}
    known = {*mesh.materials, *mesh.anisotropic}
    if without := tuple(i for i, material in of.items() if material not in known and i not in plies):
        yield MissingMaterial(without)
    shells = [section for section in mesh.sections.values() if isinstance(section, GeneralShell)]
    materials = (*mesh.materials.values(), *mesh.laminae.values(), *mesh.anisotropic.values(), *shells)
    massless = not mesh.point_masses and not any(getattr(material, "density", None) for material in materials)
    for material in dict.fromkeys(of.values()):
        if massless and (elastic := mesh.materials.get(material)):
            regions = tuple(number for number, its in of.items() if its == material and number not in plies)
            yield MissingMaterial(regions, elastic.youngs_modulus, elastic.poisson_ratio)


def _of_mass(pulls: Sequence[BodyForce]) -> str:
    """Load on all mass, in words."""
    words = []
    for pull in pulls:
        if g := float(np.linalg.norm(pull.factor * pull.acceleration)):
            words.append(f"gravity of {g:.4g} m/s² along {_unit(pull.factor * pull.acceleration)}")
        if speed := float(np.linalg.norm(pull.rotation)):
            words.append(f"rotation at {speed:.4g} rad/s about {_unit(pull.rotation)}")
    return f"{', '.join(words) or 'zero load'}, acts on the whole mass"


def _unit(v: np.ndarray) -> str:
    return "(" + ", ".join(f"{round(float(x), 3) + 0.0:g}" for x in v / np.linalg.norm(v)) + ")"


def _places(mesh: Mesh, facets: Facets | None, faces: Faces | None, by_which: str) -> Iterator[CandidateLocation]:
    """Loads of the deck, reference nodes of ties, node sets, faces.
    by_which: support set, in the description of a supported face."""
    is_supported = np.zeros(len(mesh.position), dtype=bool)
    is_supported[mesh.held] = True
    yield from _deck_loads(mesh, is_supported)
    # an average of rotations alone ties a shell to a solid: no load is put there
    ties: list[RigidElement | AveragingElement] = [
        *mesh.rigid,
        *(tie for tie in mesh.averaging if min(tie.components) < 3),
    ]
    for reference in dict.fromkeys(tie.reference for tie in ties):
        led = [tie for tie in ties if tie.reference == reference]
        count, where = sum(len(tie.nodes) for tie in led), _centre(mesh, np.array([reference]))
        what = f"{where}, reference node of {', '.join(map(str, led))}, connected to {count} nodes"
        yield CandidateLocation("node", str(mesh.node_ids[reference]), what, bool(is_supported[reference]))
    for name, ids in mesh.node_sets.items():
        nodes = np.flatnonzero(np.isin(mesh.node_ids[: mesh.own_nodes], ids))
        if nodes.size:
            yield CandidateLocation(
                "set", name, f"{nodes.size} nodes, {_centre(mesh, nodes)}", bool(is_supported[nodes].all())
            )
    if facets is not None and faces is not None:
        supported = np.asarray((is_supported[facets.nodes] | (facets.nodes < 0)).all(axis=1))
        contact = contact_faces(mesh, facets, faces)
        lies_on = {int(face): f"{contact.support_in_words(i)}{by_which}" for i, face in enumerate(contact.face)}
        by = {face: pointed_at(face, faces, mesh.position, facets) for face in lies_on}
        instead = {int(f): faces.near(int(g)) for f, g in zip(contact.face, contact.instead_of, strict=True) if g >= 0}
        for face in range(len(faces.area)):
            on_support = bool(supported[faces.of == face].all())
            what = f"{faces.area[face]:.3g} m², {faces.in_words(face)}"
            yield CandidateLocation(
                "face",
                faces.near(face),
                what,
                on_support,
                lies_on=lies_on.get(face, ""),
                picked=by.get(face, ""),
                instead_of=instead.get(face, ""),
            )
