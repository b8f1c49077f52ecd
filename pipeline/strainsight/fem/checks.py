"""Checks of a mesh before assembly: geometry, regions, sections, materials and element quality."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.anisotropic import STACKED, Anisotropic, Layer, general_fault, stiffness_fault
from strainsight.mesh.kinds import facet_of, kind_of
from strainsight.mesh.kinds.kind import ElementKind
from strainsight.mesh.model import CellBlock, Material, Mesh, Region
from strainsight.mesh.thin import (
    BeamBlock,
    BeamSection,
    GeneralShell,
    Lamina,
    Laminate,
    Ply,
    Section,
    ShellBlock,
    ShellSection,
)

# an arc of 120° on one side puts its middle 0.29 side lengths off, a quarter-point node 0.25
MIDSIDE_LIMIT = 0.3
MIDDLE_HALF = 0.25
"""Largest distance of a mid-side node of a shell or beam from the middle, as a share of its side. At this distance the
strain at the nearer end has no bound."""


def check_mesh(mesh: Mesh) -> None:
    """Raise DeckError unless every element has a known kind, its mid-side nodes near the middle of its sides, finite
    positions, and a material with E > 0, −1 < ν < ½, ρ ≥ 0."""
    check_geometry(mesh)
    check_materials(mesh)


def check_geometry(mesh: Mesh) -> None:
    """Raise DeckError unless every element has a known kind and a region, every shell and beam a section, and every node is at
    an admissible position."""
    if not np.all(np.isfinite(mesh.position)):
        node = mesh.node_ids[np.argmin(np.isfinite(mesh.position).all(axis=1))]
        raise DeckError(
            f"node {node} has a position that is not finite",
            remedy="Correct the coordinates of the node.",
            entity=("node", int(node)),
        )
    for block in mesh.blocks:
        _check_midsides(mesh, block)
    for element in mesh.elements:
        _check_regions(mesh, element)
    for thin in mesh.thin:
        _check_middle_half(mesh, thin)
        kinds = (ShellSection, GeneralShell, Laminate) if isinstance(thin, ShellBlock) else (BeamSection,)
        _check_sections(mesh, thin, kinds)


def _check_regions(mesh: Mesh, block: CellBlock | ShellBlock | BeamBlock) -> None:
    for number in np.unique(block.region):
        if int(number) not in mesh.regions:
            element = block.ids[np.argmax(block.region == number)]
            raise DeckError(
                f"element {element} refers to region {number}, which does not exist",
                remedy=f"Add a property (section) with the id {number} to the mesh file.",
                entity=("element", int(element)),
            )


def _check_sections(mesh: Mesh, block: ShellBlock | BeamBlock, kind: tuple[type[Section], ...]) -> None:
    for number in np.unique(block.region):
        section = mesh.sections.get(int(number))
        if not isinstance(section, kind):
            element = block.ids[np.argmax(block.region == number)]
            what = "has no section" if section is None else "has a section of another element type"
            raise DeckError(
                f"{mesh.regions[int(number)]} of {block.kind} element {element} {what}",
                remedy="Assign a shell section (for example PSHELL) to shells, and a beam section (for example PBAR) to beams.",
                entity=("element", int(element)),
            )


def check_materials(mesh: Mesh) -> None:
    """Raise DeckError unless every region with elements has a suitable material."""
    present = {int(number) for block in mesh.elements for number in np.unique(block.region)}
    for region in (mesh.regions[number] for number in sorted(present)):
        if (laminate := mesh.laminate(region.id)) is not None:
            _check_layers(mesh, f"a ply of {region}", laminate.plies, mesh.ply_materials(region.id))
        elif (shell := mesh.general_shell(region.id)) is not None:
            _check_general(shell, region)
        elif (anisotropic := mesh.anisotropic_of(region.id)) is not None:
            _check_anisotropic(mesh, anisotropic, region)
        elif region.id in mesh.composites:
            _check_composite(mesh, region)
        elif (material := mesh.materials.get(region.material)) is not None:
            _check_material(material)
        else:
            number = region.material
            raise DeckError(
                f"{region} {f'refers to material {number}, which does not exist' if number else 'has no material'}",
                where=mesh.source or None,
                remedy=f"Add the material to the config: mesh.materials: {{NAME: {{regions: [{region.id}], youngs_modulus: …, "
                "poisson_ratio: …, density: …}}.",
            )


def _check_general(shell: GeneralShell, region: Region) -> None:
    if not (shell.thickness > 0 and np.isfinite(shell.thickness)):
        raise DeckError(f"{region} is {shell.thickness:g} m thick", remedy="Specify a positive thickness.")
    if fault := general_fault(shell):
        raise DeckError(f"{region}: {fault[0]}", remedy=fault[1])
    _check_density(region, shell.density)


def _check_composite(mesh: Mesh, region: Region) -> None:
    composite = mesh.composites[region.id]
    for block in mesh.elements:
        here = block.region == region.id
        if here.any() and composite.direction not in STACKED.get(block.kind, ()):
            element, lacks = int(block.ids[np.argmax(here)]), block.kind not in STACKED
            raise DeckError(
                f"{region} has layers, but {block.kind} element {element} "
                + (
                    "cannot have layers"
                    if lacks
                    else f"cannot have layers along its direction {composite.direction + 1}"
                ),
                remedy="Use layers only in hexahedra, or in wedges along direction 3 (triangle to triangle). "
                "Assign a section with a single material to other elements.",
                entity=("element", element),
            )
    if not composite.layers:
        raise DeckError(
            f"{region} is a composite solid without layers", remedy="Specify at least one layer in its section."
        )
    _check_layers(mesh, f"a layer of {region}", composite.layers, mesh.layer_materials(region.id))


def _check_anisotropic(mesh: Mesh, material: Anisotropic, region: Region) -> None:
    for block in mesh.thin:
        if (block.region == region.id).any():
            raise DeckError(
                f"{region} of {block.kind} elements has an anisotropic material ({material}), which only solids support",
                remedy="Assign an orthotropic material or a laminate to shells, and an isotropic material to beams.",
            )
    _check_stiffness(material)


def _check_stiffness(material: Anisotropic) -> None:
    if fault := stiffness_fault(material.stiffness):
        raise DeckError(f"{material}: {fault[0]}", remedy=fault[1])
    _check_density(material, material.density)


def _check_layers(
    mesh: Mesh, name: str, layers: Sequence[Layer | Ply], materials: Sequence[Anisotropic | Lamina | Material | None]
) -> None:
    """Raise DeckError unless every layer has a thickness and a material."""
    for layer, material in zip(layers, materials, strict=True):
        if not (layer.thickness > 0 and np.isfinite(layer.thickness)):
            raise DeckError(f"{name} has the thickness {layer.thickness:g}", remedy="Specify a positive thickness.")
        if material is None:
            raise DeckError(
                f"{name} refers to material {layer.material}, which does not exist",
                where=mesh.source or None,
                remedy=f"Add material {layer.material} to the deck.",
            )
        if isinstance(material, Anisotropic):
            _check_stiffness(material)
        elif isinstance(material, Lamina):
            _check_lamina(material)
        else:
            _check_material(material)


def _check_lamina(lamina: Lamina) -> None:
    for name in ("e1", "e2", "g12", "g1z", "g2z"):
        modulus = getattr(lamina, name)
        if not modulus > 0 or (np.isinf(modulus) and name in ("e1", "e2", "g12")):
            raise DeckError(f"{lamina} has the modulus {name} {modulus:g} Pa", remedy="Specify a positive modulus.")
    if not lamina.nu12**2 < lamina.e1 / lamina.e2:
        raise DeckError(
            f"{lamina} has Poisson's ratio nu12 = {lamina.nu12:g}",
            remedy=f"Specify a nu12 below √(e1/e2) = {np.sqrt(lamina.e1 / lamina.e2):g}, the limit of a stable material.",
        )
    _check_density(lamina, lamina.density)


def _check_material(material: Material) -> None:
    if not (material.youngs_modulus > 0 and np.isfinite(material.youngs_modulus)):
        raise DeckError(
            f"{material} has Young's modulus {material.youngs_modulus:g} Pa", remedy="Specify a positive modulus."
        )
    if not -1 < material.poisson_ratio < 0.5:
        raise DeckError(
            f"{material} has Poisson's ratio {material.poisson_ratio:g}",
            remedy="Specify a Poisson's ratio between -1 and 0.5, in practice at most 0.49.",
        )
    _check_density(material, material.density)


def _check_density(owner: object, density: float) -> None:
    if not (density >= 0 and np.isfinite(density)):
        raise DeckError(f"{owner} has density {density:g} kg/m³", remedy="Specify a density ≥ 0.")


def _check_midsides(mesh: Mesh, block: CellBlock) -> None:
    """Raise DeckError for mid-side nodes off the middle: in another order than VTK's, |J| can stay positive at all points."""
    kind = kind_of(block.kind)
    for node, ends in enumerate(kind.edges, start=kind.corners):
        a, b, m = (mesh.position[block.nodes[:, i]] for i in (*ends, node))
        off = np.linalg.norm(m - 0.5 * (a + b), axis=1) / np.linalg.norm(b - a, axis=1)
        worst = int(np.argmax(off))
        if not off[worst] <= MIDSIDE_LIMIT:
            raise DeckError(
                f"node {mesh.node_ids[block.nodes[worst, node]]} of {block.kind} element {block.ids[worst]} is "
                f"{off[worst]:.2g} side lengths away from the middle of the element side (limit {MIDSIDE_LIMIT:g})",
                remedy="Check the mid-side nodes of this element in the mesh file: one is missing or in a wrong position.",
                entity=("element", int(block.ids[worst])),
            )


