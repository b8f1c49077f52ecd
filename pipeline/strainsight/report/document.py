"""The frame of every page: one self-contained file that fetches nothing and runs nothing."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from importlib.resources import files

# Nothing is fetched and nothing runs, whatever a name in a deck contains.
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


def document(
    kind: str, name: str, title: str, answer: str, sections: Iterable[str], footer: str, styles: Iterable[str] = ()
) -> str:
    """HTML text of a page. kind ("gauge placement"), name of the run, title: plain text; answer, sections, footer: HTML;
    styles: files beside page.css whose rules come after its own."""
    folder = files("strainsight.report")
    css = "".join(folder.joinpath(style).read_text(encoding="utf-8") for style in ("page.css", *styles))
    return "\n".join(
        (
            "<!DOCTYPE html>",
            '<html lang="en"><head><meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">',
            f"<title>{escape(title)} – strainsight</title><style>\n{css}</style></head><body>",
            f'<header><p class="eyebrow">strainsight · {kind} · {escape(name)}</p>',
            f"<h1>{escape(title)}</h1>",
            f'<p class="answer">{answer}</p></header><main>',
            *(section for section in sections if section),
            "</main>",
            f"<footer>{footer}</footer></body></html>\n",
        )
    )
