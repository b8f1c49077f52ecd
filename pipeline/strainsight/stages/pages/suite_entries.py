"""Inputs of the stage of a suite: runs with artefacts, studies, measures with run indices instead of names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from strainsight.config.load import LoadedConfig
from strainsight.config.loads import unit_of
from strainsight.config.suite import Measure, SuiteConfig, as_texts, measures_of
from strainsight.config.suite_runs import PlannedRun, all_of, number_at, study_of, wrong
from strainsight.experiment.structure.references import PARAMETER_UNITS

DRAWN = (
    *("node", "set", "direction", "moment", "bearing", "pressure", "deck_load", "factor", "gravity", "rotation"),
    "known",
)
"""Data of a load in the picture."""
OF_A_BENCH = ("simulate", "estimate", "place", "report")
"""Stages of a bench with artefacts on the page; of a placement all."""
SIDES = ("published_settings", "other_settings")
"""Results of a comparison: with the settings of the source, and with other settings."""
DEFAULT = {"placement": "validate", "bench": "estimate"}
"""Stage of a measure that names none."""


def suite_config(suite: LoadedConfig, runs: Sequence[PlannedRun], stages: Sequence[Sequence[str]]) -> dict[str, Any]:
    """stages: those that each run is brought through. Raises ConfigError for a measure on a stage that its run does not reach."""
    model = suite.model
    assert isinstance(model, SuiteConfig)
    places = {str(run.config.data["name"]).removesuffix(model.suffix): run.place for run in runs}
    measures = measures_of(model.claims, model.comparisons)
    measured = dict(
        zip(
            measures,
            all_of(measures.items(), lambda measure: _measure(suite, *measure, places, runs, stages)),
            strict=True,
        )
    )
    wanted = {*OF_A_BENCH, *(measure["stage"] for measure in measured.values())}
    return {
        "name": model.name,
        "title": model.title,
        "runs": [_entry(model, run, reached, wanted) for run, reached in zip(runs, stages, strict=True)],
        "studies": suite.data["studies"],
        "claims": [
            claim.model_dump(mode="json", include={"text", "why"}) | {"measure": measured[f"claims.{i}"]}
            for i, claim in enumerate(model.claims)
        ],
        "comparisons": [
            row.model_dump(mode="json", exclude=set(SIDES))
            | {side: measured.get(f"comparisons.{i}.{side}") for side in SIDES}
            for i, row in enumerate(model.comparisons)
        ],
    }


def _entry(model: SuiteConfig, run: PlannedRun, reached: Sequence[str], wanted: set[str]) -> dict[str, Any]:
    data, entry, study = run.config.data, run.entry, study_of(model, run)
    bench = data["kind"] == "bench"
    shown = [stage for stage in reached if stage in wanted or not bench]
    placement = {}
    if not bench:
        loads, parameters = data["loads"], data["parameters"]
        placement = {
            "loads": {name: {key: load[key] for key in DRAWN} for name, load in loads.items()},
            "unknowns": {
                name: {"kind": "input", "unit": unit_of(loads[name])}
                if name in loads
                else {"kind": "parameter", "unit": PARAMETER_UNITS[parameters[name]["property"]]}
                for name in data["place"]["estimate"]
            },
        }
    return placement | {
        "name": data["name"],
        "label": entry.label,
        "note": entry.note,
        "study": entry.study or "",
        "group": entry.group,
        "at": None if study is None or study.over is None else number_at(data, study.over),
        "reached": reached[-1],
        "artefacts": {stage: f"{data['name']}/{stage}.h5" for stage in shown},
    }


def _measure(
    suite: LoadedConfig,
    key: str,
    measure: Measure,
    places: Mapping[str, int],
    runs: Sequence[PlannedRun],
    stages: Sequence[Sequence[str]],
) -> dict[str, Any]:
    """A measure with run indices instead of names, and its key."""
    named = [places[name] for name in as_texts(measure.run)]
    other = None if measure.against is None else places[measure.against]
    stage = measure.stage or DEFAULT[runs[named[0]].config.data["kind"]]
    for place in [*named, *([] if other is None else [other])]:
        if stage not in stages[place]:
            raise wrong(
                suite,
                f"{key}.{'run' if measure.stage is None else 'stage'}",
                f"runs[{place}], '{runs[place].config.data['name']}', does not have the stage '{stage}'; the "
                f"run has the stages {', '.join(stages[place])}",
                f"set `stage` to one of these stages, or remove `until` from runs[{place}]",
            )
    return measure.model_dump(mode="json", include=set(Measure.model_fields) - {"run", "against"}) | {
        "key": key, "runs": named, "against": other, "number": list(as_texts(measure.number)), "stage": stage,
    }  # fmt: skip
