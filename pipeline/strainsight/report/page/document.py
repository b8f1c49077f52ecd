"""The frame of every page: one self-contained file that fetches nothing and runs nothing but its own scripts."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from hashlib import sha256
from html import escape
from importlib.resources import files

PARTS = files("strainsight.report")
SPACE_STYLE, SPACE_SCRIPTS = "space/space.css", ("space/draw.js", "space/view.js")
"""Files of the page that go with a structure to turn round; the scripts run as one."""


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
    """HTML text of a page. kind ("gauge placement"), name of the run, title: plain text; answer, sections, footer: HTML; style: a
    file beside page.css whose rules come after its own; turned: whether a section has a structure to turn round."""
    styles = ["page/page.css", *filter(None, [style]), *[SPACE_STYLE] * turned]
    css = "".join(map(text_of, styles))
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
    """The text of a file below `report/`."""
    return PARTS.joinpath(name).read_text(encoding="utf-8")


def policy(scripts: Iterable[str]) -> str:
    """The page's content security policy: nothing is fetched, and no script runs but these, each named by its digest;
    whatever a name in a deck contains."""
    digests = (base64.b64encode(sha256(script.encode()).digest()).decode() for script in scripts)
    allowed = " ".join(f"'sha256-{digest}'" for digest in digests)
    return f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {allowed}"
