"""Estimates of a bench's moduli that have left the range in which its reduced bodies are good."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from strainsight.cases.bench.inverse.comparison import in_theta
from strainsight.cases.bench.inverse.estimation import Estimated
from strainsight.cases.bench.inverse.hold_out import HeldOut
from strainsight.estimation.decision import out_of_range
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


def without_sigma(own: Estimated) -> Estimated:
    """The estimate with every σ withheld: NaN."""
    smoothed = own.smoothed
    nothing = np.full_like(own.std, np.nan)
    return replace(
        own,
        std=nothing,
        xi_covariance=np.full_like(own.xi_covariance, np.nan),
        smoothed=None if smoothed is None else replace(smoothed, std=np.full_like(smoothed.std, np.nan)),
        compared=None,
        without=None if own.without is None else _held_out(own.without),
        rings={
            name: replace(
                ring,
                std=np.full_like(ring.std, np.nan),
                pressure_std=np.full_like(ring.pressure_std, np.nan),
                worst=replace(
                    ring.worst,
                    force_std=np.full_like(ring.worst.force_std, np.nan),
                    pressure_std=np.full_like(ring.worst.pressure_std, np.nan),
                ),
            )
            for name, ring in own.rings.items()
        },
    )


def _held_out(own: HeldOut) -> HeldOut:
    rows = tuple(replace(row, claim=None, inside=np.nan) for row in own.rows)
    return replace(own, std=np.full_like(own.std, np.nan), rows=rows)
