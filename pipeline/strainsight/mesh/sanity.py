"""Sanity checks of a mesh: what is more likely a mistake than meant, though it can be computed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from strainsight.mesh.anisotropic import Anisotropic
from strainsight.mesh.joins import Relation, Springs
from strainsight.mesh.model import FloatArray, IntArray, Material, Mesh
from strainsight.mesh.thin import BeamSection, GeneralShell, Laminate, ShellBlock, ShellSection, concatenate
from strainsight.mesh.units import LIKELY_DENSITY, likely_units, mixed_units

FOIL = 5e-5
"""[m] What is thinner is no shell that gauges are bonded on."""
SIDES = 10.0
"""Sides of its elements that a shell may be thick."""
LEVER = 10.0
"""Thicknesses that the middle of a shell may lie off its nodes."""
TORSION = 1.5
"""J over the polar moment of area: at most 1 of any section, more where a G of its own is taken into J."""
STIFF = 1e8
"""Stiffness of a spring over E L of the structure, L its length, beyond which the digits of the structure are lost."""
UNITS = "lengths of a deck are in mesh.length_unit, those of mesh.sections in m"


def section_warnings(mesh: Mesh) -> list[str]:
    """Of every region of shells and beams, of springs, and of shells that are turned against each other."""
    found = [text for number in mesh.sections for text in _of_section(mesh, number)]
    return [*found, *_far_beams(mesh), *_stiff_springs(mesh), *_turned_shells(mesh)]


def _of_section(mesh: Mesh, number: int) -> Iterator[str]:
    section, name = mesh.sections[number], str(mesh.regions[number])
    if isinstance(section, BeamSection):
        yield from _of_beam(mesh, number, section)
        return
    shells = [(block, block.region == number) for block in mesh.shells]
    nodes = concatenate(block.corners[own].ravel() for block, own in shells)
    if not len(nodes):
        return
    t, long = section.thickness, _length(mesh, nodes)
    side = float(np.median(np.concatenate([_sides(mesh, block, own) for block, own in shells])))
    if t < FOIL:
        yield f"{name} is {t:.3g} m thick, thinner than {FOIL:g} m: {UNITS}"
    elif t > long or t > SIDES * side:
        yield f"{name} is {t:.3g} m thick and {long:.3g} m long, of elements of {side:.3g} m: {UNITS}"
    lever = max(float(np.abs(block.offset[own]).max(initial=0.0)) for block, own in shells)
    if lever > LEVER * t:
        yield f"{name} lies up to {lever:.3g} m off its nodes (offset), {lever / t:.3g} times its thickness: {UNITS}"
    if isinstance(section, ShellSection) and section.bending == 0:
        yield f"{name} has no stiffness in bending: it is a membrane (a PSHELL without MID2), and gives way across itself"
    if isinstance(section, GeneralShell) and not section.bending.any():
        yield f"{name} has no stiffness in bending: it is a membrane, and gives way across itself"
    if isinstance(section, Laminate):
        turned = {abs(ply.angle) for ply in section.plies} - {0.0}
        if (
            turned
            and max(turned) <= np.pi / 2 + 0.01
            and turned & {round(a, k) for a in _RADIANS for k in (2, 3, 4, 5)}
        ):
            yield f"{name} has plies at {', '.join(f'{a:g}°' for a in sorted(turned))}: angles are in degrees, not in radians"


_RADIANS = (np.pi / 6, np.pi / 4, np.pi / 3, np.pi / 2)
"""30, 45, 60 and 90 degrees."""


def _of_beam(mesh: Mesh, number: int, section: BeamSection) -> Iterator[str]:
    """A section of area A has ∫ r² dA ≥ A²/2π, that of a circle, J ≤ ∫ r² dA, and a radius of gyration below the length of
    the structure: a stub may be shorter."""
    name = str(mesh.regions[number])
    own = [block.nodes[block.region == number].ravel() for block in mesh.beams if block.kind != "rod"]
    nodes = concatenate(own)
    if not len(nodes):
        return
    long = _length(mesh, mesh.nodes_of_elements)
    for end, own_end in (("", section), (" at its end B", section.at_b)):
        if own_end is None:
            continue
        A, J, polar = own_end.area, own_end.torsion, float(np.trace(own_end.second))
        if polar == 0 or A == 0:
            continue
        if polar < (1 - 1e-3) * A**2 / (2 * np.pi):
            yield (
                f"{name}{end}: I1 + I2 = {polar:.3g} m⁴ is less than a circle of its area has, A²/2π = "
                f"{A**2 / (2 * np.pi):.3g} m⁴, and no section is below that: are A = {A:.3g} m² and these in one unit?"
            )
        elif np.sqrt(polar / A) > long:
            yield (
                f"{name}{end}: its radius of gyration √((I1 + I2)/A) is {np.sqrt(polar / A):.3g} m, and the structure is "
                f"{long:.3g} m long: are area and moments of area swapped, or in another unit?"
            )
        if J == 0 and _can_twist(mesh, number):
            yield f"{name}{end} does not resist torsion: J is 0 or blank"
        elif TORSION * polar < J:
            yield f"{name}{end}: J = {J:.3g} m⁴ is more than I1 + I2 = {polar:.3g} m⁴, which no section has"


def _can_twist(mesh: Mesh, number: int) -> bool:
    """Whether an end of some beam of a region may turn about the beam: in a plane frame supports hold all that would."""
    held = np.zeros((len(mesh.position), 6), dtype=bool)
    held[mesh.fixed[:, 0], mesh.fixed[:, 1]] = True
    turned = list(mesh.axes)
    held[turned] = held[turned, 3:].all(axis=1, keepdims=True)  # along axes of their own
    for block in mesh.beams:
        ends = block.nodes[block.region == number][:, :2]
        along = np.abs(mesh.position[ends[:, 1]] - mesh.position[ends[:, 0]])
        felt = along > 1e-6 * along.max(axis=1, keepdims=True)
        if (felt[:, None] & ~held[ends][:, :, 3:]).any():
            return True
    return False


def _far_beams(mesh: Mesh) -> Iterator[str]:
    own = mesh.nodes_of_elements
    for block in mesh.beams:
        lever = np.linalg.norm(block.offset, axis=2).max(axis=1)
        if len(lever) and lever.max() > _length(mesh, own):
            worst = int(np.argmax(lever))
            yield (
                f"element {block.ids[worst]} ({block.kind}) lies {lever[worst]:.3g} m off its nodes (offset), and the structure "
                f"is {_length(mesh, own):.3g} m long: {UNITS}"
            )


def _stiff_springs(mesh: Mesh) -> Iterator[str]:
    E = [own.youngs_modulus for own in mesh.materials.values()] + [own.e1 for own in mesh.laminae.values()]
    if not E or not len(mesh.nodes_of_elements):
        return
    long = _length(mesh, mesh.nodes_of_elements)
    for own in mesh.springs:
        for turns, unit, power in ((False, "N/m", 1), (True, "N m/rad", 3)):
            k = float(own.stiffness[own.torsion == turns].max(initial=0.0))
            if k > STIFF * max(E) * long**power:
                yield (
                    f"{own} has {k:.3g} {unit}, {k / (max(E) * long**power):.2g} times E L{'³' * turns} of the structure: its "
                    "digits are lost beside that; hold the motion (SPC), or tie it (RBE2)"
                )


def _turned_shells(mesh: Mesh) -> list[str]:
    """Neighbours of one region whose normals point to opposite sides: they run along their common side the same way. Where parts
    meet at a corner, as a web and a skin, each has its own."""
    ids, regions, ends = [], [], []
    for block in mesh.shells:
        ring = np.stack([block.corners, np.roll(block.corners, -1, axis=1)], axis=2)
        ids.append(np.repeat(block.ids, ring.shape[1]))
        regions.append(np.repeat(block.region, ring.shape[1]))
        ends.append(ring.reshape(-1, 2))
    if not ids:
        return []
    element, region, pair = np.concatenate(ids), np.concatenate(regions), np.concatenate(ends)
    _, side, count = np.unique(np.sort(pair, axis=1), axis=0, return_inverse=True, return_counts=True)
    side = side.ravel()
    order = np.argsort(side, kind="stable")
    order = order[count[side[order]] == 2].reshape(-1, 2)
    same = order[(pair[order[:, 0], 0] == pair[order[:, 1], 0]) & (region[order[:, 0]] == region[order[:, 1]])]
    if not len(same):
        return []
    a, b = element[same[0]].tolist()
    return [
        f"normals of shells change sides at {len(same)} of their common sides, as between elements {a} and {b}: upper and lower "
        "face, offsets, the order of plies and pressures change with them; number their nodes the same way round"
    ]


def _length(mesh: Mesh, nodes: IntArray) -> float:
    return float(np.linalg.norm(np.ptp(mesh.position[nodes], axis=0)))


def _sides(mesh: Mesh, block: ShellBlock, own: np.ndarray) -> FloatArray:
    x = mesh.position[block.corners[own]]
    return np.asarray(np.linalg.norm(x - np.roll(x, -1, axis=1), axis=2).min(axis=1))


MODULUS = (1e5, 1e13)
"""[Pa], from soft foam to ten times diamond."""
DENSITY = (10.0, 1e5)
"""[kg/m³], from light foam to four times osmium. Steel in t/mm³ that is read as kg/mm³ has 7.85: its modulus is off as much,
so that the speed of sound does not show it."""
EXTENT = (1e-3, 100.0)
"""[m], from a crystal to a rotor blade: what is tested with strain gauges."""
WAVE_SPEED = (10.0, 2.5e4)
"""√(E/ρ) [m/s], from soft rubber to beyond diamond: whatever the material, a modulus and a density that fit each other."""
LOCKING = 0.495
"""Poisson's ratio of solids above which elements without pressure of their own are much too stiff; rubber is taken at 0.49."""
SHEAR_EXCESS = 2.0
"""How many times too stiff in shear across its layers a composite solid may be without a warning."""
GRAVITY = 9.80665
METAL = 1e10
"""[Pa] What is stiffer is no mass that is smeared over something soft."""


