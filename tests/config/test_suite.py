"""Suites and their studies."""

from __future__ import annotations

from pathlib import Path

import pytest

from strainsight.config.load import load_config
from strainsight.config.suite_runs import runs_of
from strainsight.errors import ConfigError
from strainsight.stages.pages.suite_entries import suite_config

CONFIGS = Path(__file__).parents[2] / "configs"
SUITE = """\
kind: suite
name: all
title: Two runs
set: {place.instants: 3}
suffix: -short
runs:
  - config: cantilever-youngs-modulus.yaml
    label: E
    set: {place.keep: 5}
  - config: cantilever-youngs-modulus.yaml
    name: watched
    label: E, only observed
    until: observe
  - config: cantilever-input.yaml
    label: tip
    note: With the modulus of the first run.
"""


BENCH = """\
kind: bench
name: bob
bodies:
  bob: {type: rigid, mass: 2.0, inertia: {xx: 1.0, yy: 1.0, zz: 1.0}}
frames:
  pivot: {body: ground}
  hinge: {body: bob}
joints:
  hinge: {type: fixed, frames: [pivot, hinge]}
simulate: {duration: 1.0, time_step: 0.1}
"""
STUDIES = """\
kind: suite
name: all
title: Benches
suffix: -x
set: {simulate: {duration: 1.0, time_step: 0.1}}
runs:
  - {config: bench.yaml, name: long, label: long steps, study: steps, group: own, set: {simulate.time_step: 0.5}}
  - {config: bench.yaml, name: short, label: short steps, study: steps, group: own}
  - {config: bench.yaml, name: other, label: another}
studies:
  - {name: steps, note: What a step costs., over: simulate.time_step, numbers: [steps]}
claims:
  - {text: Few steps., run: long, stage: simulate, number: steps, below: 3}
  - {text: Five times as many., run: [short], stage: simulate, number: steps, against: long, above: 4.5, below: 5.5}
"""
COMPARISONS = """\
comparisons:
  - source: figure 1
    statement: It takes few steps.
    published_settings: {run: long, stage: simulate, number: steps, below: 9}
  - source: figure 2
    statement: E is found.
    published: 1 %
    other_settings: {run: other, number: error.E, below: 0.01}
  - source: figure 3
    statement: It is drawn.
    why: A drawing.
"""
COMPARED = STUDIES.replace("bench.yaml, name: other", "beam.yaml, name: other").split("claims:")[0] + COMPARISONS
COMPARED = COMPARED.replace("set: {simulate: {duration: 1.0, time_step: 0.1}}\n", "")


