"""The tables of docs/artefacts.md, from the records: `python docs/artefact_reference.py` writes them anew.

Only tables are made; what stands around them is written by hand.
"""

from __future__ import annotations

import re
from pathlib import Path

from strainsight.records.artefacts import BENCH, BESIDE, PLACEMENT, SHARED
from strainsight.records.record import FieldPlace, listed

PAGE = Path(__file__).parent / "artefacts.md"
HEAD = "| dataset | shape | unit | what |\n|---|---|---|---|\n"


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
