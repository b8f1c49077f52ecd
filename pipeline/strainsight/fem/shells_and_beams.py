"""Stiffness and mass of shells and beams on the translations and rotations of their nodes, affine in moduli and densities."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy import sparse

from strainsight.fem.affine import AffineOperator, Parameter, sum_of
from strainsight.fem.beam_matrices import (
    beam_masses,
    beam_stiffnesses,
    curved_beam_masses,
    curved_beam_stiffnesses,
    rod_masses,
    rod_stiffnesses,
)
from strainsight.fem.beam_properties import properties_of
from strainsight.fem.by_region import by_element, cut, density_of, poisson_ratios, region_operator, regions_of, some_of
from strainsight.fem.shells import shell_axes, shell_masses, shell_stiffnesses
from strainsight.fem.shells.matrices import Resistance, in_shear, laminate_resistance, plane_stress
from strainsight.mesh.model import Material, Mesh
from strainsight.mesh.thin import (
    BeamBlock,
    BeamSection,
    GeneralShell,
    Lamina,
    ShellBlock,
    ShellSection,
    nodes_along_beams,
)
from strainsight.parallel import mapped

RIGID_IN_SHEAR = 1000.0
"""Substitute of t_s/t = ∞: shear increases a deflection by a thousandth of its normal effect."""


def resistance_of(mesh: Mesh, part: ShellBlock) -> Resistance:
    """Resistance of shells (e,) along the axes of `shell_axes`; of homogeneous ones with unit modulus, of others with theirs."""
    e = len(part.ids)
    result = Resistance(np.zeros((e, 3, 3)), np.zeros((e, 3, 3)), np.zeros((e, 3, 3)), np.zeros((e, 2, 2)))
    numbers = np.unique(part.region).tolist()
    general = {number: shell for number in numbers if (shell := mesh.general_shell(number)) is not None}
    homogeneous = np.isin(part.region, [n for n in numbers if mesh.laminate(n) is None and n not in general])
    if homogeneous.any():
        sections = [mesh.sections[int(number)] for number in part.region[homogeneous]]
        nu = poisson_ratios(mesh, part.region[homogeneous])
        result.A[homogeneous], result.D[homogeneous], result.S[homogeneous] = _homogeneous(
            [section for section in sections if isinstance(section, ShellSection)], nu
        )
    if homogeneous.all():
        return result
    angle = material_angle(mesh, part)
    for number in numbers:
        if number in general or mesh.laminate(number) is not None:
            in_region = part.region == number
            resistance = of_general(general[number]) if number in general else of_laminate(mesh, number)
            rotated = resistance.rotate(angle[in_region])
            result.A[in_region], result.B[in_region], result.D[in_region], result.S[in_region] = (
                rotated.A,
                rotated.B,
                rotated.D,
                rotated.S,
            )
    return result


def of_general(shell: GeneralShell) -> Resistance:
    """Resistance of a shell of several or anisotropic materials, along their x and y."""
    t, shear = shell.thickness, shell.shear
    if not np.isfinite(shear).all():
        shear = RIGID_IN_SHEAR * float(in_shear(shell.bending)) * np.eye(2)
    return Resistance(t * shell.membrane, t**2 * shell.coupling, t**3 / 12 * shell.bending, t * shear)


def of_laminate(mesh: Mesh, region: int) -> Resistance:
    """Resistance of the laminate of a region along the x and y of the laminate."""
    laminate = mesh.laminate(region)
    assert laminate is not None
    materials = plies_of(mesh, region)
    thickness, angle = np.array([[ply.thickness, np.radians(ply.angle)] for ply in laminate.plies]).T
    Q = np.stack([ply_stiffness(material) for material in materials])
    shear = [_shear_flexibility(material) for material in materials]
    return laminate_resistance(thickness, angle, Q, np.array(shear))


def plies_of(mesh: Mesh, region: int) -> tuple[Lamina | Material, ...]:
    """The material of every ply of a laminate that `check_mesh` has accepted."""
    materials = tuple(material for material in mesh.ply_materials(region) if material is not None)
    laminate = mesh.laminate(region)
    assert laminate is not None
    assert len(materials) == len(laminate.plies)
    return materials


def ply_stiffness(material: Lamina | Material) -> np.ndarray:
    """Q (3, 3) [Pa] of a ply along its axes, in plane stress."""
    if isinstance(material, Lamina):
        return plane_stress(material.e1, material.e2, material.nu12, material.g12)
    E, nu = material.youngs_modulus, material.poisson_ratio
    return plane_stress(E, E, nu, E / (2 * (1 + nu)))


def _shear_flexibility(material: Lamina | Material) -> tuple[float, float]:
    if isinstance(material, Lamina):
        return 1 / material.g1z, 1 / material.g2z
    return (2 * (1 + material.poisson_ratio) / material.youngs_modulus,) * 2


def material_angle(mesh: Mesh, part: ShellBlock) -> np.ndarray:
    """Angle (e,) [rad] about the shell normal from x of `shell_axes` to x of the material."""
    X = shell_axes(mesh.position[part.nodes], part.ids)
    x, y = (np.einsum("ec,ec->e", part.axis, X[:, :, i]) for i in (0, 1))
    return np.where(np.isnan(part.axis).any(axis=1), 0.0, np.arctan2(y, x))


def shell_weight(
    mesh: Mesh, part: ShellBlock, density: np.ndarray, nonstructural: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """m = ∫ρ dz (e,) [kg/m²], ∫ρ(z − z_m)² dz [kg] and the centre of mass z_m [m] from the nodes, of shells with densities (e,).

    density: of a laminate the mean one; nonstructural: include the mass of the sections, which lies in their middle."""
    numbers, where = np.unique(part.region, return_inverse=True)
    moments = np.array([_moments(mesh, int(number)) for number in numbers])
    extra = np.array([mesh.sections[int(number)].nonstructural for number in numbers])[where]
    area, first, second = density * moments[where].T
    area = area + nonstructural * extra
    is_eccentric = first != 0
    height = np.divide(first, area, out=np.zeros_like(area), where=is_eccentric)
    return area, second - height * first, part.offset + height


def _moments(mesh: Mesh, region: int) -> tuple[float, float, float]:
    """∫ (1, z, z²) ρ dz over the mean density, z from the middle."""
    section, mean = mesh.sections[region], mesh.density_of(region)
    assert not isinstance(section, BeamSection)
    if isinstance(section, ShellSection | GeneralShell):
        return section.thickness, 0.0, section.thickness**3 / 12
    rho = np.array([material.density for material in plies_of(mesh, region)])
    share = rho / mean if mean else np.ones(len(rho))
    z = np.cumsum([0.0, *(ply.thickness for ply in section.plies)]) - 0.5 * section.thickness
    first, second, third = (float(share @ (z[1:] ** k - z[:-1] ** k) / k) for k in (1, 2, 3))
    return first, 0.0 if abs(second) < 1e-12 * section.thickness**2 else second, third


def _homogeneous(sections: Sequence[ShellSection], nu: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, D (e, 3, 3) and S (e, 2, 2) of homogeneous shells with unit modulus: t C, t³/12 C, t_s G."""
    t, bending, shear = (
        np.array([getattr(section, name) for section in sections]) for name in ("thickness", "bending", "shear")
    )
    C = np.zeros((len(nu), 3, 3))
    C[:, 0, 0] = C[:, 1, 1] = 1 / (1 - nu**2)
    C[:, 0, 1] = C[:, 1, 0] = nu / (1 - nu**2)
    C[:, 2, 2] = 0.5 / (1 + nu)
    S = (np.minimum(shear, RIGID_IN_SHEAR) * t * 0.5 / (1 + nu) * (bending > 0))[:, None, None] * np.eye(2)
    return t[:, None, None] * C, (bending * t**3 / 12)[:, None, None] * C, S


