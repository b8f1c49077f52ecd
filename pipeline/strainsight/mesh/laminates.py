"""Laminates: shells of plies one on the other, each of a material of its own that may be orthotropic."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated

from strainsight.columns import Column


@dataclass(frozen=True)
class Lamina:
    """Linear orthotropic in plane stress; axis 1 along its fibres, nu12 = −ε₂/ε₁ under σ₁."""

    id: Annotated[int, Column("1", "", "id of every orthotropic material")]
    e1: Annotated[float, Column("Pa", "", "modulus along its axis 1")]
    e2: Annotated[float, Column("Pa", "", "modulus along its axis 2")]
    nu12: Annotated[float, Column("1", "", "contraction along 2 of a stress along 1")]
    g12: Annotated[float, Column("Pa", "", "shear modulus in its plane")]
    g1z: Annotated[float, Column("Pa", "", "shear modulus across, of axis 1; infinite: no shear")]
    g2z: Annotated[float, Column("Pa", "", "shear modulus across, of axis 2; infinite: no shear")]
    density: Annotated[float, Column("kg/m^3", "", "density of every orthotropic material")]
    name: Annotated[str, Column("1", "", "name in the words of the file")] = ""

    def __str__(self) -> str:
        return self.name or f"material {self.id}"


@dataclass(frozen=True)
class Ply:
    """Of a lamina, or of an isotropic material; its angle is one about the normal of the shell."""

    material: Annotated[int, Column("1", "", "id of its material, from the lower face up")]
    thickness: Annotated[float, Column("m", "", "thickness")]
    angle: Annotated[float, Column("deg", "", "angle of its axis 1 from x of the laminate")] = 0.0


@dataclass(frozen=True)
class Laminate:
    """Section of a shell of plies, the one at the lower face first; its x is that of the material of the shell,
    `ShellBlock.axis`."""

    plies: Annotated[tuple[Ply, ...], Column("", "ply", "plies")]
    nonstructural: Annotated[float, Column("kg/m^2", "", "mass that is not of its plies")] = 0.0

    @property
    def thickness(self) -> float:
        """Of all plies together [m]."""
        return sum(ply.thickness for ply in self.plies)


def scaled(lamina: Lamina, stiffness: float, density: float) -> Lamina:
    """A lamina whose moduli and density are multiplied."""
    moduli = {name: getattr(lamina, name) * stiffness for name in ("e1", "e2", "g12", "g1z", "g2z")}
    return replace(lamina, density=lamina.density * density, **moduli)
