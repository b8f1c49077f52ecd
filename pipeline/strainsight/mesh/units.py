"""Units of a deck and their conversion to SI; the unit of time is always the second."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from difflib import get_close_matches

import numpy as np

from strainsight.errors import UserError
from strainsight.mesh.joins import Springs
from strainsight.mesh.laminates import scaled
from strainsight.mesh.model import Mesh
from strainsight.mesh.resized import relations_resized, resized_matrix, with_thin_resized
from strainsight.mesh.thin import GeneralShell

LENGTH: Mapping[str, float] = {
    "m": 1.0,
    "dm": 1e-1,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "km": 1e3,
    "in": 0.0254,
    "ft": 0.3048,
}
"""[m]."""

MASS: Mapping[str, float] = {
    "kg": 1.0,
    "g": 1e-3,
    "mg": 1e-6,
    "t": 1e3,
    "tonne": 1e3,
    "Mg": 1e3,
    "lb": 0.45359237,
    "slug": 14.593902937206364,
    "lbf*s2/in": 175.12683524647636,
}
"""[kg]; the last two are the masses that 1 lbf accelerates by 1 ft/s² and 1 in/s²."""


def length_factor(unit: str) -> float:
    """Metres in one `unit`. Raises UserError for an unknown one."""
    return _factor(unit, LENGTH, "mesh.length_unit")


def mass_factor(unit: str) -> float:
    """Kilograms in one `unit`. Raises UserError for an unknown one."""
    return _factor(unit, MASS, "mesh.mass_unit")


def _factor(unit: str, table: Mapping[str, float], key: str) -> float:
    if unit in table:
        return table[unit]
    close = get_close_matches(unit, table, n=1, cutoff=0.5) or get_close_matches(unit.lower(), table, n=1, cutoff=0.3)
    raise UserError(
        f"unknown unit {unit!r}",
        key=key,
        remedy=(f"did you mean {close[0]!r}? " if close else "") + f"known units: {', '.join(table)}",
    )


def to_si(mesh: Mesh, length_unit: str, mass_unit: str) -> Mesh:
    """A mesh in deck units → in m, kg, s.

        x [L],   m [M],   E [M/(L s²)],   ρ [M/L³],   I [M L²],   f [M L/s²],   moments [M L²/s²],   a [L/s²],   k [M/s², M L²/s²]

    and sections of shells and beams as `resized` has them; what multiplies a rotation in a relation is a length.
    So millimetres go with tonnes where moduli are in MPa. Weights of averaging elements are ratios and stay.
    Raises UserError for an unknown unit.
    """
    L, M = length_factor(length_unit), mass_factor(mass_unit)
    materials = {
        i: replace(m, youngs_modulus=m.youngs_modulus * M / L, density=m.density * M / L**3)
        for i, m in mesh.materials.items()
    }
    laminae = {i: scaled(own, M / L, M / L**3) for i, own in mesh.laminae.items()}
    anisotropic = {
        i: replace(own, stiffness=own.stiffness * M / L, density=own.density * M / L**3)
        for i, own in mesh.anisotropic.items()
    }
    masses = tuple(
        replace(
            point,
            mass=point.mass * M,
            offset=point.offset * L,
            inertia=point.inertia * M * L**2,
            matrix=resized_matrix(point.matrix, L, M),
        )
        for point in mesh.point_masses
    )
    springs = tuple(_in_si(own, L, M) for own in mesh.springs)
    loads = {
        name: replace(
            load,
            force=load.force * M * L,
            moment=None if load.moment is None else load.moment * M * L**2,
            body=tuple(replace(b, acceleration=b.acceleration * L, centre=b.centre * L) for b in load.body),
        )
        for name, load in mesh.loads.items()
    }
    sized = with_thin_resized(mesh, L, M)
    sections = {i: own.stiffer(M / L) if isinstance(own, GeneralShell) else own for i, own in sized.sections.items()}
    return replace(
        sized,
        sections=sections,
        position=mesh.position * L,
        materials=materials,
        laminae=laminae,
        anisotropic=anisotropic,
        orientations={i: own.resized(L) for i, own in mesh.orientations.items()},
        composites={i: own.resized(L) for i, own in mesh.composites.items()},
        relations=relations_resized(mesh, L),
        point_masses=masses,
        springs=springs,
        loads=loads,
    )


def _in_si(own: Springs, L: float, M: float) -> Springs:
    """A force is k s; what a rotation stretches a spring by, r θ, is a length."""
    arms = (own.component > 2) & ~own.torsion[own.spring]
    stiffness = own.stiffness * np.where(own.torsion, M * L**2, M)
    return replace(own, stiffness=stiffness, value=own.value * np.where(arms, L, 1.0))
