"""*EQUATION of an Abaqus deck: relations between motions."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.numbers import parse_integer
from strainsight.mesh.joins import Relation
from strainsight.mesh.model import IntArray


@dataclass
class Equations:
    """Relations, numbered from 1, and where each stands."""

    relations: list[Relation] = field(default_factory=list)
    where: list[tuple[str, int]] = field(default_factory=list)


@dataclass(frozen=True)
class Term:
    """What an entry names: nodes (k,), one or as many as equations, ascending by id; degree of freedom 1-6, coefficient."""

    nodes: IntArray
    component: int
    value: float
    row: Row


def equations(assembly: Assembly, rotations: Mapping[int, int], still: Collection[int]) -> Equations:
    """Σ A u = 0 along the *TRANSFORM of the nodes, the first motion follows; sets make as many equations as they have nodes.

    rotations: node whose translations are the rotations of another one (CalculiX) → that node; still: rows of the nodes that
    have no rotations. Equations of later steps are left out, with a note. Raises DeckError for options, one in the first step,
    for a node or set that is not there, sets of unequal size or without an order (UNSORTED), degrees of freedom that are none of
    1 to 6, and rotations of a node that has none.
    """
    found = Equations()
    for step, keyword in [(own, k) for own in assembly.steps for k in own.keywords if k.name == "EQUATION"]:
        if step.number == 1:
            raise keyword.error("stands inside the first *STEP", "move it before, or take it out")
        assembly.notes.append(
            f"the equations of step {step.number} ({keyword.where}) are left out: those of the model count"
        )
    for scope, keyword in assembly.keywords("EQUATION"):
        if other := sorted(set(keyword.parameters) - {"INPUT"}):
            raise keyword.error(
                f"{other[0]} is not supported", "give the equations alone, whose right-hand side is zero"
            )
        for start, entries in _equations(keyword):
            if all(row.integer(at + 1, "the degree of freedom") in (0, 8, 11) for row, at in entries):
                assembly.notes.append(f"{start.where}: an equation between temperatures or pressures is left out")
                continue
            terms = [_term(assembly, scope, *entry) for entry in entries]
            _add(assembly, start, terms, rotations, still, found)
    return found


def _equations(keyword: Keyword) -> Iterator[tuple[Row, list[tuple[Row, int]]]]:
    """Of each equation its first line, with the number of terms, and line and first entry of each of its terms."""
    rows = iter(keyword.rows())
    for start in rows:
        count = start.integer(0, "the number of terms")
        if count < 1 or any(start.entries[1:]):
            raise start.error(
                "is no number of terms", "begin an equation with it, alone on a line, then give the terms"
            )
        terms: list[tuple[Row, int]] = []
        while len(terms) < count:
            row = next(rows, None)
            if row is None:
                raise start.error(
                    f"{count} terms are stated, {len(terms)} follow", "give them all, or correct the number"
                )
            used = 1 + max(i for i, entry in enumerate(row.entries) if entry) if any(row.entries) else 0
            if used % 3:
                raise row.error(
                    "not three entries a term", "give node, degree of freedom and coefficient of every term"
                )
            terms += [(row, i) for i in range(0, used, 3)]
        if len(terms) > count:
            raise start.error(f"{count} terms are stated, {len(terms)} follow", "correct the number")
        yield start, terms


def _term(assembly: Assembly, scope: Scope, row: Row, at: int) -> Term:
    component = row.integer(at + 1, "the degree of freedom")
    if not 1 <= component <= 6:
        raise row.error(f"degree of freedom {component}", "give one of 1 to 6")
    nodes = assembly.node_rows(row.text(at), scope, row)
    if not nodes.size:
        raise row.error(f"node set {row.text(at)!r} is empty", "name another set")
    if len(nodes) > 1 and _unsorted(assembly, row.text(at), scope):
        raise row.error(f"node set {row.text(at)!r} is UNSORTED", "write an equation for each of its nodes")
    return Term(nodes[np.argsort(assembly.node_ids[nodes])], component, row.real(at + 2, "the coefficient"), row)


def _unsorted(assembly: Assembly, entry: str, scope: Scope) -> bool:
    within, name = assembly.split_name(entry, scope)
    named = [
        k for k in within.part.keywords if k.name == "NSET" and k.parameters.get("NSET", "").upper() == name.upper()
    ]
    return parse_integer(name) is None and any("UNSORTED" in keyword.parameters for keyword in named)


def _add(
    assembly: Assembly,
    start: Row,
    terms: list[Term],
    rotations: Mapping[int, int],
    still: Collection[int],
    found: Equations,
) -> None:
    count = len(terms[0].nodes)
    for term in terms:
        if len(term.nodes) not in (1, count):
            raise term.row.error(
                f"a set of {len(term.nodes)} nodes where the first one has {count}",
                "give sets of as many nodes, or one node",
            )
    if terms[0].value == 0:
        raise terms[0].row.error(
            "the coefficient of the first term is 0", "give a motion first that can follow the others"
        )
    for i in range(count):
        node: list[int] = []
        component: list[int] = []
        for term in terms:
            own = int(term.nodes[i if len(term.nodes) > 1 else 0])
            turns = 3 if own in rotations else 0
            node.append(rotations.get(own, own))
            component.append(term.component - 1 + turns)
            if (component[-1] > 2 and term.value != 0 and node[-1] in still) or component[-1] > 5:
                raise term.row.error(
                    f"degree of freedom {term.component} of node {assembly.node_ids[own]}, which has no such rotation",
                    "nodes of solids have translations only (1 to 3)",
                )
        file, line = start.keyword.files[start.i], start.keyword.numbers[start.i]
        found.where.append((file, line))
        value = np.array([term.value for term in terms])
        found.relations.append(Relation(len(found.where), np.array(node), np.array(component), value, "*EQUATION"))
