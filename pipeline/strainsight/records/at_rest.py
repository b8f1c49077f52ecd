"""A bench at rest: statics.h5, and modes.h5 of a bench, whose grid is /VTKHDF."""

from __future__ import annotations

import numpy as np

from strainsight.records.record import dataset, group, record


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
