"""place: gauges on a flexible body of a bench for its unknowns, with an optimality bound and random layouts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from strainsight.config.bench.bench import BenchConfig
from strainsight.experiment.bench.layout.placement import placement_output
from strainsight.runner.output import Output
from strainsight.runner.stage import Context, Stage
from strainsight.stages.bench.inputs import HISTORIES, bodies, meshes


def run(context: Context[BenchConfig]) -> Output:
    """The placement, with the pool as points of a grid."""
    return placement_output(context.config, meshes(context), bodies(context), context)


PLACE = Stage(
    "place",
    version=24,
    reads=(
        "seed",
        "bodies",
        "frames",
        "joints",
        "bearings",
        "forces",
        "simulate.time_step",
        "simulate.method",
        "simulate.snap_tolerance",
        "simulate.allow_unstable",
        "estimate.time_step",
        "estimate.increments",
        "estimate.disturbance",
        "estimate.method.step_error",
        "estimate.method.noise",
        "estimate.parameters",
        "estimate.tolerances",
        "estimate.inputs.*.std",
        "estimate.inputs.*.smoothness",
        "estimate.inputs.*.damping",
        "estimate.inputs.*.increment",
        "estimate.inputs.*.model",
        "estimate.inputs.*.kappa",
        "estimate.inputs.*.frequency",
        "estimate.inputs.*.amplitude",
        "place",
    ),
    upstream=("import", "reduce"),
    files=HISTORIES,
    run=run,
    records=("gauges.csv",),
)

IN_ITS_RUN = ("estimate.duration", "estimate.sensors", "simulate.duration", "simulate.start", "sensors")
"""Additional keys for estimated parameters or gauge tolerances: their σ depends on the duration of the run and on its loads."""


def place_stage(config: Mapping[str, Any]) -> Stage:
    """The stage of a bench, which reads more where there are constants to estimate, or sensors among its candidates."""
    estimate = config.get("estimate") or {}
    constants = estimate.get("tolerances") is not None or any(
        entry.get("std") is not None for entry in (estimate.get("parameters") or {}).values()
    )
    more = IN_ITS_RUN if constants else ("sensors",) if (config.get("place") or {}).get("sensors") else ()
    return replace(PLACE, reads=(*PLACE.reads, *more))
