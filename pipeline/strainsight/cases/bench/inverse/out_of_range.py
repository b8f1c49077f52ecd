"""Estimates of a bench's moduli that have left the range in which its reduced bodies are good."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from strainsight.cases.bench.inverse.comparison import in_theta
from strainsight.cases.bench.inverse.estimation import Estimated
from strainsight.estimation.decision import out_of_range, without_sigma
from strainsight.records.bodies import ReducedBody

REMEDY = (
    "set bodies.*.moduli.*.value nearer to it, keep more modes (bodies.*.modes), or look for a load, unit, support or "
    "sensor that is not as stated"
)
"""Of a modulus that came out beyond its `reach`."""


def bench_out_of_range(own: Estimated, reduced: Mapping[str, ReducedBody]) -> dict[str, str]:
    """Modulus → that it came out beyond its `reach`, for those that did; of all runs, the first that did.

    Laws of bearings are exact at every diameter, radius and preload that their own checks let pass.
    """
    reach = {name: (float(low), float(high)) for body in reduced.values() for name, (low, high) in body.reach.items()}
    beyond: dict[str, str] = {}
    for name in own.unknowns.free:
        inner = own.unknowns.parameters[name]
        if inner not in reach:
            continue
        for value in in_theta(own, own.bench.system.parameters.index(inner))[0][-1]:
            if np.isfinite(value) and name not in beyond:
                beyond |= out_of_range({name: float(value)}, {name: reach[inner]}, {name: "Pa"}, "reduce")
    return beyond


def estimated_without_sigma(own: Estimated) -> Estimated:
    """The estimate with every σ withheld: NaN."""
    held = own.without
    if held is not None:
        rows = tuple(replace(row, claim=None, inside=np.nan) for row in held.rows)
        held = replace(without_sigma(held), rows=rows)
    return replace(
        own,
        std=np.full_like(own.std, np.nan),
        xi_covariance=np.full_like(own.xi_covariance, np.nan),
        smoothed=without_sigma(own.smoothed),
        compared=None,
        without=held,
        rings=without_sigma(own.rings),
    )
