"""Artefacts of a bench (thesis 1.5-1.7, 2-4): bodies, equilibrium, modes, bearings, motion, surface fields (/VTKHDF), estimate,
layout."""

from __future__ import annotations

import numpy as np

from strainsight.fem.affine import AffineOperator
from strainsight.records.bearing import AT_FOUR_CONTACTS
from strainsight.records.estimated import Compared
from strainsight.records.record import dataset, group, record
from strainsight.records.reduced import AffineTerms
from strainsight.rom.inertia import InertiaInvariants

ABOUT_REST = "x: modal coordinates and their rates, Δu and Δy: changes of loads and readings from equilibrium"


@record
class WorstInstant:
    """Ball loads at the instant of the highest contact pressure."""

    time: float = dataset("s", "", "time of the highest contact pressure of the bearing")
    force: np.ndarray = dataset("N", "ball × 4", f"contact force {AT_FOUR_CONTACTS}, at `time`")
    contact_angle: np.ndarray = dataset("rad", "ball × 4", f"contact angle {AT_FOUR_CONTACTS}, at `time`")
    pressure: np.ndarray = dataset("Pa", "ball × 4", f"contact pressure {AT_FOUR_CONTACTS}, at `time`")


@record
class RingMotion:
    """Motion and load of a bearing."""

    displacement: np.ndarray = dataset(
        "m or rad",
        "/time × 5",
        "displacements along x, y, z and tilts about y, z of the inner ring relative to the outer ring, in the axes of the "
        "outer ring",
    )
    load: np.ndarray = dataset(
        "N or N m",
        "/time × 5",
        "forces along x, y, z and moments about y, z through the bearing centre, on the inner ring, in the axes of the outer "
        "ring",
    )
    pressure: np.ndarray = dataset("Pa", "/time", "highest contact pressure of the bearing at every instant")
    worst: WorstInstant = group()


@record
class DriveMotion:
    """Motion and force of a driven joint."""

    position: np.ndarray = dataset("m or rad", "/time", "position of the driven joint: angle, displacement or length")
    rate: np.ndarray = dataset("m/s or rad/s", "/time", "rate of the position of the driven joint")
    force: np.ndarray = dataset(
        "N or N m", "/time", "force or torque of the driven joint; force × rate: supplied power"
    )


@record
class Violation:
    position: np.ndarray = dataset("m or rad", "/time", "largest residual of the joint constraints at every instant")
    velocity: np.ndarray = dataset(
        "m/s or rad/s", "/time", "largest time derivative of the residuals of the joint constraints at every instant"
    )


@record
class Simulated:
    """simulate.h5."""

    time: np.ndarray = dataset("s", "/time", "time from the start of the run")
    q: np.ndarray = dataset("SI", "/time × coordinate", "generalised coordinates of all bodies")
    v: np.ndarray = dataset("SI", "/time × coordinate", "rates of the generalised coordinates of all bodies")
    violation: Violation = group()
    frequency: np.ndarray = dataset("Hz", "mode", "undamped natural frequencies of the bench at the start of the run")
    coordinates: dict[str, np.ndarray] = dataset(
        "1", "2", "entries of body <name> in q: first index, last index plus 1"
    )
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
    von_mises: np.ndarray = dataset("Pa", "/time", "largest von Mises stress on the surface in every stored field")
    moduli: dict[str, np.ndarray] = dataset(
        "Pa", "/time", "Young's modulus <name> used for the stress: the estimate, if <name> was estimated"
    )


SQUARE = "coordinate × coordinate"
IN_UNITS = "(units of the reduced coordinates: m, rad or m √kg)"


@record
class ReducedBody:
    """One body; interface: node id as text → its six motions."""

    clamped: bool = dataset("1", "", "1: body with supports in its mesh (clamped); 0: free body")
    frequency: np.ndarray = dataset("Hz", "mode", "fixed-interface natural frequencies")
    cut: float = dataset("Hz", "", "lowest natural frequency of the omitted fixed-interface modes")
    reach: dict[str, np.ndarray] = dataset(
        "Pa", "2", "range of modulus <name> in which static errors of the reduced body are below 1 %"
    )
    mass: np.ndarray = dataset("SI", SQUARE, f"reduced mass matrix {IN_UNITS}")
    stiffness: AffineOperator = group(AffineTerms, "SI", f"reduced stiffness matrix {IN_UNITS}")
    damping: AffineOperator = group(AffineTerms, "SI", f"reduced damping matrix {IN_UNITS}")
    basis: np.ndarray = dataset(
        "SI",
        "3 nodes × coordinate",
        "displacement [m] of the nodes in body axes, per unit of each reduced coordinate; row = 3 × node index + component "
        "(x: 0, y: 1, z: 2)",
    )
    interface: dict[str, np.ndarray] = dataset(
        "SI",
        "6 × coordinate",
        "translations [m] and rotations [rad] of node <name> in body axes, per unit of each reduced coordinate",
    )
    inertia: InertiaInvariants = group()


