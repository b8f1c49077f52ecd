"""place.h5 of a bench: candidates, the placement in the pool, and the layouts with what each is expected to know."""

from __future__ import annotations

import numpy as np

from strainsight.records.layout import PlacedLayout
from strainsight.records.record import dataset, group, record

PLACED = "place"
"""Name of the layout that was placed; others are drawn at random, random-1, random-2 …"""


@record
class BenchCandidates:
    position: np.ndarray = dataset("m", "candidate × 3", "position")
    direction: np.ndarray = dataset("1", "candidate × 3", "measuring direction")
    element: np.ndarray = dataset("1", "candidate", "element id in the deck")
    facet: np.ndarray = dataset("1", "candidate", "facet number within the element, from 1")
    response: np.ndarray = dataset(
        "(strain or m or m/s^2)/SI", "candidate × /inputs", "reading per unit of every unknown at rest"
    )


@record
class BenchLayout:
    """One layout, its gauges in its order."""

    candidate: np.ndarray = dataset("1", "gauge", "number of every gauge among the candidates")
    sensor: tuple[str, ...] = dataset(
        "1", "gauge", "SENSOR.AXIS where it is a component of a sensor of the bench, empty where it is a gauge"
    )
    position: np.ndarray = dataset("m", "gauge × 3", "position")
    direction: np.ndarray = dataset("1", "gauge × 3", "measuring direction")
    length: np.ndarray = dataset("m", "gauge", "length of its grid, 0: the strain at its centre")
    metric: float = dataset(
        "1", "", "<what>; inf where an unknown is lost, NaN where the equation is not solved to accuracy"
    )
    std: np.ndarray = dataset(
        "SI",
        "/inputs",
        "σ of every unknown that the filter comes to claim, of a parameter at the end of the run; inf where a load "
        "is lost, NaN where that is not solved",
    )
    without: np.ndarray = dataset("SI", "gauge × /inputs", "that σ without each gauge")

    @property
    def bonded(self) -> np.ndarray:
        """Which are gauges on the body (gauges,)."""
        return np.array([not name for name in self.sensor], dtype=bool)


@record
class BenchPlaced(PlacedLayout):
    """place.h5 of a bench: the state is (η, η̇, u, ξ) about the static equilibrium, motions that the constraints leave in their
    modes, their rates, the unknown inputs, the parameters in their coordinates."""

    inputs: tuple[str, ...] = dataset("1", "/inputs", "name of every unknown, inputs before parameters")
    units: tuple[str, ...] = dataset("1", "/inputs", "unit of every one of them")
    candidates: BenchCandidates = group()
    layouts: dict[str, BenchLayout] = group(what="<what>")

    @property
    def placed(self) -> BenchLayout:
        """The layout that was placed."""
        return self.layouts[PLACED]

    @property
    def random_std(self) -> np.ndarray:
        """`std` of every layout that was drawn (r, inputs)."""
        drawn = [layout.std for name, layout in self.layouts.items() if name != PLACED]
        return np.array(drawn).reshape(-1, len(self.inputs))

    def layout(self, which: str) -> BenchLayout:
        """For a sensor with `layout: which`. "random": the first of those drawn, which is no worse a draw than another."""
        return self.placed if which == PLACED else self.layouts["random-1"]
