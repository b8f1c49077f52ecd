"""Nodal axes and point masses of an Abaqus deck."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from strainsight.decks.abaqus.parts import normal, orthonormal
from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.text import Row
from strainsight.errors import DeckError
from strainsight.mesh.joins import PointMass
from strainsight.mesh.model import FloatArray


def nodal_axes(assembly: Assembly) -> dict[int, FloatArray]:
    """Row of a node → axes (3, 3), one in a column, of its *TRANSFORM.

        TYPE=R   x ∥ a, z ∥ a × b          TYPE=C   r, θ, z about the axis from a to b
        TYPE=S   r, θ, φ about the centre a with the pole b,   φ = r × θ

    Those of an instance turn with it. Raises DeckError for a node with two, and for points that define no axes.
    """
    found: dict[int, FloatArray] = {}
    for scope, keyword in assembly.keywords("TRANSFORM"):
        row = keyword.rows()[0]
        a, b = row.reals(6, "a coordinate").reshape(2, 3)
        kind = keyword.parameters.get("TYPE", "R").upper() or "R"
        nodes = assembly.node_set(keyword.needs("NSET"), scope, keyword)
        if kind not in ("R", "C", "S"):
            raise keyword.error(f"TYPE={kind} is not R, C or S", "give the type of the system")
        for node in nodes.tolist():
            if node in found:
                raise keyword.error(
                    f"node {assembly.node_ids[node]} has axes of another *TRANSFORM", "give every node one system"
                )
            position = scope.rotation.T @ (assembly.position[node] - scope.translation)
            try:
                found[node] = scope.rotation @ _axes(kind, a, b, position, row)
            except DeckError:
                if kind == "R":
                    raise
                raise row.error(
                    f"node {assembly.node_ids[node]} lies on the axis: it has no radial direction",
                    "take it out of the node set",
                ) from None
    return found


def _axes(kind: str, a: FloatArray, b: FloatArray, position: FloatArray, row: Row) -> FloatArray:
    if kind == "R":
        return orthonormal(a, normal(a, b), row)
    pole, arm = b - a, position - a
    around = normal(pole, arm)
    if kind == "C":
        return orthonormal(np.cross(around, pole), pole, row)
    return orthonormal(arm, np.cross(arm, around), row)


def point_masses(assembly: Assembly, rotations: Mapping[int, int]) -> tuple[PointMass, ...]:
    """MASS elements with their *MASS; ROTARYI elements give a mass on the same node its inertia, or stand alone.

    I = [I11 I12 I13; · I22 I23; · · I33], its products with the sign of a tensor, turned with the instance.
    rotations: see `Supports.pairs`. Raises DeckError for an element without value or node, or on a ROT NODE, whose motions
    are rotations, and for values that are negative.
    """
    masses: dict[int, tuple[int, float]] = {}
    for row, (_, line) in _valued(assembly, "MASS", "MASS"):
        mass = line.real(0, "the mass")
        if mass < 0:
            raise line.error(f"the mass is {mass:g}, negative", "give a positive mass")
        masses[row] = (_node_of(assembly, row, rotations), mass)
    inertias: dict[int, tuple[int, FloatArray]] = {}
    for row, (scope, line) in _valued(assembly, "ROTARYI", "ROTARYINERTIA"):
        if line.keyword.parameters.get("ORIENTATION"):
            raise line.keyword.error("ORIENTATION is not supported", "write the inertia along the basic axes")
        a, b, c, ab, ac, bc = line.reals(6, "the inertia")
        tensor = np.array([[a, ab, ac], [ab, b, bc], [ac, bc, c]])
        lowest = float(np.linalg.eigvalsh(tensor)[0])
        if lowest < -1e-9 * np.abs(tensor).max():
            raise line.error(f"the least principal inertia is {lowest:g}, negative", "correct the six values")
        inertias[row] = (_node_of(assembly, row, rotations), scope.rotation @ tensor @ scope.rotation.T)
    points = [PointMass(int(assembly.element_ids[row]), node, mass) for row, (node, mass) in masses.items()]
    for row, (node, tensor) in inertias.items():
        i = next((i for i, point in enumerate(points) if point.node == node), None)
        if i is None:
            points.append(PointMass(int(assembly.element_ids[row]), node, 0.0, inertia=tensor))
        else:
            point = points[i]
            points[i] = PointMass(point.id, node, point.mass, inertia=point.inertia + tensor)
    return tuple(sorted(points, key=lambda point: point.id))


def _valued(assembly: Assembly, element: str, name: str) -> Iterable[tuple[int, tuple[Scope, Row]]]:
    """Rows of the elements of a type, with the data line that gives their value."""
    wanted = np.array([type_ == element for type_ in assembly.type], dtype=bool)
    given: dict[int, tuple[Scope, Row]] = {}
    for scope, keyword in assembly.keywords(name):
        if keyword.parameters.get("TYPE", "ISOTROPIC").upper() not in ("ISOTROPIC", ""):
            raise keyword.error("masses that differ by direction are not supported", "give one mass")
        line = keyword.rows()[0]
        rows = assembly.element_set(keyword.needs("ELSET"), scope, keyword)
        for row in rows[wanted[rows]].tolist():
            if row in given:
                raise keyword.error(f"element {assembly.element_ids[row]} has a value already", "give it one value")
            given[row] = (scope, line)
    for row in np.flatnonzero(wanted).tolist():
        if row not in given:
            file, number = assembly.element_where[row]
            raise DeckError(
                f"{element} {assembly.element_ids[row]} has no value",
                where=f"{file}:{number}",
                remedy=f"add its *{'MASS' if element == 'MASS' else 'ROTARY INERTIA'}",
            )
    return given.items()


def _node_of(assembly: Assembly, row: int, rotations: Mapping[int, int]) -> int:
    nodes = assembly.nodes[assembly.first[row] : assembly.first[row + 1]]
    name = f"{assembly.type[row]} {assembly.element_ids[row]}"
    file, number = assembly.element_where[row]
    if len(nodes) != 1 or nodes[0] < 0:
        raise DeckError(
            f"{name} does not stand on one node of the deck",
            where=f"{file}:{number}",
            remedy="give its id and one node",
        )
    if int(nodes[0]) in rotations:
        raise DeckError(
            f"{name} stands on node {assembly.node_ids[nodes[0]]}, the ROT NODE of a *RIGID BODY",
            where=f"{file}:{number}",
            remedy=f"put it on the reference node {assembly.node_ids[rotations[int(nodes[0])]]}",
        )
    return int(nodes[0])


def component_range(rows: list[Row], start: int) -> tuple[int, ...]:
    """Components 0-5 of data lines "first, last" that begin at entry `start`; all six where none is given."""
    found: set[int] = set()
    for row in rows:
        if not row.text(start):
            return tuple(range(6))
        first = row.integer(start, "the first degree of freedom")
        last = row.integer(start + 1, "the last degree of freedom", first) or first
        if not 1 <= first <= last <= 6:
            raise row.error(f"degrees of freedom {first} to {last}", "write the first and the last one, from 1 to 6")
        found |= set(range(first - 1, last))
    return tuple(sorted(found)) or tuple(range(6))
