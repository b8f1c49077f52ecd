"""HTML elements; text from configs and decks is escaped here."""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Iterable, Sequence
from html import escape

import numpy as np

from strainsight.pages.arrays import FloatArray
from strainsight.pages.chart import drawing
from strainsight.pages.chart.drawing import Drawing
from strainsight.positions import METRES, PositionAxes
from strainsight.text import number, percent, quantity

AXES = METRES.heads
LONGEST = 20
"""Longest word in a column heading that is not broken."""
FEW_COLUMNS = 4
"""Columns of a table that fit on a phone; of a wider one every row becomes a list."""
UNFOLDED = 12
"""Figures of a kind that are shown without unfolding."""
THEME = {"#ffffff": "var(--card)"} | {
    getattr(drawing, name.upper()): f"var(--{name})"
    for name in ("blue", "vermilion", "green", "orange", "purple", "sky", "ink", "muted", "grid")
}


def data(value: float, shown: str, unit: str = "") -> str:
    """Formatted number with its exact value; unit: of the exact value."""
    exact = str(value) if isinstance(value, int) else repr(float(value))
    attribute = f' data-unit="{escape(unit)}"' if unit else ""
    return f'<data value="{exact}"{attribute}>{escape(shown)}</data>'


def count(value: int) -> str:
    """An integer."""
    return data(int(value), number(value))


def share(value: float | None) -> str:
    """A ratio in per cent, or a dash for None."""
    return "–" if value is None else data(value, percent(value))


def measure(value: float | None, unit: str = "", digits: int = 4) -> str:
    """A number with its unit, or a dash for None."""
    return "–" if value is None else data(value, quantity(value, unit, digits), unit)


def plain(value: float, digits: int = 4) -> str:
    """A dimensionless number."""
    return data(value, number(value, digits))


def links(name: str, places: Iterable[int]) -> str:
    """Links to numbered targets of the page: `name-1`, `name-3`."""
    return ", ".join(f'<a href="#{name}-{i}">{i}</a>' for i in places)


def result_mark(result: str, good: bool, bad: str = "✕") -> str:
    """A result in a table with a tick if it is good, else with the character `bad`."""
    return f'<strong class="{"good" if good else "bad"} whole">{"✓" if good else bad} {result}</strong>'


def bullets(sentences: Iterable[str]) -> str:
    """Escaped bullet list, empty without items."""
    return items(map(escape, sentences))


def items(texts: Iterable[str]) -> str:
    """Bullet list of HTML, empty without items."""
    listed = "".join(f"<li>{text}</li>" for text in texts)
    return f"<ul>{listed}</ul>" if listed else ""


def table(
    name: str,
    head: Sequence[str],
    rows: Iterable[Sequence[str]],
    *,
    title: str = "",
    caption: str = "",
    numeric: Iterable[int] = (),
    foot: Sequence[str] = (),
) -> str:
    """Table of HTML cells; the first cell of a row is its heading, `numeric` columns are right-aligned.

    name: unique on the page; title, caption: HTML above it."""
    right = frozenset(numeric)

    stacked = len(head) > FEW_COLUMNS
    names = {i: re.sub(r"<[^>]*>", " ", text) for i, text in enumerate(head) if stacked}

    def line(cells: Sequence[str]) -> str:
        rest = "".join(cell(text, right=i in right, head=names.get(i, "")) for i, text in enumerate(cells) if i)
        return f'<tr><th scope="row">{cells[0]}</th>{rest}</tr>'

    above, below = _head(head, right) if head else "", f"<tfoot>{line(foot)}</tfoot>" if foot else ""
    kind = ' class="stacked"' * stacked
    return sheet(name, f"<table{kind}>{above}<tbody>{''.join(map(line, rows))}</tbody>{below}</table>", title, caption)


def grouped_table(
    name: str, head: Sequence[str], bodies: Iterable[str], *, caption: str = "", numeric: Iterable[int] = ()
) -> str:
    """Table of blocks of rows (`<tbody>…</tbody>`) that stay together when sorted; others: see `table`."""
    return sheet(
        name, f'<table class="runs">{_head(head, frozenset(numeric))}{"".join(bodies)}</table>', caption=caption
    )


