"""What a deck says about the config that `strainsight init` writes for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from strainsight.config.template import Suggestion
from strainsight.decks.reader import read_mesh
from strainsight.mesh.model import Mesh
from strainsight.mesh.sanity import usual_units
from strainsight.ordering import first_of_largest

STEEL = 2.0e11


def suggestion(path: Path) -> Suggestion:
    """Units that suit the deck's materials, its largest region, its load or a node to load, and what the config has to add.

    Raises DeckError where the deck cannot be read.
    """
    mesh = read_mesh(path, solids=False)  # in the deck's own numbers
    count = {number: sum(int(np.sum(b.region == number)) for b in mesh.blocks) for number in mesh.regions}
    region = max(count, key=lambda number: count[number]) if count else 1
    material = mesh.materials.get(mesh.regions[region].material) if count else None
    units = usual_units(material.youngs_modulus, material.density) if material else _by_size(mesh)
    converted = read_mesh(path, *units, solids=False) if units else mesh
    load = _acting_load(converted)
    return Suggestion(
        *(units or ("m", "kg")),
        region=region,
        youngs_modulus=converted.materials[material.id].youngs_modulus if material and units else STEEL,
        node=_free_node(mesh),
        deck_load=load[0] if load else None,
        force=load[1] if load else Suggestion.force,
        materials=all(mesh.regions[number].material in mesh.materials for number in mesh.regions),
        supports=len(mesh.fixed) > 0,
        node_set=next(iter(mesh.node_sets), "root"),
    )


def _by_size(mesh: Mesh) -> tuple[str, str] | None:
    """Millimetres for what would be tens of metres long."""
    return ("mm", "t") if np.ptp(mesh.position, axis=0).max(initial=0.0) > 20 else None


def _acting_load(mesh: Mesh) -> tuple[str, float] | None:
    """The first load of the deck that has a resultant and acts on no node that is held, and that resultant [N]."""
    held = _held(mesh)
    for name, load in mesh.loads.items():
        force = float(np.linalg.norm(load.force.sum(axis=0)))
        if force > 1e-9 * np.abs(load.force).sum() and held.isdisjoint(load.nodes.tolist()):
            return name, force
    return None


def _held(mesh: Mesh) -> set[int]:
    """Nodes of the supports; where the deck has none, of those that `init` writes: the first node set."""
    held = set(mesh.fixed[:, 0].tolist())
    if not held and mesh.node_sets:
        held = set(np.flatnonzero(np.isin(mesh.node_ids, next(iter(mesh.node_sets.values())))).tolist())
    return held


def _free_node(mesh: Mesh) -> int:
    """A reference node that is not held, else a node of a load, else the node farthest from the supports."""
    held = _held(mesh)
    loaded = [node for load in mesh.loads.values() for node in load.nodes.tolist()]
    ties = [e.reference for e in mesh.rigid] + [e.reference for e in mesh.averaging]
    for node in (*ties, *loaded):
        if node not in held:
            return int(mesh.node_ids[node])
    solid = np.unique(np.concatenate([np.zeros(0, int), *(b.nodes.ravel() for b in mesh.blocks)]))
    candidates = solid if solid.size else np.arange(len(mesh.node_ids))
    centre = mesh.position[sorted(held)].mean(axis=0) if held else mesh.position[candidates].mean(axis=0)
    far = candidates[first_of_largest(np.linalg.norm(mesh.position[candidates] - centre, axis=1))]
    return int(mesh.node_ids[far])
