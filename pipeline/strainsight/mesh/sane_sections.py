"""Sections of shells and beams, springs and normals that no structure has, in sentences for a warning."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from strainsight.mesh.laminates import Laminate
from strainsight.mesh.model import FloatArray, IntArray, Mesh
from strainsight.mesh.thin import BeamSection, GeneralShell, ShellBlock, ShellSection

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
    nodes = np.concatenate([np.zeros(0, dtype=np.int64), *(block.corners[own].ravel() for block, own in shells)])
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
    nodes = np.concatenate([np.zeros(0, dtype=np.int64), *own])
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
