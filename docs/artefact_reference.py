"""Write the tables of datasets that docs/artefacts.md includes, one file per record.

`python docs/artefact_reference.py FOLDER`; the build of the manual calls it. The tables are not kept in the repository.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from strainsight.records.bearing import BearingResults
from strainsight.records.bench import (
    AtRest,
    BenchEstimated,
    BenchTruths,
    Coupled,
    ReducedBodies,
    Simulated,
    SurfaceHistory,
)
from strainsight.records.bench_placed import BenchPlaced
from strainsight.records.estimated import CampaignRecord, Estimated
from strainsight.records.mesh import Imported
from strainsight.records.placed import Observed, Placed
from strainsight.records.record import FieldPlace, listed
from strainsight.records.reduced import Modes, Reduced
from strainsight.records.suite import SuiteNumbers
from strainsight.records.training import Screened, Training
from strainsight.records.validated import Validated

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
"""Stage of a placement → record of its results file; `suite` is also a stage of suites of benches."""

BENCH: dict[str, Any] = {
    "reduce": ReducedBodies,
    "bearing": BearingResults,
    "place": BenchPlaced,
    "simulate": Simulated,
    "truth": BenchTruths,
    "estimate": BenchEstimated,
    "field": SurfaceHistory,
    "statics": AtRest,
    "modes": Coupled,
}
"""The same of a bench."""


def tables() -> dict[str, str]:
    """File name → table, one row per dataset, sorted by path."""
    kinds = PLACEMENT | {"estimate-records": CampaignRecord}
    kinds |= {f"bench-{stage}" if stage in PLACEMENT else stage: kind for stage, kind in BENCH.items()}
    rows = {name: sorted(listed(kind, FieldPlace("", what="metric"))) for name, kind in kinds.items()}
    return {
        f"{name}.txt": HEAD + "".join(f"| `{path}` | {axes} | {unit} | {what} |\n" for path, axes, unit, what in datasets)
        for name, datasets in rows.items()
    }


def write(folder: Path) -> None:
    """Write the tables whose content changed."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in tables().items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != content:
            path.write_text(content, encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
