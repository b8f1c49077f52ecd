"""place: gauges of a bench's flexible body for its unknowns, with a bound and layouts drawn at random beside them."""

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
    version=22,
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
"""What it reads, too, where parameters are estimated, or gauges have tolerances: σ depends on how long a constant is watched and
by which gauges, what these are off by on the loads of the run."""


def place_stage(config: Mapping[str, Any]) -> Stage:
    """The stage of a bench, which reads more where there are constants to estimate, or sensors among its candidates."""
    estimate = config.get("estimate") or {}
    constants = estimate.get("tolerances") is not None or any(
        entry.get("std") is not None for entry in (estimate.get("parameters") or {}).values()
    )
    more = IN_ITS_RUN if constants else ("sensors",) if (config.get("place") or {}).get("sensors") else ()
    return replace(PLACE, reads=(*PLACE.reads, *more))
