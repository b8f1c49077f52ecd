"""Artefacts of a bench (thesis 1.5-1.7, 2-4): bodies, equilibrium, modes, bearings, motion, surface fields (/VTKHDF), estimate,
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
    """Ball loads at the instant of the highest contact pressure."""

    time: float = dataset("s", "", "time of the highest contact pressure")
    force: np.ndarray = dataset("N", "ball × 4", "contact force of every ball (ball × contact)")
    contact_angle: np.ndarray = dataset("rad", "ball × 4", "contact angle of every ball (ball × contact)")
    pressure: np.ndarray = dataset("Pa", "ball × 4", "contact pressure of every ball (ball × contact)")


@record
class RingMotion:
    """Motion and load of a bearing."""

    displacement: np.ndarray = dataset(
        "m or rad", "/time × 5", "displacement x, y, z and tilts about y, z of the inner ring"
    )
    load: np.ndarray = dataset("N or N m", "/time × 5", "force x, y, z and moments about y, z on the inner ring")
    pressure: np.ndarray = dataset("Pa", "/time", "highest contact pressure of the bearing at every instant")
    worst: WorstInstant = group()


@record
class DriveMotion:
    """Motion and force of a driven joint."""

    position: np.ndarray = dataset("m or rad", "/time", "position of the drive")
    rate: np.ndarray = dataset("m/s or rad/s", "/time", "rate of the drive")
    force: np.ndarray = dataset(
        "N or N m", "/time", "force or torque of the drive; force × rate is the power into the bench"
    )


@record
class Violation:
    position: np.ndarray = dataset("SI", "/time", "largest constraint violation at every instant")
    velocity: np.ndarray = dataset("SI", "/time", "largest rate of the constraint violation at every instant")


@record
class Simulated:
    """simulate.h5."""

    time: np.ndarray = dataset("s", "/time", "time from the start of the run")
    q: np.ndarray = dataset("SI", "/time × coordinate", "coordinates of all bodies")
    v: np.ndarray = dataset("SI", "/time × coordinate", "rates of the coordinates of all bodies")
    violation: Violation = group()
    frequency: np.ndarray = dataset("Hz", "mode", "undamped natural frequencies of the bench at the start")
    coordinates: dict[str, np.ndarray] = dataset("1", "2", "coordinates of <name>: first index, and last index plus 1")
    inputs: dict[str, np.ndarray] = dataset("unit of input <name>", "/time", "load <name>")
    sensors: dict[str, np.ndarray] = dataset(
        "unit of sensor <name>",
        "/time × component of <name>",
        "readings of <name>: strain of every gauge; x, y, z and tilts of a relative motion; x, y, z of a frame; "
        "force and moment of a joint",
    )
    bearings: dict[str, RingMotion] = group()
    drives: dict[str, DriveMotion] = group()


@record
class SurfaceHistory:
    """Data of field.h5 in addition to its grid."""

    time: np.ndarray = dataset("s", "/time", "time of every stored surface field")
    von_mises: np.ndarray = dataset("Pa", "/time", "largest von Mises stress of every stored surface field")
    moduli: dict[str, np.ndarray] = dataset(
        "Pa", "/time", "Young's modulus <name> used for the stress: the estimate, if <name> was estimated"
    )


SQUARE = "coordinate × coordinate"


@record
class ReducedBody:
    """One body; interface: node id as text → its six motions."""

    clamped: bool = dataset("1", "", "1 if the body has supports on the ground")
    frequency: np.ndarray = dataset("Hz", "mode", "fixed-interface natural frequencies")
    cut: float = dataset("Hz", "", "natural frequency of the first truncated mode")
    reach: dict[str, np.ndarray] = dataset(
        "Pa", "2", "range of modulus <name> in which static errors of the reduced body are below 1 %"
    )
    mass: np.ndarray = dataset("kg per unit^2", SQUARE, "reduced mass")
    stiffness: AffineOperator = group(AffineTerms, "N/m per unit^2", "reduced stiffness")
    damping: AffineOperator = group(AffineTerms, "N s/m per unit^2", "reduced damping")
    basis: np.ndarray = dataset(
        "m per unit", "3 nodes × coordinate", "displacement of the nodes per coordinate (row 3 node + component)"
    )
    interface: dict[str, np.ndarray] = dataset(
        "m or rad per unit", "6 × coordinate", "translations and rotations of node <name> per coordinate"
    )
    inertia: InertiaInvariants = group()


@record
class ReducedBodies:
    """reduce.h5."""

    bodies: dict[str, ReducedBody] = group()


@record
class FrameAtRest:
    """Pose of a frame."""

    position: np.ndarray = dataset("m", "3", "origin of the frame in global axes")
    axes: np.ndarray = dataset("1", "3 × 3", "axes of the frame in global axes, as columns")


@record
class RingAtRest:
    """State of a bearing."""

    displacement: np.ndarray = dataset("m or rad", "5", "displacement x, y, z and tilts about y, z of the inner ring")
    load: np.ndarray = dataset("N or N m", "5", "force x, y, z and moments about y, z on the inner ring")
    pressure: float = dataset("Pa", "", "highest contact pressure of the bearing")


@record
class AtRest:
    """statics.h5: equilibrium under the loads at t = 0."""

    q: np.ndarray = dataset("SI", "coordinate", "coordinates of all bodies")
    growth: float = dataset("1/s", "", "growth rate of the instability of the equilibrium; 0: stable")
    coordinates: dict[str, np.ndarray] = dataset("1", "2", "coordinates of <name>: first index, and last index plus 1")
    inputs: dict[str, float] = dataset("unit of input <name>", "", "load <name>")
    frames: dict[str, FrameAtRest] = group()
    sensors: dict[str, np.ndarray] = dataset("unit of sensor <name>", "component of <name>", "readings of <name>")
    reactions: dict[str, np.ndarray] = dataset(
        "N or N m",
        "6",
        "force and moment of joint <name> on its second frame about its origin, in the axes of the first frame",
    )
    drives: dict[str, float] = dataset("N or N m", "", "force or torque of the drive <name>")
    bearings: dict[str, RingAtRest] = group()


@record
class FrameInModes:
    """Motion of a frame in the modes."""

    displacement: np.ndarray = dataset("m per unit", "mode × 3", "displacement of the frame origin in global axes")
    rotation: np.ndarray = dataset("rad per unit", "mode × 3", "rotation of the frame about the global axes")


@record
class StateSpace:
    """Linearised model ẋ = A x + B Δu, Δy = C x + D Δu about the equilibrium; x: modal coordinates and their rates."""

    A: np.ndarray = dataset("1/s", "state × state", "state matrix: ẋ per x")
    B: np.ndarray = dataset("SI per unit of the load", "state × input", "input matrix: ẋ per load")
    C: np.ndarray = dataset("SI per unit of x", "output × state", "output matrix: readings per x")
    D: np.ndarray = dataset("SI per unit of the load", "output × input", "feedthrough matrix: readings per load")
    inputs: tuple[str, ...] = dataset("1", "input", "names of the loads")
    outputs: tuple[str, ...] = dataset(
        "1", "output", "names of the sensors that depend on the state, with component number"
    )


@record
class Coupled:
    """modes.h5 of a bench: small motions about the initial state, with M = 1."""

    frequency: np.ndarray = dataset("Hz", "mode", "undamped natural frequencies; 0: free motion")
    damping: np.ndarray = dataset("1", "mode", "damping ratios of the modes")
    stiffness: np.ndarray = dataset("1/s^2", "mode", "ω² of every mode; negative: unstable equilibrium")
    shape: np.ndarray = dataset("SI per unit", "mode × coordinate", "mode shapes in the coordinates of the bodies")
    q: np.ndarray = dataset("SI", "coordinate", "coordinates of all bodies in equilibrium")
    growth: float = dataset("1/s", "", "growth rate of the instability of the equilibrium; 0: stable")
    coordinates: dict[str, np.ndarray] = dataset("1", "2", "coordinates of <name>: first index, and last index plus 1")
    frames: dict[str, FrameInModes] = group()
    eigenvalue: np.ndarray = dataset("1/s", "state × 2", "eigenvalues of the state matrix A, real and imaginary part")
    system: StateSpace = group()


FIVE = "[x, y, z, about y, about z]"


@record
class BearingCase:
    """A bearing in equilibrium under a load on its inner ring."""

    load: np.ndarray = dataset("N or N m", "5", f"load on the inner ring {FIVE}")
    displacement: np.ndarray = dataset("m or rad", "5", f"displacement of the inner ring {FIVE}")
    stiffness: np.ndarray = dataset("N/m to N m/rad", "5 × 5", "stiffness of the bearing, ∂load/∂displacement")
    station: np.ndarray = dataset("rad", "/station", "angular position of every ball, from the y axis towards z")
    force: np.ndarray = dataset("N", "/station × 4", "contact force of every ball (ball × contact)")
    contact_angle: np.ndarray = dataset("rad", "/station × 4", "contact angle of every ball (ball × contact)")
    pressure: np.ndarray = dataset("Pa", "/station × 4", "peak contact pressure of every ball (ball × contact)")


@record
class BearingCurve:
    """Load as a function of one displacement."""

    displacement: np.ndarray = dataset(
        "<unit>", "/displacement", "varied displacement of the inner ring; other displacements are zero"
    )
    load: np.ndarray = dataset("N or N m", "/displacement × 5", f"load on the inner ring {FIVE}")


@dataclass(frozen=True)
class BearingDisplaced:
    """A bearing along one displacement, component `along` of five."""

    bearing: str
    along: int
    curve: BearingCurve


@record
class BearingCases:
    """Load cases of one bearing."""

    cases: dict[str, BearingCase] = group(path="/<name>")


@record
class BearingCurves:
    """Curves of one bearing, by curve number."""

    curves: dict[str, BearingCurve] = group(path="/<name>", unit="unit of <name>")


@record
class BearingResults:
    """bearing.h5, by bearing."""

    cases: dict[str, BearingCases] = group()
    curves: dict[str, BearingCurves] = group()


@record
class BenchTruths:
    """Every history starts in the configured initial state, with its loads."""

    time: np.ndarray = dataset("s", "/time", "time from the start of the run")
    begin: np.ndarray = dataset("s", "history", "start time of each history in the load histories")
    q: np.ndarray = dataset("SI", "/time × history × coordinate", "coordinates of all bodies")
    v: np.ndarray = dataset("SI", "/time × history × coordinate", "rates of the coordinates of all bodies")
    inputs: dict[str, np.ndarray] = dataset("unit of input <name>", "/time × history", "load <name>")


@record
class LoadHistory:
    """An unknown load. true: simulated value; there: value on the measured bench; smoothed: smoother of an extended filter that
    did not diverge; smoothed_std: only if the smoother is consistent."""

    estimate: np.ndarray = dataset("<unit>", "/time", "estimate of <what>")
    std: np.ndarray = dataset("<unit>", "/time", "standard deviation of the estimate of <what>")
    smoothed: np.ndarray | None = dataset(
        "<unit>", "/time", "smoothed estimate of <what>, from all samples", default=None
    )
    smoothed_std: np.ndarray | None = dataset(
        "<unit>", "/time", "standard deviation of the smoothed estimate of <what>", default=None
    )
    true: np.ndarray | None = dataset("<unit>", "/time", "true <what>", default=None)
    unscaled: np.ndarray | None = dataset("<unit>", "/time", "<what> on the measured bench", default=None)


@record
class ParameterHistory:
    estimate: np.ndarray = dataset("<unit>", "/time", "estimate of <what>")
    std: np.ndarray = dataset("<unit>", "/time", "standard deviation of the estimate of <what>")
    true: float | None = dataset("<unit>", "", "true value of <what>", default=None)


@record
class SensorMatch:
    """A sensor and its estimate; for a sensor that the filter does not use, measured is the true reading."""

    used: bool = dataset("1", "", "1 if the filter uses <what>")
    expected: np.ndarray = dataset("<unit>", "instant × component", "estimated reading of <what>")
    measured: np.ndarray | None = dataset(
        "<unit>",
        "instant × component",
        "reading of <what>: with noise if the filter uses the sensor, otherwise true",
        default=None,
    )
    predicted: np.ndarray | None = dataset(
        "<unit>",
        "instant × component",
        "reading of <what>, predicted from the other channels; NaN: not predicted",
        default=None,
    )
    predicted_std: np.ndarray | None = dataset(
        "<unit>", "instant × component", "standard deviation of the measured minus the predicted reading", default=None
    )
    left_in: tuple[str, ...] | None = dataset(
        "1", "component", "reason why <what> was not predicted from the other channels; empty: predicted", default=None
    )
    bias: np.ndarray | None = dataset(
        "<unit>", "component", "final estimate of the offset of <what>; 0: no offset", default=None
    )
    bias_std: np.ndarray | None = dataset(
        "<unit>", "component", "standard deviation of the estimated offset of <what>", default=None
    )


@record
class BallsThen:
    """Ball loads at the instant of the highest estimated contact pressure."""

    time: float = dataset("s", "", "time of the highest contact pressure")
    station: np.ndarray = dataset("rad", "ball", "angular position of every ball")
    force: np.ndarray = dataset("N", "ball × 4", "contact force of every ball (ball × contact)")
    force_std: np.ndarray = dataset("N", "ball × 4", "standard deviation of the contact force")
    pressure: np.ndarray = dataset("Pa", "ball × 4", "contact pressure of every ball (ball × contact)")
    pressure_std: np.ndarray = dataset("Pa", "ball × 4", "standard deviation of the contact pressure")


@record
class RingEstimate:
    """Estimated bearing motion and loads of the first run; missing with the grid filter."""

    displacement: np.ndarray = dataset(
        "m or rad", "/time × 5", "displacement x, y, z and tilts about y, z of the inner ring"
    )
    std: np.ndarray = dataset("m or rad", "/time × 5", "standard deviation of the displacement of the inner ring")
    instants: np.ndarray = dataset("s", "picture", "times at which the ball loads were evaluated")
    pressure: np.ndarray = dataset("Pa", "picture", "highest contact pressure of all balls")
    pressure_std: np.ndarray = dataset("Pa", "picture", "standard deviation of the highest contact pressure")
    worst: BallsThen = group()


@record
class LoadRuns:
    error: np.ndarray = dataset("<unit>", "run", "RMS error of <what> over the second half of every run")


@record
class ParameterRuns:
    start: np.ndarray = dataset("<unit>", "run", "initial value of <what>")
    estimate: np.ndarray = dataset("<unit>", "run", "final estimate of <what>")
    std: np.ndarray = dataset("<unit>", "run", "standard deviation of the final estimate of <what>")
    error: np.ndarray | None = dataset("<unit>", "run", "final estimate minus true value of <what>", default=None)


@record
class BenchEstimated:
    """estimate.h5 of a bench."""

    time: np.ndarray = dataset("s", "/time", "time from the start of the run")
    q: np.ndarray = dataset("SI", "/time × coordinate", "estimated coordinates of all bodies")
    violation: np.ndarray = dataset("1", "/time", "largest relative constraint violation of the estimate")
    nis: np.ndarray = dataset("1", "instant", "normalised innovation squared (NIS), divided by the number of channels")
    lost: np.ndarray = dataset("1", "run", "time step in which the run diverged; −1: not diverged")
    inputs: dict[str, LoadHistory] = group(unit="unit of input <name>", what="<name>")
    parameters: dict[str, ParameterHistory] = group(unit="unit of parameter <name>", what="<name>")
    sensors: dict[str, SensorMatch] = group(unit="unit of sensor <name>", what="<name>")
    input_runs: dict[str, LoadRuns] = group(path="/runs/inputs/<name>", unit="unit of input <name>", what="<name>")
    parameter_runs: dict[str, ParameterRuns] = group(
        path="/runs/parameters/<name>", unit="unit of parameter <name>", what="<name>"
    )
    seeds: dict[str, np.ndarray] = dataset(
        "SI", "seed", "summary value <name> of every seed; missing for a single seed", path="/runs/numbers/<name>"
    )
    bearings: dict[str, RingEstimate] = group()
    compared: Compared | None = group(default=None)


PLACED = "place"
"""Name of the placed layout; random layouts are random-1, random-2 …"""


@record
class BenchCandidates:
    position: np.ndarray = dataset("m", "candidate × 3", "position of every candidate")
    direction: np.ndarray = dataset("1", "candidate × 3", "measuring direction of every candidate")
    element: np.ndarray = dataset("1", "candidate", "element id of every candidate in the deck")
    facet: np.ndarray = dataset("1", "candidate", "facet number of every candidate in its element, from 1")
    response: np.ndarray = dataset(
        "(strain or m or m/s^2)/SI", "candidate × /inputs", "static reading per unit of every unknown"
    )


@record
class BenchLayout:
    """One layout with its gauges in order."""

    candidate: np.ndarray = dataset("1", "gauge", "candidate number of every gauge")
    sensor: tuple[str, ...] = dataset(
        "1", "gauge", "SENSOR.AXIS for a sensor component of the bench; empty for a gauge"
    )
    position: np.ndarray = dataset("m", "gauge × 3", "position of every gauge")
    direction: np.ndarray = dataset("1", "gauge × 3", "measuring direction of every gauge")
    length: np.ndarray = dataset("m", "gauge", "grid length of every gauge; 0: strain at the grid centre")
    metric: float = dataset(
        "1", "", "<what> of the layout; inf: an unknown is unobservable; NaN: not solved accurately"
    )
    std: np.ndarray = dataset(
        "SI",
        "/inputs",
        "steady-state σ of every load, σ of every parameter at the end of the run; inf: unobservable load; "
        "NaN: not solved accurately",
    )
    without: np.ndarray = dataset("SI", "gauge × /inputs", "σ of every unknown without each gauge")

    @property
    def bonded(self) -> np.ndarray:
        """Whether an entry is a gauge on the body (gauges,)."""
        return np.array([not name for name in self.sensor], dtype=bool)


@record
class BenchPlaced(PlacedLayout):
    """place.h5 of a bench. The state is (η, η̇, u, ξ) about the static equilibrium: modal coordinates of the constrained motion,
    their rates, unknown inputs, scaled parameters."""

    inputs: tuple[str, ...] = dataset("1", "/inputs", "names of the unknowns, inputs before parameters")
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
