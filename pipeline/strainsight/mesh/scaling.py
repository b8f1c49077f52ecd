"""A structure of another size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from strainsight.mesh.joins import Relation
from strainsight.mesh.model import FloatArray, Mesh
from strainsight.mesh.thin import BeamBlock, GeneralShell, Laminate, Section, ShellBlock, ShellSection

Block = TypeVar("Block", ShellBlock, BeamBlock)
Own = TypeVar("Own", bound=Section)


def resized(section: Own, length: float, mass: float) -> Own:
    """A section whose lengths and masses are multiplied: t [L], A [L²], I, J [L⁴], mass per area [M/L²] and length [M/L],
    density [M/L³]; moduli stay."""
    if isinstance(section, ShellSection):
        return replace(
            section, thickness=section.thickness * length, nonstructural=section.nonstructural * mass / length**2
        )
    if isinstance(section, GeneralShell):
        return replace(
            section,
            thickness=section.thickness * length,
            density=section.density * mass / length**3,
            nonstructural=section.nonstructural * mass / length**2,
        )
    if isinstance(section, Laminate):
        return replace(
            section,
            plies=tuple(replace(ply, thickness=ply.thickness * length) for ply in section.plies),
            nonstructural=section.nonstructural * mass / length**2,
        )
    return replace(
        section,
        area=section.area * length**2,
        second=section.second * length**4,
        torsion=section.torsion * length**4,
        points=section.points * length,
        neutral=(section.neutral[0] * length, section.neutral[1] * length),
        beside=(section.beside[0] * length, section.beside[1] * length),
        nonstructural=section.nonstructural * mass / length,
        at_b=None if section.at_b is None else resized(section.at_b, length, mass),
    )


def resized_sections(sections: Mapping[int, Section], length: float, mass: float) -> dict[int, Section]:
    """All of them, by region."""
    return {region: resized(section, length, mass) for region, section in sections.items()}


def with_thin_resized(mesh: Mesh, length: float, mass: float) -> Mesh:
    """A mesh whose shells and beams have their sections and offsets multiplied; positions and all else stay."""

    def moved(block: Block) -> Block:
        return replace(block, offset=block.offset * length)

    return replace(
        mesh,
        shells=tuple(moved(block) for block in mesh.shells),
        beams=tuple(moved(block) for block in mesh.beams),
        sections=resized_sections(mesh.sections, length, mass),
    )


def relations_resized(mesh: Mesh, length: float) -> tuple[Relation, ...]:
    """Σ c u + Σ d θ = 0 in lengths that are multiplied, u' = L u and θ' = θ:  Σ c u' + Σ L d θ' = 0."""
    return tuple(replace(own, value=own.value * np.where(own.component > 2, length, 1.0)) for own in mesh.relations)


def resized_matrix(matrix: FloatArray | None, length: float, mass: float) -> FloatArray | None:
    """A mass matrix (6, 6) on translations and rotations: [M, M L; M L, M L²]."""
    if matrix is None:
        return None
    scale = np.repeat([1.0, length], 3)
    return np.asarray(mass * scale[:, None] * matrix * scale)


def scaled(mesh: Mesh, s: float) -> Mesh:
    """The structure s times as large, of the same material: x → s x, sections too, point masses m → s³ m, their inertia → s⁵.

    Stiffness grows with s, that of springs too, mass with s³, frequencies fall with 1/s. Forces of the file stay as they are.
    """
    if s == 1.0:
        return mesh
    masses = tuple(
        replace(
            own,
            mass=s**3 * own.mass,
            offset=s * own.offset,
            inertia=s**5 * own.inertia,
            matrix=resized_matrix(own.matrix, s, s**3),
        )
        for own in mesh.point_masses
    )
    springs = tuple(
        replace(
            own,
            stiffness=own.stiffness * np.where(own.torsion, s**3, s),
            value=own.value * np.where((own.component > 2) & ~own.torsion[own.spring], s, 1.0),
        )
        for own in mesh.springs
    )
    return replace(
        with_thin_resized(mesh, s, s**3),
        position=s * mesh.position,
        orientations={i: own.resized(s) for i, own in mesh.orientations.items()},
        composites={i: own.resized(s) for i, own in mesh.composites.items()},
        relations=relations_resized(mesh, s),
        point_masses=masses,
        springs=springs,
    )
