"""The pipelines of a bench and of a bearing alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from strainsight.runner.stage import Stage
from strainsight.stages.bench.bearing import BEARING

BEARING_ALONE = (BEARING,)
ON_DEMAND = ("statics", "modes")
"""Stages of a bench that a run has not."""


def bench_stages(config: Mapping[str, Any]) -> tuple[Stage, ...]:
    """From the decks to a simulation in time and its page; with its bearings alone, a placement, a truth by another integrator,
    an estimate and a field where the config has them."""
    from strainsight.stages.bench.import_bodies import IMPORT, REDUCE
    from strainsight.stages.bench.simulate import SIMULATE

    stages = [*((BEARING,) if config["bearings"] else ()), IMPORT, REDUCE]
    if config.get("place"):
        stages.append(_place(config))
    takes_over = _takes_over(config)
    stages.append(_after(SIMULATE, "place") if takes_over else SIMULATE)
    if config.get("estimate"):
        from strainsight.stages.bench.estimate import ESTIMATE
        from strainsight.stages.bench.truth import truth_stage

        given = config["estimate"]["sensors"].values()
        estimate = _after(ESTIMATE, "place") if takes_over or _any_layout(given) else ESTIMATE
        truth = config["estimate"]["truth"]
        if truth["model"] == "other" and config["estimate"]["measured"] is None:
            stages.append(truth_stage(truth["duration"] is not None))
            estimate = _after(estimate, "truth")
        stages.append(estimate)
    if config.get("field"):
        from strainsight.stages.bench.field import field_stage

        stages.append(field_stage(config["field"]["of"]))
    from strainsight.stages.bench.report import report_stage

    stages.append(report_stage([stage.name for stage in stages]))
    return tuple(stages)


def demanded(stage: str, config: Mapping[str, Any]) -> tuple[Stage, ...]:
    """The stages up to one that is no part of a run, and is computed when its command asks for it; none of another name."""
    if stage not in ON_DEMAND:
        return ()
    from strainsight.stages.bench.at_rest import MODES, STATICS
    from strainsight.stages.bench.import_bodies import IMPORT, REDUCE

    asked = MODES if stage == MODES.name else STATICS
    if not _takes_over(config):
        return (IMPORT, REDUCE, asked)
    return (IMPORT, REDUCE, _place(config), _after(asked, "place"))


def _place(config: Mapping[str, Any]) -> Stage:
    from strainsight.stages.bench.place import place_stage

    estimate = config.get("estimate") or {}
    constants = estimate.get("tolerances") is not None or any(
        own.get("std") is not None for own in (estimate.get("parameters") or {}).values()
    )
    sensors = (config.get("place") or {}).get("sensors")
    return place_stage(constants, bool(sensors))


def _takes_over(config: Mapping[str, Any]) -> bool:
    """Whether a sensor takes its gauges from the placement; of one whose components a filter alone takes from there, a simulation
    has all."""
    return _any_layout(config["sensors"].values())


def _any_layout(sensors: Iterable[Mapping[str, Any]]) -> bool:
    return any(sensor.get("layout") for sensor in sensors)


def _after(stage: Stage, name: str) -> Stage:
    """The stage with one more upstream."""
    return replace(stage, upstream=(*stage.upstream, name))
