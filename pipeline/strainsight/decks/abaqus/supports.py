"""Nodal axes, point masses, springs and *EQUATION of an Abaqus deck."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from strainsight.decks.abaqus.parts import normal, orthonormal
from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.faults import plural
from strainsight.decks.text import parse_integer
from strainsight.errors import DeckError
from strainsight.mesh.joins import PointMass, Relation, Springs, spring_between
from strainsight.mesh.model import FloatArray, IntArray


def nodal_axes(assembly: Assembly) -> dict[int, FloatArray]:
    """Row of a node → axes (3, 3), one in a column, of its *TRANSFORM.

        TYPE=R   x ∥ a, z ∥ a × b          TYPE=C   r, θ, z about the axis from a to b
        TYPE=S   r, θ, φ about the centre a with the pole b,   φ = r × θ

    Axes of an instance rotate with it. Raises DeckError for a node with two systems, and for points that define no axes."""
    axes: dict[int, FloatArray] = {}
    for scope, keyword in assembly.keywords("TRANSFORM"):
        row = keyword.rows()[0]
        a, b = row.reals(6, "a coordinate").reshape(2, 3)
        kind = keyword.word("TYPE", "R") or "R"
        nodes = assembly.set_rows("NODE", keyword.needs("NSET"), scope, keyword)
        if kind not in ("R", "C", "S"):
            raise keyword.error(f"TYPE={kind} is not supported", "set TYPE to R, C or S")
        for node in nodes.tolist():
            if node in axes:
                raise keyword.error(
                    f"node {assembly.node_ids[node]} already has another *TRANSFORM",
                    "remove the node from the node set of one *TRANSFORM",
                )
            position = scope.rotation.T @ (assembly.position[node] - scope.translation)
            try:
                axes[node] = scope.rotation @ _axes(kind, a, b, position, row)
            except DeckError:
                if kind == "R":
                    raise
                raise row.error(
                    f"node {assembly.node_ids[node]} is on the axis of the {'cylindrical' if kind == 'C' else 'spherical'} "
                    "system, where the radial or tangential direction is undefined",
                    "remove the node from the node set of the *TRANSFORM",
                ) from None
    return axes


def _axes(kind: str, a: FloatArray, b: FloatArray, position: FloatArray, row: Row) -> FloatArray:
    if kind == "R":
        return orthonormal(a, normal(a, b), row)
    pole, arm = b - a, position - a
    around = normal(pole, arm)
    if kind == "C":
        return orthonormal(np.cross(around, pole), pole, row)
    return orthonormal(arm, np.cross(arm, around), row)


def point_masses(assembly: Assembly, rotations: Mapping[int, int]) -> tuple[PointMass, ...]:
    """MASS elements with their *MASS; a ROTARYI element adds inertia to a mass on the same node, or is a separate point mass.

    I = [I11 I12 I13; · I22 I23; · · I33], products with the sign of a tensor, rotated with the instance. rotations:
    see `Supports.pairs`. Raises DeckError for an element without value or node, an element on a ROT NODE, whose
    motions are rotations, and negative values."""
    points = []
    for row, (_, keyword) in _with_keyword(assembly, ("MASS",), "MASS"):
        mass = keyword.rows()[0].not_negative(0, "the mass")
        points.append(PointMass(int(assembly.element_ids[row]), _node_of(assembly, row, rotations), mass))
    for row, (scope, keyword) in _with_keyword(assembly, ("ROTARYI",), "ROTARYINERTIA"):
        line = keyword.rows()[0]
        a, b, c, ab, ac, bc = line.reals(6, "the inertia")
        tensor = np.array([[a, ab, ac], [ab, b, bc], [ac, bc, c]])
        lowest = float(np.linalg.eigvalsh(tensor)[0])
        if lowest < -1e-9 * np.abs(tensor).max():
            raise line.error(
                f"a principal moment of inertia is {lowest:g}, negative",
                "correct I11, I22, I33, I12, I13 and I23 so that the inertia tensor has no negative eigenvalue",
            )
        node, turned = _node_of(assembly, row, rotations), scope.rotation @ tensor @ scope.rotation.T
        i = next((i for i, point in enumerate(points) if point.node == node), None)
        if i is None:
            points.append(PointMass(int(assembly.element_ids[row]), node, 0.0, inertia=turned))
        else:
            points[i] = replace(points[i], inertia=points[i].inertia + turned)
    return tuple(sorted(points, key=lambda point: point.id))


REFUSED = {
    "SPRING": (
        ("NONLINEAR", "ORIENTATION", "COMPLEXSTIFFNESS"),
        "remove the parameter, and specify one constant stiffness along the nodal axes",
    ),
    "ROTARYINERTIA": (
        ("ORIENTATION",),
        "remove ORIENTATION, and specify the moments of inertia about axes parallel to the global axes",
    ),
    "MASS": ((), ""),
}
"""Keyword → unsupported parameters and remedy."""


def _with_keyword(assembly: Assembly, types: Sequence[str], name: str) -> Iterator[tuple[int, tuple[Scope, Keyword]]]:
    """Rows of the elements of some types, with the keyword `name` that defines their value."""
    wanted = np.isin(np.array(assembly.type, dtype=str), types)
    keyword_of_row: dict[int, tuple[Scope, Keyword]] = {}
    for scope, keyword in assembly.keywords(name):
        parameters, remedy = REFUSED[name]
        for parameter in parameters:
            if keyword.parameters.get(parameter) is not None:
                raise keyword.error(f"the parameter {parameter} is not supported", remedy)
        if keyword.word("TYPE", "ISOTROPIC") not in ("ISOTROPIC", ""):
            raise keyword.error("anisotropic masses are not supported", "set TYPE=ISOTROPIC, and write one mass")
        rows = assembly.set_rows("ELEMENT", keyword.needs("ELSET"), scope, keyword)
        for row in rows[wanted[rows]].tolist():
            if row in keyword_of_row:
                raise keyword.error(
                    f"element {assembly.element_ids[row]} already has another {keyword.title}",
                    "remove the element from the element set of one of the two keywords",
                )
            keyword_of_row[row] = (scope, keyword)
    for row in np.flatnonzero(wanted).tolist():
        if row not in keyword_of_row:
            title = "ROTARY INERTIA" if name == "ROTARYINERTIA" else name
            remedy = f"add *{title}, or leave these elements out (mesh.ignore: [{assembly.type[row]}])"
            raise assembly.element_error(row, f"{assembly.element(row)} has no *{title}", remedy)
        yield row, keyword_of_row[row]


def _node_of(assembly: Assembly, row: int, rotations: Mapping[int, int]) -> int:
    nodes = assembly.nodes_of(row)
    if len(nodes) != 1 or nodes[0] < 0:
        raise assembly.element_error(
            row,
            f"{assembly.element(row)} must have exactly one node, and this node must be in the deck",
            "write the element id and one existing node id",
        )
    if int(nodes[0]) in rotations:
        raise assembly.element_error(
            row,
            f"{assembly.element(row)} refers to node {assembly.node_ids[nodes[0]]}, the ROT NODE of a *RIGID BODY",
            f"replace this node by the REF NODE {assembly.node_ids[rotations[int(nodes[0])]]} of this body",
        )
    return int(nodes[0])


def component_range(rows: list[Row], start: int) -> tuple[int, ...]:
    """Components 0-5 of data lines "first, last" that begin at entry `start`; all six by default."""
    components: set[int] = set()
    for row in rows:
        if not row.text(start):
            return tuple(range(6))
        first = row.integer(start, "the first tied degree of freedom")
        last = row.integer(start + 1, "the last tied degree of freedom", first) or first
        if not 1 <= first <= last <= 6:
            raise row.error(
                f"the range of degrees of freedom {first} to {last} is not valid",
                "write the lower degree of freedom first; both must be from 1 to 6",
            )
        components |= set(range(first - 1, last))
    return tuple(sorted(components)) or tuple(range(6))


NODES = {"SPRING1": 1, "SPRING2": 2, "SPRINGA": 2}
"""Element type → number of nodes."""


def springs(assembly: Assembly, axes: Mapping[int, FloatArray], rotations: Mapping[int, int]) -> tuple[Springs, ...]:
    """One `Springs` an element, with the constant stiffness k of its *SPRING:

        SPRING1  s = u_i      SPRING2  s = u_i − v_j      SPRINGA  s = (v − u)·(y − x)/|y − x|  along its nodes at x
        and y

    i, j are degrees of freedom along the *TRANSFORM of the nodes. rotations: node whose translations are the
    rotations of another node (CalculiX) → that node. Raises DeckError for an element without *SPRING or node,
    stiffness that is not constant or has an ORIENTATION, and springs between a translation and a rotation."""
    elements = []
    for row, (_, keyword) in _with_keyword(assembly, tuple(NODES), "SPRING"):
        kind, nodes = assembly.type[row], assembly.nodes_of(row).tolist()
        if len(nodes) != NODES[kind] or min(nodes) < 0:
            remedy = f"write {NODES[kind]} existing node ids, or leave these elements out (mesh.ignore: [{kind}])"
            what = f"{assembly.element(row)} has a wrong number of nodes, or a node that is not in the deck"
            raise assembly.element_error(row, what, remedy)
        lines = keyword.rows()
        if kind == "SPRINGA":
            along = assembly.position[nodes[1]] - assembly.position[nodes[0]]
            if not np.linalg.norm(along) > 0:
                raise keyword.error(
                    f"the nodes of {assembly.element(row)} coincide, so the direction of the spring is undefined",
                    "use SPRING2, and write the degrees of freedom on its first data line",
                )
            e = along / np.linalg.norm(along)
            ends = [(nodes[0], 0, -e), (nodes[1], 0, e)]
        else:
            ends = []
            for i, (node, sign) in enumerate(zip(nodes, (1.0, -1.0), strict=False)):
                component = lines[0].component(i)
                axis = axes.get(node, np.eye(3))[:, component % 3]
                turns = component > 2 or node in rotations
                ends.append((rotations.get(node, node), 3 if turns else 0, sign * axis))
            if len({first for _, first, _ in ends}) > 1:
                raise lines[0].error(
                    "the spring connects a translation with a rotation", "connect two translations or two rotations"
                )
        # a SPRINGA has a blank line of degrees of freedom, and blank lines are not stored
        line = lines[-1]
        if len(lines) > 2 or (kind != "SPRINGA" and len(lines) < 2):
            raise line.error(
                "the data lines of the spring are not complete",
                "write one line with the degrees of freedom, then one line with the stiffness",
            )
        k = line.not_negative(0 if line.text(0) or kind != "SPRINGA" else 1, "the stiffness")
        elements.append(spring_between(assembly.element(row), k, ends))
    return tuple(elements)


@dataclass
class Equations:
    """Relations, numbered from 1, and file and line of each."""

    relations: list[Relation] = field(default_factory=list)
    where: list[tuple[str, int]] = field(default_factory=list)


@dataclass(frozen=True)
class Term:
    """Term of an equation: nodes (k,), one or as many as equations, ascending by id; component 0-5, coefficient."""

    nodes: IntArray
    component: int
    value: float
    row: Row


def equations(assembly: Assembly, rotations: Mapping[int, int], still: Collection[int]) -> Equations:
    """Equations Σ A u = 0 along the *TRANSFORM of the nodes; the first motion is dependent; a node set makes one
    equation for each node.

    rotations: node whose translations are the rotations of another node (CalculiX) → that node; still: rows of nodes
    without rotations. Equations of later steps are left out, with a note. Raises DeckError for options, equations in
    the first step, missing nodes or sets, sets of unequal size or without an order (UNSORTED), degrees of freedom
    other than 1 to 6, and rotations of nodes without rotations."""
    result = Equations()
    for step, keyword in [(step_, k) for step_ in assembly.steps for k in step_.keywords if k.name == "EQUATION"]:
        if step.number == 1:
            raise keyword.error(
                "equations inside the first *STEP are not supported",
                "move the equation before the first *STEP, or remove it",
            )
        assembly.notes.append(
            f"the equations of step {step.number} ({keyword.where}) are left out: only equations before the first *STEP are used"
        )
    for scope, keyword in assembly.keywords("EQUATION"):
        if other := sorted(set(keyword.parameters) - {"INPUT"}):
            raise keyword.error(
                f"the parameter {other[0]} is not supported",
                "remove the parameter; the right-hand side of equations must be zero",
            )
        for start, entries in _equations(keyword):
            if all(row.integer(at + 1, "the degree of freedom of a term") in (0, 8, 11) for row, at in entries):
                assembly.notes.append(f"{start.where}: the equation of temperatures or pressures is left out")
                continue
            terms = [_term(assembly, scope, *entry) for entry in entries]
            value = np.array([term.value for term in terms])
            for node, component in _motions(assembly, terms, rotations, still):
                result.where.append((keyword.files[start.i], keyword.numbers[start.i]))
                number = len(result.where)
                result.relations.append(Relation(number, np.array(node), np.array(component), value, "*EQUATION"))
    return result


def _equations(keyword: Keyword) -> Iterator[tuple[Row, list[tuple[Row, int]]]]:
    """First line of each equation, and the line and first entry of each term."""
    rows = iter(keyword.rows())
    for start in rows:
        count = start.integer(0, "the number of terms of the equation")
        if count < 1 or any(start.tokens[1:]):
            raise start.error(
                "the number of terms of the equation is not valid",
                "begin the equation with a line that contains only the number of terms, then write the terms",
            )
        terms: list[tuple[Row, int]] = []
        while len(terms) < count:
            if (row := next(rows, None)) is None:
                raise start.error(
                    f"{count} terms are declared, but {len(terms)} are defined",
                    "add the missing terms, or correct the number of terms",
                )
            used = 1 + max(i for i, entry in enumerate(row.tokens) if entry) if any(row.tokens) else 0
            if used % 3:
                raise row.error("a term needs three entries", "write node, degree of freedom and coefficient")
            terms += [(row, i) for i in range(0, used, 3)]
        if len(terms) > count:
            raise start.error(
                f"{count} terms are declared, but {len(terms)} are defined", "correct the number of terms"
            )
        yield start, terms


def _term(assembly: Assembly, scope: Scope, row: Row, at: int) -> Term:
    component = row.component(at + 1)
    if not (nodes := assembly.rows("NODE", row.text(at), scope, row)).size:
        raise row.error(
            f"node set {row.text(at)!r} is empty", "add nodes to this node set, or remove the term from the equation"
        )
    if len(nodes) > 1 and _unsorted(assembly, row.text(at), scope):
        raise row.error(
            f"node set {row.text(at)!r} is UNSORTED, which is not supported in equations",
            "write a separate equation for each of its nodes",
        )
    return Term(nodes[np.argsort(assembly.node_ids[nodes])], component, row.real(at + 2, "the coefficient"), row)


def _unsorted(assembly: Assembly, entry: str, scope: Scope) -> bool:
    within, name = assembly.split_name(entry, scope)
    named = [k for k in within.part.keywords if k.name == "NSET" and k.word("NSET") == name.upper()]
    return parse_integer(name) is None and any("UNSORTED" in keyword.parameters for keyword in named)


def _motions(
    assembly: Assembly, terms: list[Term], rotations: Mapping[int, int], still: Collection[int]
) -> Iterator[tuple[list[int], list[int]]]:
    """Nodes and components 0-5 of the terms of each resulting equation."""
    count = len(terms[0].nodes)
    for term in terms:
        if len(term.nodes) not in (1, count):
            raise term.row.error(
                f"the node set has {plural(len(term.nodes), 'node')}, but the node set of the first term has {count}",
                f"use a node set of {plural(count, 'node')}, or a single node",
            )
    if terms[0].value == 0:
        raise terms[0].row.error(
            "the coefficient of the first term is 0", "start the equation with a term whose coefficient is not zero"
        )
    for i in range(count):
        named = [int(term.nodes[i if len(term.nodes) > 1 else 0]) for term in terms]
        node = [rotations.get(node_row, node_row) for node_row in named]
        component = [term.component + 3 * (node_row in rotations) for term, node_row in zip(terms, named, strict=True)]
        for term, named_row, row, c in zip(terms, named, node, component, strict=True):
            if (c > 2 and term.value != 0 and row in still) or c > 5:
                raise term.row.error(
                    f"degree of freedom {term.component + 1} does not exist at node {assembly.node_ids[named_row]}",
                    "use degrees of freedom 1 to 3 at nodes of solids, and 1 to 6 at nodes of shells and beams",
                )
        yield node, component
