"""What other filters make of the same samples, and whether their σ allows for what the bank finds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from strainsight.estimation.decision import CONSISTENT
from strainsight.report.page.markup import measure, plain, share, table

LEAD = "The same samples and model, tolerances left out: the filters differ in what they approximate."
CAPTION = (
    "The bank is Bayes' rule but for quadrature; sigma-point and extended filter take parameter and motion as normal, and the "
    "extended one neglects the product of their errors. Ratio: the RMS error that the bank expects of an estimate, over "
    "the σ claimed for it; above 2 overconfident, below 0.5 too cautious."
)


@dataclass(frozen=True)
class OtherFilter:
    """A parameter by one filter: estimate [unit]; std relative, claimed; ratio: RMS error that the bank expects of it over that,
    and the verdict, empty of the bank itself."""

    parameter: str
    unit: str
    filter: str
    estimate: float
    std: float
    ratio: float
    verdict: str = ""


def filters_section(claims: Sequence[OtherFilter]) -> str:
    """A row for every parameter and filter; nothing where none were compared."""
    if not claims:
        return ""
    rows = [
        [
            escape(own.parameter),
            escape(own.filter),
            measure(own.estimate, own.unit),
            share(own.std),
            plain(own.ratio, 3) if own.verdict else "–",
            f"{'✓' if own.verdict == CONSISTENT else '✕'} {own.verdict}" * bool(own.verdict),
        ]
        for own in claims
    ]
    head = ("parameter", "filter", "estimate", "claimed σ", "ratio", "verdict")
    text = table("filters compared", head, rows, caption=CAPTION, numeric=(2, 3, 4))
    return f'<h2>By other filters</h2><p class="lead">{LEAD}</p><div class="card">{text}</div>'
