"""`strainsight doctor`: is everything here that a run needs?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from strainsight.errors import printable
from strainsight_cli import checks, packages
from strainsight_cli.checks import FAILS, GOOD, WARNING, Finding
from strainsight_cli.printing import json_line, say

COLOURS = {GOOD: "green", WARNING: "yellow", FAILS: "red"}


def examine(results: Path) -> list[Finding]:
    """All findings, in the order of the table."""
    return [
        *packages.check_packages(),
        *checks.check_solver(),
        *checks.check_mpi(),
        *checks.check_rendering(),
        *checks.check_threads(),
        *checks.check_memory(),
        *checks.check_disk(results),
        *checks.check_terminal(),
    ]


def show(findings: Sequence[Finding], as_json: bool) -> int:
    """Print the table, or one JSON object a finding; the exit code: 1 where something fails."""
    if as_json:
        for finding in findings:
            say(json_line(asdict(finding)))
    else:
        _print_table(findings)
        counts = {verdict: sum(f.verdict == verdict for f in findings) for verdict in (FAILS, WARNING)}
        many = "" if counts[WARNING] == 1 else "s"
        say("", f"{counts[FAILS]} of {len(findings)} fail, {counts[WARNING]} warning{many}")
    return int(any(finding.verdict == FAILS for finding in findings))


def _print_table(findings: Sequence[Finding]) -> None:
    """A row a finding; the remedy stands below what it corrects."""
    from rich.text import Text

    from strainsight_cli.render import print_grid

    rows = []
    for finding in findings:
        found = printable(finding.found) + (f"\n→ {printable(finding.remedy)}" if finding.remedy else "")
        verdict = Text(finding.verdict, style=COLOURS[finding.verdict])
        rows.append((Text(finding.subject), verdict, Text(found)))
    print_grid(("checked", "verdict", "found"), rows)
