"""Which stages a config's `kind` stands for; imported only when a command needs them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from strainsight.workflow.stage import Stage

STAGES = {
    "bearing": "Look at a bearing alone: load-displacement curves, stiffness, loads of the balls",
    "import": "Read the deck, with its materials and constraints",
    "reduce": "Reduce the flexible bodies of a bench",
    "modes": "Find natural frequencies and mode shapes",
    "rom": "Reduce the model",
    "train": "Simulate the training run and the strain of every candidate",
    "screen": "Drop weak and clustered candidates",
    "observe": "Say which unknowns are observable together",
    "place": "Choose the gauges",
    "simulate": "Simulate a bench in time",
    "estimate": "Estimate from measurements: of a test, or of a bench",
    "field": "Write the strain and stress of a bench's body in time",
    "spectrum": "Find the modes of a validation's truth",
    "validate": "Estimate from simulated measurements",
    "report": "Write report.html",
}


def stages_of(config: Mapping[str, Any]) -> tuple[Stage, ...]:
    """The pipeline of a config, in order."""
    if config["kind"] == "placement":
        from strainsight.stages.placement import stages_for

        estimate = config.get("estimate")
        return stages_for(bool(estimate and estimate.get("file")), config["validate"]["truth"]["model"])
    from strainsight.stages.bench.pipeline import BEARING_ALONE, bench_stages

    return BEARING_ALONE if config["kind"] == "bearing" else bench_stages(config)