def unused_nodes(mesh: Mesh) -> IntArray:
    """Indices of the nodes that no element, rigid or averaging element, relation, mass, spring or support refers to."""
    used = attached(mesh)
    used[[point.node for point in mesh.point_masses]] = True
    return np.flatnonzero(~used)


def without_loose_masses(mesh: Mesh) -> Mesh:
    """The mesh without point masses on nodes that nothing else refers to, which move nothing; and a note on them."""
    held = attached(mesh)
    loose = [point for point in mesh.point_masses if not held[point.node]]
    if not loose:
        return mesh
    shown = ", ".join(str(mesh.node_ids[point.node]) for point in loose[:5]) + (", …" if len(loose) > 5 else "")
    some = f"{len(loose)} point masses" if len(loose) > 1 else "a point mass"
    note = (
        f"{some} of {sum(point.mass for point in loose):.4g} kg on nodes that no element, tie, spring or support holds, left "
        f"out: node {shown}"
    )
    kept = tuple(point for point in mesh.point_masses if held[point.node])
    return replace(mesh, point_masses=kept, notes=(*mesh.notes, note))


def attached(mesh: Mesh) -> NDArray[np.bool_]:
    """Nodes (n,) that an element, tie, spring or support refers to."""
    used = np.zeros(len(mesh.node_ids), dtype=bool)
    used[mesh.arms[:, 0]] = True
    for block in mesh.elements:
        used[block.nodes] = True
    for tie in mesh.ties:
        used[tie.nodes] = used[tie.reference] = True
    joints: tuple[Relation | Springs, ...] = (*mesh.relations, *mesh.springs)
    for joined in joints:
        used[joined.node] = True
    used[mesh.fixed[:, 0]] = True
    return used


