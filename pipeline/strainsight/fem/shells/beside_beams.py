"""Shells along which beams run: the rotation of their nodes about the normal is that of the beam, and not of the shell.

A beam on an arm e below a shell that tilts by θ(x) moves by e θ sideways, and its sections turn by e θ' about the normal, which
the shell does not. A shell that held its nodes to its own rotation would let the beam bend sideways between nodes alone.
"""

from __future__ import annotations

import numpy as np

from strainsight.fem.shells.tria import linear_turn


def let_go(K: np.ndarray, normal: np.ndarray, which: np.ndarray, spring: np.ndarray) -> np.ndarray:
    """K with a spring between the rotation p about the normal of some nodes and that of the element there, which follows it
    alone,

        K − K p pᵀK/(pᵀK p + s).

    normal (e, k, 3); which (e, k); spring s (e,) [N m]."""
    for node in np.flatnonzero(which.any(axis=0)):
        own = np.flatnonzero(which[:, node])
        at = slice(6 * node + 3, 6 * node + 6)
        column = np.einsum("eac,ec->ea", K[own, :, at], normal[own, node])
        pivot = np.einsum("ec,ec->e", column[:, at], normal[own, node]) + spring[own]
        share = np.divide(column, pivot[:, None], out=np.zeros(column.shape), where=pivot[:, None] > 0)
        K[own] -= share[:, :, None] * column[:, None, :]
    return K


def sprung(K: np.ndarray, xy: np.ndarray, which: np.ndarray, spring: np.ndarray) -> np.ndarray:
    """The same of triangles K (e, 18, 18) on the plane that do not feel these rotations: a spring from each to ½(v,x − u,y) of
    linear u and v."""
    apart = np.zeros((*which.shape, 18))
    apart[:, [0, 1, 2], [5, 11, 17]] = 1.0
    apart[..., 0::6], apart[..., 1::6] = (-linear_turn(xy)[:, None, :, component] for component in (0, 1))
    return np.asarray(K + apart.swapaxes(1, 2) @ ((spring[:, None] * which)[..., None] * apart))
