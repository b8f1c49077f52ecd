"""Anisotropic materials of solids, and the orientation of their axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from strainsight.columns import Column
from strainsight.mesh.coordinates import CoordinateSystem, local_axes
from strainsight.mesh.thin import FloatArray, GeneralShell

INDEFINITE = 1e-10
"""Least ratio of eigenvalues of a stiffness scaled to a unit diagonal; below, the material does not resist some strain."""


@dataclass(frozen=True)
class Anisotropic:
    """Linear anisotropic solid, σ = C ε."""

    id: Annotated[int, Column("1", "", "id of every anisotropic material")]
    stiffness: Annotated[
        FloatArray, Column("Pa", "6 × 6", "stiffness matrix in the material axes, order 11 22 33 12 23 31, γ = 2ε")
    ]
    density: Annotated[float, Column("kg/m^3", "", "density of every anisotropic material")]
    name: Annotated[str, Column("1", "", "name of every anisotropic material in the file or config")] = ""

    def __str__(self) -> str:
        return self.name or f"material {self.id}"

    @property
    def moduli(self) -> tuple[float, float, float]:
        """Young's moduli along its axes [Pa], 1/S₁₁, 1/S₂₂, 1/S₃₃ of S = C⁻¹."""
        one, two, three = (1 / np.diagonal(np.linalg.inv(self.stiffness))[:3]).tolist()
        return one, two, three


@dataclass(frozen=True)
class Orientation:
    """Orientation of the axes 1, 2, 3 of a material: rotated from the directions of a system at each point."""

    system: CoordinateSystem
    turn: Annotated[
        FloatArray,
        Column(
            "1",
            "3 × 3",
            "directions of the material axes 1, 2, 3, as columns, in the coordinate system of the material",
        ),
    ]

    @property
    def varies(self) -> bool:
        """Whether the axes vary from point to point."""
        return self.system.kind != "rectangular"

    def axes_at(self, position: FloatArray) -> FloatArray:
        """Axes (n, 3, 3), one in a column, at positions (n, 3) [m]; on the axis of a cylinder those of the system."""
        return np.asarray(local_axes(position, self.system)[0] @ self.turn)


def orthotropic(moduli: Sequence[float], ratios: Sequence[float], shear: Sequence[float]) -> FloatArray:
    """C (6, 6) of engineering constants: moduli E₁, E₂, E₃, ratios ν₁₂, ν₁₃, ν₂₃, shear moduli G₁₂, G₁₃, G₂₃, all of these > 0:

        S_ii = 1/E_i,   S_ij = −ν_ij/E_i  (i < j),   S of 12, 23, 31 = 1/G₁₂, 1/G₂₃, 1/G₁₃,   C = S⁻¹

    ν_ij = −ε_j/ε_i under a stress along i. `stiffness_fault` checks whether C is admissible."""
    e1, e2, _ = moduli
    nu12, nu13, nu23 = ratios
    g12, g13, g23 = shear
    S = np.zeros((6, 6))
    S[np.arange(3), np.arange(3)] = 1 / np.asarray(moduli)
    S[0, 1] = S[1, 0] = -nu12 / e1
    S[0, 2] = S[2, 0] = -nu13 / e1
    S[1, 2] = S[2, 1] = -nu23 / e2
    C = np.diag([0.0, 0.0, 0.0, g12, g23, g13])
    C[:3, :3] = np.linalg.inv(S[:3, :3])
    return np.asarray(0.5 * (C + C.T))


def constants_fault(moduli: Sequence[float], ratios: Sequence[float], shear: Sequence[float]) -> tuple[str, str] | None:
    """Fault of engineering constants, in the order of `orthotropic`, and the remedy: all moduli must be positive, and S of the
    normal strains positive definite."""
    for name, value in zip(("E1", "E2", "E3", "G12", "G13", "G23"), (*moduli, *shear), strict=True):
        if not (value > 0 and np.isfinite(value)):
            return f"{name} is {value:g}, not positive", "Specify a positive modulus."
    e1, e2, e3 = moduli
    a, b, c = (nu * root for nu, root in zip(ratios, np.sqrt([e2 / e1, e3 / e1, e3 / e2]), strict=True))
    least = float(np.linalg.eigvalsh(np.array([[1, -a, -b], [-a, 1, -c], [-b, -c, 1]]))[0])
    if not least > INDEFINITE:
        return (
            "the material is unstable: the smallest eigenvalue of the flexibility matrix √(E_i E_j) S_ij is "
            f"{least:.3g}, for NU12 {ratios[0]:g}, NU13 {ratios[1]:g}, NU23 {ratios[2]:g}",
            "Specify NU_ij = −ε_j/ε_i under a stress along i; multiply Poisson's ratios of the opposite convention (NU_ji) by "
            "E_i/E_j.",
        )
    return None


