"""Sanity checks of a mesh: warnings about values that are probably mistakes."""

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
"""[m] Smallest plausible thickness of a shell with gauges."""
SIDES = 10.0
"""Largest plausible thickness of a shell over the sides of its elements."""
LEVER = 10.0
"""Largest plausible offset of the middle of a shell over its thickness."""
TORSION = 1.5
"""J over the polar moment of area: at most 1 for any section, more if J includes another shear modulus."""
STIFF = 1e8
"""Stiffness of a spring over E L of a structure of length L, above which the structure is lost in rounding."""
UNITS = "Check the unit: lengths of the deck are in mesh.length_unit, lengths of mesh.sections in m."


def _shell_warnings(mesh: Mesh, number: int) -> Iterator[str]:
    section, name = mesh.sections[number], str(mesh.regions[number])
    if isinstance(section, BeamSection):
        yield from _beam_warnings(mesh, number, section)
        return
    shells = [(block, block.region == number) for block in mesh.shells]
    nodes = concatenate(block.corners[selected].ravel() for block, selected in shells)
    if not len(nodes):
        return
    t, long = section.thickness, _length(mesh, nodes)
    side = float(np.median(np.concatenate([_sides(mesh, block, selected) for block, selected in shells])))
    if t < FOIL:
        yield f"{name} is {t:.3g} m thick, thinner than {FOIL:g} m. {UNITS}"
    elif t > long or t > SIDES * side:
        yield f"{name} is {t:.3g} m thick, but {long:.3g} m long with elements of {side:.3g} m. {UNITS}"
    lever = max(float(np.abs(block.offset[selected]).max(initial=0.0)) for block, selected in shells)
    if lever > LEVER * t:
        yield f"{name} has an offset of up to {lever:.3g} m from the nodes, {lever / t:.3g} times the thickness. {UNITS}"
    if isinstance(section, ShellSection) and section.bending == 0:
        yield f"{name} has no bending stiffness: it is a membrane (a PSHELL without MID2) without transverse stiffness."
    if isinstance(section, GeneralShell) and not section.bending.any():
        yield f"{name} has no bending stiffness: it is a membrane without transverse stiffness."
    if isinstance(section, Laminate):
        angles = {abs(ply.angle) for ply in section.plies} - {0.0}
        if (
            angles
            and max(angles) <= np.pi / 2 + 0.01
            and angles & {round(a, k) for a in _RADIANS for k in (2, 3, 4, 5)}
        ):
            yield f"{name} has ply angles of {', '.join(f'{a:g}°' for a in sorted(angles))}. The unit is degrees, not radians."


_RADIANS = (np.pi / 6, np.pi / 4, np.pi / 3, np.pi / 2)
"""30, 45, 60 and 90 degrees."""


def _beam_warnings(mesh: Mesh, number: int, section: BeamSection) -> Iterator[str]:
    """Warnings for a beam section: any area A has ∫ r² dA ≥ A²/2π (circle) and J ≤ ∫ r² dA, and the radius of gyration is below
    the length of the structure (a single stub may be shorter)."""
    name = str(mesh.regions[number])
    node_lists = [block.nodes[block.region == number].ravel() for block in mesh.beams if block.kind != "rod"]
    if not len(concatenate(node_lists)):
        return
    long = _length(mesh, mesh.nodes_of_elements)
    for end, at_end in (("", section), (" at end B", section.at_b)):
        if at_end is None:
            continue
        A, J, polar = at_end.area, at_end.torsion, float(np.trace(at_end.second))
        if polar == 0 or A == 0:
            continue
        if polar < (1 - 1e-3) * A**2 / (2 * np.pi):
            yield (
                f"{name}{end}: I1 + I2 = {polar:.3g} m⁴ is below the minimum for this area, A²/2π = "
                f"{A**2 / (2 * np.pi):.3g} m⁴ (circle). Check that A = {A:.3g} m² and the moments use the same unit."
            )
        elif np.sqrt(polar / A) > long:
            yield (
                f"{name}{end}: the radius of gyration √((I1 + I2)/A) is {np.sqrt(polar / A):.3g} m, but the structure is only "
                f"{long:.3g} m long. Check whether area and moments of area are swapped or in different units."
            )
        if J == 0 and _can_twist(mesh, number):
            yield f"{name}{end} does not resist torsion: J is 0 or blank."
        elif TORSION * polar < J:
            yield f"{name}{end}: J = {J:.3g} m⁴ exceeds I1 + I2 = {polar:.3g} m⁴, which is impossible."


