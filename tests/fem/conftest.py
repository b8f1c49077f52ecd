"""Boxes of every element kind."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.mesh.model import CellBlock, Material, Mesh, Region

from ..solids import CUTS, PYRAMID, SOLIDS
from ..structures import hexahedra


def with_midsides(position: np.ndarray, cells: np.ndarray, kind: str) -> tuple[np.ndarray, np.ndarray]:
    pairs = np.sort(cells[:, np.array(SOLIDS[kind].edges)], axis=2)
    unique, index = np.unique(pairs.reshape(-1, 2), axis=0, return_inverse=True)
    middle = 0.5 * (position[unique[:, 0]] + position[unique[:, 1]])
    return np.vstack([position, middle]), np.hstack([cells, len(position) + index.reshape(pairs.shape[:2])])


def make_mesh(position, blocks, fixed=(), material=(2.1e11, 0.3, 7850.0), **more) -> Mesh:
    """blocks: (kind, cells, region); regions share the material unless `materials` says region → material tuple."""
    regions = sorted({int(r) for _, _, region in blocks for r in np.unique(region)})
    table = more.pop("materials", dict.fromkeys(regions, material))
    cells, at = [], 1
    for kind, nodes, region in blocks:
        cells.append(
            CellBlock(
                kind, np.arange(at, at + len(nodes)), np.asarray(nodes), np.broadcast_to(region, len(nodes)).copy()
            )
        )
        at += len(nodes)
    return Mesh(
        node_ids=np.arange(1, len(position) + 1),
        position=np.asarray(position, float),
        blocks=tuple(cells),
        regions={r: Region(r, f"region {r}", r) for r in regions},
        materials={r: Material(r, *table[r]) for r in regions},
        fixed=np.asarray(list(fixed), dtype=np.int64).reshape(-1, 2),
        **more,
    )


def make_box(
    kind: str,
    counts=(2, 2, 2),
    size=(1.0, 1.0, 1.0),
    distort: float = 0.0,
    seed: int = 0,
    clamp_root: bool = False,
    **more,
) -> Mesh:
    """A box of counts hexahedra, cut into `kind`; inner corners moved by `distort` cells, root clamped if asked."""
    grid, _, cells = hexahedra(counts)
    cells = cells.reshape(-1, 8)
    inner = np.all((grid > 0) & (grid < np.array(counts)), axis=1)
    rng = np.random.default_rng(seed)
    moved = grid + distort * rng.uniform(-1, 1, grid.shape) * inner[:, None]
    position = moved / np.array(counts) * np.array(size)
    if SOLIDS[kind].corners == PYRAMID:
        inside = position[cells].mean(axis=1)
        cells = np.column_stack([cells, len(position) + np.arange(len(cells))])
        position = np.vstack([position, inside + 0.3 * distort * rng.uniform(-1, 1, inside.shape) * size / counts])
    cells = np.concatenate([cells[:, list(cut)] for cut in CUTS[SOLIDS[kind].corners]])
    if SOLIDS[kind].edges:
        position, cells = with_midsides(position, cells, kind)
    fixed = [(n, c) for n in np.flatnonzero(np.isclose(position[:, 0], 0.0)) for c in range(3)] if clamp_root else []
    return make_mesh(position, [(kind, cells, more.pop("region", 1))], fixed, **more)


@pytest.fixture(scope="session")
def box():
    return make_box


@pytest.fixture(scope="session")
def mesh_of():
    return make_mesh


@pytest.fixture(scope="session")
def midsides():
    return with_midsides
