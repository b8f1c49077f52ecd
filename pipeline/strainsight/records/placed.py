"""observe.h5 and place.h5: observability, scenarios, layout, optimality bound, and layouts by other criteria.

`<what>` is the criterion: tr(W P), or another one."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from strainsight.loads.observability import Observability
from strainsight.records.record import dataset, group, record


@record
class Augmented:
    """Every scenario as solved, for an independent solution."""

    state: tuple[str, ...] = dataset(
        "1",
        "/state",
        "names of the entries of the augmented state x*: reduced coordinates q, rates of q, unknowns, states of "
        "the load models",
    )
    F: np.ndarray = dataset(
        "1/s",
        "scenario × /state × /state",
        "augmented state matrix F* of every scenario (instant, pose, parameter sample or load case)",
    )
    H: np.ndarray = dataset(
        "unit of the channel",
        "scenario × channel × /state",
        "strain operator H* of every scenario: reading of every channel per unit of x*",
    )
    Q: np.ndarray = dataset("1/s", "scenario × /state × /state", "process noise intensity Q of the augmented state")
    R: np.ndarray = dataset("(unit of the channel)^2 s", "scenario × channel", "noise intensity R of every channel")
    weight: np.ndarray = dataset("1", "scenario × /state", "diagonal of the weight matrix W of the placement criterion")
    scale: np.ndarray = dataset(
        "SI",
        "scenario × /state",
        "scale of every entry of x*: x* = scale · scaled state. With all candidates at the start of the "
        "elimination (the pool), the steady-state covariance P of the scaled state has the diagonal 1",
    )


@record
class PoolTable:
    """A unit of the elimination: a gauge, or a mirrored pair."""

    candidate: np.ndarray = dataset(
        "1",
        "pool row",
        "candidate number of the first channel of every pool row; a pool row is a gauge or mirrored pair at the start of "
        "the elimination",
    )
    channel: np.ndarray = dataset("1", "channel", "candidate number of every channel in /augmented/H")
    row: np.ndarray = dataset("1", "channel", "row in /pool/gauges of the gauge of every channel in /augmented/H")
    gauges: np.ndarray = dataset(
        "1",
        "pool row × 1 or 2",
        "numbers of the gauges that are placed or removed together; −1 in the second column: one gauge, not a "
        "mirrored pair",
    )


@record
class Removals:
    """The elimination, starting with the whole pool."""

    removed: np.ndarray = dataset(
        "1", "removal", "gauges removed by the backward elimination, as rows of /pool/gauges, in order of removal"
    )
    trace: np.ndarray | None = dataset(
        "1",
        "removal + 1",
        "<what> with all candidates of the pool and after every removal; only for the trace criterion",
        default=None,
    )
    metric: np.ndarray | None = dataset(
        "1",
        "removal + 1",
        "<what> with all candidates of the pool and after every removal; only for other criteria",
        default=None,
    )
    rise: np.ndarray = dataset("1", "removal", "increase of <what> with every removal, in full precision")
    unknowns: tuple[str, ...] = dataset("1", "/unknowns", "unknowns in the placement criterion: loads, then parameters")
    blocks: np.ndarray = dataset(
        "1", "removal + 1 × /unknowns", "weighted variance of every unknown; the sum of a row is tr(W P)"
    )
    solves: np.ndarray = dataset("1", "removal", "number of exact Riccati solutions for every removal")
    ties: np.ndarray = dataset("1", "removal", "number of equally good alternatives for every removal (ties)")


@record
class Selection:
    """A set of gauges."""

    gauge: np.ndarray = dataset("1", "gauge", "<what>; every value is a row in /pool/gauges")
    number: np.ndarray = dataset("1", "gauge", "candidate number of every gauge")
    channel: np.ndarray = dataset(
        "1", "gauge × most channels", "candidate numbers of the channels of every gauge; −1: no channel"
    )
    rank: np.ndarray = dataset(
        "1",
        "gauge",
        "rank of every gauge: 1 for the first row of `gauge`; both gauges of a mirrored pair have the same rank",
    )
    element: np.ndarray = dataset("1", "gauge", "element id of every gauge in the deck")
    facet: np.ndarray = dataset("1", "gauge", "facet number of every gauge in its element, from 1")
    nodes: np.ndarray = dataset("1", "gauge × 8", "node indices of the facet of every gauge; −1: no node")
    position: np.ndarray = dataset("m", "gauge × 3", "position of every gauge, in global axes")
    direction: np.ndarray = dataset(
        "1", "gauge × 3", "measuring direction of the first channel of every gauge, in global axes"
    )
    load: np.ndarray | None = dataset(
        "1",
        "gauge",
        "largest absolute reading of every gauge in the stage `train`, divided by the measuring range; NaN: measuring "
        "range not specified",
        default=None,
    )


@record
class LayoutBound:
    """Bound on the criterion of any permitted layout."""

    lower_bound: float = dataset("1", "", "lower bound on <what> of all permitted layouts")
    gap: float = dataset("1", "", "optimality gap: (<what> of the layout − bound) / <what>")
    weights: np.ndarray = dataset(
        "1", "pool row", "weight of every gauge or mirrored pair in the convex relaxation of the placement"
    )


@record
class Rules:
    """The layout and layouts by other criteria, evaluated with the same covariances."""

    rule: tuple[str, ...] = dataset("1", "/rule", "name of the method that selected each gauge set, such as random")
    gauges: np.ndarray = dataset("1", "/rule × row", "gauges of every gauge set, as rows of /pool/gauges; −1: no gauge")
    name: tuple[str, ...] = dataset("1", "/name", "name of every criterion; the first is the criterion of the layout")
    value: np.ndarray = dataset("1", "/rule × /name", "value of every criterion (a variance) for every gauge set")
    std: dict[str, np.ndarray] = dataset(
        "SI", "/rule", "steady-state standard deviation of <name> with every gauge set; for ranking only"
    )


@record
class PlacedLayout:
    """Data of place.h5 of a structure and of a bench."""

    augmented: Augmented = group()
    pool: PoolTable = group()
    elimination: Removals = group(what="<what>")
    residual: float = dataset("1", "", "largest relative residual of all Riccati solutions", path="/riccati/residual")
    greedy: Selection = group(path="/selected/greedy", what="gauges that remain after the backward elimination")
    final: Selection = group(
        path="/selected/final",
        what="gauges of the layout; first the gauge with the largest increase of the criterion after removal",
    )
    loss: np.ndarray = dataset(
        "1",
        "gauge",
        "<what> after the failure of each gauge of the layout; inf: an unknown becomes unobservable; NaN: "
        "Riccati equation not solved accurately",
        path="/failure/loss",
    )
    certificate: LayoutBound | None = group(what="<what>", default=None)
    baseline: dict[str, float] = dataset("1", "", "<what> of the gauge set selected by <name>")
    criteria: Rules = group()
    advice: tuple[str, ...] = dataset("1", "sentence", "recommendations for the layout")


def metric_key(criterion: str) -> str:
    """Name of the criterion in datasets and in the summary, for the trace and for other criteria."""
    return "trace" if criterion == "trace" else "metric"


@record
class Budget:
    """Contributions to the variance of every unknown."""

    source: tuple[str, ...] = dataset("1", "/source", "name of every source of the variance of the estimate")
    share: dict[str, np.ndarray] = dataset("1", "/source", "share of every source in the filtered variance of <name>")

    @property
    def shares(self) -> dict[str, dict[str, float]]:
        """Name → source → share."""
        return {name: dict(zip(self.source, shares.tolist(), strict=True)) for name, shares in self.share.items()}


def budget_of_shares(shares: Mapping[str, Mapping[str, float]]) -> Budget | None:
    """Variance shares from name → source → share, with the same sources for each name; None if empty."""
    sources = tuple(next(iter(shares.values()), ()))
    share = {name: np.array([by_source[source] for source in sources]) for name, by_source in shares.items()}
    return Budget(source=sources, share=share) if sources else None


@record
class Observed:
    """observe.h5."""

    excitation: tuple[str, ...] = dataset(
        "1",
        "/excitation",
        "name of every excitation: load case, 'training simulation' (the simulation of the stage `train`), or frequency",
    )
    case: tuple[str, ...] = dataset(
        "1",
        "/case",
        "group of unknowns that is checked together: input (loads), E (stiffness parameters), rho (densities), damping, or "
        "several of these joined by +",
    )
    unknowns: tuple[str, ...] = dataset("1", "/case", "names of the unknowns in each group; `case` lists the groups")
    condition: np.ndarray = dataset(
        "1",
        "/excitation × /case",
        "condition number of the scaled observability (PBH) matrix at λ = 0, median over instants",
    )
    condition_raw: np.ndarray = dataset(
        "1",
        "/excitation × /case",
        "condition number of the unscaled observability (PBH) matrix at λ = 0, as in the thesis (Cottone 2022); "
        "depends on units",
    )
    sigma_min: np.ndarray = dataset(
        "1", "/excitation × /case", "smallest singular value of the scaled observability (PBH) matrix at λ = 0"
    )
    lost: np.ndarray = dataset(
        "1", "/excitation × /case", "unobservable or weakly observable unknowns of every group; empty: none"
    )


@record
class HotSpots:
    """Mesh sensitivity of the gauge strains, for the final set or any set; changes relative to the RMS reading in training."""

    refined: np.ndarray = dataset(
        "1",
        "gauge",
        "largest strain change at the gauge after refinement of the local mesh, relative to the RMS strain in the stage "
        "`train`; NaN: not tested",
    )
    spread: np.ndarray = dataset(
        "1",
        "gauge",
        "strain change at the gauge if nearby nodal forces are distributed over facets, relative to the RMS strain in the "
        "stage `train`; NaN: not tested",
    )
    share: float = dataset(
        "1", "", "limit of the relative strain changes `refined` and `spread`; above the limit: hot spot"
    )

    @property
    def hot(self) -> np.ndarray:
        """Gauges with a change above the limit (gauges,), by mesh refinement or distributed forces."""
        with np.errstate(invalid="ignore"):
            return (np.abs(self.refined) > self.share) | (np.abs(self.spread) > self.share)


@record
class Influence:
    """Influence matrix of the layout."""

    load: tuple[str, ...] = dataset("1", "/load", "names of the loads")
    unit: tuple[str, ...] = dataset("1", "/load", "unit of every load")
    reading: np.ndarray = dataset(
        "SI", "channel × /load", "static reading of every channel of the layout per unit of every load, at the guess"
    )
    signal_to_noise: np.ndarray = dataset(
        "1", "channel", "RMS reading of every channel in the stage `train`, relative to the noise of a sample"
    )
    condition: float | None = dataset(
        "1",
        "",
        "condition number of the readings of the unknown loads, relative to noise and for the reference of σ of every load; "
        "only for two unknown loads or more",
        default=None,
    )


@record
class FrequencyResponse:
    """Frequency response functions of the strain gauges of the layout at the guess."""

    load: tuple[str, ...] = dataset("1", "/load", "names of the loads")
    unit: tuple[str, ...] = dataset("1", "/load", "unit of every load")
    channel: tuple[str, ...] = dataset("1", "/channel", "labels of the strain channels")
    gauge: np.ndarray = dataset("1", "/channel", "number of the gauge of every channel in the layout, from 0")
    frequency: np.ndarray = dataset("Hz", "/frequency", "frequencies, ascending from 0")
    magnitude: np.ndarray = dataset(
        "SI", "/frequency × /channel × /load", "amplitude of the strain per unit amplitude of every load"
    )
    phase: np.ndarray = dataset("rad", "/frequency × /channel × /load", "phase of the strain relative to the load")
    natural: np.ndarray = dataset("Hz", "/natural", "natural frequencies, each of them in frequency")
    excited: np.ndarray = dataset("1", "/natural × /load", "1 if the load excites the mode of this natural frequency")


@record
class AtGauges:
    """Bonding conditions at the gauge locations, for the final set or any set."""

    in_place: np.ndarray = dataset(
        "1",
        "gauge",
        "RMS strain change over one standard deviation of the gauge position, relative to the RMS strain in the stage `train`; "
        "NaN: no strain gauge",
    )
    over_grid: np.ndarray = dataset(
        "1",
        "gauge",
        "RMS strain change along the measuring grid, relative to the RMS strain in the stage `train`; NaN: no strain gauge",
    )
    room: np.ndarray = dataset("m", "gauge", "free height above the gauge; inf: larger than the search limit")
    lies_on: tuple[str, ...] = dataset(
        "1",
        "gauge",
        "centre of the face below the gauge and reason why the face is probably a contact face; empty: no contact face",
    )
    in_place_limit: float = dataset(
        "1",
        "",
        "limit of the relative strain change over one standard deviation of the gauge position; a larger change is a "
        "steep gradient",
    )
    over_grid_limit: float = dataset(
        "1", "", "limit of the relative strain change along the measuring grid; a larger change is a steep gradient"
    )
    room_limit: float = dataset("m", "", "free height required for bonding")

    def steep_in_words(self, i: int) -> str:
        """Warning of a steep gradient at gauge i, with value and limit; empty below the limits."""
        kinds = {
            "over one standard deviation of the gauge position": (self.in_place[i], self.in_place_limit),
            "along the measuring grid": (self.over_grid[i], self.over_grid_limit),
        }
        changes = [
            f"{100 * value:.2g} % strain change {what} (limit {100 * limit:.2g} %)"
            for what, (value, limit) in kinds.items()
            if value > limit
        ]
        return f"steep gradient: {' and '.join(changes)}" if changes else ""

    def access(self, i: int) -> tuple[str, ...]:
        """Reasons to check the access at gauge i: free height, or contact face; empty without one."""
        room = f"free height above the gauge {1e3 * self.room[i]:.2g} mm (limit {1e3 * self.room_limit:.2g} mm)"
        return (*[room] * bool(self.room[i] <= self.room_limit), *filter(None, [self.lies_on[i]]))

    def access_in_words(self, i: int) -> str:
        """Warning to check the access at gauge i, with the reasons; empty without one."""
        reasons = self.access(i)
        return f"check access: {', and '.join(reasons)}" if reasons else ""


@record
class ByCase:
    """Load cases of the placement."""

    name: tuple[str, ...] = dataset("1", "/name", "name of every load case")
    weight: np.ndarray = dataset("1", "/name", "weight of every load case in the placement criterion")
    scenario: np.ndarray = dataset("1", "scenario", "load case number of every scenario in /augmented")
    metric: np.ndarray = dataset(
        "1", "/name", "<what> of the layout in every load case, without the weight of the load case"
    )
    std: dict[str, np.ndarray] = dataset(
        "1",
        "/name",
        "predicted σ of <name> in the simulation of the stage `train`, relative to the RMS (load) or guess (parameter)",
    )
    acts: dict[str, np.ndarray] = dataset(
        "1", "/name", "1 if <name> acts in the load case; 0: not part of the criterion of this load case"
    )
    scale: dict[str, np.ndarray] = dataset(
        "SI", "/name", "RMS in the load case (load) or guess (parameter) of <name>, the reference of σ"
    )
    worst: dict[str, str] = dataset("1", "", "load case with the largest σ of <name>")


@record
class Placed(PlacedLayout):
    """place.h5."""

    expected_std: dict[str, float] = dataset(
        "SI",
        "",
        "predicted σ of <name> in the simulation of the stage `train`, with tolerances, in the load case with the largest σ",
    )
    without: dict[str, np.ndarray] = dataset(
        "1",
        "gauge",
        "predicted relative σ of <name> without each gauge of the layout: largest value of all load cases, "
        "relative to the RMS in the load case",
    )
    budget: Budget | None = group(default=None)
    observability: Observability = group()
    influence: Influence | None = group(default=None)
    frequency_response: FrequencyResponse | None = group(default=None)
    hot_spots: HotSpots | None = group(default=None)
    at_gauges: AtGauges | None = group(default=None)
    by_case: ByCase | None = group(path="/load_cases", what="<what>", default=None)
