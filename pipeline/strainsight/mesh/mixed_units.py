"""Materials whose modulus and density are stated in units that do not belong together."""

from __future__ import annotations

from itertools import product

from strainsight.mesh.units import MASS, length_factor, mass_factor

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
