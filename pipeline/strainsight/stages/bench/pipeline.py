"""The pipelines of a bench and of a bearing alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from strainsight.runner.stage import Stage
from strainsight.stages.bench.bearing import BEARING

ON_DEMAND = ("statics", "modes")
"""Stages of a bench that a run has not."""


def bench_stages(config: Mapping[str, Any]) -> tuple[Stage, ...]:
    """From the decks to a simulation in time and its page; with its bearings alone, a placement, a truth by another integrator,
    an estimate and a field where the config has them."""
    from strainsight.stages.bench.import_bodies import IMPORT, REDUCE
    from strainsight.stages.bench.report import report_stage
    from strainsight.stages.bench.simulate import SIMULATE

    stages = [*((BEARING,) if config["bearings"] else ()), IMPORT, REDUCE]
    if config.get("place"):
        from strainsight.stages.bench.place import place_stage

        stages.append(place_stage(config))
    takes_over = _any_layout(config["sensors"])
    stages.append(_after(SIMULATE, "place") if takes_over else SIMULATE)
    if config.get("estimate"):
        from strainsight.stages.bench.estimate import ESTIMATE
        from strainsight.stages.bench.truth import truth_stage

        truth = config["estimate"]["truth"]
        estimate = _after(ESTIMATE, "place") if takes_over or _any_layout(config["estimate"]["sensors"]) else ESTIMATE
        if truth["model"] == "independent" and config["estimate"]["measured"] is None:
            stages.append(truth_stage(truth["duration"] is not None))
            estimate = _after(estimate, "truth")
        stages.append(estimate)
    if config.get("field"):
        from strainsight.stages.bench.field import FIELD

        stages.append(_after(FIELD, "estimate") if config["field"]["of"] == "estimate" else FIELD)
    stages.append(report_stage([stage.name for stage in stages]))
    return tuple(stages)


def demanded(stage: str, config: Mapping[str, Any]) -> tuple[Stage, ...]:
    """The stages up to one that is no part of a run, and is computed when its command asks for it; none of another name."""
    if stage not in ON_DEMAND:
        return ()
    from strainsight.stages.bench.equilibrium import MODES, STATICS
    from strainsight.stages.bench.import_bodies import IMPORT, REDUCE

    last = MODES if stage == MODES.name else STATICS
    if not _any_layout(config["sensors"]):
        return (IMPORT, REDUCE, last)
    from strainsight.stages.bench.place import place_stage

    return (IMPORT, REDUCE, place_stage(config), _after(last, "place"))


def _any_layout(sensors: Mapping[str, Mapping[str, Any]]) -> bool:
    """Whether a sensor takes its gauges from the placement; of one whose components a filter alone takes from there, a simulation
    has all."""
    return any(sensor.get("layout") for sensor in sensors.values())


def _after(stage: Stage, name: str) -> Stage:
    """The stage with one more upstream."""
    return replace(stage, upstream=(*stage.upstream, name))
