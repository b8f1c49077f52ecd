"""Self-contained HTML page of a test: results, figures, model and provenance.

Contents of the sections are in `Findings`, figures in `figures_of_test`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from html import escape
from typing import Any

import numpy as np

from strainsight.pages.arrays import FloatArray, History, Reading, rms
from strainsight.pages.chart.drawing import Drawing
from strainsight.pages.page import sections
from strainsight.pages.page.markup import (
    badge,
    bullets,
    count,
    figures,
    folded,
    mark,
    measure,
    plain,
    scene,
    select_figures,
    share,
    table,
    tile,
    titled,
)
from strainsight.pages.page.sections import panel
from strainsight.pages.picture.geometry import areas, scale_bar, scale_of
from strainsight.pages.space.model import ShownState, contour_of
from strainsight.pages.space.section import space_section
from strainsight.pages.tested.data import Findings, Map, TestedUnknown, peak_of
from strainsight.pages.tested.figures import hold_out_section, reading
from strainsight.pages.view.viewing import FACETS, Panel, View
from strainsight.records.estimated import TestSource
from strainsight.text import capital, listed, number, quantity

LOUD = 1.5
"""RMS of the residual relative to the configured noise from which it is marked, if the record is inconsistent."""
SHOWN = 3
"""Number of warnings on the first screen; all are listed below."""


def answer(report: Findings) -> str:
    """First sentences: the most serious warning, then the estimates and their source."""
    parts = ", ".join(map(_estimate_text, report.unknowns))
    channels, samples = len(report.readings), report.file.samples
    text = f'<strong class="bad">{escape(_sentence(report.warnings[0]))}</strong> ' if report.warnings else ""
    text += f"<strong>{parts}</strong>" if parts else "<strong>No unknown was estimated</strong>"
    source = f"{count(samples)} samples of {count(channels)} channel{'s' * (channels != 1)}"
    return f"{text}, from {source} in {escape(report.file.source.file)}."


def _estimate_text(unknown: TestedUnknown) -> str:
    load, value = unknown.kind == "load", measure(unknown.estimate, unknown.unit)
    sigma = share(unknown.relative) if not load else measure(unknown.std, unknown.unit, 2)
    sigma = "σ withheld" if unknown.std is None else f"±\u00a0{sigma}"
    top = ""
    if unknown.peak is not None:
        size, at = unknown.peak.largest
        top = ", peak –" if math.isnan(size) else f", peak {measure(size, unknown.unit)} at {measure(at, 's')}"
    return f"{escape(unknown.name)} {value}{' RMS' * load} ({sigma}){top}"


def findings_screen(report: Findings) -> str:
    """Unknowns, consistency of the record, channels, and warnings. Every number is a `data` element."""
    good = report.consistent
    words = mark(escape(_sentence(report.innovations)), good) if report.innovations else ""
    consistency = tile("consistency of record and model", "consistent" if good else "inconsistent", after=words)
    first = bullets(map(_sentence, report.warnings[:SHOWN]))
    more = f'<p><a href="#warnings">All {count(len(report.warnings))} warnings</a></p>'
    cautions = (
        sections.caution("Warnings", first + more * (len(report.warnings) > SHOWN), "warnings"),
        sections.caution("Not tested", bullets([NOT_TESTED] * (not report.hold_out))),
    )
    tiles = "".join(map(_tile, report.unknowns)) + consistency
    return sections.first_screen(
        f'<div class="tiles">{tiles}</div><div class="first">{_channels(report)}</div>', cautions
    )


def _tile(unknown: TestedUnknown) -> str:
    load, known = unknown.kind == "load", unknown.std is not None
    small = "RMS" if load else f"± {share(unknown.relative)}" if known else ""
    value = measure(unknown.estimate, unknown.unit) + f' <small class="whole">{small}</small>' * bool(small)
    rows = [
        ("± claimed σ", measure(unknown.std, unknown.unit, 3)),
        ("σ / RMS", share(unknown.relative if load and known else None)),
    ]
    if (peak := unknown.peak) is not None and not math.isnan(peak.low):
        for words, size, at in (("maximum", peak.high, peak.high_at), ("minimum", peak.low, peak.low_at)):
            rows.append((words, f"{measure(size, unknown.unit)} at {measure(at, 's')}"))
    doubts = ["σ is withheld"] * (not known) + list(unknown.doubts)
    marks = "".join(mark(escape(text), False) for text in doubts)
    return tile(f"{escape(unknown.name)}, {unknown.kind}", value, rows, marks)


def _channels(report: Findings) -> str:
    """Every channel: RMS, residual relative to the noise, largest reading and its instant."""
    rows = []
    for channel in report.readings:
        value, at = peak_of(channel.time, channel.measured).largest
        left, size = rms(channel.residual), rms(channel.measured)
        times = left / channel.noise_std if channel.noise_std > 0 else math.nan
        loud = (
            f'<strong class="bad">{plain(times, 3)}</strong>'
            if times > LOUD and not report.consistent
            else plain(times, 3)
        )
        rows.append(
            [
                badge(channel.label, channel.gauge),
                *(reading(signal, channel.unit) for signal in (size, left)),
                "–" if math.isnan(times) else loud,
                reading(value, channel.unit, 4),
                "–" if math.isnan(at) else measure(at, "s"),
                count(channel.missing),
            ]
        )
    text = table(
        "channels",
        (
            "channel",
            "RMS reading",
            "RMS residual",
            "residual / noise",
            "largest reading",
            "at time",
            "missing samples in the filter",
        ),
        rows,
        title="<h2>Channels</h2>",
        caption="Residual: measured − reconstructed. Residual / noise: RMS residual divided by the configured noise; "
        "at most about one for an exact model. Model errors increase it, but a record with errors within the config section "
        "`tolerances` is consistent. Missing samples in the filter: without the first sample of the record, whose reading the "
        "filter does not use. Missing samples in the file are listed with the processing of the record.",
        numeric=range(1, 7),
    )
    return f'<div class="card">{text}</div>'


def _sentence(text: str) -> str:
    """Text with a full stop."""
    return f"{text}{'' if text.endswith(('.', '!', '?')) else '.'}"


def extremes_section(report: Findings) -> str:
    """Minimum and maximum of every load and channel, with their instants."""
    loads = {load.name for load in report.loads}
    rows = [_row(load.name, "load", load, load.mean, load.std) for load in report.histories if load.name in loads]
    rows += [
        _row(f"magnitude of the sum of the loads at {total.name}", "loads", total, total.mean, total.std)
        for total in report.resultants
    ]
    rows += [_row(load.name, "known load", load, load.mean) for load in report.known]
    for channel in report.readings:
        rows.append(_row(channel.label, "measured", channel, channel.measured))
        rows.append(_row(channel.label, "reconstructed", channel, channel.estimated, channel.std))
    head = ("signal", "kind", "minimum", "at [s]", "maximum", "at [s]", "± σ at peak")
    return sections.section("Extremes", table("extremes", head, rows, numeric=range(2, 7)) if rows else "")


def _row(
    name: str, what: str, signal: History | Reading, values: FloatArray, std: FloatArray | None = None
) -> list[str]:
    """Minimum and maximum of a signal, and σ at the larger absolute value."""
    peak, sigma = peak_of(signal.time, values), "–"
    if std is not None and not math.isnan(peak.low):
        at = float(std[int(abs(signal.time - peak.largest[1]).argmin())])
        sigma = "withheld" if math.isnan(at) else reading(at, signal.unit, 2)
    cells = [escape(name), what]
    for value, when in ((peak.low, peak.low_at), (peak.high, peak.high_at)):
        cells += [reading(value, signal.unit, 4), "–" if math.isnan(when) else plain(when, 5)]
    return [*cells, sigma]


def title_of(name: str, report_unknowns: tuple[str, ...]) -> str:
    """Title of the page, e.g. "beam: estimates of side and E"."""
    return f"{name}: estimates of {listed(report_unknowns)}" if report_unknowns else f"{name}: test"


FOOTER = (
    "σ is one standard deviation, as claimed by the filter. Loads, strain and stress of the surface are smoothed estimates from "
    "all samples. Readings are reconstructed by the filter from samples up to each instant. Residual: measured − reconstructed."
)
SPECTRA = (
    "Measured − reconstructed, and the configured noise (dashed). Values far below the dashed line indicate that the filter "
    "interprets noise as motion or load. Peaks above the dashed line indicate effects that the model does not include."
)

READINGS = "Measured and reconstructed readings of each channel; below, the residual."
NOT_TESTED = "No gauge was held out: predictions at positions without gauges were not tested."

CHECKED = (
    "RMS predicted: RMS of this prediction. Residual / σ is about 1 for channels that are consistent with it. The most likely "
    "fault of a channel is listed only if the record is inconsistent with the model."
)


def page_of_test(
    report: Findings, drawings: tuple[Drawing, ...], pictures: tuple[bytes, ...] = (), problem: str = ""
) -> str:
    """Self-contained HTML page.

    drawings: from `figures_of_test`; pictures: PNG files of `views_of`, empty with the reason in `problem`."""
    links = ", ".join(f'<a href="{escape(page)}">{escape(name)}</a>' for name, page in report.other_records)
    parts = (
        f'<p class="lead">Record {escape(report.record)}. Other records: {links}.</p>' * bool(links),
        findings_screen(report),
        folded(
            select_figures(drawings, "reading-"), "multiples", titled("Measured and reconstructed readings", READINGS)
        ),
        sections.listing_section(
            "" if report.checked is None else capital(report.checked.title), report.checked, range(1, 5), CHECKED
        ),
        hold_out_section(report.hold_out, select_figures(drawings, "hold-out-")),
        _residuals(report, drawings),
        figures(select_figures(drawings, "load-", "resultant-", "spectrum-", "known-"), "<h2>Loads</h2>"),
        figures(select_figures(drawings, "estimate-", "posterior-"), "<h2>Parameters</h2>"),
        extremes_section(report),
        field_section(report, pictures, problem),
        space_of(report),
        sections.damage_section(report.damage),
        sections.budget_section(report.budget),
        sections.filters_section(report.filters, report.units),
        sections.warnings_section(report.warnings),
        _file(report),
        sections.provenance_section(report.facts, report.provenance),
    )
    return sections.document("test", report.name, report.title, answer(report), parts, FOOTER, turned=True)


def _residuals(report: Findings, drawings: tuple[Drawing, ...]) -> str:
    shown = folded(select_figures(drawings, "residual-"), "multiples")
    known = {spectrum.name for spectrum in report.residuals}
    if missing := ", ".join(channel.label for channel in report.readings if channel.label not in known):
        shown += f'<p class="note">No spectrum of {escape(missing)}: too few consecutive samples.</p>'
    return titled("Spectra of the residuals", SPECTRA) + shown if shown else ""


def _file(report: Findings) -> str:
    """Measurement file, its channels and its processing."""
    file, source = report.file, report.file.source
    facts = [
        ("file", escape(source.file)),
        ("SHA-256", broken_digest(source.sha256)),
        ("size", _size_text(source.bytes)),
        ("format", escape(source.format)),
        ("date", escape(source.date) or "not configured (key estimate.date)"),
        ("sample rate", quantity(file.rate, "Hz")),
        (
            "record",
            f"{number(file.duration)} s, starting at t = {number(file.start)} s, {number(file.samples, 12)} samples",
        ),
    ]
    columns = zip(source.channel, source.measures, source.unit, strict=True)
    rows = [[*map(escape, words), escape(_calibration_text(source, i))] for i, words in enumerate(columns)]
    channels = table("calibration", ("channel", "measures", "unit in the measurement file", "processing"), rows)
    panels = panel("File", table("file", (), facts)) + panel("Channels", channels)
    panels += panel("Processing of the record", bullets(report.notes))
    return sections.section("Measurement file", panels, "file", "panels")


def broken_digest(sha256: str) -> str:
    """Digest with possible line breaks every 16 digits."""
    return "<wbr>".join(sha256[i : i + 16] for i in range(0, len(sha256), 16))


def _size_text(size: int) -> str:
    """Bytes in a readable unit."""
    units = ((1e9, "GB"), (1e6, "MB"), (1e3, "kB"))
    rounded = next((f"{number(size / factor, 3)} {unit}" for factor, unit in units if size >= factor), "")
    return f"{rounded} ({number(size, 12)} bytes)" if rounded else f"{number(size, 12)} bytes"


def _calibration_text(source: TestSource, i: int) -> str:
    """Processing of channel i of the file, in order."""
    unit, delay, zero = source.unit[i], source.delay[i], source.zero[i]
    ratio = "" if np.isnan(source.poisson_ratio[i]) else f", ν {source.poisson_ratio[i]:g}"
    steps = {
        f"minus {source.offset[i]:g} {unit}": source.offset[i],
        f"minus {source.drift[i]:g} {unit} per second": source.drift[i],
        f"minus mean from {zero[0]:g} to {zero[1]:g} s": np.isfinite(zero).all(),
        "sign reversed": source.sign[i] < 0,
        f"{source.bridge[i]} bridge, gauge factor {source.gauge_factor[i]:g}{ratio}": source.bridge[i],
        f"times {source.scale[i]:g}": source.scale[i] != 1,
        f"shifted by {abs(delay):g} s ({'late' if delay > 0 else 'early'} in the file)": delay,
    }
    return "; ".join(step for step, done in steps.items() if done) or "none"


SIZE = (1000, 600)
"""Size of a map [px]; the page shows it at about half."""


def views_of(report: Findings) -> tuple[View, ...]:
    """View of every map, empty without a surface."""
    moment = report.moment
    if moment is None:
        return ()
    panel = f"t = {moment.time:.5g} s, displacement × {moment.factor:g}"
    # Names of loads at one node would overlap; the 3D view has the arrows.
    bare = replace(report.layout, loads=())
    style: dict[str, Any] = {"on": FACETS, "size": SIZE, "bar": False}
    return tuple(
        View("", bare, (Panel(panel, shown.values, moment.shift),), shown.quantity, shown.unit, **style)
        for shown in moment.maps
    )


def field_section(report: Findings, pictures: Sequence[bytes], problem: str) -> str:
    """Maps of the surface, empty without one; pictures: of every map, empty with the reason in `problem`."""
    moment, cards = report.moment, ""
    if moment is None:
        return ""
    for shown, png in zip(moment.maps, pictures, strict=False):
        # symmetric about zero if both signs occur; peaks may exceed the scale
        area = areas(report.layout.points, report.layout.faces)
        name, scale = shown.quantity, scale_of(shown.quantity, shown.unit, shown.values, area)
        alt = (
            f"{name} of the surface at {number(moment.time)} s, colour scale from {number(scale.low, 3)} to "
            f"{number(scale.high, 3)} {shown.unit}."
        )
        image = f"{scene(png, alt, f'picture: {name}', *SIZE)}{scale_bar(scale)}"
        words = f"<figcaption>{_extremes(shown)}</figcaption>"
        cards += f'<figure class="card"><h3>{escape(name)}</h3>{image}{words}</figure>'
    if not pictures:
        words = f"<p><strong>No picture.</strong> {escape(problem)}</p>" if problem else ""
        cards = f'<div class="card">{words}{"".join(f"<p>{_extremes(shown)}</p>" for shown in moment.maps)}</div>'
    lead = f"Surface at {measure(moment.time, 's')}, the instant of the largest reading "
    lead += f"({escape(moment.label)}), smoothed."
    return sections.section("Strain and stress of the surface", cards, kind="figures", lead=lead)


def space_of(report: Findings) -> str:
    """Interactive 3D view of the structure with each map as colours, beginning with the last."""
    moment, layout = report.moment, report.layout
    if moment is None:
        return space_section([("", layout)])
    when, group = f"at {number(moment.time)}\u00a0s", "Strain and stress"
    shapes = []
    for shown in reversed(moment.maps):
        contour = contour_of(shown.values, layout, shown.quantity, shown.unit)
        shapes.append(ShownState(f"{shown.quantity} {when}", contour=contour, group=group))
    moved = ShownState(
        f"{when}, displacement × {number(moment.factor)}", moment.shift, shapes[0].contour, "Displaced surface"
    )
    return space_section([("", layout)], [*shapes, moved], first=0)


def _extremes(shown: Map) -> str:
    """Extremes of a map, with σ at the largest absolute value if known."""
    values, unit = shown.values, shown.unit
    text = f"Values from {measure(float(values.min()), unit)} to {measure(float(values.max()), unit)}"
    if shown.std is not None:
        at = max(int(np.argmax(values)), int(np.argmin(values)), key=lambda i: abs(values[i]))
        text += (
            f"; largest absolute value {measure(float(values[at]), unit)} ± {measure(float(shown.std[at]), unit, 2)}"
        )
    return f"{text}, at the facet centres."
