"""Layouts of gauges on a bench: the placed one beside those drawn at random, and how sensors take them over."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from strainsight.cases.bench.layout.linear import expected_std, scenario_of
from strainsight.errors import InfeasibleError, NumericalError
from strainsight.multibody.inverse.linear import LinearBench
from strainsight.placement.scenario import solve_pool
from strainsight.workflow.output import Table


@dataclass(frozen=True)
class Layout:
    """gauges (k,): numbers of its candidates; trace: tr(W P); std (nu,) [N, N m]: σ that a filter on it comes to claim; without
    (k, nu): the same without each gauge. inf where an input is lost, NaN where the equation is not solved to accuracy."""

    gauges: np.ndarray
    trace: float
    std: np.ndarray
    without: np.ndarray


def layout_of(
    bench: LinearBench, weight: np.ndarray, gauges: np.ndarray, rows: np.ndarray, noise: float, acceleration: float
) -> Layout:
    """The layout of these gauges with what it is worth; weight (n*,) of the trace, rows (k, n) strain per coordinate."""
    own = scenario_of(bench, rows, noise, acceleration)
    try:
        solved = solve_pool(replace(own, weight=weight))
        trace = solved.metric.value(solved.P)
    except InfeasibleError:
        trace = float("inf")
    except NumericalError:
        trace = float("nan")
    without = [_claimed(bench, np.delete(rows, i, axis=0), noise, acceleration) for i in range(len(rows))]
    return Layout(gauges, trace, _claimed(bench, rows, noise, acceleration), np.array(without))


def _claimed(bench: LinearBench, rows: np.ndarray, noise: float, acceleration: float) -> np.ndarray:
    """`expected_std` (nu,), NaN where it is not solved."""
    try:
        return expected_std(bench, rows, noise, acceleration)
    except NumericalError:
        return np.full(len(bench.increment), np.nan)


def layout_table(layouts: Mapping[str, Layout], inputs: tuple[str, ...]) -> Table:
    rows = tuple(
        (name, f"{layout.trace:.4g}", *(f"{value:.4g}" for value in layout.std)) for name, layout in layouts.items()
    )
    return Table("layouts", ("layout", "tr(W P)", *(f"σ({name})" for name in inputs)), rows)