def _check_middle_half(mesh: Mesh, block: ShellBlock | BeamBlock) -> None:
    """Raise DeckError unless mid-side nodes of shells and beams lie in the middle half of their side and near its line."""
    edges, corners = _sides_of(block)
    for node, ends in enumerate(edges, start=corners):
        a, b, m = (mesh.position[block.nodes[:, i]] for i in (*ends, node))
        side, off = b - a, m - 0.5 * (a + b)
        square = np.maximum(np.sum(side**2, axis=1), np.finfo(float).tiny)
        along = np.sum(off * side, axis=1) / square
        across = np.linalg.norm(off - along[:, None] * side, axis=1) / np.sqrt(square)
        worst = int(np.argmax(np.maximum(np.abs(along) / MIDDLE_HALF, across / MIDSIDE_LIMIT)))
        if abs(along[worst]) < MIDDLE_HALF and across[worst] <= MIDSIDE_LIMIT:
            continue
        where = (
            f"lies at {0.5 + along[worst]:.2g} of the side length, outside the middle half of the side"
            if abs(along[worst]) >= MIDDLE_HALF
            else f"is {across[worst]:.2g} side lengths away from the straight side (limit {MIDSIDE_LIMIT:g})"
        )
        raise DeckError(
            f"node {mesh.node_ids[block.nodes[worst, node]]} of {block.kind} element {block.ids[worst]} {where}",
            remedy="Move the node near the middle of the side, or check the node order of the element.",
            entity=("element", int(block.ids[worst])),
        )


