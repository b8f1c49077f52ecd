"""Shells, beams and rods of a mesh with their sections."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from strainsight.columns import Column


@dataclass(frozen=True)
class Lamina:
    """Linear orthotropic material in plane stress; axis 1 along the fibres, nu12 = −ε₂/ε₁ under σ₁."""

    id: Annotated[int, Column("1", "", "id of every orthotropic material")]
    e1: Annotated[float, Column("Pa", "", "Young's modulus along material axis 1")]
    e2: Annotated[float, Column("Pa", "", "Young's modulus along material axis 2")]
    nu12: Annotated[float, Column("1", "", "Poisson's ratio, contraction along 2 under stress along 1")]
    g12: Annotated[float, Column("Pa", "", "in-plane shear modulus")]
    g1z: Annotated[float, Column("Pa", "", "transverse shear modulus in plane 1-z; infinite: rigid")]
    g2z: Annotated[float, Column("Pa", "", "transverse shear modulus in plane 2-z; infinite: rigid")]
    density: Annotated[float, Column("kg/m^3", "", "density of every orthotropic material")]
    name: Annotated[str, Column("1", "", "name of every orthotropic material in the file")] = ""

    def __str__(self) -> str:
        return self.name or f"material {self.id}"


@dataclass(frozen=True)
class Ply:
    """Ply of a lamina or an isotropic material; its angle is about the normal of the shell."""

    material: Annotated[int, Column("1", "", "material id of every ply, starting at the lower face")]
    thickness: Annotated[float, Column("m", "", "thickness of every ply")]
    angle: Annotated[float, Column("deg", "", "angle of ply axis 1 from the x axis of the laminate")] = 0.0


@dataclass(frozen=True)
class Laminate:
    """Section of a laminated shell, from the lower face up; its x is that of the material of the shell, `ShellBlock.axis`."""

    plies: Annotated[tuple[Ply, ...], Column("", "ply", "plies")]
    nonstructural: Annotated[float, Column("kg/m^2", "", "nonstructural mass")] = 0.0

    @property
    def thickness(self) -> float:
        """Total thickness of all plies [m]."""
        return sum(ply.thickness for ply in self.plies)


IntArray = NDArray[np.int64]
FloatArray = NDArray[np.float64]
Pair = tuple[float, float]
ZERO: Pair = (0.0, 0.0)


def concatenate(parts: Iterable[IntArray]) -> IntArray:
    """Concatenation along the first axis; empty (0,) without parts."""
    arrays = list(parts)
    return np.concatenate(arrays) if arrays else np.zeros(0, dtype=np.int64)


SHELL_KINDS = ("quad4", "tri3", "quad8", "tri6")
CORNERS = {3: 3, 4: 4, 6: 3, 8: 4}
"""Number of nodes of a shell → number of its corner nodes, which come first; mid-side nodes follow, first between 1 and 2."""
BEAM_KINDS = ("beam", "rod", "beam3")


@dataclass(frozen=True)
class ShellSection:
    """Section of a homogeneous shell; bending is 12 I/t³ of a PSHELL, shear t_s/t of G t."""

    thickness: Annotated[float, Column("m", "", "thickness t")]
    bending: Annotated[
        float,
        Column(
            "1",
            "",
            "bending stiffness 12 I/t³ relative to a solid plate (I: second moment of area per width); 0: membrane",
        ),
    ] = 1.0
    shear: Annotated[
        float, Column("1", "", "transverse shear thickness relative to the thickness t; infinite: rigid in shear")
    ] = 5 / 6
    nonstructural: Annotated[float, Column("kg/m^2", "", "nonstructural mass")] = 0.0


@dataclass(frozen=True)
class GeneralShell:
    """Section of a shell with different or anisotropic materials for membrane, bending and shear, along their x and y.

        N = t M ε + t² C κ,   M = t² C ε + t³/12 D κ,   Q = t S γ

    Strain ε + z κ is in the order xx, yy, xy, γ_xy = 2 ε_xy.

    M of a uniform shell relates stress to strain on its faces."""

    thickness: Annotated[float, Column("m", "", "thickness t")]
    membrane: Annotated[
        FloatArray,
        Column(
            "Pa",
            "3 × 3",
            "matrix M of the membrane forces t M ε (ε: membrane strain), in the material axes, order xx yy xy, γ = 2ε",
        ),
    ]
    coupling: Annotated[
        FloatArray,
        Column(
            "Pa",
            "3 × 3",
            "coupling matrix C of the membrane forces t² C κ (κ: curvature) and the bending moments t² C ε",
        ),
    ]
    bending: Annotated[
        FloatArray, Column("Pa", "3 × 3", "matrix D of the bending moments t³/12 D κ (κ: curvature); 0: membrane")
    ]
    shear: Annotated[
        FloatArray,
        Column(
            "Pa",
            "2 × 2",
            "matrix S of the transverse shear forces t S γ (γ: shear strain), order xz yz; infinite: rigid",
        ),
    ]
    density: Annotated[float, Column("kg/m^3", "", "density of the shell")]
    uniform: Annotated[bool, Column("1", "", "1 if membrane and bending have the same material and no coupling")]
    nonstructural: Annotated[float, Column("kg/m^2", "", "nonstructural mass")] = 0.0

    @property
    def modulus(self) -> float:
        """The larger of Young's moduli of the membrane along x and y [Pa], 1/(M⁻¹)₁₁ and 1/(M⁻¹)₂₂."""
        return float(1 / np.diagonal(np.linalg.inv(self.membrane))[:2].min())


