"""A table that the console shows too, as a section of a page."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

from strainsight.report.page.markup import table


@dataclass(frozen=True)
class Listing:
    """Plain text: title, columns, and rows with a cell for each; `numeric` columns are flush right."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: tuple[int, ...] = ()


def listing_section(heading: str, own: Listing | None, lead: str = "") -> str:
    """The table below a heading; "" where there is none."""
    if own is None or not own.rows:
        return ""
    head, rows = [escape(name) for name in own.columns], [[escape(cell) for cell in row] for row in own.rows]
    text = table(own.title, head, rows, caption=escape(lead), numeric=own.numeric)
    return f'<h2>{escape(heading)}</h2><div class="card">{text}</div>'


def damage_section(own: Listing | None) -> str:
    """Hot spots and virtual gauges."""
    return listing_section(
        "Fatigue damage", own, "Of the hottest spots of the surface, none near another, and of virtual gauges."
    )