def _sides_of(block: ShellBlock | BeamBlock) -> tuple[tuple[tuple[int, int], ...], int]:
    """The two ends of every side with a mid-side node, and the number of corner nodes."""
    if isinstance(block, ShellBlock):
        kind = facet_of(block.kind)
        return kind.edges, kind.corners
    return (((0, 1),), 2) if block.nodes.shape[1] == 3 else ((), 2)


CHUNK = 8192
POOR = 0.1
"""Scaled Jacobian below which an element is reported."""


@dataclass(frozen=True)
class Quality:
    """Quality of the elements of one kind: ids (e,), shape (e,) scaled Jacobian of the corners [-], curvature (e,) ratio of
    least to greatest |J| at the quadrature points [-], 1 for an element with straight, parallel sides."""

    kind: str
    ids: np.ndarray
    shape: np.ndarray
    curvature: np.ndarray


def element_quality(mesh: Mesh) -> tuple[Quality, ...]:
    """Quality of every element, block by block.

    shape: the least over the corners of |J| over the product of the three sides that meet there, divided by its value in
    the regular element: 1 there, 0 where an element is flat, negative where it is inverted.
    Source: Knupp et al., The Verdict geometric quality library, SAND2007-1751 (2006)."""
    return tuple(Quality(block.kind, block.ids, *_quality_of_block(mesh, block)) for block in mesh.blocks)


def check_inverted(quality: Sequence[Quality]) -> None:
    """Raise DeckError with the number of elements that have |J| ≤ 0 at a quadrature point of their stiffness."""
    inverted = {block.kind: block.ids[block.curvature <= 0] for block in quality if (block.curvature <= 0).any()}
    if not inverted:
        return
    ids = np.concatenate([*inverted.values()])
    kinds = " and ".join(f"{len(numbers)} {kind}" for kind, numbers in inverted.items())
    names = ", ".join(str(number) for number in ids[:5]) + (", …" if len(ids) > 5 else "")
    raise DeckError(
        f"{kinds} of {sum(len(block.ids) for block in quality)} solid elements are flat or inverted: {names}",
        remedy="Check the node order and the mid-side nodes of these elements.",
        entity=("element", int(ids[0])),
    )


def _quality_of_block(mesh: Mesh, block: CellBlock) -> tuple[np.ndarray, np.ndarray]:
    shape, curvature = np.empty(len(block.ids)), np.empty(len(block.ids))
    kind = kind_of(block.kind)
    slopes = kind.gradient(kind.stiffness[0])
    for start in range(0, len(block.ids), CHUNK):
        cut = slice(start, start + CHUNK)
        position = mesh.position[block.nodes[cut]]
        shape[cut] = _scaled_jacobian(kind, position)
        det = np.linalg.det(np.einsum("qkd,ekc->eqdc", slopes, position, optimize=True))
        largest = det.max(axis=1)
        curvature[cut] = np.divide(det.min(axis=1), largest, out=np.zeros(len(det)), where=largest > 0)
    return shape, curvature


def _scaled_jacobian(kind: ElementKind, position: np.ndarray) -> np.ndarray:
    worst = np.full(len(position), np.inf)
    for corner, *others in kind.sides:
        sides = position[:, others] - position[:, [corner]]
        size = np.prod(np.linalg.norm(sides, axis=2), axis=1)
        worst = np.minimum(worst, np.linalg.det(sides) / np.where(size > 0, size, np.inf))
    return worst / kind.regular
