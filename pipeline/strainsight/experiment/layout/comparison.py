"""The layout beside those by other rules, all scored by the same covariances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.errors import InfeasibleError, NumericalError
from strainsight.experiment.layout.task import Task
from strainsight.placement.baselines import d_optimal, effective_independence, qr_pivoting, random_sets
from strainsight.placement.criteria import CRITERIA, criterion_of
from strainsight.placement.elimination import eliminate_from
from strainsight.placement.limits import limits_of
from strainsight.placement.scenario import Pool
from strainsight.placement.score import Scores, scores
from strainsight.runner.output import Table

RANDOM_SETS = 10
"""Random sets of the pool, scored beside the other rules."""
CRITERION_SCENARIOS = 3
"""Scenarios of a load case that layouts by other criteria are made with; all of them score every layout."""
RULES = {
    "final": "this layout",
    "greedy": "elimination alone",
    **{criterion.name: criterion.title for criterion in CRITERIA},
    "effective_independence": "effective independence",
    "qr_pivoting": "QR pivoting",
    "d_optimal": "D-optimal",
}
"""Rules in words; random sets are shown by their median."""


@dataclass(frozen=True)
class RuleComparison:
    """rule → the set of pool rows that it chooses, none where it finds none, and its scores; ours first, and in the scores the
    criterion that it was chosen by."""

    sets: dict[str, np.ndarray]
    scores: dict[str, Scores]


def comparison(task: Task, final: np.ndarray, greedy: np.ndarray) -> RuleComparison:
    """Sets of as many pool rows as the layout `final`: by other criteria, by rules that look at readings only, at random.

    greedy: what the elimination keeps. Only the random sets are held to the limits of the layout.
    """
    keep, pools, readings, unknowns = len(final), task.pools, task.readings, task.unknowns
    criterion, fixed, cases = task.settings.criterion, task.limits.fixed, task.cases
    some = _some(np.zeros(len(pools), dtype=int) if cases is None else cases.of)
    whitened = readings.rows / np.sqrt(readings.variance)[..., None]
    sets: dict[str, np.ndarray | None] = {
        "final": final,
        "greedy": greedy,
        **{
            name: _kept(task.under([task.searched[i] for i in some], name, "mean", some), keep, fixed)
            for name in task.metrics
            if name != criterion
        },
        "effective_independence": effective_independence(whitened, keep),
        "qr_pivoting": qr_pivoting(whitened, keep),
        "d_optimal": d_optimal(readings.rows, readings.variance, readings.prior, keep),
    }
    drawn = random_sets(len(readings.rows), keep, RANDOM_SETS, task.seed, task.limits.allows)
    sets |= {f"random_{i}": gauges for i, gauges in enumerate(drawn, start=1)}
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


def criteria_table(others: RuleComparison, names: Sequence[str], scale: np.ndarray | None) -> Table:
    """This layout beside those by other rules, by every criterion; of the random sets, the one of median metric.

    names of the unknowns; scale (u,) that their σ is shown relative to, None: in its unit.
    """
    criteria = [criterion_of(name) for name in others.scores["final"].cost]
    chosen = criteria[0].name
    shown = {RULES[rule]: others.scores[rule] for rule in others.sets if rule in RULES}
    random = [s for rule, s in others.scores.items() if rule.startswith("random_")]
    drawn = sorted(random, key=lambda s: (np.isnan(s.cost[chosen]), s.cost[chosen]))
    if drawn:
        shown[f"random, median of {len(drawn)}"] = drawn[(len(drawn) - 1) // 2]
    best = others.scores["final"].cost[chosen]

    def number(value: float) -> str:
        return f"{value:.3g}" if np.isfinite(value) else "lost" if np.isinf(value) else "–"

    rows = tuple(
        (
            rule,
            number(s.cost[chosen]),
            number(s.cost[chosen] / best),
            *(number(s.cost[c.name]) for c in criteria[1:]),
            *(
                number(v) if scale is None or not np.isfinite(v) else f"{100 * v / scale[i]:.2g} %"
                for i, v in enumerate(s.std)
            ),
        )
        for rule, s in shown.items()
    )
    columns = (
        "layout by",
        criteria[0].symbol,
        "times this",
        *(c.symbol for c in criteria[1:]),
        *(f"steady-state σ({n})" for n in names),
    )
    return Table("criteria, of the covariance that ranks layouts: its σ is no claim", columns, rows)


def _some(of: np.ndarray) -> list[int]:
    """`CRITERION_SCENARIOS` of the scenarios of every load case, spread evenly; of (scenarios,): the case of each."""
    numbers: list[int] = []
    for case in np.unique(of):
        scenarios = np.flatnonzero(of == case)
        numbers += scenarios[np.unique(np.linspace(0, len(scenarios) - 1, CRITERION_SCENARIOS).astype(int))].tolist()
    return numbers


def _kept(pools: Sequence[Pool], keep: int, fixed: frozenset[int]) -> np.ndarray | None:
    """What an elimination by the metric of these pools keeps; None where it cannot go so far."""
    try:
        return eliminate_from(pools, limits_of(len(pools[0].rows), keep, fixed=fixed)).selected
    except (InfeasibleError, NumericalError):
        return None
