"""observe.h5 and place.h5: what could be known, the scenarios as solved, the layout and how far it is from the best."""

from __future__ import annotations

import numpy as np

from strainsight.records.budget import Budget
from strainsight.records.layout import PlacedLayout
from strainsight.records.record import dataset, group, record


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
class PbhNumbers:
    """Observability of the unknowns from the whole pool."""

    condition: float = dataset("1", "", "condition of the scaled PBH matrix at λ = 0")
    sigma_min: float = dataset("1", "", "its smallest singular value")
    condition_raw: float = dataset(
        "1", "", "the same without scales, as the thesis prints it, which orders cases by their units"
    )


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
    observability: PbhNumbers = group()
    hot_spots: HotSpots | None = group(default=None)
    at_gauges: AtGauges | None = group(default=None)
    by_case: ByCase | None = group(path="/load_cases", what="<what>", default=None)
