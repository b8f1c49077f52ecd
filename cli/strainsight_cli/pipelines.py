"""Which stages a config's `kind` stands for; imported only when a command needs them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from strainsight.workflow.stage import Stage

STAGES = {
    "import": "Read the deck, with its materials and constraints",
    "modes": "Find natural frequencies and mode shapes",
    "rom": "Reduce the model",
    "train": "Simulate the training run and the strain of every candidate",
    "screen": "Drop weak and clustered candidates",
    "observe": "Say which unknowns could be told apart",
    "place": "Choose the gauges",
    "validate": "Estimate from simulated measurements",
    "report": "Write report.html",
}


def stages_of(config: Mapping[str, Any]) -> tuple[Stage, ...]:
    """The pipeline of a config, in order."""
    assert config["kind"] == "placement"
    from strainsight.stages.placement import stages_for

    estimate = config.get("estimate")
    return stages_for(bool(estimate and estimate.get("file")))
