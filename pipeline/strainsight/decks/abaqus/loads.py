"""Loads of an Abaqus deck: concentrated ones, pressures on elements and surfaces, weight and rotation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator

import numpy as np

from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.sections import Sections
from strainsight.decks.abaqus.surfaces import Surface, facets_of, shell_facets, surface_of
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.faults import moment_note
from strainsight.decks.text import parse_integer
from strainsight.mesh.facets import Traction, consistent_forces
from strainsight.mesh.joins import BodyForce, NodalForces
from strainsight.mesh.kinds.kind import Kind
from strainsight.mesh.model import FloatArray, IntArray
from strainsight.mesh.thin import Laminate, ShellSection

AXES = {"BX": 0, "BY": 1, "BZ": 2}
"""Label of a force per volume → its direction."""


def loads_of(
    assembly: Assembly,
    found: dict[tuple[str, str], Surface],
    axes: dict[int, FloatArray],
    rotations: dict[int, int],
    turning: Collection[int],
    sections: Sections,
    ignored: Counter[str],
) -> dict[str, NodalForces]:
    """Each *CLOAD, *DLOAD and *DSLOAD as CLOAD-1, CLOAD-2, …, DLOAD-1, …, in the order of the file.

    found: the surfaces; rotations: see `Supports.pairs`; turning: rows of nodes with rotations, a moment on any other becomes a
    note. Loads of other kinds are counted. Raises DeckError for nodes, elements
    and surfaces that are not there, and for a data line that is incomplete.
    """
    loads: dict[str, NodalForces] = {}
    loose: set[int] = set()
    for number, (scope, keyword) in enumerate(_keywords(assembly, "CLOAD"), start=1):
        if (load := _concentrated(assembly, scope, keyword, axes, rotations)) is not None:
            loads[f"CLOAD-{number}"] = load
            if load.moment is not None:
                loose |= {int(row) for row in load.nodes[load.moment.any(axis=1)] if row not in turning}
    if loose:
        assembly.notes.append(moment_note("*CLOAD of a moment", sorted(int(assembly.node_ids[row]) for row in loose)))
    for number, (scope, keyword) in enumerate(_keywords(assembly, "DLOAD"), start=1):
        if (load := _distributed(assembly, scope, keyword, sections, ignored)) is not None:
            loads[f"DLOAD-{number}"] = load
    for number, (scope, keyword) in enumerate(_keywords(assembly, "DSLOAD"), start=1):
        if (load := _on_surfaces(assembly, scope, keyword, found, ignored)) is not None:
            loads[f"DSLOAD-{number}"] = load
    return loads


def _keywords(assembly: Assembly, name: str) -> Iterator[tuple[Scope, Keyword]]:
    """Those of the model, then those of the steps."""
    yield from assembly.keywords(name)
    for step in assembly.steps:
        yield from ((assembly.scopes[""], keyword) for keyword in step.keywords if keyword.name == name)


def _concentrated(
    assembly: Assembly, scope: Scope, keyword: Keyword, axes: dict[int, FloatArray], rotations: dict[int, int]
) -> NodalForces | None:
    """Forces and moments along nodal axes, turned to basic; a force on the ROT NODE of a *RIGID BODY (CalculiX) is a moment on
    its reference node."""
    force: dict[int, FloatArray] = {}
    moment: dict[int, FloatArray] = {}
    for row in keyword.rows(needed=False):
        nodes = assembly.node_rows(row.text(0), scope, row)
        component, value = row.integer(1, "the degree of freedom"), row.real(2, "the force")
        if not 1 <= component <= 6:
            raise row.error(f"degree of freedom {component} takes no force", "forces act on 1 to 3, moments on 4 to 6")
        for node in nodes.tolist():
            direction = axes[node][:, (component - 1) % 3] if node in axes else np.eye(3)[(component - 1) % 3]
            values, at = (moment, rotations.get(node, node)) if component > 3 or node in rotations else (force, node)
            values[at] = values.get(at, np.zeros(3)) + value * direction
    if not (force or moment):
        return None
    loaded = list(dict.fromkeys([*force, *moment]))
    forces, moments = (np.array([own.get(node, np.zeros(3)) for node in loaded]) for own in (force, moment))
    return NodalForces(np.array(loaded), forces, moments if moment else None)


def _distributed(
    assembly: Assembly, scope: Scope, keyword: Keyword, sections: Sections, ignored: Counter[str]
) -> NodalForces | None:
    """P1 to P6: a pressure p on a facet of a solid, t = −p n.   P: on a shell, along its normal, t = p n (Abaqus guide to
    prescribed conditions, distributed loads).   BX to BZ: a force per volume of shells.   GRAV: g times a direction.
    CENTRIF: Ω², a point and the axis."""
    parts: list[tuple[IntArray, FloatArray]] = []
    body: list[BodyForce] = []
    family = assembly.families
    for row in keyword.rows(needed=False):
        label = row.text(1).upper()
        if label in ("GRAV", "CENTRIF"):
            body.append(_body(assembly, scope, row, label))
        elif label == "P":
            rows = assembly.element_rows(row.text(0), scope, row)
            shells = rows[family[rows] == "shell"]
            if shells.size < rows.size:
                ignored["*DLOAD P on elements that are no shells"] += 1
            parts += _pressed(assembly, shell_facets(assembly, shells), -row.real(2, "the pressure"))
        elif label[:1] == "P" and (number := parse_integer(label[1:])) is not None:
            rows = assembly.element_rows(row.text(0), scope, row)
            solid = rows[assembly.kind[rows] >= 0]
            if solid.size < rows.size:
                ignored["*DLOAD on elements that are no solids"] += 1
            parts += _pressed(assembly, facets_of(assembly, solid, number, row, "P"), row.real(2, "the pressure"))
        elif label in AXES and (family[rows := assembly.element_rows(row.text(0), scope, row)] == "shell").all():
            parts += _per_volume(assembly, sections, rows, AXES[label], row.real(2, "the force per volume"))
        else:
            ignored[f"*DLOAD {label}"] += 1
    return _summed(parts, body)


def _per_volume(
    assembly: Assembly, sections: Sections, rows: IntArray, axis: int, b: float
) -> list[tuple[IntArray, FloatArray]]:
    """A force b per volume of the shells in rows along a basic axis, b t per area."""
    found = []
    for number in np.unique(sections.region[rows]).tolist():
        section = sections.sections.get(number)
        if isinstance(section, ShellSection | Laminate):
            traction = b * section.thickness * np.eye(3)[axis]
            for kind, nodes in shell_facets(assembly, rows[sections.region[rows] == number]):
                forces = consistent_forces(assembly.position, kind, nodes, _even(traction))
                found.append((nodes.ravel(), forces.reshape(-1, 3)))
    return found


def _even(t: FloatArray) -> Traction:
    """The same traction everywhere."""
    return lambda x, n, _: np.broadcast_to(t, x.shape)


def _body(assembly: Assembly, scope: Scope, row: Row, label: str) -> BodyForce:
    """Weight or rotation of the elements and point masses of a set, or of all where it names none."""
    rows = assembly.element_rows(row.text(0), scope, row) if row.text(0) else None
    elements = None if rows is None else np.sort(assembly.element_ids[rows])
    size = row.real(2, "the magnitude")
    start = 3 if label == "GRAV" else 6
    direction = np.array([row.real(start + i, "a component of the direction", 0.0) for i in range(3)])
    if not (length := float(np.linalg.norm(direction))) > 0:
        raise row.error(f"{label} has no direction", "give three numbers, not all zero")
    direction = scope.rotation @ direction / length
    if label == "GRAV":
        return BodyForce(acceleration=size * direction, elements=elements)
    if size < 0:
        raise row.error(f"the square of the angular velocity is {size:g}, negative", "give Ω²")
    point = np.array([row.real(3 + i, "a coordinate of the point", 0.0) for i in range(3)])
    centre = scope.rotation @ point + scope.translation
    return BodyForce(rotation=np.sqrt(size) * direction, centre=centre, elements=elements)


def _on_surfaces(
    assembly: Assembly,
    scope: Scope,
    keyword: Keyword,
    found: dict[tuple[str, str], Surface],
    ignored: Counter[str],
) -> NodalForces | None:
    """P: a pressure p on a *SURFACE of facets, t = −p n, the normal n of a shell on its side SNEG against its own."""
    parts: list[tuple[IntArray, FloatArray]] = []
    for row in keyword.rows(needed=False):
        if (label := row.text(1).upper()) != "P":
            ignored[f"*DSLOAD {label}"] += 1
            continue
        surface = surface_of(row.text(0), row, assembly, scope, found)
        if not surface.facets:
            raise row.error(f"surface {row.text(0)!r} has no facets", "name a surface of TYPE=ELEMENT with sides")
        if surface.sideless:
            raise row.error(
                f"surface {row.text(0)!r} holds shells on neither side, or edges", "name the side of each, SPOS or SNEG"
            )
        parts += _pressed(assembly, surface.facets, row.real(2, "the pressure"))
    return _summed(parts, [])


def _pressed(
    assembly: Assembly, facets: list[tuple[Kind, IntArray]] | tuple[tuple[Kind, IntArray], ...], p: float
) -> list[tuple[IntArray, FloatArray]]:
    return [
        (nodes.ravel(), consistent_forces(assembly.position, kind, nodes, lambda x, n, _: -p * n).reshape(-1, 3))
        for kind, nodes in facets
    ]


def _summed(parts: list[tuple[IntArray, FloatArray]], body: list[BodyForce]) -> NodalForces | None:
    if not (parts or body):
        return None
    rows = np.concatenate([np.zeros(0, dtype=np.int64), *(nodes for nodes, _ in parts)])
    nodes, place = np.unique(rows, return_inverse=True)
    force = np.zeros((len(nodes), 3))
    if parts:
        np.add.at(force, place, np.concatenate([own for _, own in parts]))
    return NodalForces(nodes, force, body=tuple(body))
