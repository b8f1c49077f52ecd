"""Placement on a body of a bench."""

from __future__ import annotations

import numpy as np

from strainsight.records.placed import PlacedLayout
from strainsight.records.record import dataset, group, record

PLACED = "place"
"""Name of the placed layout; random layouts are random-1, random-2 …"""


@record
class BenchCandidates:
    position: np.ndarray = dataset(
        "m", "candidate × 3", "position of every candidate: gauge in body axes, bench sensor in global axes"
    )
    direction: np.ndarray = dataset(
        "1", "candidate × 3", "measuring direction of every candidate: gauge in body axes, bench sensor in global axes"
    )
    element: np.ndarray = dataset("1", "candidate", "element id of every candidate in the deck")
    facet: np.ndarray = dataset("1", "candidate", "facet number of every candidate in its element, from 1")
    response: np.ndarray = dataset(
        "SI",
        "candidate × /inputs",
        "static reading of every candidate per unit of each unknown load or parameter, at the first instant in `place.poses`",
    )


@record
class BenchLayout:
    """One layout with its gauges in order."""

    candidate: np.ndarray = dataset("1", "gauge", "candidate number of every gauge")
    sensor: tuple[str, ...] = dataset("1", "gauge", "SENSOR.AXIS for a component of a bench sensor; empty for a gauge")
    position: np.ndarray = dataset(
        "m", "gauge × 3", "position of every gauge in body axes, or of a bench sensor in global axes"
    )
    direction: np.ndarray = dataset(
        "1", "gauge × 3", "measuring direction of every gauge in body axes, or of a bench sensor in global axes"
    )
    length: np.ndarray = dataset(
        "m", "gauge", "length of the measuring grid of every gauge; 0: strain at the grid centre"
    )
    metric: float = dataset(
        "1", "", "<what> of the layout; inf: an unknown is unobservable; NaN: Riccati equation not solved accurately"
    )
    std: np.ndarray = dataset(
        "SI",
        "/inputs",
        "standard deviation of the estimate of every unknown (load: in the steady state, parameter: at the end of the "
        "run). inf: unobservable load; NaN: Riccati equation not solved accurately",
    )
    without: np.ndarray = dataset(
        "SI", "gauge × /inputs", "standard deviation of the estimate of every unknown after the failure of each gauge"
    )

    @property
    def bonded(self) -> np.ndarray:
        """Whether an entry is a gauge on the body (gauges,)."""
        return np.array([not name for name in self.sensor], dtype=bool)


@record
class BenchPlaced(PlacedLayout):
    """place.h5 of a bench. The state is (η, η̇, u, ξ) about the static equilibrium: modal coordinates of the constrained motion,
    their rates, unknown inputs, scaled parameters."""

    inputs: tuple[str, ...] = dataset("1", "/inputs", "names of the unknowns: loads, then parameters")
    units: tuple[str, ...] = dataset("1", "/inputs", "units of the unknowns")
    candidates: BenchCandidates = group()
    layouts: dict[str, BenchLayout] = group(what="<what>")

    @property
    def placed(self) -> BenchLayout:
        """The placed layout."""
        return self.layouts[PLACED]

    @property
    def random_std(self) -> np.ndarray:
        """`std` of every random layout (r, inputs)."""
        stds = [layout.std for name, layout in self.layouts.items() if name != PLACED]
        return np.array(stds).reshape(-1, len(self.inputs))

    def layout(self, which: str) -> BenchLayout:
        """Layout for a sensor with `layout: which`; "random" is the first random layout."""
        return self.placed if which == PLACED else self.layouts["random-1"]
