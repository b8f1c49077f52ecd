"""Ties between nodes of a mesh, point masses, springs and loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from strainsight.columns import Column
from strainsight.errors import DeckError
from strainsight.mesh.thin import FloatArray, IntArray

STRAIGHT = "straight side"
"""Name of the relations of an omitted mid-side node, which follows the mean motion of the ends of its side."""


@dataclass(frozen=True)
class RigidElement:
    """RBE2: the components (0-5) of `nodes` follow the six motions of node `reference` (all indices).

    Rotations of a dependent node count only if it is the reference of another element. Names are as "RBE2 30", "*COUPLING"."""

    id: Annotated[int, Column("1", "", "id of every rigid element (RBE2)")]
    reference: Annotated[int, Column("1", "", "index in /nodes/id of the reference node of every rigid element")]
    nodes: Annotated[IntArray, Column("1", "dependent node", "indices of the dependent nodes of every rigid element")]
    components: Annotated[tuple[int, ...], Column("1", "", "dependent components 1-6 of every rigid element")]
    name: Annotated[str, Column("1", "", "name of the rigid element in the mesh file or config")] = ""

    def __str__(self) -> str:
        return self.name or f"rigid element {self.id}"


@dataclass(frozen=True)
class AveragingElement:
    """RBE3: components (0-5) of node `reference` are the weighted mean motion of `nodes` (all indices).

    weight ≥ 0; directions: None for all; dependent: as many as components, None for those of the reference."""

    id: Annotated[int, Column("1", "", "id of every averaging element (RBE3)")]
    reference: Annotated[int, Column("1", "", "reference node index of every averaging element")]
    nodes: Annotated[IntArray, Column("1", "averaged node", "indices of the averaged nodes of every averaging element")]
    weight: Annotated[FloatArray, Column("1", "averaged node", "weights of the averaged nodes")]
    components: Annotated[
        tuple[int, ...], Column("1", "", "components 1-6 of the reference node that follow the average")
    ]
    directions: Annotated[
        NDArray[np.bool_] | None,
        Column("1", "averaged node × 3", "1 if this translation of the averaged node enters the average", none=1),
    ] = None
    dependent: Annotated[
        IntArray | None,
        Column(
            "1",
            "component × 2",
            "dependent motions as [node index, component 0-5] (UM); without UM, those of the reference node",
        ),
    ] = None
    name: Annotated[str, Column("1", "", "name of the averaging element in the mesh file or config")] = ""
    rotations: Annotated[
        NDArray[np.bool_] | None,
        Column(
            "1",
            "averaged node × 3",
            "1 if this rotation of the averaged node enters the average",
            offset="directions_offset",
        ),
    ] = None

    def __str__(self) -> str:
        return self.name or f"averaging element {self.id}"

    @property
    def turned(self) -> IntArray:
        """Nodes whose rotations count."""
        return self.nodes[:0] if self.rotations is None else self.nodes[self.rotations.any(axis=1)]

    def with_nodes(self, reference: int, nodes: IntArray, at: IntArray) -> AveragingElement:
        """The element on other nodes (c k,), those of c copies in order; weights of merged nodes are added; at: old index → new.

        Raises DeckError for merged nodes that count in different directions."""
        row = np.arange(len(nodes)) % len(self.nodes)
        counts = [flags[row].astype(int) for flags in (self.directions, self.rotations) if flags is not None]
        key = np.column_stack([nodes, *counts])
        _, first, of = np.unique(key, axis=0, return_index=True, return_inverse=True)
        if len(np.unique(nodes)) < len(first):
            raise DeckError(
                f"{self}: two coincident nodes of this averaging element have different components",
                remedy="Use the same components for both nodes.",
                entity=("tie", self.id),
            )
        dependent = self.dependent
        return replace(
            self,
            reference=reference,
            nodes=nodes[first],
            weight=np.bincount(of.ravel(), self.weight[row]).astype(float),
            directions=None if self.directions is None else self.directions[row[first]],
            rotations=None if self.rotations is None else self.rotations[row[first]],
            dependent=None if dependent is None else np.column_stack([at[dependent[:, 0]], dependent[:, 1]]),
        )


@dataclass(frozen=True)
class Relation:
    """MPC, *EQUATION: Σ value z[node, component] = 0 over its terms, the motion of the first one follows the others.

    Names are as "MPC 7", "*EQUATION". yields: the relation is dropped if a support clamps its dependent motion."""

    id: Annotated[int, Column("1", "", "id of every constraint equation (MPC, *EQUATION)")]
    node: Annotated[
        IntArray,
        Column("1", "term", "node index of every term of every constraint equation (MPC)", offset="term_offset"),
    ]
    component: Annotated[
        IntArray,
        Column(
            "1",
            "term",
            "component of the term, in the axes of its node: 0-2 translations, 3-5 rotations",
            offset="term_offset",
        ),
    ]
    value: Annotated[
        FloatArray,
        Column(
            "SI", "term", "coefficient of the term; unit 1 for a translation, m for a rotation", offset="term_offset"
        ),
    ]
    name: Annotated[str, Column("1", "", "name of the constraint equation in the mesh file or config")] = ""
    yields: bool = False

    def __str__(self) -> str:
        return self.name or f"constraint equation {self.id}"

    @property
    def ties(self) -> bool:
        """Whether it connects different parts: all relations except a straight side, which belongs to one element."""
        return self.name != STRAIGHT

    @property
    def follower(self) -> tuple[int, int]:
        """Node and component of the motion that follows."""
        return int(self.node[0]), int(self.component[0])

    @property
    def turned(self) -> IntArray:
        """Nodes whose rotations are in it."""
        return np.unique(self.node[(self.component > 2) & (self.value != 0)])


@dataclass(frozen=True)
class PointMass:
    """CONM2, along the basic axes. A mass that differs between axes (CONM1, CMASS) is a matrix [kg, kg m, kg m²] on the motions
    of the node instead of offset and inertia; mass is then the mean over the axes, as counted in the weight."""

    id: Annotated[int, Column("1", "", "id of every point mass")]
    node: Annotated[int, Column("1", "", "node index of every point mass")]
    mass: Annotated[float, Column("kg", "", "mass of every point mass")]
    offset: Annotated[FloatArray, Column("m", "3", "offset of the centre of mass from the node, in global axes")] = (
        field(default_factory=lambda: np.zeros(3))
    )
    inertia: Annotated[
        FloatArray,
        Column("kg m^2", "3 × 3", "inertia tensor of every point mass about its centre of mass, in global axes"),
    ] = field(default_factory=lambda: np.zeros((3, 3)))
    matrix: Annotated[
        FloatArray | None,
        Column(
            "SI",
            "6 × 6",
            "mass matrix about the node in global axes, for a mass that differs between axes (CONM1, CMASS); otherwise 0",
        ),
    ] = None

    @property
    def turns(self) -> bool:
        """Whether it resists rotations of its node."""
        parts = (self.offset, self.inertia, np.zeros(1) if self.matrix is None else self.matrix[3:])
        return any(bool(np.any(part)) for part in parts)

    def rotated(self, R: FloatArray) -> PointMass:
        """The mass rotated by R (3, 3)."""
        both = np.kron(np.eye(2), R)
        matrix = None if self.matrix is None else both @ self.matrix @ both.T
        return replace(self, offset=R @ self.offset, inertia=R @ self.inertia @ R.T, matrix=matrix)


@dataclass(frozen=True)
class Springs:
    """Springs of one element or support: spring i resists its elongation s = Σ r z with the force k s, or the moment.

    Components are along the basic axes; r is in m for the rotations of an axial spring."""

    name: Annotated[str, Column("1", "", "name of the spring element or support in the file or config")]
    stiffness: Annotated[FloatArray, Column("SI", "spring", "spring stiffness: N/m, for torsion springs N m/rad")]
    spring: Annotated[
        IntArray,
        Column(
            "1",
            "term",
            "index of the spring; a spring has one term for each node motion that elongates it",
            offset="part_offset",
        ),
    ]
    node: Annotated[
        IntArray, Column("1", "term", "index of the node whose motion elongates the spring", offset="part_offset")
    ]
    component: Annotated[
        IntArray,
        Column("1", "term", "component of the node motion: 0-2 translations, 3-5 rotations", offset="part_offset"),
    ]
    value: Annotated[
        FloatArray,
        Column("SI", "term", "elongation of the spring per m or rad of this node motion", offset="part_offset"),
    ]

    @property
    def torsion(self) -> NDArray[np.bool_]:
        """(s,): springs with rotations only."""
        turns = np.ones(len(self.stiffness), dtype=bool)
        turns[self.spring[self.component < 3]] = False
        return turns

    @property
    def turned(self) -> IntArray:
        """Nodes whose rotations are in it."""
        return np.unique(self.node[(self.component > 2) & (self.value != 0)])

    def rotated(self, R: FloatArray) -> Springs:
        """The springs rotated by R (3, 3): three terms for each of these."""
        return replace(
            self,
            spring=np.repeat(self.spring, 3),
            node=np.repeat(self.node, 3),
            component=(3 * (self.component // 3)[:, None] + np.arange(3)).ravel(),
            value=(self.value[:, None] * R[:, self.component % 3].T).ravel(),
        )

    def __str__(self) -> str:
        return self.name


def spring_between(name: str, stiffness: float, ends: Sequence[tuple[int, int, FloatArray]]) -> Springs:
    """One spring; ends: node, 0 for translations or 3 for rotations, and the elongation (3,) per unit of each."""
    node, first, value = zip(*ends, strict=True)
    return Springs(
        name,
        np.array([stiffness]),
        np.zeros(3 * len(ends), dtype=np.int64),
        np.repeat(node, 3).astype(np.int64),
        np.concatenate([component + np.arange(3) for component in first]),
        np.concatenate(value),
    )


@dataclass(frozen=True)
class BodyForce:
    """A body force on every mass dm: dm factor a(x),  a = g + (ω × (x − c)) × ω.

    acceleration g (3,) [m/s²], rotation ω (3,) [rad/s] about the point centre c (3,) [m]; elements: ids of the solids and point
    masses that it acts on, None for all."""

    acceleration: Annotated[FloatArray, Column("m/s^2", "3", "acceleration g of the body force, in global axes")] = (
        field(default_factory=lambda: np.zeros(3))
    )
    rotation: FloatArray = field(default_factory=lambda: np.zeros(3))
    centre: Annotated[FloatArray, Column("m", "3", "a point of the rotation axis of the body force")] = field(
        default_factory=lambda: np.zeros(3)
    )
    elements: IntArray | None = None
    factor: float = 1.0


@dataclass(frozen=True)
class NodalForces:
    """A load of the file (one load set), along the basic axes; body: body forces not yet included in force. regions: those whose
    mass contributes to the forces, which are proportional to their density."""

    nodes: Annotated[IntArray, Column("1", "loaded node", "node index of every node on which the load acts")]
    force: Annotated[FloatArray, Column("N", "loaded node × 3", "forces on the loaded nodes, in global axes")]
    moment: Annotated[
        FloatArray | None,
        Column(
            "N m",
            "loaded node × 3",
            "moments on the loaded nodes, in global axes; 0 without moment",
            offset="force_offset",
        ),
    ] = None
    body: tuple[BodyForce, ...] = ()
    regions: Annotated[
        tuple[int, ...], Column("1", "region", "ids of the regions whose mass causes the load (gravity, rotation)")
    ] = ()
