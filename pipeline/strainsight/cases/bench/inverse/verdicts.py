"""Warnings about an estimate: where its claim does not hold, and why."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from strainsight.cases.bench.inverse.unknowns import asked
from strainsight.config.bench.bench import BenchConfig
from strainsight.estimation.consistency import Claim

Scalar = float | str
"""Of a summary."""

LARGE_NIS, SMALL_NIS = 2.0, 0.5
"""Of a truth that the filter's model could have made; slow loads make it smaller, down to (m − n)/m."""
HARDLY = 0.5
"""σ of a load over its largest value above which it is weakly observable."""
MATCHES = 0.01
"""Mismatch of a sensor up to which one bench moves as the other."""


def warnings_of(
    config: BenchConfig,
    free: tuple[str, ...],
    numbers: Mapping[str, Scalar],
    claims: Mapping[str, Claim],
    nis: float,
    lost: np.ndarray,
) -> Iterator[str]:
    """Sentences; numbers: the summary's, claims by unknown, nis over the number of channels, lost (runs,) steps, −1 for none."""
    estimate, gone = asked(config), lost[lost >= 0]
    if len(gone):
        yield f"{len(gone)} of {len(lost)} runs diverged, the first after {gone.min()} steps"
    for name in (*estimate.inputs, *free):
        std, claim = _float(numbers, f"std.{name}"), claims.get(name)
        if claim is not None and claim.verdict == "overconfident":
            yield (
                f"{name} is overconfident: its error is {claim.ratio:.3g} times what the filter claims, at most "
                f"{claim.band[1]:.3g} where the claim holds"
            )
        if name in estimate.inputs and std > HARDLY:
            yield (
                f"{name} is weakly observable: σ is {100 * std:.3g} % of the largest load; give other sensors, "
                "or make a load known"
            )
    yield from (
        f"{name} is not identified: its starts end more than three σ apart, its σ has not halved, or it is wrong beyond it"
        for name in free
        if numbers.get(f"identified.{name}") is False
    )
    if nis > LARGE_NIS or (estimate.truth.model == "walk" and nis < SMALL_NIS):
        size, noises = ("larger", "small") if nis > 1 else ("smaller", "large")
        yield (
            f"innovations are {np.sqrt(max(nis, 1 / nis)):.3g} times {size} than the filter claims: its model is not the bench, "
            f"or increments, disturbance or noise are too {noises}"
        )
    if estimate.measured is not None:
        for name in estimate.sensors:
            mismatch = _float(numbers, f"mismatch.{name}")
            if mismatch > MATCHES:
                there = estimate.measured.run
                yield f"these loads do not make {name} read as on {there}: it is {100 * mismatch:.3g} % off"


def message_of(
    config: BenchConfig, free: tuple[str, ...], numbers: Mapping[str, Scalar], method: str, truth: str
) -> str:
    """One line: what is known of every unknown."""
    said, estimate = [], asked(config)
    for name in (*estimate.inputs, *free):
        if f"error.{name}" in numbers:
            error, std = (100 * _float(numbers, f"{key}.{name}") for key in ("error", "std"))
            said.append(f"{name} to {error:.2g} % (σ {std:.2g} %)")
        elif f"ratio_slope.{name}" in numbers:
            offset = _float(numbers, f"ratio_offset.{name}")
            said.append(
                f"{name} = {_float(numbers, f'ratio_slope.{name}'):.3g} of the one there {'+-'[offset < 0]} {abs(offset):.3g}"
            )
    if estimate.measured is not None:
        worst = max((_float(numbers, f"mismatch.{name}") for name in estimate.sensors), default=np.nan)
        said.insert(0, f"sensors {100 * worst:.2g} % off")
    return f"{', '.join(said) or 'nothing comparable'}; {method}, {truth}"


def _float(numbers: Mapping[str, Scalar], key: str) -> float:
    return float(numbers.get(key, np.nan))
