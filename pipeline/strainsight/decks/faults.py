"""Faults of ids, positions, connectivity and material constants, found on arrays; what every reader says of them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.joins import AveragingElement, Relation, RigidElement
from strainsight.mesh.model import CellBlock, FloatArray, IntArray
from strainsight.mesh.thin import concatenate

Where = Callable[[str, int], str]
"""("node" or "element", id) → its place in the file."""

OR_CONFIG = ", or state it in the config (mesh.materials)"
"""What a deck without a material may do instead."""

COLLAPSED = {
    **dict.fromkeys(("quad4", "quad8"), "replace collapsed quadrangles by triangles"),
    **dict.fromkeys(("tri3", "tri6", "line2", "line3"), "remove it"),
}
"""What to do about an element with a node twice; of solids another."""


class Doubt(str):
    """A note on what a deck says that is more likely a mistake than meant: it is among the warnings of an import."""


def notes_and_doubts(found: Iterable[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Notes, and those of them that are doubts, as plain strings."""
    both = list(found)
    doubts = tuple(str(text) for text in both if isinstance(text, Doubt))
    return tuple(text for text in both if not isinstance(text, Doubt)), doubts


def repeated(ids: IntArray) -> tuple[int, int] | None:
    """Positions of the first id that stands twice, in the order of the file; None where each stands once."""
    order = np.argsort(ids, kind="stable")
    again = np.flatnonzero(np.diff(ids[order]) == 0)
    if not again.size:
        return None
    at = again[np.argmin(order[again + 1])]
    return int(order[at]), int(order[at + 1])


def check_once(ids: IntArray, what: str, where: Callable[[int], str]) -> None:
    """Raise DeckError where an id stands twice; where: row → its place."""
    if pair := repeated(ids):
        first, second = pair
        raise DeckError(
            f"{what} id {ids[second]} stands twice (first at {where(first)})",
            where=where(second),
            remedy=f"give every {what} its own id",
        )


def folded(nodes: IntArray) -> int | None:
    """First row of nodes (m, k) in which a node stands twice."""
    twice = np.any(np.diff(np.sort(nodes, axis=1), axis=1) == 0, axis=1)
    return int(np.argmax(twice)) if twice.any() else None


def coincident(nodes: IntArray) -> tuple[int, int] | None:
    """Two rows of nodes (m, k) that hold the same nodes, the earlier one first."""
    ordered = np.sort(nodes, axis=1)
    by_nodes = np.lexsort(ordered.T)
    same = np.flatnonzero(np.all(np.diff(ordered[by_nodes], axis=0) == 0, axis=1))
    if not same.size:
        return None
    a, b = sorted((int(by_nodes[same[0]]), int(by_nodes[same[0] + 1])))
    return a, b


def note_shared(nodes: IntArray, called: Callable[[int], str], notes: list[str]) -> None:
    """Two elements of a kind on the same nodes (m, k) may be meant, as parts of a section; called: row → "S4R 12"."""
    if pair := coincident(nodes):
        count = len(nodes) - len(np.unique(np.sort(nodes, axis=1), axis=0))
        shared = f"{called(pair[1])} is on the nodes of {called(pair[0])} ({plural(count, 'such element')})"
        notes.append(Doubt(f"{shared}: stiffness and mass of both count"))


def elastic_fault(youngs_modulus: float, poisson_ratio: float) -> tuple[str, str] | None:
    """What is wrong with the constants of an isotropic solid, and the remedy: E > 0, −1 < ν < ½."""
    if not youngs_modulus > 0:
        return f"Young's modulus is {youngs_modulus:g}, not positive", "give a positive modulus"
    if not -1 < poisson_ratio < 0.5:
        return (
            f"Poisson's ratio is {poisson_ratio:g}, outside -1 to 0.5",
            "a solid needs a ratio below 0.5 (rubber: 0.49)",
        )
    return None


def lamina_fault(moduli: Mapping[str, float], poisson_ratio: float, name: str = "NU12") -> tuple[str, str] | None:
    """What is wrong with the constants of an orthotropic ply, and the remedy; moduli: name → value, E1 and E2 first. All are
    positive, and ν₁₂² < E₁/E₂."""
    for each, value in moduli.items():
        if not value > 0:
            return f"{each} is {value:g}, not positive", "give a positive modulus"
    e1, e2 = list(moduli.values())[:2]
    if not poisson_ratio**2 < e1 / e2:
        what = f"{name} is {poisson_ratio:g}, its square not below E1/E2 = {e1 / e2:g}"
        return what, f"{name} = −ε₂/ε₁ under a stress along 1"
    return None


def entity_error(kind: str, number: int, what: str, remedy: str, where: Where) -> DeckError:
    """A DeckError at a "node" or "element" of the file."""
    return DeckError(what, where=where(kind, number), remedy=remedy, entity=(kind, number))


