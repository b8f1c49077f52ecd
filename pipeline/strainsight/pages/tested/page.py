"""One self-contained HTML page of a test: what was found first, then what it rests on.

What a section shows stands in `Findings`, its figures in `figures.figures_of_test`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from html import escape

import numpy as np

from strainsight.pages.arrays import FloatArray, History, Reading, rms
from strainsight.pages.chart.drawing import Drawing
from strainsight.pages.page.markup import (
    badge,
    bullets,
    chosen,
    count,
    figures,
    folded,
    mark,
    measure,
    plain,
    scene,
    share,
    table,
    tile,
)
from strainsight.pages.page.sections import (
    budget_section,
    damage_section,
    document,
    filters_section,
    listing_section,
    panel,
    rests_on,
    section,
    warnings_section,
)
from strainsight.pages.picture.geometry import Scale, areas, scale_bar, scale_of
from strainsight.pages.picture.layout import Layout
from strainsight.pages.space.model import Shape, contour_of
from strainsight.pages.space.section import space_section
from strainsight.pages.tested.data import Findings, Map, Moment, Peak, Unknown, peak_of
from strainsight.pages.tested.figures import hold_out_section, reading
from strainsight.pages.text import listed, number, quantity
from strainsight.pages.view.viewing import FACETS, Panel, View
from strainsight.records.estimated import Source

LOUD = 1.5
"""RMS of what is left over the stated noise from which it is marked."""
SHOWN = 3
"""Warnings on the first screen; all of them stand below."""


def answer(report: Findings) -> str:
    """The first sentences: the gravest warning, then every unknown, from what it was found."""
    parts = ", ".join(_found(own) for own in report.unknowns)
    channels, samples = len(report.readings), report.file.samples
    text = f'<strong class="bad">{escape(_sentence(report.warnings[0]))}</strong> ' if report.warnings else ""
    text += f"<strong>{parts}</strong>" if parts else "<strong>No unknown was estimated</strong>"
    return (
        f"{text}, from {count(samples)} samples of {count(channels)} channel{'s' * (channels != 1)} in "
        f"{escape(report.file.source.file)}."
    )


def _found(own: Unknown) -> str:
    name = escape(own.name)
    if own.kind == "parameter":
        sigma = "σ withheld" if own.std is None else f"±\u00a0{share(own.relative)}"
        return f"{name} {measure(own.estimate, own.unit)} ({sigma})"
    sigma = "σ withheld" if own.std is None else f"±\u00a0{measure(own.std, own.unit, 2)}"
    top = "" if own.peak is None else f", at most {_peak(own.peak, own.unit)}"
    return f"{name} {measure(own.estimate, own.unit)} RMS ({sigma}){top}"


def _peak(peak: Peak, unit: str) -> str:
    value, at = peak.largest
    return "–" if math.isnan(value) else f"{measure(value, unit)} at {measure(at, 's')}"


def first_screen(report: Findings) -> str:
    """Every unknown, the verdict on the record, every channel, and what to mind. Every number in it is a `data` element."""
    tiles = "".join(_tile(own) for own in report.unknowns) + _verdict(report)
    return (
        f'<section id="answer" aria-label="answer"><div class="tiles">{tiles}</div>'
        f'<div class="first">{_channels(report)}</div>{_cautions(report)}</section>'
    )


def _tile(own: Unknown) -> str:
    load = own.kind == "load"
    value = measure(own.estimate, own.unit)
    if load:
        value += ' <small class="whole">RMS</small>'
    elif own.std is not None:
        value += f' <small class="whole">± {share(own.relative)}</small>'
    rows = []
    if own.std is not None:
        rows.append(("± claimed σ", measure(own.std, own.unit, 3)))
        if load:
            rows.append(("σ of its RMS", share(own.relative)))
    if own.peak is not None:
        ends = (("largest", own.peak.high, own.peak.high_at), ("least", own.peak.low, own.peak.low_at))
        rows += [
            (words, f"{measure(size, own.unit)} at {measure(at, 's')}")
            for words, size, at in ends
            if not math.isnan(size)
        ]
    doubts = ["σ is withheld"] * (own.std is None) + list(own.doubts)
    marks = "".join(mark(escape(text), False) for text in doubts)
    return tile(f"{escape(own.name)}, {own.kind}", value, rows, marks)


def _verdict(report: Findings) -> str:
    """Whether the record is what the model and the stated noise make one expect."""
    good = report.consistent
    words = mark(escape(_sentence(report.verdict)), good)
    return tile("the record and what was stated", "fits" if good else "does not fit", after=words)


def _channels(report: Findings) -> str:
    """Every channel: its size, what the estimate leaves of it beside the noise, its largest reading and when."""
    rows = []
    for own in report.readings:
        value, at = peak_of(own.time, own.measured).largest
        left = rms(own.residual)
        rows.append(
            [
                badge(own.label, own.gauge),
                reading(rms(own.measured), own.unit),
                reading(left, own.unit),
                _times(left / own.noise_std if own.noise_std > 0 else math.nan),
                reading(value, own.unit, 4),
                "–" if math.isnan(at) else measure(at, "s"),
                count(own.missing),
            ]
        )
    head = ("channel", "RMS", "left over, RMS", "of its noise", "largest reading", "at", "missing")
    text = table(
        "channels",
        head,
        rows,
        title="<h2>Channel by channel</h2>",
        caption="Left over: measured less reconstructed. Of its noise: that over the noise as stated; one or less where the "
        "model holds.",
        numeric=range(1, 7),
    )
    return f'<div class="card without">{text}</div>'


def _times(ratio: float) -> str:
    if math.isnan(ratio):
        return "–"
    return f'<strong class="bad">{plain(ratio, 3)}</strong>' if ratio > LOUD else plain(ratio, 3)


def _cautions(report: Findings) -> str:
    cards = ""
    if report.warnings:
        shown = bullets(_sentence(text) for text in report.warnings[:SHOWN])
        many = len(report.warnings)
        more = f'<p><a href="#warnings">All {count(many)} warnings</a></p>' if many > SHOWN else ""
        cards += f'<div class="card warnings"><h2>Warnings</h2>{shown}{more}</div>'
    if not report.hold_out:
        cards += (
            '<div class="card notes"><h2>Not tested</h2>'
            + bullets(["No gauge was held out: how well places without a gauge are predicted was not tested."])
            + "</div>"
        )
    return f'<div class="cautions">{cards}</div>' if cards else ""


def _sentence(text: str) -> str:
    """With a capital letter, where it begins with a word and no name, and a full stop."""
    return f"{text}{'' if text.endswith(('.', '!', '?')) else '.'}"


def extremes_section(report: Findings) -> str:
    """The least and the largest of every load and channel, and when."""
    loads = {own.name for own in report.loads}
    rows = [_row(own.name, "load", own, own.mean, own.std) for own in report.histories if own.name in loads]
    rows += [_row(f"size of the sum at {own.name}", "loads", own, own.mean, own.std) for own in report.resultants]
    rows += [_row(own.name, "known load", own, own.mean) for own in report.known]
    for own in report.readings:
        rows.append(_row(own.label, "measured", own, own.measured))
        rows.append(_row(own.label, "reconstructed", own, own.estimated, own.std))
    head = ("signal", "what", "least", "at [s]", "largest", "at [s]", "± σ there")
    return section("Extremes", table("extremes", head, rows, numeric=range(2, 7)) if rows else "")


def _row(
    name: str, what: str, signal: History | Reading, values: FloatArray, std: FloatArray | None = None
) -> list[str]:
    """Of values of a signal the least and the largest, and σ at the one of larger size."""
    peak, sigma = peak_of(signal.time, values), "–"
    if std is not None and not math.isnan(peak.low):
        at = float(std[int(abs(signal.time - peak.largest[1]).argmin())])
        sigma = "withheld" if math.isnan(at) else reading(at, signal.unit, 2)
    cells = [escape(name), what]
    for value, when in ((peak.low, peak.low_at), (peak.high, peak.high_at)):
        cells += [reading(value, signal.unit, 4), "–" if math.isnan(when) else plain(when, 5)]
    return [*cells, sigma]


def title_of(name: str, report_unknowns: tuple[str, ...]) -> str:
    """As "beam: what the test says of side and E"."""
    return f"{name}: what the test says of {listed(report_unknowns)}" if report_unknowns else f"{name}: the test"


FOOTER = (
    "σ is one standard deviation, as the filter claims it. Loads and the surface are smoothed: from all samples, earlier and "
    "later ones. Readings are reconstructed by the filter, from the samples up to each instant. Left over: measured less "
    "reconstructed."
)
SPECTRA = (
    "Measured less reconstructed, beside the noise as stated (dashed). Below that line noise was taken for motion or load; what "
    "stands out above it the model does not have."
)

CHECKED = (
    "RMS of each channel and of what the rest of the record says that it reads; residual over its σ is 1 where they agree. What "
    "explains the record best is named also where the record agrees with the model, and then says little."
)


def page_of_test(
    report: Findings, drawings: tuple[Drawing, ...], pictures: tuple[bytes, ...] = (), problem: str = ""
) -> str:
    """The page as HTML text without any resource outside itself.

    drawings from `figures.figures_of_test`; pictures: PNG of `field.views_of`, or none with the sentence on why.
    """
    sections = (
        _other_records(report),
        first_screen(report),
        _readings(drawings),
        listing_section("Every channel beside the others", report.checked, range(1, 5), CHECKED),
        hold_out_section(report.hold_out, chosen(drawings, "hold-out-")),
        _residuals(report, drawings),
        figures(chosen(drawings, "load-", "resultant-", "spectrum-", "known-"), "<h2>Loads</h2>"),
        figures(chosen(drawings, "estimate-", "posterior-"), "<h2>Parameters</h2>"),
        extremes_section(report),
        field_section(report, pictures, problem),
        space_of(report),
        damage_section(report.damage),
        budget_section(report.budget),
        filters_section(report.filters, report.units),
        warnings_section(report.warnings),
        _file(report),
        rests_on(report.facts, report.provenance),
    )
    return document("test", report.name, report.title, answer(report), sections, FOOTER, turned=True)


def _other_records(report: Findings) -> str:
    """Which record of a test this is, and where the others are."""
    if not report.beside:
        return ""
    links = ", ".join(f'<a href="{escape(page)}">{escape(name)}</a>' for name, page in report.beside)
    return f'<p class="lead">Record {escape(report.record)}. The others: {links}.</p>'


def _readings(drawings: tuple[Drawing, ...]) -> str:
    lead = '<p class="lead">What each channel measured, and what the estimate says that it reads; below, the difference.</p>'
    shown = folded(chosen(drawings, "reading-"), "multiples")
    return f"<h2>Measured and reconstructed</h2>{lead}{shown}" if shown else ""


def _residuals(report: Findings, drawings: tuple[Drawing, ...]) -> str:
    shown = folded(chosen(drawings, "residual-"), "multiples")
    known = {own.name for own in report.residuals}
    none = [own.label for own in report.readings if own.label not in known]
    if none:
        shown += f'<p class="note">None of {escape(", ".join(none))}: too few samples follow one another.</p>'
    return f'<h2>Spectra of what is left over</h2><p class="lead">{SPECTRA}</p>{shown}' if shown else ""


def _file(report: Findings) -> str:
    """What a reader needs to know, a year later, of where the numbers come from."""
    own, source = report.file, report.file.source
    facts = {
        "file": escape(source.file),
        "SHA-256": broken_digest(source.sha256),
        "size": _size_in_words(source.bytes),
        "format": escape(source.format),
        "date": escape(source.date) or "not stated (estimate.date)",
        "sample rate": quantity(own.rate, "Hz"),
        "record": f"{number(own.duration)} s from {number(own.start)} s, {number(own.samples, 12)} samples",
    }
    rows = [
        [escape(name), escape(source.measures[i]), escape(source.unit[i]), escape(_calibration_in_words(source, i))]
        for i, name in enumerate(source.channel)
    ]
    channels = table("calibration", ("channel", "measures", "unit in the file", "what was done to it"), rows)
    panels = panel("The file", table("file", (), list(facts.items()))) + panel("Its channels", channels)
    panels += panel("What was done to the record", bullets(report.notes) if report.notes else "")
    return f'<h2 id="file">The file of the test</h2><div class="panels">{panels}</div>'


def broken_digest(sha256: str) -> str:
    """A digest that a line may break every 16 digits."""
    return "<wbr>".join(sha256[i : i + 16] for i in range(0, len(sha256), 16))


def _size_in_words(size: int) -> str:
    """Bytes as people read them."""
    for factor, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if size >= factor:
            return f"{number(size / factor, 3)} {unit} ({number(size, 12)} bytes)"
    return f"{number(size, 12)} bytes"


def _calibration_in_words(source: Source, i: int) -> str:
    """What was done to channel i of the file, in the order in which it was done."""
    unit, parts = source.unit[i], []
    if source.offset[i]:
        parts.append(f"less {source.offset[i]:g} {unit}")
    if source.drift[i]:
        parts.append(f"less {source.drift[i]:g} {unit} a second")
    if np.isfinite(source.zero[i]).all():
        parts.append("less its mean from {:g} to {:g} s".format(*source.zero[i]))
    if source.sign[i] < 0:
        parts.append("sign turned")
    if source.bridge[i]:
        ratio = "" if np.isnan(source.poisson_ratio[i]) else f", ν {source.poisson_ratio[i]:g}"
        parts.append(f"{source.bridge[i]} bridge, gauge factor {source.gauge_factor[i]:g}{ratio}")
    if source.scale[i] != 1:
        parts.append(f"times {source.scale[i]:g}")
    if source.delay[i]:
        parts.append(f"moved by {abs(source.delay[i]):g} s, {'late' if source.delay[i] > 0 else 'early'} in the file")
    return "; ".join(parts) or "nothing was done"


SIZE = (1000, 600)
"""Of a map [px]; the page shows it at about half of that."""


def views_of(report: Findings) -> tuple[View, ...]:
    """A view of every map of the moment, to be drawn as a picture; none where there is no moment."""
    moment = report.moment
    if moment is None:
        return ()
    panel = f"t = {moment.time:.5g} s, displacement × {moment.factor:g}"
    # Names of loads at one node would stand on one another; the view in space has the arrows.
    bare = replace(report.layout, loads=())
    return tuple(
        View("", bare, (Panel(panel, own.values, moment.shift),), own.quantity, own.unit, FACETS, size=SIZE, bar=False)
        for own in moment.maps
    )


def field_section(report: Findings, pictures: Sequence[bytes], problem: str) -> str:
    """Maps side by side; nothing where the mesh has no surface. pictures: of every map, or none with the sentence on why."""
    moment = report.moment
    if moment is None:
        return ""
    lead = (
        f'<p class="lead">The whole surface at {measure(moment.time, "s")}, the moment of the largest reading '
        f"({escape(moment.label)}), smoothed.</p>"
    )
    cards = ""
    for own, png in zip(moment.maps, pictures, strict=False):
        name = own.quantity
        shown = scene(png, _alt(own, moment, report.layout), f"picture: {name}", *SIZE)
        bar = scale_bar(scale(own, report.layout))
        cards += (
            f'<figure class="card"><h3>{escape(name)}</h3>{shown}{bar}<figcaption>{_said(own)}</figcaption></figure>'
        )
    if not pictures:
        said = f"<p><strong>No picture.</strong> {escape(problem)}</p>" if problem else ""
        cards = f'<div class="card">{said}{"".join(f"<p>{_said(own)}</p>" for own in moment.maps)}</div>'
    return f'<h2>Strain and stress of the surface</h2>{lead}<div class="figures">{cards}</div>'


def space_of(report: Findings) -> str:
    """The structure to turn round, coloured by each map of the moment, the last of them first."""
    moment = report.moment
    if moment is None:
        return space_section([("", report.layout)])
    when, group = f"at {number(moment.time)}\u00a0s", "Strain and stress"
    shapes = [
        Shape(
            f"{own.quantity} {when}", contour=contour_of(own.values, report.layout, own.quantity, own.unit), group=group
        )
        for own in reversed(moment.maps)
    ]
    moved = Shape(f"{when}, displacement × {number(moment.factor)}", moment.shift, shapes[0].contour, "Moved")
    return space_section([("", report.layout)], [*shapes, moved], first=0)


def scale(own: Map, layout: Layout) -> Scale:
    """That of the picture: about zero where both signs occur, a peak beyond its ends."""
    return scale_of(own.quantity, own.unit, own.values, areas(layout.points, layout.faces))


def _said(own: Map) -> str:
    """The extremes of a map, with σ at the largest where it is known."""
    low, high = int(np.argmin(own.values)), int(np.argmax(own.values))
    at = high if abs(own.values[high]) >= abs(own.values[low]) else low
    sigma = "" if own.std is None else f" ± {measure(float(own.std[at]), own.unit, 2)}"
    span = f"From {measure(float(own.values[low]), own.unit)} to {measure(float(own.values[high]), own.unit)}"
    largest = f"largest size {measure(float(own.values[at]), own.unit)}{sigma}" if own.std is not None else ""
    return f"{span}{f'; {largest}' if largest else ''}, by facets at their middles."


def _alt(own: Map, moment: Moment, layout: Layout) -> str:
    low, high = scale(own, layout).low, scale(own, layout).high
    return (
        f"{own.quantity} of the surface at {number(moment.time)} s, in colours from {number(low, 3)} to "
        f"{number(high, 3)} {own.unit}."
    )
