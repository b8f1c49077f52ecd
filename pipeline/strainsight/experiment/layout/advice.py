"""Expected σ of a layout, its variance budget, and advice."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from strainsight.errors import at_least
from strainsight.experiment.layout.gauge_list import GaugeList
from strainsight.experiment.layout.layout import OptimisedLayout
from strainsight.experiment.layout.task import Task
from strainsight.ordering import index_of_largest
from strainsight.placement.certificate import Certificate
from strainsight.placement.criteria import Criterion
from strainsight.placement.elimination import Elimination
from strainsight.placement.score import WORTH, gains, worth_keeping
from strainsight.records.placed import Budget
from strainsight.runner.output import Table, warnings_table
from strainsight.text import listed as listed_words

MATTERS = 1.05
"""Factor by which another layout has to be better than the first, and by which no σ may be worse."""


@dataclass(frozen=True)
class Expectation:
    """Expected σ of every unknown.

    std: name → σ; without: name → (k,) σ without each gauge in turn; relative to `reference` [SI]: RMS of a load in the training
    simulation, guess of a parameter. For a bench σ is in SI, and `reference` is empty. inf if unobservable, NaN if not solved.
    budget: name → source → share of the variance, empty for a bench."""

    std: dict[str, float]
    without: dict[str, np.ndarray]
    reference: Mapping[str, float] = field(default_factory=dict)
    budget: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    @property
    def absolute(self) -> dict[str, float]:
        """σ of every unknown [SI]."""
        return {name: std * self.reference.get(name, 1.0) for name, std in self.std.items()}

    def importance(self, over: Collection[str]) -> np.ndarray:
        """Relative increase of σ without each gauge, summed over these unknowns (k,); infinite if not solved."""
        grown = np.asarray(sum(self.without[name] / self.std[name] for name in over))
        return np.where(np.isnan(grown), np.inf, grown)


def sigma_text(std: float, reference: float | None, unit: str) -> str:
    """`0.91 % (1.72e+09 Pa)`, of a factor `0.91 %`; reference: of a relative σ [unit], None for σ in its unit."""
    if reference is None:
        return f"{std:.3g} {unit}"
    return f"{100 * std:.2g} %" + f" ({std * reference:.3g} {unit})" * (unit != "1")


def least_expected(layouts: Sequence[Expectation], over: Collection[str]) -> int:
    """Index of the layout with the smallest geometric mean of σ over these unknowns. In turn, a layout replaces the selected one
    only if better by the factor MATTERS, and worse by it in no unknown."""
    selected = 0
    for i, layout in enumerate(layouts):
        ratio = np.array([layout.std[name] / layouts[selected].std[name] for name in over])
        if np.exp(np.mean(np.log(ratio))) * MATTERS <= 1 and ratio.max() <= MATTERS:
            selected = i
    return selected


REMEDY = {
    "noise": "reduce the noise of the channels, or add channels",
    "process noise": "reduce the process noise, if it exceeds the real changes of loads and parameters and the model errors",
    "start": "use a longer record or simulation, because the initial σ still has an effect",
    "position": "position the gauges more accurately, or move the gauges to locations with smaller strain gradients",
    "angle": "align the gauges more accurately",
    "gain": "calibrate the channels more accurately",
    "common gain": "calibrate the amplifier with a shunt, or use gauges of several batches",
    "transverse sensitivity": "use gauges of known transverse sensitivity",
    "mesh": "refine the mesh around the gauges, or use quadratic elements",
    "offset": "zero the channels more accurately",
    "drift": "use channels with less drift, or a shorter record",
    "temperature": "keep the temperature constant, or add compensation gauges on an unloaded part",
    "load direction": "align the loads more accurately, or estimate their transverse components",
    "load point": "apply the loads more accurately at their intended points",
    "load gain": "calibrate the load cells more accurately",
    "load between samples": "record known loads at a higher rate",
    "damping": "measure the damping of each mode",
    "mass": "weigh load cells and fixtures, and enter them in mesh.point_masses",
    "frequency": "measure the natural frequencies and update the model, or use quasi-static loads",
    "stiffness": "determine the stiffness more accurately, or estimate a modulus",
}
"""Source of variance → remedy."""


def sigma_table(expected: Expectation, units: Mapping[str, str]) -> Table:
    """Table of the expected σ of every unknown, with its reference and its largest source of variance; units: of the
    unknowns."""
    rows = []
    for name, std in expected.std.items():
        reference, shares = expected.reference.get(name), expected.budget.get(name, {})
        size = [] if reference is None else [f"{reference:.4g} {units[name]}"]
        source = [f"{largest_source(shares)} ({100 * max(shares.values()):.0f} % of the variance)"] if shares else []
        rows.append((name, *size, sigma_text(std, reference, units[name]), *source))
    columns = ["unknown", *["guess, or RMS of the load"] * bool(expected.reference), "expected σ"]
    columns += ["largest source of σ"] * bool(expected.budget)
    return Table("accuracy: expected σ of the layout", tuple(columns), tuple(rows), answer=True)


def largest_source(shares: Mapping[str, float]) -> str:
    """Largest source of a variance budget."""
    return list(shares)[index_of_largest(np.array(list(shares.values())))]


def budget_table(budget: Mapping[str, Mapping[str, float]], of: str = "budget") -> Table:
    """Table of the variance by source, in %."""
    sources = list(dict.fromkeys(source for shares in budget.values() for source in shares))
    rows = tuple((name, *(f"{100 * shares[source]:.1f} %" for source in sources)) for name, shares in budget.items())
    return Table(of, ("variance of", *sources), rows)


def budget_tables(budget: Budget | None, without: Sequence[str] = (), answer: bool = False) -> tuple[Table, ...]:
    """Variance budget of a filter run, remedies, and the reasons for missing budgets; empty without any. answer: whether the
    remedies are an answer of the run."""
    sentences = (*helps({} if budget is None else budget.shares), *without)
    table = () if budget is None else (budget_table(budget.shares, "variance budget of the filtered estimates"),)
    return (*table, *warnings_table(sentences, "how to reduce σ", answer))


def helps(budget: Mapping[str, Mapping[str, float]]) -> Iterator[str]:
    """Sentences on the largest source of variance of the unknowns, and its remedy."""
    led: dict[str, list[str]] = {}
    for name, shares in budget.items():
        led.setdefault(largest_source(shares), []).append(name)
    for source, names in led.items():
        much = listed_words([f"{100 * budget[name][source]:.0f} % of the variance of {name}" for name in names])
        yield f"Largest source of σ({listed_words(names)}): {source} ({much}). To reduce σ, {REMEDY[source]}."


NEARLY = 0.8
"""Share of the measuring range in training from which a gauge is reported."""


def advice(
    task: Task,
    elimination: Elimination,
    layout: OptimisedLayout,
    listed: GaugeList,
    expected: Expectation,
    loss: np.ndarray,
    groups: Sequence[tuple[int, ...]],
) -> tuple[str, ...]:
    """Sentences on a layout, the most useful first; expected, loss (k,): in the order of listed; groups: redundant gauges."""
    labels, plain = listed.labels, task.limits.plain
    # with limits, the costs of smaller and larger sets are not available
    cost = elimination.cost if plain else elimination.cost[-1:]
    price, alone, ties = task.cost_of(layout.gauges), task.pool.alone, sum(1 for tied in elimination.ties if tied)
    return (
        *helps(expected.budget),
        *_how_many(task.sigma, cost, len(layout.gauges), labels, task.settings.keep),
        *(_weakest(expected.std) if task.relative else ()),
        *best_possible(layout.certificate, task.criterion, task.over, task.sigma),
        *_uneliminated(task, layout),
        *_redundant(labels, groups, expected),
        *_failures(labels, loss, expected.std, expected.without),
        *(f"{labels[int(i)]} is already bonded." for i in np.flatnonzero(listed.bonded)),
        *_loads(labels, listed.most / listed.range),
        *([f"The layout costs {price[0]:g}; the budget is {price[1]:g}."] if price else []),
        *([f"Gauges that were omitted because their mirror image is not available: {alone}."] if alone else []),
        *(
            [
                f"Equivalent layouts exist: in {ties} of {len(elimination.ties)} removals, another gauge was equally good."
            ]
            if ties
            else []
        ),
    )


def _how_many(sigma: str, cost: np.ndarray, size: int, labels: Sequence[str], keep: int) -> Iterator[str]:
    if len(labels) < keep:
        yield f"The layout has {len(labels)} instead of {keep} gauges, because the limits allow no further useful gauge."
    gain = gains(cost)
    if not len(gain):
        return
    worth = worth_keeping(cost, size)
    if worth == size:
        yield f"Number of gauges: one more gauge would reduce {sigma} by only {100 * gain[0]:.2g} %."
    else:
        more, total = worth - size, 1 - np.prod(1 - gain[: worth - size])
        together = f" {more} more would reduce it by {100 * total:.2g} % in total," * (more > 1)
        yield (
            f"Number of gauges: one more gauge would reduce {sigma} by {100 * gain[0]:.2g} %,{together} and each "
            f"further gauge by less than {100 * WORTH:g} %."
        )


def moved_in_words(exact: Expectation, chosen: Expectation, over: Collection[str]) -> str:
    """Gain of the layout chosen with installation errors over the layout chosen without."""
    name = max(over, key=lambda key: exact.std[key] / chosen.std[key])
    return (
        "Installation errors were included as noise, which favours locations away from steep strain gradients. In a layout "
        f"optimised without these errors, the expected σ of {name} would be {exact.std[name] / chosen.std[name]:.3g} "
        "times as large."
    )


def _weakest(std: Mapping[str, float]) -> Iterator[str]:
    if len(std) > 1:
        name = max(std, key=lambda key: std[key])
        yield f"{name} has the largest relative uncertainty, ± {100 * std[name]:.2g} %."


def best_possible(
    certificate: Certificate | None, criterion: Criterion, over: Sequence[str], sigma: str
) -> Iterator[str]:
    """Bound on every other layout of the size: its metric is at least (1 − gap) of ours, the root (sigma) √(1 − gap).

    With several unknowns it does not bound a single σ. Percentages are rounded up, as they are upper bounds."""
    if certificate is None:
        return
    gap = max(certificate.gap, 0.0)
    root = float(1 - np.sqrt(1 - gap))
    variance, deviation = (
        at_least(100 * gap) if gap > 0.001 else "0.1",
        at_least(100 * root) if root > 0.0005 else "0.05",
    )
    if len(over) == 1:
        yield f"Optimality: no allowed layout can reduce {sigma} by more than {deviation} %."
    else:
        yield (
            f"Optimality: no allowed layout can reduce the criterion {criterion.symbol} by more than {variance} %, or its root, "
            f"{sigma}, by more than {deviation} %. A single σ may be reduced by more."
        )


def _uneliminated(task: Task, layout: OptimisedLayout) -> Iterator[str]:
    """Sentence on the bound over candidates that did not enter the elimination."""
    if task.whole is None or layout.better is None:
        return
    every, entered = len(task.whole.limits.size), len(task.whole.rows)
    yield (
        f"The optimality bound covers all {every} candidates. The elimination used {entered} of them; {layout.better or 'none'} "
        "of the remaining candidates could improve the layout."
    )


def _redundant(labels: Sequence[str], groups: Sequence[tuple[int, ...]], expected: Expectation) -> Iterator[str]:
    """Gauges with nearly proportional readings, of which any one may fail: every σ then grows by less than WORTH."""
    growth = np.max([expected.without[name] / std - 1 for name, std in expected.std.items()], axis=0)
    for group in groups:
        spare = [i for i in group if growth[i] < WORTH]
        if len(spare) > 1:
            yield (
                f"{', '.join(labels[i] for i in spare)} are redundant: their readings in the training simulation "
                "(stage `train`) are nearly proportional, and without any one of them every σ grows by less than "
                f"{100 * WORTH:g} %."
            )


def _failures(
    labels: Sequence[str], loss: np.ndarray, std: Mapping[str, float], without: Mapping[str, np.ndarray]
) -> Iterator[str]:
    lost = [label for label, value in zip(labels, loss, strict=True) if np.isinf(value)]
    unsolved = [label for label, value in zip(labels, loss, strict=True) if np.isnan(value)]
    if unsolved:
        yield f"The effect of a failure of {' or '.join(unsolved)} could not be computed accurately."
    if len(lost) == len(labels):
        yield "If any gauge fails, an unknown is no longer observable."
    elif lost:
        yield f"If {' or '.join(lost)} fails, an unknown is no longer observable."
    elif not unsolved:
        known = {name: values for name, values in without.items() if np.isfinite(values).all()}
        growths = (
            (float(np.max(values)) / std[name], name, index_of_largest(values)) for name, values in known.items()
        )
        for growth, name, worst in [max(growths, key=lambda growth_and_name: growth_and_name[0])] if known else ():
            if growth > 1:
                yield f"If one gauge fails, σ({name}) grows by at most {_percent(growth - 1)} ({labels[worst]})."
            else:
                yield "If one gauge fails, no σ grows, because the installation error of this gauge is removed, too."


def _percent(share: float) -> str:
    """Per cent with two digits and without exponent."""
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.2g} %"


def _loads(labels: Sequence[str], load: np.ndarray) -> Iterator[str]:
    for label, share in zip(labels, load, strict=True):
        if share > 1:
            yield (
                f"{label} exceeds its measuring range: the reading in the training simulation (stage `train`) is "
                f"{share:.2g} times the limit."
            )
        elif share > NEARLY:
            yield f"{label} uses {100 * share:.0f} % of its measuring range in the training simulation (stage `train`)."
