"""Which record each artefact is."""

from __future__ import annotations

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
from strainsight.records.reduced import Modes, Reduced
from strainsight.records.suite import SuiteNumbers
from strainsight.records.training import Screened, Training
from strainsight.records.validated import Validated

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
