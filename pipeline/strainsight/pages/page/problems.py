"""Problems of estimates and benefit of the placement, for the first lines and the title of a page."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

from strainsight.estimation.decision import DIVERGED, LOST, OVERCONFIDENT, WITHHELD
from strainsight.pages.page.markup import plain, share
from strainsight.pages.placement.data import Unknown

HARDLY = "the measurements hardly reduce the initial uncertainty of this unknown"


def faults(unknown: Unknown, diverged: bool = False) -> tuple[str, ...]:
    """Problems of the estimate of an unknown; diverged: whether a repeat diverged."""
    wrong = [DIVERGED] * (diverged or (unknown.error is not None and not math.isfinite(unknown.error)))
    wrong += [WITHHELD] * unknown.withheld
    wrong += [OVERCONFIDENT] * (bool(unknown.claims) and unknown.claims[0].overconfident)
    return (*wrong, *[LOST] * unknown.lost)


def why(fault: str, unknown: Unknown) -> str:
    """A problem with its numbers, as HTML."""
    if fault == OVERCONFIDENT:
        return unknown.claims[0].words(plain)
    return f"{LOST} ({HARDLY})" if fault == LOST else fault


def headline(problems: Iterable[tuple[str, Sequence[str]]]) -> str:
    """Problems by unknown as the beginning of a page title, empty without problems."""
    parts = [f"{name} {' and '.join(faults)}" for name, faults in problems if faults]
    return f"✕ {', '.join(parts)} – " if parts else ""


def leading(unknowns: Sequence[Unknown]) -> str:
    """Problems of unknowns and missing benefit of the placement, as HTML at the beginning of a page."""
    text = ""
    for unknown in unknowns:
        wrong = faults(unknown)
        error = f"; error of the estimate: {share(unknown.error)}" * (OVERCONFIDENT in wrong)
        text += problem_text(unknown.name, [why(fault, unknown) for fault in wrong], error)
    return text + no_benefit(unknowns)


def problem_text(name: str, faults: Sequence[str], more: str = "") -> str:
    """Problems of an unknown as HTML, empty without problems."""
    return f'<strong class="bad">{escape(name)}: {", ".join(faults)}{more}.</strong> ' if faults else ""


def no_benefit(unknowns: Sequence[Unknown]) -> str:
    """Warning that random layouts are as good, as HTML; empty if the placement has a benefit."""
    none = _as_well(unknowns, "none")
    if not none:
        return ""
    of = "" if len(none) == len(unknowns) else f" for {' and '.join(none)}"
    counts = " and ".join(many + f" ({name})" * (len(none) > 1) for name, many in none.items())
    text = f"No benefit of the placement{of}: {counts} random layouts with the same number of gauges are at least as accurate."
    return f'<strong class="bad">{text}</strong> '


def not_shown(unknowns: Sequence[Unknown]) -> list[str]:
    """Sentences, as HTML, on unknowns for which a benefit is not significant."""
    return [
        f"The benefit of the placement for {name} is not significant: {many} random layouts with the same number of "
        "gauges are at least as accurate."
        for name, many in _as_well(unknowns, "not shown").items()
    ]


def _as_well(unknowns: Sequence[Unknown], result: str) -> dict[str, str]:
    """Unknown with this benefit → number of random layouts at least as accurate, as HTML."""
    benefits = {escape(one.name): one.benefit for one in unknowns if one.benefit and one.benefit.result == result}
    return {name: f"{plain(benefit.as_well)} of {plain(benefit.sets)}" for name, benefit in benefits.items()}
