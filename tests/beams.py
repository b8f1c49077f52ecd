"""Lines of beams, assembled densely, for tests of their element matrices."""

from __future__ import annotations

import numpy as np
from scipy import linalg

from strainsight.fem.beam_matrices import (
    beam_masses,
    beam_stiffnesses,
    curved_beam_masses,
    curved_beam_stiffnesses,
)
from strainsight.fem.beam_properties import BeamProperties


def axes_of(ends, towards):
    """x, y, z in columns of beams between ends (e, 2, 3), y towards (e, 3) or (3,)."""
    x = ends[:, 1] - ends[:, 0]
    x = x / np.linalg.norm(x, axis=1)[:, None]
    z = np.cross(x, np.broadcast_to(towards, x.shape))
    z /= np.linalg.norm(z, axis=1)[:, None]
    return np.stack([x, np.cross(z, x), z], axis=2)


def properties(count, area, second, torsion, shear=(0.0, 0.0), nu=0.3):
    """The same section in all beams, or with ends given: area (2,), second (2, 2, 2), torsion (2,)."""
    two = np.broadcast_to(np.asarray(second, float), (2, 2, 2))
    return BeamProperties(
        np.tile(np.broadcast_to(np.asarray(area, float), 2), (count, 1)),
        np.tile(two, (count, 1, 1, 1)),
        np.tile(np.broadcast_to(np.asarray(torsion, float), 2), (count, 1)),
        np.tile(np.asarray(shear, float), (count, 1)),
        np.full(count, nu),
    )


def rectangle(count, along_y, along_z, shear=(0.0, 0.0), nu=0.3, torsion=None):
    a, b = max(along_y, along_z), min(along_y, along_z)
    J = a * b**3 * (1 / 3 - 0.21 * b / a * (1 - (b / a) ** 4 / 12)) if torsion is None else torsion
    second = np.diag([along_z * along_y**3, along_y * along_z**3]) / 12
    return properties(count, along_y * along_z, second, J, shear, nu)


class Beams:
    """Elements with K and M (e, 6k, 6k) on cells (e, k) of nodes (n, 3): dense K and M of all motions."""

    def __init__(self, nodes, cells, stiffness, mass):
        self.nodes, self.cells = nodes, cells
        self.rows = (6 * cells[:, :, None] + np.arange(6)).reshape(len(cells), -1)
        self.K, self.M = np.zeros((2, 6 * len(nodes), 6 * len(nodes)))
        for rows, k, m in zip(self.rows, stiffness, mass, strict=True):
            self.K[np.ix_(rows, rows)] += k
            self.M[np.ix_(rows, rows)] += m

    def free(self, fixed):
        """Motions but for these: {node: components}."""
        held = [6 * node + component for node, components in fixed.items() for component in components]
        return np.setdiff1d(np.arange(len(self.K)), held)

    def solve(self, fixed, loads):
        """Motions (n, 6) under loads {(node, component): value}."""
        f, u = np.zeros(len(self.K)), np.zeros(len(self.K))
        for (node, component), value in loads.items():
            f[6 * node + component] += value
        free = self.free(fixed)
        u[free] = np.linalg.solve(self.K[np.ix_(free, free)], f[free])
        return u.reshape(-1, 6)

    def frequencies(self, fixed, count):
        free = self.free(fixed)
        # M may be singular (no inertia of turning), K is not
        inverse = linalg.eigvalsh(self.M[np.ix_(free, free)], self.K[np.ix_(free, free)])
        return 1 / np.sqrt(inverse[::-1][:count]) / (2 * np.pi)


class Frame(Beams):
    """Beams of two nodes."""

    def __init__(self, nodes, pairs, towards, own, E, density=0.0, rotary=False, offset=None, released=None):
        nodes, pairs = np.asarray(nodes, float), np.asarray(pairs)
        e = len(pairs)
        self.own, self.E = own, E
        self.position = nodes[pairs]
        self.offset = np.zeros((e, 2, 3)) if offset is None else offset
        self.released = np.zeros((e, 2, 6), bool) if released is None else released
        self.axes = axes_of(self.position + self.offset, towards)
        ids = np.arange(1, e + 1)
        K = E * beam_stiffnesses(self.position, self.axes, own, self.offset, self.released, ids)
        turning = density * own.second if rotary else None
        M = beam_masses(self.position, self.axes, density * own.area, self.offset, ids, turning)
        super().__init__(nodes, pairs, K, M)


class Arch(Beams):
    """Beams of three nodes, the middle one last."""

    def __init__(self, nodes, cells, towards, own, E, density=0.0):
        nodes, cells = np.asarray(nodes, float), np.asarray(cells)
        position, e = nodes[cells], len(cells)
        axes = axes_of(position[:, :2], towards)
        offset, ids = np.zeros((e, 3, 3)), np.arange(1, e + 1)
        K = E * curved_beam_stiffnesses(position, axes, own, offset, ids)
        M = curved_beam_masses(position, axes, density * own.area, offset, ids, density * own.second)
        super().__init__(nodes, cells, K, M)


def line(count, length, direction=(1.0, 0.0, 0.0)):
    """Nodes and pairs of a straight line of beams."""
    nodes = np.linspace(0, length, count + 1)[:, None] * np.asarray(direction)
    return nodes, np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)


def threes(nodes):
    """Beams of three nodes one after the other along nodes (2e + 1,)."""
    nodes = np.asarray(nodes)
    return np.stack([nodes[:-2:2], nodes[2::2], nodes[1::2]], axis=1)