CHUNK = 2048
"""Elements at a time; of second-order shells fewer, so that they fit the cache."""


@dataclass(frozen=True)
class ThinPattern:
    """Pairs of nodes that share an element, sorted: onto (pairs, blocks of all elements) sums the blocks of each pair; indptr
    (m + 1,) and columns (pairs,) are their positions."""

    onto: sparse.csr_array
    indptr: np.ndarray
    columns: np.ndarray


def thin_operators(mesh: Mesh, parameters: Sequence[Parameter] = ()) -> tuple[AffineOperator, AffineOperator]:
    """Stiffness and consistent mass of shells and beams on six motions of each of their m nodes (6m, 6m), see `motions`:

        K(θ) = Σ_regions E_r K_r(ν_r, section),     M(θ) = Σ_regions ρ_r M_r(section) + M_nonstructural

    The terms of a parameter have unit modulus, factor or density; for a laminate E_r is 1, K_r includes the moduli of its
    plies, and ρ_r is its mean density. K_r and M_r of moduli of plies and of section factors are those of `interpolated`.
    Raises DeckError for a degenerate element; UserError for parameters that overlap or name no region, or a property that a
    region does not have."""

    @cache
    def pattern(regions: frozenset[int]) -> ThinPattern:
        """The pattern of these regions, which does not depend on the values of their properties."""
        return _pattern(mesh, _parts(mesh, regions))

    def stiffness(part_mesh: Mesh, some: Mapping[int, float]) -> sparse.csr_array:
        return _sum(pattern(frozenset(some)), _stiffnesses(part_mesh, some))

    def mass(part_mesh: Mesh, some: Mapping[int, float], nonstructural: bool = False) -> sparse.csr_array:
        return _sum(pattern(frozenset(some)), _masses(part_mesh, some, nonstructural))

    K = region_operator(mesh, parameters, "stiffness", mesh.thin, stiffness)
    M = region_operator(mesh, parameters, "mass", mesh.thin, mass)
    with_extra_mass = {
        number: 0.0
        for number, section in mesh.sections.items()
        if section.nonstructural or (isinstance(section, BeamSection) and section.at_b and section.at_b.nonstructural)
    }
    return K, sum_of(M, AffineOperator(mass(mesh, with_extra_mass, True), {}))


