"""The file of the test: what it was, its digest, and what was done to every channel."""

from __future__ import annotations

from html import escape

from strainsight.report.page.markup import bullets, table
from strainsight.report.tested.first import size_in_words
from strainsight.report.tested.parts import Parts
from strainsight.report.text import number, quantity


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
