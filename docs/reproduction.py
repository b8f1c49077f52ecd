"""Tables of the manual from the numbers of suites: `python docs/reproduction.py` after `make thesis` and `make bench`.

    docs/reproduction.md    every comparison of configs/thesis/suite.yaml, from results/thesis/suite.h5
    docs/thesis-runs.md     every statement of configs/bench/suite.yaml, from results/bench/suite.h5

The argument is the folder of the results (default: results). A suite without results leaves its page unchanged. Only the text
below the heading is generated. A row that does not hold needs a reason (`why`) in the suite, else the script ends with an error.
"""

from __future__ import annotations

import re
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

from strainsight.config.load import load_config
from strainsight.config.suite import SuiteConfig
from strainsight.pages.suite.data import Statement, measured, target, unexplained
from strainsight.records.record import read
from strainsight.records.suite import SuiteNumbers
from strainsight.runner.artefact import Artefact

DOCS = Path(__file__).parent
CONFIGS = DOCS.parent / "configs"
RESULTS = {"contradicted": "does not hold"}
"""Result of a row → how the manual prints it, where that differs."""
RANGE = re.compile(r" \([^()]* to [^()]*\)")
"""10 and 90 % quantiles of the histories."""


def comparisons(numbers: SuiteNumbers) -> str:
    """Number of rows by result, and a table with one row per comparison."""
    rows = numbers.comparisons
    refuse(zip(rows.source, rows.verdict, rows.why, strict=True))
    text = [
        f"{len(numbers.runs.name)} runs. {counted(rows.verdict)}",
        "",
        *head("", "thesis", "published", "published settings", "other settings", "result"),
    ]
    for source, says, printed, theirs, ours, verdict, why in zip(
        rows.source,
        rows.statement,
        rows.published,
        rows.published_settings,
        rows.other_settings,
        rows.verdict,
        rows.why,
        strict=True,
    ):
        text.append(line([source, says, printed, *without_repetition(theirs, ours), cell(verdict, why)]))
    return "\n".join(text) + "\n"


def statements(numbers: SuiteNumbers) -> str:
    """Number of statements by result, and a table with measured median and target of each."""
    suite = load_config(CONFIGS / "bench" / "suite.yaml").model
    assert isinstance(suite, SuiteConfig)
    rows, found = numbers.statements, defaultdict(list)
    refuse(zip(rows.text, rows.verdict, rows.why, strict=True))
    for claim, run, name, value in zip(
        numbers.numbers.claim, numbers.numbers.run, numbers.numbers.name, numbers.numbers.value, strict=True
    ):
        found[int(claim)].append((int(run), str(name), float(value)))
    text = [
        f"{len(numbers.runs.name)} runs. {counted(rows.verdict)}",
        "",
        *head("statement", "measured", "target", "result"),
    ]
    for i, (own, verdict, why) in enumerate(zip(suite.claims, rows.verdict, rows.why, strict=True)):
        told = Statement(own.text, tuple(found[i]), own.above, own.below, own.equals, own.unit)
        text.append(line([own.text, RANGE.sub("", measured(told)), target(told), cell(verdict, why)]))
    return "\n".join(text) + "\n"


def refuse(rows: Iterable[tuple[str, str, str]]) -> None:
    """Exit if a row of (name, result, reason) lacks a reason."""
    if owing := [f"{name}: {verdict}" for name, verdict, why in rows if unexplained(verdict, why)]:
        sys.exit("Add a reason (why) to these rows of the suite:\n" + "\n".join(owing))


def counted(verdicts: Sequence[str]) -> str:
    """Number of rows by result."""
    return ", ".join(f"{RESULTS.get(verdict, verdict)}: {many}" for verdict, many in Counter(verdicts).items()) + "."


def without_repetition(theirs: str, ours: str) -> tuple[str, str]:
    """Cells of a comparison without the ranges over histories, and with a common target once."""
    target_of = re.compile(r" \([^()]*\)$")
    theirs, ours = (re.sub(RANGE.pattern + r"(?=.*\([^()]*\)$)", "", text) for text in (theirs, ours))
    if (hit := target_of.search(theirs)) and ours.endswith(hit[0]):
        ours = target_of.sub("", ours)
    return theirs, ours


def cell(verdict: str, why: str) -> str:
    """A result and its reason."""
    return f"**{RESULTS.get(verdict, verdict)}**" + (f". {why}" if why else "")


def head(*columns: str) -> tuple[str, str]:
    """Header of a table."""
    return line(columns), line(["---"] * len(columns))


def line(cells: Sequence[str]) -> str:
    """Row of a table."""
    return "| " + " | ".join(own.replace("|", "\\|") for own in cells) + " |"


PAGES = (
    ("thesis", "reproduction.md", "## Figure by figure\n", comparisons),
    ("bench", "thesis-runs.md", "### Statement by statement\n", statements),
)
"""Suite, page, heading, and the function that writes the text below it."""

if __name__ == "__main__":
    results = Path(sys.argv[1] if len(sys.argv) > 1 else "results")
    for suite, page, heading, below in PAGES:
        file, path = results / suite / "suite.h5", DOCS / page
        if not file.exists():
            print(f"{page}: {file} not found, page unchanged")
            continue
        by_hand = path.read_text(encoding="utf-8").split(heading)[0]
        path.write_text(by_hand + heading + below(read(SuiteNumbers, Artefact(file))), encoding="utf-8")
