"""What a placement writes, on a structure and on a bench: the scenarios as solved, the elimination, the layout, how far it is
from the best, and layouts by other rules.

`<what>` in the words of a dataset stands for the metric: tr(W P), or that of another criterion.
"""

from __future__ import annotations

import numpy as np

from strainsight.records.record import dataset, group, record


@record
class Augmented:
    """Every scenario exactly as it was solved, so that anyone can solve it again."""

    state: tuple[str, ...] = dataset(
        "1", "/state", "what each of x* is: coordinates q, their rates, then the unknowns with what their models add"
    )
    F: np.ndarray = dataset("1/s", "scenario × /state × /state", "augmented state matrix F*")
    H: np.ndarray = dataset("unit of the channel", "scenario × channel × /state", "rows H* of every channel")
    Q: np.ndarray = dataset("1/s", "scenario × /state × /state", "process intensity")
    R: np.ndarray = dataset("unit of the intensity", "scenario × channel", "intensity of every channel")
    weight: np.ndarray = dataset("1", "scenario × /state", "diagonal of W")
    scale: np.ndarray = dataset(
        "x*", "scenario × /state", "x* = scale · the coordinates above, in which diag P = 1 with the whole pool"
    )


@record
class PoolTable:
    """What is bonded and removed as one: a gauge, or a mirrored pair."""

    candidate: np.ndarray = dataset("1", "pool row", "candidate of every pool row, of its first channel")
    channel: np.ndarray = dataset("1", "channel", "candidate of every row of /augmented/H")
    row: np.ndarray = dataset("1", "channel", "pool row that every row of /augmented/H belongs to")
    gauges: np.ndarray = dataset(
        "1", "pool row × 1 or 2", "gauges of every pool row, −1 where it has one and others two"
    )


@record
class Removals:
    """The elimination, the whole pool first."""

    removed: np.ndarray = dataset("1", "removal", "pool rows in the order of their removal")
    trace: np.ndarray | None = dataset(
        "1", "removal + 1", "<what>, the full pool first, where it is the trace", default=None
    )
    metric: np.ndarray | None = dataset(
        "1", "removal + 1", "<what>, the full pool first, where it is another one", default=None
    )
    rise: np.ndarray = dataset("1", "removal", "rise of <what> at every removal, with all its digits")
    unknowns: tuple[str, ...] = dataset("1", "/unknowns", "name of every unknown that the metric weighs, inputs first")
    blocks: np.ndarray = dataset(
        "1", "removal + 1 × /unknowns", "variance of every one of them times its weight, of which tr(W P) is the sum"
    )
    solves: np.ndarray = dataset("1", "removal", "exact Riccati solves of every removal")
    ties: np.ndarray = dataset("1", "removal", "other pool rows that were as good to remove, at every removal")


@record
class Selection:
    """A set of gauges."""

    gauge: np.ndarray = dataset("1", "gauge", "pool row of every gauge, <what>")
    number: np.ndarray = dataset("1", "gauge", "number of every gauge among the candidates")
    channel: np.ndarray = dataset(
        "1", "gauge × most channels", "candidates that are its channels, −1 where it has fewer"
    )
    rank: np.ndarray = dataset("1", "gauge", "1 is the first: pool rows <what>")
    element: np.ndarray = dataset("1", "gauge", "element id in the deck")
    facet: np.ndarray = dataset("1", "gauge", "facet number within the element, from 1")
    nodes: np.ndarray = dataset("1", "gauge × 8", "node indices of the facet, −1 where it has fewer")
    position: np.ndarray = dataset("m", "gauge × 3", "position")
    direction: np.ndarray = dataset("1", "gauge × 3", "direction of its first channel")
    load: np.ndarray | None = dataset(
        "1", "gauge", "largest training reading over the range of every gauge, NaN: none stated", default=None
    )


@record
class Bound:
    """What any layout within the limits could reach."""

    lower_bound: float = dataset("1", "", "no layout within the limits has a smaller <what>")
    gap: float = dataset("1", "", "(<what> of the final set − bound) / <what>")
    weights: np.ndarray = dataset("1", "pool row", "gauge weights of the relaxed problem")


@record
class Rules:
    """The layout beside those by other rules, all from the same covariances."""

    rule: tuple[str, ...] = dataset("1", "/rule", "how every set was found")
    gauges: np.ndarray = dataset("1", "/rule × row", "pool rows of every set, −1 for none")
    name: tuple[str, ...] = dataset("1", "/name", "every criterion, that of the layout first")
    value: np.ndarray = dataset("1", "/rule × /name", "every set by every criterion, a variance")
    std: dict[str, np.ndarray] = dataset("SI", "/rule", "steady-state σ of <name>, which ranks layouts and is no claim")


@record
class PlacedLayout:
    """What place.h5 of a structure and that of a bench have in common."""

    augmented: Augmented = group()
    pool: PoolTable = group()
    elimination: Removals = group(what="<what>")
    residual: float = dataset(
        "1", "", "largest relative residual of the elimination's Riccati solutions", path="/riccati/residual"
    )
    greedy: Selection = group(path="/selected/greedy", what="in ascending order")
    final: Selection = group(path="/selected/final", what="the most missed first")
    loss: np.ndarray = dataset(
        "1",
        "gauge",
        "<what> when each gauge of the final set fails; inf where an unknown is then lost, NaN where not solved",
        path="/failure/loss",
    )
    certificate: Bound | None = group(what="<what>", default=None)
    baseline: dict[str, float] = dataset("1", "", "<what> of the set by <name>")
    criteria: Rules = group()
    advice: tuple[str, ...] = dataset("1", "sentence", "what to do with the layout")


def metric_key(criterion: str) -> str:
    """What the metric is called in datasets and in the summary: the trace by its name, any other criterion by none."""
    return "trace" if criterion == "trace" else "metric"