def size_of(mesh: Mesh) -> float:
    """Diagonal of the box about all elements, of a mesh without elements about all nodes [m]."""
    nodes = [block.nodes.ravel() for block in mesh.elements] or [np.arange(len(mesh.node_ids))]
    return float(np.linalg.norm(np.ptp(mesh.position[np.concatenate(nodes)], axis=0)))


def empty_regions(mesh: Mesh) -> tuple[int, ...]:
    """Ids of the regions that no element belongs to."""
    filled = {int(i) for block in mesh.elements for i in np.unique(block.region)}
    return tuple(i for i in mesh.regions if i not in filled)


def sanity_warnings(mesh: Mesh, length_unit: str = "m", mass_unit: str = "kg", free: bool = False) -> tuple[str, ...]:
    """Warnings: values that speak of a wrong unit, what is not used, what the file has and this model lacks.

    length_unit and mass_unit: those that the mesh was converted from, to say which others would make sense; free: nothing
    has to hold it.
    """
    found = list(leading_warnings(mesh))
    found += mesh.doubts
    for material in mesh.materials.values():
        found += _ratio_warnings(mesh, material)
    general = {number: own for number, own in mesh.sections.items() if isinstance(own, GeneralShell)}
    constants = [(str(own), own.youngs_modulus, own.density, False) for own in mesh.materials.values()]
    constants += [(str(own), own.e1, own.density, True) for own in mesh.laminae.values()]
    constants += [(str(mesh.regions[number]), own.modulus, own.density, False) for number, own in general.items()]
    constants += [(str(own), max(own.moduli), own.density, True) for own in mesh.anisotropic.values()]
    for name, E, rho, ply in constants:
        found += _material_warnings(name, E, rho, length_unit, mass_unit, ply)
    found += _stiff_cores(mesh)
    found += section_warnings(mesh)
    extent = float(np.max(np.ptp(mesh.position, axis=0)))
    found += _outside("the structure's extent", extent, EXTENT, "m", "check mesh.length_unit")
    found += _far_references(mesh)
    if (unused := unused_nodes(mesh)).size:
        shown = ", ".join(str(mesh.node_ids[i]) for i in unused[:5]) + (", …" if unused.size > 5 else "")
        words = "nodes belong to nothing and are" if unused.size > 1 else "node belongs to nothing and is"
        found.append(f"{unused.size} {words} left out of the model: {shown}")
    found += [f"{mesh.regions[i]} has no elements" for i in empty_regions(mesh)]
    grounded = any(len(own.node) == 1 for own in mesh.relations)
    if not mesh.held.size and not mesh.springs and not grounded and not free:
        found.append(
            "nothing is fixed: hold it, let it be free (mesh.free), or hang it on soft springs (mesh.supports, stiffness)"
        )
    return tuple(found)


