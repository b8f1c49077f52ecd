"""What place writes: the scenarios as solved, the selections, the certificate, the criteria."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from strainsight.augmentation.observability import Observability
from strainsight.cases.structure.channels import Channels
from strainsight.cases.structure.comparison import Comparison
from strainsight.cases.structure.expectation import Expectation
from strainsight.cases.structure.pool import PoolRows
from strainsight.cases.structure.problem import Problem
from strainsight.gauges.candidates import Candidates
from strainsight.placement.certificate import Certificate
from strainsight.placement.criteria.choices import CRITERIA, criterion_of
from strainsight.placement.elimination import Elimination
from strainsight.placement.scenario import Scenario
from strainsight.records.grids import gauge_grid
from strainsight.workflow.output import Dataset, Table


def augmented_datasets(result: Elimination, pool: PoolRows) -> dict[str, Dataset]:
    """Every scenario exactly as it was solved, so that anyone can solve it again."""
    s = [solved.scenario for solved in result.pools]
    there = pool.channels >= 0
    return {
        "/augmented/F": Dataset(np.array([x.F for x in s]), "1/s", "augmented state matrix F* (scenario × n* × n*)"),
        "/augmented/H": Dataset(
            np.array([_flat(x, x.H, there) for x in s]), "strain", "rows H* of every channel (scenario × channel × n*)"
        ),
        "/augmented/Q": Dataset(np.array([x.Q for x in s]), "1/s", "process intensity (scenario × n* × n*)"),
        "/augmented/R": Dataset(
            np.array([_flat(x, x.r, there) for x in s]), "strain^2 s", "intensity of every channel (scenario × channel)"
        ),
        "/augmented/weight": Dataset(np.array([x.weight for x in s]), "1", "diagonal of W (scenario × n*)"),
        "/augmented/scale": Dataset(
            np.array([solved.scale for solved in result.pools]),
            "x*",
            "x* = scale · the coordinates above, in which diag P = 1 with the whole pool",
        ),
    }


def _flat(scenario: Scenario, array: np.ndarray, there: np.ndarray) -> np.ndarray:
    """The channels of a pool one behind the other; there (pool, c) bool."""
    return array[there] if scenario.H.ndim == 3 else array


def metric_key(criterion: str) -> str:
    """What the metric is called in datasets and in the summary: the trace by its name, any other criterion by none."""
    return "trace" if criterion == "trace" else "metric"


def elimination_datasets(result: Elimination, problem: Problem, pool: PoolRows) -> dict[str, Dataset]:
    there, metric, unknowns = pool.channels >= 0, result.pools[0].metric, problem.unknowns
    symbol = metric.criterion.symbol
    named = dict(zip(unknowns.position(problem.model).tolist(), unknowns.names, strict=True))
    names = [named[state] for state in metric.states.tolist()]
    return {
        "/pool/candidate": Dataset(pool.first, "1", "row of train.h5 of every pool row, of its first channel"),
        "/pool/channel": Dataset(pool.channels[there], "1", "row of train.h5 of every row of /augmented/H"),
        "/pool/row": Dataset(np.nonzero(there)[0], "1", "pool row that every row of /augmented/H belongs to"),
        "/pool/gauges": Dataset(
            pool.gauges, "1", "gauges of every pool row, −1 where it has one and others two (pool × 1 or 2)"
        ),
        "/elimination/removed": Dataset(result.removed, "1", "pool rows in the order of their removal"),
        f"/elimination/{metric_key(metric.criterion.name)}": Dataset(
            result.cost, "1", f"{symbol}, the full pool first"
        ),
        "/elimination/rise": Dataset(result.rise, "1", f"rise of {symbol} at every removal, with all its digits"),
        "/elimination/unknowns": Dataset(
            np.array(names, dtype=np.str_), "1", "name of every unknown that the metric weighs, inputs first"
        ),
        "/elimination/blocks": Dataset(
            result.blocks,
            "1",
            "variance of every one of them times its weight, of which tr(W P) is the sum (step × unknown)",
            ("", "/elimination/unknowns"),
        ),
        "/elimination/solves": Dataset(result.solves, "1", "exact Riccati solves of every removal"),
        "/elimination/ties": Dataset(
            np.array([len(tied) for tied in result.ties], dtype=np.int64),
            "1",
            "other pool rows that were as good to remove, at every removal",
        ),
        "/riccati/residual": Dataset(
            np.array(result.residual), "1", "largest relative residual of the elimination's Riccati solutions"
        ),
    }


def selection_datasets(
    key: str, pool: PoolRows, gauges: np.ndarray, candidates: Candidates, channels: Channels
) -> dict[str, Dataset]:
    own = channels.of(gauges)
    first, place = own[:, 0], f"/selected/{key}"
    final = key == "final"
    row = np.array([int(np.flatnonzero((pool.gauges == g).any(axis=1))[0]) for g in gauges])
    rank = np.unique(row, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(rank[1]))[rank[2]] + 1
    return {
        f"{place}/gauge": Dataset(
            row, "1", "pool row of every gauge, " + ("the most missed first" if final else "ascending")
        ),
        f"{place}/number": Dataset(gauges, "1", "number of every gauge in train.h5"),
        f"{place}/channel": Dataset(
            own, "1", "rows of train.h5 of its channels, −1 where it has fewer (gauge × channel)"
        ),
        f"{place}/rank": Dataset(order, "1", "1 is the gauge that is missed most" if final else "order of the list"),
        f"{place}/element": Dataset(candidates.element[first], "1", "element id in the deck"),
        f"{place}/facet": Dataset(candidates.facet[first], "1", "facet number within the element, from 1"),
        f"{place}/nodes": Dataset(candidates.nodes[first], "1", "node indices of the facet, −1 where it has fewer"),
        f"{place}/position": Dataset(candidates.position[first], "m", "position (gauge × xyz)"),
        f"{place}/direction": Dataset(candidates.direction[first], "1", "direction of its first channel (gauge × xyz)"),
    }


def expectation_datasets(problem: Problem, expected: Expectation) -> dict[str, Dataset]:
    scale = dict(zip(problem.unknowns.names, problem.unknowns.scale.tolist(), strict=True))
    return {
        f"/expected_std/{name}": Dataset(
            np.array(std * scale[name]),
            "SI",
            f"σ of {name} that the filter is expected to claim, along the training run",
        )
        for name, std in expected.std.items()
    } | {
        f"/without/{name}": Dataset(values, "1", f"relative σ of {name} expected without each gauge of the final set")
        for name, values in expected.without.items()
    }


def observability_datasets(condition: Observability) -> dict[str, Dataset]:
    return {
        "/observability/condition": Dataset(
            np.array(condition.condition), "1", "condition of the scaled PBH matrix at λ = 0"
        ),
        "/observability/sigma_min": Dataset(np.array(condition.sigma_min), "1", "its smallest singular value"),
        "/observability/condition_raw": Dataset(
            np.array(condition.condition_raw), "1", "the thesis's number, which orders cases by their units"
        ),
    }


def certificate_datasets(certificate: Certificate | None, symbol: str) -> dict[str, Dataset]:
    if certificate is None:
        return {}
    return {
        "/certificate/lower_bound": Dataset(
            np.array(certificate.lower_bound), "1", f"no layout within the limits has a smaller {symbol}"
        ),
        "/certificate/gap": Dataset(np.array(certificate.gap), "1", f"({symbol} of the final set − bound) / {symbol}"),
        "/certificate/weights": Dataset(certificate.weights, "1", "gauge weights of the relaxed problem"),
    }


def comparison_datasets(others: Comparison, names: Sequence[str]) -> dict[str, Dataset]:
    rules, scores = list(others.sets), list(others.scores.values())
    criteria = [criterion_of(name) for name in scores[0].cost]
    scales = ("/criteria/rule",)
    # Under a budget the elimination may end with fewer than are in the layout.
    width = max(len(gauges) for gauges in others.sets.values())
    sets = np.array([np.pad(g, (0, width - len(g)), constant_values=-1) for g in others.sets.values()])
    cost = np.array([[s.cost[c.name] for c in criteria] for s in scores])
    return {
        f"/baseline/{rule}": Dataset(np.array(own[0]), "1", f"{criteria[0].symbol} of the set by {rule}")
        for rule, own in zip(rules, cost, strict=True)
        if rule not in ("final", "greedy")
    } | {
        "/criteria/rule": Dataset(np.array(rules, dtype=np.str_), "1", "how every set was found"),
        "/criteria/gauges": Dataset(sets, "1", "pool rows of every set, −1 for none (rule × row)"),
        "/criteria/name": Dataset(
            np.array([c.name for c in criteria], dtype=np.str_), "1", "every criterion, that of the layout first"
        ),
        "/criteria/value": Dataset(
            cost,
            "1",
            "every set by every criterion, a variance (rule × criterion): " + ", ".join(c.symbol for c in criteria),
            (*scales, "/criteria/name"),
        ),
        **{
            f"/criteria/std/{name}": Dataset(
                np.array([s.std[i] for s in scores]), "SI", f"frozen σ of {name}, which ranks and is no claim", scales
            )
            for i, name in enumerate(names)
        },
    }


RULES = {
    "final": "this layout",
    "greedy": "elimination alone",
    **{criterion.name: criterion.title for criterion in CRITERIA},
    "effective_independence": "effective independence",
    "qr_pivoting": "QR pivoting",
    "d_optimal": "D-optimal",
}
"""Rules in words; random sets are shown by their median."""


def criteria_table(others: Comparison, problem: Problem) -> Table:
    """This layout beside those by other rules, by every criterion; of the random sets, the one of median metric."""
    criteria = [criterion_of(name) for name in others.scores["final"].cost]
    chosen = criteria[0].name
    shown = {RULES[rule]: others.scores[rule] for rule in others.sets if rule in RULES}
    random = [s for rule, s in others.scores.items() if rule.startswith("random_")]
    drawn = sorted(random, key=lambda s: (np.isnan(s.cost[chosen]), s.cost[chosen]))
    if drawn:
        shown[f"random, median of {len(drawn)}"] = drawn[(len(drawn) - 1) // 2]
    best = others.scores["final"].cost[chosen]
    names, scale = problem.unknowns.names, problem.unknowns.scale

    def number(value: float) -> str:
        return f"{value:.3g}" if np.isfinite(value) else "lost" if np.isinf(value) else "–"

    rows = tuple(
        (
            rule,
            number(s.cost[chosen]),
            number(s.cost[chosen] / best),
            *(number(s.cost[c.name]) for c in criteria[1:]),
            *(f"{100 * v / a:.2g} %" if np.isfinite(v) else number(v) for v, a in zip(s.std, scale, strict=True)),
        )
        for rule, s in shown.items()
    )
    columns = (
        "layout by",
        criteria[0].symbol,
        "times this",
        *(c.symbol for c in criteria[1:]),
        *(f"frozen σ({n})" for n in names),
    )
    return Table("criteria, all from the same covariance", columns, rows)


def place_message(
    pool: int, keep: int, certificate: Certificate | None, std: Mapping[str, float], condition: Observability
) -> str:
    parts = [f"{pool} → {keep}"]
    if certificate:
        parts.append(f"gap {100 * max(certificate.gap, 0.0):.3f} %")
    parts += [f"{name} ± {100 * value:.2g} %" for name, value in std.items()]
    if condition.null_direction:
        parts.append(f"hardly observable: {condition.null_direction}")
    return ", ".join(parts)


def placed_grid(
    pool: PoolRows, final: np.ndarray, removed: np.ndarray, candidates: Candidates
) -> tuple[dict[str, Dataset], dict[str, dict[str, Any]]]:
    """The pool as points: rank in the final set (0: not in it), step at which a gauge was removed (0: never), direction."""
    which, column = np.nonzero(pool.gauges >= 0)
    first = candidates.first[pool.gauges[which, column]]
    rank, step = np.zeros(len(pool.gauges), dtype=np.int64), np.zeros(len(pool.gauges), dtype=np.int64)
    rank[final] = np.arange(1, len(final) + 1)
    step[removed] = np.arange(1, len(removed) + 1)
    return gauge_grid(
        candidates.position[first],
        {"rank": rank[which], "removed": step[which], "direction": candidates.direction[first]},
    )
