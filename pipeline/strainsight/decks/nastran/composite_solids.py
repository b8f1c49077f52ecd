"""Composite solids of a Nastran deck: PCOMPS."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from strainsight.decks.nastran.cards import Card
from strainsight.decks.nastran.composites import plies_of
from strainsight.decks.nastran.grids import resolved_system
from strainsight.mesh.anisotropic import Orientation
from strainsight.mesh.composite_solids import STACKED, CompositeSolid, Layer
from strainsight.mesh.coordinates import BASIC, CoordinateSystem
from strainsight.mesh.kinds import kind_of
from strainsight.mesh.laminates import Ply
from strainsight.mesh.model import CellBlock, FloatArray

DIRECTIONS = (12, 13, 21, 23, 31, 32)
MOST, NOTED = 45.0, 5.0
"""Degrees between the normal of the layers of an element and the axis that CORDM has for it: an error, and a note."""


def layers_of(card: Card) -> tuple[Ply, ...]:
    """Material, relative thickness and angle of each layer, from the facet of the first corners up."""
    return plies_of(card, step=8, at=1)


def composite_solid(
    card: Card,
    plies: Sequence[Ply],
    anisotropic: Collection[int],
    blocks: Sequence[CellBlock],
    position: FloatArray,
    systems: dict[int, CoordinateSystem],
    notes: list[str],
) -> CompositeSolid:
    """Layers from G1-G4 to G5-G8 of hexahedra, from triangle to triangle of wedges. PSDIR p s: THETA turns axis 1 of a material
    from axis p of CORDM about axis s, which is its axis 3, and lies across the layers.

    anisotropic: ids of such materials, the only ones that CORDM matters to; position (n, 3) of the nodes. Raises DeckError for a
    CORDM that is blank or −1, a PSDIR that is none, elements that have no layers, and those whose layers lie across another axis.
    """
    pid = card.integer(0, "the property id")
    own = [(block, block.nodes[block.region == pid], block.ids[block.region == pid]) for block in blocks]
    for block, nodes, ids in own:
        if len(nodes) and block.kind not in STACKED:
            raise card.error(
                f"{block.kind} element {ids[0]} can have no layers",
                "give layers to CHEXA and CPENTA, and others a PSOLID",
            )
    if not any(ply.material in anisotropic for ply in plies):
        return CompositeSolid(tuple(Layer(p.material, p.thickness, Orientation(BASIC, np.eye(3))) for p in plies))
    if card.text(1) in ("", "-1"):
        raise card.error(
            f"CORDM is {card.text(1) or 'blank'}, and its plies are anisotropic: codes read that as other axes",
            "name a coordinate system (CORD2R, CORD2C, CORD2S) with an axis across the layers, or 0 for the basic one",
        )
    directions = card.integer(2, "the directions PSDIR", 13)
    if directions not in DIRECTIONS:
        raise card.error(
            f"PSDIR is {directions}",
            "give the axis of CORDM along plies at 0° and the one across them, 12, 13, 21, 23, 31 or 32",
        )
    along, across = directions // 10 - 1, directions % 10 - 1
    axes = np.eye(3)[:, [along, along, across]]
    axes[:, 1] = np.cross(axes[:, 2], axes[:, 0])
    system = resolved_system(card, 1, systems)
    for block, nodes, ids in own:
        if len(nodes):
            _check_across(card, block, nodes, ids, Orientation(system, axes), _alike(plies), position, notes)
    return CompositeSolid(
        tuple(Layer(p.material, p.thickness, Orientation(system, axes @ _turned(p.angle))) for p in plies)
    )


def _check_across(
    card: Card,
    block: CellBlock,
    nodes: np.ndarray,
    ids: np.ndarray,
    orientation: Orientation,
    alike: bool,
    position: FloatArray,
    notes: list[str],
) -> None:
    """Axis 3 of elements at their centres against the normal of the layers there, ∂x/∂ξ × ∂x/∂η, or its line where the layers
    are `alike` from both sides."""
    kind = kind_of(block.kind)
    x = position[nodes]
    r, s = np.einsum("kd,ekc->dec", kind.gradient(kind.centre)[0], x)[:2]
    normal = np.cross(r, s)
    centre = np.einsum("k,ekc->ec", kind.shape(kind.centre)[0], x)
    cosine = np.einsum("ec,ec->e", normal, orientation.axes_at(centre)[:, :, 2]) / np.linalg.norm(normal, axis=1)
    angle = np.degrees(np.arccos(np.clip(abs(cosine) if alike else cosine, -1.0, 1.0)))
    worst = int(np.argmax(angle))
    if angle[worst] > MOST:
        raise card.error(
            f"layers of {block.kind} element {ids[worst]} lie from its first facet (G1, G2, …) to the opposite one, "
            f"{angle[worst]:.3g}° off the axis of CORDM that PSDIR puts across them",
            "number the nodes of the element so that its first facet is below the plies, or correct CORDM or PSDIR",
        )
    if angle[worst] > NOTED:
        notes.append(
            f"PCOMPS {card.text(0)}: the axis of CORDM across the plies is up to {angle[worst]:.3g}° off the normal of elements "
            f"({ids[worst]}); axes of plies are those of CORDM, not projected on the element"
        )


def _alike(plies: Sequence[Ply]) -> bool:
    """Whether plies counted from the other side are the same."""
    own = [(ply.material, ply.thickness, ply.angle) for ply in plies]
    return own == own[::-1]


def _turned(degrees: float) -> FloatArray:
    """Axes (3, 3), one in a column, turned about the third."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
