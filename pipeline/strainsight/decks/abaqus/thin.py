"""Shells, beams and trusses of an Abaqus deck as blocks."""

from __future__ import annotations

import numpy as np

from strainsight.decks.abaqus.cells import NODES
from strainsight.decks.abaqus.composites import default_axes
from strainsight.decks.abaqus.scopes import Assembly
from strainsight.decks.abaqus.sections import Sections
from strainsight.decks.faults import Doubt, coincident, folded, plural
from strainsight.mesh.beam_axes import ALONG, axes_along
from strainsight.mesh.laminates import Laminate
from strainsight.mesh.model import FloatArray, IntArray
from strainsight.mesh.plates import PARALLEL, plate_normals
from strainsight.mesh.thin import BEAM_KINDS, CORNERS, SHELL_KINDS, BeamBlock, ShellBlock

IN_ORDER = {"beam": (0, 1), "rod": (0, 1), "beam3": (0, 2, 1)}
"""Kind → where its nodes stand in the deck: ends, and the one between."""
APART = 1e-9
"""Length of an element over the extent of the model, below which its ends coincide."""


def shell_blocks(assembly: Assembly, sections: Sections) -> tuple[ShellBlock, ...]:
    """Shells with a section, a block a kind.

    Raises DeckError for a node that stands twice in a shell, and for one that has no area, is folded or warped too much.
    """
    blocks = []
    kinds = assembly.thin_kinds
    for kind in SHELL_KINDS:
        rows = np.flatnonzero((kinds == kind) & (sections.region > 0))
        if not rows.size:
            continue
        nodes = assembly.nodes[assembly.first[rows][:, None] + np.arange(NODES[kind])]
        if (at := folded(nodes)) is not None:
            raise assembly.element_error(
                int(rows[at]), "has a node twice", "write a collapsed quadrangle as an S3, take others out"
            )
        _check_shape(assembly, rows, nodes[:, : CORNERS[NODES[kind]]])
        _note_shared(assembly, rows, nodes)
        region = sections.region[rows]
        offset = np.array([sections.offset[number][0] for number in region.tolist()])
        axis = np.array([sections.direction[number] for number in region.tolist()])
        plies = [isinstance(sections.sections[number], Laminate) for number in region.tolist()]
        bare = np.isnan(axis).any(axis=1) & plies
        axis[bare] = default_axes(assembly.position[nodes[bare, : CORNERS[NODES[kind]]]])
        blocks.append(ShellBlock(kind, assembly.element_ids[rows], nodes, region, offset, axis))
    return tuple(blocks)


def _check_shape(assembly: Assembly, rows: IntArray, nodes: IntArray) -> None:
    """Shells on nodes (n, k) span an area, and are neither folded nor warped too much."""
    plate_normals(
        assembly.position[nodes],
        lambda i, what, remedy: assembly.element_error(int(rows[i]), what, remedy),
        lambda i: assembly.element(int(rows[i])),
        "S3",
        assembly.notes,
    )


