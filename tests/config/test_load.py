"""A config is checked whole: every problem at once, each with its place and its remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from strainsight.config.load import load_config
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
        ("keep: 4", "kepe: 4", "place.kepe"),
        ("length_unit: m", "length_unit: metre", "mesh.length_unit"),
        ("guess: 1.89e+11", "guess: '1.89e+11'", "parameters.E.guess"),
        ("range: [1.6e+11, 2.4e+11]", "range: [2.4e+11, 1.6e+11]", "parameters.E.range"),
        ("guess: 1.89e+11", "guess: 2.9e+11", "parameters.E"),
        ("direction: [0, 0, 1]", "direction: [0, 0, 0]", "loads.tip.direction"),
        ("node: 2, ", "", "loads.tip"),
        ("modes: 10", "modes: 0", "rom.modes"),
        ("ratio: 0.01", "ratio: 1.5", "damping.ratio"),
        ("train: {duration: 1.0", "train: {duration: 1.0e+308", "train.time_step"),
        ("train: {duration: 1.0, time_step: 5.0e-4", "train: {duration: 1.0, time_step: 5.0e-324", "train.time_step"),
        ("seed: 1", "seed: 99999999999999999999", "seed"),
        ("aggregate: mean", "aggregate: median", "place.aggregate"),
        ("parameters: {E: 2.1e+11}", "parameters: {G: 2.1e+11}", "validate.truth.parameters.G"),
        ("parameters: {E: 2.1e+11}", "parameters: {E: 9.0e+11}", "validate.truth.parameters.E"),
        ("name: cantilever-youngs-modulus", "name: ../elsewhere", "name"),
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


def test_an_unknown_load_that_is_not_estimated_is_refused_where_the_unknowns_are_listed(write):
    (error,) = refused(write(EXAMPLE.replace("known: true", "known: false")))
    assert error.key.startswith("place.estimate")
    assert "tip" in str(error)


ESTIMATE = "estimate: {channels: [{channel: a, gauge: G1, unit: m/m}], inputs: {tip: {channel: b, unit: N}}}\n"


@pytest.mark.parametrize(
    ("override", "key", "says"),
    [
        ("estimate.initial_std={F: 0.2}", "estimate.initial_std.F", "no unknown 'F'"),
        ("estimate.initial_std={tip: 0.2}", "estimate.initial_std.tip", "no unknown 'tip'"),
        ("estimate.inputs={top: {channel: b, unit: N}}", "estimate.inputs.top", "no load 'top'"),
    ],
)
def test_a_name_in_estimate_that_nothing_would_read_is_refused(write, override, key, says):
    path = write(EXAMPLE + ESTIMATE)
    load_config(path)
    (error,) = refused(path, override)
    assert (error.key, says) == (key, error.what)


def test_a_channel_of_an_unknown_load_is_refused(write):
    (error,) = refused(
        write(EXAMPLE + ESTIMATE),
        "loads.tip.known=false",
        "place.estimate=[tip, E]",
        "validate.initial_std={tip: 0.1, E: 0.1}",
    )
    assert error.key == "estimate.inputs.tip"
    assert "would not be read" in error.what


def test_all_problems_are_reported_at_once(write):
    text = EXAMPLE.replace("keep: 4", "kepe: 4").replace("modes: 10", "modes: -1").replace("seed: 1", "seed: no")
    keys = {error.key for error in refused(write(text))}
    assert {"place.kepe", "rom.modes", "seed"} <= keys


def test_a_misspelt_key_is_recognised(write):
    errors = refused(write(EXAMPLE.replace("minimum_spacing", "minimal_spacing")))
    assert "did you mean minimum_spacing" in errors[0].remedy


@pytest.mark.parametrize("number", ["189e9", "1.89e11", "1.89E+11", "189000000000"])
def test_a_number_is_a_number_however_it_is_written(write, number):
    assert load_config(write(EXAMPLE.replace("1.89e+11", number))).data["parameters"]["E"]["guess"] == 1.89e11


@pytest.mark.parametrize(
    "text",
    [
        "",
        "just text",
        "- a list",
        "kind: placement\nkind: placement\n",
        "kind: !!python/object/apply:os.system ['true']\n",
        "a: &a [*a]\n",
        "kind: [\n",
        "kind: \x00\n",
    ],
)
def test_what_is_no_config_is_refused_in_one_message(write, text):
    assert refused(write(text))[0].where


def test_a_missing_file_is_refused(tmp_path):
    assert "no such" in str(refused(tmp_path / "none.yaml")[0])


def test_an_override_counts_and_is_named_as_the_place(write):
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


def test_paths_stay_as_written(write):
    assert load_config(write(EXAMPLE)).data["mesh"]["file"] == "../meshes/cantilever.bdf"


@pytest.mark.parametrize("kind", ["[placement]", "{placement: 1}", "[[]]", "null", "1"])
@pytest.mark.parametrize("override", [(), ("place.keep=4",)])
def test_a_kind_that_is_no_text_is_refused(write, kind, override):
    (error,) = refused(write(EXAMPLE.replace("kind: placement", f"kind: {kind}")), *override)
    assert error.key == "kind"


def test_what_a_terminal_obeys_is_not_shown_as_it_stands(write):
    (error,) = refused(write(f"{EXAMPLE}\n'a\\u202e\\x1b]0;b\\x07': 1\n".replace("'", '"')))
    assert "a\\u202e\\x1b]0;b\\x07" in str(error)
    assert str(error).replace("\n", "").isprintable()


def test_a_number_of_five_thousand_digits_is_cut_in_the_message(write):
    (error,) = refused(write(EXAMPLE.replace("seed: 1", f"seed: {'9' * 5000}")))
    assert "is not a decimal number" in error.what
    assert len(str(error)) < 2000


def test_half_of_a_sign_is_no_text(write):
    r"""\ud83d\ude00 is how JSON writes one sign; half of it cannot be written into any file."""
    good = load_config(write(EXAMPLE.replace("parameters:", r'"parameters":')), [r'name="a\u005fb"'])
    assert good.model.name == "a_b"
    (error,) = refused(write(EXAMPLE.replace("name: cantilever", r'name: "\ud83d" # ')))
    assert "half of a sign" in error.what
    (error,) = refused(write(EXAMPLE.replace("seed: 1", r'seed: "\ud83d\ude00"')))
    assert "'😀'" in error.what


@pytest.mark.parametrize("place", ["²", "9" * 5000, "٣", "-1", "3"])
def test_a_place_in_a_list_that_is_none(write, place):
    (error,) = refused(write(EXAMPLE), f"loads.tip.direction.{place}=1")
    assert "has no entry" in error.what or "is not KEY=VALUE" in error.what


def test_a_file_that_is_too_long_is_no_config(write):
    """A mebibyte of commas took a minute; the limit may fall within a sign of two bytes."""
    for sign in ("[" + "1," * (1 << 19), "é" * (1 << 17), "x" * ((1 << 17) - 8) + "é" * 99):
        (error,) = refused(write(f"name: {sign}"))
        assert "larger than 128 KiB" in error.what
