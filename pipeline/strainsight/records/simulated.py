"""A bench in time (thesis 1.5-1.7): simulate.h5, and field.h5 of the surface of a flexible body, whose pictures are /VTKHDF."""

from __future__ import annotations

import numpy as np

from strainsight.records.record import dataset, group, record


@record
class WorstInstant:
    """The balls at the instant of the highest contact pressure."""

    time: float = dataset("/time", "s", "", "instant of the highest pressure")
    force: np.ndarray = dataset("/force", "N", "ball × 4", "contact force then (ball × contact)")
    contact_angle: np.ndarray = dataset("/contact_angle", "rad", "ball × 4", "contact angle then (ball × contact)")
    pressure: np.ndarray = dataset("/pressure", "Pa", "ball × 4", "contact pressure then (ball × contact)")


@record
class RingMotion:
    """What a bearing does."""

    displacement: np.ndarray = dataset(
        "/displacement", "m or rad", "/time × 5", "x, y, z, tilts about y, z of the inner ring"
    )
    load: np.ndarray = dataset("/load", "N or N m", "/time × 5", "load on the inner ring")
    pressure: np.ndarray = dataset("/pressure", "Pa", "/time", "highest contact pressure at every instant")
    worst: WorstInstant = group("/worst")


@record
class DriveMotion:
    """What a driven joint does."""

    position: np.ndarray = dataset("/position", "m or rad", "/time", "where it is")
    rate: np.ndarray = dataset("/rate", "m/s or rad/s", "/time", "how fast it moves")
    force: np.ndarray = dataset(
        "/force", "N or N m", "/time", "force or torque along it, by which it does the work force × rate on the bench"
    )


@record
class Violation:
    position: np.ndarray = dataset("/position", "SI", "/time", "largest constraint violation at every instant")
    velocity: np.ndarray = dataset("/velocity", "SI", "/time", "largest rate of one")


@record
class Simulated:
    """simulate.h5."""

    time: np.ndarray = dataset("/time", "s", "/time", "time, the start first")
    q: np.ndarray = dataset("/q", "SI", "/time × coordinate", "coordinates")
    v: np.ndarray = dataset("/v", "SI", "/time × coordinate", "their rates")
    violation: Violation = group("/violation")
    frequency: np.ndarray = dataset(
        "/frequency", "Hz", "mode", "undamped frequencies of the coupled bench at the start"
    )
    coordinates: dict[str, np.ndarray] = dataset(
        "/coordinates/<name>", "1", "2", "first coordinate of <name> and the one after its last"
    )
    inputs: dict[str, np.ndarray] = dataset("/inputs/<name>", "unit of input <name>", "/time", "load <name>")
    sensors: dict[str, np.ndarray] = dataset(
        "/sensors/<name>",
        "unit of sensor <name>",
        "/time × component of <name>",
        "readings of <name>: strain of every gauge; x, y, z and tilts about y, z of a relative motion; x, y, z of a frame; "
        "force and moment of a joint",
    )
    bearings: dict[str, RingMotion] = group("/bearings/<name>")
    drives: dict[str, DriveMotion] = group("/drives/<name>")


@record
class SurfaceInTime:
    """field.h5 beside its grid."""

    time: np.ndarray = dataset("/time", "s", "/time", "instants of the pictures")
    von_mises: np.ndarray = dataset("/von_mises", "Pa", "/time", "largest von Mises stress of every picture")
    moduli: dict[str, np.ndarray] = dataset(
        "/moduli/<name>", "Pa", "/time", "Young's modulus <name> that the stress is of; as estimated, where it was"
    )
