"""A run of steps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from strainsight.errors import NumericalError
from strainsight.multibody.advance import Advance, Method, advance
from strainsight.multibody.initial import check_consistent
from strainsight.multibody.system import System


@dataclass(frozen=True)
class Trajectory:
    """time (T + 1,) [s], q, v (T + 1, n), u (T + 1, nu), the start first; lam (T, m): multipliers of the
    joints in the last stage of a step, zero for the rigidity of bodies."""

    time: np.ndarray
    q: np.ndarray
    v: np.ndarray
    u: np.ndarray
    lam: np.ndarray


def simulate(
    system: System,
    q0: np.ndarray,
    v0: np.ndarray,
    u: np.ndarray,
    h: float,
    theta: np.ndarray,
    method: Method = "second_order",
    progress: Callable[[int], None] | None = None,
) -> Trajectory:
    """`advance` from 0 to h, 2h, …; u (T + 1, nu): loads at these instants, straight between them [N, N m], then p and ṗ of
    driven joints.

    progress is called with the number of steps done.
    Raises InfeasibleError where the start breaks a constraint, NumericalError with the time where a step fails.
    """
    u = np.asarray(u, dtype=float)
    check_consistent(system, np.asarray(q0, dtype=float), np.asarray(v0, dtype=float), u[0])
    count = len(u) - 1
    q, v = np.empty((count + 1, system.size)), np.empty((count + 1, system.size))
    lam = np.empty((count, system.constrained))
    q[0], v[0] = q0, v0
    last: Advance | None = None
    for k in range(count):
        try:
            last = advance(system, q[k], v[k], (u[k], u[k + 1]), h, theta, method, last=last)
        except NumericalError as error:
            raise NumericalError(f"at t = {k * h:g} s: {error.what}", remedy=error.remedy) from error
        q[k + 1], v[k + 1], lam[k] = last.q, last.v, last.stages[-1].lam
        if progress is not None:
            progress(k + 1)
    return Trajectory(h * np.arange(count + 1), q, v, u, lam)
