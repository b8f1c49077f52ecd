"""Checks of ids, positions, connectivity and material constants, with the error messages that all mesh readers share."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.joins import AveragingElement, Relation, RigidElement
from strainsight.mesh.model import CellBlock, FloatArray, IntArray
from strainsight.mesh.thin import concatenate

Where = Callable[[str, int], str]
"""("node" or "element", id) → place in the file."""

OR_CONFIG = ", or define the material in the config (mesh.materials)"
"""Ending of a remedy for a deck without a material."""

COLLAPSED = {
    **dict.fromkeys(("quad4", "quad8"), "replace collapsed quadrilaterals by triangles"),
    **dict.fromkeys(("tri3", "tri6", "line2", "line3"), "remove the element"),
}
"""Remedy for an element with a repeated node, by kind; solids have another one."""


class Doubt(str):
    """A note on a probable mistake in a deck; an import reports it as a warning."""


def notes_and_doubts(messages: Iterable[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Split messages into notes and doubts, as plain strings."""
    both = list(messages)
    doubts = tuple(str(text) for text in both if isinstance(text, Doubt))
    return tuple(text for text in both if not isinstance(text, Doubt)), doubts


def find_duplicate(ids: IntArray) -> tuple[int, int] | None:
    """Positions of the first repeated id, in the order of the file; None if all ids are unique."""
    order = np.argsort(ids, kind="stable")
    if not (again := np.flatnonzero(np.diff(ids[order]) == 0)).size:
        return None
    at = again[np.argmin(order[again + 1])]
    return int(order[at]), int(order[at + 1])


def check_once(ids: IntArray, what: str, where: Callable[[int], str]) -> None:
    """Raise DeckError for a repeated id; where: row → place in the file."""
    if pair := find_duplicate(ids):
        first, second = pair
        raise DeckError(
            f"{what} id {ids[second]} is used twice (first at {where(first)})",
            where=where(second),
            remedy=f"use a unique id for every {what}",
        )


def find_repeated_node(nodes: IntArray) -> int | None:
    """First row of nodes (m, k) with a repeated node."""
    twice = np.any(np.diff(np.sort(nodes, axis=1), axis=1) == 0, axis=1)
    return int(np.argmax(twice)) if twice.any() else None


def find_coincident(nodes: IntArray) -> tuple[int, int] | None:
    """Two rows of nodes (m, k) with the same nodes, the earlier one first."""
    ordered = np.sort(nodes, axis=1)
    by_nodes = np.lexsort(ordered.T)
    if not (same := np.flatnonzero(np.all(np.diff(ordered[by_nodes], axis=0) == 0, axis=1))).size:
        return None
    a, b = sorted((int(by_nodes[same[0]]), int(by_nodes[same[0] + 1])))
    return a, b


def note_shared(nodes: IntArray, called: Callable[[int], str], notes: list[str]) -> None:
    """Add a note on two elements of a kind with the same nodes (m, k), which may be intended; called: row → "S4R 12"."""
    if pair := find_coincident(nodes):
        first, second = pair
        count = len(nodes) - len(np.unique(np.sort(nodes, axis=1), axis=0))
        shared = (
            f"{called(second)} has the same nodes as {called(first)} ({plural(count, 'duplicate element')} in total)"
        )
        notes.append(Doubt(f"{shared}: the model includes the stiffness and mass of both"))


def elastic_fault(youngs_modulus: float, poisson_ratio: float) -> tuple[str, str] | None:
    """Error and remedy for the constants of an isotropic solid unless E > 0 and −1 < ν < ½."""
    if not youngs_modulus > 0:
        return f"Young's modulus is {youngs_modulus:g}, not positive", "specify a positive modulus"
    if not -1 < poisson_ratio < 0.5:
        return (
            f"Poisson's ratio is {poisson_ratio:g}, outside -1 to 0.5",
            "specify a Poisson's ratio above -1 and below 0.5 (for rubber, for example, 0.49)",
        )
    return None


def lamina_fault(moduli: Mapping[str, float], poisson_ratio: float, name: str = "NU12") -> tuple[str, str] | None:
    """Error and remedy for the constants of an orthotropic ply unless all moduli are positive and ν₁₂² < E₁/E₂;
    moduli: name → value, E1 and E2 first."""
    for each, value in moduli.items():
        if not value > 0:
            return f"{each} is {value:g}, not positive", "specify a positive modulus"
    e1, e2 = list(moduli.values())[:2]
    if not poisson_ratio**2 < e1 / e2:
        what = f"{name} is {poisson_ratio:g}, but its square must be less than E1/E2 = {e1 / e2:g}"
        return what, f"correct Poisson's ratio {name}, which is −ε₂/ε₁ for a stress along axis 1"
    return None


def entity_error(kind: str, number: int, what: str, remedy: str, where: Where) -> DeckError:
    """A DeckError at a "node" or "element" of the file."""
    return DeckError(what, where=where(kind, number), remedy=remedy, entity=(kind, number))


