"""What a deck says about the config that `strainsight init` writes for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from strainsight.config.template import Suggestion
from strainsight.decks.reader import read_mesh
from strainsight.mesh.model import Mesh
from strainsight.mesh.suspicions import usual_units

STEEL = 2.0e11


def suggestion(path: Path) -> Suggestion:
    """Units that suit the deck's materials, its largest region, a node to load, and what the config has to add.

    Raises DeckError where the deck cannot be read.
    """
    mesh = read_mesh(path, solids=False)  # in the deck's own numbers
    count = {number: sum(int(np.sum(b.region == number)) for b in mesh.blocks) for number in mesh.regions}
    region = max(count, key=lambda number: count[number]) if count else 1
    material = mesh.materials.get(mesh.regions[region].material) if count else None
    units = usual_units(material.youngs_modulus, material.density) if material else _by_size(mesh)
    converted = read_mesh(path, *units, solids=False) if units else mesh
    return Suggestion(
        *(units or ("m", "kg")),
        region=region,
        youngs_modulus=converted.materials[material.id].youngs_modulus if material and units else STEEL,
        node=_free_node(mesh),
        materials=all(mesh.regions[number].material in mesh.materials for number in mesh.regions),
        supports=len(mesh.fixed) > 0,
        node_set=next(iter(mesh.node_sets), "root"),
    )


def _by_size(mesh: Mesh) -> tuple[str, str] | None:
    """Millimetres for what would be tens of metres long."""
    return ("mm", "t") if np.ptp(mesh.position, axis=0).max(initial=0.0) > 20 else None


def _free_node(mesh: Mesh) -> int:
    """A reference node that is not held, else a node of a load, else the node farthest from the supports.

    Where the deck has no supports, those that `init` writes: the first node set.
    """
    held = set(mesh.fixed[:, 0].tolist())
    if not held and mesh.node_sets:
        held = set(np.flatnonzero(np.isin(mesh.node_ids, next(iter(mesh.node_sets.values())))).tolist())
    loaded = [node for load in mesh.loads.values() for node in load.nodes.tolist()]
    ties = [e.reference for e in mesh.rigid] + [e.reference for e in mesh.averaging]
    for node in (*ties, *loaded):
        if node not in held:
            return int(mesh.node_ids[node])
    solid = np.unique(np.concatenate([np.zeros(0, int), *(b.nodes.ravel() for b in mesh.blocks)]))
    candidates = solid if solid.size else np.arange(len(mesh.node_ids))
    centre = mesh.position[sorted(held)].mean(axis=0) if held else mesh.position[candidates].mean(axis=0)
    far = candidates[np.argmax(np.linalg.norm(mesh.position[candidates] - centre, axis=1))]
    return int(mesh.node_ids[far])
