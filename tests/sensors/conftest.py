"""Surfaces of every facet kind over a chart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from strainsight.mesh.facets import Facets
from strainsight.mesh.joins import RigidElement
from strainsight.mesh.kinds import FACETS
from strainsight.mesh.model import Mesh
from strainsight.sensors.strain_operator import channel_rows, misplaced

from ..bodies import body, held

KINDS = tuple(kind.name for kind in FACETS if not len(kind.read_at))
SQUARE = (((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)),)
HALVES = ((0, 0), (2, 0), (2, 2), (1, 0), (2, 1), (1, 1)), ((0, 0), (2, 2), (0, 2), (1, 1), (1, 2), (0, 1))
"""Nodes of a cell, in halves of it."""


def surface(
    kind: str,
    nx: int,
    ny: int,
    chart: Callable[[float, float], tuple[float, float, float]],
    shake: float = 0.0,
    closed: bool = False,
) -> tuple[np.ndarray, Facets]:
    """nx × ny cells (triangles: two each) with their nodes at chart(u, v), 0 ≤ u ≤ nx, 0 ≤ v ≤ ny, those inside shaken by
    `shake` cells along u and v, those between corners a fifth as much, beside them; closed: u = nx is u = 0 again."""
    i, j = np.indices((2 * nx + 1, 2 * ny + 1))
    inside = (j > 0) & (j < 2 * ny) & (closed | ((i > 0) & (i < 2 * nx)))
    off = shake * inside[..., None] * np.random.default_rng([nx, ny]).uniform(-1, 1, (*inside.shape, 2))
    off[-1] = off[0] if closed else off[-1]
    for a, b in ((1, 0), (0, 1), (1, 1)):
        ends = [
            off[2 * k * a : len(off) - 2 * (1 - k) * a : 2, 2 * k * b : off.shape[1] - 2 * (1 - k) * b : 2]
            for k in (0, 1)
        ]
        off[a::2, b::2] = 0.2 * off[a::2, b::2] + 0.5 * sum(ends)
    parts = np.array(HALVES if kind.startswith("tri") else SQUARE)[:, : len(FACETS[KINDS.index(kind)].nodes)]
    grid = (2 * np.stack(np.indices((nx, ny)), axis=-1).reshape(-1, 1, 1, 2) + parts).reshape(-1, parts.shape[1], 2)
    grid[..., 0] %= 2 * nx if closed else 2 * nx + 1
    used, nodes = np.unique(grid @ [2 * ny + 1, 1], return_inverse=True)
    position = [chart(*(np.array(key) / 2 + off[key])) for key in zip(*np.divmod(used, 2 * ny + 1), strict=True)]
    f = len(grid)
    facets = Facets(
        element_id=np.arange(1, f + 1),
        facet=np.ones(f, dtype=np.int64),
        kind=np.full(f, KINDS.index(kind)),
        nodes=np.pad(nodes.reshape(f, -1), [(0, 0), (0, 8 - parts.shape[1])], constant_values=-1),
        region=np.ones(f, dtype=np.int64),
    )
    return np.array(position), facets


def plate(kind, nx, ny, shake=0.0):
    """Cells of 1 m × 1 m in the x-y plane, normal +z."""
    return surface(kind, nx, ny, lambda u, v: (u, v, 0.0), shake)


def tube(kind, around, along, radius, shake=0.0):
    """A cylinder about z, cells of 1 m along z, normal outward."""
    step = 2 * np.pi / around
    chart = lambda u, v: (radius * np.cos(step * u), radius * np.sin(step * u), v)  # noqa: E731
    return surface(kind, around, along, chart, shake, closed=True)


def bare(position: np.ndarray) -> Mesh:
    """A mesh of nodes only, for facets that are given apart."""
    return Mesh(np.arange(1, len(position) + 1), position, ())


def bricks() -> Mesh:
    """10 × 3 × 2 hexahedra of edge 0.1 m, all nodes at x = 0 held, those at x = 1 m tied to a node in their middle."""
    mesh = body("hex8", (10, 3, 2), lambda *u: 0.1 * np.array(u))
    mesh = held(mesh, mesh.position[:, 0] == 0)
    count, ids = len(mesh.position), np.arange(1, len(mesh.position) + 2)
    tip = np.flatnonzero(mesh.position[:, 0] > 0.99)
    return replace(
        mesh,
        node_ids=ids,
        position=np.vstack([mesh.position, [1.0, 0.15, 0.1]]),
        rigid=(RigidElement(1, count, tip, (0, 1, 2)),),
        node_sets={"lonely": ids[:1], "root": ids[np.unique(mesh.fixed[:, 0])]},
    )


@pytest.fixture
def box_mesh() -> Mesh:
    return bricks()


def misplaced_rows(position, candidates, field, facets=None, offset=None, rotation=None):
    """`channel_rows` of the gauges that are `misplaced`."""
    moved, _ = misplaced(position, candidates.grids, facets, offset, rotation)
    return candidates.read(channel_rows(position, moved, field, facets=facets))