def beam_blocks(assembly: Assembly, sections: Sections) -> tuple[BeamBlock, ...]:
    """Beams and trusses with a section, a block a kind:

        x from the first node to the last,     n2 = x × v/|x × v|,   n1 = n2 × x

    y is n1 and z is n2; v is the direction n1 of the section, or points from the first node to one more of the element. A B32
    has its middle node between its ends.
    Raises DeckError for nodes that are missing or coincide, and for a direction n1 along the beam.
    """
    extent = float(np.ptp(assembly.position, axis=0).max()) if len(assembly.position) else 0.0
    blocks = []
    kinds = assembly.thin_kinds
    for kind in BEAM_KINDS:
        rows = np.flatnonzero((kinds == kind) & (sections.region > 0))
        if not rows.size:
            continue
        _check_count(assembly, rows, IN_ORDER[kind])
        nodes = assembly.nodes[assembly.first[rows][:, None] + np.array(IN_ORDER[kind])]
        x = np.diff(assembly.position[nodes[:, :2]], axis=1)[:, 0]
        length = np.linalg.norm(x, axis=1)
        if (short := ~(length > APART * extent)).any():
            raise assembly.element_error(
                int(rows[np.argmax(short)]), "has no length: its nodes coincide", "move a node, or take it out"
            )
        x = x / length[:, None]
        region = sections.region[rows]
        v = (
            np.eye(3)[np.argmin(np.abs(x), axis=1)]
            if kind == "rod"
            else _directions(assembly, sections, rows, region, len(IN_ORDER[kind]))
        )
        n2 = np.cross(x, v)
        size = np.linalg.norm(n2, axis=1)
        if (lost := ~(size > PARALLEL * np.linalg.norm(v, axis=1))).any():
            at = int(np.argmax(lost))
            given = ", ".join(f"{c:g}" for c in v[at])
            raise assembly.element_error(
                int(rows[at]),
                f"lies along the first axis n1 ({given}) of its section",
                "give a direction across the beam on the line after the dimensions, which is 0, 0, -1 without it",
            )
        n2 = n2 / size[:, None]
        n1 = np.cross(n2, x)
        place = np.array([sections.offset[number] for number in region.tolist()])
        _note_shared(assembly, rows, nodes)
        axes = np.stack([x, n1, n2], axis=2)
        own = np.repeat(axes[:, None], nodes.shape[1], axis=1)
        if kind == "beam3":
            own, _ = axes_along(assembly.position[nodes], axes, ALONG)
        off = own[..., 1] * place[:, None, :1] + own[..., 2] * place[:, None, 1:] if kind != "rod" else 0 * own[..., 0]
        blocks.append(
            BeamBlock(
                kind,
                assembly.element_ids[rows],
                nodes,
                region,
                axes,
                off,
                np.zeros((len(rows), 2, 6), dtype=bool),
            )
        )
    return tuple(blocks)


def _check_count(assembly: Assembly, rows: IntArray, order: tuple[int, ...]) -> None:
    """As many nodes as a beam has, or one more that n1 points to, which trusses have not."""
    for row in rows.tolist():
        nodes = assembly.nodes[assembly.first[row] : assembly.first[row + 1]]
        truss = assembly.type[row].startswith("T")
        if not len(order) <= len(nodes) <= len(order) + (not truss):
            count, more = ("two", "third") if len(order) == 2 else ("three", "fourth")
            raise assembly.element_error(
                row, f"has {len(nodes)} nodes", f"give {count}" + ("" if truss else f", and a {more} that n1 points to")
            )
        if nodes.min() < 0:
            i = int(np.argmin(nodes)) + 1
            raise assembly.element_error(
                row, f"has a node that is not in the deck (its {i}.)", "add the node, or correct the id"
            )


def _directions(assembly: Assembly, sections: Sections, rows: IntArray, region: IntArray, count: int) -> FloatArray:
    """v (n, 3) of each beam of `count` nodes."""
    v = np.array([sections.direction[number] for number in region.tolist()])
    more = np.flatnonzero(assembly.first[rows + 1] - assembly.first[rows] == count + 1)
    begin = assembly.first[rows[more]]
    v[more] = assembly.position[assembly.nodes[begin + count]] - assembly.position[assembly.nodes[begin]]
    return v


def _note_shared(assembly: Assembly, rows: IntArray, nodes: IntArray) -> None:
    """Two elements of a kind on the same nodes may be meant, as parts of a section."""
    if pair := coincident(nodes):
        count = len(nodes) - len(np.unique(np.sort(nodes, axis=1), axis=0))
        first, second = (assembly.element(int(rows[i])) for i in pair)
        shared = f"{second} is on the nodes of {first} ({plural(count, 'such element')})"
        assembly.notes.append(Doubt(f"{shared}: stiffness and mass of both count"))
