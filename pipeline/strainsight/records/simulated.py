"""A bench in time (thesis 1.5-1.7): simulate.h5, and field.h5 of the surface of a flexible body, whose pictures are /VTKHDF."""

from __future__ import annotations

import numpy as np

from strainsight.records.record import dataset, group, record


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
