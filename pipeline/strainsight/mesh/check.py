"""What is odd about a mesh though it can be taken over."""

from __future__ import annotations

import re

import numpy as np

from strainsight.mesh.model import IntArray, Mesh

MODULUS = (1e6, 1e13)
"""[Pa], from soft rubber to ten times diamond."""
DENSITY = (1.0, 1e5)
"""[kg/m³], from light foam to four times osmium."""
EXTENT = (1e-4, 1e4)
"""[m]."""

_STRUCTURAL = re.compile(
    r"C(?!ORD|ONVM?$|REEP)[A-Z]|R(BAR|ROD|BE1|TRPLT|SPLINE|JOINT)|MPC|DMIG|NSM|ASET|OMIT|SUPORT|MATT"
)


def unused_nodes(mesh: Mesh) -> IntArray:
    """Indices of the nodes that no cell, rigid or averaging element, mass or support refers to."""
    used = np.zeros(len(mesh.node_ids), dtype=bool)
    for block in mesh.blocks:
        used[block.nodes] = True
    ties = [(e.reference, e.nodes) for e in mesh.rigid] + [(e.reference, e.nodes) for e in mesh.averaging]
    for reference, nodes in ties:
        used[nodes] = True
        used[reference] = True
    used[[point.node for point in mesh.point_masses]] = True
    used[mesh.fixed[:, 0]] = True
    return np.flatnonzero(~used)


def empty_regions(mesh: Mesh) -> tuple[int, ...]:
    """Ids of the regions that no cell belongs to."""
    filled = {int(i) for block in mesh.blocks for i in np.unique(block.region)}
    return tuple(i for i in mesh.regions if i not in filled)


def suspicions(mesh: Mesh) -> tuple[str, ...]:
    """Sentences for a warning: values that speak of a wrong unit, what is not used, structural cards not taken over."""
    found = []
    for material in mesh.materials.values():
        name, units = f"material {material.id}", "mesh.mass_unit and mesh.length_unit"
        found += _outside(f"{name}: Young's modulus", material.youngs_modulus, MODULUS, "Pa", units)
        found += _outside(f"{name}: density", material.density, DENSITY, "kg/m³", units)
    extent = float(np.max(np.ptp(mesh.position, axis=0)))
    found += _outside("the structure's extent", extent, EXTENT, "m", "mesh.length_unit")
    if (unused := unused_nodes(mesh)).size:
        shown = ", ".join(str(mesh.node_ids[i]) for i in unused[:5]) + (", …" if unused.size > 5 else "")
        found.append(f"{unused.size} nodes belong to nothing and are left out of the model: {shown}")
    found += [f"region {i} ({mesh.regions[i].name}) has no elements" for i in empty_regions(mesh)]
    if len(mesh.fixed) == 0:
        found.append("nothing is fixed")
    found += [
        f"{count} × {card} not taken over: the stiffness, mass or tie it adds is missing"
        for card, count in mesh.ignored.items()
        if _STRUCTURAL.match(card)
    ]
    return tuple(found)


def _outside(what: str, value: float, limits: tuple[float, float], unit: str, check: str) -> list[str]:
    low, high = limits
    if low <= value <= high:
        return []
    return [f"{what} is {value:.3g} {unit}, outside {low:g} to {high:g}: check {check}"]
