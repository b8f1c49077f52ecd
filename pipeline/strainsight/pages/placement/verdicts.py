"""Verdicts in words: where the σ claimed for an unknown does not hold, and whether placing the gauges gained anything."""

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
    found = [DIVERGED] * (diverged or (unknown.error is not None and not math.isfinite(unknown.error)))
    found += [WITHHELD] * unknown.withheld
    found += [OVERCONFIDENT] * (bool(unknown.claims) and unknown.claims[0].overconfident)
    return (*found, *[LOST] * unknown.lost)


def why(fault: str, unknown: Unknown) -> str:
    """A fault and what it stands on, as HTML."""
    if fault == OVERCONFIDENT:
        return unknown.claims[0].words(plain)
    return f"{LOST} ({HARDLY})" if fault == LOST else fault


def headline(found: Iterable[tuple[str, Sequence[str]]]) -> str:
    """Faults by unknown as the beginning of a page's title, empty where there are none."""
    parts = [f"{name} {' and '.join(faults)}" for name, faults in found if faults]
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
    judged = [unknown for unknown in unknowns if unknown.benefit is not None]
    none = [unknown for unknown in judged if unknown.benefit is not None and unknown.benefit.verdict == "none"]
    if not none:
        return ""
    of = "" if len(none) == len(unknowns) else f" for {' and '.join(escape(unknown.name) for unknown in none)}"
    counts = " and ".join(
        f"{plain(own.as_well)} of {plain(own.sets)}" + f" ({escape(unknown.name)})" * (len(none) > 1)
        for unknown in none
        if (own := unknown.benefit) is not None
    )
    text = f"Placement brings no benefit here{of}: {counts} random layouts of the same size do as well."
    return f'<strong class="bad">{text}</strong> '


def not_shown(unknowns: Sequence[Unknown]) -> list[str]:
    """Sentences, as HTML: of which unknowns too many random layouts do as well to tell."""
    return [
        f"That the placement helps {escape(unknown.name)} is not shown: {plain(own.as_well)} of {plain(own.sets)} random "
        "layouts of the same size do as well."
        for unknown in unknowns
        if (own := unknown.benefit) is not None and own.verdict == "not shown"
    ]


def denominator(unknown: Unknown) -> str:
    """What errors and σ of an unknown are relative to."""
    if unknown.kind == "parameter":
        return "of its true value"
    return "of its amplitude" if unknown.zero else "of its RMS"
