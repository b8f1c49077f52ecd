"""The page of one run of a bench: what was estimated and how well, what it rests on, how the bench moved."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

from strainsight.pages.bench.bearing_page import balls_figures
from strainsight.pages.bench.data import BenchRun, BenchUnknown
from strainsight.pages.bench.figures import (
    components_figure,
    consistency_figure,
    ratio_figure,
    runs_figure,
    unknown_figure,
)
from strainsight.pages.bench.motion import bearing_figures, drive_figure, loads_figure, random_figure, stress_figure
from strainsight.pages.bench.tables import bench_answer, mismatch_table, placement_table, runs_table, too_high
from strainsight.pages.chart.drawing import Drawing
from strainsight.pages.page.markup import bullets, figure, figures, measure, picture, plain, table
from strainsight.pages.page.sections import advice_card, document, panel, rests_on, section
from strainsight.pages.placement.figures import trend_figure
from strainsight.pages.placement.first import headline
from strainsight.pages.placement.gauge_table import criteria_meaning, criteria_table
from strainsight.pages.tested.figures import hold_out_figures, hold_out_section

STYLE = "bench/bench.css"
FOOTER = (
    "σ is one standard deviation. Errors and claimed σ of a bench are relative: of a load to its largest true value, of a "
    "parameter to its true value. Bearings are quasi-static after Hertz, their rings rigid but for the contacts."
)


def bench_figures(run: BenchRun) -> dict[str, tuple[Drawing, ...]]:
    """Section of the page → its figures: "unknowns", "sensors", "hold-out", "placement", "motion"."""
    found: dict[str, tuple[Drawing, ...]] = {}
    if (estimate := run.estimate) is not None:
        found["unknowns"] = tuple(
            unknown_figure(f"unknown-{i}", _title(unknown), unknown.kind, [("", unknown.history)])
            for i, unknown in enumerate(estimate.unknowns)
        )
        found["unknowns"] += tuple(
            ratio_figure(f"ratio-{i}", f"{unknown.name}: ratio of the loads", [("", unknown)])
            for i, unknown in enumerate(estimate.unknowns)
            if unknown.there is not None
        )
        found["unknowns"] += tuple(
            drawn for name, ring in estimate.bearings.items() for drawn in balls_figures(name, ring)
        )
        found["unknowns"] += tuple(runs_figure(unknown) for unknown in estimate.unknowns if unknown.errors is not None)
        found["sensors"] = tuple(
            components_figure(f"sensor-{i}", f"{sensor.name}: measured against estimated", sensor)
            for i, sensor in enumerate(estimate.sensors)
        )
        found["sensors"] += (consistency_figure(estimate, run.number("expected_nis")),)
        found["hold-out"] = tuple(hold_out_figures(estimate.hold_out))
    if (placement := run.placement) is not None:
        found["placement"] = (trend_figure(placement.trend),)
        if placement.placed.random_std.size:
            found["placement"] += (random_figure(placement.placed),)
    if (motion := run.motion) is not None:
        drawings = [loads_figure(motion)] if motion.inputs else []
        drawings += [stress_figure(run.stress)] if run.stress is not None else []
        drawings += [drive_figure(motion.time, name, *drive) for name, drive in motion.drives.items()]
        for name, ring in motion.bearings.items():
            drawings += bearing_figures(motion.time, name, ring)
        shown = {sensor.name for sensor in run.sensors}
        drawings += [
            components_figure(f"motion-{i}", f"{sensor.name}: reading", sensor)
            for i, sensor in enumerate(motion.sensors)
            if sensor.name not in shown
        ]
        found["motion"] = tuple(drawings)
    return found


def bench_page(
    run: BenchRun,
    drawings: dict[str, tuple[Drawing, ...]],
    provenance: Mapping[str, str],
    pictures: Sequence[tuple[str, bytes]] = (),
    turned: str = "",
) -> str:
    """The page as HTML text without any resource outside itself; drawings from `bench_figures`; pictures: caption, PNG;
    turned: the section of `space_section`, or nothing."""
    number_of = {entry.key: i for i, entry in enumerate(entry for entries in drawings.values() for entry in entries)}

    def each(key: str) -> list[str]:
        return [figure(entry, number_of[entry.key]) for entry in drawings.get(key, ())]

    def cards(key: str) -> str:
        return figures(each(key))

    sections = [
        f'<section class="card warnings"><h2>Warnings</h2>{bullets(run.warnings)}</section>' if run.warnings else ""
    ]
    if run.estimate is not None:
        listed = runs_table("unknowns", [(escape(run.name), run)])
        sections.append(f'<section id="answer" aria-label="answer" class="card">{listed}</section>')
        sections.append(f"<h2>What was estimated</h2>{cards('unknowns')}")
        sections.append(f"{section('Does it explain the sensors?', mismatch_table(run))}{cards('sensors')}")
        sections.append(hold_out_section(run.estimate.hold_out, each("hold-out")))
    if pictures:
        head = "Gauges and stress on the body" if run.stress is not None else "Gauges on the body"
        sections.append(f"<h2>{head}</h2>" + "".join(_picture(*entry) for entry in pictures))
    sections.append(turned)
    if run.placement is not None:
        sections.append(f"<h2>Where the gauges go</h2>{_placed(run)}{cards('placement')}")
    if run.motion is not None:
        lead = '<p class="lead">Simulated under the loads of the config.</p>'
        sections.append(f"<h2>How the bench moves</h2>{lead}{cards('motion')}")
    sections.append(rests_on({}, provenance, panel("Numbers", table("numbers", (), _facts(run)))))
    return document(
        "bench",
        run.name,
        headline([*((unknown.name, run.faults(unknown.name)) for unknown in run.unknowns), *too_high(run)]) + run.name,
        bench_answer(run),
        sections,
        FOOTER,
        STYLE,
        turned=bool(turned),
    )


def _placed(run: BenchRun) -> str:
    """The layout, what to do with it, and the same by other rules."""
    placement = run.placement
    assert placement is not None
    text = f'<div class="card">{placement_table(placement, run.numbers.get("place", {}))}</div>'
    text += advice_card(placement.placed.advice, "h3")
    if not placement.criteria:
        return text
    rules = criteria_table(placement.trend, placement.metrics, placement.criteria, placement.units)
    return f'{text}<div class="card">{criteria_meaning(placement.metrics)}{rules}</div>'


def _picture(caption: str, png: bytes) -> str:
    shown = picture(png, caption, 1400, 900)
    return f'<figure class="card picture">{shown}<figcaption>{escape(caption)}</figcaption></figure>'


def _title(unknown: BenchUnknown) -> str:
    return f"{unknown.name}, {'load' if unknown.kind == 'input' else 'parameter'}"


NAMES: Sequence[tuple[str, str, str]] = (
    ("coordinates", "coordinates", ""),
    ("constraints", "constraints", ""),
    ("steps", "steps", ""),
    ("violation", "constraints violated by at most", ""),
    ("violation_rate", "their rates by at most", ""),
    ("first_frequency", "first coupled frequency", "Hz"),
    ("band", "follows loads up to", "Hz"),
    ("turn", "largest turn of a body in a step", "rad"),
)


def _facts(run: BenchRun) -> list[tuple[str, str]]:
    rows = []
    for key, name, unit in NAMES:
        value = run.numbers.get("simulate", {}).get(key)
        if isinstance(value, int | float):
            rows.append((name, measure(float(value), unit)))
    for key, name in (("method", "correction"), ("truth", "truth")):
        if isinstance(value := run.summary.get(key), str):
            rows.append((name, escape(value)))
    for key, name in (
        ("channels", "channels"),
        ("unknowns", "unknowns"),
        ("violation", "constraints violated by, corrected"),
    ):
        if (text := run.number(key)) is not None:
            rows.append((name, plain(text, 3)))
    rows += [
        (escape(f"placement: {key}"), plain(float(value), 4))
        for key, value in run.numbers.get("place", {}).items()
        if isinstance(value, int | float) and not isinstance(value, bool) and not key.startswith("std.")
    ]
    return rows
