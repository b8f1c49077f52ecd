"""One self-contained HTML page of a test of several records: the table over records first, then what they share."""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape

from strainsight.pages.chart.drawing import Drawing
from strainsight.pages.chart.panels import posterior_figure
from strainsight.pages.page.markup import bullets, count, figure, figures, measure, plain, share, table
from strainsight.pages.page.sections import damage_section, document, rests_on, section, warnings_section
from strainsight.pages.tested.data import Findings, Unknown
from strainsight.pages.tested.page import broken_digest
from strainsight.records.estimated import CampaignRecord
from strainsight.runner.output import Table

FOOTER = (
    "σ is one standard deviation, as the filter claims it. Parameters are the same in all records, and so are the errors of "
    "gauges, damping and loads, which do not average away; loads, motion and zeros are each record's own."
)


@dataclass(frozen=True)
class RecordRow:
    """A record: what its page shows, the file name of that page; inside: share of its innovations within 2σ; verdict in words."""

    report: Findings
    page: str
    inside: float
    verdict: str


@dataclass(frozen=True)
class CampaignFindings:
    """All that the page shows: records one by one, and what they share; damage of all of them, None where it was not asked
    for. Name, unknown parameters, facts and provenance are those of any record."""

    title: str
    records: tuple[RecordRow, ...]
    shared: CampaignRecord
    warnings: tuple[str, ...]
    damage: Table | None = None

    @property
    def first(self) -> Findings:
        """The first record."""
        return self.records[0].report

    @property
    def parameters(self) -> tuple[Unknown, ...]:
        """The unknown parameters, by all records."""
        return tuple(own for own in self.first.unknowns if own.kind == "parameter")


def campaign_figures(report: CampaignFindings) -> tuple[Drawing, ...]:
    """The density of every parameter by all records."""
    units = report.first.units
    return tuple(posterior_figure(name, units[name], own) for name, own in report.shared.posterior.items())


def page_of_campaign(report: CampaignFindings, drawings: tuple[Drawing, ...]) -> str:
    """The page as HTML text without any resource outside itself; drawings of `campaign_figures`."""
    sections = [
        _records(report),
        _parameters(report, drawings),
        damage_section(report.damage),
        warnings_section(report.warnings),
        _files(report),
        rests_on(report.first.facts, report.first.provenance),
    ]
    return document("test", report.first.name, report.title, _answer(report), sections, FOOTER)


def _answer(report: CampaignFindings) -> str:
    text = f'<strong class="bad">{escape(report.warnings[0])}</strong> ' if report.warnings else ""
    found = ", ".join(
        f"{escape(own.name)} {measure(own.estimate, own.unit)} "
        + ("(σ withheld)" if own.std is None else f"(± {share(own.relative)})")
        for own in report.parameters
    )
    samples = sum(own.report.file.samples for own in report.records)
    said = f"<strong>{found}</strong>, from" if found else "From"
    return f"{text}{said} {count(samples)} samples in {count(len(report.records))} records."


def _records(report: CampaignFindings) -> str:
    head = ["record", "date", "duration"]
    for own in report.first.loads:
        head += [f"{escape(own.name)}, peak", "± σ there", f"{escape(own.name)}, RMS", "± σ"]
    head += ["innovations within 2σ", "verdict"]
    rows = []
    for record in report.records:
        row = [
            f'<a href="{escape(record.page)}">{escape(record.report.record)}</a>',
            escape(record.report.file.source.date) or "–",
            measure(record.report.file.duration, "s"),
        ]
        for own in record.report.loads:
            peak, at_peak = (None, None) if own.peak is None else (own.peak.largest[0], own.peak_std)
            row += [
                measure(peak, own.unit),
                _std(at_peak, own.unit),
                measure(own.estimate, own.unit),
                _std(own.std, own.unit),
            ]
        tone = "good" if record.report.consistent else "bad"
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
    return section("Record by record", text, "records")


def _std(value: float | None, unit: str) -> str:
    return "withheld" if value is None or math.isnan(value) else measure(value, unit, 2)


def _parameters(report: CampaignFindings, drawings: tuple[Drawing, ...]) -> str:
    if not report.parameters:
        return ""
    names = [own.report.record for own in report.records]
    rows = []
    for own in report.parameters:
        each = [measure(value, own.unit) for value in report.shared.alone[own.name].tolist()]
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
    return f"{section('Parameters, the same in all records', text, 'parameters')}{said}{cards}"


def _files(report: CampaignFindings) -> str:
    rows = []
    for own in report.records:
        file, source = own.report.file, own.report.file.source
        cells = [escape(own.report.record), escape(source.file), broken_digest(source.sha256), escape(source.format)]
        rows.append([*cells, plain(file.rate), count(file.samples)])
    text = table("files", ("record", "file", "SHA-256", "format", "rate [Hz]", "samples"), rows, numeric=(4, 5))
    return section("The files of the test", text, "file")
