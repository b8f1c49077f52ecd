"""What a layout is expected to know in every load case, and which of them is the worst for an unknown."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from strainsight.experiment.layout.expectation import Expectation
from strainsight.experiment.layout.placement import Placed
from strainsight.ordering import first_of_largest
from strainsight.placement.score import score
from strainsight.records.placed import ByCase
from strainsight.runner.output import Table


def worst_case(found: Sequence[Expectation], acts: Sequence[np.ndarray]) -> Expectation:
    """Of every unknown what is expected in the load case where σ, relative to its amplitude there, is largest; without a gauge
    the largest of any case. Only cases count in which the unknown acts; acts (u,) bool of each."""
    if len(found) == 1:
        return found[0]
    std, without, budget = {}, {}, {}
    for i, name in enumerate(found[0].std):
        there = [own for own, act in zip(found, acts, strict=True) if act[i]]
        worst = there[first_of_largest(np.array([own.std[name] for own in there]))]
        std[name] = worst.std[name]
        without[name] = np.max([own.without[name] for own in there], axis=0)
        budget[name] = worst.budget[name]
    return Expectation(std, without, budget)


def cases_of(found: Placed, expected: Sequence[Expectation]) -> ByCase:
    """The load cases of a layout: weight, metric, expected σ; expected: one a case, of the layout."""
    task, cases = found.task, found.task.cases
    assert cases is not None
    names, every = task.unknowns.names, range(len(cases.names))
    metric = task.metrics[task.criterion.name]
    cost = [
        score(
            [task.pools[i].under(metric[case]) for i in np.flatnonzero(cases.of == case)], found.final, task.aggregate
        )
        for case in every
    ]
    std = np.array([[own.std[name] for name in names] for own in expected])
    return ByCase(
        name=cases.names,
        weight=cases.weight,
        scenario=cases.of,
        metric=np.array(cost),
        std={name: std[:, i] for i, name in enumerate(names)},
        acts={name: cases.acts[:, i] for i, name in enumerate(names)},
        scale={name: cases.scale[:, i] for i, name in enumerate(names)},
        worst={
            name: cases.names[first_of_largest(np.where(cases.acts[:, i], std[:, i], -np.inf))]
            for i, name in enumerate(names)
        },
    )


def case_table(own: ByCase, symbol: str) -> Table:
    """Every load case with its weight, what the criterion is in it and what is expected of every unknown."""
    rows = tuple(
        (
            name,
            f"{own.weight[i]:g}",
            f"{own.metric[i]:.4g}",
            *(f"{100 * std[i]:.3g} %" if own.acts[unknown][i] else "silent" for unknown, std in own.std.items()),
        )
        for i, name in enumerate(own.name)
    )
    columns = ("load case", "weight", symbol, *(f"expected σ({name})" for name in own.std))
    return Table("load cases: σ relative to the amplitude in each", columns, rows)


def cases_in_words(own: ByCase, aggregate: str) -> Iterator[str]:
    """In which load case every unknown is known least, and which one a worst-case layout is ruled by."""
    if len(own.name) == 1:
        return
    least: dict[str, list[str]] = {}
    for unknown, case in own.worst.items():
        least.setdefault(case, []).append(unknown)
    for case, unknowns in least.items():
        yield f"Of the load cases {case} is where {' and '.join(unknowns)} {'is' if len(unknowns) == 1 else 'are'} known least."
    if aggregate == "worst":
        yield f"The layout is ruled by the load case {own.name[first_of_largest(own.weight * own.metric)]}."
