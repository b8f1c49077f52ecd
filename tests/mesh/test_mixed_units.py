"""Moduli and densities in units that do not belong together are warned of, with the unit; real materials never are."""

from __future__ import annotations

import pytest

from strainsight.mesh.mixed_units import USUAL_UNITS, mixed_units
from strainsight.mesh.sanity import sanity_warnings
from strainsight.mesh.units import LENGTH, to_si

from .test_sanity import tetrahedron

MM_KG, MM_T, IN_LB, CM_KG = ("mm", "kg"), ("mm", "t"), ("in", "lb"), ("cm", "kg")
MIXED = {  # name: (E and ρ as the deck has them, its units, what the warning names)
    "steel in kg, mm and N": (2.1e5, 7.85e-6, MM_KG, "2.1e+05 looks like MPa (steel, 2.1e+11 Pa): in mm, kg and s it is 2.1e+08"),
    "or in t": (2.1e5, 7.85e-6, MM_KG, "or give the density as 7.85e-09 with mesh.mass_unit t"),
    "aluminium": (7e4, 2.7e-6, MM_KG, "7e+04 looks like MPa (aluminium"),
    "titanium": (1.14e5, 4.43e-6, MM_KG, "in mm, kg and s it is 1.14e+08"),
    "concrete": (3e4, 2.4e-6, MM_KG, "3e+04 looks like MPa (concrete"),
    "kg, mm, ms and kN": (210.0, 7.85e-6, MM_KG, "210 looks like GPa with time in ms (steel"),
    "in seconds": (210.0, 7.85e-6, MM_KG, "in mm, kg and s it is 2.1e+08"),
    "g, mm, ms and N": (2.1e5, 7.85e-3, ("mm", "g"), "2.1e+05 looks like MPa with time in ms"),
    "g in place of t": (2.1e5, 7.85e-3, MM_T, "0.00785 looks like g/mm³ (steel): in mm, t and s it is 7.85e-09"),
    "t, mm and kN": (210.0, 7.85e-9, MM_T, "210 looks like GPa"),
    "pounds without 386": (3e7, 0.283, IN_LB, "or give the density as 0.000733 with mesh.mass_unit lbf*s2/in"),
    "weight in lbf": (3e7, 0.283, ("in", "lbf*s2/in"), "0.283 looks like lb/in³ (steel): in in, lbf*s2/in and s it is 0.000733"),
    "ksi": (3e4, 7.33e-4, ("in", "lbf*s2/in"), "in in, lbf*s2/in and s it is 3e+07"),
    "kg, cm and N": (2.1e7, 7.85e-3, CM_KG, "2.1e+07 looks like N/cm² (steel, 2.1e+11 Pa): in cm, kg and s it is 2.1e+09"),
    "MPa in metres": (2.1e5, 7850.0, ("m", "kg"), "2.1e+05 looks like MPa"),
    "GPa in metres": (210.0, 7850.0, ("m", "kg"), "210 looks like GPa"),
    "MPa and t in metres": (2.1e5, 7.85, ("m", "t"), "in m, t and s it is 2.1e+08"),
    "psi and slugs": (3e7, 15.2, ("ft", "slug"), "in ft, slug and s it is 4.32e+09"),
    "kgf": (2.1e4, 7.85e-6, MM_KG, "2.1e+04 looks like kgf/mm²"),
    "weight in N": (2.1e5, 7.7e-5, MM_T, "looks like N/mm³ (weight)"),
    "pounds a cubic foot": (2.07e11, 490.0, ("m", "kg"), "490 looks like lb/ft³ (steel): in m, kg and s it is 7849"),
}
REAL = {  # Pa, kg/m³
    "natural rubber": (2e6, 930), "filled rubber": (1e7, 1300), "soft foam": (2e5, 30), "rigid foam": (5e7, 60),
    "cork": (2e7, 160), "wood": (1.1e10, 450), "wood across": (5e8, 450), "balsa": (3e9, 150), "honeycomb": (1e9, 50),
    "soil": (5e7, 1900),
    "gravel": (1e8, 2250), "resin filled with sand": (1e10, 2100), "concrete": (3e10, 2400), "light concrete": (1.5e10, 1800),
    "warm asphalt": (3e8, 2400), "granite": (5e10, 2700), "glass": (7e10, 2500), "ice": (9e9, 917), "bone": (1.5e10, 1900),
    "PTFE": (5e8, 2200), "ABS": (2.3e9, 1050), "CFRP": (7e10, 1600), "ply": (1.4e11, 1580), "GFRP": (2e10, 1900),
    "nylon filled with tungsten": (5e9, 11000), "rubber filled with lead": (1e7, 4000), "lead": (1.6e10, 11340),
    "solder": (3e10, 8400), "tin": (5e10, 7290), "zinc": (8.5e10, 7100), "magnesium": (4.5e10, 1780), "beryllium": (3e11, 1850),
    "steel": (2.1e11, 7850), "cast iron": (1.1e11, 7200), "aluminium": (7e10, 2700), "titanium": (1.1e11, 4430),
    "copper": (1.2e11, 8940), "gold": (7.9e10, 19300), "uranium": (2e11, 19000), "tungsten": (4.1e11, 19300),
    "zirconia": (2e11, 6000), "alumina": (3.7e11, 3900), "diamond": (1.1e12, 3500), "aluminium foam": (5e9, 500),
    "steel with smeared masses": (2.1e11, 12000), "steel that weighs little": (2.1e11, 1000),
}  # fmt: skip


@pytest.mark.parametrize(("E", "rho", "units", "words"), MIXED.values(), ids=MIXED)
def test_units_that_do_not_belong_together_are_named_with_the_number_that_would(E, rho, units, words):
    found = " / ".join(sanity_warnings(to_si(tetrahedron(1.0, E, rho), *units), *units))
    assert words in found


def test_the_number_that_a_warning_asks_for_is_without_one():
    for E, rho, units in ((2.1e8, 7.85e-6, MM_KG), (2.1e5, 7.85e-9, MM_T), (1.158e10, 0.283, IN_LB), (2.1e9, 7.85e-3, CM_KG)):
        size = 0.3 / LENGTH[units[0]]
        assert sanity_warnings(to_si(tetrahedron(size, E, rho), *units), *units) == ()


def test_no_real_material_is_warned_of_in_any_consistent_units():
    for units in (*USUAL_UNITS, ("mm", "g"), ("cm", "g"), ("in", "lb"), ("ft", "lb")):
        for name, (E, rho) in REAL.items():
            assert mixed_units(E, rho, *units) == "", (name, units)


@pytest.mark.parametrize("material", REAL.values(), ids=REAL)
def test_a_structure_of_a_real_material_has_no_warning(material):
    assert sanity_warnings(tetrahedron(1.0, *material)) == ()


def test_plies_in_kg_mm_and_n_are_named_and_an_isotropic_material_of_these_numbers_is_not():
    E, rho = 1.35e8, 1600.0
    assert "1.35e+05 looks like MPa (a ply of carbon fibre" in mixed_units(E, rho, *MM_KG, ply=True)
    assert mixed_units(E, rho, *MM_KG) == ""
