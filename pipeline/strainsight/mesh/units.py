"""Units of a deck, their conversion to SI, and scaling of a structure; the unit of time is always the second."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import is_dataclass, replace
from difflib import get_close_matches
from itertools import product
from typing import Any, TypeVar, cast

import numpy as np

from strainsight.columns import columns_of
from strainsight.errors import UserError
from strainsight.mesh.joins import PointMass, Relation, Springs
from strainsight.mesh.model import Mesh

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
        remedy=(f"Did you mean {close[0]!r}? " if close else "") + f"Use one of the units {', '.join(table)}.",
    )


POWERS: Mapping[str, tuple[int, int, int]] = {
    "m": (1, 0, 0),
    "m/s^2": (1, 0, 0),
    "m^2": (2, 0, 0),
    "m^4": (4, 0, 0),
    "kg": (0, 1, 0),
    "kg/m": (-1, 1, 0),
    "kg/m^2": (-2, 1, 0),
    "kg/m^3": (-3, 1, 0),
    "kg m^2": (2, 1, 0),
    "Pa": (0, 0, 1),
    "N": (2, 0, 1),
    "N m": (3, 0, 1),
}
"""Unit of a `Column` → powers of length, mass and pressure; N/m is pressure times length; seconds are unchanged."""
PHYSICAL = (
    *("materials", "laminae", "anisotropic", "orientations", "composites", "sections"),
    *("shells", "beams", "relations", "point_masses", "springs"),
)
"""Fields of a mesh with physical quantities."""
T = TypeVar("T")


def rescaled(value: T, length: float = 1.0, mass: float = 1.0, pressure: float = 1.0) -> T:
    """Multiply the quantities of a part of a mesh, or of a tuple or mapping of parts, by the factors of their units (`Column`).

    A relation Σ c u + Σ d θ = 0 has u' = L u and θ' = θ. So d becomes L d, and so does the elongation of a spring by a rotation.
    A mass matrix on translations and rotations becomes [M, M L; M L, M L²]. Ratios, angles and directions are unchanged."""

    def factor(unit: str) -> float:
        l, m, p = POWERS[unit]
        scale = mass**m * pressure**p
        return scale * length**l if l >= 0 else scale / length**-l

    def changed(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {key: changed(each) for key, each in value.items()}
        if isinstance(value, tuple):
            return tuple(changed(each) for each in value)
        if not is_dataclass(value):
            return value
        changes: dict[str, Any] = {}
        for name, (_, column) in columns_of(type(value)).items():  # type: ignore[arg-type]
            quantity = getattr(value, name)
            if quantity is None or column is None or column.unit not in POWERS:
                changes[name] = changed(quantity)
            else:
                by = factor(column.unit)
                changes[name] = tuple(by * each for each in quantity) if isinstance(quantity, tuple) else by * quantity
        if isinstance(value, Relation):
            changes["value"] = value.value * np.where(value.component > 2, length, 1.0)
        elif isinstance(value, Springs):
            arms = (value.component > 2) & ~value.torsion[value.spring]
            changes["value"] = value.value * np.where(arms, length, 1.0)
            changes["stiffness"] = value.stiffness * np.where(value.torsion, factor("N m"), pressure * length)
        elif isinstance(value, PointMass) and value.matrix is not None:
            arm = np.repeat([1.0, length], 3)
            changes["matrix"] = mass * arm[:, None] * value.matrix * arm
        return replace(value, **changes)  # type: ignore[type-var]

    return cast(T, changed(value))


def _rescaled_mesh(mesh: Mesh, length: float, mass: float, pressure: float) -> Mesh:
    """The mesh without its loads, rescaled."""
    parts: dict[str, Any] = {name: rescaled(getattr(mesh, name), length, mass, pressure) for name in PHYSICAL}
    return replace(mesh, position=length * mesh.position, **parts)


def scaled(mesh: Mesh, s: float) -> Mesh:
    """The structure scaled by s, of the same material: x → s x, sections too, point masses m → s³ m, their inertia → s⁵.

    Stiffness, also of springs, grows with s, mass with s³, frequencies fall with 1/s. Forces of the file are unchanged."""
    return mesh if s == 1.0 else _rescaled_mesh(mesh, s, s**3, 1.0)


def to_si(mesh: Mesh, length_unit: str, mass_unit: str) -> Mesh:
    """A mesh in deck units → in m, kg, s.

        x [L],   m [M],   E [M/(L s²)],   ρ [M/L³],   I [M L²],   f [M L/s²],   moments [M L²/s²],   a [L/s²],   k [M/s², M L²/s²]

    So millimetres require tonnes if moduli are in MPa. Weights of averaging elements are ratios and unchanged.
    Raises UserError for an unknown unit."""
    L, M = length_factor(length_unit), mass_factor(mass_unit)
    return replace(_rescaled_mesh(mesh, L, M, M / L), loads=rescaled(mesh.loads, L, M, M / L))


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
"""Stiff solids: ranges of Young's modulus [Pa] and density [kg/m³], and a lower bound of E/ρ [m²/s²] for materials of that
density: lead has 1.4e6, warm asphalt 1.2e5."""
PLIES = (
    ("a ply of carbon fibre", (1.1e11, 3e11), (1450.0, 1700.0), 3e5),
    ("a ply of glass fibre", (3.5e10, 5.5e10), (1800.0, 2200.0), 5e4),
)
"""The same along the fibres."""
STIFFEST = 1e8
"""E/ρ [m²/s²] that only fibres and ceramics exceed; steel and aluminium have 2.7e7."""

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
    """Units of length and mass in which E and ρ of a deck are those of a structural material, the most common first."""
    for length, mass in USUAL_UNITS:
        L, M = length_factor(length), mass_factor(mass)
        fits = _within(rho * M / L**3, LIKELY_DENSITY) or rho == 0
        if fits and _within(E * M / L, LIKELY_MODULUS):
            return length, mass
    return None


def likely_units(E: float, rho: float, length_unit: str, mass_unit: str) -> str:
    """Advice on the units of a structural material with E [Pa] and ρ [kg/m³], from a deck in the units given."""
    L, M = length_factor(length_unit), mass_factor(mass_unit)
    e, r = E * L / M, rho * L**3 / M
    if words := mixed_units(E, rho, length_unit, mass_unit):
        return words
    if units := usual_units(e, r):
        l, m = length_factor(units[0]), mass_factor(units[1])
        in_words = f"With mesh.length_unit {units[0]} and mesh.mass_unit {units[1]}"
        return f"{in_words} the material would have {e * m / l:.4g} Pa and {r * m / l**3:.4g} kg/m³."
    for (name, modulus, density, _), (p, pascals), (d, densities) in product(
        SOLIDS, PRESSURES.items(), DENSITIES.items()
    ):
        if _within(e * pascals, modulus) and _within(r * densities, density):
            both = f"The modulus {e:.4g} appears to be in {p} and the density {r:.4g} in {d} ({name})"
            return f"{both}. Specify modulus and density in units of mesh.length_unit, mesh.mass_unit and s."
    return "Check mesh.mass_unit and mesh.length_unit."


def mixed_units(E: float, rho: float, length_unit: str, mass_unit: str, ply: bool = False) -> str:
    """Message about a modulus or density of a deck that is in another unit; empty for consistent or unknown materials.

    The modulus E [Pa] is questioned if the density ρ [kg/m³] is that of a solid, and vice versa."""
    L, M = length_factor(length_unit), mass_factor(mass_unit)
    e, r = E * L / M, rho * L**3 / M
    solids = SOLIDS + PLIES * ply
    if any(_within(E, modulus) and _within(rho, density) for _, modulus, density, _ in solids):
        return ""
    odd = STIFFEST * rho < E or rho > LIKELY_DENSITY[1]
    here = f"In {length_unit}, {mass_unit} and s the value is"
    for name, modulus, density, least in solids:
        for unit, factor in PRESSURES.items() if _within(rho, density) and least * rho > E else ():
            if not _within(meant := e * factor, modulus):
                continue
            in_ms = " with time in ms" if length_unit == "mm" and _same(M / L / factor, 1e-6) else ""
            words = f"The modulus {e:.4g} appears to be in {unit}{in_ms} ({name}, {meant:.3g} Pa). {here} {meant * L / M:.4g}"
            for other, mass in MASS.items():
                if _same(mass, factor * L):
                    return f"{words}. Or set mesh.mass_unit to {other}, and the density in the deck to {rho * L**3 / mass:.4g}."
            return f"{words}."
        for unit, factor in DENSITIES.items() if _within(E, modulus) and odd else ():
            if _within(meant := r * factor, density):
                return f"The density {r:.4g} appears to be in {unit} ({name}). {here} {meant * L**3 / M:.4g}."
    return ""


def _same(one: float, other: float) -> bool:
    return abs(one / other - 1) < 1e-3


def _within(value: float, limits: tuple[float, float]) -> bool:
    return limits[0] <= value <= limits[1]
