"""Units of a deck and their conversion to SI; the unit of time is always the second."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from difflib import get_close_matches
from itertools import product

import numpy as np

from strainsight.errors import UserError
from strainsight.mesh.joins import Springs
from strainsight.mesh.model import Mesh
from strainsight.mesh.scaling import relations_resized, resized_matrix, with_thin_resized
from strainsight.mesh.thin import GeneralShell, scaled

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


LIKELY_MODULUS = (1e9, 6e11)
LIKELY_DENSITY = (500.0, 2.5e4)
USUAL_UNITS = (("m", "kg"), ("mm", "t"), ("mm", "kg"), ("in", "lbf*s2/in"), ("ft", "slug"), ("cm", "kg"), ("m", "t"))

SOLIDS = (
    ("steel", (1.8e11, 2.25e11), (7500.0, 8200.0), 1e6),
    ("cast iron", (0.9e11, 1.8e11), (6900.0, 7450.0), 1e6),
    ("aluminium", (6.5e10, 7.8e10), (2550.0, 2900.0), 1e6),
    ("titanium", (0.95e11, 1.25e11), (4300.0, 4700.0), 1e6),
    ("copper or brass", (0.9e11, 1.4e11), (8300.0, 9000.0), 1e6),
    ("nickel", (1.8e11, 2.3e11), (8000.0, 9000.0), 1e6),
    ("tungsten", (3.3e11, 4.3e11), (1.7e4, 1.95e4), 1e6),
    ("concrete", (2e10, 5e10), (2350.0, 2550.0), 1e5),
)
"""Stiff solids: ranges of Young's modulus [Pa] and density [kg/m³], and E/ρ [m²/s²] below which no material of that density lies:
lead has 1.4e6, warm asphalt 1.2e5."""
PLIES = (
    ("a ply of carbon fibre", (1.1e11, 3e11), (1450.0, 1700.0), 3e5),
    ("a ply of glass fibre", (3.5e10, 5.5e10), (1800.0, 2200.0), 5e4),
)
"""The same along the fibres."""
STIFFEST = 1e8
"""E/ρ [m²/s²] that only fibres and ceramics exceed, of steel and aluminium 2.7e7."""

PRESSURES = {
    "Pa": 1.0,
    "kPa": 1e3,
    "MPa": 1e6,
    "GPa": 1e9,
    "psi": 6894.757,
    "ksi": 6894.757e3,
    "lbf/ft²": 47.88026,
    "N/cm²": 1e4,
    "kgf/cm²": 98066.5,
    "kgf/mm²": 9.80665e6,
}
"""[Pa]."""
DENSITIES = {
    "kg/m³": 1.0,
    "g/cm³": 1e3,
    "g/mm³": 1e6,
    "kg/mm³": 1e9,
    "t/mm³": 1e12,
    "lb/ft³": 16.018463,
    "lb/in³": 27679.905,
    "lbf·s²/in⁴": 1.0686894e7,
    "slug/ft³": 515.37882,
    "N/m³ (weight)": 1 / 9.80665,
    "N/mm³ (weight)": 1e9 / 9.80665,
}
"""[kg/m³]."""


def usual_units(E: float, rho: float) -> tuple[str, str] | None:
    """Units of length and mass that make a structural material of E and ρ as a deck has them, the most usual first."""
    for length, mass in USUAL_UNITS:
        L, M = length_factor(length), mass_factor(mass)
        fits = _within(rho * M / L**3, LIKELY_DENSITY) or rho == 0
        if fits and _within(E * M / L, LIKELY_MODULUS):
            return length, mass
    return None


def likely_units(E: float, rho: float, length_unit: str, mass_unit: str) -> str:
    """Which units would make a structural material of E [Pa] and ρ [kg/m³], in words; they come from a deck in these units."""
    L, M = length_factor(length_unit), mass_factor(mass_unit)
    e, r = E * L / M, rho * L**3 / M
    if words := mixed_units(E, rho, length_unit, mass_unit):
        return words
    if units := usual_units(e, r):
        l, m = length_factor(units[0]), mass_factor(units[1])
        in_words = f"with mesh.length_unit {units[0]} and mesh.mass_unit {units[1]}"
        return f"{in_words} it is {e * m / l:.4g} Pa and {r * m / l**3:.4g} kg/m³"
    for (name, modulus, density, _), (p, pascals), (d, densities) in product(
        SOLIDS, PRESSURES.items(), DENSITIES.items()
    ):
        if _within(e * pascals, modulus) and _within(r * densities, density):
            both = f"{e:.4g} looks like {p} and {r:.4g} like {d} ({name})"
            return f"{both}: state both in mesh.length_unit, mesh.mass_unit and s"
    return "check mesh.mass_unit and mesh.length_unit"


def mixed_units(E: float, rho: float, length_unit: str, mass_unit: str, ply: bool = False) -> str:
    """What a deck in these units states in another unit, in words: its modulus where the density E [Pa], ρ [kg/m³] is that of a
    solid and the modulus is not, or its density where the modulus is. Empty for any other material."""
    L, M = length_factor(length_unit), mass_factor(mass_unit)
    e, r = E * L / M, rho * L**3 / M
    solids = SOLIDS + PLIES * ply
    if any(_within(E, modulus) and _within(rho, density) for _, modulus, density, _ in solids):
        return ""
    odd = STIFFEST * rho < E or rho > LIKELY_DENSITY[1]
    here = f"in {length_unit}, {mass_unit} and s it is"
    for name, modulus, density, least in solids:
        for unit, factor in PRESSURES.items() if _within(rho, density) and least * rho > E else ():
            if not _within(meant := e * factor, modulus):
                continue
            in_ms = " with time in ms" if length_unit == "mm" and _same(M / L / factor, 1e-6) else ""
            words = f"{e:.4g} looks like {unit}{in_ms} ({name}, {meant:.3g} Pa): {here} {meant * L / M:.4g}"
            for other, mass in MASS.items():
                if _same(mass, factor * L):
                    return f"{words}; or give the density as {rho * L**3 / mass:.4g} with mesh.mass_unit {other}"
            return words
        for unit, factor in DENSITIES.items() if _within(E, modulus) and odd else ():
            if _within(meant := r * factor, density):
                return f"{r:.4g} looks like {unit} ({name}): {here} {meant * L**3 / M:.4g}"
    return ""


def _same(one: float, other: float) -> bool:
    return abs(one / other - 1) < 1e-3


def _within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= value <= limits[1]
