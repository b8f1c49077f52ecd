"""The table of docs/reproduction.md, from the numbers of the suite that `make thesis` runs: `python docs/reproduction.py`.

Another suite.h5 may be given as an argument. Only what stands below its heading is made; the rest is written by hand. A row that
does not hold and says no reason ends it.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

from strainsight.records.record import read
from strainsight.records.suite import SuiteNumbers
from strainsight.report.suite.data import unexplained
from strainsight.workflow.artefact import Artefact

PAGE = Path(__file__).parent / "reproduction.md"
HEADING = "## Figure by figure\n"
COLUMNS = ("", "the thesis", "printed", "as printed, here", "ours", "")


def below(numbers: SuiteNumbers) -> str:
    """How many rows came to which verdict, and a row a comparison."""
    rows, text = numbers.comparisons, [f"{len(numbers.runs.name)} runs."]
    text[0] += "".join(f" {verdict.capitalize()}: {many}." for verdict, many in Counter(rows.verdict).items())
    text += ["", line(COLUMNS), line(["---"] * len(COLUMNS))]
    for source, says, printed, theirs, ours, verdict, why in zip(
        rows.source, rows.says, rows.printed, rows.as_printed, rows.ours, rows.verdict, rows.why, strict=True
    ):
        text.append(line([source, says, printed, theirs, ours, f"**{verdict}**" + (f". {why}" if why else "")]))
    return "\n".join(text) + "\n"


def line(cells) -> str:
    """A row of a table."""
    return "| " + " | ".join(own.replace("|", "\\|") for own in cells) + " |"


def without_reason(numbers: SuiteNumbers) -> list[str]:
    """Rows whose verdict owes a reason."""
    rows = numbers.comparisons
    return [
        f"{source}, {says}: {verdict}"
        for source, says, verdict, why in zip(rows.source, rows.says, rows.verdict, rows.why, strict=True)
        if unexplained(verdict, why)
    ]


if __name__ == "__main__":
    found = read(SuiteNumbers, Artefact(Path(sys.argv[1] if len(sys.argv) > 1 else "results/thesis/suite.h5")))
    if owing := without_reason(found):
        sys.exit("why is missing in configs/thesis/suite.yaml:\n" + "\n".join(owing))
    by_hand = PAGE.read_text(encoding="utf-8").split(HEADING)[0]
    PAGE.write_text(by_hand + HEADING + below(found), encoding="utf-8")