@dataclass(frozen=True)
class BeamSection:
    """Section of a beam at its end A, and at B if different, linear in between; axes y and z across the beam.

    yy of second is I1 of a PBAR, shear K1, K2; neutral is the position of the structural mass (N1, N2 of a PBEAM), the last
    field that of the nonstructural mass (M1, M2). sides: whether there is material in the middle of the sides +y, +z, −y and
    −z of the box about its points, for a gauge. The axis of the element goes through the shear centres."""

    area: Annotated[float, Column("m^2", "", "area of the section")]
    second: Annotated[FloatArray, Column("m^4", "2 × 2", "∫ (y, z)ᵀ (y, z) dA")] = field(
        default_factory=lambda: np.zeros((2, 2))
    )
    torsion: Annotated[float, Column("m^4", "", "torsion constant J")] = 0.0
    shear: Annotated[
        Pair, Column("1", "2", "shear areas for forces along y and z, relative to the area; 0: rigid in shear")
    ] = ZERO
    points: Annotated[
        FloatArray, Column("m", "point × 2", "y and z of the stress recovery points, relative to the shear centre")
    ] = field(default_factory=lambda: np.zeros((0, 2)))
    nonstructural: Annotated[float, Column("kg/m", "", "nonstructural mass")] = 0.0
    at_b: BeamSection | None = None
    sides: tuple[bool, bool, bool, bool] = (True, True, True, True)
    neutral: Annotated[Pair, Column("m", "2", "y and z of the neutral axis, relative to the shear centre")] = ZERO
    beside: Annotated[Pair, Column("m", "2", "y and z of the nonstructural mass, relative to the shear centre")] = ZERO

    def with_shear(self, ratio: float) -> BeamSection:
        """The section for a shear modulus multiplied by `ratio`, which is included in J and the shear factors."""
        shear = (ratio * self.shear[0], ratio * self.shear[1])
        return replace(self, torsion=ratio * self.torsion, shear=shear, at_b=self.at_b and self.at_b.with_shear(ratio))


Section = ShellSection | GeneralShell | Laminate | BeamSection