def stiffness_fault(C: FloatArray) -> tuple[str, str] | None:
    """Fault of the stiffness C (n, n) of a material, and the remedy: it must be positive definite, because its work is positive.

    The eigenvalues are those of C_ij/√(C_ii C_jj), independent of units and ratios of moduli."""
    diagonal = np.diagonal(C)
    if not np.isfinite(C).all():
        return "the stiffness matrix has a value that is not finite", "Specify finite values in the stiffness matrix."
    if not (diagonal > 0).all():
        i = int(np.argmin(diagonal > 0))
        return (
            f"the stiffness matrix is not positive definite: diagonal entry {i + 1} is {diagonal[i]:g}, and the smallest "
            f"eigenvalue is {np.linalg.eigvalsh(C)[0]:.4g}",
            "Specify positive values on the diagonal of the stiffness matrix.",
        )
    scale = np.sqrt(diagonal)
    lam, V = np.linalg.eigh(C / np.outer(scale, scale))
    if not lam[0] > INDEFINITE * lam[-1]:
        worst = V[:, 0] / scale
        shown = ", ".join(f"{component:.2g}" for component in worst / np.abs(worst).max())
        return (
            f"the stiffness matrix is not positive definite: scaled to a unit diagonal, the smallest eigenvalue is {lam[0]:.3g}; "
            f"the strain ({shown}) requires no work",
            "Correct the off-diagonal constants: each must be smaller than the square root of the product of its two "
            "diagonal entries.",
        )
    return None


def general_fault(shell: GeneralShell) -> tuple[str, str] | None:
    """Fault of the stiffness of a shell of several materials, and the remedy: it must be positive definite in the membrane, in
    bending (if any), in both together, and in shear (if any)."""
    parts = {"membrane stiffness": shell.membrane}
    if shell.bending.any():
        parts["bending stiffness"] = shell.bending
        both = [[shell.membrane, shell.coupling], [shell.coupling.T, shell.bending / 12]]
        parts["membrane and bending stiffness"] = np.block(both)
    if shell.shear.any() and np.isfinite(shell.shear).all():
        parts["transverse shear stiffness"] = shell.shear
    for name, C in parts.items():
        if fault := stiffness_fault(C):
            return f"{name}: {fault[0]}", fault[1]
    return None


STACKED: dict[str, tuple[int, ...]] = {"hex8": (0, 1, 2), "hex20": (0, 1, 2), "wedge6": (2,), "wedge15": (2,)}
"""Kinds that may have layers → possible directions of these in their reference domain, from −1 to 1."""


@dataclass(frozen=True)
class Layer:
    """Layer of an isotropic material, or of an anisotropic one with the orientation of its axes."""

    material: Annotated[
        int, Column("1", "", "material id of every layer, from ξ = −1 to ξ = 1 along the stacking direction")
    ]
    thickness: Annotated[
        float, Column("1", "", "relative thickness of every layer: only the ratios between layers count")
    ]
    orientation: Orientation


@dataclass(frozen=True)
class CompositeSolid:
    """Layers of a region of solids, which divide the extent of each element along direction 0, 1 or 2 of its reference domain in
    proportion to their thickness, the first at ξ = −1."""

    layers: Annotated[tuple[Layer, ...], Column("", "layer", "layers")]
    direction: Annotated[
        int, Column("1", "", "stacking direction of the layers: axis 0, 1 or 2 of the element reference domain")
    ] = 2

    @property
    def shares(self) -> FloatArray:
        """Shares of the extent of an element (l,) [-], with the sum 1."""
        thickness = np.array([layer.thickness for layer in self.layers])
        return thickness / thickness.sum()

    @property
    def ends(self) -> FloatArray:
        """ξ between the layers (l + 1,), from −1 to 1."""
        ends = np.concatenate([[0.0], np.cumsum(self.shares)])
        return np.asarray(2 * ends / ends[-1] - 1)

    def layer_at(self, xi: FloatArray) -> np.ndarray:
        """Number (q,) of the layer at points ξ (q, 3); at an interface the lower one."""
        return np.clip(np.searchsorted(self.ends, xi[:, self.direction]) - 1, 0, len(self.layers) - 1)

    def between(self, low: float, high: float) -> CompositeSolid:
        """The part between two ξ, as layers of a separate element."""
        parts = zip(self.layers, np.diff(np.clip(self.ends, low, high)).tolist(), strict=True)
        return replace(self, layers=tuple(replace(layer, thickness=share) for layer, share in parts if share > 1e-12))