def check_nodes(ids: IntArray, position: FloatArray, where: Where) -> None:
    """Raise DeckError unless node ids (n,) are positive and unique, and positions (n, 3) finite."""
    _check_ids(ids, "node", where)
    finite = np.isfinite(position).all(axis=1)
    if not finite.all():
        node = int(ids[np.argmin(finite)])
        what = f"node {node} has a coordinate that is not a finite number"
        raise entity_error("node", node, what, "correct the coordinate, or export the mesh again", where)


def check_elements(
    blocks: Sequence[CellBlock], where: Where, name: Callable[[CellBlock, int], str] | None = None
) -> None:
    """Raise DeckError unless element ids are positive and unique, and no two elements and no two nodes of an element are the
    same. name: a block and a row of it → the element in the words of its format; "element 10 (tet4)" by default."""
    _check_ids(concatenate(block.ids for block in blocks), "element", where)
    called = name or (lambda block, row: f"element {block.ids[row]} ({block.kind})")
    for block in blocks:
        if (row := find_repeated_node(block.nodes)) is not None:
            what = f"{called(block, row)}: the element has the same node twice"
            remedy = COLLAPSED.get(block.kind, "replace collapsed elements by wedges or tetrahedra")
            raise entity_error("element", int(block.ids[row]), what, remedy, where)
        if (pair := find_coincident(block.nodes)) is not None:
            first, second = (int(block.ids[row]) for row in pair)
            place, other = where("element", second), where("element", first)
            what = f"{called(block, pair[1])} has the same nodes as {called(block, pair[0])}"
            what += f" at {other}" if other != place else ""
            remedy = "remove one of the two elements; together they double the stiffness and mass"
            raise entity_error("element", second, what, remedy, where)


def _check_ids(ids: IntArray, what: str, where: Where) -> None:
    if ids.size and ids.min() < 1:
        number = int(ids.min())
        raise DeckError(
            f"{what} id {number} is not positive", where=where(what, number), remedy="use ids of at least 1"
        )
    if (pair := find_duplicate(ids)) is not None:
        number = int(ids[pair[1]])
        raise entity_error(
            what, number, f"{what} id {number} is used twice", f"use a unique id for every {what}", where
        )


def plural(count: int, what: str) -> str:
    """ "1 element", "2 elements"."""
    return f"{count} {what}" + ("" if count == 1 else "s")


ENFORCED = "ENFORCED DISPLACEMENT"
"""Name in a config of a support with a prescribed displacement that is not zero; if ignored, its components are free."""
HELD = "ENFORCED DISPLACEMENT with a nonzero value"
"""Name in a config of such a support whose components are fixed at zero, as in a frequency analysis of any program."""
MISSING_END = "MISSING ENDDATA"
"""Name in a config of a deck with BEGIN BULK but without ENDDATA, which may be truncated."""
PRELOAD = "PRELOAD"
"""Name in a config of the preload of a modal analysis; cards are "PRELOAD by STATSUB" and similar."""
LINEAR = {
    **dict.fromkeys(("S9R5", "CQUAD"), "shells of eight or four nodes"),
    **dict.fromkeys(("T3D3", "CBEAM3"), "trusses or beams of two nodes"),
}
"""Shells of nine nodes and quadratic trusses, in the spelling of `short` → number of nodes of a supported element."""
_UNUSED = re.compile(r"\sthat no | not selected$")


def spelt(card: str) -> str:
    """A card in one spelling, as a config may name it: "*ELEMENT, TYPE=S4R" and "S4R", "*TIE" and "Tie" are the same."""
    return card.partition(" by ")[0].upper().replace(" ", "").replace("*", "").removeprefix("ELEMENT,TYPE=")


def short(card: str) -> str:
    """A card as a config should name it: without characters that are special in YAML."""
    name = card.partition(" by ")[0].removeprefix("*").removeprefix("ELEMENT, TYPE=")
    return f'"{name}"' if "," in name else name


def classify_effects(cards: Iterable[str], structural: re.Pattern[str], control: re.Pattern[str]) -> dict[str, str]:
    """Card → "structure" or "none" (see `Mesh`) if a pattern matches its beginning; unused cards are left out."""
    effect: dict[str, str] = {}
    for card in cards:
        if control.match(card):
            effect[card] = "none"
        elif structural.match(card) and not _UNUSED.search(card):
            effect[card] = "structure"
    return effect


def turning_nodes(
    rigid: Sequence[RigidElement], averaging: Sequence[AveragingElement], relations: Sequence[Relation] = ()
) -> set[int]:
    """Rows of the nodes with rotations that matter: reference nodes, rotating followers of an RBE2, and nodes that a
    relation or an average rotates."""
    followers = {int(row) for e in rigid if max(e.components) > 2 for row in e.nodes}
    followers |= {int(row) for e in averaging for row in e.turned} | {int(row) for e in relations for row in e.turned}
    return followers | {e.reference for e in rigid} | {e.reference for e in averaging}


def moment_note(card: str, ids: Sequence[int]) -> str:
    """Note on moments on nodes (ids, ascending, at least one) without rotations."""
    more = f" and {plural(len(ids) - 1, 'more node')} have" if len(ids) > 1 else " has"
    return f"{card}: node {ids[0]}{more} no rotations, so moments are applied as couples of forces"
