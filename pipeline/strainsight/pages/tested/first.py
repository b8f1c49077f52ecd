"""The first screen of the page of a test: what was found and how sure it is, whether the record is believable, what to mind."""

from __future__ import annotations

import math
from html import escape

from strainsight.pages.arrays import FloatArray, History, Reading, rms
from strainsight.pages.page.markup import badge, bullets, count, mark, measure, plain, share, table, tile
from strainsight.pages.page.sections import section
from strainsight.pages.tested.data import Findings, Peak, Unknown, peak_of
from strainsight.pages.tested.figures import reading
from strainsight.pages.text import listed

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
