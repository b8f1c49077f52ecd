"""Verdicts in words: where the σ claimed for an unknown does not hold, and whether placing the gauges gained anything."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from html import escape

import numpy as np

from strainsight.estimation.verdict import DIVERGED, OVERCONFIDENT, Claim, claim_of
from strainsight.report.page.markup import plain, share
from strainsight.report.placement.data import Unknown
from strainsight.report.text import digits_apart, number
from strainsight.workflow.output import Scalar

LOST = "not identified"
WEAK, CONTRADICTED = "weakly observable", "contradicted by its sensors"
BEYOND, WITHHELD = "beyond the range of the reduced model", "σ is withheld"
BORNE_OUT, UNTESTED = "borne out by the sensors left out", "not contradicted"
HARDLY = "the measurements hardly narrow it"

Shown = Callable[[float, int], str]
"""How a number is written: `number` for people, `plain` for a page."""


def claims_of(name: str, numbers: Mapping[str, Scalar], repeats: tuple[np.ndarray, np.ndarray]) -> tuple[Claim, ...]:
    """All claims of an unknown, first the one that decides.

    numbers: the summary of validate; repeats: error and claimed σ (n,) of them, one draw each. Of a load the smoothed estimate
    counts, too, and errors are RMS of as many draws as the record in time is worth.
    """

    def drawn(error: str, std: str, draws: str) -> tuple[np.ndarray, np.ndarray]:
        many = int(numbers[f"{draws}.{name}"])
        return np.full(many, float(numbers[f"{error}.{name}"])), np.full(many, float(numbers[f"{std}.{name}"]))

    of = {"test": drawn("error", "std", "draws")}
    if f"zero.{name}" in numbers:
        of["smoothed"] = drawn("smoothed", "smoothed_std", "smoothed_draws")
    found = ((key, claim_of(*errors)) for key, errors in (*of.items(), ("repeats", repeats)))
    claims = [replace(claim, of=key) for key, claim in found if claim is not None]
    return tuple(sorted(claims, key=lambda claim: claim.weight, reverse=True))


def in_words(claim: Claim, shown: Shown = number, *, limit: bool = True) -> str:
    """As "overconfident (error 6.6 times the claimed σ, at most 3.21 where it holds)"; limit: whether the most is named."""
    what = {"smoothed": "smoothed error", "repeats": "RMS error of the repeats"}.get(claim.of, "error")
    most = claim.band[1] if limit and claim.verdict == OVERCONFIDENT else None
    return f"{claim.verdict} ({what} {ratio_in_words(claim.ratio, most, shown)})"


def ratio_in_words(ratio: float, most: float | None, shown: Shown = number) -> str:
    """As "6.6 times the claimed σ, at most 3.21 where it holds"; most: the largest ratio where it does, None: not named."""
    digits = 2 if most is None else digits_apart(ratio, most, 2)
    limit = "" if most is None else f", at most {shown(most, max(digits, 3))} where it holds"
    return f"{shown(ratio, digits)} times the claimed σ{limit}"


def faults(unknown: Unknown, diverged: bool = False) -> tuple[str, ...]:
    """What is wrong with the estimate of an unknown, empty where nothing is; diverged: whether a repeat did."""
    found = [DIVERGED] * (diverged or (unknown.error is not None and not math.isfinite(unknown.error)))
    found += [WITHHELD] * unknown.withheld
    found += [OVERCONFIDENT] * (bool(unknown.claims) and unknown.claims[0].verdict == OVERCONFIDENT)
    return (*found, *[LOST] * unknown.lost)


def why(fault: str, unknown: Unknown) -> str:
    """A fault and what it stands on, as HTML."""
    if fault == OVERCONFIDENT:
        return in_words(unknown.claims[0], plain)
    return f"{LOST} ({HARDLY})" if fault == LOST else fault


def headline(found: Iterable[tuple[str, Sequence[str]]]) -> str:
    """Faults by unknown as the beginning of a page's title, empty where there are none."""
    parts = [f"{name} {' and '.join(faults)}" for name, faults in found if faults]
    return f"✕ {', '.join(parts)} – " if parts else ""


def leading(unknowns: Sequence[Unknown]) -> str:
    """What a page begins with, as HTML: what does not hold, and unknowns for which the placement gains nothing."""
    text = ""
    for unknown in unknowns:
        if wrong := faults(unknown):
            off = f"; it is {share(unknown.error)} off" * (OVERCONFIDENT in wrong)
            said = ", ".join(why(fault, unknown) for fault in wrong)
            text += f'<strong class="bad">{escape(unknown.name)}: {said}{off}.</strong> '
    return text + no_benefit(unknowns)


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
