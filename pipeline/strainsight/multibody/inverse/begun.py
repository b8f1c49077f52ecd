"""What a step leaves out, for all trials of one step: its slopes by the parameters, and an estimate of its own error."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.errors import NumericalError, UserError
from strainsight.multibody.advance import Method
from strainsight.multibody.inverse.left_out import LeftOut, Start, left_out
from strainsight.multibody.inverse.loads import LoadProcess
from strainsight.multibody.inverse.parameters import ParameterCoordinates
from strainsight.multibody.system import System

WIDTH = 1e-4
"""Of the differences by parameters, whose coordinates are logarithms, or µm of preload."""
CHECKED = 4
"""Every how many steps the error that is left of `left_out` is estimated anew: half of what its cost would be in each."""


@dataclass(frozen=True, eq=False)
class Begun:
    """Step k begins where left.change was found; by_xi (2n, p): slopes of that by the parameters; stale (2n, 2n): mean square of
    what it changes by when linearised at the start of the step; left None: it cannot be had."""

    k: int
    x: np.ndarray
    left: LeftOut | None
    by_xi: np.ndarray
    stale: np.ndarray

    @property
    def noise(self) -> np.ndarray:
        """Covariance (2n, 2n) of the motion that no state tells."""
        return self.stale if self.left is None else self.left.noise + self.stale


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
    the rates and of what is drawn. before: the step before, whose estimate of the error goes on.
    """
    n, p = 2 * system.size, len(xi)
    by_xi = np.zeros((n, p))
    stale = before.stale if before is not None and before.k == k - 1 else np.zeros((n, n))
    middle = 0.5 * (start.q + ahead[0]), 0.5 * (start.v + ahead[1])
    try:
        left = left_out(system, method, loads, inputs, start, middle)
        for j in range(0 if rest else p):
            moved = xi.copy()
            moved[j] += WIDTH
            there = start._replace(theta=coordinates.theta(moved)[0])
            by_xi[:, j] = (left_out(system, method, loads, inputs, there, middle).change - left.change) / WIDTH
        if k % CHECKED == 0:
            d = left.change - left_out(system, method, loads, inputs, start, (start.q, start.v)).change
            stale = 0.5 * (stale + np.outer(d, d)) if stale.any() else np.outer(d, d)
    except (NumericalError, UserError):
        return Begun(k, x.copy(), None, np.zeros((n, p)), stale)
    if rest:
        by_load = left.by_load.copy()
        by_load[:, loads.first] = 0.0
        left = replace(left, by_state=np.zeros_like(left.by_state), by_load=by_load)
    return Begun(k, x.copy(), left, by_xi, stale)