@dataclass(frozen=True)
class ShellBlock:
    """Shells of one kind of `SHELL_KINDS`, corner nodes before mid-side nodes."""

    kind: str
    ids: Annotated[IntArray, Column("1", "shell", "id of every shell in the deck", name="id")]
    nodes: Annotated[IntArray, Column("1", "shell × node", "node indices in order around the shell")]
    region: Annotated[IntArray, Column("1", "shell", "region id of every shell")]
    offset: Annotated[
        FloatArray,
        Column("m", "shell", "offset of the mid-surface from the nodes, along the normal defined by the node order"),
    ]
    axis: Annotated[
        FloatArray,
        Column(
            "1",
            "shell × 3",
            "vector whose projection on the shell is the material x axis; NaN: the x axis is along the first side",
        ),
    ]
    on_faces: Annotated[
        IntArray,
        Column(
            "1",
            "shell with faces × 2 × node",
            "indices of the added nodes on the upper and lower face of the shell; they move rigidly with the nodes of the shell",
        ),
    ] = field(default_factory=lambda: np.zeros((0, 2, 0), dtype=np.int64))

    def __post_init__(self) -> None:
        object.__setattr__(self, "on_faces", self.on_faces.reshape(-1, 2, self.nodes.shape[1]))

    @property
    def corners(self) -> IntArray:
        """Indices (n, c) of the nodes at its corners."""
        return self.nodes[:, : CORNERS[self.nodes.shape[1]]]


@dataclass(frozen=True)
class BeamBlock:
    """Elements of one kind: straight "beam" or "rod" (without bending and shear), or "beam3" with a middle node, which may be
    curved and has no pin flags. x is from A to B, both moved by the offsets along the basic axes."""

    kind: str
    ids: Annotated[IntArray, Column("1", "beam", "id of every beam or rod in the deck", name="id")]
    nodes: Annotated[IntArray, Column("1", "beam × node", "node indices of ends A and B, and of the middle node")]
    region: Annotated[IntArray, Column("1", "beam", "region id of every beam or rod")]
    axes: Annotated[
        FloatArray, Column("1", "beam × 3 × 3", "axes x, y, z of every beam, as columns; x from end A to B")
    ]
    offset: Annotated[
        FloatArray, Column("m", "beam × node × 3", "offset of the beam axis from its nodes, in global axes")
    ]
    released: Annotated[
        NDArray[np.bool_],
        Column(
            "1", "beam × 2 × 6", "1 if this end of the beam is released for this motion, in the beam axes (pin flags)"
        ),
    ]
    on_sides: Annotated[
        IntArray,
        Column(
            "1",
            "beam with sides × side × side node",
            "indices of the added nodes on the four sides of the beam; they move rigidly with the nodes of the beam; −1: no node",
        ),
    ] = field(default_factory=lambda: np.zeros((0, 4, 4), dtype=np.int64))


def nodes_that_turn(shells: Sequence[ShellBlock], beams: Sequence[BeamBlock]) -> IntArray:
    """Indices, ascending, of the nodes whose rotations shells and beams resist; rods and solids resist none."""
    blocks_of_nodes = [*(block.nodes for block in shells), *(block.nodes for block in beams if block.kind != "rod")]
    return np.unique(concatenate(nodes.ravel() for nodes in blocks_of_nodes))


def nodes_along_beams(shells: Sequence[ShellBlock], beams: Sequence[BeamBlock]) -> IntArray:
    """Indices, ascending, of both nodes of every beam along a side of a shell, or along half of one; without rods."""
    none = [np.zeros((0, 2), dtype=np.int64)]
    lines = [block.nodes[:, pair] for block in beams for pair in _SPANS[block.kind]]
    ends = np.sort(np.concatenate(none + lines), axis=1)
    if not len(ends):
        return ends.ravel()
    size = int(max(ends.max(), *(block.nodes.max(initial=0) for block in shells), 0)) + 1
    sides = np.sort(np.concatenate(none + [_sides(block) for block in shells]), axis=1)
    on_side = np.isin(ends @ [size, 1], sides @ [size, 1])
    return np.unique(ends[on_side])


_SPANS = {"beam": ((0, 1),), "rod": (), "beam3": ((0, 2), (2, 1))}
"""Local numbers of neighbours in a beam."""


def _sides(block: ShellBlock) -> IntArray:
    """Pairs (s, 2) of neighbouring nodes around shells; for second-order shells also pairs of corners."""
    count = CORNERS[block.nodes.shape[1]]
    rings = [block.corners]
    if block.nodes.shape[1] > count:
        rings.append(np.stack([block.corners, block.nodes[:, count:]], axis=2).reshape(len(block.nodes), -1))
    return np.concatenate([np.stack([ring, np.roll(ring, -1, axis=1)], axis=2).reshape(-1, 2) for ring in rings])
