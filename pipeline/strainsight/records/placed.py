"""observe.h5 and place.h5: what could be known, the scenarios as solved, the layout, how far it is from the best, and layouts by
other rules.

`<what>` in the words of a dataset stands for the metric: tr(W P), or that of another criterion.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.loads.observability import Observability
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
class LayoutBound:
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
    certificate: LayoutBound | None = group(what="<what>", default=None)
    baseline: dict[str, float] = dataset("1", "", "<what> of the set by <name>")
    criteria: Rules = group()
    advice: tuple[str, ...] = dataset("1", "sentence", "what to do with the layout")


def metric_key(criterion: str) -> str:
    """What the metric is called in datasets and in the summary: the trace by its name, any other criterion by none."""
    return "trace" if criterion == "trace" else "metric"


@record
class Budget:
    """What the variance of every unknown is made of."""

    source: tuple[str, ...] = dataset("1", "/source", "where a part of the variance comes from")
    share: dict[str, np.ndarray] = dataset("1", "/source", "share of every source in the variance of <name>, filtered")

    @property
    def shares(self) -> dict[str, dict[str, float]]:
        """Name → source → share."""
        return {name: dict(zip(self.source, own.tolist(), strict=True)) for name, own in self.share.items()}


def budget_of_shares(shares: Mapping[str, Mapping[str, float]]) -> Budget | None:
    """Of name → source → share, each with the same sources; None of nothing."""
    sources = tuple(next(iter(shares.values()), ()))
    share = {name: np.array([own[source] for source in sources]) for name, own in shares.items()}
    return Budget(source=sources, share=share) if sources else None


@record
class Observed:
    """observe.h5."""

    excitation: tuple[str, ...] = dataset("1", "/excitation", "name of every excitation")
    case: tuple[str, ...] = dataset(
        "1", "/case", "groups that are unknown together: input, E (all moduli), rho (all densities)"
    )
    unknowns: tuple[str, ...] = dataset("1", "/case", "names of the unknowns of every case")
    condition: np.ndarray = dataset(
        "1", "/excitation × /case", "condition of the scaled PBH matrix at λ = 0, median over instants"
    )
    condition_raw: np.ndarray = dataset(
        "1", "/excitation × /case", "the value as defined in the thesis, which orders cases by their units"
    )
    sigma_min: np.ndarray = dataset("1", "/excitation × /case", "smallest singular value of the scaled matrix there")
    lost: np.ndarray = dataset("1", "/excitation × /case", "what is unobservable or nearly so; empty where nothing is")


@record
class HotSpots:
    """Whether the strain at gauges is that of the part: of the final set, or of any; changes over the RMS reading in training."""

    refined: np.ndarray = dataset(
        "1", "gauge", "largest change of its strain when the mesh around it is refined, NaN: not tested"
    )
    spread: np.ndarray = dataset(
        "1", "gauge", "change when forces on nodes there are spread over the facets, NaN: not tested"
    )
    share: float = dataset("1", "", "change of its training RMS beyond which it is at a hot spot")

    @property
    def hot(self) -> np.ndarray:
        """Which gauges change by more than the share (gauges,), by refinement or by spreading."""
        with np.errstate(invalid="ignore"):
            return (np.abs(self.refined) > self.share) | (np.abs(self.spread) > self.share)


@record
class AtGauges:
    """What the places of the gauges of the final set, or of any, ask of whoever bonds them."""

    in_place: np.ndarray = dataset(
        "1", "gauge", "RMS change of its strain over σ of its place, over its training RMS; NaN: reads no strain"
    )
    over_grid: np.ndarray = dataset(
        "1", "gauge", "RMS change of the strain from end to end of its grid, over its training RMS; NaN as there"
    )
    room: np.ndarray = dataset("m", "gauge", "free height over it, inf: more than the limit")
    lies_on: tuple[str, ...] = dataset(
        "1", "gauge", "where the face below it is and what holds it, where something probably lies on that face"
    )
    in_place_limit: float = dataset("1", "", "change in place beyond which the gradient is steep")
    over_grid_limit: float = dataset("1", "", "change over the grid beyond which it is")
    room_limit: float = dataset("m", "", "free height that a hand takes")

    def steep_in_words(self, i: int) -> str:
        """That the gradient is steep at gauge i, with the number and the limit; empty where it is not."""
        said = [
            f"by {100 * value:.2g} % {what} (limit {100 * limit:.2g} %)"
            for value, limit, what in (
                (self.in_place[i], self.in_place_limit, "over σ of its place"),
                (self.over_grid[i], self.over_grid_limit, "over its grid"),
            )
            if value > limit
        ]
        return f"steep gradient here: the strain changes {' and '.join(said)}" if said else ""

    def access(self, i: int) -> tuple[str, ...]:
        """Why access is to be checked at gauge i: the room over it, what holds its face; empty where it is not."""
        room = f"{1e3 * self.room[i]:.2g} mm of room over it (limit {1e3 * self.room_limit:.2g} mm)"
        return (*[room] * bool(self.room[i] <= self.room_limit), *filter(None, [self.lies_on[i]]))

    def access_in_words(self, i: int) -> str:
        """That access is to be checked at gauge i, and why; empty where it is not."""
        said = self.access(i)
        return f"check access: {', and '.join(said)}" if said else ""


@record
class ByCase:
    """The load cases that a layout is placed for."""

    name: tuple[str, ...] = dataset("1", "/name", "every load case")
    weight: np.ndarray = dataset("1", "/name", "what it counts")
    scenario: np.ndarray = dataset("1", "scenario", "number of the load case of every scenario of /augmented")
    metric: np.ndarray = dataset("1", "/name", "<what> of the final set in it alone, without its weight")
    std: dict[str, np.ndarray] = dataset(
        "1", "/name", "σ of <name> expected along its training run, relative to the amplitude or guess there"
    )
    acts: dict[str, np.ndarray] = dataset(
        "1", "/name", "whether <name> acts in it; where it is silent it is no part of the metric"
    )
    scale: dict[str, np.ndarray] = dataset("SI", "/name", "that amplitude or guess")
    worst: dict[str, str] = dataset("1", "", "load case in which <name> is known least")


@record
class Placed(PlacedLayout):
    """place.h5."""

    expected_std: dict[str, float] = dataset(
        "SI", "", "σ of <name> that is expected along the training run, tolerances included; in its worst load case"
    )
    without: dict[str, np.ndarray] = dataset(
        "1",
        "gauge",
        "relative σ of <name> expected without each gauge of the final set; the largest of any load case, each "
        "relative to the amplitude in it",
    )
    budget: Budget | None = group(default=None)
    observability: Observability = group()
    hot_spots: HotSpots | None = group(default=None)
    at_gauges: AtGauges | None = group(default=None)
    by_case: ByCase | None = group(path="/load_cases", what="<what>", default=None)