def _can_twist(mesh: Mesh, number: int) -> bool:
    """Whether an end of some beam of a region can rotate about the beam; supports of a plane frame prevent it."""
    clamped = np.zeros((len(mesh.position), 6), dtype=bool)
    clamped[mesh.fixed[:, 0], mesh.fixed[:, 1]] = True
    with_axes = list(mesh.axes)
    clamped[with_axes] = clamped[with_axes, 3:].all(axis=1, keepdims=True)  # in local axes
    for block in mesh.beams:
        ends = block.nodes[block.region == number][:, :2]
        along = np.abs(mesh.position[ends[:, 1]] - mesh.position[ends[:, 0]])
        along_beam = along > 1e-6 * along.max(axis=1, keepdims=True)
        if (along_beam[:, None] & ~clamped[ends][:, :, 3:]).any():
            return True
    return False


def _far_beams(mesh: Mesh) -> Iterator[str]:
    nodes = mesh.nodes_of_elements
    for block in mesh.beams:
        lever = np.linalg.norm(block.offset, axis=2).max(axis=1)
        if len(lever) and lever.max() > _length(mesh, nodes):
            worst = int(np.argmax(lever))
            yield (
                f"element {block.ids[worst]} ({block.kind}) has an offset of {lever[worst]:.3g} m from its nodes, but the "
                f"structure is {_length(mesh, nodes):.3g} m long. {UNITS}"
            )


def _stiff_springs(mesh: Mesh) -> Iterator[str]:
    E = [iso.youngs_modulus for iso in mesh.materials.values()] + [ply.e1 for ply in mesh.laminae.values()]
    if not E or not len(mesh.nodes_of_elements):
        return
    long = _length(mesh, mesh.nodes_of_elements)
    for spring in mesh.springs:
        for turns, unit, power in ((False, "N/m", 1), (True, "N m/rad", 3)):
            k = float(spring.stiffness[spring.torsion == turns].max(initial=0.0))
            if k > STIFF * max(E) * long**power:
                yield (
                    f"{spring}: the stiffness {k:.3g} {unit} is {k / (max(E) * long**power):.2g} times E L{'³' * turns} of the "
                    "structure (E: Young's modulus, L: length), so rounding errors dominate. Replace the spring by a support "
                    "(SPC) or a rigid tie (RBE2)."
                )


def _inconsistent_normals(mesh: Mesh) -> list[str]:
    """Warning for neighbours of one region with opposite normals: their common side has the same direction in both. Parts that
    meet at a corner, such as a web and a skin, are separate regions."""
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
        f"normals of neighbouring shells are opposite, for example of elements {a} and {b} ({len(same)} such pairs in total). "
        "Upper and lower face, offsets, ply order and pressures depend on the normal. Number the nodes of "
        "all shells in the same direction."
    ]


def _length(mesh: Mesh, nodes: IntArray) -> float:
    return float(np.linalg.norm(np.ptp(mesh.position[nodes], axis=0)))


def _sides(mesh: Mesh, block: ShellBlock, selected: np.ndarray) -> FloatArray:
    x = mesh.position[block.corners[selected]]
    return np.asarray(np.linalg.norm(x - np.roll(x, -1, axis=1), axis=2).min(axis=1))


MODULUS = (1e5, 1e13)
"""[Pa], from soft foam to ten times diamond."""
DENSITY = (10.0, 1e5)
"""[kg/m³], from light foam to four times osmium. Steel in t/mm³ read as kg/mm³ has 7.85 and a modulus that is wrong by the
same factor, so that the speed of sound does not reveal it."""
EXTENT = (1e-3, 100.0)
"""[m], from a crystal to a rotor blade: structures tested with strain gauges."""
WAVE_SPEED = (10.0, 2.5e4)
"""√(E/ρ) [m/s], from soft rubber to above diamond: consistency of modulus and density for any material."""
LOCKING = 0.495
"""Poisson's ratio above which solid elements without a pressure unknown are much too stiff; rubber is often set to 0.49."""
SHEAR_EXCESS = 2.0
"""Factor by which the transverse shear stiffness of a composite solid may be too large without a warning."""
GRAVITY = 9.80665
METAL = 1e10
"""[Pa] Stiffer materials do not represent a mass that is smeared over a soft one."""


def unused_nodes(mesh: Mesh) -> IntArray:
    """Indices of the nodes without element, rigid or averaging element, relation, mass, spring or support."""
    used = attached(mesh)
    used[[point.node for point in mesh.point_masses]] = True
    return np.flatnonzero(~used)


def without_loose_masses(mesh: Mesh) -> Mesh:
    """The mesh without point masses on nodes without any connection, which have no effect; with a note."""
    connected = attached(mesh)
    if not (loose := [point for point in mesh.point_masses if not connected[point.node]]):
        return mesh
    shown = ", ".join(str(mesh.node_ids[point.node]) for point in loose[:5]) + (", …" if len(loose) > 5 else "")
    some = f"{len(loose)} point masses with a total" if len(loose) > 1 else "a point mass"
    note = (
        f"{some} of {sum(point.mass for point in loose):.4g} kg omitted, because no element, tie, spring or support is connected "
        f"to node {shown}"
    )
    remaining = tuple(point for point in mesh.point_masses if connected[point.node])
    return replace(mesh, point_masses=remaining, notes=(*mesh.notes, note))


