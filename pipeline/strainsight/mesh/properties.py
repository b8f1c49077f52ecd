"""Properties of regions that a parameter may be: their value in a mesh, and the mesh with another value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from strainsight.errors import UserError, did_you_mean
from strainsight.mesh.additions import free_material, with_properties
from strainsight.mesh.laminates import Lamina
from strainsight.mesh.model import Mesh
from strainsight.mesh.thin import BeamSection

PLY_MODULI = ("e1", "e2", "g12", "g1z", "g2z")
"""Of the plies of laminates, in one orthotropic material."""
SECTION_FACTORS = {"area_factor": ("area",), "bending_factor": ("second",), "torsion_factor": ("torsion",)}
"""Of beams and rods: what each multiplies of their section at both ends."""
SHAPING = (*PLY_MODULI, *SECTION_FACTORS)
"""Properties that the stiffness is not proportional to."""
OF_MASS = ("density", "area_factor", "bending_factor")
"""Properties that the mass depends on."""


def value_of(mesh: Mesh, region: int, property: str, material: int | str | None = None) -> float:
    """What a region (id) has [SI], 1 of a factor; material: id or name of that of the plies, where they have several.

    The density of a laminate is the mean over its thickness. Raises UserError where the region has no such property.
    """
    if property == "stiffness_factor":
        return 1.0
    if property == "density":
        density = mesh.density_of(region)
        assert density is not None
        return density
    if property in SECTION_FACTORS:
        _require_section(mesh, region, property)
        return 1.0
    if property in PLY_MODULI:
        value = float(getattr(mesh.laminae[_lamina(mesh, region, property, material)], property))
        if value == float("inf"):
            raise UserError(f"{mesh.regions[region]} does not shear across: its {property} is infinite")
        return value
    if mesh.laminate(region) is not None:
        raise UserError(
            f"{mesh.regions[region]} is a laminate: it has no single Young's modulus",
            remedy="estimate a factor of its stiffness: property: stiffness_factor, guess: 1.0, range: [0.8, 1.2]; or one of its "
            f"moduli: property: {', '.join(PLY_MODULI)}",
        )
    return mesh.materials[mesh.regions[region].material].youngs_modulus


def with_value(
    mesh: Mesh, property: str, regions: Sequence[int], value: float, material: int | str | None = None
) -> Mesh:
    """The mesh whose regions (ids) have this value, as `value_of` says it; a factor multiplies what they have. Other regions of
    the same material or section keep theirs. Raises UserError as `value_of` does."""
    if property in ("youngs_modulus", "density", "stiffness_factor"):
        return with_properties(mesh, regions, **{property: value})
    for region in regions:
        if property in SECTION_FACTORS:
            mesh = _with_section(mesh, region, property, value)
        else:
            mesh = _with_lamina(mesh, region, property, value, material)
    return mesh


def meant(mesh: Mesh, region: int, property: str, material: int | str | None = None) -> int:
    """What of a region (id) a property of `SHAPING` is of: the id of a material of its plies, or 0, its section. Raises UserError
    as `value_of` does."""
    if property in PLY_MODULI:
        return _lamina(mesh, region, property, material)
    _require_section(mesh, region, property)
    return 0


def _lamina(mesh: Mesh, region: int, property: str, material: int | str | None) -> int:
    """Id of the orthotropic material that is meant of the plies of a region."""
    if (laminate := mesh.laminate(region)) is None:
        raise UserError(
            f"{mesh.regions[region]} is no laminate: it has no {property}",
            remedy="estimate the youngs_modulus of its material, or name a region of plies",
        )
    found = {ply.material: mesh.laminae[ply.material] for ply in laminate.plies if ply.material in mesh.laminae}
    if not found:
        raise UserError(
            f"the plies of {mesh.regions[region]} are of isotropic materials: they have no {property}",
            remedy="estimate a factor of its stiffness: property: stiffness_factor, guess: 1.0",
        )
    names = {number: str(own) for number, own in found.items()}
    if material is None:
        if len(found) > 1:
            raise UserError(
                f"the plies of {mesh.regions[region]} are of {len(found)} orthotropic materials",
                remedy=f"say which is meant: `material:` {' or '.join(f'{i} ({name})' for i, name in names.items())}",
            )
        return next(iter(found))
    for number, name in names.items():
        if material in (number, name):
            return number
    known = [str(own) for own in (*found, *names.values())]
    raise UserError(
        f"the plies of {mesh.regions[region]} have no orthotropic material {material!r}",
        remedy=did_you_mean(str(material), known, f"they have {', '.join(known)}"),
    )


def _with_lamina(mesh: Mesh, region: int, property: str, value: float, material: int | str | None) -> Mesh:
    old, number = _lamina(mesh, region, property, material), free_material(mesh)
    laminate = mesh.laminate(region)
    assert laminate is not None
    own = mesh.laminae[old]
    moduli = {name: value if name == property else getattr(own, name) for name in PLY_MODULI}
    lamina = Lamina(number, nu12=own.nu12, density=own.density, name=str(own), **moduli)
    plies = tuple(replace(ply, material=number) if ply.material == old else ply for ply in laminate.plies)
    return replace(
        mesh,
        laminae={**mesh.laminae, number: lamina},
        sections={**mesh.sections, region: replace(laminate, plies=plies)},
    )


def _require_section(mesh: Mesh, region: int, property: str) -> BeamSection:
    """Raises UserError for a region that is not of beams, or whose section has nothing of it."""
    section = mesh.sections.get(region)
    if not isinstance(section, BeamSection):
        raise UserError(
            f"{mesh.regions[region]} is not of beams or rods: it has no {property}",
            remedy="name a region of beams, or estimate a stiffness_factor",
        )
    if not all(
        (getattr(section, name) > 0 if name != "second" else section.second.any()) for name in SECTION_FACTORS[property]
    ):
        raise UserError(
            f"the section of {mesh.regions[region]} has no stiffness of its own that a {property} multiplies",
            remedy="name another region or another factor",
        )
    return section


def _with_section(mesh: Mesh, region: int, property: str, factor: float) -> Mesh:
    section = _require_section(mesh, region, property)

    def times(own: BeamSection) -> BeamSection:
        return replace(own, **{name: factor * getattr(own, name) for name in SECTION_FACTORS[property]})

    changed = replace(times(section), at_b=section.at_b and times(section.at_b))
    return replace(mesh, sections={**mesh.sections, region: changed})