def block(heading: str, rows: Sequence[Sequence[str]], once: Sequence[str] = (), after: int = 1) -> str:
    """Block of `grouped_table`; heading and the cells `once`, after `after` cells, span all rows; rows consist of `cell`."""
    span = f' rowspan="{len(rows)}"' if len(rows) > 1 else ""
    first = f'<th scope="rowgroup"{span}>{heading}</th>'
    shared = "".join(f'<td class="n"{span}>{text}</td>' for text in once)
    lines = []
    for i, row in enumerate(rows):
        head, middle = (first, shared) if i == 0 else ("", "")
        lines.append(f"<tr>{head}{''.join(row[:after])}{middle}{''.join(row[after:])}</tr>")
    return f"<tbody>{''.join(lines)}</tbody>" if rows else ""


def cell(text: str, *, right: bool = False, across: int = 1, head: str = "") -> str:
    """Cell of a block; right: right-aligned; across: number of columns; head: HTML text of its heading on a narrow screen."""
    number = ' class="n"' if right else ""
    span = f' colspan="{across}"' if across > 1 else ""
    name = f' data-head="{head}"' if head else ""
    return f"<td{number}{span}{name}>{text}</td>"


def _head(names: Sequence[str], right: frozenset[int]) -> str:
    """Column headings; very long words may be broken anywhere."""
    cells = ""
    for i, name in enumerate(names):
        longest = max(map(len, re.sub(r"<[^>]*>", " ", name).split()), default=0)
        kinds = " ".join(["n"] * (i in right) + ["v"] * (longest > LONGEST))
        kind = f' class="{kinds}"' if kinds else ""
        cells += f'<th scope="col"{kind}>{name}</th>'
    return f"<thead><tr>{cells}</tr></thead>"


def sheet(name: str, text: str, title: str = "", caption: str = "") -> str:
    """A table in a scrollable region, with title and caption; tables.js adds its buttons by name."""
    note = f'<p class="note">{caption}</p>' if caption else ""
    label = escape(name)
    return (
        f'<div class="sheet"><div class="over">{title}{note}</div>'
        f'<div class="scroll" data-table="{label}" tabindex="0" role="region" aria-label="table: {label}">{text}</div></div>'
    )


def pairs(name: str, entries: Iterable[tuple[str, str]]) -> str:
    """Table of escaped names and values; name: see `table`."""
    return table(name, (), [(escape(key), f"<span>{escape(value)}</span>") for key, value in entries])


def tile(name: str, value: str, rows: Sequence[tuple[str, str]] = (), after: str = "") -> str:
    """Card with a key number: name, value and further rows that are known; all as HTML."""
    items = "".join(f"<dt>{what}</dt><dd>{text}</dd>" for what, text in rows if text != "–")
    return (
        f'<div class="card tile"><h2 class="name">{name}</h2><p class="value">{value}</p>'
        f"{f'<dl>{items}</dl>' if items else ''}{after}</div>"
    )


def mark(text: str, good: bool) -> str:
    """Result in a tile with tick or cross."""
    return f'<p class="mark {"good" if good else "bad"}">{"✓" if good else "✕"} {text}</p>'


def badge(label: str, index: int, *, hollow: bool = False) -> str:
    """A gauge label on its colour, or framed by it."""
    colour = drawing.gauge_colour(index)
    ground = "#ffffff" if hollow else colour
    style = f"background:{ground};color:{drawing.ink_on(ground)}" + f";box-shadow:inset 0 0 0 2px {colour}" * hollow
    return f'<span class="badge" style="{style}">{escape(label)}</span>'


def figure(entry: Drawing, index: int) -> str:
    """Card with an inline drawing and its caption."""
    return (
        f'<figure class="card"><h3>{escape(entry.title)}</h3>{inline_svg(entry, f"f{index}-")}'
        f"<figcaption>{escape(entry.caption)}</figcaption></figure>"
    )


