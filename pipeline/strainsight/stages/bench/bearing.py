"""bearing: every bearing alone, as bearing engineers look at it (thesis 1.18-1.25)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from strainsight.cases.bench.bench import bearing_of
from strainsight.errors import StrainsightError, blame
from strainsight.multibody.bearing.element import ball_loads, bearing_load
from strainsight.multibody.bearing.equilibrium import displacement
from strainsight.multibody.bearing.geometry import Bearing
from strainsight.report.bench.bearing_page import (
    CASE_HEAD,
    CONTACTS,
    DISPLACEMENT_UNITS,
    DISPLACEMENTS,
    BearingCase,
    BearingCurve,
    bearing_page,
    case_rows,
)
from strainsight.workflow.output import Dataset, Output, Scalar, Table
from strainsight.workflow.stage import Context, Stage

ALONG = ("x", "y", "z", "tilt_y", "tilt_z")
USUAL_REACH, USUAL_POINTS = 1e-4, 41
"""[m] of the curves where the config asks for none: at the pitch circle, whether it slides or tilts."""


def run(context: Context) -> Output:
    """Load-displacement curves, and for every load case the displacement, the stiffness and what each ball carries."""
    config = context.config
    bearings: dict[str, Bearing] = {}
    for name, entry in config.bearings.items():
        with blame(f"bearings.{name}"):
            bearings[name] = bearing_of(entry)
    cases, curves = list(_cases(config, bearings)), list(_curves(config, bearings))
    page = bearing_page(config.name, {name: _facts(b) for name, b in bearings.items()}, cases, curves).encode()
    datasets: dict[str, Dataset] = {}
    summary: dict[str, Scalar] = {}
    for case in cases:
        datasets |= _case_datasets(case)
        summary[f"pressure.{case.bearing}.{case.case}"] = float(case.pressure.max())
        summary[f"loaded.{case.bearing}.{case.case}"] = int((case.force > 0).any(axis=1).sum())
    for i, curve in enumerate(curves):
        place = f"/curves/{curve.bearing}/{i}"
        unit = DISPLACEMENT_UNITS[curve.along]
        datasets[f"{place}/displacement"] = Dataset(
            curve.displacement, unit, f"displacement {DISPLACEMENTS[curve.along]} of the inner ring, the others zero"
        )
        datasets[f"{place}/load"] = Dataset(
            curve.load,
            "N or N m",
            "load that holds it there (point × [x, y, z, about y, about z])",
            (f"{place}/displacement", ""),
        )
    worst = max(cases, key=lambda case: float(case.pressure.max()), default=None)
    counts = ((len(bearings), "bearing"), (len(cases), "load case"), (len(curves), "curve"))
    said = ", ".join(f"{count} {what}{'s' * (count != 1)}" for count, what in counts)
    if worst is not None:
        said += f"; at most {worst.pressure.max() / 1e6:.0f} MPa ({worst.bearing}, {worst.case})"
    return Output(datasets=datasets, summary=summary, message=said, tables=_tables(cases), files={"bearing.html": page})


def _cases(config: Any, bearings: Mapping[str, Bearing]) -> Iterator[BearingCase]:
    for name, bearing in bearings.items():
        for case, entry in config.cases.items():
            if not _is_of(name, entry):
                continue
            load = np.array([*entry.force, *entry.moment], dtype=float)
            try:
                q = displacement(bearing, load)
            except StrainsightError as error:
                # a case may be of several bearings
                what = f"'{name}': {error.what}"
                raise type(error)(what, key=f"cases.{case}", remedy=error.remedy) from error
            found, balls = bearing_load(bearing, q), ball_loads(bearing, q)
            yield BearingCase(
                name, case, found.force, q, found.tangent, balls.angle, balls.force, balls.contact_angle, balls.pressure
            )


def _curves(config: Any, bearings: Mapping[str, Bearing]) -> Iterator[BearingCurve]:
    for name, bearing in bearings.items():
        half = bearing.pitch_diameter / 2
        asked = [
            (f"curves.{i}", ALONG.index(curve.along), curve.reach, int(curve.points))
            for i, curve in enumerate(config.curves)
            if _is_of(name, curve)
        ]
        if not config.curves:
            usual = ((along, USUAL_REACH if along < 3 else USUAL_REACH / half) for along in (0, 1, 3))
            asked = [(f"bearings.{name}", along, reach, USUAL_POINTS) for along, reach in usual]
        for key, along, reach, points in asked:
            over = np.linspace(-reach, reach, points)
            q = np.zeros((points, 5))
            q[:, along] = over
            with blame(key):
                load = np.array([bearing_load(bearing, row, slopes=False).force for row in q])
            yield BearingCurve(name, along, over, load)


def _is_of(name: str, entry: Any) -> bool:
    """Whether a load case or a curve is of this bearing; null means every one."""
    chosen = entry.bearing
    return chosen is None or name in ((chosen,) if isinstance(chosen, str) else chosen)


def _facts(bearing: Bearing) -> str:
    radii = ", ".join(f"{1e3 * r:.5g}" for r in bearing.radii)
    return (
        f"{bearing.balls} balls of {1e3 * bearing.ball_diameter:.5g} mm on {1e3 * bearing.pitch_diameter:.6g} mm, contact angle "
        f"{np.rad2deg(bearing.contact_angle):.4g}°, groove radii {radii} mm, preload {1e6 * bearing.preload:.4g} µm"
    )


def _case_datasets(case: BearingCase) -> dict[str, Dataset]:
    place = f"/cases/{case.bearing}/{case.case}"
    scales = (f"{place}/station", "")
    return {
        f"{place}/load": Dataset(case.load, "N or N m", "load on the inner ring [x, y, z, about y, about z]"),
        f"{place}/displacement": Dataset(case.displacement, "m or rad", "its displacement [x, y, z, about y, about z]"),
        f"{place}/stiffness": Dataset(case.stiffness, "N/m to N m/rad", "∂load/∂displacement"),
        f"{place}/station": Dataset(case.station, "rad", "station of every ball, from the y axis towards z"),
        f"{place}/force": Dataset(
            case.force, "N", "contact force (ball × [inner left, inner right, outer left, outer right])", scales
        ),
        f"{place}/contact_angle": Dataset(case.angle, "rad", "contact angle (ball × contact)", scales),
        f"{place}/pressure": Dataset(case.pressure, "Pa", "peak contact pressure (ball × contact)", scales),
    }


def _tables(cases: list[BearingCase]) -> tuple[Table, ...]:
    tables = []
    for case in cases:
        rows = [
            (name, *(f"{value:.{digits}g} {unit}".rstrip() for value, unit, digits in cells))
            for name, cells in case_rows(case)
        ]
        tables.append(Table(f"{case.bearing} under {case.case}", CASE_HEAD, tuple(rows)))
        loaded = int((case.force > 0).any(axis=1).sum())
        rows_of_balls = [
            (
                contact,
                f"{case.force[:, i].max():.5g} N",
                f"{case.pressure[:, i].max() / 1e6:.5g} MPa",
                f"{np.rad2deg(case.angle[np.argmax(case.force[:, i]), i]):.4g}°" if case.force[:, i].max() > 0 else "–",
            )
            for i, contact in enumerate(CONTACTS)
        ]
        title = f"the balls of {case.bearing} under {case.case}: {loaded} of {len(case.station)} loaded"
        tables.append(Table(title, ("contact", "largest force", "pressure", "angle there"), tuple(rows_of_balls)))
    return tuple(tables)


BEARING = Stage("bearing", version=1, reads=("name", "bearings", "cases", "curves"), upstream=(), files=(), run=run)
