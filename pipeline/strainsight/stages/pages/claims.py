"""Whether an estimate kept to the σ that was claimed for it: in the test, after smoothing, over the repeats."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.estimation.verdict import OVERCONFIDENT, TOO_CAUTIOUS, benefit_of, claim_of
from strainsight.report.placement.data import Benefit, Claim
from strainsight.workflow.output import Scalar


def claims_of(name: str, numbers: Mapping[str, Scalar], repeats: tuple[np.ndarray, np.ndarray]) -> tuple[Claim, ...]:
    """All claims of an unknown, first the one that decides: the worst overconfident one, else the most cautious one.

    numbers: the summary of validate; repeats: error and claimed σ (n,) of them, one draw each. Of a load the smoothed estimate
    counts, too, and errors are RMS of as many draws as the record in time is worth.
    """
    test = claim_of(*_draws(numbers, f"error.{name}", f"std.{name}", f"draws.{name}"))
    found = [] if test is None else [Claim("test", **vars(test))]
    if f"zero.{name}" in numbers:
        smoothed = claim_of(*_draws(numbers, f"smoothed.{name}", f"smoothed_std.{name}", f"smoothed_draws.{name}"))
        found += [] if smoothed is None else [Claim("smoothed", **vars(smoothed))]
    often = claim_of(*repeats)
    found += [] if often is None else [Claim("repeats", **vars(often))]
    return tuple(sorted(found, key=_weight, reverse=True))


def benefit_on(name: str, numbers: Mapping[str, Scalar], random: np.ndarray) -> Benefit | None:
    """The layout among random sets of all candidates, whose errors are random (sets,)."""
    found = benefit_of(float(numbers[f"error.{name}"]), random)
    return None if found is None else Benefit(**vars(found))


def _draws(numbers: Mapping[str, Scalar], error: str, std: str, draws: str) -> tuple[np.ndarray, np.ndarray]:
    """An RMS error and σ as so many draws of that size."""
    many = int(numbers[draws])
    return np.full(many, float(numbers[error])), np.full(many, float(numbers[std]))


def _weight(claim: Claim) -> tuple[int, float]:
    low, high = claim.band
    if claim.verdict == OVERCONFIDENT:
        return 2, claim.ratio / high
    return (1, low / max(claim.ratio, 1e-300)) if claim.verdict == TOO_CAUTIOUS else (0, 0.0)
