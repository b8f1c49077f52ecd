"""Scenarios that are solved with their whole pool before gauges are chosen, and rows of strain on their states."""

import numpy as np

from strainsight.placement.elimination import eliminate_from
from strainsight.placement.limits import Limits, limits_of
from strainsight.placement.scenario import solve_pool, weight_of_pools


def eliminate(scenarios, keep, aggregate="mean", *, fixed=(), names=()):
    """`eliminate_from` of the scenarios as solved."""
    limits = keep if isinstance(keep, Limits) else limits_of(len(scenarios[0].H), keep, fixed=fixed)
    return eliminate_from([solve_pool(own, names) for own in scenarios], limits, aggregate, names=names)


def whole_pool_weight(scenarios, unknown, names=()):
    """`weight_of_pools` of the scenarios as solved."""
    return weight_of_pools([solve_pool(own, names) for own in scenarios], unknown)


def augment_rows(rows, unknowns):
    """H* = [H, 0, 0, 0] (m, n*): strain rows (m, n) on x*; at given q nothing else enters."""
    m, n = rows.shape
    return np.hstack([rows, np.zeros((m, n + len(unknowns.state_names)))])
