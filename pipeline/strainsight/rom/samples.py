"""Points of the parameter box: those the basis is built from, and those it is checked at."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.errors import InfeasibleError

GOLDEN = (3 - 5**0.5) / 2

Theta = Mapping[str, float]


def parameter_samples(
    reference: Theta, ranges: Mapping[str, tuple[float, float]], samples: int
) -> tuple[dict[str, float], ...]:
    """The reference, then samples − 1 points of a Latin hypercube in log θ that reaches both ends of every range.

    reference and ranges [SI]; the columns are ordered by the ranks of a Halton sequence, so nothing is random.
    Raises InfeasibleError for a range that is missing or not 0 < low ≤ high.
    """
    if not reference:
        return ({},)
    count = samples - 1
    return (dict(reference), *_latin(reference, ranges, np.linspace(0, 1, count) if count > 1 else np.zeros(count)))


def held_out_samples(
    reference: Theta, ranges: Mapping[str, tuple[float, float]], count: int
) -> tuple[dict[str, float], ...]:
    """A Latin hypercube at the golden section of `count` equal parts of log θ, so never on a level of the samples.

    Arguments and errors as in `parameter_samples`.
    """
    return _latin(reference, ranges, (np.arange(count) + GOLDEN) / count) if reference else ({},)


def _latin(
    reference: Theta, ranges: Mapping[str, tuple[float, float]], levels: np.ndarray
) -> tuple[dict[str, float], ...]:
    if not len(levels):
        return ()
    order = np.argsort(_halton(len(reference), len(levels)), axis=0).argsort(axis=0)
    columns = {}
    for i, name in enumerate(reference):
        if name not in ranges:
            raise InfeasibleError(f"parameter {name} has no range", remedy="give it one")
        low, high = ranges[name]
        if not 0 < low <= high < np.inf:
            raise InfeasibleError(f"parameter {name} ranges from {low:g} to {high:g}", remedy="give 0 < low <= high")
        columns[name] = low * (high / low) ** levels[order[:, i]]
    return tuple({name: float(column[k]) for name, column in columns.items()} for k in range(len(levels)))


def _halton(dimensions: int, count: int) -> np.ndarray:
    """Points 1 … count of Halton's sequence (count, dimensions): the digits of k in base 2, 3, 5, …, behind the point in reverse.

    scipy.stats has it, and takes half a second to import.
    """
    points = np.zeros((count, dimensions))
    primes = (p for p in range(2, 10**6) if all(p % q for q in range(2, int(p**0.5) + 1)))
    for j, base in zip(range(dimensions), primes, strict=False):
        left, weight = np.arange(1, count + 1), 1.0
        while left.any():
            left, digit = np.divmod(left, base)
            weight /= base
            points[:, j] += weight * digit
    return points
