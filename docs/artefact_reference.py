"""The tables of docs/artefacts.md, from the records: `python docs/artefact_reference.py` writes them anew.

Only tables are made; what stands around them is written by hand.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from strainsight.records.bench import (
    AtRest,
    BearingsAlone,
    BenchEstimated,
    BenchPlaced,
    BenchTruths,
    Coupled,
    ReducedBodies,
    Simulated,
    SurfaceInTime,
)
from strainsight.records.estimated import CampaignRecord, Estimated
from strainsight.records.mesh import Imported
from strainsight.records.placed import Observed, Placed
from strainsight.records.record import FieldPlace, listed
from strainsight.records.reduced import Modes, Reduced
from strainsight.records.suite import SuiteNumbers
from strainsight.records.training import Screened, Training
from strainsight.records.validated import Validated

PAGE = Path(__file__).parent / "artefacts.md"
HEAD = "| dataset | shape | unit | what |\n|---|---|---|---|\n"

PLACEMENT: dict[str, Any] = {
    "import": Imported,
    "modes": Modes,
    "rom": Reduced,
    "train": Training,
    "screen": Screened,
    "observe": Observed,
    "place": Placed,
    "spectrum": Modes,
    "validate": Validated,
    "estimate": Estimated,
    "suite": SuiteNumbers,
}
"""Stage of a placement → the record that its artefact is read as; `suite` is one of benches, too."""

BENCH: dict[str, Any] = {
    "reduce": ReducedBodies,
    "bearing": BearingsAlone,
    "place": BenchPlaced,
    "simulate": Simulated,
    "truth": BenchTruths,
    "estimate": BenchEstimated,
    "field": SurfaceInTime,
    "statics": AtRest,
    "modes": Coupled,
}
"""The same of a bench."""
BESIDE: dict[str, Any] = {"estimate.h5 of several records": CampaignRecord}
"""Heading in docs/artefacts.md → what an artefact has in another case."""
SHARED = ("import", "modes", "place", "estimate", "report")
"""Stages of both: docs/artefacts.md says "of a bench" in the heading of the second."""


def table(kind: type) -> str:
    """One row a dataset, by path."""
    rows = sorted(listed(kind, FieldPlace("", what="metric")))
    return HEAD + "".join(f"| `{path}` | {shape} | {unit} | {what} |\n" for path, shape, unit, what in rows)


def renewed(text: str) -> str:
    """The page with the table of every artefact that is a record made anew."""
    kinds = {f"{stage}.h5": kind for stage, kind in PLACEMENT.items()}
    kinds |= {f"{stage}.h5{' of a bench' * (stage in SHARED)}": kind for stage, kind in BENCH.items()}
    for heading, kind in (kinds | BESIDE).items():
        pattern = rf"(^## {re.escape(heading)}\n(?:(?!^## |^\| dataset ).*\n)*)(?:^\|.*\n)+"
        text, found = re.subn(pattern, lambda own, kind=kind: own[1] + table(kind), text, flags=re.MULTILINE)
        if found != 1:
            raise ValueError(f"{PAGE.name} has {found} tables under '{heading}', not one")
    return text


if __name__ == "__main__":
    PAGE.write_text(renewed(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
