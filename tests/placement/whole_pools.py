"""Scenarios that are solved with their whole pool before gauges are chosen."""

from strainsight.placement.elimination import eliminate_from
from strainsight.placement.limits import as_limits
from strainsight.placement.scenario import solve_pool, weight_of_pools


def eliminate(scenarios, keep, aggregate="mean", *, fixed=(), names=()):
    """`eliminate_from` of the scenarios as solved."""
    limits = as_limits(len(scenarios[0].H), keep, fixed)
    return eliminate_from([solve_pool(own, names) for own in scenarios], limits, aggregate, names=names)


def whole_pool_weight(scenarios, unknown, names=()):
    """`weight_of_pools` of the scenarios as solved."""
    return weight_of_pools([solve_pool(own, names) for own in scenarios], unknown)
