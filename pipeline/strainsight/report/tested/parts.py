"""What the sections of the page of a test are made from."""

from __future__ import annotations

from dataclasses import dataclass

from strainsight.report.chart.drawing import Drawing
from strainsight.report.page.markup import figure
from strainsight.report.tested.data import Findings


@dataclass(frozen=True)
class Parts:
    """report; drawings of `figures.figures_of_test`; pictures: PNG of every map of the moment, in their order, empty where
    nothing can be rendered; problem: the sentence on why."""

    report: Findings
    drawings: tuple[Drawing, ...]
    pictures: tuple[bytes, ...] = ()
    problem: str = ""


def chosen(parts: Parts, *begins: str) -> list[str]:
    """Cards of the figures whose keys begin so."""
    return [figure(own, i) for i, own in enumerate(parts.drawings) if own.key.startswith(begins)]


def multiples(cards: list[str], unfolded: int = 12) -> str:
    """Cards in a grid of small ones; from number `unfolded` on they are shown on demand."""
    if not cards:
        return ""
    shown, folded = cards[:unfolded], cards[unfolded:]
    text = f'<div class="multiples">{"".join(shown)}</div>'
    if folded:
        more = f"<summary>{len(folded)} more</summary>"
        text += f'<details>{more}<div class="multiples">{"".join(folded)}</div></details>'
    return text