def leading_warnings(mesh: Mesh) -> tuple[str, ...]:
    """What makes the model another structure than the deck's: contact that is bonded or open, and cards that are not used."""
    ignored = ignored_structure(mesh).items()
    return (*mesh.contacts, *(f"{count} × {card} ignored: {lost(card)}" for card, count in ignored))


def ignored_structure(mesh: Mesh) -> dict[str, int]:
    """Cards that may add stiffness, mass or a tie and are not used, with their count."""
    return {card: count for card, count in mesh.ignored.items() if mesh.effect.get(card) == "structure"}


def lost(card: str) -> str:
    """What a model lacks without a card."""
    if card.startswith("PRELOAD"):
        said = "the deck asks for modes under a preload, and the stiffness is that of the part without load"
        return (
            f"{said}: CalculiX counts the loads of the step before, Abaqus asks for NLGEOM there"
            if "PERTURB" in card
            else said
        )
    if card.endswith(("NLGEOM", "LGDISP", "TYPE=STRESS")):
        return "the stiffness is that of the part without load, and not that under the preload of this step"
    if card.startswith("ENFORCED DISPLACEMENT"):
        if card.endswith("DISPLACEMENT"):
            return "what moves there is free"
        return (
            "the motion is held at zero, as in a frequency analysis; if the test pushes there with a force, free it with "
            "mesh.ignore: [ENFORCED DISPLACEMENT]"
        )
    if card.endswith("INREL"):
        return "inertia relief is asked for with mesh.free: true"
    if card.endswith("COUPMASS"):
        return (
            "it asks for lumped mass, and beside shells and beams mass is consistent here, as with PARAM,COUPMASS,1: frequencies "
            "of two coarse meshes of tet10 were 9 and 23 % apart for it"
        )
    return "the stiffness, mass or tie it may add is missing"


