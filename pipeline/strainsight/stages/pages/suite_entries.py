"""What the stage of a suite is given: its runs with their artefacts, its studies, its claims with places for names of runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from strainsight.cases.structure.settings import PARAMETER_UNITS
from strainsight.config.load import LoadedConfig
from strainsight.config.loads import unit_of
from strainsight.config.suite import SuiteConfig
from strainsight.config.suite_runs import PlannedRun, all_of, study_of, value_over, wrong
from strainsight.config.suite_studies import Claim, as_texts

DRAWN = (
    *("node", "set", "direction", "moment", "bearing", "pressure", "deck_load", "factor", "gravity", "rotation"),
    "known",
)
"""What the picture shows of a load."""
OF_A_BENCH = ("simulate", "estimate", "place", "report")
"""Stages of a bench whose artefacts the page is made of; of a placement all."""
DEFAULT = {"placement": "validate", "bench": "estimate"}
"""Stage of a claim that names none."""


def suite_config(suite: LoadedConfig, runs: Sequence[PlannedRun], stages: Sequence[Sequence[str]]) -> dict[str, Any]:
    """stages: those that each run is brought through. Raises ConfigError for a claim on a stage that its run does not reach."""
    model = suite.model
    assert isinstance(model, SuiteConfig)
    default = DEFAULT[runs[0].config.data["kind"]]
    claims = all_of(range(len(model.claims)), lambda i: _claim(suite, i, runs, stages, default))
    wanted = {*OF_A_BENCH, *(claim["stage"] for claim in claims)}
    return {
        "name": model.name,
        "title": model.title,
        "runs": [_entry(model, run, reached, wanted) for run, reached in zip(runs, stages, strict=True)],
        "studies": suite.data["studies"],
        "claims": claims,
    }


def _entry(model: SuiteConfig, run: PlannedRun, reached: Sequence[str], wanted: set[str]) -> dict[str, Any]:
    data, entry, study = run.config.data, run.entry, study_of(model, run)
    bench = data["kind"] == "bench"
    shown = [stage for stage in reached if stage in wanted or not bench]
    return {
        "name": data["name"],
        "label": entry.label,
        "note": entry.note,
        "study": entry.study or "",
        "group": entry.group,
        "at": None if study is None or study.over is None else value_over(data, study.over),
        "reached": reached[-1],
        "artefacts": {stage: f"{data['name']}/{stage}.h5" for stage in shown},
    } | ({} if bench else _of_placement(data))


def _of_placement(data: Mapping[str, Any]) -> dict[str, Any]:
    loads, parameters = data["loads"], data["parameters"]
    return {
        "loads": {name: {key: load[key] for key in DRAWN} for name, load in loads.items()},
        "unknowns": {
            name: {"kind": "input", "unit": unit_of(loads[name])}
            if name in loads
            else {"kind": "parameter", "unit": PARAMETER_UNITS[parameters[name]["property"]]}
            for name in data["place"]["estimate"]
        },
    }


def _claim(
    suite: LoadedConfig, i: int, runs: Sequence[PlannedRun], stages: Sequence[Sequence[str]], default: str
) -> dict[str, Any]:
    model = suite.model
    assert isinstance(model, SuiteConfig)
    claim: Claim = model.claims[i]
    places = {str(run.config.data["name"]).removesuffix(model.suffix): run.place for run in runs}
    own = [places[name] for name in as_texts(claim.run)]
    other = None if claim.against is None else places[claim.against]
    stage = claim.stage or default
    for place in [*own, *([] if other is None else [other])]:
        if stage not in stages[place]:
            raise wrong(
                suite,
                f"claims.{i}.{'run' if claim.stage is None else 'stage'}",
                f"runs[{place}], '{runs[place].config.data['name']}', has no stage '{stage}': it goes through "
                f"{', '.join(stages[place])}",
                "name a stage that it goes through, or take `until` out",
            )
    return claim.model_dump(mode="json", exclude={"run", "against"}) | {
        "runs": own, "against": other, "number": list(as_texts(claim.number)), "stage": stage,
    }  # fmt: skip
