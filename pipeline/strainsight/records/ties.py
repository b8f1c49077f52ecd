"""Supports, ties and springs of a `Mesh` by columns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.mesh.joins import AveragingElement, Relation, RigidElement, Springs
from strainsight.records.lists import ALL, OFFSET, components, ints, joined, letters, split
from strainsight.records.record import dataset, group, record


@record
class RigidElements:
    """RBE2."""

    id: np.ndarray = dataset("/id", "1", "rigid element", "id of every rigid element (RBE2)")
    reference: np.ndarray = dataset("/reference", "1", "rigid element", "reference node index of every rigid element")
    components: tuple[str, ...] = dataset("/components", "1", "rigid element", "components 1-6 of its dependent nodes")
    name: tuple[str, ...] = dataset("/name", "1", "rigid element", "its name in the words of the file")
    nodes: np.ndarray = dataset("/nodes", "1", "dependent node", "dependent node indices" + ALL)
    nodes_offset: np.ndarray = dataset("/nodes_offset", "1", "rigid element + 1", OFFSET)

    @classmethod
    def of(cls, elements: Sequence[RigidElement]) -> RigidElements:
        nodes, offset = joined([e.nodes for e in elements], int)
        return cls(
            id=ints([e.id for e in elements]),
            reference=ints([e.reference for e in elements]),
            components=tuple(letters(e.components) for e in elements),
            name=tuple(e.name for e in elements),
            nodes=nodes,
            nodes_offset=offset,
        )

    def made(self) -> tuple[RigidElement, ...]:
        columns = (
            self.id.tolist(),
            self.reference.tolist(),
            split(self.nodes, self.nodes_offset),
            map(components, self.components),
            self.name,
        )
        return tuple(RigidElement(*row) for row in zip(*columns, strict=True))


@record
class AveragingElements:
    """RBE3."""

    id: np.ndarray = dataset("/id", "1", "averaging element", "id of every averaging element (RBE3)")
    reference: np.ndarray = dataset(
        "/reference", "1", "averaging element", "reference node index of every averaging element"
    )
    components: tuple[str, ...] = dataset(
        "/components", "1", "averaging element", "components 1-6 of its reference node"
    )
    name: tuple[str, ...] = dataset("/name", "1", "averaging element", "its name in the words of the file")
    nodes: np.ndarray = dataset("/nodes", "1", "averaged node", "node indices" + ALL)
    nodes_offset: np.ndarray = dataset("/nodes_offset", "1", "averaging element + 1", OFFSET)
    weight: np.ndarray = dataset("/weight", "1", "averaged node", "weights" + ALL)
    weight_offset: np.ndarray = dataset("/weight_offset", "1", "averaging element + 1", OFFSET)
    directions: np.ndarray = dataset(
        "/directions", "1", "averaged node × 3", "1 where a translation of a node counts" + ALL
    )
    directions_offset: np.ndarray = dataset("/directions_offset", "1", "averaging element + 1", OFFSET)
    rotations: np.ndarray = dataset("/rotations", "1", "averaged node × 3", "1 where a rotation of a node counts" + ALL)
    dependent: np.ndarray = dataset(
        "/dependent",
        "1",
        "component × 2",
        "[node index, component] that the relations are solved for (UM); none: the reference's own" + ALL,
    )
    dependent_offset: np.ndarray = dataset("/dependent_offset", "1", "averaging element + 1", OFFSET)

    @classmethod
    def of(cls, elements: Sequence[AveragingElement]) -> AveragingElements:
        counted = [np.ones((len(e.nodes), 3), bool) if e.directions is None else e.directions for e in elements]
        turned = [np.zeros((len(e.nodes), 3), bool) if e.rotations is None else e.rotations for e in elements]
        solved = [np.zeros((0, 2), np.int64) if e.dependent is None else e.dependent for e in elements]
        nodes, nodes_offset = joined([e.nodes for e in elements], int)
        weight, weight_offset = joined([e.weight for e in elements], float)
        directions, directions_offset = joined(counted, int, (3,))
        dependent, dependent_offset = joined(solved, int, (2,))
        return cls(
            id=ints([e.id for e in elements]),
            reference=ints([e.reference for e in elements]),
            components=tuple(letters(e.components) for e in elements),
            name=tuple(e.name for e in elements),
            nodes=nodes,
            nodes_offset=nodes_offset,
            weight=weight,
            weight_offset=weight_offset,
            directions=directions,
            directions_offset=directions_offset,
            rotations=joined(turned, int, (3,))[0],
            dependent=dependent,
            dependent_offset=dependent_offset,
        )

    def made(self) -> tuple[AveragingElement, ...]:
        columns = (
            self.id.tolist(),
            self.reference.tolist(),
            split(self.nodes, self.nodes_offset),
            split(self.weight, self.weight_offset),
            map(components, self.components),
            [entry.astype(bool) for entry in split(self.directions, self.directions_offset)],
            [entry if len(entry) else None for entry in split(self.dependent, self.dependent_offset)],
            self.name,
            [entry.astype(bool) if entry.any() else None for entry in split(self.rotations, self.directions_offset)],
        )
        return tuple(AveragingElement(*row) for row in zip(*columns, strict=True))


@record
class Relations:
    """MPC, *EQUATION: the sum of value times motion is zero, the first motion follows the others."""

    id: np.ndarray = dataset("/id", "1", "relation", "number of every relation (MPC, *EQUATION)")
    name: tuple[str, ...] = dataset("/name", "1", "relation", "its name in the words of the file")
    node: np.ndarray = dataset("/node", "1", "term", "node index of every motion" + ALL)
    component: np.ndarray = dataset(
        "/component", "1", "term", "component of that motion, along the axes of its node: 0-2 motions, 3-5 rotations"
    )
    value: np.ndarray = dataset("/value", "SI", "term", "what multiplies that motion; of a rotation in m")
    term_offset: np.ndarray = dataset("/term_offset", "1", "relation + 1", OFFSET)

    @classmethod
    def of(cls, relations: Sequence[Relation]) -> Relations:
        node, term_offset = joined([own.node for own in relations], int)
        return cls(
            id=ints([own.id for own in relations]),
            name=tuple(own.name for own in relations),
            node=node,
            component=joined([own.component for own in relations], int)[0],
            value=joined([own.value for own in relations], float)[0],
            term_offset=term_offset,
        )

    def made(self) -> tuple[Relation, ...]:
        terms = [split(own, self.term_offset) for own in (self.node, self.component, self.value)]
        return tuple(Relation(*row) for row in zip(self.id.tolist(), *terms, self.name, strict=True))


@record
class Axes:
    """Displacement systems of their own (CD)."""

    node: np.ndarray = dataset("/node", "1", "turned node", "node indices with a displacement system of their own")
    direction: np.ndarray = dataset(
        "/direction", "1", "turned node × 3 × 3", "their axes, one in a column (node × xyz × axis)"
    )


@record
class Constraints:
    fixed: np.ndarray = dataset(
        "/fixed",
        "1",
        "held component × 2",
        "components held at zero: [node index, component], 0-2 motions, 3-5 rotations",
    )
    rigid: tuple[RigidElement, ...] = group("/rigid", RigidElements)
    averaging: tuple[AveragingElement, ...] = group("/averaging", AveragingElements)
    relations: tuple[Relation, ...] = group("/relations", Relations)
    axes: Axes = group("/axes")


@record
class SpringColumns:
    """Springs of elements and supports."""

    name: tuple[str, ...] = dataset("/name", "1", "support", "element or support in the words of the file or config")
    stiffness: np.ndarray = dataset("/stiffness", "SI", "spring", "N/m, of torsion springs N m/rad" + ALL)
    stiffness_offset: np.ndarray = dataset("/stiffness_offset", "1", "support + 1", OFFSET)
    spring: np.ndarray = dataset("/spring", "1", "part", "which spring of its list a motion is a part of" + ALL)
    node: np.ndarray = dataset("/node", "1", "part", "node index of that motion")
    component: np.ndarray = dataset("/component", "1", "part", "component of that motion: 0-2 motions, 3-5 rotations")
    value: np.ndarray = dataset("/value", "SI", "part", "elongation for a unit of that motion")
    part_offset: np.ndarray = dataset("/part_offset", "1", "support + 1", OFFSET)

    @classmethod
    def of(cls, elements: Sequence[Springs]) -> SpringColumns:
        stiffness, stiffness_offset = joined([e.stiffness for e in elements], float)
        spring, part_offset = joined([e.spring for e in elements], int)
        return cls(
            name=tuple(e.name for e in elements),
            stiffness=stiffness,
            stiffness_offset=stiffness_offset,
            spring=spring,
            node=joined([e.node for e in elements], int)[0],
            component=joined([e.component for e in elements], int)[0],
            value=joined([e.value for e in elements], float)[0],
            part_offset=part_offset,
        )

    def made(self) -> tuple[Springs, ...]:
        parts = [split(own, self.part_offset) for own in (self.spring, self.node, self.component, self.value)]
        each = zip(self.name, split(self.stiffness, self.stiffness_offset), *parts, strict=True)
        return tuple(Springs(*row) for row in each)
