"""Rigid motions of a body in words."""

from __future__ import annotations

import numpy as np

AXES = "xyz"


def motion_words(null: np.ndarray, centre: np.ndarray, radius: float, where: str = "") -> list[str]:
    """The motions in span(null), each followed by `where`: "rotation about z through (0, 0, 0.5) m".

    null (6, k): translations and rotations times the radius [m] of a body about its centre (3,) [m].
    """
    U, strength, _ = np.linalg.svd(null, full_matrices=False)
    U = U[:, strength > 1e-6]
    pure = [i for i in range(6) if np.linalg.norm(U[i]) > 1 - 1e-9]
    words = [(f"translation {AXES[i]}" if i < 3 else f"rotation about {AXES[i - 3]}") + where for i in pure]
    rest = U.copy()
    rest[pure] = 0.0
    Q, strength, _ = np.linalg.svd(rest, full_matrices=False)
    for t, w in ((q[:3], q[3:] / radius) for q in _echelon(Q[:, strength > 1e-6]).T):
        if np.linalg.norm(w) * radius < 1e-6 * np.linalg.norm(t):
            words.append(f"translation along {_triple(_upward(t))}{where}")
        else:
            point = centre + np.cross(w, t) / (w @ w)
            words.append(f"rotation about {_line(_upward(w))} through {_triple(point)} m{where}")
    return words


def _echelon(Q: np.ndarray) -> np.ndarray:
    """The basis of span(Q), Q (6, k), in which each vector alone has a one in one of k rows, rotations first: no rounding
    chooses among the bases."""
    rows: list[int] = []
    for row in (3, 4, 5, 0, 1, 2):
        if np.linalg.matrix_rank(Q[[*rows, row]], tol=1e-6) > len(rows):
            rows.append(row)
    return Q @ np.linalg.inv(Q[rows])


def _upward(v: np.ndarray) -> np.ndarray:
    """±v/|v|, its first component that is none of rounding positive."""
    v = v / np.linalg.norm(v)
    return v * np.sign(v[np.argmax(np.abs(v) > 1e-6)])


def _line(w: np.ndarray) -> str:
    along = int(np.argmax(np.abs(w)))
    return AXES[along] if abs(w[along]) > 1 - 1e-9 else _triple(w)


def _triple(v: np.ndarray) -> str:
    return "(" + ", ".join(f"{round(float(x), 6) + 0.0:.4g}" for x in v) + ")"