def check_nodes(ids: IntArray, position: FloatArray, where: Where) -> None:
    """Raise DeckError unless node ids (n,) are positive and each once, and positions (n, 3) finite."""
    _check_ids(ids, "node", where)
    finite = np.isfinite(position).all(axis=1)
    if not finite.all():
        node = int(ids[np.argmin(finite)])
        what = f"node {node} has a coordinate that is not a finite number"
        raise entity_error("node", node, what, "correct the coordinate, or write the mesh again", where)


def check_elements(
    blocks: Sequence[CellBlock], where: Where, name: Callable[[CellBlock, int], str] | None = None
) -> None:
    """Raise DeckError unless element ids are positive and each once, no element has a node twice, no two are the same.

    name: a block and a row of it → the element in the words of its format; "element 10 (tet4)" by default.
    """
    _check_ids(concatenate(block.ids for block in blocks), "element", where)
    called = name or (lambda block, row: f"element {block.ids[row]} ({block.kind})")
    for block in blocks:
        if (row := folded(block.nodes)) is not None:
            what = f"{called(block, row)}: a node stands twice in the element"
            remedy = COLLAPSED.get(block.kind, "replace collapsed elements by wedges or tetrahedra")
            raise entity_error("element", int(block.ids[row]), what, remedy, where)
        if (pair := coincident(block.nodes)) is not None:
            first, second = (int(block.ids[row]) for row in pair)
            place, other = where("element", second), where("element", first)
            what = f"{called(block, pair[1])}: the same nodes as {called(block, pair[0])}"
            what += f" at {other}" if other != place else ""
            remedy = "remove one of the two: together they count stiffness and mass twice"
            raise entity_error("element", second, what, remedy, where)


def _check_ids(ids: IntArray, what: str, where: Where) -> None:
    if ids.size and ids.min() < 1:
        number = int(ids.min())
        raise DeckError(
            f"{what} number {number} is not positive", where=where(what, number), remedy=f"number the {what}s from 1"
        )
    if (pair := repeated(ids)) is not None:
        number = int(ids[pair[1]])
        raise entity_error(
            what, number, f"{what} number {number} stands twice", f"give every {what} its own number", where
        )


def plural(count: int, what: str) -> str:
    """ "1 element", "2 elements"."""
    return f"{count} {what}" + ("" if count == 1 else "s")


ENFORCED = "ENFORCED DISPLACEMENT"
"""What a config calls a support that is not at zero; with it left out the components are free."""
HELD = f"{ENFORCED} of another value than zero"
"""The same where the components are held, as in a frequency analysis of any program."""
MISSING_END = "MISSING ENDDATA"
"""What a config calls that a deck with BEGIN BULK ends without ENDDATA, so that it may be cut off."""
PRELOAD = "PRELOAD"
"""What a config calls the stress under which a deck asks for modes; cards are "PRELOAD by STATSUB" and the like."""
LINEAR = {**dict.fromkeys(("S9R5", "CQUAD"), "eight or four nodes"), **dict.fromkeys(("T3D3", "CBEAM3"), "two nodes")}
"""Shells of nine nodes and quadratic trusses, in the spelling of `short` → what to mesh with instead."""
_UNUSED = re.compile(r" that no | not selected$")


def spelt(card: str) -> str:
    """A card as a config may name it, in one spelling: "*ELEMENT, TYPE=S4R" and "S4R", "*TIE" and "Tie" are the same."""
    return card.partition(" by ")[0].upper().replace(" ", "").replace("*", "").removeprefix("ELEMENT,TYPE=")


def short(card: str) -> str:
    """A card as a config names it best: without what YAML would take for something else."""
    name = card.partition(" by ")[0].removeprefix("*").removeprefix("ELEMENT, TYPE=")
    return f'"{name}"' if "," in name else name


def effects(cards: Iterable[str], structural: re.Pattern[str], control: re.Pattern[str]) -> dict[str, str]:
    """Card → "structure" or "none" (see `Mesh`), where a pattern matches its beginning; not of cards that nothing refers to."""
    found: dict[str, str] = {}
    for card in cards:
        if control.match(card):
            found[card] = "none"
        elif structural.match(card) and not _UNUSED.search(card):
            found[card] = "structure"
    return found


def turning_nodes(
    rigid: Sequence[RigidElement], averaging: Sequence[AveragingElement], relations: Sequence[Relation] = ()
) -> set[int]:
    """Rows of the nodes whose rotations count: reference nodes, what follows one of an RBE2 in rotations, and what a relation
    or a mean turns."""
    followers = {int(row) for e in rigid if max(e.components) > 2 for row in e.nodes}
    followers |= {int(row) for e in averaging for row in e.turned} | {int(row) for e in relations for row in e.turned}
    return followers | {e.reference for e in rigid} | {e.reference for e in averaging}


def moment_note(card: str, ids: Sequence[int]) -> str:
    """What becomes of moments on nodes (ids, ascending, at least one) that have no rotations."""
    more = f" and {len(ids) - 1} more" if len(ids) > 1 else ""
    return f"{card} on node {ids[0]}{more} without rotations: a couple of forces on the nodes of the elements there"
