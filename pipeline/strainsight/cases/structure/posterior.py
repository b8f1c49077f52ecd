"""What the samples leave of every parameter: records, numbers and sentences."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.cases.structure.problem import Problem
from strainsight.estimation.bank import BankRun
from strainsight.estimation.posterior import marginal
from strainsight.records.estimated import Posterior

IDENTIFIED = 0.5
"""Share of its initial σ that the samples may leave of a parameter that they identify."""


def posteriors_of(problem: Problem, covariance: np.ndarray, bank: BankRun | None) -> dict[str, Posterior]:
    """Of every parameter of a bank; covariance (n*, n*) at t = 0. None by another filter, nor by columns, of which no more than
    mean and covariance is known."""
    if bank is None or bank.step is None:
        return {}
    names, guess = problem.unknowns.parameters, problem.unknowns.guess
    first = problem.unknowns.size(problem.model) - len(names)
    found = {}
    for i, name in enumerate(names):
        prior = 0.0, float(np.sqrt(covariance[first + i, first + i]))
        own = marginal(bank.point[:, i], bank.weight, float(bank.step[i]), prior)
        value, peak = guess[name] * np.exp(own.value), guess[name] * np.exp(own.peak)
        found[name] = Posterior(
            value=value, density=own.density, prior=own.prior, left=own.left, peak=peak, share=own.share
        )
    return found


def posterior_numbers(posterior: Mapping[str, Posterior]) -> dict[str, float | bool | int]:
    """Every number by its name."""
    numbers: dict[str, float | bool | int] = {}
    for name, own in posterior.items():
        numbers |= {f"left.{name}": own.left, f"identified.{name}": own.left <= IDENTIFIED}
        numbers[f"peaks.{name}"] = len(own.peak)
    return numbers


def posterior_doubts(posterior: Mapping[str, Posterior], units: Mapping[str, str]) -> list[str]:
    """What a reader has to know of it: that a parameter is hardly seen, or that several values explain the samples."""
    words = []
    for name, own in posterior.items():
        if own.left > IDENTIFIED:
            words.append(f"{name} is not identified: the measurements leave {100 * own.left:.0f} % of its initial σ")
        if len(own.peak) > 1:
            places = ", ".join(
                f"{peak:.4g} {units[name]} ({100 * share:.0f} %)"
                for peak, share in zip(own.peak, own.share, strict=True)
            )
            words.append(f"the measurements allow {len(own.peak)} values of {name}: {places}; its σ spans them all")
    return words