def _ratio_warnings(mesh: Mesh, material: Material) -> list[str]:
    """Of a Poisson's ratio that locks solids, or is negative, as one of a wrong shear modulus is."""
    nu = material.poisson_ratio
    if nu < 0:
        return [
            f"{material}: Poisson's ratio is {nu:.4g}: it widens where it is pulled. If E and G state it, ν = E/2G − 1, G is "
            "not that of the material: a metal has G of 0.38 to 0.4 E"
        ]
    if nu > LOCKING and any(
        material in (mesh.material_of(int(region)), *mesh.layer_materials(int(region)))
        for block in mesh.blocks
        for region in np.unique(block.region)
    ):
        return [
            f"{material}: Poisson's ratio is {nu:.10g}: elements of displacements alone lock where a solid hardly changes its "
            f"volume (K/G is {2 * (1 + nu) / (3 * (1 - 2 * nu)):.3g}); give at most {LOCKING:g}"
        ]
    return []


def _stiff_cores(mesh: Mesh) -> list[str]:
    """Composite solids with a soft core: within an element all layers have one strain of shear across, in place of one stress, so
    that it resists with Σ sG where layers of their own would with 1/Σ(s/G), s their shares."""
    found = []
    for number, composite in mesh.composites.items():
        G = np.array([np.nan if own is None else _shear_modulus(own) for own in mesh.layer_materials(number)])
        excess = float((composite.shares @ G) * (composite.shares @ (1 / G)))
        if excess > SHEAR_EXCESS:
            found.append(
                f"{mesh.regions[number]} has layers whose shear moduli lie {G.max() / G.min():.3g} times apart: its elements are "
                f"up to {excess:.3g} times too stiff in shear across the layers; where that matters (thick, or a soft core), "
                "mesh the core and its skins with elements of their own"
            )
    return found


def _shear_modulus(own: Anisotropic | Material) -> float:
    """G [Pa], of an anisotropic material the mean of three."""
    if isinstance(own, Anisotropic):
        return float(np.diagonal(own.stiffness)[3:].mean())
    return own.youngs_modulus / (2 * (1 + own.poisson_ratio))


def _far_references(mesh: Mesh) -> list[str]:
    """Reference nodes that lie farther from the nodes of their tie than three times the size of the structure."""
    if not mesh.elements:
        return []
    size = size_of(mesh)
    of = "elements" if mesh.shells or mesh.beams else "solids"
    found = []
    for tie in mesh.ties:
        distance = float(np.linalg.norm(mesh.position[tie.nodes] - mesh.position[tie.reference], axis=1).min())
        if distance > 3 * size:
            found.append(
                f"node {mesh.node_ids[tie.reference]} of {tie} lies {distance:.3g} m from its nodes, the {of} are {size:.3g} m "
                "long: positions in the config are in m, whatever the unit of the file"
            )
    return found


def _material_warnings(
    name: str, E: float, rho: float, length_unit: str, mass_unit: str, ply: bool = False
) -> list[str]:
    """Of a modulus [Pa] and a density [kg/m³] that no material has; ply: E along the fibres of a composite."""
    in_config = name.startswith("mesh.materials.")
    if in_config:
        length_unit, mass_unit = "m", "kg"
    remedy = "values of the config are in Pa and kg/m³" if in_config else likely_units(E, rho, length_unit, mass_unit)
    found = _outside(f"{name}: Young's modulus", E, MODULUS, "Pa", remedy)
    if rho == 0:
        return [*found, f"{name} has no density: it adds stiffness and no mass"]
    found += _outside(f"{name}: density", rho, DENSITY, "kg/m³", remedy)
    if not found and rho > LIKELY_DENSITY[1] and E > METAL:
        found = [
            f"{name}: density is {rho:.3g} kg/m³, and no metal has more than {LIKELY_DENSITY[1]:g}: a weight per volume over g "
            f"would be {rho / GRAVITY:.4g} kg/m³ (PARAM,WTMASS): check the deck"
        ]
    if not found and (mixed := mixed_units(E, rho, length_unit, mass_unit, ply)):
        found = [
            f"{name}: Young's modulus is {E:.3g} Pa and density {rho:.4g} kg/m³: {mixed}{f'; {remedy}' * in_config}"
        ]
    if not found:
        found = _outside(f"{name}: the speed of sound √(E/ρ)", float(np.sqrt(E / rho)), WAVE_SPEED, "m/s", remedy)
    return found


def _outside(what: str, value: float, limits: tuple[float, float], unit: str, remedy: str) -> list[str]:
    low, high = limits
    if low <= value <= high:
        return []
    return [f"{what} is {value:.3g} {unit}, outside {low:g} to {high:g}: {remedy}"]
