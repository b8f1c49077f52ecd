"""Whole histories of the motion, drawn from what the measurements of a test leave open."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from strainsight.cases.structure.filtered_test import Filtered, Filtering
from strainsight.estimation.bank import BankRun
from strainsight.estimation.bank_paths import AT_ONCE, Paths, bank_paths
from strainsight.estimation.biased import driven_with_offsets
from strainsight.estimation.error_paths import smoother_errors


def histories(given: Filtering, found: Filtered, count: int, seed: int) -> Iterator[Paths]:
    """`count` draws of q (N, T + 1, n) with the parameters of each, in parts; by the bank where there is one, with z behind it.

    A parameter that a filter lets drift is its mean over the record.
    """
    if found.bank is not None:
        yield from histories_of_bank(given, found.bank, count, seed)
        return
    model, known, at = given.model, given.test.known, given.biased
    q = slice(0, model.model.size)
    core, rng = driven_with_offsets(model, known, at), np.random.default_rng(seed)
    part = max(1, AT_ONCE // ((len(known) + 1) * core.size))
    for first in range(0, count, part):
        error = smoother_errors(core, found.run, min(part, count - first), rng)
        error += found.smoothed.mean[None, :, 0]
        yield Paths(error[:, :, model.parameter_states].mean(axis=1), error[:, :, q])


def histories_of_bank(given: Filtering, bank: BankRun, count: int, seed: int) -> Iterator[Paths]:
    """By a bank, which may be that of other walks of the loads than those of the test's results."""
    test, covariance, q = given.test, given.covariance, slice(0, given.model.model.size)
    before = given.model, np.zeros(len(covariance)), covariance, test.known, test.values, given.nuisances
    return bank_paths(*before, bank, count, seed, given.biased, given.settled, q, given.record)
