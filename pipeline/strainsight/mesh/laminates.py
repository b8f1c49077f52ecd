"""Laminates: shells of plies one on the other, each of a material of its own that may be orthotropic."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Lamina:
    """Linear orthotropic in plane stress: e1, e2 along and across its fibres, g12, g1z, g2z [Pa], g1z and g2z infinite where it
    does not shear across; nu12 [-], −ε₂/ε₁ under σ₁; density [kg/m³]; name in the words of the file."""

    id: int
    e1: float
    e2: float
    nu12: float
    g12: float
    g1z: float
    g2z: float
    density: float
    name: str = ""

    def __str__(self) -> str:
        return self.name or f"material {self.id}"


@dataclass(frozen=True)
class Ply:
    """material: id of a lamina, or of an isotropic material; thickness [m]; angle [deg] of its axis 1 from x of the laminate,
    about the normal of the shell."""

    material: int
    thickness: float
    angle: float = 0.0


@dataclass(frozen=True)
class Laminate:
    """Section of a shell of plies, the one at the lower face first; mass that is not of their materials [kg/m²].

    x of the laminate is that of the material of the shell, `ShellBlock.axis`.
    """

    plies: tuple[Ply, ...]
    nonstructural: float = 0.0

    @property
    def thickness(self) -> float:
        """Of all plies together [m]."""
        return sum(ply.thickness for ply in self.plies)


def scaled(lamina: Lamina, stiffness: float, density: float) -> Lamina:
    """A lamina whose moduli and density are multiplied."""
    moduli = {name: getattr(lamina, name) * stiffness for name in ("e1", "e2", "g12", "g1z", "g2z")}
    return replace(lamina, density=lamina.density * density, **moduli)
