"""What a filter on a layout is expected to claim, what its variance is made of, and what an engineer can do."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from strainsight.errors import at_least
from strainsight.experiment.layout.gauge_list import GaugeList
from strainsight.experiment.layout.layout import OptimisedLayout
from strainsight.experiment.layout.task import Task
from strainsight.ordering import first_of_largest, tied_order
from strainsight.placement.certificate import Certificate
from strainsight.placement.criteria import Criterion
from strainsight.placement.elimination import Elimination
from strainsight.placement.score import WORTH, gains, worth_keeping
from strainsight.records.placed import Budget
from strainsight.runner.output import Table, warnings_table
from strainsight.text import listed as listed_words

MATTERS = 1.05
"""Factor that another layout than the first has to be better by, and that σ of no unknown may be worse by."""


@dataclass(frozen=True)
class Expectation:
    """σ of every unknown: std, name → σ; without, name → (k,) σ without each gauge in turn. On a structure relative to the
    scale of the unknown, on a bench in N or N m; inf where it is lost, NaN where it is not solved. budget, name → source → share
    of the variance with all gauges, the shares of a name in sum 1; empty on a bench."""

    std: dict[str, float]
    without: dict[str, np.ndarray]
    budget: Mapping[str, Mapping[str, float]] = field(default_factory=dict)

    def importance(self, over: Collection[str]) -> np.ndarray:
        """How much σ grows without each gauge, summed over these unknowns (k,); infinite where that is not solved."""
        grown = np.asarray(sum(self.without[name] / self.std[name] for name in over))
        return np.where(np.isnan(grown), np.inf, grown)


def least_expected(layouts: Sequence[Expectation], over: Collection[str]) -> int:
    """Which of several layouts has the least geometric mean of σ over these unknowns; the first one unless another is better
    by the factor MATTERS, and worse by it in no unknown."""
    ratio = np.array([[layout.std[name] / layouts[0].std[name] for name in over] for layout in layouts])
    mean = np.exp(np.mean(np.log(ratio), axis=1))
    allowed = (mean * MATTERS <= 1) & (ratio.max(axis=1) <= MATTERS)
    allowed[0] = True
    return int(tied_order(np.where(allowed, mean, np.inf))[0])


REMEDY = {
    "noise": "quieter channels, or more of them",
    "process noise": "a smaller process noise, if loads, parameters and the model change or err less than it allows",
    "start": "a longer run",
    "position": "gauges placed more exactly, or where the strain changes less from place to place",
    "angle": "gauges aligned more exactly",
    "gain": "channels calibrated more exactly",
    "transverse sensitivity": "gauges of known transverse sensitivity",
    "offset": "channels zeroed more exactly",
    "drift": "channels that hold their zero, or a shorter record",
    "temperature": "a steady temperature, or gauges beside on a part without load",
    "load direction": "loads aligned more exactly, or their components across among the unknowns",
    "load point": "loads put on more exactly",
    "load gain": "load cells calibrated more exactly",
    "load between samples": "known loads recorded at a higher rate",
    "damping": "damping measured mode by mode",
    "frequency": "natural frequencies measured, and the model corrected by them, or slow loads, which do not depend on them",
    "stiffness": "a stiffness known more exactly, or a modulus among the unknowns",
}
"""Source of variance → what makes it smaller."""


def budget_table(budget: Mapping[str, Mapping[str, float]], of: str = "budget") -> Table:
    """Unknowns by source, in % of the variance."""
    sources = list(dict.fromkeys(source for shares in budget.values() for source in shares))
    rows = tuple((name, *(f"{100 * shares[source]:.1f} %" for source in sources)) for name, shares in budget.items())
    return Table(of, ("variance of", *sources), rows)


def budget_tables(budget: Budget | None, without: Sequence[str] = ()) -> tuple[Table, ...]:
    """Of a filter that has run, with what would help most, and why an unknown has none; none of nothing."""
    sentences = (*helps({} if budget is None else budget.shares), *without)
    table = () if budget is None else (budget_table(budget.shares, "budget of the filtered estimates"),)
    return (*table, *warnings_table(sentences, "what would help"))


def helps(budget: Mapping[str, Mapping[str, float]]) -> Iterator[str]:
    """What would lower σ of every unknown most, those with the same source in one sentence."""
    led: dict[str, list[str]] = {}
    for name, shares in budget.items():
        largest = list(shares)[first_of_largest(np.array(list(shares.values())))]
        led.setdefault(largest, []).append(name)
    for source, names in led.items():
        much = listed_words([f"{100 * budget[name][source]:.0f} % of the variance of {name}" for name in names])
        yield f"What would help {listed_words(names)} most: {REMEDY[source]} ({source}: {much})."


NEARLY = 0.8
"""A gauge that sees this share of its range in training is worth a word."""


def advice(
    task: Task,
    elimination: Elimination,
    layout: OptimisedLayout,
    listed: GaugeList,
    expected: Expectation,
    loss: np.ndarray,
    groups: Sequence[tuple[int, ...]],
) -> tuple[str, ...]:
    """Sentences on a layout, the most useful first; expected and loss (k,) in the order of listed, groups of it are redundant."""
    labels, plain = listed.labels, task.limits.plain
    # Where limits rule the size, no smaller or larger set is beside the layout.
    cost = elimination.cost if plain else elimination.cost[-1:]
    price, alone, ties = task.cost_of(layout.gauges), task.pool.alone, sum(1 for tied in elimination.ties if tied)
    return (
        *_how_many(task.sigma, cost, len(layout.gauges), labels, task.settings.keep),
        *(_weakest(expected.std) if task.relative else ()),
        *helps(expected.budget),
        *best_possible(layout.certificate, task.criterion, task.over, task.sigma),
        *_beyond(task, layout),
        *(
            f"{', '.join(labels[i] for i in group)} are redundant in the training run: they average noise, and can replace "
            "each other."
            for group in groups
        ),
        *_failures(labels, loss, expected.std, expected.without),
        *(f"{labels[int(i)]} was there already." for i in np.flatnonzero(listed.bonded)),
        *_loads(labels, listed.most / listed.range),
        *([f"The layout costs {price[0]:g} of {price[1]:g}."] if price else []),
        *([f"{alone} gauges have no mirror image that is free, and were left out."] if alone else []),
        *(
            [f"{ties} removals were between gauges that are equally good: other layouts are as good as this one."]
            if ties
            else []
        ),
    )


def _how_many(sigma: str, cost: np.ndarray, kept: int, labels: Sequence[str], keep: int) -> Iterator[str]:
    if len(labels) < keep:
        yield f"{len(labels)} gauges, not {keep}: within the limits of the layout no further one was found that fits and helps."
    gain = gains(cost)
    if not len(gain):
        return
    worth = worth_keeping(cost, kept)
    if worth == kept:
        yield (
            f"{len(labels)} gauges are enough: one more would lower {sigma} by {100 * gain[0]:.2g} %, and no further one by "
            f"{100 * WORTH:g} %."
        )
    else:
        total = 1 - np.prod(1 - gain[: worth - kept])
        yield (
            f"One more gauge would lower {sigma} by {100 * gain[0]:.2g} %, {worth - kept} more by {100 * total:.2g} %; beyond "
            f"that none lowers it by {100 * WORTH:g} %."
        )


def moved_in_words(exact: Expectation, chosen: Expectation, over: Collection[str]) -> str:
    """What a layout that is chosen with installation errors gains over the one that is chosen without."""
    name = max(over, key=lambda key: exact.std[key] / chosen.std[key])
    return (
        "Placed with errors of installation as noise: off the steep gradients σ of "
        f"{name} is expected to be {exact.std[name] / chosen.std[name]:.3g} times lower than on the layout for exact gauges."
    )


def _weakest(std: Mapping[str, float]) -> Iterator[str]:
    if len(std) > 1:
        name = max(std, key=lambda key: std[key])
        yield f"{name} is what this layout knows least: ± {100 * std[name]:.2g} % of its guess or amplitude."


def best_possible(
    certificate: Certificate | None, criterion: Criterion, over: Sequence[str], sigma: str
) -> Iterator[str]:
    """What the lower bound says of every other layout of the size: the metric is at least (1 − gap) of ours, its root, which is
    named sigma, √(1 − gap).

    Of several unknowns it bounds no single σ. Shares are rounded up: what nothing exceeds must not be said too small.
    """
    if certificate is None:
        return
    gap = max(certificate.gap, 0.0)
    root = float(1 - np.sqrt(1 - gap))
    variance, deviation = (
        at_least(100 * gap) if gap > 0.001 else "0.1",
        at_least(100 * root) if root > 0.0005 else "0.05",
    )
    if len(over) == 1:
        yield f"With no other layout within the limits is {sigma} lower by more than {deviation} %."
    else:
        yield (
            f"With no other layout within the limits is {criterion.symbol} lower by more than {variance} %, or its "
            f"root, {sigma}, by more than {deviation} %; σ of one of them alone may be lower by more."
        )


def _beyond(task: Task, layout: OptimisedLayout) -> Iterator[str]:
    """What the bound says of the candidates that did not enter the elimination."""
    if task.whole is None or layout.beyond is None:
        return
    every, entered = len(task.whole.limits.size), len(task.whole.rows)
    what = f"That holds for all {every} candidates, of which {entered} entered the elimination"
    if layout.beyond:
        yield f"{what}: {layout.beyond} of the others could be in a better layout."
    else:
        yield f"{what}: none of the others is in a better layout."


def _failures(
    labels: Sequence[str], loss: np.ndarray, std: Mapping[str, float], without: Mapping[str, np.ndarray]
) -> Iterator[str]:
    lost = [label for label, value in zip(labels, loss, strict=True) if np.isinf(value)]
    unsolved = [label for label, value in zip(labels, loss, strict=True) if np.isnan(value)]
    if unsolved:
        yield f"What is left if {' or '.join(unsolved)} fails was not solved to accuracy."
    if len(lost) == len(labels):
        yield "Whichever gauge fails, an unknown is lost."
    elif lost:
        yield f"An unknown is lost if {' or '.join(lost)} fails."
    elif not unsolved:
        known = {name: values for name, values in without.items() if np.isfinite(values).all()}
        growths = (
            (float(np.max(values)) / std[name], name, first_of_largest(values)) for name, values in known.items()
        )
        for growth, name, worst in [max(growths, key=lambda growth_and_name: growth_and_name[0])] if known else ():
            if growth > 1:
                yield f"The worst failure is that of {labels[worst]}: σ of {name} grows by {_percent(growth - 1)}."
            else:
                yield "σ of no unknown grows if one gauge fails: what it reads wrong then goes with it."


def _percent(share: float) -> str:
    """Two digits, and no powers of ten."""
    return f"{100 * share:.0f} %" if share >= 0.1 else f"{100 * share:.2g} %"


def _loads(labels: Sequence[str], load: np.ndarray) -> Iterator[str]:
    for label, share in zip(labels, load, strict=True):
        if share > 1:
            yield f"{label} sees {share:.2g} times what it can measure in the training run."
        elif share > NEARLY:
            yield f"{label} sees {100 * share:.0f} % of its range in the training run."