def motions(mesh: Mesh, rotation_rows: Mapping[int, int]) -> sparse.csr_array:
    """P (6m, 3n + 3r): three translations and three rotations of each node of shells and beams from z; rotations of node i from
    row rotation_rows[i]. The rows of nodes without rotations are empty: their resistance, such as the torsion of rods between
    solids, is left out."""
    nodes = mesh.thin_nodes
    first = np.array([rotation_rows.get(node, -1) for node in nodes.tolist()], dtype=np.int64)
    columns = np.concatenate([3 * nodes[:, None] + np.arange(3), first[:, None] + np.arange(3)], axis=1).ravel()
    nonempty = np.flatnonzero(np.repeat(np.stack([first >= -1, first >= 0], axis=1), 3))
    shape = (6 * len(nodes), 3 * len(mesh.position) + 3 * len(rotation_rows))
    size = np.int32 if max(shape) < 2**31 else np.int64  # otherwise every product with it has column numbers of 8 bytes
    places = nonempty.astype(size), columns[nonempty].astype(size)
    return sparse.csr_array((np.ones(len(nonempty)), places), shape=shape)


def thin_mass(mesh: Mesh, elements: np.ndarray | None = None) -> tuple[sparse.csr_array, list[int]]:
    """M (6m, 6m) of the shells and beams, of these elements (ids) or all, and the ids of their regions."""
    selected = mesh
    if elements is not None:
        selected = replace(
            mesh,
            shells=tuple(some_of(block, np.isin(block.ids, elements)) for block in mesh.shells),
            beams=tuple(some_of(block, np.isin(block.ids, elements)) for block in mesh.beams),
        )
    regions = regions_of(selected.thin)
    density = {number: density_of(mesh, number) for number in regions}
    return _sum(_pattern(mesh, _parts(selected, density)), _masses(selected, density, True)), regions


def _stiffnesses(mesh: Mesh, regions: Mapping[int, float]) -> list[np.ndarray]:
    """Factor × stiffness of the elements in these regions, some at a time, as `_blocks`."""
    along = nodes_along_beams(mesh.shells, mesh.beams)

    def of_part(part: ShellBlock | BeamBlock) -> np.ndarray:
        x = mesh.position[part.nodes]
        factor = by_element(part, regions)[:, None, None]
        if isinstance(part, ShellBlock):
            K = shell_stiffnesses(x, resistance_of(mesh, part), part.offset, part.ids, np.isin(part.nodes, along))
        else:
            nu = poisson_ratios(mesh, part.region)
            properties = properties_of([_beam(mesh, int(number)) for number in part.region], nu)
            if part.kind == "rod":
                K = rod_stiffnesses(x, properties.area[:, 0], properties.torsion[:, 0], nu, part.ids)
            elif part.kind == "beam3":
                K = curved_beam_stiffnesses(x, part.axes, properties, part.offset, part.ids)
            else:
                K = beam_stiffnesses(x, part.axes, properties, part.offset, part.released, part.ids)
        return _blocks(part.nodes, factor * K)

    return mapped(of_part, _parts(mesh, regions))


