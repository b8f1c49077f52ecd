"""What the variance of every unknown is made of: a bar of its sources, and their shares."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

from strainsight.report.page.markup import share, table
from strainsight.report.text import percent

COLOURS = ("blue", "vermilion", "green", "orange", "purple", "sky", "ink")
OTHER, REST = "all others", "muted"
"""Sources beyond the colours, the smallest, are one part of a bar."""
CAPTION = (
    "Shares of the variance of the filtered estimate, of a parameter at the end of the run, of a load over its last half. noise: "
    "of the gauges; process noise: what the loads and the motion may do beside their model; start: what is not known at first."
)


def budget_section(budget: Mapping[str, Mapping[str, float]]) -> str:
    """Bars, their key and the table; nothing without a budget. budget: unknown's name → source → share of its variance."""
    if not budget:
        return ""
    sources = list(dict.fromkeys(source for shares in budget.values() for source in shares))
    largest = {source: max(shares.get(source, 0.0) for shares in budget.values()) for source in sources}
    order = sorted(sources, key=lambda source: -largest[source])
    colour = dict(zip(order, COLOURS, strict=False))
    bars = "".join(_bar(name, shares, colour) for name, shares in budget.items())
    shown = {**colour, **({OTHER: REST} if len(order) > len(colour) else {})}
    key = "".join(
        f'<li><i style="background:var(--{tone})"></i>{escape(source)}</li>' for source, tone in shown.items()
    )
    rows = [[escape(name), *(share(shares.get(source)) for source in order)] for name, shares in budget.items()]
    head = ["variance of", *map(escape, order)]
    text = table("shares of the variance", head, rows, caption=CAPTION, numeric=range(1, len(head)))
    return (
        f'<h2>What the uncertainty is made of</h2><div class="card">{bars}<ul class="key">{key}</ul>'
        f'<div class="below">{text}</div></div>'
    )


def _bar(name: str, shares: Mapping[str, float], colour: Mapping[str, str]) -> str:
    """The sources of one unknown side by side, as wide as their shares; in words for those who do not see it."""
    parts = {source: shares.get(source, 0.0) for source in colour}
    parts[OTHER] = sum(value for source, value in shares.items() if source not in colour)
    largest = sorted(parts.items(), key=lambda part: -part[1])
    said = ", ".join(f"{source} {percent(value, 2)}" for source, value in largest if value >= 0.005)
    pieces = "".join(
        f'<i style="width:{100 * value:.2f}%;background:var(--{colour.get(source, REST)})"></i>'
        for source, value in parts.items()
        if value >= 0.0005
    )
    return (
        f'<p class="of">{escape(name)}</p>'
        f'<div class="bar" role="img" aria-label="{escape(f"Variance of {name}: {said}.")}">{pieces}</div>'
    )
