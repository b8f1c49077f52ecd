"""Bars of hexahedra for reductions, and what a test picks from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.linalg import eigvalsh

from strainsight.fem.assembly import assemble
from strainsight.fem.model import nodal
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.joins import RigidElement
from strainsight.mesh.model import Mesh
from strainsight.sensors.candidates import candidates
from strainsight.sensors.strain_operator import channel_rows

from ..bodies import with_nodes
from ..fem.conftest import make_box

MESHES = Path(__file__).parents[2] / "meshes"
ROOT, TIP, SIDE = 901, 902, 903
SIZE = np.array([1.2, 0.3, 0.2])
START = np.array([0.4, -0.1, 0.25])
RHO = 7850.0


def bar(counts: tuple[int, int, int] = (8, 3, 2), side: bool = False, clamped: bool = False) -> Mesh:
    """A bar of hexahedra in two materials, its end faces tied to ROOT and TIP, a patch of its top to SIDE if asked."""
    cells = np.prod(counts)
    region = np.repeat([1, 2], [counts[0] // 2 * cells // counts[0], -(-counts[0] // 2) * cells // counts[0]])
    plain = make_box("hex8", counts, SIZE, region=region, materials={1: (2.1e11, 0.3, RHO), 2: (7.0e10, 0.33, RHO)})
    u = plain.position / SIZE
    n, middle = len(u), START + 0.5 * SIZE
    ends = [[START[0], *middle[1:]], [START[0] + SIZE[0] + 0.05, *middle[1:]]]
    faces = [np.flatnonzero(u[:, 0] == 0), np.flatnonzero(u[:, 0] == 1)]
    if side:
        ends.append([middle[0], middle[1], START[2] + SIZE[2] + 0.1])
        faces.append(np.flatnonzero((u[:, 2] == 1) & (np.abs(counts[0] * u[:, 0] - counts[0] // 2) < 1.5)))
    return replace(
        with_nodes(replace(plain, position=START + plain.position), *ends, ids=[ROOT, TIP, SIDE][: len(ends)]),
        fixed=np.array([(n, c) for c in range(6)] if clamped else [], dtype=np.int64).reshape(-1, 2),
        rigid=tuple(RigidElement(k + 1, n + k, face, (0, 1, 2)) for k, face in enumerate(faces)),
    )


def pick(model, *nodes):
    """Rows of the transform with six motions of every node (6k, n_free), dense."""
    rows = []
    for node in nodes:
        i = model.mesh.node_index(node)
        rows += [*range(3 * i, 3 * i + 3), *range(first := model.constraint.reference_rows[i], first + 3)]
    return model.constraint.transform[rows].toarray()


def dense(X):
    return X.toarray()


def rigid(points: np.ndarray) -> np.ndarray:
    """Displacement of points (k, 3) in three translations and three rotations about the origin (3k, 6)."""
    spin = np.stack([np.cross(axis, points).ravel() for axis in np.eye(3)], axis=1)
    return np.hstack([np.tile(np.eye(3), (len(points), 1)), spin])


def frequencies(K, M):
    return np.sqrt(np.maximum(eigvalsh(K, M), 0)) / (2 * np.pi)


def inertia_of(model, motion):
    """TᵀMr of a motion of every node (3n, k), by the mass matrix of all nodes."""
    T = model.constraint.transform[: len(motion)]
    return T.T @ (assemble(model.mesh, ())[1].constant @ motion)


def gauge_rows(model, shapes):
    bonded = candidates(model.mesh, exterior_facets(model.mesh), (1.0, 0.0, 0.0), (0.0, 45.0))
    return channel_rows(model.mesh.position, bonded, nodal(model, shapes))
