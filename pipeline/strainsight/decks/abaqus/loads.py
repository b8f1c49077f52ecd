"""Loads of an Abaqus deck: concentrated loads, pressures on elements and surfaces, gravity and rotation."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.decks.abaqus.scopes import Assembly, Scope
from strainsight.decks.abaqus.sections import Sections
from strainsight.decks.abaqus.surfaces import Surfaces, facets_of, shell_facets
from strainsight.decks.abaqus.text import Keyword, Row
from strainsight.decks.faults import moment_note
from strainsight.decks.text import parse_integer
from strainsight.mesh.facets import Traction, consistent_forces
from strainsight.mesh.joins import BodyForce, NodalForces
from strainsight.mesh.kinds.kind import Kind
from strainsight.mesh.model import FloatArray, IntArray
from strainsight.mesh.thin import Laminate, ShellSection, concatenate

AXES = {"BX": 0, "BY": 1, "BZ": 2}
"""Label of a force per volume → direction."""


@dataclass(frozen=True)
class LoadReader:
    """Reader of loads; rotations: see `Supports.pairs`; axes: row of a node → its *TRANSFORM; other loads are counted."""

    surfaces: Surfaces
    axes: Mapping[int, FloatArray]
    rotations: Mapping[int, int]
    sections: Sections
    ignored: Counter[str]

    def read(self, turning: Collection[int]) -> dict[str, NodalForces]:
        """Loads of *CLOAD, *DLOAD and *DSLOAD as CLOAD-1, CLOAD-2, …, DLOAD-1, …, in the order of the file.

        turning: rows of nodes with rotations; moments on other nodes become a note. Raises DeckError for missing
        nodes, elements and surfaces, and for an incomplete data line."""
        assembly = self.surfaces.assembly
        readers = {"CLOAD": self._concentrated, "DLOAD": self._distributed, "DSLOAD": self._on_surfaces}
        loads = {
            f"{name}-{number}": load
            for name, read in readers.items()
            for number, (scope, keyword) in enumerate(assembly.keywords(name, of_steps=True), start=1)
            if (load := read(scope, keyword)) is not None
        }
        turned = [load.nodes[load.moment.any(axis=1)] for load in loads.values() if load.moment is not None]
        if loose := {int(row) for rows in turned for row in rows if row not in turning}:
            ids = sorted(int(assembly.node_ids[row]) for row in loose)
            assembly.notes.append(moment_note("*CLOAD", ids))
        return loads

    def _concentrated(self, scope: Scope, keyword: Keyword) -> NodalForces | None:
        """Forces and moments along nodal axes, rotated to basic axes; a force on the ROT NODE of a *RIGID BODY
        (CalculiX) is a moment on its reference node."""
        force: dict[int, FloatArray] = {}
        moment: dict[int, FloatArray] = {}
        for row in keyword.rows(needed=False):
            nodes = self.surfaces.assembly.rows("NODE", row.text(0), scope, row)
            component, value = row.component(1), row.real(2, "the force")
            for node in nodes.tolist():
                direction = self.axes.get(node, np.eye(3))[:, component % 3]
                values = moment if component > 2 or node in self.rotations else force
                at = node if values is force else self.rotations.get(node, node)
                values[at] = values.get(at, np.zeros(3)) + value * direction
        if not (force or moment):
            return None
        loaded = list(dict.fromkeys([*force, *moment]))
        forces, moments = (np.array([vectors.get(node, np.zeros(3)) for node in loaded]) for vectors in (force, moment))
        return NodalForces(np.array(loaded), forces, moments if moment else None)

    def _distributed(self, scope: Scope, keyword: Keyword) -> NodalForces | None:
        """P1 to P6: pressure p on a facet of a solid, t = −p n.   P: on a shell, along its normal, t = p n (Abaqus
        guide to prescribed conditions, distributed loads).   BX to BZ: force per volume of shells.   GRAV: g times a
        direction. CENTRIF: Ω², a point and the axis."""
        assembly = self.surfaces.assembly
        parts: list[tuple[IntArray, FloatArray]] = []
        body: list[BodyForce] = []
        for row in keyword.rows(needed=False):
            label = row.text(1).upper()
            if label in ("GRAV", "CENTRIF"):
                body.append(_body(assembly, scope, row, label))
                continue
            number = parse_integer(label[1:]) if label[:1] == "P" else None
            if label != "P" and number is None and label not in AXES:
                self.ignored[f"*DLOAD {label}"] += 1
                continue
            rows = assembly.rows("ELEMENT", row.text(0), scope, row)
            shells = rows[assembly.families[rows] == "shell"]
            if label in AXES and shells.size < rows.size:
                self.ignored[f"*DLOAD {label}"] += 1
            elif label in AXES:
                parts += self._per_volume(rows, AXES[label], row.real(2, "the force per volume"))
            elif number is None:
                if shells.size < rows.size:
                    self.ignored["*DLOAD P on elements that are not shells"] += 1
                parts += _pressure_forces(assembly, shell_facets(assembly, shells), -row.real(2, "the pressure"))
            else:
                solid = rows[assembly.kind[rows] >= 0]
                if solid.size < rows.size:
                    self.ignored["*DLOAD on elements that are not solids"] += 1
                parts += _pressure_forces(
                    assembly, facets_of(assembly, solid, number, row, "P"), row.real(2, "the pressure")
                )
        return _sum_forces(parts, body)

    def _per_volume(self, rows: IntArray, axis: int, b: float) -> list[tuple[IntArray, FloatArray]]:
        """Force b per volume of the shells in rows along a basic axis, b t per area."""
        loads = []
        assembly, region = self.surfaces.assembly, self.sections.region
        for number in np.unique(region[rows]).tolist():
            section = self.sections.properties.sections.get(number)
            if isinstance(section, ShellSection | Laminate):
                t = b * section.thickness * np.eye(3)[axis]
                loads += _facet_forces(
                    assembly, shell_facets(assembly, rows[region[rows] == number]), _uniform_traction(t)
                )
        return loads

    def _on_surfaces(self, scope: Scope, keyword: Keyword) -> NodalForces | None:
        """P: pressure p on a *SURFACE of facets, t = −p n; the side SNEG of a shell reverses its normal n."""
        parts: list[tuple[IntArray, FloatArray]] = []
        for row in keyword.rows(needed=False):
            if (label := row.text(1).upper()) != "P":
                self.ignored[f"*DSLOAD {label}"] += 1
                continue
            surface = self.surfaces.find(row.text(0), scope, row)
            if not surface.facets:
                raise row.error(
                    f"surface {row.text(0)!r} has no facets",
                    "define the surface by element facets (*SURFACE, TYPE=ELEMENT)",
                )
            if surface.sideless:
                raise row.error(
                    f"surface {row.text(0)!r} contains shell edges, or shells without SPOS or SNEG",
                    "in *SURFACE, write SPOS or SNEG for each shell (side of the pressure), and remove shell edges",
                )
            parts += _pressure_forces(self.surfaces.assembly, surface.facets, row.real(2, "the pressure"))
        return _sum_forces(parts, [])


def _body(assembly: Assembly, scope: Scope, row: Row, label: str) -> BodyForce:
    """Gravity or rotation of the elements and point masses of a set, or of all if no set is named."""
    rows = assembly.rows("ELEMENT", row.text(0), scope, row) if row.text(0) else None
    elements = None if rows is None else np.sort(assembly.element_ids[rows])
    size = row.real(2, "the magnitude")
    start = 3 if label == "GRAV" else 6
    direction = np.array([row.real(start + i, "a component of the load direction", 0.0) for i in range(3)])
    if not (length := float(np.linalg.norm(direction))) > 0:
        raise row.error(f"the direction of {label} is zero", "specify three components that are not all zero")
    direction = scope.rotation @ direction / length
    if label == "GRAV":
        return BodyForce(acceleration=size * direction, elements=elements)
    if size < 0:
        raise row.error(
            f"the squared angular velocity is {size:g}, negative", "set entry 3 of this line to Ω² [rad²/s²]"
        )
    point = np.array([row.real(3 + i, "a coordinate of the point on the rotation axis", 0.0) for i in range(3)])
    centre = scope.rotation @ point + scope.translation
    return BodyForce(rotation=np.sqrt(size) * direction, centre=centre, elements=elements)


def _pressure_forces(
    assembly: Assembly, facets: Sequence[tuple[Kind, IntArray]], p: float
) -> list[tuple[IntArray, FloatArray]]:
    return _facet_forces(assembly, facets, lambda x, n, _: -p * n)


def _uniform_traction(t: FloatArray) -> Traction:
    """Uniform traction."""
    return lambda x, n, _: np.broadcast_to(t, x.shape)


def _facet_forces(
    assembly: Assembly, facets: Sequence[tuple[Kind, IntArray]], traction: Traction
) -> list[tuple[IntArray, FloatArray]]:
    return [
        (nodes.ravel(), consistent_forces(assembly.position, kind, nodes, traction).reshape(-1, 3))
        for kind, nodes in facets
    ]


def _sum_forces(parts: list[tuple[IntArray, FloatArray]], body: list[BodyForce]) -> NodalForces | None:
    if not (parts or body):
        return None
    nodes, place = np.unique(concatenate(nodes for nodes, _ in parts), return_inverse=True)
    force = np.zeros((len(nodes), 3))
    if parts:
        np.add.at(force, place, np.concatenate([forces for _, forces in parts]))
    return NodalForces(nodes, force, body=tuple(body))