def _masses(mesh: Mesh, density: Mapping[int, float], nonstructural: bool) -> list[np.ndarray]:
    """Mass of the elements in these regions, some at a time, as `_blocks`."""

    def of_part(part: ShellBlock | BeamBlock) -> np.ndarray:
        x = mesh.position[part.nodes]
        rho = by_element(part, density)
        if isinstance(part, ShellBlock):
            area, rotary, height = shell_weight(mesh, part, rho, nonstructural)
            M = shell_masses(x, area, rotary, height, part.ids)
        else:
            ends = [_ends(_beam(mesh, int(number))) for number in part.region]
            area, extra = (
                np.array([[getattr(end, name) for end in both] for both in ends]) for name in ("area", "nonstructural")
            )
            length, more = rho[:, None] * area, nonstructural * extra
            if part.kind == "rod":
                M = rod_masses(x, (length + more)[:, 0], part.ids)
            else:
                rotary = rho[:, None, None, None] * np.array([[end.second for end in both] for both in ends])
                places = np.array([[(end.neutral, end.beside) for end in both] for both in ends])
                if not places.any():
                    masses = curved_beam_masses if part.kind == "beam3" else beam_masses
                    M = masses(x, part.axes, length + more, part.offset, part.ids, rotary)
                else:
                    M = beam_masses(x, part.axes, length, part.offset, part.ids, rotary, places[:, :, 0])
                    M += beam_masses(x, part.axes, more, part.offset, part.ids, None, places[:, :, 1])
        return _blocks(part.nodes, M)

    return mapped(of_part, _parts(mesh, density))


def _blocks(nodes: np.ndarray, matrices: np.ndarray) -> np.ndarray:
    """Matrices (e, 6k, 6k) of elements with nodes (e, k) by pairs of nodes (e k k, 36)."""
    e, k = nodes.shape
    return matrices.reshape(e, k, 6, k, 6).swapaxes(2, 3).reshape(-1, 36)


def _beam(mesh: Mesh, region: int) -> BeamSection:
    section = mesh.sections[region]
    assert isinstance(section, BeamSection)
    return section


def _ends(section: BeamSection) -> tuple[BeamSection, BeamSection]:
    return section, section.at_b or section


def _parts(mesh: Mesh, regions: Collection[int]) -> Iterator[ShellBlock | BeamBlock]:
    """The elements in these regions, some at a time."""
    for block in mesh.thin:
        yield from cut(block, regions, CHUNK // 8 if block.nodes.shape[1] > 4 else CHUNK)


def _pattern(mesh: Mesh, parts: Iterator[ShellBlock | BeamBlock]) -> ThinPattern:
    """Pattern of some elements, on all nodes of shells and beams of a mesh."""
    index = np.full(len(mesh.position), -1)
    index[mesh.thin_nodes] = np.arange(len(mesh.thin_nodes))
    m, keys = len(mesh.thin_nodes), [np.zeros(0, dtype=np.int64)]
    for part in parts:
        local = index[part.nodes]
        keys.append((local[:, :, None] * m + local[:, None, :]).ravel())
    pairs, place = np.unique(np.concatenate(keys), return_inverse=True)
    onto = sparse.csr_array((np.ones(len(place)), (place, np.arange(len(place)))), shape=(len(pairs), len(place)))
    indptr = (
        np.concatenate([[0], np.cumsum(np.bincount(pairs // m, minlength=m))]) if m else np.zeros(1, dtype=np.int64)
    )
    size: type[np.signedinteger] = np.int32 if 36 * len(pairs) < 2**31 else np.int64
    return ThinPattern(onto, indptr.astype(size), (pairs % m if m else pairs).astype(size))


def _sum(pattern: ThinPattern, parts: list[np.ndarray]) -> sparse.csr_array:
    """Σ over elements (6m, 6m): the 6 × 6 blocks of every pair of nodes, added up."""
    blocks = (pattern.onto @ np.concatenate([np.zeros((0, 36)), *parts])).reshape(-1, 6, 6)
    m = len(pattern.indptr) - 1
    X = sparse.bsr_array((blocks, pattern.columns, pattern.indptr), shape=(6 * m, 6 * m))
    return sparse.csr_array(X.tocsr())