def select_figures(drawings: Sequence[Drawing], *begins: str) -> list[str]:
    """Cards of the figures whose keys begin with one of `begins`, numbered by their index in `drawings`."""
    return [figure(entry, i) for i, entry in enumerate(drawings) if entry.key.startswith(begins)]


def figures(cards: Iterable[str], heading: str = "", grid: str = "figures") -> str:
    """Cards side by side below a heading, empty without cards; grid: "figures", or smaller "multiples"."""
    shown = "".join(cards)
    return f'{heading}<div class="{grid}">{shown}</div>' if shown else ""


def folded(cards: Sequence[str], grid: str = "figures", heading: str = "") -> str:
    """Cards as in `figures`; those after UNFOLDED are shown on demand."""
    more = figures(cards[UNFOLDED:], f"<summary>{len(cards) - UNFOLDED} more</summary>", grid)
    return figures(cards[:UNFOLDED], heading, grid) + (f"<details>{more}</details>" if more else "")


def titled(heading: str, lead: str = "", name: str = "") -> str:
    """Heading and optional lead sentence; name: link target."""
    target = f' id="{name}"' if name else ""
    return f"<h2{target}>{heading}</h2>" + f'<p class="lead">{lead}</p>' * bool(lead)


def unfolding(summary: str, content: str) -> str:
    """Card that shows its content on demand."""
    return f'<details class="card below"><summary>{summary}</summary>{content}</details>'


def picture(png: bytes, alt: str, width: int, height: int) -> str:
    """Embedded picture, with size in pixels of the page."""
    source = f"data:image/png;base64,{base64.b64encode(png).decode()}"
    return f'<img alt="{escape(alt)}" width="{width}" height="{height}" src="{source}">'


def scene(png: bytes, alt: str, label: str, width: int = 1280, height: int = 840) -> str:
    """Scrollable picture; label: for assistive technology."""
    shown = picture(png, alt, width, height)
    return f'<div class="scene" tabindex="0" role="region" aria-label="{escape(label)}">{shown}</div>'


def inline_svg(entry: Drawing, prefix: str) -> str:
    """SVG as an inline element with ids under `prefix`, colours of the page theme and alternative text."""
    text = entry.svg.decode()
    text = text[text.index("<svg") :]
    head, body = text.split(">", 1)
    box = re.search(r'viewBox="[^"]*"', head)
    body = re.sub(r'<g id="[^"]*"', "<g", body)
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', body))
    body = re.sub(r' id="([^"]*)"', lambda match: f' id="{prefix}{match[1]}"' if match[1] in used else "", body)
    body = re.sub(r'(?:xlink:)?href="#', f'href="#{prefix}', body).replace("url(#", f"url(#{prefix}")
    body = re.sub(r"#[0-9a-f]{6}\b(?=[;\"\s])", lambda match: THEME.get(match[0], match[0]), body)
    # the default text colour, black, would be invisible on a dark page
    return f'<svg {box[0] if box else ""} role="img" aria-label="{escape(entry.alt)}" fill="var(--ink)">{body}'


def decimals(points: FloatArray, frame: PositionAxes = METRES) -> int:
    """Decimals of positions in the frame's unit, to about 1e-4 of the structure's size; points (n, 3) [m]."""
    size = float(np.linalg.norm(np.ptp(points, axis=0))) / frame.metres
    return min(max(4 - math.floor(math.log10(size)), 0), 9) if size > 0 else 4


def coordinates(position: FloatArray, places: int) -> str:
    """Coordinates with `places` decimals."""
    return " ".join(f"{round(float(value), places) + 0.0:.{places}f}".replace("-", "−") for value in position)


def axes(position: FloatArray, places: int, frame: PositionAxes = METRES) -> list[str]:
    """x, y and z of a position (3,) [m] in the frame as cells with `places` decimals."""
    place = frame.place(position)
    return [data(float(value), coordinates(place[i : i + 1], places)) for i, value in enumerate(place)]
