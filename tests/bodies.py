"""Bodies of any solid on a grid, held and loaded at nodes, and how they move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from strainsight.fem.factorisation import factorise
from strainsight.fem.model import build_model, nodal
from strainsight.mesh.kinds import kind_of
from strainsight.mesh.model import CellBlock, Material, Mesh, Region

from .solids import CUTS, HEX, SOLIDS

E, NU, RHO = 2.1e11, 0.3, 7850.0


def body(kind, counts, chart, keep=lambda *cell: True):
    """Cells of a grid, each cut into solids of a kind; pyramids with a node in its middle; nodes at chart(u), u in cells."""
    number, rows, corners = {}, [], [*HEX, (0.5, 0.5, 0.5)]
    for cell in np.ndindex(*counts):
        if not keep(*cell):
            continue
        at = [tuple(int(v) for v in 2 * (np.array(cell) + corner)) for corner in corners]
        for part in CUTS[SOLIDS[kind].corners]:
            own = [at[i] for i in part]
            own += [tuple((np.add(own[a], own[b]) // 2).tolist()) for a, b in kind_of(kind).edges]
            rows.append([number.setdefault(key, len(number)) for key in own])
    x = np.array([chart(*(np.array(key) / 2)) for key in number], dtype=float)
    ids = np.arange(1, len(rows) + 1)
    block = CellBlock(kind, ids, np.array(rows), np.ones(len(rows), dtype=np.int64))
    steel = {"regions": {1: Region(1, "part", 1)}, "materials": {1: Material(1, E, NU, RHO)}}
    return Mesh(np.arange(1, len(x) + 1), x, (block,), **steel)


def with_nodes(mesh, *points, ids=()):
    """With further nodes at points; ids: theirs, or those after the last."""
    position = np.vstack([mesh.position, *points])
    ids = ids or int(mesh.node_ids.max()) + 1 + np.arange(len(position) - len(mesh.position))
    return replace(mesh, node_ids=np.append(mesh.node_ids, ids), position=position)


def held(mesh, where, components=(0, 1, 2)):
    pairs = [(node, c) for node in np.flatnonzero(where) for c in components]
    return replace(mesh, fixed=np.vstack([mesh.fixed, pairs]).astype(np.int64))


def moved(mesh, force):
    """Displacements (3n, 1) under forces at nodes (n, 3)."""
    model = build_model(mesh)
    T = model.constraint.transform[: force.size]
    return nodal(model, factorise(model.stiffness.constant).solve(T.T @ force.reshape(-1, 1)))


def stacked(one, shift):
    """Two copies of a body of one kind without a common node, the second moved by `shift` (3,)."""
    n, block = len(one.position), one.blocks[0]
    nodes, count = np.vstack([block.nodes, block.nodes + n]), 2 * len(block.ids)
    both = replace(block, ids=np.arange(1, count + 1), nodes=nodes, region=np.ones(count, dtype=np.int64))
    position = np.vstack([one.position, one.position + shift])
    return replace(one, node_ids=np.arange(1, 2 * n + 1), position=position, blocks=(both,))
