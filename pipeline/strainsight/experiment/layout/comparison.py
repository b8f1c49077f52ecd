"""Comparison of the layout with layouts by other rules, all scored by the same covariances."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache

import numpy as np

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.experiment.layout.task import Task
from strainsight.placement.baselines import d_optimal, effective_independence, qr_pivoting, random_sets
from strainsight.placement.criteria import CRITERIA, LogDeterminant, Trace, criterion_of
from strainsight.placement.elimination import eliminate_from
from strainsight.placement.limits import limits_of
from strainsight.placement.score import Scores, scores
from strainsight.runner.output import Table

RANDOM_SETS = 10
"""Number of random layouts in the comparison."""
CRITERION_SCENARIOS = 3
"""Scenarios per load case for layouts by other criteria; all scenarios are used to score them."""
RULES = {
    "final": "this layout",
    "greedy": "elimination alone",
    **{criterion.name: criterion.title for criterion in CRITERIA},
    "effective_independence": "effective independence",
    "qr_pivoting": "QR pivoting",
    "d_optimal": "D-optimal",
}
"""Titles of the rules; random layouts are shown by their median."""


@dataclass(frozen=True)
class RuleComparison:
    """rule → chosen pool rows (empty if it fails), and scores; this layout first, and its criterion first in the scores."""

    sets: dict[str, np.ndarray]
    scores: dict[str, Scores]


def comparison(task: Task, final: np.ndarray, greedy: np.ndarray) -> RuleComparison:
    """Layouts of the size of `final` by other criteria, by rules based on readings only, and at random.

    greedy: result of the elimination. Only the random layouts satisfy the limits."""
    keep, pools, readings, unknowns = len(final), task.pools, task.readings, task.unknowns
    criterion, fixed, cases = task.settings.criterion, task.limits.fixed, task.cases
    some = _some(np.zeros(len(pools), dtype=int) if cases is None else cases.of)
    whitened = readings.rows / np.sqrt(readings.variance)[..., None]

    @cache
    def eliminated(name: str) -> np.ndarray | None:
        """Result of an elimination by this criterion, None if it fails."""
        pools = task.under([task.searched[i] for i in some], name, "mean", some)
        with suppress(InfeasibleError, NumericalError):
            return eliminate_from(pools, limits_of(len(pools[0].rows), keep, fixed=fixed)).selected
        return None

    # of a single variance all criteria agree, but for the weights of the trace
    of_variance = {} if len(task.over) > 1 else dict.fromkeys(task.metrics.keys() - {Trace.name}, LogDeterminant.name)
    sets: dict[str, np.ndarray | None] = {
        "final": final,
        "greedy": greedy,
        **{name: eliminated(of_variance.get(name, name)) for name in task.metrics if name != criterion},
        "effective_independence": effective_independence(whitened, keep),
        "qr_pivoting": qr_pivoting(whitened, keep),
        "d_optimal": d_optimal(readings.rows, readings.variance, readings.prior, keep),
    }
    random = random_sets(len(readings.rows), keep, RANDOM_SETS, task.seed, task.limits.allows)
    sets |= {f"random_{i}": gauges for i, gauges in enumerate(random, start=1)}
    by = {name: task.under(pools, name) for name in dict.fromkeys((criterion, *task.metrics))}
    scale, share = (unknowns.scale, None) if cases is None else (cases.scale[cases.of], cases.shares())
    chosen = {name: np.zeros(0, dtype=int) if gauges is None else gauges for name, gauges in sets.items()}
    every = {
        name: Scores.all(by, np.nan, len(unknowns.at))
        if gauges is None
        else scores(by, gauges, unknowns.at, scale, task.aggregate, share)
        for name, gauges in sets.items()
    }
    return RuleComparison(chosen, every)


def criteria_table(others: RuleComparison, names: Sequence[str], reference: Sequence[float] | None) -> Table:
    """Table of layouts by rule and criterion, with the random layout of median metric.

    names: of the unknowns; reference (u,): of relative σ, None for σ in its unit."""
    criteria = [criterion_of(name) for name in others.scores["final"].cost]
    chosen = criteria[0].name
    shown = {RULES[rule]: others.scores[rule] for rule in others.sets if rule in RULES}
    random = [s for rule, s in others.scores.items() if rule.startswith("random_")]
    ordered = sorted(random, key=lambda s: (np.isnan(s.cost[chosen]), s.cost[chosen]))
    if ordered:
        shown[f"median of {len(ordered)} random layouts"] = ordered[(len(ordered) - 1) // 2]
    best = others.scores["final"].cost[chosen]

    def number(value: float) -> str:
        return f"{value:.3g}" if np.isfinite(value) else "unobservable" if np.isinf(value) else "–"

    rows = tuple(
        (
            rule,
            number(s.cost[chosen]),
            number(s.cost[chosen] / best),
            *(number(s.cost[c.name]) for c in criteria[1:]),
            *(
                number(v) if reference is None or not np.isfinite(v) else f"{100 * v / reference[i]:.2g} %"
                for i, v in enumerate(s.std)
            ),
        )
        for rule, s in shown.items()
    )
    columns = (
        "rule",
        criteria[0].symbol,
        f"{criteria[0].symbol} relative to the selected layout",
        *(c.symbol for c in criteria[1:]),
        *(f"steady-state σ({n})" for n in names),
    )
    return Table(
        "criteria of the steady-state covariance: use them to rank layouts, not as the expected σ", columns, rows
    )


def _some(of: np.ndarray) -> list[int]:
    """Indices of `CRITERION_SCENARIOS` evenly spread scenarios per load case; of (scenarios,): case of each scenario."""
    numbers: list[int] = []
    for case in np.unique(of):
        scenarios = np.flatnonzero(of == case)
        numbers += scenarios[np.unique(np.linspace(0, len(scenarios) - 1, CRITERION_SCENARIOS).astype(int))].tolist()
    return numbers
