"""What a model assumes: the fate of every card, what hangs together, the rigid-body check, mass by part, and what differs from
the program of the deck; one table, for the terminal and the page."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from strainsight.cases.structure.grounds import free_motions
from strainsight.errors import StrainsightError
from strainsight.fem.grounded import EXACT, links
from strainsight.fem.mass import element_mass_parts
from strainsight.fem.pieces import parts
from strainsight.fem.thin import thin_mass
from strainsight.mesh.kinds import kind_of
from strainsight.mesh.model import Mesh
from strainsight.mesh.sanity import lost
from strainsight.mesh.unjoined import Coincident, Joints, joined_parts
from strainsight.workflow.output import Table

ASSUMES = "what this model assumes"
MOST = 24
"""Regions whose mass is listed."""
Row = tuple[str, str, str]


def assumed_table(mesh: Mesh, program: str, free: bool) -> Table:
    """Of a mesh as it is computed; program: whose deck it was, as `format_of` says; free: nothing has to hold it."""
    contacts = (("contact", "", text) for text in mesh.contacts)
    rows = (
        *contacts,
        *_cards(mesh),
        *_connections(mesh),
        *_rigid(mesh, free),
        *_masses(mesh),
        *_differences(mesh, program),
    )
    return Table(ASSUMES, ("what", "how many", "detail"), rows)


def _cards(mesh: Mesh) -> Iterator[Row]:
    for card, count in sorted(mesh.read.items()):
        if own := count - sum(n for name, n in mesh.ignored.items() if name.split(" that ")[0] == card or name == card):
            yield (f"card {card}", str(own), "read")
    for card, count in mesh.ignored.items():
        yield (f"card {card}", str(count), _fate(card, mesh.effect.get(card, "")))


def _fate(card: str, effect: str) -> str:
    """Of a card that does not count, in words; an enforced displacement may be held all the same."""
    if " that no " in card or " not selected" in card:
        return "left out: nothing refers to it"
    if effect == "structure":
        return f"not as the deck has it: {lost(card)}"
    if effect == "none":
        return "left out: it changes neither stiffness, mass nor supports"
    return "left out: what it does is not known here"


def _connections(mesh: Mesh) -> Iterator[Row]:
    if not mesh.elements:
        return
    joints = Joints(mesh)
    tied = np.unique(joined_parts(mesh, joints)[mesh.nodes_of_elements])
    yield ("parts that share no node", str(parts(mesh).count), f"{len(tied)} with ties, relations and springs")
    found = Coincident(mesh, joints)
    yield ("nodes in one place that nothing joins", str(len(found.unjoined)), "")
    if mesh.shells:
        rings = [
            np.stack([own.corners, np.roll(own.corners, -1, axis=1)], axis=2).reshape(-1, 2) for own in mesh.shells
        ]
        _, count = np.unique(np.sort(np.concatenate(rings), axis=1), axis=0, return_counts=True)
        several = f"{int((count > 2).sum())} sides have more than two shells"
        yield ("free sides of shells", str(int((count == 1).sum())), several)


def _rigid(mesh: Mesh, free: bool) -> Iterator[Row]:
    if mesh.elements:
        try:
            left = free_motions(mesh)
            words = ", ".join(left[:8]) + (f" and {len(left) - 8} more" if len(left) > 8 else "")
            yield ("rigid-body check: motions left", str(len(left)), words + " (mesh.free)" * (free and bool(left)))
        except StrainsightError as error:
            yield ("rigid-body check: motions left", "?", error.what)
    found = links(mesh)
    ground = sum(own.share > EXACT for own in found)
    detail = f"{ground} resist one; largest share of it {found[0].share:.2g}, {found[0].name}" if found else ""
    yield ("rigid-body check: springs and relations between nodes", str(len(found)), detail)
    supports = len(np.unique(mesh.fixed[:, 0]))
    yield ("nodes held", str(supports), f"{len(mesh.fixed)} components at zero")


def _masses(mesh: Mesh) -> Iterator[Row]:
    """Of every region, and of point masses."""
    if any(mesh.density_of(number) is None for number in mesh.regions):
        return
    of: dict[int, float] = dict.fromkeys(mesh.regions, 0.0)
    for part, values in element_mass_parts(mesh):
        a, b = np.triu_indices(part.nodes.shape[1])
        own = values @ np.where(a == b, 1.0, 2.0)
        for number in np.unique(part.region):
            of[int(number)] += float(own[part.region == number].sum())
    listed = list(of)[:MOST]
    for number in listed:
        ids = [block.ids[block.region == number] for block in mesh.thin]
        if any(len(own) for own in ids):
            M, _ = thin_mass(mesh, np.concatenate(ids))
            along = np.zeros((M.shape[0] // 6, 6))
            along[:, 0] = 1.0
            of[number] += float(along.ravel() @ (M @ along.ravel()))
        name = mesh.regions[number].name
        yield (f"mass of region {number} {name}", f"{of[number]:.6g} kg", f"{mesh.density_of(number):.5g} kg/m³")
    if len(of) > MOST:
        yield ("mass of other regions", "", f"{len(of) - MOST} more are not listed")
    if mesh.point_masses:
        yield (
            "point masses",
            f"{sum(own.mass for own in mesh.point_masses):.6g} kg",
            f"{len(mesh.point_masses)} of them",
        )


def _differences(mesh: Mesh, program: str) -> Iterator[Row]:
    """What another program does in another way, of what is in this mesh."""
    kinds = {block.kind for block in mesh.elements}
    for text in (
        "linear about the state without load: no preload, contact, large displacement or temperature",
        "damping is that of the config, whatever the deck says",
        "mass of solids is lumped (mesh.mass or PARAM,COUPMASS): the diagonal of the consistent one, scaled to the mass of each "
        "element; on coarse meshes frequencies are lower than by consistent mass"
        if mesh.lumped
        else {
            "nastran": "mass is consistent; Nastran lumps it unless PARAM,COUPMASS is 1 (mesh.mass: lumped): on coarse meshes "
            "frequencies are higher then",
            "abaqus": "mass is consistent; Abaqus lumps that of elements of the first order: on coarse meshes frequencies are "
            "higher here",
        }.get(program, "mass is consistent"),
        "hex8 have incompatible modes, and bend without locking: programs without them are stiffer"
        if "hex8" in kinds
        else "",
        "linear tetrahedra, wedges and pyramids are too stiff in bending, here as elsewhere"
        if kinds & {"tet4", "wedge6", "pyra5"}
        else "",
        "rotations of shells about their normal have a stiffness that follows from the membrane, and no K6ROT"
        if mesh.shells
        else "",
        "beams shear with the factors of their section; what Abaqus takes off for slender ones is not imitated"
        if program == "abaqus" and mesh.beams
        else "",
        "nodes of solids have no rotations: what is tied or bent to them there turns freely"
        if any(kind_of(block.kind).corners for block in mesh.blocks) and mesh.thin
        else "",
    ):
        if text:
            yield ("differs", "", text)
