"""estimate.h5 of a bench: loads and parameters of the first run beside the truth, and what sensors read by them (thesis 2-4)."""

from __future__ import annotations

import numpy as np

from strainsight.records.estimated import Compared
from strainsight.records.placed import PlacedLayout
from strainsight.records.record import dataset, group, record


@record
class LoadHistory:
    """An unknown load; true: without `estimate.measured`, there: on the bench that was measured, with it; smoothed: by an
    extended filter whose first run did not diverge, smoothed_std: where it is known to hold."""

    estimate: np.ndarray = dataset("<unit>", "/time", "estimate of <what>")
    std: np.ndarray = dataset("<unit>", "/time", "its claimed σ")
    smoothed: np.ndarray | None = dataset("<unit>", "/time", "<what> by all samples, also the later ones", default=None)
    smoothed_std: np.ndarray | None = dataset("<unit>", "/time", "its claimed σ", default=None)
    true: np.ndarray | None = dataset("<unit>", "/time", "the true load", default=None)
    there: np.ndarray | None = dataset("<unit>", "/time", "the load on the bench that was measured", default=None)


@record
class ParameterHistory:
    estimate: np.ndarray = dataset("<unit>", "/time", "estimate of <what>")
    std: np.ndarray = dataset("<unit>", "/time", "its claimed σ")
    true: float | None = dataset("<unit>", "", "its true value", default=None)


@record
class SensorMatch:
    """A sensor by the estimate; one that the filter was not given has the true reading as its measured one."""

    used: bool = dataset("1", "", "whether the filter was given <what>")
    expected: np.ndarray = dataset("<unit>", "instant × component", "what the estimate says that it reads")
    measured: np.ndarray | None = dataset(
        "<unit>", "instant × component", "what it reads, with its noise where the filter was given it", default=None
    )
    predicted: np.ndarray | None = dataset(
        "<unit>", "instant × component", "readings by the other channels, NaN: it is in", default=None
    )
    predicted_std: np.ndarray | None = dataset(
        "<unit>", "instant × component", "σ of measured − predicted", default=None
    )
    left_in: tuple[str, ...] | None = dataset(
        "1", "component", "why it was not left out, empty where it was", default=None
    )
    bias: np.ndarray | None = dataset(
        "<unit>", "component", "estimated offset at the end, 0 of a component that has none", default=None
    )
    bias_std: np.ndarray | None = dataset("<unit>", "component", "its claimed σ", default=None)


@record
class BallsThen:
    """The balls at the instant of the highest estimated contact pressure."""

    time: float = dataset("s", "", "instant of the highest pressure")
    station: np.ndarray = dataset("rad", "ball", "station of every ball")
    force: np.ndarray = dataset("N", "ball × 4", "contact force then (ball × contact)")
    force_std: np.ndarray = dataset("N", "ball × 4", "its claimed σ")
    pressure: np.ndarray = dataset("Pa", "ball × 4", "contact pressure then (ball × contact)")
    pressure_std: np.ndarray = dataset("Pa", "ball × 4", "its claimed σ")


@record
class RingEstimate:
    """What a bearing does by the estimate of the first run; not there where a bank filters."""

    displacement: np.ndarray = dataset("m or rad", "/time × 5", "x, y, z, tilts about y, z of the inner ring")
    std: np.ndarray = dataset("m or rad", "/time × 5", "their claimed σ")
    instants: np.ndarray = dataset("s", "picture", "instants at which the balls were looked at")
    pressure: np.ndarray = dataset("Pa", "picture", "highest contact pressure of all balls")
    pressure_std: np.ndarray = dataset("Pa", "picture", "claimed σ of the pressure there")
    worst: BallsThen = group()


@record
class LoadRuns:
    error: np.ndarray = dataset("<unit>", "run", "rms error of <what> over the second half")


@record
class ParameterRuns:
    start: np.ndarray = dataset("<unit>", "run", "first guess of <what>")
    estimate: np.ndarray = dataset("<unit>", "run", "estimate at the end")
    std: np.ndarray = dataset("<unit>", "run", "claimed σ at the end")
    error: np.ndarray | None = dataset("<unit>", "run", "estimate less true value at the end", default=None)


@record
class BenchEstimated:
    """estimate.h5 of a bench."""

    time: np.ndarray = dataset("s", "/time", "time, the start first")
    q: np.ndarray = dataset("SI", "/time × coordinate", "estimated coordinates of all bodies")
    violation: np.ndarray = dataset("1", "/time", "largest constraint violation of the estimate, relative")
    nis: np.ndarray = dataset("1", "instant", "normalised innovation squared over the number of channels")
    lost: np.ndarray = dataset("1", "run", "step in which each run diverged, -1: none")
    inputs: dict[str, LoadHistory] = group(unit="unit of input <name>", what="<name>")
    parameters: dict[str, ParameterHistory] = group(unit="unit of parameter <name>", what="<name>")
    sensors: dict[str, SensorMatch] = group(unit="unit of sensor <name>", what="<name>")
    input_runs: dict[str, LoadRuns] = group(path="/runs/inputs/<name>", unit="unit of input <name>", what="<name>")
    parameter_runs: dict[str, ParameterRuns] = group(
        path="/runs/parameters/<name>", unit="unit of parameter <name>", what="<name>"
    )
    seeds: dict[str, np.ndarray] = dataset(
        "SI", "seed", "number <name> of the summary, once a seed; not of a single one", path="/runs/numbers/<name>"
    )
    bearings: dict[str, RingEstimate] = group()
    compared: Compared | None = group(default=None)


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
