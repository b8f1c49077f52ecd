"""Where the time of a suite went, and the most memory that it held."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from strainsight import processes

if TYPE_CHECKING:
    from strainsight.runner.artefact import Artefact
    from strainsight.runner.output import Table

Computed = tuple[str, str, float | None]
"""Key, digest and seconds: a reused artefact is the same to the last digit."""


def timing_table(runs: Sequence[str], found: Sequence[Sequence[Artefact]], page: Artefact) -> Table:
    """A row a run, a column a stage: seconds that the stage took when it was computed, "↩ 2" where it was run 2 that did.

    Which run it was is known of what was reused just now; of what was there before, the first run is taken to be it.
    page: the suite's own artefact, in a row of its own.
    """
    from strainsight.runner.output import Table

    stages = list(dict.fromkeys(artefact.header.stage for artefacts in found for artefact in artefacts))
    by: dict[Computed, int] = {}
    for reused in (False, True):
        for i, artefacts in enumerate(found):
            for artefact in artefacts:
                if bool(artefact.source) == reused:
                    by.setdefault(_computed(artefact), i)
    cells: list[list[str]] = []
    spent = [[0.0] * len(stages) for _ in runs]
    for i, artefacts in enumerate(found):
        cells.append([""] * len(stages))
        for artefact in artefacts:
            column, seconds = stages.index(artefact.header.stage), artefact.header.seconds
            if (maker := by[_computed(artefact)]) != i:
                cells[i][column] = f"↩ {maker + 1}"
            else:
                cells[i][column] = "?" if seconds is None else _seconds(seconds)
                spent[i][column] = seconds or 0.0
    rows = [
        (str(i + 1), name, *cells[i], _seconds(sum(spent[i])) if any(spent[i]) else "") for i, name in enumerate(runs)
    ]
    own = page.header.seconds or 0.0
    rows.append(("", "the suite's page", *[""] * len(stages), _seconds(own)))
    below = [_seconds(sum(column)) for column in zip(*spent, strict=True)]
    rows.append(("", "all", *below, _seconds(own + sum(map(sum, spent)))))
    return Table("where the time goes [s] (↩ n: reused from run n)", ("", "run", *stages, "all"), tuple(rows))


def peak_memory(jobs: int) -> str:
    """The most memory that this process held, and the largest of its children, of which there were `jobs` at a time."""
    own, child = (processes.peak_memory(children) for children in (False, True))
    if own is None or child is None:
        return "\npeak memory: not known here"
    at_once = f", {jobs} of them at a time" if jobs > 1 else ""
    largest = f", largest child process {child / 2**30:.2f} GiB{at_once}" if child else ""
    return f"\npeak memory: {own / 2**30:.2f} GiB{largest}"


def _computed(artefact: Artefact) -> Computed:
    return artefact.key, artefact.digest, artefact.header.seconds


def _seconds(value: float) -> str:
    return f"{value:.1f}" if value < 100 else f"{value:.0f}"
