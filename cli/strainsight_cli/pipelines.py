"""Which stages a config's `kind` stands for; imported only when a command needs them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from strainsight.workflow.stage import Stage

STAGES = {
    "import": "Read the deck, with its materials and constraints",
    "rom": "Reduce the model",
    "train": "Simulate the training run and the strain of every candidate",
    "screen": "Drop weak and clustered candidates",
    "place": "Choose the gauges",
    "validate": "Estimate from simulated measurements",
    "report": "Write report.html",
}


def stages_of(kind: str) -> tuple[Stage, ...]:
    """The pipeline of a config's kind, in order."""
    assert kind == "placement"
    from strainsight.stages.placement import PLACEMENT

    return PLACEMENT
