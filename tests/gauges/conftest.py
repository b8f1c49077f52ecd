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

from ..bodies import body, held

KINDS = tuple(kind.name for kind in FACETS if not len(kind.read_at))


def surface(
    kind: str,
    nx: int,
    ny: int,
    chart: Callable[[float, float], tuple[float, float, float]],
    shake: float = 0.0,
    closed: bool = False,
) -> tuple[np.ndarray, Facets]:
    """nx × ny cells (triangles: two each) with their nodes at chart(u, v), 0 ≤ u ≤ nx, 0 ≤ v ≤ ny, those inside shaken by
    `shake` cells along u and v; closed: u = nx is u = 0 again."""
    rng = np.random.default_rng(nx * 100 + ny)
    where: dict[tuple[int, int], int] = {}
    position: list[tuple[float, float, float]] = []

    def node(key: tuple[int, int]) -> int:
        key = (key[0] % (2 * nx), key[1]) if closed else key
        if key not in where:
            where[key] = len(position)
            position.append(chart(*(np.array(key) / 2 + shaken(key))))
        return where[key]

    moved: dict[tuple[int, int], np.ndarray] = {}

    def shaken(key: tuple[int, int]) -> np.ndarray:
        """How far a corner is off its place; a node between corners goes with them, and is shaken a fifth as much."""
        key = (key[0] % (2 * nx), key[1]) if closed else key
        if key not in moved:
            inside = 0 < key[1] < 2 * ny and (closed or 0 < key[0] < 2 * nx)
            own = shake * inside * rng.uniform(-1, 1, 2)
            i, j = key[0] % 2, key[1] % 2
            if i or j:
                own = 0.2 * own + 0.5 * (shaken((key[0] - i, key[1] - j)) + shaken((key[0] + i, key[1] + j)))
            moved[key] = own
        return moved[key]

    rows = []
    for i in range(nx):
        for j in range(ny):
            a, b, c, d = (2 * i, 2 * j), (2 * i + 2, 2 * j), (2 * i + 2, 2 * j + 2), (2 * i, 2 * j + 2)
            for corners in [(a, b, c), (a, c, d)] if kind.startswith("tri") else [(a, b, c, d)]:
                keys = list(corners)
                if kind in ("tri6", "quad8"):
                    following = (*corners[1:], corners[0])
                    keys += [((p[0] + q[0]) // 2, (p[1] + q[1]) // 2) for p, q in zip(corners, following, strict=True)]
                rows.append([node(key) for key in keys] + [-1] * (8 - len(keys)))
    f = len(rows)
    facets = Facets(
        element_id=np.arange(1, f + 1),
        facet=np.ones(f, dtype=np.int64),
        kind=np.full(f, KINDS.index(kind)),
        nodes=np.array(rows),
        region=np.ones(f, dtype=np.int64),
    )
    return np.array(position), facets


@pytest.fixture
def plate():
    """plate(kind, nx, ny, shake=0): cells of 1 m × 1 m in the x-y plane, normal +z."""
    return lambda kind, nx, ny, shake=0.0: surface(kind, nx, ny, lambda u, v: (u, v, 0.0), shake)


@pytest.fixture
def tube():
    """tube(kind, around, along, radius, shake=0): a cylinder about z, cells of 1 m along z, normal outward."""

    def build(kind, around, along, radius, shake=0.0):
        step = 2 * np.pi / around
        return surface(
            kind,
            around,
            along,
            lambda u, v: (radius * np.cos(step * u), radius * np.sin(step * u), v),
            shake,
            closed=True,
        )

    return build


@pytest.fixture
def bare():
    """bare(position): a mesh of nodes only, for facets that are given apart."""

    def build(position: np.ndarray) -> Mesh:
        return Mesh(np.arange(1, len(position) + 1), position, (), {}, {}, np.zeros((0, 2), dtype=np.int64))

    return build


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
