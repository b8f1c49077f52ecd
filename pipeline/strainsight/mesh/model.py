"""What a deck says, in SI units and with the ids of the file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

ELEMENT_KINDS = ("tet4", "tet10", "hex8", "hex20", "wedge6", "wedge15")


@dataclass(frozen=True)
class CellBlock:
    """Elements of one kind: ids (n,) of the file, nodes (n, k) indices of nodes in VTK order, region (n,) ids."""

    kind: str
    ids: IntArray
    nodes: IntArray
    region: IntArray


@dataclass(frozen=True)
class Material:
    """Linear isotropic: youngs_modulus [Pa], poisson_ratio [-], density [kg/m³]."""

    id: int
    youngs_modulus: float
    poisson_ratio: float
    density: float


@dataclass(frozen=True)
class Region:
    """A property that elements refer to (a PSOLID, an element set, a physical group) and its material id."""

    id: int
    name: str
    material: int


@dataclass(frozen=True)
class RigidElement:
    """RBE2: the components (0-2) of `nodes` follow the six motions of node `reference` (all indices)."""

    id: int
    reference: int
    nodes: IntArray
    components: tuple[int, ...]


@dataclass(frozen=True)
class AveragingElement:
    """RBE3: components (0-5) of node `reference` are the weighted mean motion of `nodes`; weight (k,)."""

    id: int
    reference: int
    nodes: IntArray
    weight: FloatArray
    components: tuple[int, ...]


@dataclass(frozen=True)
class PointMass:
    """CONM2: a mass [kg] on a node (index)."""

    id: int
    node: int
    mass: float


@dataclass(frozen=True)
class Mesh:
    """A finite-element model as its file says it, lengths in m, masses in kg.

    node_ids (n,) of the file; position (n, 3) [m]; blocks of cells; fixed (f, 2) pairs (node index, component 0-5)
    that are held at zero; node_sets and element_sets name → ids of the file; ignored card → count not taken over;
    included: files that the deck takes in.
    """

    node_ids: IntArray
    position: FloatArray
    blocks: tuple[CellBlock, ...]
    regions: Mapping[int, Region]
    materials: Mapping[int, Material]
    fixed: IntArray
    rigid: tuple[RigidElement, ...] = ()
    averaging: tuple[AveragingElement, ...] = ()
    point_masses: tuple[PointMass, ...] = ()
    node_sets: Mapping[str, IntArray] = field(default_factory=dict)
    element_sets: Mapping[str, IntArray] = field(default_factory=dict)
    ignored: Mapping[str, int] = field(default_factory=dict)
    source: str = ""
    included: tuple[str, ...] = ()

    def node_index(self, node_id: int) -> int:
        """Index of the node with this id of the file; KeyError where there is none."""
        hits = np.flatnonzero(self.node_ids == node_id)
        if hits.size == 0:
            raise KeyError(node_id)
        return int(hits[0])
