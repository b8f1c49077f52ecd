"""One self-contained HTML page of a test: what was found first, then what it rests on.

A further section is a function of `Parts` that gives HTML, "" where there is nothing to show, and an entry in SECTIONS; what it
shows stands in `Findings`, its figures in `figures.figures_of_test`.
"""

from __future__ import annotations

from collections.abc import Callable
from html import escape

from strainsight.report.chart.drawing import Drawing
from strainsight.report.page.budget import budget_section
from strainsight.report.page.document import document
from strainsight.report.page.filters import filters_section
from strainsight.report.page.listing import damage_section, listing_section
from strainsight.report.page.markup import bullets, figures, pairs, table
from strainsight.report.space.section import STYLE, script
from strainsight.report.tested.data import Findings
from strainsight.report.tested.field import field_section, space_of
from strainsight.report.tested.first import answer, extremes_section, first_screen, size_in_words
from strainsight.report.tested.hold_out import hold_out_section
from strainsight.report.tested.parts import Parts, chosen, multiples
from strainsight.report.text import number, quantity

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


def file_section(parts: Parts) -> str:
    """What a reader needs to know, a year later, of where the numbers come from."""
    report, own = parts.report, parts.report.file
    facts = {
        "file": escape(own.name),
        "SHA-256": "<wbr>".join(own.sha256[i : i + 16] for i in range(0, len(own.sha256), 16)),
        "size": size_in_words(own.bytes),
        "format": escape(own.format),
        "date": escape(own.date) or "not stated (estimate.date)",
        "sample rate": quantity(own.rate, "Hz"),
        "record": f"{number(own.duration)} s from {number(own.start)} s, {number(own.samples, 12)} samples",
    }
    text = table("file", (), list(facts.items()))
    rows = [[escape(c.name), escape(c.measures), escape(c.unit), escape(c.calibration)] for c in own.channels]
    channels = table("calibration", ("channel", "measures", "unit in the file", "what was done to it"), rows)
    cards = f'<section class="card"><h3>The file</h3>{text}</section>'
    cards += f'<section class="card"><h3>Its channels</h3>{channels}</section>'
    if report.notes:
        cards += f'<section class="card"><h3>What was done to the record</h3>{bullets(report.notes)}</section>'
    return f'<h2 id="file">The file of the test</h2><div class="panels">{cards}</div>'


def _beside(parts: Parts) -> str:
    """Which record of a test this is, and where the others are."""
    if not parts.report.beside:
        return ""
    links = ", ".join(f'<a href="{escape(page)}">{escape(name)}</a>' for name, page in parts.report.beside)
    return f'<p class="lead">Record {escape(parts.report.record)}. The others: {links}.</p>'


def _readings(parts: Parts) -> str:
    lead = '<p class="lead">What each channel measured, and what the estimate says that it reads; below, the difference.</p>'
    shown = multiples(chosen(parts, "reading-"))
    return f"<h2>Measured and reconstructed</h2>{lead}{shown}" if shown else ""


def _checked(parts: Parts) -> str:
    return listing_section("Every channel beside the others", parts.report.checked, CHECKED)


def _damage(parts: Parts) -> str:
    return damage_section(parts.report.damage)


def _residuals(parts: Parts) -> str:
    lead = f'<p class="lead">{SPECTRA}</p>'
    shown = multiples(chosen(parts, "residual-"))
    there = {own.name for own in parts.report.residuals}
    none = [own.label for own in parts.report.readings if own.label not in there]
    if none:
        shown += f'<p class="note">None of {escape(", ".join(none))}: too few samples follow one another.</p>'
    return f"<h2>Spectra of what is left over</h2>{lead}{shown}" if shown else ""


def _loads(parts: Parts) -> str:
    cards = chosen(parts, "load-", "resultant-", "spectrum-", "known-")
    return figures(cards, "<h2>Loads</h2>")


def _parameters(parts: Parts) -> str:
    return figures(chosen(parts, "estimate-", "posterior-"), "<h2>Parameters</h2>")


def _budget(parts: Parts) -> str:
    return budget_section(parts.report.budget)


def _filters(parts: Parts) -> str:
    return filters_section(parts.report.filters)


def _warnings(parts: Parts) -> str:
    if not parts.report.warnings:
        return ""
    return f'<h2 id="warnings">Warnings</h2><div class="card warnings">{bullets(parts.report.warnings)}</div>'


def _provenance(parts: Parts) -> str:
    report, cards = parts.report, ""
    for name, entries in (("Model and run", report.facts), ("Provenance", report.provenance)):
        if entries:
            cards += f'<section class="card"><h3>{name}</h3>{pairs(name.lower(), entries.items())}</section>'
    return f'<h2>What it rests on</h2><div class="panels">{cards}</div>' if cards else ""


SECTIONS: tuple[Callable[[Parts], str], ...] = (
    _beside,
    first_screen,
    _readings,
    _checked,
    hold_out_section,
    _residuals,
    _loads,
    _parameters,
    extremes_section,
    field_section,
    space_of,
    _damage,
    _budget,
    _filters,
    _warnings,
    file_section,
    _provenance,
)
"""What the page shows, from the top."""


def page_of_test(
    report: Findings, drawings: tuple[Drawing, ...], pictures: tuple[bytes, ...] = (), problem: str = ""
) -> str:
    """The page as HTML text without any resource outside itself.

    drawings from `figures.figures_of_test`; pictures: PNG of `field.views_of`, or none with the sentence on why.
    """
    parts = Parts(report, drawings, pictures, problem)
    sections = [section(parts) for section in SECTIONS]
    return document("test", report.name, report.title, answer(report), sections, FOOTER, (STYLE,), (script(),))