@record
class ReducedBodies:
    """reduce.h5."""

    bodies: dict[str, ReducedBody] = group()


@record
class FrameAtRest:
    """Pose of a frame."""

    position: np.ndarray = dataset("m", "3", "position of the origin of the frame in equilibrium, in global axes")
    axes: np.ndarray = dataset(
        "1", "3 × 3", "directions of the axes of the frame in equilibrium, in global axes, as columns"
    )


@record
class RingAtRest:
    """State of a bearing."""

    displacement: np.ndarray = dataset(
        "m or rad",
        "5",
        "displacements along x, y, z and tilts about y, z of the inner ring relative to the outer ring, in the axes of the "
        "outer ring",
    )
    load: np.ndarray = dataset(
        "N or N m",
        "5",
        "forces along x, y, z and moments about y, z through the bearing centre, on the inner ring, in the axes of the outer "
        "ring",
    )
    pressure: float = dataset("Pa", "", "highest contact pressure of the bearing")


@record
class AtRest:
    """statics.h5: equilibrium under the loads at t = 0."""

    q: np.ndarray = dataset("SI", "coordinate", "generalised coordinates of all bodies in equilibrium")
    growth: float = dataset(
        "1/s", "", "growth rate of the least stable motion about the equilibrium; 0: stable equilibrium"
    )
    coordinates: dict[str, np.ndarray] = dataset(
        "1", "2", "entries of body <name> in q: first index, last index plus 1"
    )
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

    displacement: np.ndarray = dataset(
        "kg^-1/2",
        "mode × 3",
        "displacement of the origin of the frame per unit of each modal coordinate, in global axes",
    )
    rotation: np.ndarray = dataset(
        "rad/(m kg^1/2)", "mode × 3", "rotation of the frame per unit of each modal coordinate, about global axes"
    )


@record
class StateSpace:
    """Linearised model ẋ = A x + B Δu, Δy = C x + D Δu about the equilibrium; x: modal coordinates and their rates."""

    A: np.ndarray = dataset("1/s", "state × state", f"state matrix A of ẋ = A x + B Δu; {ABOUT_REST}")
    B: np.ndarray = dataset("SI", "state × input", f"input matrix B of ẋ = A x + B Δu; {ABOUT_REST}")
    C: np.ndarray = dataset("SI", "output × state", f"output matrix C of Δy = C x + D Δu; {ABOUT_REST}")
    D: np.ndarray = dataset("SI", "output × input", f"feedthrough matrix D of Δy = C x + D Δu; {ABOUT_REST}")
    inputs: tuple[str, ...] = dataset("1", "input", "names of the loads in Δu")
    outputs: tuple[str, ...] = dataset("1", "output", "sensor and component number of every reading in Δy")


@record
class Coupled:
    """modes.h5 of a bench: small motions about the initial state, with M = 1."""

    frequency: np.ndarray = dataset("Hz", "mode", "undamped natural frequencies of the bench; 0: rigid-body motion")
    damping: np.ndarray = dataset("1", "mode", "damping ratios of the modes")
    stiffness: np.ndarray = dataset(
        "1/s^2", "mode", "square of the angular frequency of every mode; negative: unstable mode"
    )
    shape: np.ndarray = dataset(
        "SI",
        "mode × coordinate",
        "mode shapes: generalised coordinates of all bodies per unit of each modal coordinate",
    )
    q: np.ndarray = dataset("SI", "coordinate", "generalised coordinates of all bodies in equilibrium")
    growth: float = dataset(
        "1/s", "", "growth rate of the least stable motion about the equilibrium; 0: stable equilibrium"
    )
    coordinates: dict[str, np.ndarray] = dataset(
        "1", "2", "entries of body <name> in q: first index, last index plus 1"
    )
    frames: dict[str, FrameInModes] = group()
    eigenvalue: np.ndarray = dataset("1/s", "state × 2", "eigenvalues of the state matrix A: real and imaginary part")
    system: StateSpace = group()


