"""Where membrane and shear strain of second-order shells are tied, and how they go on from there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from strainsight.mesh.kinds.kind import Kind, Rule
from strainsight.mesh.kinds.quadrangles import QUAD8
from strainsight.mesh.kinds.rules import gauss, triangle
from strainsight.mesh.kinds.triangles import ALONG_SIDES, FIRST, SECOND, TRI6

Weights = Callable[[np.ndarray], np.ndarray]

TWO = np.array([-1.0, 1.0]) / np.sqrt(3)
"""Gauss points of −1 … 1."""
SIDES = np.array([-1.0, 0.0, 1.0])
"""Where shear is tied across: along the sides it is then that of their own nodes, and curved ones do not lock."""


@dataclass(frozen=True, eq=False)
class Ties:
    """facet: the kind with the same nodes; rule of the integrals; inner (q, 2) → N (q,) and ∂N/∂ξ (q, 2) of the motion within,
    which ψ has; completed: the functions of the nodes have a share in it that makes them hold quadratics; held: ties
    leave a motion free, which what is not tied has to hold; stretch_at (t, 2), where e_rr, e_ss, 2 e_rs are taken, and their
    weights (q, 3, t, 3) at points (q, 2); shear_at (t, 2) and weights (q, 2, t, 2) of γ_r, γ_s."""

    facet: Kind
    rule: Rule
    inner: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    completed: bool
    held: bool
    stretch_at: np.ndarray
    stretch: Weights
    shear_at: np.ndarray
    shear: Weights


def _lagrange(at: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(q, n): the polynomials that are one at one of the points `at` (n,), at x (q,)."""
    others = [np.delete(at, i) for i in range(len(at))]
    return np.stack([np.prod((x[:, None] - b) / (a - b), axis=1) for a, b in zip(at, others, strict=True)], axis=-1)


def _grid(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.stack(np.meshgrid(a, b, indexing="ij"), axis=-1).reshape(-1, 2)


def _over_grid(a: np.ndarray, b: np.ndarray, xi: np.ndarray) -> np.ndarray:
    """(q, a b): the polynomials of the points of a grid."""
    both = _lagrange(a, xi[:, 0])[:, :, None] * _lagrange(b, xi[:, 1])[:, None]
    return both.reshape(len(xi), -1)


def _quad_stretch(xi: np.ndarray) -> np.ndarray:
    W = np.zeros((len(xi), 3, 4, 3))
    for component in range(3):
        W[:, component, :, component] = _over_grid(TWO, TWO, xi)
    return W


def _quad_shear(xi: np.ndarray) -> np.ndarray:
    W = np.zeros((len(xi), 2, 12, 2))
    W[:, 0, :6, 0] = _over_grid(TWO, SIDES, xi)
    W[:, 1, 6:, 1] = _over_grid(SIDES, TWO, xi)
    return W


def _quad_inner(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(1 − ξ²)(1 − η²): with it the functions are those of nine nodes."""
    r, s = xi.T
    return (1 - r**2) * (1 - s**2), np.stack([-2 * r * (1 - s**2), -2 * s * (1 - r**2)], axis=-1)


QUAD = Ties(
    facet=QUAD8,
    rule=gauss(3, 2),
    inner=_quad_inner,
    completed=True,
    held=True,
    stretch_at=_grid(TWO, TWO),
    stretch=_quad_stretch,
    shear_at=np.vstack([_grid(TWO, SIDES), _grid(SIDES, TWO)]),
    shear=_quad_shear,
)
"""e at the four points of Gauss, γ_r at ξ = ±1/√3 and η = 0, ±1, γ_s the other way round."""


_INSIDE, _SHARE = triangle(4)
_TRI_SHEAR = np.vstack([[[FIRST, 0], [SECOND, 0], [SECOND, FIRST], [FIRST, SECOND], [0, SECOND], [0, FIRST]], _INSIDE])
_ALONG = np.array([[1.0, 0], [1, 0], [-1, 1], [-1, 1], [0, -1], [0, -1]])


def _linear(xi: np.ndarray) -> np.ndarray:
    return np.column_stack([np.ones(len(xi)), xi])


_LINEAR = [np.linalg.inv(_linear(ALONG_SIDES[i : i + 3])) for i in (0, 3, 6)]


def _tri_stretch(xi: np.ndarray) -> np.ndarray:
    """Linear along each of the three, 2 e_qq = e_rr + e_ss − 2 e_rs."""
    rr, ss, qq = (_linear(xi) @ own for own in _LINEAR)
    W = np.zeros((len(xi), 3, 9, 3))
    W[:, 0, :3, 0] = W[:, 2, :3, 0] = rr
    W[:, 1, 3:6, 1] = W[:, 2, 3:6, 1] = ss
    W[:, 2, 6:, 0] = W[:, 2, 6:, 1] = -qq
    W[:, 2, 6:, 2] = qq
    return W


def _edge_space(xi: np.ndarray) -> np.ndarray:
    """(q, 2, 8): (γ_r, γ_s) linear, and (s, −r) times r and s."""
    r, s = xi.T
    no, one = np.zeros_like(r), np.ones_like(r)
    return np.stack(
        [
            np.stack([one, r, s, no, no, no, r * s, s * s], axis=-1),
            np.stack([no, no, no, one, r, s, -r * r, -r * s], axis=-1),
        ],
        axis=1,
    )


def _tied_shear() -> np.ndarray:
    """(8, t, 2): coefficients of `_edge_space` from γ at the points: along the sides at both, and the mean inside."""
    held = np.zeros((8, len(_TRI_SHEAR), 2))
    held[range(6), range(6)] = _ALONG
    held[6, 6:, 0] = held[7, 6:, 1] = _SHARE / _SHARE.sum()
    space = np.einsum("htc,tcb->hb", held, _edge_space(_TRI_SHEAR))
    return np.linalg.solve(space, held.reshape(8, -1)).reshape(held.shape)


_SHEAR = _tied_shear()


def _tri_shear(xi: np.ndarray) -> np.ndarray:
    return np.einsum("qcb,btd->qctd", _edge_space(xi), _SHEAR)


def _tri_inner(xi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """27 r s (1 − r − s)."""
    r, s = xi.T
    return 27 * r * s * (1 - r - s), 27 * np.stack([s * (1 - 2 * r - s), r * (1 - r - 2 * s)], axis=-1)


TRIA = Ties(
    facet=TRI6,
    rule=(_INSIDE, _SHARE),
    inner=_tri_inner,
    completed=False,
    held=False,
    stretch_at=ALONG_SIDES,
    stretch=_tri_stretch,
    shear_at=_TRI_SHEAR,
    shear=_tri_shear,
)

TIES = {8: QUAD, 6: TRIA}
"""Nodes of an element → what is tied in it."""
