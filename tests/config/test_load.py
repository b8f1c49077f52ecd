"""Configs are read with their overrides, checked against the schema, and the suite of the thesis is complete."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from strainsight.config.deck_properties import Answers, CandidateLocation, LoadAnswer
from strainsight.config.load import load_config
from strainsight.config.suite_runs import runs_of
from strainsight.config.template import schema_text, template
from strainsight.errors import ConfigError

CONFIGS = Path(__file__).parents[2] / "configs"
EXAMPLE = (CONFIGS / "cantilever-youngs-modulus.yaml").read_text(encoding="utf-8")


@pytest.fixture
def write(tmp_path):
    def written(text: str) -> Path:
        path = tmp_path / "own.yaml"
        path.write_text(text, encoding="utf-8")
        return path

    return written


def refused(path: Path, *overrides: str) -> list[ConfigError]:
    with pytest.raises(ConfigError) as caught:
        load_config(path, overrides)
    return [caught.value, *caught.value.others]


def line_of(text: str, part: str) -> int:
    return text[: text.index(part)].count("\n") + 1


EXAMPLES = sorted(path for names in ("*.yaml", "hub/hub-*.yaml", "lug/*.yaml") for path in CONFIGS.glob(names))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_is_valid_and_named_like_its_file(path):
    assert load_config(path).model.name == path.stem


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ("length_unit: m", "length_unit: metre", "mesh.length_unit"),
        ("range: [1.6e+11, 2.4e+11]", "range: [2.4e+11, 1.6e+11]", "parameters.E.range"),
        ("guess: 1.89e+11", "guess: 2.9e+11", "parameters.E"),
        ("direction: [0, 0, 1]", "direction: [0, 0, 0]", "loads.tip.direction"),
        ("node: 2, ", "", "loads.tip"),
        ("modes: 10", "modes: 0", "rom.modes"),
        ("train: {duration: 1.0", "train: {duration: 1.0e+308", "train.time_step"),
        ("train: {duration: 1.0, time_step: 5.0e-4", "train: {duration: 1.0, time_step: 5.0e-324", "train.time_step"),
        ("parameters: {E: 2.1e+11}", "parameters: {G: 2.1e+11}", "validate.truth.parameters.G"),
        ("parameters: {E: 2.1e+11}", "parameters: {E: 9.0e+11}", "validate.truth.parameters.E"),
        ("initial_std: {E: 0.1}", "initial_std: {}", "validate.initial_std"),
    ],
)
def test_a_problem_names_file_line_column_key_and_remedy(write, old, new, key):
    assert EXAMPLE.count(old) == 1
    text = EXAMPLE.replace(old, new)
    (error, *others) = refused(write(text))
    assert not others
    file, line, column = error.where.rsplit(":", 2)
    assert file.endswith("own.yaml")
    assert int(line) == line_of(EXAMPLE, old)
    assert int(column) >= 1
    assert error.key.startswith(key)
    assert error.remedy


ESTIMATE = "estimate: {channels: [{channel: a, gauge: G1, unit: m/m}], inputs: {tip: {channel: b, unit: N}}}\n"


UNKNOWN = ["loads.tip.known=false", "place.estimate=[tip, E]", "validate.initial_std={tip: 0.1, E: 0.1}"]


@pytest.mark.parametrize(
    ("overrides", "key", "says"),
    [
        (["loads.tip.known=false"], "place.estimate", "tip"),
        (["estimate.initial_std={F: 0.2}"], "estimate.initial_std.F", "no entry of place.estimate has the name 'F'"),
        (["estimate.initial_std={tip: 0.2}"], "estimate.initial_std.tip", "no entry of place.estimate has the name 'tip'"),
        (["estimate.inputs={top: {channel: b, unit: N}}"], "estimate.inputs.top", "no load has the name 'top'"),
        (UNKNOWN, "estimate.inputs.tip", "has no effect"),
    ],
)
def test_load_or_name_without_effect_is_refused(write, overrides, key, says):
    path = write(EXAMPLE + ESTIMATE)
    load_config(path)
    (error,) = (error for error in refused(path, *overrides) if error.key.startswith(key))
    assert says in str(error)


def test_all_problems_are_reported_at_once(write):
    text = EXAMPLE.replace("keep: 4", "kepe: 4").replace("modes: 10", "modes: -1").replace("seed: 1", "seed: no")
    errors = {error.key: error for error in refused(write(text.replace("minimum_spacing", "minimal_spacing")))}
    assert {"place.kepe", "rom.modes", "seed"} <= errors.keys()
    assert any("did you mean minimum_spacing" in error.remedy for error in errors.values())


@pytest.mark.parametrize("number", ["189e9", "1.89e11", "1.89E+11", "189000000000"])
def test_number_is_read_in_every_notation(write, number):
    assert load_config(write(EXAMPLE.replace("1.89e+11", number))).data["parameters"]["E"]["guess"] == 1.89e11


@pytest.mark.parametrize(
    "text",
    [
        "",
        "- a list",
        "kind: placement\nkind: placement\n",
        "kind: !!python/object/apply:os.system ['true']\n",
        "a: &a [*a]\n",
        "kind: \x00\n",
    ],
)
def test_invalid_config_file_is_refused_in_one_message(write, text):
    assert refused(write(text))[0].where


def test_override_applies_and_is_reported_as_location(write):
    path = write(EXAMPLE)
    config = load_config(path, ["place.keep=6", "gauges.direction.angles=[0, 90]"])
    assert config.data["place"]["keep"] == 6
    assert config.data["gauges"]["direction"]["angles"] == [0, 90]
    assert config.locate("place.keep") == "--set place.keep"
    assert config.locate("place.instants").endswith(
        f":{line_of(EXAMPLE, 'instants')}:{config.locate('place.instants').rsplit(':')[-1]}"
    )
    assert refused(path, "place.keep=four")[0].where == "--set place.keep"
    assert refused(path, "place.keep")[0].where == "--set"


@pytest.mark.parametrize("kind", ["[placement]", "null"])
@pytest.mark.parametrize("override", [(), ("place.keep=4",)])
def test_a_kind_that_is_no_text_is_refused(write, kind, override):
    (error,) = refused(write(EXAMPLE.replace("kind: placement", f"kind: {kind}")), *override)
    assert error.key == "kind"


def test_control_characters_are_escaped(write):
    (error,) = refused(write(f"{EXAMPLE}\n'a\\u202e\\x1b]0;b\\x07': 1\n".replace("'", '"')))
    assert "a\\u202e\\x1b]0;b\\x07" in str(error)
    assert str(error).replace("\n", "").isprintable()


def test_lone_surrogate_is_refused(write):
    r"""\ud83d\ude00 is how JSON writes one sign; half of it cannot be written into any file."""
    good = load_config(write(EXAMPLE.replace("parameters:", r'"parameters":')), [r'name="a\u005fb"'])
    assert good.model.name == "a_b"
    (error,) = refused(write(EXAMPLE.replace("name: cantilever", r'name: "\ud83d" # ')))
    assert "half of a surrogate pair" in error.what
    (error,) = refused(write(EXAMPLE.replace("seed: 1", r'seed: "\ud83d\ude00"')))
    assert "'😀'" in error.what


def test_a_file_that_is_too_long_is_no_config(write):
    """A mebibyte of commas took a minute; the limit may fall within a sign of two bytes."""
    for sign in ("[" + "1," * (1 << 19), "é" * (1 << 17), "x" * ((1 << 17) - 8) + "é" * 99):
        (error,) = refused(write(f"name: {sign}"))
        assert "larger than 128 KiB" in error.what


# What is generated from the models: the committed schema and the template.
ROOT = Path(__file__).parents[2]


def test_the_committed_schema_is_that_of_the_models():
    assert (ROOT / "docs" / "config.schema.json").read_text(encoding="utf-8") == schema_text()


def test_every_field_of_the_schema_is_described():
    def fields(node):
        if isinstance(node, dict):
            yield from node.get("properties", {}).items()
            for value in node.values():
                yield from fields(value)
        elif isinstance(node, list):
            for value in node:
                yield from fields(value)

    found = list(fields(json.loads(schema_text())))
    assert len(found) > 60
    assert [name for name, field in found if not (field.get("description") or field.get("$ref"))] == []


@pytest.mark.parametrize("deck", ["../parts/hub-7.nas", "ünï it's: #1.bdf"])
def test_the_template_is_valid_for_any_deck_name(tmp_path, deck):
    path = tmp_path / "own.yaml"
    told = Answers(loads=(LoadAnswer(CandidateLocation("node", "2", "a node"), "[0, 0, 1]", 1e4, (20.0, 20.0)),))
    path.write_text(template(deck, answers=told), encoding="utf-8")
    assert load_config(path).data["mesh"]["file"] == deck


# configs/thesis/suite.yaml has a row for every figure and table of chapters 2 to 6, and each is measured or says why not.
SUITE = Path(__file__).parents[2] / "configs" / "thesis" / "suite.yaml"
FIGURES = {2: 8, 3: 9, 4: 6, 5: 1, 6: 15}
TABLES = {2: 1, 3: 2, 6: 2}
"""Chapter → how many it has."""


@pytest.fixture(scope="module")
def suite():
    return load_config(SUITE)


@pytest.fixture(scope="module")
def runs(suite):
    return [run.config for run in runs_of(suite)]


def named(rows, kind):
    """Numbers of the figures or tables that sources name, as in "table 6.2, figure 6.9"."""
    return {
        number
        for row in rows
        for words in re.findall(rf"{kind}s? ((?:\d\.\d+(?:, )?)+)", row.source)
        for number in re.findall(r"\d\.\d+", words)
    }


@pytest.mark.parametrize(("kind", "counts"), [("figure", FIGURES), ("table", TABLES)])
def test_no_example_is_missing(suite, kind, counts):
    wanted = {f"{chapter}.{i}" for chapter, count in counts.items() for i in range(1, count + 1)}
    assert named(suite.model.comparisons, kind) == wanted


@pytest.mark.slow
def test_thesis_examples_have_thesis_settings(runs):
    placements = [run for run in runs if run.data["kind"] == "placement"]
    printed = [run.model for run in placements if run.model.name.startswith("thesis-")]
    assert len(printed) == len(placements) / 2
    for own in printed:
        assert (own.process_noise.rule, own.process_noise.model_error) == ("as_printed", 0.0)
        assert (own.place.instants, own.place.weights, own.place.damping_slope) == (1, "thesis", False)
        assert (own.filter.method, own.validation.truth.model) == ("extended", "rom")


@pytest.mark.slow
def test_the_benches_of_chapter_2_have_its_update_and_its_noise(runs):
    """Algorithm 1: one update a step, Q* after it, its own step as the truth; but for the one that shows what Q* costs."""
    benches = {run.model.name: run.model for run in runs if run.data["kind"] == "bench"}
    estimates = {name: own.estimate for name, own in benches.items() if own.estimate is not None}
    printed = {name: own for name, own in estimates.items() if name.startswith("thesis-") and own.measured is None}
    assert all(own.method.update in ("one_shot", "as_printed") and own.truth.model == "filter_step" for own in printed.values())
    second = [name for name in printed if re.match(r"thesis-(loads|step|noise|wrong)", name)]
    assert {name for name in second if printed[name].method.noise != "as_printed"} == {"thesis-loads-before"}
    ours = [own.method for name, own in estimates.items() if name.startswith("ours-")]
    assert {(own.update, own.noise) for own in ours} == {("iterated", "before_step")}


def test_the_page_of_the_manual_has_every_row(suite):
    """docs/reproduction.md is made by `python docs/reproduction.py` from the numbers of this suite as it stands."""
    page = (SUITE.parents[2] / "docs" / "reproduction.md").read_text(encoding="utf-8").split("## Figure by figure")[1]
    rows = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("| ")][2:]
    said = [(row.source, row.statement, row.published) for row in suite.model.comparisons]
    assert [tuple(cell.strip() for cell in row[:3]) for row in rows] == said


@pytest.mark.parametrize(
    ("key", "old", "new"),
    [("filter.method", "bank", "grid"), ("validate.truth.model", "rich", "perturbed")],
)
def test_old_value_is_accepted_with_a_warning(write, key, old, new):
    path = write(EXAMPLE)
    with pytest.warns(UserWarning, match=f"--set {key}  {key}: '{old}' is now called '{new}'"):
        loaded = load_config(path, [f"{key}={old}"])
    assert loaded.data == load_config(path, [f"{key}={new}"]).data


@pytest.mark.parametrize(
    ("name", "key", "new"),
    [
        ("bench/loads.yaml", "estimate.allow_unfollowed", "allow_unresolved_steps"),
        ("thesis/suite.yaml", "comparisons.0.says", "statement"),
        ("thesis/suite.yaml", "comparisons.1.as_printed", "published_settings"),
    ],
)
def test_old_key_is_accepted_with_a_warning_at_its_line(write, name, key, new):
    text, old = (CONFIGS / name).read_text(encoding="utf-8"), key.rpartition(".")[2]
    path = write(text.replace(f" {new}:", f" {old}:", 1))
    line = text[: text.index(f" {new}:")].count("\n") + 1
    with pytest.warns(UserWarning, match=rf"own.yaml:{line}:\d+  {key}: '{old}' is now called '{new}'"):
        loaded = load_config(path)
    assert loaded.data == load_config(CONFIGS / name).data
    assert not any(place.startswith(key) for place in loaded._places)
