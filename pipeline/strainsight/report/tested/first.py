"""The first screen of the page of a test: what was found and how sure it is, whether the record is believable, what to mind."""

from __future__ import annotations

import math
from html import escape

from strainsight.report.arrays import History, Reading, rms
from strainsight.report.page.markup import badge, bullets, count, mark, measure, plain, share, table, tile
from strainsight.report.page.sections import section
from strainsight.report.tested.data import Findings, Peak, Unknown, peak_of
from strainsight.report.tested.figures import reading
from strainsight.report.text import listed

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
        sigma = "σ withheld" if own.std is None else f"±\u00a0{share(_relative(own))}"
        return f"{name} {measure(own.estimate, own.unit)} ({sigma})"
    sigma = "σ withheld" if own.std is None else f"±\u00a0{measure(own.std, own.unit, 2)}"
    top = "" if own.peak is None else f", at most {_peak(own.peak, own.unit)}"
    return f"{name} {measure(own.estimate, own.unit)} RMS ({sigma}){top}"


def _peak(peak: Peak, unit: str) -> str:
    value, at = peak.largest
    return "–" if math.isnan(value) else f"{measure(value, unit)} at {measure(at, 's')}"


def _relative(own: Unknown) -> float:
    return own.std / abs(own.estimate) if own.std is not None and own.estimate else math.nan


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
        value += f' <small class="whole">± {share(_relative(own))}</small>'
    rows = []
    if own.std is not None:
        rows.append(("± claimed σ", measure(own.std, own.unit, 3)))
        if load:
            rows.append(("σ of its RMS", share(_relative(own))))
    if own.peak is not None:
        for words, value_, at in (
            ("largest", own.peak.high, own.peak.high_at),
            ("least", own.peak.low, own.peak.low_at),
        ):
            if not math.isnan(value_):
                rows.append((words, f"{measure(value_, own.unit)} at {measure(at, 's')}"))
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
    shown = [own for own in report.histories if own.name in loads]
    rows = [_row(own.name, "load", peak_of(own.time, own.mean), own.unit, own) for own in shown]
    rows += [
        _row(f"size of the sum at {own.name}", "loads", peak_of(own.time, own.mean), own.unit, own)
        for own in report.resultants
    ]
    rows += [_row(own.name, "known load", peak_of(own.time, own.mean), own.unit, None) for own in report.known]
    for own in report.readings:
        for words, values, held in (("measured", own.measured, None), ("reconstructed", own.estimated, own)):
            rows.append(_row(own.label, words, peak_of(own.time, values), own.unit, held))
    head = ("signal", "what", "least", "at [s]", "largest", "at [s]", "± σ there")
    return section("Extremes", table("extremes", head, rows, numeric=range(2, 7)) if rows else "")


def _row(name: str, what: str, peak: Peak, unit: str, claimed: History | Reading | None) -> list[str]:
    """σ at the value of larger size."""
    sigma = "–"
    if claimed is not None and not math.isnan(peak.low):
        at = peak.largest[1]
        own = float(claimed.std[int(abs(claimed.time - at).argmin())])
        sigma = "withheld" if math.isnan(own) else reading(own, unit, 2)
    cells = [escape(name), what]
    for value, when in ((peak.low, peak.low_at), (peak.high, peak.high_at)):
        cells += [reading(value, unit, 4), "–" if math.isnan(when) else plain(when, 5)]
    return [*cells, sigma]


def title_of(name: str, report_unknowns: tuple[str, ...]) -> str:
    """As "beam: what the test says of side and E"."""
    return f"{name}: what the test says of {listed(report_unknowns)}" if report_unknowns else f"{name}: the test"
