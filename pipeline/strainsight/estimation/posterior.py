"""What the samples leave of one parameter: the density of its posterior, how wide that is, and how many peaks it has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from strainsight.columns import Column

VALUES = 401
"""At which a density is given."""
REACH = 5.0
"""Standard deviations about the mean, and about every point that counts, that it is given over."""
COUNTS = 1e-9
"""Least weight of such a point."""
KERNEL = 0.7
"""Of a point of the lattice, in steps of it: a normal density is right to 2 exp(−2π² KERNEL²) = 1e-4 of its height, and
narrow peaks are drawn wider than they are."""
VALLEY = 0.5
"""Two peaks are two where the density between them falls below this share of the lower one;"""
SHARE = 0.01
"""and each holds at least so much of it."""


@dataclass(frozen=True)
class Posterior:
    """What the samples leave of one parameter, <what>; its peaks from the lowest value on."""

    value: Annotated[np.ndarray, Column("<unit>", "/value", "values of <what>")]
    density: Annotated[np.ndarray, Column("1", "/value", "density of ln <what> after the samples")]
    prior: Annotated[np.ndarray, Column("1", "/value", "the same before them")]
    left: Annotated[float, Column("1", "", "σ of ln <what> after the samples over that before them")]
    peak: Annotated[np.ndarray, Column("<unit>", "/peak", "values at which the density is largest")]
    share: Annotated[np.ndarray, Column("1", "/peak", "probability of what lies about each")]


def marginal(point: np.ndarray, weight: np.ndarray, step: float, prior: tuple[float, float]) -> Posterior:
    """Of a posterior given by points (B,) with weights (B,) of sum one; step: of the lattice they belong to, along p, infinite
    where it is no lattice, which has the normal density then; prior: mean and standard deviation of a normal density.

        π(p) = Σ wᵢ N(p; p̄ + a(pᵢ − p̄), h²),     h = KERNEL · step,     a² = 1 − h²/σ²

    with kernels drawn together about the mean p̄, so that it keeps mean and variance σ² of the points. Source: Liu and West, in
    Sequential Monte Carlo Methods in Practice (2001), chapter 10.
    """
    mean = float(weight @ point)
    std = float(np.sqrt(weight @ (point - mean) ** 2))
    h = min(KERNEL * step, std)
    centre = mean + np.sqrt(1 - (h / std) ** 2) * (point - mean)
    heavy = weight > COUNTS
    ends = (
        min(mean - REACH * std, centre[heavy].min() - REACH * h),
        max(mean + REACH * std, centre[heavy].max() + REACH * h),
    )
    value = np.linspace(*ends, VALUES)
    density = normal(value[:, None], centre, h) @ weight
    peak, share = peaks_of(value, density)
    return Posterior(value, density, normal(value, *prior), std / prior[1], peak, share)


def normal(value: np.ndarray, mean: np.ndarray | float, std: float) -> np.ndarray:
    return np.asarray(np.exp(-0.5 * ((value - mean) / std) ** 2) / (np.sqrt(2 * np.pi) * std))


def peaks_of(value: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where a density (k,) at equally spaced values (k,) has its peaks, and the share of it up to the valleys beside each."""
    inner = density[1:-1]
    tops = 1 + np.flatnonzero((inner > density[:-2]) & (inner >= density[2:]))
    kept: list[int] = []
    valleys: list[int] = []
    for top in tops.tolist():
        if kept:
            low = kept[-1] + int(np.argmin(density[kept[-1] : top + 1]))
            if density[low] > VALLEY * min(density[kept[-1]], density[top]):
                kept[-1] = max(kept[-1], top, key=lambda at: float(density[at]))
                continue
            valleys.append(low)
        kept.append(top)
    mass = np.array([part.sum() for part in np.split(density, valleys)]) / density.sum()
    large = mass >= SHARE
    return value[kept][large], mass[large]
