"""How the faces of shells and the sides of beams move with the nodes of these."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from strainsight.fem.beam_curved import GAUSS, beam_strains
from strainsight.fem.equations import Rows
from strainsight.fem.ties import rigid_rows
from strainsight.mesh.beam_axes import ALONG, axes_along
from strainsight.mesh.beam_sides import SIDES, around
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
        own = _of_curved_sides if block.nodes.shape[1] == 3 else _of_sides
        T = sparse.csr_array(T + own(mesh, block, rows) @ T)
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


def _of_curved_sides(mesh: Mesh, block: BeamBlock, rows: Rows) -> sparse.csr_array:
    """The same of beams of three nodes, on the six motions of these."""
    element, side = np.nonzero(block.on_sides[:, :, 0] >= 0)
    corners, nodes, offset = block.on_sides[element, side], block.nodes[element], block.offset[element]
    position = mesh.position[nodes]
    axes, size = axes_along(position + offset, block.axes[element], ALONG)
    strains = beam_strains(position, block.axes[element], offset, GAUSS)
    # from the points of Gauss to A, B and between
    line = np.stack([0.5 * (1 + ALONG / GAUSS[0]), 0.5 * (1 + ALONG / GAUSS[1])], axis=1)
    nu = np.array([mesh.materials[mesh.regions[int(i)].material].poisson_ratio for i in block.region[element]])
    value = np.zeros((len(element), 8, 3, 18))
    for number, (axis, sign) in enumerate(SIDES):
        own = np.flatnonzero(side == number)
        if not len(own):
            continue
        at = np.array([node for node, _ in around(axis, sign)])
        arm = mesh.position[corners[own]] - (position + offset)[own][:, at]
        y, z = (np.einsum("sci,sci->sc", arm, axes[own][:, at][..., i]) for i in (1, 2))
        # of the middle of the side: which node stands at the same place of the beam on its other edge
        out, along = (y, z) if axis == 0 else (z, y)
        middle = np.stack([along[:, (at == at[c])].mean(axis=1) for c in range(8)], axis=1)
        my, mz = (out, middle) if axis == 0 else (middle, out)
        B = np.einsum("pg,sgrm->sprm", line, strains[own])[:, at]
        strain = B[:, :, 0] - my[..., None] * B[:, :, 5] + mz[..., None] * B[:, :, 4]
        shift = -(nu[own, None] * (along - middle))[..., None] * strain
        gamma = strains[own][:, :, 2 - axis]  # along z of the sides ±y, along y of the sides ±z
        mean, rise = gamma.mean(axis=1), 0.5 * (gamma[:, 1] - gamma[:, 0]) / GAUSS[1]
        xi = ALONG[at]
        shift -= size[own, 2, None, None] * (xi[:, None] * mean[:, None] + 0.5 * xi[:, None] ** 2 * rise[:, None])
        value[own] = axes[own][:, at][..., 2 - axis, None] * shift[:, :, None]
    row = np.broadcast_to((3 * corners[:, :, None] + np.arange(3))[..., None], value.shape)
    column = np.broadcast_to(_six(rows, nodes.ravel()).reshape(-1, 1, 1, 18), value.shape)
    kept = value != 0
    return sparse.csr_array((value[kept], (row[kept], column[kept])), shape=(rows.size, rows.size))
