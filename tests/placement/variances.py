"""Every criterion as a function of the eigenvalues of a covariance, in whatever arithmetic they are."""

from __future__ import annotations

from math import prod

import numpy as np

VARIANCE = {
    "trace": sum,
    "log_determinant": lambda values: prod(values) ** (1 / type(values[0])(len(values))),
    "worst_eigenvalue": max,
}


def variance(name, M):
    """The criterion of that name of M (k, k)."""
    return VARIANCE[name](np.linalg.eigvals(M).real.tolist())


def metric_of(name, scenario, P):
    """The same of the states of positive weight, in units of their weights."""
    at = np.flatnonzero(scenario.weight > 0)
    root = np.sqrt(scenario.weight[at])
    return variance(name, P[np.ix_(at, at)] * np.outer(root, root))
