"""bearing.h5: bearings alone; contacts in the order inner left, inner right, outer left, outer right (thesis 1.18-1.25)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.records.record import dataset, group, record

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
class Displaced:
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
