"""Tables of the manual from the numbers of suites: `python docs/reproduction.py` after `make thesis` and `make bench`.

    docs/reproduction.md    every comparison of configs/thesis/suite.yaml, from results/thesis/suite.h5
    docs/thesis-runs.md     every statement of configs/bench/suite.yaml, from results/bench/suite.h5

A suite that was not run leaves its page as it is; other results are an argument. Only what stands below a page's heading is made,
the rest is written by hand. A comparison or statement that does not hold and says no reason ends it.
"""

from __future__ import annotations

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


def comparisons(numbers: SuiteNumbers) -> str:
    """How many rows came to which verdict, and a row a comparison."""
    rows = numbers.comparisons
    refuse(zip(rows.source, rows.verdict, rows.why, strict=True))
    text = [
        f"{len(numbers.runs.name)} runs. {counted(rows.verdict)}",
        "",
        *head("", "the thesis", "printed", "as printed, here", "ours", ""),
    ]
    for source, says, printed, theirs, ours, verdict, why in zip(
        rows.source, rows.says, rows.printed, rows.as_printed, rows.ours, rows.verdict, rows.why, strict=True
    ):
        text.append(line([source, says, printed, theirs, ours, cell(verdict, why)]))
    return "\n".join(text) + "\n"


def statements(numbers: SuiteNumbers) -> str:
    """How many statements hold, and a row each: what was measured and what it has to be, as the suite's page has them."""
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
        *head("statement", "measured", "to be", ""),
    ]
    for i, (own, verdict, why) in enumerate(zip(suite.claims, rows.verdict, rows.why, strict=True)):
        told = Statement(own.text, tuple(found[i]), own.above, own.below, own.equals, own.unit)
        text.append(line([own.text, measured(told), target(told), cell(verdict, why)]))
    return "\n".join(text) + "\n"


def refuse(rows: Iterable[tuple[str, str, str]]) -> None:
    """End where a row of name, verdict and reason owes a reason."""
    if owing := [f"{name}: {verdict}" for name, verdict, why in rows if unexplained(verdict, why)]:
        sys.exit("give them a why in the suite:\n" + "\n".join(owing))


def counted(verdicts: Sequence[str]) -> str:
    """How often each verdict came out."""
    return " ".join(f"{verdict.capitalize()}: {many}." for verdict, many in Counter(verdicts).items())


def cell(verdict: str, why: str) -> str:
    """A verdict and its reason."""
    return f"**{verdict}**" + (f". {why}" if why else "")


def head(*columns: str) -> tuple[str, str]:
    """The first two lines of a table."""
    return line(columns), line(["---"] * len(columns))


def line(cells: Sequence[str]) -> str:
    """A row of a table."""
    return "| " + " | ".join(own.replace("|", "\\|") for own in cells) + " |"


PAGES = (
    ("thesis", "reproduction.md", "## Figure by figure\n", comparisons),
    ("bench", "thesis-runs.md", "### Statement by statement\n", statements),
)
"""Suite, page, heading, and what stands below it."""

if __name__ == "__main__":
    results = Path(sys.argv[1] if len(sys.argv) > 1 else "results")
    for suite, page, heading, below in PAGES:
        file, path = results / suite / "suite.h5", DOCS / page
        if not file.exists():
            print(f"{page}: {file} is not there, the page stays as it is")
            continue
        by_hand = path.read_text(encoding="utf-8").split(heading)[0]
        path.write_text(by_hand + heading + below(read(SuiteNumbers, Artefact(file))), encoding="utf-8")
