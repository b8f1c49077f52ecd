"""What is wrong with estimates and what the placement gains, in the words that lead a page and its title."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape

from strainsight.estimation.decision import DIVERGED, LOST, OVERCONFIDENT, WITHHELD
from strainsight.pages.page.markup import plain, share
from strainsight.pages.placement.data import Unknown

HARDLY = "the measurements hardly narrow it"


def faults(unknown: Unknown, diverged: bool = False) -> tuple[str, ...]:
    """What is wrong with the estimate of an unknown, empty where nothing is; diverged: whether a repeat did."""
    wrong = [DIVERGED] * (diverged or (unknown.error is not None and not math.isfinite(unknown.error)))
    wrong += [WITHHELD] * unknown.withheld
    wrong += [OVERCONFIDENT] * (bool(unknown.claims) and unknown.claims[0].overconfident)
    return (*wrong, *[LOST] * unknown.lost)


def why(fault: str, unknown: Unknown) -> str:
    """A fault and what it stands on, as HTML."""
    if fault == OVERCONFIDENT:
        return unknown.claims[0].words(plain)
    return f"{LOST} ({HARDLY})" if fault == LOST else fault


def headline(accusations: Iterable[tuple[str, Sequence[str]]]) -> str:
    """Faults by unknown as the beginning of a page's title, empty where there are none."""
    parts = [f"{name} {' and '.join(faults)}" for name, faults in accusations if faults]
    return f"✕ {', '.join(parts)} – " if parts else ""


def leading(unknowns: Sequence[Unknown]) -> str:
    """What a page begins with, as HTML: what does not hold, and unknowns for which the placement gains nothing."""
    text = ""
    for unknown in unknowns:
        wrong = faults(unknown)
        off = f"; it is {share(unknown.error)} off" * (OVERCONFIDENT in wrong)
        text += accused(unknown.name, [why(fault, unknown) for fault in wrong], off)
    return text + no_benefit(unknowns)


def accused(name: str, faults: Sequence[str], more: str = "") -> str:
    """What is wrong with an unknown, as HTML; empty where nothing is."""
    return f'<strong class="bad">{escape(name)}: {", ".join(faults)}{more}.</strong> ' if faults else ""


def no_benefit(unknowns: Sequence[Unknown]) -> str:
    """That random layouts do as well, of which unknowns, as HTML; empty where none is so."""
    none = _as_well(unknowns, "none")
    if not none:
        return ""
    of = "" if len(none) == len(unknowns) else f" for {' and '.join(none)}"
    counts = " and ".join(many + f" ({name})" * (len(none) > 1) for name, many in none.items())
    text = f"Placement brings no benefit here{of}: {counts} random layouts of the same size do as well."
    return f'<strong class="bad">{text}</strong> '


def not_shown(unknowns: Sequence[Unknown]) -> list[str]:
    """Sentences, as HTML: of which unknowns too many random layouts do as well to tell."""
    return [
        f"That the placement helps {name} is not shown: {many} random layouts of the same size do as well."
        for name, many in _as_well(unknowns, "not shown").items()
    ]


def _as_well(unknowns: Sequence[Unknown], verdict: str) -> dict[str, str]:
    """Names of the unknowns of that benefit → how many random layouts do as well, as HTML."""
    benefits = {escape(one.name): one.benefit for one in unknowns if one.benefit and one.benefit.result == verdict}
    return {name: f"{plain(benefit.as_well)} of {plain(benefit.sets)}" for name, benefit in benefits.items()}
