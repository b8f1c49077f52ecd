"""What a mesh must be before it is assembled."""

from __future__ import annotations

import numpy as np

from strainsight.errors import DeckError
from strainsight.mesh.kinds import kind_of
from strainsight.mesh.model import CellBlock, Material, Mesh

# an arc of 120° on one side puts its middle 0.29 side lengths off, a quarter-point node 0.25
MIDSIDE_LIMIT = 0.3


def check_mesh(mesh: Mesh) -> None:
    """Raise DeckError unless every element has a known kind, its mid-side nodes near the middle of its sides, finite
    positions, and a material with E > 0, −1 < ν < ½, ρ ≥ 0."""
    check_geometry(mesh)
    check_materials(mesh)


def check_geometry(mesh: Mesh) -> None:
    """Raise DeckError unless every element has a known kind and a region, and its nodes are where they should be."""
    if not np.all(np.isfinite(mesh.position)):
        node = mesh.node_ids[np.argmin(np.isfinite(mesh.position).all(axis=1))]
        raise DeckError(
            f"node {node} has a position that is not finite",
            remedy="correct its coordinates",
            entity=("node", int(node)),
        )
    for block in mesh.blocks:
        _check_midsides(mesh, block)
        for number in np.unique(block.region):
            if int(number) not in mesh.regions:
                element = block.ids[np.argmax(block.region == number)]
                raise DeckError(
                    f"element {element} refers to region {number}, which is not there",
                    remedy="add its property",
                    entity=("element", int(element)),
                )


def check_materials(mesh: Mesh) -> None:
    """Raise DeckError unless every region with elements has a material that solids can be made of."""
    present = {int(number) for block in mesh.blocks for number in np.unique(block.region)}
    for region in (mesh.regions[number] for number in sorted(present)):
        m = mesh.materials.get(region.material)
        if m is None:
            known = (
                f"refers to material {region.material}, which is not there" if region.material else "has no material"
            )
            raise DeckError(
                f"{region} {known}",
                where=mesh.source or None,
                remedy=f"state it in the config: mesh.materials: {{NAME: {{regions: [{region.id}], youngs_modulus: …, "
                "poisson_ratio: …, density: …}}",
            )
        _check_material(m)


def _check_material(m: Material) -> None:
    if not (m.youngs_modulus > 0 and np.isfinite(m.youngs_modulus)):
        raise DeckError(f"{m} has Young's modulus {m.youngs_modulus:g} Pa", remedy="it must be positive")
    if not -1 < m.poisson_ratio < 0.5:
        raise DeckError(
            f"{m} has Poisson's ratio {m.poisson_ratio:g}",
            remedy="it must lie between -1 and 0.5, at most 0.49 in practice",
        )
    if not (m.density >= 0 and np.isfinite(m.density)):
        raise DeckError(f"{m} has density {m.density:g} kg/m³", remedy="it must not be negative")


def _check_midsides(mesh: Mesh, block: CellBlock) -> None:
    """Mid-side nodes in another order than VTK's can leave |J| > 0 at every quadrature point: look at each."""
    kind = kind_of(block.kind)
    for node, ends in enumerate(kind.edges, start=kind.corners):
        a, b, m = (mesh.position[block.nodes[:, i]] for i in (*ends, node))
        off = np.linalg.norm(m - 0.5 * (a + b), axis=1) / np.linalg.norm(b - a, axis=1)
        worst = int(np.argmax(off))
        if not off[worst] <= MIDSIDE_LIMIT:
            raise DeckError(
                f"node {mesh.node_ids[block.nodes[worst, node]]} of {block.kind} element {block.ids[worst]} is "
                f"{off[worst]:.2g} side lengths off the middle of its side",
                remedy="the mid-side nodes of the file are missing or in another order",
                entity=("element", int(block.ids[worst])),
            )
