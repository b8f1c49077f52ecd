"""How the faces of shells and the sides of beams move with the nodes of these."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from strainsight.fem.equations import Rows
from strainsight.fem.ties import rigid_rows
from strainsight.mesh.model import Mesh
from strainsight.mesh.thin import BeamBlock


def with_arms(mesh: Mesh, rows: Rows, T: sparse.csr_array) -> sparse.csr_array:
    """T of z = T z_free (3n + 3r, n_free), with its rows of the nodes that follow one of a shell or beam as rigid arms:

        u_a = u + θ × (x_a − x),     on a side of a beam  − ν ε d  ∓ ½ γ L ŝ  too

    ŝ across the beam in the side, d along it from the middle of the side, ε the strain of that middle along the beam: the side
    contracts as in uniaxial stress. γ = (u_B − u_A)·ŝ/L − ½(θ_A + θ_B)·(x̂ × ŝ) of the ends (− at B): so much are straight
    sides turned against their sections by bending alone, as the deflection between nodes is none of a line; it is no shear.
    """
    T = sparse.csr_array(T + _rigid(mesh, rows) @ T)
    sides = [block for block in mesh.beams if (block.on_sides >= 0).any()]
    for block in sides:
        T = sparse.csr_array(T + _of_sides(mesh, block, rows) @ T)
    return T


def _rigid(mesh: Mesh, rows: Rows) -> sparse.csr_array:
    arm, reference = mesh.arms.T
    leads = _six(rows, reference)
    values = rigid_rows(mesh.position[arm] - mesh.position[reference])
    row = np.broadcast_to((3 * arm[:, None] + np.arange(3))[:, :, None], values.shape)
    column = np.broadcast_to(leads[:, None, :], values.shape)
    kept = values != 0
    return sparse.csr_array((values[kept], (row[kept], column[kept])), shape=(rows.size, rows.size))


def _six(rows: Rows, nodes: np.ndarray) -> np.ndarray:
    """Rows (k, 6) of the translations and rotations of nodes (k,)."""
    first = np.array([rows.first[node] for node in nodes.tolist()], dtype=np.int64)
    return np.concatenate([3 * nodes[:, None] + np.arange(3), first[:, None] + np.arange(3)], axis=1)


def _of_sides(mesh: Mesh, block: BeamBlock, rows: Rows) -> sparse.csr_array:
    """What the sides (s) of the beams of a block add to their rigid arms."""
    element, side = np.nonzero(block.on_sides[:, :, 0] >= 0)
    corners, ends = block.on_sides[element, side], block.nodes[element]
    x, node = mesh.position[corners], mesh.position[ends] + block.offset[element]
    along, across = block.axes[element, :, 0], block.axes[element][np.arange(len(element)), :, 2 - side % 2]
    length = np.linalg.norm(node[:, 1] - node[:, 0], axis=1)
    # which end each corner is at, by its place along the beam
    at_b = np.einsum("sci,si->sc", x - node[:, :1], along) > 0.5 * length[:, None]
    sign = np.where(at_b, 1.0, -1.0)
    d = np.einsum("sci,si->sc", x - x.mean(axis=1, keepdims=True), across)
    nu = np.array([mesh.materials[mesh.regions[int(i)].material].poisson_ratio for i in block.region[element]])
    strain = (0.5 * sign / length[:, None])[:, :, None] * along[:, None]
    contraction = -(nu[:, None] * d)[:, :, None, None, None] * across[:, None, :, None, None] * strain[:, None, None]
    # γ on the six motions of both nodes
    arms = rigid_rows(block.offset[element].reshape(-1, 3)).reshape(-1, 2, 3, 6)
    slope = np.einsum("e,s,si,seik->sek", [-1.0, 1.0], 1 / length, across, arms)
    slope[:, :, 3:] -= 0.5 * np.cross(along, across)[:, None]
    turned = (
        -0.5 * (sign * length[:, None])[:, :, None, None, None] * across[:, None, :, None, None] * slope[:, None, None]
    )
    row = 3 * corners[:, :, None] + np.arange(3)
    six = _six(rows, ends.ravel()).reshape(-1, 2, 6)
    entries = [(contraction, row[:, None, None]), (turned, six[:, None, None])]
    value = np.concatenate([own.ravel() for own, _ in entries])
    places = (
        np.concatenate([np.broadcast_to(row[..., None, None], own.shape).ravel() for own, _ in entries]),
        np.concatenate([np.broadcast_to(column, own.shape).ravel() for own, column in entries]),
    )
    return sparse.csr_array((value, places), shape=(rows.size, rows.size))
