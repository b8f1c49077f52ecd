"""Springs of an Abaqus deck: SPRING1, SPRING2 and SPRINGA with their *SPRING."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Keyword
from strainsight.errors import DeckError
from strainsight.mesh.joins import Springs
from strainsight.mesh.model import FloatArray

NODES = {"SPRING1": 1, "SPRING2": 2, "SPRINGA": 2}
"""Element type → number of its nodes."""


def springs(assembly: Assembly, axes: Mapping[int, FloatArray], rotations: Mapping[int, int]) -> tuple[Springs, ...]:
    """One `Springs` an element, with the constant stiffness k of its *SPRING:

        SPRING1  s = u_i      SPRING2  s = u_i − v_j      SPRINGA  s = (v − u)·(y − x)/|y − x|  along its nodes at x and y

    i, j degrees of freedom of its nodes along their *TRANSFORM. rotations: node whose translations are the rotations of another
    one (CalculiX) → that node. Raises DeckError for an element without *SPRING or node, for stiffness that is not constant or
    turned (NONLINEAR, ORIENTATION), and for a translation against a rotation.
    """
    kinds = np.array([type_ if type_ in NODES else "" for type_ in assembly.type])
    given: dict[int, tuple[Scope, Keyword]] = {}
    for scope, keyword in assembly.keywords("SPRING"):
        for parameter in ("NONLINEAR", "ORIENTATION", "COMPLEXSTIFFNESS"):
            if parameter in keyword.parameters:
                raise keyword.error(f"{parameter} is not supported", "give one constant stiffness")
        rows = assembly.element_set(keyword.needs("ELSET"), scope, keyword)
        for row in rows[kinds[rows] != ""].tolist():
            if row in given:
                raise keyword.error(f"element {assembly.element_ids[row]} has a *SPRING already", "give it one")
            given[row] = (scope, keyword)
    found = []
    for row in np.flatnonzero(kinds != "").tolist():
        name = f"{kinds[row]} {assembly.element_ids[row]}"
        file, number = assembly.element_where[row]
        nodes = assembly.nodes[assembly.first[row] : assembly.first[row + 1]].tolist()
        if row not in given or len(nodes) != NODES[str(kinds[row])] or min(nodes) < 0:
            lacks = "no *SPRING gives it a stiffness" if row not in given else "it does not stand on nodes of the deck"
            raise DeckError(
                f"{name}: {lacks}",
                where=f"{file}:{number}",
                remedy=f"add it, or leave the elements out (mesh.ignore: [{kinds[row]}])",
            )
        found.append(_spring(assembly, name, str(kinds[row]), nodes, given[row][1], axes, rotations))
    return tuple(found)


def _spring(
    assembly: Assembly,
    name: str,
    kind: str,
    nodes: list[int],
    keyword: Keyword,
    axes: Mapping[int, FloatArray],
    rotations: Mapping[int, int],
) -> Springs:
    rows = keyword.rows()
    if kind == "SPRINGA":
        along = assembly.position[nodes[1]] - assembly.position[nodes[0]]
        if not np.linalg.norm(along) > 0:
            raise keyword.error(f"the nodes of {name} coincide", "use a SPRING2")
        ends = [(node, 0, sign * along / np.linalg.norm(along)) for node, sign in zip(nodes, (-1.0, 1.0), strict=True)]
    else:
        ends = []
        for i, (node, sign) in enumerate(zip(nodes, (1.0, -1.0), strict=False)):
            component = rows[0].integer(i, "the degree of freedom")
            if not 1 <= component <= 6:
                raise rows[0].error(f"degree of freedom {component}", "give one of 1 to 6")
            axis = axes.get(node, np.eye(3))[:, (component - 1) % 3]
            turns = component > 3 or node in rotations
            ends.append((rotations.get(node, node), 3 if turns else 0, sign * axis))
        if len({first for _, first, _ in ends}) > 1:
            raise rows[0].error("one end is a translation, the other a rotation", "let both be of one kind")
    # the line of degrees of freedom is blank for a SPRINGA, and blank lines are none
    line = rows[-1]
    if len(rows) > 2 or (kind != "SPRINGA" and len(rows) < 2):
        raise line.error(
            "not a line of degrees of freedom and one of stiffness", "give the two lines, or add the second"
        )
    k = line.real(0, "the stiffness") if line.text(0) or kind != "SPRINGA" else line.real(1, "the stiffness")
    if k < 0:
        raise line.error(f"the stiffness is {k:g}, negative", "give a positive stiffness")
    return Springs(
        name,
        np.array([k]),
        np.zeros(3 * len(ends), dtype=np.int64),
        np.repeat([node for node, _, _ in ends], 3).astype(np.int64),
        np.concatenate([first + np.arange(3) for _, first, _ in ends]),
        np.concatenate([axis for _, _, axis in ends]),
    )