def attached(mesh: Mesh) -> NDArray[np.bool_]:
    """Nodes (n,) with an element, tie, spring or support."""
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
    """Warnings: values that indicate a wrong unit, unused parts, and parts of the file that are not modelled.

    length_unit and mass_unit: those of the file, to suggest others; free: supports are not required."""
    warnings = list(leading_warnings(mesh))
    warnings += mesh.doubts
    for material in mesh.materials.values():
        warnings += _ratio_warnings(mesh, material)
    general = {number: shell for number, shell in mesh.sections.items() if isinstance(shell, GeneralShell)}
    constants = [
        (str(material), material.youngs_modulus, material.density, False) for material in mesh.materials.values()
    ]
    constants += [(str(material), material.e1, material.density, True) for material in mesh.laminae.values()]
    constants += [(str(mesh.regions[number]), shell.modulus, shell.density, False) for number, shell in general.items()]
    constants += [
        (str(material), max(material.moduli), material.density, True) for material in mesh.anisotropic.values()
    ]
    for name, E, rho, ply in constants:
        warnings += _material_warnings(name, E, rho, length_unit, mass_unit, ply)
    warnings += _stiff_cores(mesh)
    for number in mesh.sections:
        warnings += _shell_warnings(mesh, number)
    warnings += [*_far_beams(mesh), *_stiff_springs(mesh), *_inconsistent_normals(mesh)]
    extent = float(np.max(np.ptp(mesh.position, axis=0)))
    warnings += _outside("the largest dimension of the structure", extent, EXTENT, "m", "Check mesh.length_unit.")
    warnings += _far_references(mesh)
    if (unused := unused_nodes(mesh)).size:
        shown = ", ".join(str(mesh.node_ids[i]) for i in unused[:5]) + (", …" if unused.size > 5 else "")
        words = "nodes have no connection, and are" if unused.size > 1 else "node has no connection, and is"
        warnings.append(f"{unused.size} {words} omitted from the model: {shown}")
    warnings += [f"{mesh.regions[i]} has no elements" for i in empty_regions(mesh)]
    grounded = any(len(relation.node) == 1 for relation in mesh.relations)
    if not mesh.held.size and not mesh.springs and not grounded and not free:
        warnings.append(
            "the structure has no supports. Add supports, set mesh.free: true, or use soft springs (mesh.supports, stiffness)."
        )
    return tuple(warnings)


def leading_warnings(mesh: Mesh) -> tuple[str, ...]:
    """Differences between the model and the deck: contact that is bonded or open, and ignored cards."""
    ignored = ignored_structure(mesh).items()
    return (*mesh.contacts, *(f"{count} × {card} ignored: {lost(card)}" for card, count in ignored))


def ignored_structure(mesh: Mesh) -> dict[str, int]:
    """Cards that may add stiffness, mass or a tie and are ignored, with their count."""
    return {card: count for card, count in mesh.ignored.items() if mesh.effect.get(card) == "structure"}


def lost(card: str) -> str:
    """Consequence of ignoring a card."""
    if card.startswith("PRELOAD"):
        message = "the deck requests modes under a preload, but the stiffness is that of the unloaded structure"
        return (
            f"{message}. CalculiX includes the loads of the previous step; Abaqus includes them only with NLGEOM in that step."
            if "PERTURB" in card
            else message
        )
    if card.endswith(("NLGEOM", "LGDISP", "TYPE=STRESS")):
        return "the stiffness is that of the unloaded structure, without preload or initial stress"
    if card.startswith("ENFORCED DISPLACEMENT"):
        if card.endswith("DISPLACEMENT"):
            return "because of mesh.ignore, nodes with an enforced displacement are free to move; define loads on these nodes"
        return (
            "the enforced displacement is set to zero, as in a frequency analysis. If the test applies a force there, set "
            "mesh.ignore: [ENFORCED DISPLACEMENT]."
        )
    if card.endswith("INREL"):
        return "the model has no inertia relief; if the structure is free, set mesh.free: true"
    if card.endswith("COUPMASS"):
        return (
            "the deck requests lumped mass, but models with shells and beams always use consistent mass. "
            "On coarse meshes this increases natural frequencies (in two tet10 meshes by 9 and 23 %). For comparable "
            "frequencies, set PARAM,COUPMASS,1 in Nastran."
        )
    return "the model lacks the stiffness, mass or tie defined by the ignored card"


