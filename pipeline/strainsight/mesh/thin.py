"""Shells, beams and rods of a mesh: elements on a surface or a line, with the sections that make them solid."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from strainsight.mesh.laminates import Laminate

IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]

SHELL_KINDS = ("quad4", "tri3", "quad8", "tri6")
CORNERS = {3: 3, 4: 4, 6: 3, 8: 4}
"""Nodes of a shell → how many are at its corners, the first ones; the others lie on its sides, the first between 1 and 2."""
BEAM_KINDS = ("beam", "rod", "beam3")


@dataclass(frozen=True)
class ShellSection:
    """Thickness t [m] of a homogeneous shell; what its stiffness in bending is of t³/12 (12 I/t³ of a PSHELL, 0 of a
    membrane), and in shear of G t (t_s/t, 5/6 of a homogeneous one, infinite where it does not shear); mass that is not of its
    material [kg/m²]."""

    thickness: float
    bending: float = 1.0
    shear: float = 5 / 6
    nonstructural: float = 0.0


@dataclass(frozen=True)
class GeneralShell:
    """Section of a shell whose membrane, bending and shear are of different or anisotropic materials, along x and y of these:

        N = t M ε + t² C κ,   M = t² C ε + t³/12 D κ,   Q = t S γ,     strain ε + z κ in the order xx, yy, xy, γ_xy = 2 ε_xy

    thickness t [m]; membrane M, coupling C, bending D (3, 3) and shear S (2, 2) of xz, yz [Pa], its diagonal infinite where it
    does not shear; density [kg/m³]; mass that is not of its materials [kg/m²]; uniform: one material in the membrane and in
    bending, and nothing between them, so that M makes stress of the strain on its faces.
    """

    thickness: float
    membrane: FloatArray
    coupling: FloatArray
    bending: FloatArray
    shear: FloatArray
    density: float
    uniform: bool
    nonstructural: float = 0.0

    @property
    def modulus(self) -> float:
        """The larger of Young's moduli of the membrane along x and y [Pa], 1/(M⁻¹)₁₁ and 1/(M⁻¹)₂₂."""
        return float(1 / np.diagonal(np.linalg.inv(self.membrane))[:2].min())

    def stiffer(self, factor: float) -> GeneralShell:
        """All stiffness times a factor."""
        moduli = {name: factor * getattr(self, name) for name in ("membrane", "coupling", "bending", "shear")}
        return replace(self, **moduli)


@dataclass(frozen=True)
class BeamSection:
    """Section of a beam at its end A, and at B where it is another, linear in between; axes y and z across the beam.

    area A [m²]; second (2, 2) ∫ (y, z)ᵀ (y, z) dA [m⁴], so that I1 of a PBAR is its yy; torsion J [m⁴]; shear (2,) areas over A
    along y and z (K1, K2; 0 where it does not shear); points (p, 2) y and z where its strain is asked for [m]; mass that is not
    of its material [kg/m]; sides: on which of the sides +y, +z, −y and −z of the box about its points it has material in the
    middle, so that a gauge can sit there; y and z [m] from the axis of the element, through the shear centres: neutral, of the
    neutral axis, where its own mass is (N1, N2 of a PBEAM), and beside, of mass that is not of its material (M1, M2).
    """

    area: float
    second: FloatArray = field(default_factory=lambda: np.zeros((2, 2)))
    torsion: float = 0.0
    shear: tuple[float, float] = (0.0, 0.0)
    points: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    nonstructural: float = 0.0
    at_b: BeamSection | None = None
    sides: tuple[bool, bool, bool, bool] = (True, True, True, True)
    neutral: tuple[float, float] = (0.0, 0.0)
    beside: tuple[float, float] = (0.0, 0.0)


Section = ShellSection | GeneralShell | Laminate | BeamSection


@dataclass(frozen=True)
class ShellBlock:
    """Shells of one kind of `SHELL_KINDS`: ids (n,) of the file, nodes (n, k) indices in order around the element, corners
    before those between them, region (n,) ids; offset (n,) [m] of the middle of the shell from its nodes, along the normal that
    the order of nodes gives; axis (n, 3) a vector whose projection on the shell is x of its material, NaN where that is the side
    from the first node to the second; on_faces (n, 2, k) indices of the nodes on its upper and lower face, where they are
    there."""

    kind: str
    ids: IntArray
    nodes: IntArray
    region: IntArray
    offset: FloatArray
    axis: FloatArray
    on_faces: IntArray = field(default_factory=lambda: np.zeros((0, 2, 0), dtype=np.int64))

    @property
    def corners(self) -> IntArray:
        """Indices (n, c) of the nodes at its corners."""
        return self.nodes[:, : CORNERS[self.nodes.shape[1]]]


@dataclass(frozen=True)
class BeamBlock:
    """Elements of one kind, straight "beam" or "rod" (which has neither bending nor shear), or "beam3" with a node between its
    ends, which may be curved: ids (n,), nodes (n, k) indices of ends A and B and of the node between, region (n,) ids; axes
    (n, 3, 3) x, y, z of the beam, one in a column, x from A to B where the offsets have moved them; offset (n, k, 3) [m] of the
    beam from its nodes, along the basic axes; released (n, 2, 6) motions of each end, along those axes of the beam, that it does
    not hand on to its node (pin flags; none of "beam3"); on_sides (n, 4, 4 or 8) indices of the nodes on its sides, −1 where it
    has none."""

    kind: str
    ids: IntArray
    nodes: IntArray
    region: IntArray
    axes: FloatArray
    offset: FloatArray
    released: NDArray[np.bool_]
    on_sides: IntArray = field(default_factory=lambda: np.zeros((0, 4, 4), dtype=np.int64))


def nodes_that_turn(shells: Sequence[ShellBlock], beams: Sequence[BeamBlock]) -> IntArray:
    """Indices, ascending, of the nodes whose rotations shells and beams resist; rods and solids resist none."""
    own = [*(block.nodes for block in shells), *(block.nodes for block in beams if block.kind != "rod")]
    return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(nodes.ravel() for nodes in own)]))


def nodes_along_beams(shells: Sequence[ShellBlock], beams: Sequence[BeamBlock]) -> IntArray:
    """Indices, ascending, of both nodes of every beam that runs along a side of a shell, or along half of one; no rods."""
    none = [np.zeros((0, 2), dtype=np.int64)]
    lines = [block.nodes[:, pair] for block in beams for pair in _SPANS[block.kind]]
    ends = np.sort(np.concatenate(none + lines), axis=1)
    if not len(ends):
        return ends.ravel()
    size = int(max(ends.max(), *(block.nodes.max(initial=0) for block in shells), 0)) + 1
    sides = np.sort(np.concatenate(none + [_sides(block) for block in shells]), axis=1)
    there = np.isin(ends @ [size, 1], sides @ [size, 1])
    return np.unique(ends[there])


_SPANS = {"beam": ((0, 1),), "rod": (), "beam3": ((0, 2), (2, 1))}
"""Local numbers of neighbours in a beam."""


def _sides(block: ShellBlock) -> IntArray:
    """Pairs (s, 2) of neighbours around shells; of those with nodes on their sides, of corners too."""
    count = CORNERS[block.nodes.shape[1]]
    rings = [block.corners]
    if block.nodes.shape[1] > count:
        rings.append(np.stack([block.corners, block.nodes[:, count:]], axis=2).reshape(len(block.nodes), -1))
    return np.concatenate([np.stack([ring, np.roll(ring, -1, axis=1)], axis=2).reshape(-1, 2) for ring in rings])
