"""What the sections of shells of a mesh resist, and how heavy they are."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.fem.shells import shell_axes
from strainsight.fem.shells.laminate import Resistance, in_shear, laminate_resistance, plane_stress
from strainsight.mesh.laminates import Lamina
from strainsight.mesh.model import Material, Mesh
from strainsight.mesh.thin import BeamSection, GeneralShell, ShellBlock, ShellSection

RIGID_IN_SHEAR = 1000.0
"""What stands for t_s/t = ∞: shear adds a thousandth of what it would to a deflection."""


def resistance_of(mesh: Mesh, part: ShellBlock) -> Resistance:
    """Of shells (e,) along the axes of `shell_axes`; of homogeneous ones with unit modulus, of others as they are."""
    e = len(part.ids)
    found = Resistance(np.zeros((e, 3, 3)), np.zeros((e, 3, 3)), np.zeros((e, 3, 3)), np.zeros((e, 2, 2)))
    numbers = np.unique(part.region).tolist()
    general = {number: own for number in numbers if (own := mesh.general_shell(number)) is not None}
    alike = np.isin(part.region, [n for n in numbers if mesh.laminate(n) is None and n not in general])
    if alike.any():
        sections = [mesh.sections[int(number)] for number in part.region[alike]]
        nu = np.array([mesh.materials[mesh.regions[int(i)].material].poisson_ratio for i in part.region[alike]])
        found.A[alike], found.D[alike], found.S[alike] = _homogeneous(
            [own for own in sections if isinstance(own, ShellSection)], nu
        )
    if alike.all():
        return found
    turned = material_angle(mesh, part)
    for number in numbers:
        if number in general or mesh.laminate(number) is not None:
            own = part.region == number
            whole = of_general(general[number]) if number in general else of_laminate(mesh, number)
            seen = whole.seen_at(turned[own])
            found.A[own], found.B[own], found.D[own], found.S[own] = seen.A, seen.B, seen.D, seen.S
    return found


def of_general(own: GeneralShell) -> Resistance:
    """Of a shell of several or anisotropic materials, along x and y of these."""
    t, shear = own.thickness, own.shear
    if not np.isfinite(shear).all():
        shear = RIGID_IN_SHEAR * float(in_shear(own.bending)) * np.eye(2)
    return Resistance(t * own.membrane, t**2 * own.coupling, t**3 / 12 * own.bending, t * shear)


def of_laminate(mesh: Mesh, region: int) -> Resistance:
    """Of the laminate of a region along its own x and y."""
    laminate = mesh.laminate(region)
    assert laminate is not None
    materials = plies_of(mesh, region)
    thickness, angle = np.array([[ply.thickness, np.radians(ply.angle)] for ply in laminate.plies]).T
    Q = np.stack([ply_stiffness(own) for own in materials])
    return laminate_resistance(thickness, angle, Q, np.array([_shear_flexibility(own) for own in materials]))


def plies_of(mesh: Mesh, region: int) -> tuple[Lamina | Material, ...]:
    """The material of every ply of a laminate, which `check_mesh` is to have found there."""
    found = tuple(own for own in mesh.ply_materials(region) if own is not None)
    laminate = mesh.laminate(region)
    assert laminate is not None
    assert len(found) == len(laminate.plies)
    return found


def ply_stiffness(own: Lamina | Material) -> np.ndarray:
    """Q (3, 3) [Pa] of a ply along its axes, in plane stress."""
    if isinstance(own, Lamina):
        return plane_stress(own.e1, own.e2, own.nu12, own.g12)
    E, nu = own.youngs_modulus, own.poisson_ratio
    return plane_stress(E, E, nu, E / (2 * (1 + nu)))


def _shear_flexibility(own: Lamina | Material) -> tuple[float, float]:
    if isinstance(own, Lamina):
        return 1 / own.g1z, 1 / own.g2z
    return (2 * (1 + own.poisson_ratio) / own.youngs_modulus,) * 2


def material_angle(mesh: Mesh, part: ShellBlock) -> np.ndarray:
    """Angle (e,) [rad] about the normal of a shell from its x, `shell_axes`, to that of its material."""
    X = shell_axes(mesh.position[part.nodes], part.ids)
    x, y = (np.einsum("ec,ec->e", part.axis, X[:, :, i]) for i in (0, 1))
    return np.where(np.isnan(part.axis).any(axis=1), 0.0, np.arctan2(y, x))


def shell_weight(
    mesh: Mesh, part: ShellBlock, density: np.ndarray, nonstructural: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """m = ∫ρ dz (e,) [kg/m²], ∫ρ(z − z_m)² dz [kg] and z_m [m] from the nodes, the centre of that mass, of shells of these
    densities (e,), of a laminate the mean one; nonstructural: with the mass of the sections, which lies in their middle."""
    numbers, where = np.unique(part.region, return_inverse=True)
    each = np.array([_moments(mesh, int(number)) for number in numbers])
    beside = np.array([mesh.sections[int(number)].nonstructural for number in numbers])[where]
    area, first, second = density * each[where].T
    area = area + nonstructural * beside
    moved = first != 0
    height = np.divide(first, area, out=np.zeros_like(area), where=moved)
    return area, second - height * first, part.offset + height


def _moments(mesh: Mesh, region: int) -> tuple[float, float, float]:
    """∫ (1, z, z²) ρ dz over the mean density, z from the middle."""
    section, mean = mesh.sections[region], mesh.density_of(region)
    assert not isinstance(section, BeamSection)
    if isinstance(section, ShellSection | GeneralShell):
        return section.thickness, 0.0, section.thickness**3 / 12
    rho = np.array([own.density for own in plies_of(mesh, region)])
    share = rho / mean if mean else np.ones(len(rho))
    z = np.cumsum([0.0, *(ply.thickness for ply in section.plies)]) - 0.5 * section.thickness
    first, second, third = (float(share @ (z[1:] ** k - z[:-1] ** k) / k) for k in (1, 2, 3))
    return first, 0.0 if abs(second) < 1e-12 * section.thickness**2 else second, third


def _homogeneous(sections: Sequence[ShellSection], nu: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, D (e, 3, 3) and S (e, 2, 2) of homogeneous shells with unit modulus: t C, t³/12 C, t_s G."""
    t, bending, shear = (
        np.array([getattr(own, name) for own in sections]) for name in ("thickness", "bending", "shear")
    )
    C = np.zeros((len(nu), 3, 3))
    C[:, 0, 0] = C[:, 1, 1] = 1 / (1 - nu**2)
    C[:, 0, 1] = C[:, 1, 0] = nu / (1 - nu**2)
    C[:, 2, 2] = 0.5 / (1 + nu)
    S = (np.minimum(shear, RIGID_IN_SHEAR) * t * 0.5 / (1 + nu) * (bending > 0))[:, None, None] * np.eye(2)
    return t[:, None, None] * C, (bending * t**3 / 12)[:, None, None] * C, S