@pytest.fixture
def write(tmp_path):
    """Text of a suite → its path, beside the configs of its runs."""
    configs = {f"{name}.yaml": name for name in ("cantilever-youngs-modulus", "cantilever-input")}
    for name, source in (configs | {"beam.yaml": "cantilever-youngs-modulus", "full.yaml": "bench-full"}).items():
        (tmp_path / name).write_text((CONFIGS / f"{source}.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    (tmp_path / "bench.yaml").write_text(BENCH, encoding="utf-8")

    def written(text: str = SUITE) -> Path:
        path = tmp_path / "suite.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return written


def refused(path: Path, *overrides: str, stages=("import", "reduce", "simulate")) -> list[ConfigError]:
    def checked():
        suite = load_config(path, overrides)
        runs = runs_of(suite)
        suite_config(suite, runs, [list(stages)] * len(runs))

    with pytest.raises(ConfigError) as caught:
        checked()
    return [caught.value, *caught.value.others]


def place(text: str, part: str, file: str = "suite.yaml") -> str:
    """ "suite.yaml:line:" of the first line that holds the part."""
    return f"{file}:{text[: text.index(part)].count(chr(10)) + 1}:"


def test_every_run_gets_overrides_name_and_suffix(write):
    runs = runs_of(load_config(write()))
    assert [run.config.model.name for run in runs] == [
        "cantilever-youngs-modulus-short", "watched-short", "cantilever-input-short",
    ]
    assert [run.config.data["place"]["instants"] for run in runs] == [3, 3, 3]
    assert [run.config.data["place"]["keep"] for run in runs] == [5, 4, 4]
    assert [run.entry.until for run in runs] == ["report", "observe", "report"]


def test_a_guess_from_a_run_of_the_suite_follows_its_suffix_and_others_stay(write):
    runs = runs_of(load_config(write()))
    assert runs[2].config.data["parameters"]["E"]["guess"]["from"] == "cantilever-youngs-modulus-short"
    head, _, _, last = SUITE.split("  - config: ")
    alone = runs_of(load_config(write(f"{head}  - config: {last}")))
    assert alone[-1].config.data["parameters"]["E"]["guess"]["from"] == "cantilever-youngs-modulus"


def test_overrides_of_the_command_line_reach_the_suite_and_its_set(write):
    path = write()
    runs = runs_of(load_config(path, ["suffix=-x", "set.place.keep=7", "runs.1.set.train.duration=0.5"]))
    assert runs[1].config.model.name == "watched-x"
    assert [run.config.data["place"]["keep"] for run in runs] == [5, 7, 7]
    assert runs[1].config.data["train"]["duration"] == 0.5
    (error,) = refused(path, "set.place.instants=0")
    assert error.where == "--set set.place.instants"


def test_fault_from_set_is_located_in_suite_and_reported_once(write):
    text = SUITE.replace("place.instants: 3", "place.instant: 3").replace("place.keep: 5", "place.keep: 0")
    found = {error.key: error for error in refused(write(text))}
    assert set(found) == {"place.instant", "place.keep"}
    assert place(text, "place.instant") in found["place.instant"].where
    assert found["place.instant"].remedy == "did you mean instants?"
    assert place(text, "place.keep") in found["place.keep"].where


def test_fault_in_run_config_is_located_there_and_reported_once(write):
    path = write()
    own = path.parent / "cantilever-youngs-modulus.yaml"
    text = own.read_text(encoding="utf-8").replace("seed: 1", "seed: -1")
    own.write_text(text, encoding="utf-8")
    (error,) = refused(path)
    assert error.key == "seed"
    assert place(text, "seed", own.name) in error.where


def test_a_guess_from_a_run_that_comes_later_is_refused(write):
    head, first, _, last = SUITE.split("  - config: ")
    (error,) = refused(write(f"{head}  - config: {last}  - config: {first}"))
    assert "but the suite runs 'cantilever-youngs-modulus' later" in error.what
    assert error.key == "parameters.E.guess.from"
    assert "cantilever-input.yaml:" in error.where


@pytest.mark.parametrize(
    ("given", "remedy"),
    [("place.keep=5", "to set the key in every run of the suite, write set.place.keep=5"), ("jbos=2", "did you mean jobs?")],
)
def test_a_key_of_the_runs_behind_set_is_placed_there(write, given, remedy):
    (error,) = refused(write(), given)
    assert error.where == f"--set {given.split('=')[0]}"
    assert error.remedy == remedy


def test_a_section_that_was_replaced_whole_is_reported(write):
    text = SUITE.replace("{place.instants: 3}", "{train: {duration: 0.2}}")
    errors = [error for error in refused(write(text)) if error.what == "missing"]
    assert errors
    for error in errors:
        assert error.remedy == "`set` replaced the whole section train; set single keys there: train.duration: 0.2"
        assert place(text, "{train") in error.where


def test_page_lists_varied_key_and_location_of_results(write):
    suite = load_config(write(STUDIES))
    given = suite_config(suite, runs_of(suite), [["import", "reduce", "simulate", "report"]] * 3)
    assert [run["at"] for run in given["runs"]] == [0.5, 0.1, None]
    assert [run["study"] for run in given["runs"]] == ["steps", "steps", ""]
    assert given["runs"][0]["artefacts"] == {"simulate": "long-x/simulate.h5", "report": "long-x/report.h5"}
    measures = [claim["measure"] for claim in given["claims"]]
    assert [(own["runs"], own["against"], own["number"]) for own in measures] == [
        ([0], None, ["steps"]),
        ([1], 0, ["steps"]),
    ]


MISTAKES = {
    SUITE: [
        ("runs:", "runs: []\nrest:", "runs", "has to be a list of at least 1 entry"),
        ("suffix: -short", "suffix: a b", "suffix", "is not a valid name"),
        ("{place.keep: 5}", "{place..keep: 5}", "runs[0].set.place..keep", "is not a dotted key"),
        ("{place.keep: 5}", "{name: other}", "runs[0].set.name", "cannot set 'name'"),
        ("cantilever-input.yaml", "suite.yaml", "runs[2].config", "is a suite"),
        ("name: watched", "name: cantilever-youngs-modulus", "runs[1].name", "name of runs[0]"),
        ("name: all", "name: watched-short", "runs[1].name", "name of the suite"),
        ("title: Two runs", 'title: "Two \\e[31mruns"', "title", "control character U+001B"),
        ("label: E, only observed", 'label: "a\\0b"', "runs[1].label", "control character U+0000"),
        *(
            ("cantilever-input.yaml", name, "runs[2].config", "file not found")
            for name in ("x" * 300, r'"a\0b"', "../" * 2000)
        ),
    ],
    STUDIES: [
        ("run: long,", "run: lnog,", "claims[0].run", "unknown run 'lnog'"),
        (", below: 3", "", "claims[0]", "no limit is set"),
        ("above: 4.5", "above: 6", "claims[1].above", "the lower limit 6 is not smaller than the upper limit 5.5"),
        ("below: 3", "against_number: steps, below: 3", "claims[0].against_number", "the reference run is missing"),
        ("over: simulate.time_step", "over: simulate.start", "studies[0].over", "(runs[0])"),
        ("over: simulate.time_step, ", "", "studies[0].numbers", "have no horizontal axis"),
        ("name: steps, note", "name: stops, note", "studies[0].name", "no run belongs to the study 'stops'"),
        ("  - {name: steps,", "  - {name: steps}\n  - {name: steps,", "studies[1].name", "appears twice"),
        ("long, stage: simulate", "long, stage: simulat", "claims[0].stage", "does not have the stage 'simulat'"),
        ("long, stage: simulate, ", "long, ", "claims[0].run", "does not have the stage 'estimate'"),
    ],
    COMPARED: [
        (", below: 9}", "}", "comparisons[0].published_settings", "no limit is set"),
        ("run: other", "run: otter", "comparisons[1].other_settings.run", "unknown run 'otter'"),
        ("    why: A drawing.\n", "", "comparisons[2]", "no result and no explanation is set"),
        ("statement: It is drawn.", 'statement: "It is\\ndrawn."', "comparisons[2].statement", "a line break"),
    ],
}


@pytest.mark.parametrize(
    ("text", "before", "after", "key", "what"), [(text, *row) for text, rows in MISTAKES.items() for row in rows]
)
def test_a_mistake_in_the_suite_has_its_place(write, text, before, after, key, what):
    assert before in text
    (error,) = (error for error in refused(write(text.replace(before, after, 1))) if what in error.what and error.key == key)
    assert "suite.yaml:" in error.where
    assert error.remedy
    assert str(error).replace("\n", "").isprintable()


def test_placements_and_benches_share_page_with_separate_result_stages(write):
    text = COMPARED.replace("set: {simulate.time_step: 0.5}", "set: {simulate.time_step: 0.5}, until: simulate")
    suite = load_config(write(text))
    given = suite_config(suite, runs_of(suite), [["simulate"], ["simulate"], ["import", "place", "validate"]])
    first, second, third = given["comparisons"]
    assert first["published_settings"]["stage"] == "simulate"
    assert (second["other_settings"]["runs"], second["other_settings"]["stage"]) == ([2], "validate")
    assert second["published_settings"] is None
    assert (third["other_settings"], third["published_settings"]) == (None, None)


def test_placements_have_studies_and_claims_too(write):
    text = "kind: suite\nname: all\ntitle: t\nruns:\n  - {config: beam.yaml, name: a, label: E, study: s, group: g}\n"
    text += "studies: [{name: s, over: place.keep}]\nclaims: [{text: t, run: a, number: error.E, above: 0}]\n"
    suite = load_config(write(text))
    given = suite_config(suite, runs_of(suite), [["import", "validate"]])
    assert (given["runs"][0]["at"], given["claims"][0]["measure"]["stage"]) == (4.0, "validate")
    assert list(given["runs"][0]["artefacts"]) == ["import", "validate"]
    (error,) = refused(write(text), stages=("import", "place"))
    assert (error.key, error.what) == (
        "claims[0].run",
        "runs[0], 'a', does not have the stage 'validate'; the run has the stages import, place",
    )


def test_reference_run_of_measure_gets_suffix(write):
    estimate = (
        "{sensors: {relative: {noise: 1.0e-7}}, inputs: {Fx: {std: 1.0, increment: 1.0}}, measured: {from: NAME}}"
    )
    text = "kind: suite\nname: all\ntitle: t\nsuffix: -x\nruns:\n  - {config: full.yaml, name: full, label: f}\n"
    text += f"  - {{config: full.yaml, name: small, label: s, set: {{estimate: {estimate}}}}}\n"
    runs = runs_of(load_config(write(text.replace("NAME", "full"))))
    assert runs[1].config.data["estimate"]["measured"]["from"] == "full-x"
    runs = runs_of(load_config(write(text.replace("NAME", "elsewhere"))))
    assert runs[1].config.data["estimate"]["measured"]["from"] == "elsewhere"
    later = text.replace("NAME", "late") + "  - {config: full.yaml, name: late, label: l}\n"
    (error,) = refused(write(later))
    assert error.key == "estimate.measured.from"
    assert "but the suite runs 'late' later" in error.what
