"""Properties of regions that can be parameters: their value in a mesh, and the mesh with another value."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from scipy import sparse

from strainsight.errors import UserError, did_you_mean
from strainsight.mesh.additions import with_added_material, with_layers, with_properties
from strainsight.mesh.anisotropic import CompositeSolid
from strainsight.mesh.model import Material, Mesh
from strainsight.mesh.thin import BeamSection, GeneralShell, Lamina, Laminate, ShellSection

PLY_MODULI = ("e1", "e2", "g12", "g1z", "g2z")
"""Moduli of the plies of laminates, in one orthotropic material."""
SECTION_FACTORS = {"area_factor": "area", "bending_factor": "second", "torsion_factor": "torsion"}
"""Factors of beam and rod sections → the section property that they multiply at both ends; bending also of homogeneous shells."""
THICKNESS: Final = "thickness"
"""Thickness of shells [m]; that of a laminate scales all its plies equally."""
SHAPING = (*PLY_MODULI, *SECTION_FACTORS, THICKNESS)
"""Properties that the stiffness of no region is proportional to."""
OF_MASS = ("density", "area_factor", "bending_factor", THICKNESS)
"""Properties that the mass depends on."""


def shapes(mesh: Mesh, region: int, property: str) -> bool:
    """Whether the stiffness of a region (id) depends on a property other than proportionally; includes the modulus of isotropic
    plies of a laminate or layers of a composite solid."""
    of_plies = mesh.laminate(region) is not None or region in mesh.composites
    return property in SHAPING or (property == "youngs_modulus" and of_plies)


def without_modulus(mesh: Mesh, region: int) -> str:
    """Description of a region with several moduli: laminate, composite solid, shell of several or anisotropic materials,
    anisotropic solid; "" for a region with one modulus."""
    if mesh.laminate(region):
        return "a laminate"
    if region in mesh.composites:
        return "a composite solid"
    if mesh.general_shell(region):
        return "a shell of several or anisotropic materials"
    return "a solid of an anisotropic material" if mesh.anisotropic_of(region) else ""


def value_of(mesh: Mesh, region: int, property: str, material: int | str | None = None) -> float:
    """Value of a property of a region (id) [SI], 1 for a factor; material: id or name, if plies have several.

    The density of a laminate is the mean over its thickness. Raises UserError if the region does not have the property."""
    if property == "stiffness_factor":
        return 1.0
    if property == "density":
        density = mesh.density_of(region)
        assert density is not None
        return density
    if property == THICKNESS:
        return _shell_of(mesh, region).thickness
    if property in SECTION_FACTORS:
        _require_section(mesh, region, property)
        return 1.0
    if property in PLY_MODULI or shapes(mesh, region, property):
        value = float(getattr(_ply(mesh, region, property, material), property))
        if value == float("inf"):
            raise UserError(
                f"{mesh.regions[region]} is rigid in transverse shear: {property} is infinite",
                remedy="Specify transverse shear moduli of the ply (G1Z, G2Z on MAT8), or estimate another property.",
            )
        return value
    if what := without_modulus(mesh, region):
        raise UserError(
            f"{mesh.regions[region]} has no single Young's modulus, because it is {what}",
            remedy="Estimate a factor of the stiffness: `property: stiffness_factor`, `guess: 1.0`, `range: [0.8, 1.2]`.",
        )
    isotropic = mesh.materials[mesh.regions[region].material]
    if material is not None and material not in (isotropic.id, str(isotropic)):
        raise UserError(
            f"the material of {mesh.regions[region]} is {isotropic}, not {material!r}",
            remedy="Remove the key `material`.",
        )
    return isotropic.youngs_modulus


def with_value(
    mesh: Mesh, property: str, regions: Sequence[int], value: float, material: int | str | None = None
) -> Mesh:
    """The mesh whose regions (ids) have this value, in the sense of `value_of`; a factor multiplies their present values. Other
    regions of the same material or section are unchanged. Raises UserError as `value_of` does."""
    for region in regions:
        if property == THICKNESS:
            mesh = _with_thickness(mesh, region, value)
        elif property in SECTION_FACTORS:
            mesh = _with_section(mesh, region, property, value)
        elif property in PLY_MODULI or shapes(mesh, region, property):
            mesh = _with_ply(mesh, region, property, value, material)
        else:
            mesh = with_properties(mesh, [region], **{property: value})
    return mesh


def meant(mesh: Mesh, region: int, property: str, material: int | str | None = None) -> int:
    """Id of the ply material of a region (id) that a property that `shapes` it belongs to, or 0 for its section. Raises UserError
    as `value_of` does."""
    if property == THICKNESS:
        _shell_of(mesh, region)
        return 0
    if property in SECTION_FACTORS:
        _require_section(mesh, region, property)
        return 0
    return _ply(mesh, region, property, material).id


def _ply(mesh: Mesh, region: int, property: str, material: int | str | None) -> Lamina | Material:
    """The ply material of a region for a property: an orthotropic one, for youngs_modulus an isotropic one."""
    several = mesh.laminate(region) or mesh.composites.get(region)
    if several is None or (property != "youngs_modulus" and isinstance(several, CompositeSolid)):
        raise UserError(
            f"{mesh.regions[region]} is not a laminate and has no {property}",
            remedy="Estimate youngs_modulus of the material, or specify a region of laminated shells.",
        )
    among = mesh.materials if property == "youngs_modulus" else mesh.laminae
    kind = "isotropic" if property == "youngs_modulus" else "orthotropic"
    plies = several.layers if isinstance(several, CompositeSolid) else several.plies
    materials = {ply.material: among[ply.material] for ply in plies if ply.material in among}
    names = {number: str(ply_material) for number, ply_material in materials.items()}
    other = "youngs_modulus" if kind == "orthotropic" else ", ".join(PLY_MODULI)
    if not materials:
        raise UserError(
            f"{mesh.regions[region]} is {without_modulus(mesh, region)} without {kind} plies: {property} is undefined",
            remedy="Estimate a factor of the stiffness: `property: stiffness_factor`, `guess: 1.0`, `range: [0.8, 1.2]`"
            + ("." if isinstance(several, CompositeSolid) else f". Or estimate a ply modulus: {other}."),
        )
    if material is None:
        if len(materials) > 1:
            raise UserError(
                f"the plies of {mesh.regions[region]} have {len(materials)} {kind} materials",
                remedy=f"Select one with the key `material`: {' or '.join(f'{i} ({name})' for i, name in names.items())}.",
            )
        return next(iter(materials.values()))
    for number, name in names.items():
        if material in (number, name):
            return materials[number]
    known = [str(each) for each in (*materials, *names.values())]
    raise UserError(
        f"the plies of {mesh.regions[region]} have no {kind} material {material!r}",
        remedy=did_you_mean(str(material), known, f"Set `material` to one of {', '.join(known)}."),
    )


def _with_ply(mesh: Mesh, region: int, property: str, value: float, material: int | str | None) -> Mesh:
    old, number = _ply(mesh, region, property, material), mesh.free_material()
    change: dict[str, Any] = {property: value}
    laminate = mesh.laminate(region)
    parts: tuple[Any, ...] = laminate.plies if laminate else mesh.composites[region].layers
    changed = [replace(part, material=number) if part.material == old.id else part for part in parts]
    return with_layers(with_added_material(mesh, replace(old, id=number, name=str(old), **change)), region, changed)


def _shell_of(mesh: Mesh, region: int) -> ShellSection | GeneralShell | Laminate:
    """Section of shells. Raises UserError for a region of other elements."""
    section = mesh.sections.get(region)
    if section is None or isinstance(section, BeamSection):
        what = "solids" if section is None else "beams or rods"
        raise UserError(
            f"{mesh.regions[region]} consists of {what}, which have no thickness",
            remedy="Specify a region of shells, or estimate "
            + ("the youngs_modulus of its material." if section is None else f"one of {', '.join(SECTION_FACTORS)}."),
        )
    return section


def _with_thickness(mesh: Mesh, region: int, thickness: float) -> Mesh:
    """The mesh with another thickness, without moving its faces; `Thickness` moves them."""
    section = _shell_of(mesh, region)
    changed: ShellSection | GeneralShell | Laminate
    if isinstance(section, Laminate):
        factor = thickness / section.thickness
        changed = replace(section, plies=tuple(replace(ply, thickness=factor * ply.thickness) for ply in section.plies))
    else:
        changed = replace(section, thickness=thickness)
    return replace(mesh, sections={**mesh.sections, region: changed})


def _require_section(mesh: Mesh, region: int, property: str) -> BeamSection | ShellSection:
    """Section of a region. Raises UserError if a factor multiplies nothing in it."""
    section = mesh.sections.get(region)
    if isinstance(section, ShellSection) and property == "bending_factor":
        applies = section.bending > 0
    elif isinstance(section, BeamSection):
        applies = bool(
            section.second.any() if property == "bending_factor" else getattr(section, SECTION_FACTORS[property]) > 0
        )
    else:
        kinds = "beams or homogeneous shells" if property == "bending_factor" else "beams or rods"
        raise UserError(
            f"{mesh.regions[region]} does not consist of {kinds}: {property} is undefined",
            remedy="Specify another region, or estimate the property stiffness_factor.",
        )
    if not applies:
        raise UserError(
            f"{property} scales a stiffness that the section of {mesh.regions[region]} does not have",
            remedy="Specify another region or another property.",
        )
    return section


def _with_section(mesh: Mesh, region: int, property: str, factor: float) -> Mesh:
    section = _require_section(mesh, region, property)

    def times(end: BeamSection) -> BeamSection:
        name = SECTION_FACTORS[property]
        return replace(end, **{name: factor * getattr(end, name)})

    changed: BeamSection | ShellSection
    if isinstance(section, ShellSection):
        changed = replace(section, bending=factor * section.bending)
    else:
        changed = replace(times(section), at_b=section.at_b and times(section.at_b))
    return replace(mesh, sections={**mesh.sections, region: changed})


@dataclass(frozen=True)
class Thickness:
    """Changed thickness of shells: element (k,) ids, ascending; ratio (k,) of their thickness to that of the mesh; opposite (n,)
    indices: for a node on a face the one on the opposite face, for others themselves."""

    element: np.ndarray
    ratio: np.ndarray
    opposite: np.ndarray

    def ratio_of(self, element: np.ndarray) -> np.ndarray:
        """Ratio of elements (p,) ids; 1 for elements with the thickness of the mesh."""
        at = np.minimum(np.searchsorted(self.element, element), len(self.element) - 1)
        return np.where(self.element[at] == element, self.ratio[at], 1.0)

    def moved(self, ratio: float) -> sparse.csr_array:
        """G (3n, 3n) from positions and displacements in the mesh to those of faces of shells of that ratio r:

            x± + ½(r − 1)(x± − x∓),     u± + ½(r − 1)(u± − u∓)

        as x± = x + (offset ± t/2) n and u± = u + θ × (x± − x) (`mesh/thin_faces.py`); the offset is that of the mesh."""
        node = np.arange(len(self.opposite))
        half = np.where(self.opposite != node, 0.5 * (ratio - 1.0), 0.0)
        values, rows = np.concatenate([1 + half, -half]), np.concatenate([node, node])
        G = sparse.csr_array((values, (rows, np.concatenate([node, self.opposite]))), shape=(len(node),) * 2)
        return sparse.csr_array(sparse.kron(G, sparse.eye_array(3), format="csr"))


def thickness_of(mesh: Mesh, thicknesses: Sequence[tuple[Iterable[int], float]]) -> Thickness:
    """Thickness changes of the shells of a mesh with faces: pairs of regions (ids) and their thickness [m]. Raises UserError for
    a region of other elements."""
    ratio = {
        region: value / value_of(mesh, region, "thickness") for regions, value in thicknesses for region in regions
    }
    opposite = np.arange(len(mesh.position))
    element, ratios = [np.zeros(0, dtype=np.int64)], [np.zeros(0)]
    for block in mesh.shells:
        upper, lower = (block.on_faces[:, side].ravel() for side in (0, 1))
        opposite[upper], opposite[lower] = lower, upper
        changed = np.isin(block.region, list(ratio))
        element.append(block.ids[changed])
        ratios.append(np.array([ratio[int(region)] for region in block.region[changed]], dtype=float))
    ids, values = np.concatenate(element), np.concatenate(ratios)
    order = np.argsort(ids)
    return Thickness(ids[order], values[order], opposite)
