"""One self-contained HTML page of a test of several records: the table over records first, then what they share."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from html import escape

from strainsight.report.chart.drawing import Drawing
from strainsight.report.chart.posterior import Posterior, posterior_figure
from strainsight.report.page.document import document
from strainsight.report.page.listing import Listing, damage_section
from strainsight.report.page.markup import bullets, count, figure, figures, measure, pairs, plain, share, table
from strainsight.report.tested.data import File, Unknown

FOOTER = (
    "σ is one standard deviation, as the filter claims it. Parameters are the same in all records, and so are the errors of "
    "gauges, damping and loads, which do not average away; loads, motion and zeros are each record's own."
)


@dataclass(frozen=True)
class RecordRow:
    """A record: name, page (its file name), file; loads: each with RMS, σ and peak; inside: share of its innovations within 2σ;
    verdict in words, fits: whether it is a good one."""

    name: str
    page: str
    file: File
    loads: tuple[Unknown, ...]
    inside: float
    verdict: str
    fits: bool


@dataclass(frozen=True)
class CampaignFindings:
    """All that the page shows. parameters by all records; alone: parameter → its most likely value by each record alone;
    damage of all of them, None where it was not asked for."""

    name: str
    title: str
    records: tuple[RecordRow, ...]
    parameters: tuple[Unknown, ...]
    alone: Mapping[str, tuple[float, ...]]
    warnings: tuple[str, ...]
    posteriors: tuple[Posterior, ...]
    facts: Mapping[str, str]
    provenance: Mapping[str, str]
    damage: Listing | None = None


def campaign_figures(report: CampaignFindings) -> tuple[Drawing, ...]:
    """The density of every parameter by all records."""
    return tuple(posterior_figure(own) for own in report.posteriors)


def page_of_campaign(report: CampaignFindings, drawings: tuple[Drawing, ...]) -> str:
    """The page as HTML text without any resource outside itself; drawings of `campaign_figures`."""
    sections = [
        _records(report),
        _parameters(report, drawings),
        damage_section(report.damage),
        _warnings(report),
        _files(report),
        _provenance(report),
    ]
    return document("test", report.name, report.title, _answer(report), sections, FOOTER)


def _answer(report: CampaignFindings) -> str:
    text = f'<strong class="bad">{escape(report.warnings[0])}</strong> ' if report.warnings else ""
    found = ", ".join(
        f"{escape(own.name)} {measure(own.estimate, own.unit)} ({_sigma(own)})" for own in report.parameters
    )
    samples = sum(own.file.samples for own in report.records)
    said = f"<strong>{found}</strong>, from" if found else "From"
    return f"{text}{said} {count(samples)} samples in {count(len(report.records))} records."


def _sigma(own: Unknown) -> str:
    if own.std is None:
        return "σ withheld"
    return f"± {share(own.std / abs(own.estimate) if own.estimate else math.nan)}"


def _records(report: CampaignFindings) -> str:
    loads = report.records[0].loads
    head = ["record", "date", "duration"]
    for own in loads:
        head += [f"{own.name}, peak", "± σ there", f"{own.name}, RMS", "± σ"]
    head += ["innovations within 2σ", "verdict"]
    rows = []
    for record in report.records:
        row = [
            f'<a href="{escape(record.page)}">{escape(record.name)}</a>',
            escape(record.file.date) or "–",
            measure(record.file.duration, "s"),
        ]
        for own in record.loads:
            peak, at_peak = (None, None) if own.peak is None else (own.peak.largest[0], own.peak_std)
            row += [
                measure(peak, own.unit),
                _std(at_peak, own.unit),
                measure(own.estimate, own.unit),
                _std(own.std, own.unit),
            ]
        tone = "good" if record.fits else "bad"
        row += [share(record.inside), f'<span class="{tone}">{escape(record.verdict)}</span>']
        rows.append(row)
    text = table(
        "records",
        head,
        rows,
        caption="Each record has a page of its own. Of innovations, measured less foreseen, 95 % are within 2σ where the model "
        "and the stated noise hold.",
        numeric=range(2, len(head) - 1),
    )
    return f'<h2 id="records">Record by record</h2><div class="card">{text}</div>'


def _std(value: float | None, unit: str) -> str:
    return "withheld" if value is None or math.isnan(value) else measure(value, unit, 2)


def _parameters(report: CampaignFindings, drawings: tuple[Drawing, ...]) -> str:
    if not report.parameters:
        return ""
    names = [own.name for own in report.records]
    rows = []
    for own in report.parameters:
        each = [measure(value, own.unit) for value in report.alone[own.name]]
        rows.append([escape(own.name), measure(own.estimate, own.unit), _std(own.std, own.unit), *each])
    text = table(
        "parameters",
        ("parameter", "together", "± claimed σ", *(f"{escape(name)} alone" for name in names)),
        rows,
        caption="The most likely value by each record alone stands beside that by all of them that agree with the model.",
        numeric=range(1, 3 + len(names)),
    )
    doubts = [doubt for own in report.parameters for doubt in own.doubts]
    said = f'<div class="card warnings">{bullets(doubts)}</div>' if doubts else ""
    cards = figures(figure(own, i) for i, own in enumerate(drawings))
    return f'<h2 id="parameters">Parameters, the same in all records</h2><div class="card">{text}</div>{said}{cards}'


def _warnings(report: CampaignFindings) -> str:
    if not report.warnings:
        return ""
    return f'<h2 id="warnings">Warnings</h2><div class="card warnings">{bullets(report.warnings)}</div>'


def _files(report: CampaignFindings) -> str:
    rows = [
        [
            escape(own.name),
            escape(own.file.name),
            "<wbr>".join(own.file.sha256[i : i + 16] for i in range(0, len(own.file.sha256), 16)),
            escape(own.file.format),
            plain(own.file.rate),
            count(own.file.samples),
        ]
        for own in report.records
    ]
    text = table("files", ("record", "file", "SHA-256", "format", "rate [Hz]", "samples"), rows, numeric=(4, 5))
    return f'<h2 id="file">The files of the test</h2><div class="card">{text}</div>'


def _provenance(report: CampaignFindings) -> str:
    cards = ""
    for name, entries in (("Model and run", report.facts), ("Provenance", report.provenance)):
        if entries:
            cards += f'<section class="card"><h3>{name}</h3>{pairs(name.lower(), entries.items())}</section>'
    return f'<h2>What it rests on</h2><div class="panels">{cards}</div>' if cards else ""
