"""Results of a bearing alone: load cases and load curves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.records.record import dataset, group, record

ALONG_XYZ_ABOUT_YZ = "[x, y, z, about y, about z]"
AT_FOUR_CONTACTS = (
    "of every ball at the contacts inner left, inner right, outer left, outer right (left: towards negative x)"
)


@record
class BearingCase:
    """A bearing in equilibrium under a load on its inner ring."""

    load: np.ndarray = dataset("N or N m", "5", f"forces and moments on the inner ring {ALONG_XYZ_ABOUT_YZ}")
    displacement: np.ndarray = dataset(
        "m or rad", "5", f"displacements and tilts of the inner ring {ALONG_XYZ_ABOUT_YZ}, relative to the outer ring"
    )
    stiffness: np.ndarray = dataset(
        "(N or N m)/(m or rad)", "5 × 5", "stiffness matrix of the bearing, ∂load/∂displacement"
    )
    station: np.ndarray = dataset(
        "rad", "/station", "angular position of every ball about the bearing axis x, from the y axis towards the z axis"
    )
    force: np.ndarray = dataset("N", "/station × 4", f"contact force {AT_FOUR_CONTACTS}")
    contact_angle: np.ndarray = dataset("rad", "/station × 4", f"contact angle {AT_FOUR_CONTACTS}")
    pressure: np.ndarray = dataset("Pa", "/station × 4", f"peak contact pressure {AT_FOUR_CONTACTS}")


@record
class BearingCurve:
    """Load as a function of one displacement."""

    displacement: np.ndarray = dataset(
        "<unit>",
        "/displacement",
        "varied displacement or tilt of the inner ring; the other displacements and tilts are zero",
    )
    load: np.ndarray = dataset(
        "N or N m", "/displacement × 5", f"forces and moments on the inner ring {ALONG_XYZ_ABOUT_YZ}"
    )


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
