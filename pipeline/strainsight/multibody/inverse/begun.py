"""What a step leaves out, for all trials of one step: its slopes by the parameters, and an estimate of its own error."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.errors import NumericalError, UserError
from strainsight.multibody.advance import Method
from strainsight.multibody.inverse.left_out import LeftOut, Linearised, Start, change_at, linearised
from strainsight.multibody.inverse.loads import LoadProcess
from strainsight.multibody.inverse.parameters import ParameterCoordinates
from strainsight.multibody.system import System

WIDTH = 1e-4
"""Of the differences by parameters, whose coordinates are logarithms, or µm of preload."""
CHECKED = 4
"""Every how many steps the error that is left of `linearised` is estimated anew: half of what its cost would be in each."""
KEPT, CLOSE = 8, 0.05
"""How many steps a linearisation serves at most; twice as many as before where at its end it is off by less than CLOSE of σ of
what no state tells, one where it is not."""


@dataclass(frozen=True, eq=False)
class Begun:
    """Step k begins where left.change was found; by_xi (2n, p): slopes of that by the parameters; stale (2n, 2n): mean square of
    what it changes by when linearised where it was not; left None: it cannot be had. at: what the step is linearised as, since
    step `since`, for `serves` steps.
    """

    k: int
    x: np.ndarray
    left: LeftOut | None
    by_xi: np.ndarray
    stale: np.ndarray
    at: Linearised | None = None
    since: int = 0
    serves: int = 1

    def noises(self, k: int) -> tuple[np.ndarray | None, np.ndarray | None]:
        """Parts of the covariance (2n, 2n) of the motion that no state tells of step k, None of none: the same arrays as long as
        a linearisation serves."""
        return (None, None) if self.k != k else (None if self.left is None else self.left.noise, self.stale)


def begun(
    system: System,
    method: Method,
    loads: LoadProcess,
    inputs: np.ndarray,
    coordinates: ParameterCoordinates,
    x: np.ndarray,
    xi: np.ndarray,
    k: int,
    start: Start,
    ahead: tuple[np.ndarray, np.ndarray],
    rest: bool,
    before: Begun | None,
) -> Begun:
    """Of step k from x, linearised half-way between its start and `ahead`, q' and v' of the step alone; xi (p,) of x.

    rest: whether it begins in the equilibrium under its loads and parameters: then nothing is left out whatever they are, but of
    the rates and of what is drawn. before: the step before, whose estimate of the error goes on, and its linearisation while it
    serves: then only what moves the bench at the start is found anew. When it has served, what it is off by is part of the error.
    """
    n, p = 2 * system.size, len(xi)
    by_xi = np.zeros((n, p))
    if before is not None and before.k != k - 1:
        before = None
    stale = np.zeros((n, n)) if before is None else before.stale
    if before is not None and before.left is None:
        before = None
    old = None if before is None else before.at
    middle = 0.5 * (start.q + ahead[0]), 0.5 * (start.v + ahead[1])
    try:
        if before is not None and old is not None and k < before.since + before.serves:
            left = replace(old.left, change=old.change(system, loads.h, start))
            return replace(before, k=k, x=x.copy(), left=left)
        at = linearised(system, method, loads, inputs, start, middle)
        left = at.left
        for j in range(0 if rest else p):
            moved = xi.copy()
            moved[j] += WIDTH
            there = start._replace(theta=coordinates.theta(moved)[0])
            by_xi[:, j] = (change_at(system, method, loads, inputs, there, middle) - left.change) / WIDTH
        serves, apart = 1, []
        if old is not None and before is not None:
            d = left.change - old.change(system, loads.h, start)
            sigma = np.sqrt(np.diag(left.noise))
            serves = min(2 * before.serves, KEPT) if np.all(np.abs(d) <= CLOSE * sigma) else 1
            if before.serves > 1:
                apart.append(d)
        if apart or k % CHECKED == 0:
            apart.append(left.change - change_at(system, method, loads, inputs, start, (start.q, start.v)))
        if apart:
            off = np.array(apart)
            new = off.T @ off
            stale = 0.5 * (stale + new) if stale.any() else new
    except (NumericalError, UserError):
        return Begun(k, x.copy(), None, np.zeros((n, p)), stale)
    if rest:
        by_load = left.by_load.copy()
        by_load[:, loads.first] = 0.0
        left = replace(left, by_state=np.zeros_like(left.by_state), by_load=by_load)
        return Begun(k, x.copy(), left, by_xi, stale)
    return Begun(k, x.copy(), left, by_xi, stale, at, k, serves)
