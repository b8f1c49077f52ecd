"""HTML page of a test with several records: table of the records, then common results."""

from __future__ import annotations

import math
from dataclasses import dataclass
from html import escape

from strainsight.pages.chart.drawing import Drawing
from strainsight.pages.chart.panels import posterior_figure
from strainsight.pages.page.markup import bullets, count, figure, figures, measure, plain, share, table
from strainsight.pages.page.sections import damage_section, document, provenance_section, section, warnings_section
from strainsight.pages.tested.data import Findings, TestedUnknown
from strainsight.pages.tested.page import broken_digest
from strainsight.records.estimated import CampaignRecord
from strainsight.runner.output import Table

FOOTER = (
    "σ is one standard deviation, as claimed by the filter. All records have the same parameters, and the same errors of gauges, "
    "damping and load application, so these errors do not average out. Load histories, motion and zero offsets differ."
)


@dataclass(frozen=True)
class CampaignFindings:
    """Contents of the page: records, their common results, and damage of all records, None if not requested. Name, unknown
    parameters, facts and provenance are those of the first record."""

    title: str
    records: tuple[Findings, ...]
    shared: CampaignRecord
    warnings: tuple[str, ...]
    damage: Table | None = None

    @property
    def first(self) -> Findings:
        """First record."""
        return self.records[0]

    @property
    def parameters(self) -> tuple[TestedUnknown, ...]:
        """Unknown parameters, estimated from all records."""
        return tuple(unknown for unknown in self.first.unknowns if unknown.kind == "parameter")


def campaign_figures(report: CampaignFindings) -> tuple[Drawing, ...]:
    """Density of every parameter from all records."""
    units = report.first.units
    return tuple(posterior_figure(name, units[name], posterior) for name, posterior in report.shared.posterior.items())


def page_of_campaign(report: CampaignFindings, drawings: tuple[Drawing, ...]) -> str:
    """Self-contained HTML page; drawings: from `campaign_figures`."""
    sections = [
        _records(report),
        _parameters(report, drawings),
        damage_section(report.damage),
        warnings_section(report.warnings),
        _files(report),
        provenance_section(report.first.facts, report.first.provenance),
    ]
    return document("test", report.first.name, report.title, _answer(report), sections, FOOTER)


def _answer(report: CampaignFindings) -> str:
    text = f'<strong class="bad">{escape(report.warnings[0])}</strong> ' if report.warnings else ""
    values = ", ".join(
        f"{escape(unknown.name)} {measure(unknown.estimate, unknown.unit)} "
        + ("(σ withheld)" if unknown.std is None else f"(± {share(unknown.relative)})")
        for unknown in report.parameters
    )
    samples = sum(record.file.samples for record in report.records)
    start = f"<strong>{values}</strong>, from" if values else "From"
    return f"{text}{start} {count(samples)} samples in {count(len(report.records))} records."


def _records(report: CampaignFindings) -> str:
    head = ["record", "date", "duration"]
    for load in report.first.loads:
        head += [f"{escape(load.name)}, peak", "± σ at peak", f"{escape(load.name)}, RMS", "± σ"]
    head += ["innovations within 2σ", "consistency"]
    rows = []
    for record in report.records:
        row = [f'<a href="{escape(record.page)}">{escape(record.record)}</a>']
        row += [escape(record.file.source.date) or "–", measure(record.file.duration, "s")]
        for load in record.loads:
            peak = None if load.peak is None else load.peak.largest[0]
            for value, std in ((peak, load.peak_std), (load.estimate, load.std)):
                row += [measure(value, load.unit), _std(std, load.unit)]
        tone = "good" if record.consistent else "bad"
        rows.append([*row, share(record.inside), f'<span class="{tone}">{escape(record.consistency)}</span>'])
    caption = (
        "Each record has a separate page. With a correct model and noise, 95 % of the innovations (measured − predicted) are "
        "within 2σ."
    )
    text = table("records", head, rows, caption=caption, numeric=range(2, len(head) - 1))
    return section("Records", text, "records")


def _std(value: float | None, unit: str) -> str:
    return "withheld" if value is None or math.isnan(value) else measure(value, unit, 2)


def _parameters(report: CampaignFindings, drawings: tuple[Drawing, ...]) -> str:
    if not report.parameters:
        return ""
    rows = []
    for unknown in report.parameters:
        alone = [measure(value, unknown.unit) for value in report.shared.alone[unknown.name].tolist()]
        together = [measure(unknown.estimate, unknown.unit), _std(unknown.std, unknown.unit)]
        rows.append([escape(unknown.name), *together, *alone])
    head = ["parameter", "joint estimate", "± claimed σ"]
    head += [f"{escape(record.record)} alone" for record in report.records]
    caption = (
        "Joint estimate: most likely value from all records consistent with the model. "
        "Columns “alone”: most likely value from one record."
    )
    text = table("parameters", head, rows, caption=caption, numeric=range(1, len(head)))
    doubts = bullets(doubt for unknown in report.parameters for doubt in unknown.doubts)
    warned = f'<div class="card warnings">{doubts}</div>' if doubts else ""
    cards = figures(figure(entry, i) for i, entry in enumerate(drawings))
    return section("Parameters common to all records", text, "parameters", more=warned) + cards


def _files(report: CampaignFindings) -> str:
    rows = []
    for record in report.records:
        file, source = record.file, record.file.source
        cells = [escape(record.record), escape(source.file), broken_digest(source.sha256), escape(source.format)]
        rows.append([*cells, plain(file.rate), count(file.samples)])
    text = table("files", ("record", "file", "SHA-256", "format", "rate [Hz]", "samples"), rows, numeric=(4, 5))
    return section("Files of the test", text, "file")