def _ratio_warnings(mesh: Mesh, material: Material) -> list[str]:
    """Warnings for a Poisson's ratio that locks solids, or that is negative (for example from a wrong shear modulus)."""
    nu = material.poisson_ratio
    if nu < 0:
        return [
            f"{material}: Poisson's ratio is {nu:.4g}: the material expands laterally under tension. If the ratio follows from "
            "E and G, ν = E/2G − 1, check G: metals have G of 0.38 to 0.4 E."
        ]
    if nu > LOCKING and any(
        material in (mesh.material_of(int(region)), *mesh.layer_materials(int(region)))
        for block in mesh.blocks
        for region in np.unique(block.region)
    ):
        return [
            f"{material}: Poisson's ratio is {nu:.10g}. Elements lock (are too stiff) for nearly incompressible solids "
            f"(K/G is {2 * (1 + nu) / (3 * (1 - 2 * nu)):.3g}). Use at most {LOCKING:g}."
        ]
    return []


def _stiff_cores(mesh: Mesh) -> list[str]:
    """Warnings for composite solids with a soft core: all layers of an element have one transverse shear strain instead of one
    stress. It resists with Σ sG, separate layers would with 1/Σ(s/G); s are their shares."""
    warnings = []
    for number, composite in mesh.composites.items():
        G = np.array(
            [np.nan if material is None else _shear_modulus(material) for material in mesh.layer_materials(number)]
        )
        excess = float((composite.shares @ G) * (composite.shares @ (1 / G)))
        if excess > SHEAR_EXCESS:
            warnings.append(
                f"{mesh.regions[number]} has layers whose shear moduli differ by a factor of {G.max() / G.min():.3g}: the "
                f"elements are up to {excess:.3g} times too stiff in transverse shear. For a thick solid or a soft core, "
                "mesh core and skins with separate elements."
            )
    return warnings


def _shear_modulus(material: Anisotropic | Material) -> float:
    """G [Pa], for an anisotropic material the mean of three."""
    if isinstance(material, Anisotropic):
        return float(np.diagonal(material.stiffness)[3:].mean())
    return material.youngs_modulus / (2 * (1 + material.poisson_ratio))


def _far_references(mesh: Mesh) -> list[str]:
    """Warnings for reference nodes farther from the nodes of their tie than three times the size of the structure."""
    if not mesh.elements:
        return []
    size = size_of(mesh)
    warnings = []
    for tie in mesh.ties:
        distance = float(np.linalg.norm(mesh.position[tie.nodes] - mesh.position[tie.reference], axis=1).min())
        if distance > 3 * size:
            warnings.append(
                f"node {mesh.node_ids[tie.reference]} of {tie} is {distance:.3g} m away from the other nodes of this tie, but "
                f"the mesh is only {size:.3g} m long. Positions in the config are in m, whatever the unit of the file."
            )
    return warnings


def _material_warnings(
    name: str, E: float, rho: float, length_unit: str, mass_unit: str, ply: bool = False
) -> list[str]:
    """Warnings for a modulus [Pa] and a density [kg/m³] that no material has; ply: E along the fibres of a composite."""
    in_config = name.startswith("mesh.materials.")
    if in_config:
        length_unit, mass_unit = "m", "kg"
    remedy = "Values of the config are in Pa and kg/m³." if in_config else likely_units(E, rho, length_unit, mass_unit)
    warnings = _outside(f"{name}: Young's modulus", E, MODULUS, "Pa", remedy)
    if rho == 0:
        return [*warnings, f"{name} has no density: it adds stiffness, but no mass."]
    warnings += _outside(f"{name}: density", rho, DENSITY, "kg/m³", remedy)
    if not warnings and rho > LIKELY_DENSITY[1] and E > METAL:
        warnings = [
            f"{name}: density is {rho:.3g} kg/m³, but metals have at most {LIKELY_DENSITY[1]:g} kg/m³. If the value is a "
            f"specific weight, the density would be {rho / GRAVITY:.4g} kg/m³ (PARAM,WTMASS). Check the deck."
        ]
    if not warnings and (advice := mixed_units(E, rho, length_unit, mass_unit, ply)):
        warnings = [
            f"{name}: Young's modulus is {E:.3g} Pa and density {rho:.4g} kg/m³. {advice}{f' {remedy}' * in_config}"
        ]
    if not warnings:
        warnings = _outside(f"{name}: the speed of sound √(E/ρ)", float(np.sqrt(E / rho)), WAVE_SPEED, "m/s", remedy)
    return warnings


def _outside(what: str, value: float, limits: tuple[float, float], unit: str, remedy: str) -> list[str]:
    low, high = limits
    if low <= value <= high:
        return []
    return [f"{what} is {value:.3g} {unit}, outside the usual range {low:g} to {high:g}. {remedy}"]
