"""What joins nodes of a mesh, and the masses and springs on them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from strainsight.mesh.thin import FloatArray, IntArray

STRAIGHT = "straight side"
"""Name of the relations of a mid-side node that is not in the file: it follows the mean motion of the ends of its side."""


@dataclass(frozen=True)
class RigidElement:
    """RBE2: the components (0-5) of `nodes` follow the six motions of node `reference` (all indices).

    Rotations of a dependent node count only where it is the reference of another element. name: in the words of the file,
    as in "RBE2 30" or "*COUPLING".
    """

    id: int
    reference: int
    nodes: IntArray
    components: tuple[int, ...]
    name: str = ""

    def __str__(self) -> str:
        return self.name or f"rigid element {self.id}"


@dataclass(frozen=True)
class AveragingElement:
    """RBE3: components (0-5) of node `reference` are the weighted mean motion of `nodes` (all indices).

    weight (k,) ≥ 0; directions (k, 3) which translations of each node count, None for all; dependent (c, 2) pairs (node
    index, component) that the c equations are solved for, as many as components, None for the reference's own; name: in the
    words of the file; rotations (k, 3) which of each node count, None for none.
    """

    id: int
    reference: int
    nodes: IntArray
    weight: FloatArray
    components: tuple[int, ...]
    directions: NDArray[np.bool_] | None = None
    dependent: IntArray | None = None
    name: str = ""
    rotations: NDArray[np.bool_] | None = None

    def __str__(self) -> str:
        return self.name or f"averaging element {self.id}"

    @property
    def turned(self) -> IntArray:
        """Nodes whose rotations count."""
        return self.nodes[:0] if self.rotations is None else self.nodes[self.rotations.any(axis=1)]


@dataclass(frozen=True)
class Relation:
    """MPC, *EQUATION: Σ value z[node, component] = 0 over its terms, the motion of the first one follows the others.

    node (k,) indices, component (k,) 0-5 along the axes of the node; value (k,) [-, m at the rotations]. name: in the words of
    the file, as in "MPC 7" or "*EQUATION". yields: it does not count where a support holds the motion that follows.
    """

    id: int
    node: IntArray
    component: IntArray
    value: FloatArray
    name: str = ""
    yields: bool = False

    def __str__(self) -> str:
        return self.name or f"relation {self.id}"

    @property
    def ties(self) -> bool:
        """Whether it joins what it is between: all do but a straight side, which is of one element."""
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
    """CONM2: mass [kg] on a node (index); its centre lies at offset (3,) [m] from the node, inertia (3, 3) [kg m²] about
    that centre, both along the basic axes. Or a mass that is another one along another axis (CONM1, CMASS): matrix (6, 6)
    [kg, kg m, kg m²] on the motions of the node along the basic axes, in place of offset and inertia; mass is then the mean over
    the axes, as it counts in the weight."""

    id: int
    node: int
    mass: float
    offset: FloatArray = field(default_factory=lambda: np.zeros(3))
    inertia: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    matrix: FloatArray | None = None

    @property
    def turns(self) -> bool:
        """Whether it resists rotations of its node."""
        own = (self.offset, self.inertia, np.zeros(1) if self.matrix is None else self.matrix[3:])
        return any(bool(np.any(part)) for part in own)


def matrix_mass(number: int, node: int, M: FloatArray) -> PointMass:
    """A point mass of a matrix (6, 6)."""
    return PointMass(number, node, float(np.trace(M[:3, :3])) / 3, matrix=M)


@dataclass(frozen=True)
class Springs:
    """Springs of one element or support: spring i resists its elongation s = Σ r z with the force k s, or the moment.

    name: in the words of the file or config; stiffness k (s,) [N/m, of a torsion spring N m/rad]; each of (e,): spring, an index
    into those; node (index); component 0-5 along the basic axes; value r [-, m at the rotations of a spring that stretches].
    """

    name: str
    stiffness: FloatArray
    spring: IntArray
    node: IntArray
    component: IntArray
    value: FloatArray

    @property
    def torsion(self) -> NDArray[np.bool_]:
        """(s,): springs of which every part is a rotation."""
        turns = np.ones(len(self.stiffness), dtype=bool)
        turns[self.spring[self.component < 3]] = False
        return turns

    @property
    def turned(self) -> IntArray:
        """Nodes whose rotations are in it."""
        return np.unique(self.node[(self.component > 2) & (self.value != 0)])

    def __str__(self) -> str:
        return self.name
