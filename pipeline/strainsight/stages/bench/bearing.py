"""bearing: every bearing alone, as bearing engineers look at it (thesis 1.18-1.25)."""

from __future__ import annotations

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.bodies import BearingConfig
from strainsight.experiment.bench.bearings import bearings_of, beyond_limit, displacement_curves, load_cases
from strainsight.multibody.bearing.geometry import Bearing
from strainsight.pages.bench.bearing_page import (
    CASE_HEAD,
    CONTACTS,
    DISPLACEMENT_UNITS,
    LoadedBearing,
    bearing_page,
    case_rows,
)
from strainsight.records.bearing import BearingCases, BearingCurve, BearingCurves, BearingResults
from strainsight.records.record import written
from strainsight.runner.output import Output, Scalar, Table, warnings_table
from strainsight.runner.stage import Context, Stage


def run(context: Context[BearingConfig | BenchConfig]) -> Output:
    """Load-displacement curves, and for every load case the displacement, the stiffness and what each ball carries."""
    config = context.config
    bearings = bearings_of(config.bearings)
    under, along = load_cases(bearings, config.cases), displacement_curves(bearings, config.curves)
    curves: dict[str, dict[str, BearingCurve]] = {name: {} for name in bearings}
    for i, entry in enumerate(along):
        curves[entry.bearing][str(i)] = entry.curve
    alone = BearingResults(
        cases={name: BearingCases(cases=states) for name, states in under.items()},
        curves={name: BearingCurves(curves=of_bearing) for name, of_bearing in curves.items()},
    )
    units = {str(i): DISPLACEMENT_UNITS[entry.along] for i, entry in enumerate(along)}
    cases = [LoadedBearing(name, case, state) for name, states in under.items() for case, state in states.items()]
    page = bearing_page(config.name, {name: _facts(b) for name, b in bearings.items()}, cases, along).encode()
    summary: dict[str, Scalar] = {}
    for case in cases:
        name = f"{case.bearing}.{case.case}"
        summary |= {f"pressure.{name}": case.pressure, f"loaded.{name}": case.loaded}
    counts = ((len(bearings), "bearing"), (len(cases), "load case"), (len(along), "curve"))
    text = ", ".join(f"{count} {what}{'s' * (count != 1)}" for count, what in counts)
    if cases:
        worst = max(cases, key=lambda case: case.pressure)
        text += f"; highest contact pressure {worst.pressure / 1e6:.0f} MPa (bearing {worst.bearing}, load case {worst.case})"
    warnings = [
        words for case in cases for words in beyond_limit(case.title, case.pressure, config.bearings[case.bearing])
    ]
    tables = (*_tables(cases), *warnings_table(warnings))
    return Output(written(alone, units), summary, text, tables, files={"bearing.html": page})


def _facts(bearing: Bearing) -> str:
    radii = ", ".join(f"{1e3 * r:.5g}" for r in bearing.radii)
    return (
        f"{bearing.balls} balls of {1e3 * bearing.ball_diameter:.5g} mm, pitch diameter {1e3 * bearing.pitch_diameter:.6g} mm, "
        f"contact angle {np.rad2deg(bearing.contact_angle):.4g}°, groove radii {radii} mm, preload {1e6 * bearing.preload:.4g} µm"
    )


def _tables(cases: list[LoadedBearing]) -> tuple[Table, ...]:
    tables = []
    for case in cases:
        rows = [
            (name, *(f"{value:.{digits}g} {unit}".rstrip() for value, unit, digits in cells))
            for name, cells in case_rows(case)
        ]
        tables.append(Table(case.title, CASE_HEAD, tuple(rows), answer=True))
        force, angle = case.state.force, np.rad2deg(case.state.contact_angle)
        rows_of_balls = [
            (
                contact,
                f"{force[:, i].max():.5g} N",
                f"{case.state.pressure[:, i].max() / 1e6:.5g} MPa",
                f"{angle[np.argmax(force[:, i]), i]:.4g}°" if force[:, i].max() > 0 else "–",
            )
            for i, contact in enumerate(CONTACTS)
        ]
        title = f"ball loads of {case.title}: {case.loaded} of {len(case.state.station)} balls loaded"
        tables.append(
            Table(
                title,
                ("contact", "largest ball force", "largest contact pressure", "contact angle at largest ball force"),
                tuple(rows_of_balls),
            )
        )
    return tuple(tables)


BEARING = Stage("bearing", version=4, reads=("name", "bearings", "cases", "curves"), upstream=(), files=(), run=run)
