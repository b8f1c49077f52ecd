"""Single bearings: equilibrium under load cases, and load-displacement curves (thesis 1.18-1.25)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.bodies import BearingSection, CurveSection, LoadCase
from strainsight.config.bench.connections import BearingForce
from strainsight.errors import StrainsightError, blame
from strainsight.multibody.bearing.element import ball_loads, bearing_load, displacement
from strainsight.multibody.bearing.geometry import Bearing
from strainsight.records.bearing import BearingCase, BearingCurve, BearingDisplaced
from strainsight.records.record import record_from

ALONG = ("x", "y", "z", "tilt_y", "tilt_z")
USUAL_REACH, USUAL_POINTS = 1e-4, 41
"""Default range [m], at the pitch circle, and number of points of the curves."""


def bearings_of(sections: Mapping[str, BearingSection]) -> dict[str, Bearing]:
    """Bearings of a config, by name; converts degrees."""
    bearings = {}
    for name, entry in sections.items():
        values = dict(entry) | {key: np.deg2rad(getattr(entry, key)) for key in ("contact_angle", "first_ball")}
        del values["pressure_limit"]
        with blame(f"bearings.{name}"):
            bearings[name] = Bearing(**values)
    return bearings


def overloaded(config: BenchConfig, pressure: Mapping[str, float]) -> list[str]:
    """Warnings about bearing forces, by name, with a contact pressure [Pa] above the limit."""
    warnings = []
    for name, highest in pressure.items():
        force = config.forces[name]
        assert isinstance(force, BearingForce)
        warnings += beyond_limit(name, highest, config.bearings[force.bearing])
    return warnings


def beyond_limit(what: str, pressure: float, bearing: BearingSection) -> list[str]:
    """Warning if the pressure [Pa] exceeds the limit of the bearing."""
    if pressure <= bearing.pressure_limit:
        return []
    return [
        f"the contact pressure of {what} is {pressure / 1e6:.4g} MPa, above the limit of {bearing.pressure_limit / 1e6:.4g} MPa, "
        "so plastic deformation is likely and the elastic contact model is not valid. Correct bearing size, preload or "
        "loads, or increase `pressure_limit` of the bearing"
    ]


def load_cases(bearings: Mapping[str, Bearing], cases: Mapping[str, LoadCase]) -> dict[str, dict[str, BearingCase]]:
    """Bearing → load case → equilibrium, for the bearings of each case."""
    return {
        name: {case: _load_case(name, bearing, case, entry) for case, entry in cases.items() if entry.includes(name)}
        for name, bearing in bearings.items()
    }


def _load_case(name: str, bearing: Bearing, case: str, entry: LoadCase) -> BearingCase:
    load = np.array([*entry.force, *entry.moment], dtype=float)
    try:
        q = displacement(bearing, load)
    except StrainsightError as error:
        # a case may be of several bearings
        raise type(error)(f"'{name}': {error.what}", key=f"cases.{case}", remedy=error.remedy) from error
    state, balls = bearing_load(bearing, q), ball_loads(bearing, q)
    return record_from(
        BearingCase, balls, load=state.force, displacement=q, stiffness=state.tangent, station=balls.angle
    )


def displacement_curves(bearings: Mapping[str, Bearing], curves: Sequence[CurveSection]) -> list[BearingDisplaced]:
    """Load-displacement curves of every bearing; by default axial, radial and tilting."""
    each = []
    for name, bearing in bearings.items():
        for key, along, reach, points in _curves(name, bearing, curves):
            over = np.linspace(-reach, reach, points)
            q = np.zeros((points, 5))
            q[:, along] = over
            with blame(key):
                load = np.array([bearing_load(bearing, row, slopes=False).force for row in q])
            each.append(BearingDisplaced(name, along, BearingCurve(displacement=over, load=load)))
    return each


def _curves(name: str, bearing: Bearing, curves: Sequence[CurveSection]) -> list[tuple[str, int, float, int]]:
    """Config key, displacement index, range [m or rad] and number of points of every curve of a bearing."""
    if not curves:
        half = bearing.pitch_diameter / 2
        usual = ((along, USUAL_REACH if along < 3 else USUAL_REACH / half) for along in (0, 1, 3))
        return [(f"bearings.{name}", along, reach, USUAL_POINTS) for along, reach in usual]
    return [
        (f"curves.{i}", ALONG.index(curve.along), curve.reach, curve.points)
        for i, curve in enumerate(curves)
        if curve.includes(name)
    ]
