"""Self-contained HTML document, and sections common to several pages; a section without content is ""."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from hashlib import sha256
from html import escape
from importlib.resources import files

from strainsight.estimation.decision import CONSISTENT, classify_ratio
from strainsight.pages.page.markup import bullets, figures, measure, pairs, plain, share, table, titled
from strainsight.records.estimated import GRID_FILTER, Compared
from strainsight.runner.output import Table
from strainsight.text import percent

PARTS = files("strainsight.pages")
SPACE_STYLE, SPACE_SCRIPTS = "space/space.css", ("space/draw.js", "space/view.js")
"""Style and scripts of the 3D view; the scripts are concatenated."""


def document(
    kind: str,
    name: str,
    title: str,
    answer: str,
    sections: Iterable[str],
    footer: str,
    style: str = "",
    *,
    turned: bool = False,
) -> str:
    """HTML text of a page.

    kind ("gauge placement"), name of the run, title: plain text; answer, sections, footer: HTML; style: file with additional
    rules; turned: whether a section has a 3D view."""
    css = "".join(map(text_of, ["page/page.css", *filter(None, [style]), *[SPACE_STYLE] * turned]))
    running = [text_of("page/tables.js"), *["\n".join(map(text_of, SPACE_SCRIPTS))] * turned]
    return "\n".join(
        (
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f'<meta http-equiv="Content-Security-Policy" content="{policy(running)}">',
            f"<title>{escape(title)} – strainsight</title><style>\n{css}</style></head><body>",
            f'<header><p class="eyebrow">strainsight · {kind} · {escape(name)}</p>',
            f"<h1>{escape(title)}</h1>",
            f'<p class="answer" id="in-short">{answer}</p></header><main data-run="{escape(name)}">',
            *(section for section in sections if section),
            "</main>",
            f"<footer>{footer}</footer>",
            *(f'<script type="module">{script}</script>' for script in running),
            "</body></html>\n",
        )
    )


def text_of(name: str) -> str:
    """Text of a file below `pages/`."""
    return PARTS.joinpath(name).read_text(encoding="utf-8")


def policy(scripts: Iterable[str]) -> str:
    """Content security policy of a page: no resources are fetched, and only these scripts run."""
    digests = (base64.b64encode(sha256(script.encode()).digest()).decode() for script in scripts)
    allowed = " ".join(f"'sha256-{digest}'" for digest in digests)
    return f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {allowed}"


COLOURS = ("blue", "vermilion", "green", "orange", "purple", "sky", "ink")
OTHER, REST = "other sources", "muted"
"""The smallest sources, without a colour, are one part of a bar."""
BUDGET = (
    "Shares of the variance of the filtered estimate: of a parameter at the end of the run, of a load over the second half of "
    "the run. Noise: gauge noise. Process noise: assumed random changes of the loads, and assumed model errors. "
    "Start: initial uncertainty of the filter."
)
LEAD = (
    "All filters use the same measured samples and the same model. σ does not include the errors in the config section "
    "`tolerances`. Only the approximations of the filters differ."
)
FILTERS = (
    "The parameter grid filter applies Bayes' rule by quadrature. The sigma-point and extended filters assume normal "
    "distributions, and the extended filter neglects the product of parameter and state errors. Ratio: RMS deviation "
    "of the estimate from the posterior of the grid filter, divided by the claimed σ of the estimate. With a ratio above 2 the "
    "claimed σ is overconfident, with a ratio below 0.5 too cautious."
)
DAMAGE = "Fatigue damage at virtual gauges and at hot spots of the surface. Hot spots have a minimum distance from each other."


def section(heading: str, content: str, name: str = "", kind: str = "card", lead: str = "", more: str = "") -> str:
    """Heading and HTML in a box of this kind, "" without content; name: link target; lead: sentence between them; more: HTML
    below the box."""
    box = titled(heading, lead, name) + f'<div class="{kind}">{content}</div>{more}'
    return box if content else ""


def panel(heading: str, content: str) -> str:
    """Card with a heading."""
    return f'<section class="card"><h3>{heading}</h3>{content}</section>' if content else ""


def first_screen(content: str, cautions: Iterable[str]) -> str:
    """First screen, with cards of cautions below its content."""
    return f'<section id="answer" aria-label="answer">{content}{figures(cautions, grid="cautions")}</section>'


def caution(heading: str, content: str, kind: str = "notes") -> str:
    """Card with a caution, empty without content."""
    return f'<div class="card {kind}"><h2>{heading}</h2>{content}</div>' if content else ""


def warnings_section(warnings: Sequence[str]) -> str:
    """Warnings, the most serious first."""
    return section("Warnings", bullets(warnings), "warnings", "card warnings")


def advice_card(advice: Sequence[str], level: str = "h2") -> str:
    """Advice on a layout; level: of the heading."""
    return notes_card("Advice on this layout", bullets(advice), level)


def notes_card(heading: str, content: str, level: str = "h2", kind: str = "notes advice") -> str:
    """Separate card; level: of its heading."""
    return f'<section class="card {kind}"><{level}>{heading}</{level}>{content}</section>' if content else ""


def provenance_section(facts: Mapping[str, str], provenance: Mapping[str, str], more: str = "") -> str:
    """Panels of model and run, `more`, and provenance."""
    first, last = (
        panel(heading, pairs(heading.lower(), entries.items()) if entries else "")
        for heading, entries in (("Model and run", facts), ("Provenance", provenance))
    )
    return section("Model and provenance", f"{first}{more}{last}", kind="panels")


def listing_section(heading: str, listed: Table | None, numeric: Iterable[int], lead: str = "") -> str:
    """Section with a table of the terminal; `numeric` columns are right-aligned."""
    if listed is None or not listed.rows:
        return ""
    head, *rows = ([*map(escape, row)] for row in (listed.columns, *listed.rows))
    return section(escape(heading), table(listed.title, head, rows, caption=escape(lead), numeric=numeric))


def damage_section(listed: Table | None) -> str:
    """Damage of hot spots and virtual gauges."""
    return listing_section("Fatigue damage", listed, (2, 4), DAMAGE)


def consistency_mark(result: str) -> str:
    """A result with a tick if it is consistent, else with a cross; empty without a result."""
    return f"{'✓' if result == CONSISTENT else '✕'} {result}" * bool(result)


def filters_section(compared: Compared | None, units: Mapping[str, str]) -> str:
    """Comparison of filters on the same samples: one row per parameter and filter."""
    if compared is None:
        return ""
    rows = []
    for name, estimates in compared.estimate.items():
        columns = (compared.filter, estimates.tolist(), compared.std[name].tolist(), compared.ratio[name].tolist())
        for kind, estimate, std, ratio in zip(*columns, strict=True):
            result = "" if kind == GRID_FILTER else classify_ratio(ratio)
            numbers = [measure(estimate, units[name]), share(std / estimate), plain(ratio, 3) if result else "–"]
            rows.append([escape(name), escape(kind), *numbers, consistency_mark(result)])
    head = ("parameter", "filter", "estimate", "claimed σ", "ratio", "consistency")
    text = table("filters compared", head, rows, caption=FILTERS, numeric=(2, 3, 4))
    return section("Comparison of filters", text, lead=LEAD)


def budget_section(budget: Mapping[str, Mapping[str, float]]) -> str:
    """Bars, legend and table of the variance budget; budget: unknown → source → share of its variance."""
    sources = dict.fromkeys(source for shares in budget.values() for source in shares)
    order = sorted(sources, key=lambda source: -max(shares.get(source, 0.0) for shares in budget.values()))
    colour = dict(zip(order, COLOURS, strict=False))
    bars = "".join(_bar(name, shares, colour) for name, shares in budget.items())
    shown = {**colour, **({OTHER: REST} if len(order) > len(colour) else {})}
    key = "".join(
        f'<li><i style="background:var(--{tone})"></i>{escape(source)}</li>' for source, tone in shown.items()
    )
    rows = [[escape(name), *(share(shares.get(source)) for source in order)] for name, shares in budget.items()]
    head = ["unknown", *map(escape, order)]
    text = table(
        "share of each error source in the variance of each estimate",
        head,
        rows,
        caption=BUDGET,
        numeric=range(1, len(head)),
    )
    content = f'{bars}<ul class="key">{key}</ul><div class="below">{text}</div>' if budget else ""
    return section("Sources of uncertainty", content)


def _bar(name: str, shares: Mapping[str, float], colour: Mapping[str, str]) -> str:
    """Stacked bar of the sources of one unknown, with alternative text."""
    parts = {source: shares.get(source, 0.0) for source in colour}
    parts[OTHER] = sum(value for source, value in shares.items() if source not in colour)
    largest = sorted(parts, key=lambda source: -parts[source])
    words = ", ".join(f"{source} {percent(parts[source], 2)}" for source in largest if parts[source] >= 0.005)
    pieces = "".join(
        f'<i style="width:{100 * value:.2f}%;background:var(--{colour.get(source, REST)})"></i>'
        for source, value in parts.items()
        if value >= 0.0005
    )
    label = escape(f"Variance of {name}: {words}.")
    return f'<p class="of">{escape(name)}</p><div class="bar" role="img" aria-label="{label}">{pieces}</div>'
