"""field.h5: the surface of a flexible body in time; the pictures themselves are its /VTKHDF group."""

from __future__ import annotations

import numpy as np

from strainsight.records.record import dataset, record


@record
class SurfaceInTime:
    """field.h5 beside its grid."""

    time: np.ndarray = dataset("/time", "s", "/time", "instants of the pictures")
    von_mises: np.ndarray = dataset("/von_mises", "Pa", "/time", "largest von Mises stress of every picture")
    moduli: dict[str, np.ndarray] = dataset(
        "/moduli/<name>", "Pa", "/time", "Young's modulus <name> that the stress is of; as estimated, where it was"
    )
