"""Artefacts of a bench (thesis 1.5-1.7, 2-4): bodies, rest, modes, bearings, motion, surface (pictures are /VTKHDF), estimate and
layout."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.fem.affine import AffineOperator
from strainsight.records.estimated import Compared
from strainsight.records.placed import PlacedLayout
from strainsight.records.record import dataset, group, record
from strainsight.records.reduced import AffineTerms
from strainsight.rom.inertia import InertiaInvariants


@record
class WorstInstant:
    """The balls at the instant of the highest contact pressure."""

    time: float = dataset("s", "", "instant of the highest pressure")
    force: np.ndarray = dataset("N", "ball × 4", "contact force then (ball × contact)")
    contact_angle: np.ndarray = dataset("rad", "ball × 4", "contact angle then (ball × contact)")
    pressure: np.ndarray = dataset("Pa", "ball × 4", "contact pressure then (ball × contact)")


@record
class RingMotion:
    """What a bearing does."""

    displacement: np.ndarray = dataset("m or rad", "/time × 5", "x, y, z, tilts about y, z of the inner ring")
    load: np.ndarray = dataset("N or N m", "/time × 5", "load on the inner ring")
    pressure: np.ndarray = dataset("Pa", "/time", "highest contact pressure at every instant")
    worst: WorstInstant = group()


@record
class DriveMotion:
    """What a driven joint does."""

    position: np.ndarray = dataset("m or rad", "/time", "where it is")
    rate: np.ndarray = dataset("m/s or rad/s", "/time", "how fast it moves")
    force: np.ndarray = dataset(
        "N or N m", "/time", "force or torque along it, by which it does the work force × rate on the bench"
    )


@record
class Violation:
    position: np.ndarray = dataset("SI", "/time", "largest constraint violation at every instant")
    velocity: np.ndarray = dataset("SI", "/time", "largest rate of one")


@record
class Simulated:
    """simulate.h5."""

    time: np.ndarray = dataset("s", "/time", "time, the start first")
    q: np.ndarray = dataset("SI", "/time × coordinate", "coordinates")
    v: np.ndarray = dataset("SI", "/time × coordinate", "their rates")
    violation: Violation = group()
    frequency: np.ndarray = dataset("Hz", "mode", "undamped frequencies of the coupled bench at the start")
    coordinates: dict[str, np.ndarray] = dataset("1", "2", "first coordinate of <name> and the one after its last")
    inputs: dict[str, np.ndarray] = dataset("unit of input <name>", "/time", "load <name>")
    sensors: dict[str, np.ndarray] = dataset(
        "unit of sensor <name>",
        "/time × component of <name>",
        "readings of <name>: strain of every gauge; x, y, z and tilts about y, z of a relative motion; x, y, z of a "
        "frame; force and moment of a joint",
    )
    bearings: dict[str, RingMotion] = group()
    drives: dict[str, DriveMotion] = group()


@record
class SurfaceInTime:
    """field.h5 beside its grid."""

    time: np.ndarray = dataset("s", "/time", "instants of the pictures")
    von_mises: np.ndarray = dataset("Pa", "/time", "largest von Mises stress of every picture")
    moduli: dict[str, np.ndarray] = dataset(
        "Pa", "/time", "Young's modulus <name> that the stress is of; as estimated, where it was"
    )


SQUARE = "coordinate × coordinate"


@record
class ReducedBody:
    """One body; interface: id of the node, as text → its six motions."""

    clamped: bool = dataset("1", "", "whether supports hold the body on the ground")
    frequency: np.ndarray = dataset("Hz", "mode", "modes with the interfaces held")
    cut: float = dataset("Hz", "", "first of these modes that was left out")
    reach: dict[str, np.ndarray] = dataset(
        "Pa", "2", "lowest and highest value of modulus <name> at which statics are right to 1 %"
    )
    mass: np.ndarray = dataset("kg per unit^2", SQUARE, "reduced mass")
    stiffness: AffineOperator = group(AffineTerms, "N/m per unit^2", "reduced stiffness")
    damping: AffineOperator = group(AffineTerms, "N s/m per unit^2", "reduced damping")
    basis: np.ndarray = dataset("m per unit", "3 nodes × coordinate", "displacement of the nodes (3 node + component)")
    interface: dict[str, np.ndarray] = dataset(
        "m or rad per unit", "6 × coordinate", "three translations and three rotations of node <name>"
    )
    inertia: InertiaInvariants = group()


@record
class ReducedBodies:
    """reduce.h5."""

    bodies: dict[str, ReducedBody] = group()


@record
class FrameAtRest:
    """Where a frame stands."""

    position: np.ndarray = dataset("m", "3", "its origin in global axes")
    axes: np.ndarray = dataset("1", "3 × 3", "its axes in global ones, a column each")


@record
class RingAtRest:
    """What a bearing carries."""

    displacement: np.ndarray = dataset("m or rad", "5", "x, y, z, tilts about y, z of the inner ring")
    load: np.ndarray = dataset("N or N m", "5", "load on the inner ring")
    pressure: float = dataset("Pa", "", "highest contact pressure")


@record
class AtRest:
    """statics.h5: the equilibrium under the loads at t = 0."""

    q: np.ndarray = dataset("SI", "coordinate", "coordinates")
    growth: float = dataset("1/s", "", "rate of the motion by which it is left; 0: stable")
    coordinates: dict[str, np.ndarray] = dataset("1", "2", "first coordinate of <name> and the one after its last")
    inputs: dict[str, float] = dataset("unit of input <name>", "", "load <name>")
    frames: dict[str, FrameAtRest] = group()
    sensors: dict[str, np.ndarray] = dataset("unit of sensor <name>", "component of <name>", "readings of <name>")
    reactions: dict[str, np.ndarray] = dataset(
        "N or N m",
        "6",
        "force and moment of joint <name> on its second frame, in the axes of the first, about the second's origin",
    )
    drives: dict[str, float] = dataset("N or N m", "", "force or torque of the drive <name>")
    bearings: dict[str, RingAtRest] = group()


@record
class FrameInModes:
    """How a frame moves in the modes."""

    displacement: np.ndarray = dataset("m per unit", "mode × 3", "of its origin in global axes")
    rotation: np.ndarray = dataset("rad per unit", "mode × 3", "its turn about global axes")


@record
class StateSpace:
    """ẋ = A x + B Δu, Δy = C x + D Δu about the state at rest, x the modal coordinates and their rates."""

    A: np.ndarray = dataset("1/s", "state × state", "ẋ by x")
    B: np.ndarray = dataset("SI per unit of the load", "state × input", "ẋ by the loads")
    C: np.ndarray = dataset("SI per unit of x", "output × state", "readings by x")
    D: np.ndarray = dataset("SI per unit of the load", "output × input", "readings by the loads")
    inputs: tuple[str, ...] = dataset("1", "input", "names of the loads")
    outputs: tuple[str, ...] = dataset("1", "output", "sensors that see the state, with the number of the component")


@record
class Coupled:
    """modes.h5 of a bench: small motions about its start, M = 1."""

    frequency: np.ndarray = dataset("Hz", "mode", "undamped natural frequencies, 0 where nothing holds")
    damping: np.ndarray = dataset("1", "mode", "damping ratios")
    stiffness: np.ndarray = dataset("1/s^2", "mode", "ω², negative where the bench topples")
    shape: np.ndarray = dataset("SI per unit", "mode × coordinate", "shapes in the coordinates")
    q: np.ndarray = dataset("SI", "coordinate", "where it rests")
    growth: float = dataset("1/s", "", "rate of the motion by which that is left; 0: stable")
    coordinates: dict[str, np.ndarray] = dataset("1", "2", "first coordinate of <name> and the one after its last")
    frames: dict[str, FrameInModes] = group()
    eigenvalue: np.ndarray = dataset("1/s", "state × 2", "eigenvalues of A, real and imaginary")
    system: StateSpace = group()


FIVE = "[x, y, z, about y, about z]"


@record
class BearingCase:
    """A bearing in equilibrium under a load on its inner ring."""

    load: np.ndarray = dataset("N or N m", "5", f"load on the inner ring {FIVE}")
    displacement: np.ndarray = dataset("m or rad", "5", f"displacement of the inner ring {FIVE}")
    stiffness: np.ndarray = dataset("N/m to N m/rad", "5 × 5", "∂load/∂displacement")
    station: np.ndarray = dataset("rad", "/station", "station of every ball, from the y axis towards z")
    force: np.ndarray = dataset("N", "/station × 4", "contact force (ball × contact)")
    contact_angle: np.ndarray = dataset("rad", "/station × 4", "contact angle (ball × contact)")
    pressure: np.ndarray = dataset("Pa", "/station × 4", "peak contact pressure (ball × contact)")


@record
class BearingCurve:
    """Load over one displacement."""

    displacement: np.ndarray = dataset("<unit>", "/displacement", "one displacement of the inner ring, the others zero")
    load: np.ndarray = dataset("N or N m", "/displacement × 5", f"load that holds it there {FIVE}")


@dataclass(frozen=True)
class BearingDisplaced:
    """A bearing along one displacement, number `along` of the five."""

    bearing: str
    along: int
    curve: BearingCurve


@record
class BearingCases:
    """Load cases of one bearing."""

    cases: dict[str, BearingCase] = group(path="/<name>")


@record
class BearingCurves:
    """Curves of one bearing, by their number among all."""

    curves: dict[str, BearingCurve] = group(path="/<name>", unit="unit of <name>")


@record
class BearingsAlone:
    """bearing.h5, by bearing."""

    cases: dict[str, BearingCases] = group()
    curves: dict[str, BearingCurves] = group()


@record
class BenchTruths:
    """Every history begins in the state of the config at the start, with its loads."""

    time: np.ndarray = dataset("s", "/time", "time, the start first")
    begin: np.ndarray = dataset("s", "history", "instant of the load histories at which each begins")
    q: np.ndarray = dataset("SI", "/time × history × coordinate", "coordinates")
    v: np.ndarray = dataset("SI", "/time × history × coordinate", "their rates")
    inputs: dict[str, np.ndarray] = dataset("unit of input <name>", "/time × history", "load <name>")


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
    """What a bearing does by the estimate of the first run; omitted with a grid filter."""

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
