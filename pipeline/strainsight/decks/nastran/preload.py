"""Modes that a deck asks for about a loaded state."""

from __future__ import annotations

import re

from strainsight.decks.effects import PRELOAD
from strainsight.decks.nastran.cards import Deck
from strainsight.decks.nastran.parameters import large_displacements
from strainsight.decks.text import Line

_SOLUTION = re.compile(r"\s*SOL[\s=]+(\w+)", re.IGNORECASE)
_STATSUB = re.compile(r"\s*STATSUB\b\s*(\(.*?\))?\s*=", re.IGNORECASE)
_METHOD = re.compile(r"\s*C?METHOD\b\s*(\(.*?\))?\s*=", re.IGNORECASE)
_MODES = re.compile(r"\s*(NLIC\b|ANALYSIS\s*=\s*(MODES|MCEIG|DCEIG|MFREQ|DFREQ|MTRAN|DTRAN))", re.IGNORECASE)
_LOADED = re.compile(r"\s*ANALYSIS\s*=\s*(NLST|STATIC|PRELOAD)", re.IGNORECASE)
BUCKLING = {"105", "SEBUCKL", "5"}
STATIC = {"106", "NLSTATIC", "66"}
"""Nonlinear statics: METHOD beside LGDISP asks for the modes about the loaded state."""
STEPS = {"400", "401", "402"}
"""Solutions of several steps, in which modes follow statics; displacements may be large unless LGDISP says they are not."""


def preloads(deck: Deck) -> dict[str, list[Line]]:
    """Cards as `Mesh.ignored` names them, "PRELOAD by STATSUB" → the lines of the case control that ask for it."""
    control = deck.case_control
    solution = next((match[1].upper() for line in control if (match := _SOLUTION.match(line.text))), "")
    found: dict[str, list[Line]] = {}
    if solution not in BUCKLING:
        found["STATSUB"] = [line for line in control if _STATSUB.match(line.text)]
    large = large_displacements(deck)
    if solution in STATIC and large:
        found[f"SOL {solution}"] = [line for line in control if _METHOD.match(line.text)]
    loaded = any(_LOADED.match(line.text) for line in control)
    if solution in STEPS and loaded and large is not False:
        found[f"SOL {solution}"] = [line for line in control if _MODES.match(line.text)]
    return {f"{PRELOAD} by {name}": lines for name, lines in found.items() if lines}