@record
class BenchTruths:
    """Every history starts in the configured initial state, with its loads."""

    time: np.ndarray = dataset("s", "/time", "time from the start of the run")
    begin: np.ndarray = dataset("s", "history", "time in the configured loads at which each simulated history starts")
    q: np.ndarray = dataset("SI", "/time × history × coordinate", "generalised coordinates of all bodies")
    v: np.ndarray = dataset("SI", "/time × history × coordinate", "rates of the generalised coordinates of all bodies")
    inputs: dict[str, np.ndarray] = dataset("unit of input <name>", "/time × history", "load <name>")


@record
class LoadHistory:
    """An unknown load. true: simulated value; unscaled: value on the measured bench; smoothed: smoother of an extended filter
    that did not diverge; smoothed_std: only if the smoother is consistent."""

    estimate: np.ndarray = dataset("<unit>", "/time", "estimate of <what>")
    std: np.ndarray = dataset("<unit>", "/time", "standard deviation of the estimate of <what>")
    smoothed: np.ndarray | None = dataset(
        "<unit>", "/time", "smoothed estimate of <what>, from all samples", default=None
    )
    smoothed_std: np.ndarray | None = dataset(
        "<unit>", "/time", "standard deviation of the smoothed estimate of <what>", default=None
    )
    true: np.ndarray | None = dataset("<unit>", "/time", "true <what>", default=None)
    unscaled: np.ndarray | None = dataset("<unit>", "/time", "<what> of the bench in `measured.from`", default=None)


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
        "reading of <what>: with noise if the filter uses the sensor, otherwise without noise",
        default=None,
    )
    predicted: np.ndarray | None = dataset(
        "<unit>",
        "instant × component",
        "reading of <what>, predicted from the other channels; NaN: not predicted",
        default=None,
    )
    predicted_std: np.ndarray | None = dataset(
        "<unit>",
        "instant × component",
        "standard deviation of the difference between measured and predicted reading of <what>",
        default=None,
    )
    left_in: tuple[str, ...] | None = dataset(
        "1",
        "component",
        "reason why <what> could not be left out of the filter and predicted; empty: left out and predicted",
        default=None,
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

    time: float = dataset("s", "", "time of the highest contact pressure of the bearing")
    station: np.ndarray = dataset(
        "rad", "ball", "angular position of every ball about the bearing axis x, from the y axis towards the z axis"
    )
    force: np.ndarray = dataset("N", "ball × 4", f"contact force {AT_FOUR_CONTACTS}, at `time`")
    force_std: np.ndarray = dataset("N", "ball × 4", "standard deviation of every contact force")
    pressure: np.ndarray = dataset("Pa", "ball × 4", f"contact pressure {AT_FOUR_CONTACTS}, at `time`")
    pressure_std: np.ndarray = dataset("Pa", "ball × 4", "standard deviation of every contact pressure")


@record
class RingEstimate:
    """Estimated bearing motion and loads of the first run; missing with the grid filter."""

    displacement: np.ndarray = dataset(
        "m or rad",
        "/time × 5",
        "displacements along x, y, z and tilts about y, z of the inner ring relative to the outer ring, in the axes of the "
        "outer ring",
    )
    std: np.ndarray = dataset(
        "m or rad", "/time × 5", "standard deviation of every displacement and tilt of the inner ring"
    )
    instants: np.ndarray = dataset("s", "instant", "times at which the ball loads are evaluated")
    pressure: np.ndarray = dataset("Pa", "instant", "highest contact pressure of all balls at every instant")
    pressure_std: np.ndarray = dataset("Pa", "instant", "standard deviation of the highest contact pressure")
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
    q: np.ndarray = dataset("SI", "/time × coordinate", "estimated generalised coordinates of all bodies")
    violation: np.ndarray = dataset(
        "1",
        "/time",
        "largest residual of the joint constraints in the estimate, relative to the mass-weighted norm of the coordinates",
    )
    nis: np.ndarray = dataset(
        "1", "instant", "normalised innovation squared (NIS) at every instant, divided by the number of channels"
    )
    lost: np.ndarray = dataset("1", "run", "number of the time step in which the filter run diverged; −1: not diverged")
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
