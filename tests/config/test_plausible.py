"""Plausible ranges, messages, overrides, YAML text and damage settings of configs."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import get_args

import pytest
from pydantic import BaseModel

from strainsight.config.base import Marker, Plausible, PlausibleBy, Unbounded, implausible, mark_of
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.bodies import BearingConfig
from strainsight.config.damage import DamageSettings, MeanStressSection, SNCurve
from strainsight.config.keys import Override
from strainsight.config.load import load_config
from strainsight.config.placement import PlacementConfig
from strainsight.config.suite import SuiteConfig
from strainsight.config.yaml_text import YamlProblem, parse
from strainsight.errors import ConfigError
from strainsight.experiment.structure.damage import curve_of

from ..refusals import expect_refusal
from ..robustness.small import BENCH, PLACEMENT

ROOT = Path(__file__).parents[2]
SHIPPED = sorted([*(ROOT / "configs").rglob("*.yaml"), *(ROOT / "docs").rglob("*.yaml")])
BEARING = """
kind: bearing
name: one
bearings:
  one: {balls: 147, ball_diameter: 0.06, pitch_diameter: 3.0, contact_angle: 45, radius_inner_left: 0.0318,
        radius_inner_right: 0.0318, radius_outer_left: 0.0318, radius_outer_right: 0.0318}
cases: {pull: {force: [1.0e+5, 0, 0]}}
"""


def parts_of(*annotations):
    for item in annotations:
        yield item
        yield from parts_of(*get_args(item), *getattr(item, "metadata", ()))


def fields_of(model, seen):
    if model not in seen:
        seen.add(model)
        for name, field in model.model_fields.items():
            inside = list(parts_of(field.annotation, *field.metadata))
            yield model, name, field, inside
            for part in inside:
                if isinstance(part, type) and issubclass(part, BaseModel):
                    yield from fields_of(part, seen)


def every_number():
    kinds = (PlacementConfig, BenchConfig, BearingConfig, SuiteConfig)
    seen: set[type] = set()
    fields = list(chain.from_iterable(fields_of(kind, seen) for kind in kinds))
    return [entry for entry in fields if any(part in (int, float) for part in entry[3] if isinstance(part, type))]


def bounded(inside) -> bool:
    below = any(hasattr(part, "ge") or hasattr(part, "gt") for part in inside if not isinstance(part, type))
    above = any(hasattr(part, "le") or hasattr(part, "lt") for part in inside if not isinstance(part, type))
    return below and above


def test_every_config_number_has_plausible_range_or_reason():
    numbers = every_number()
    assert len(numbers) > 250
    lacking = [(model, name) for model, name, field, inside in numbers if not (mark_of(field, Marker) or bounded(inside))]
    assert lacking == []


def test_plausible_ranges_are_ordered():
    for _, _, field, _ in every_number():
        mark = mark_of(field, Marker)
        ranges = mark.ranges.values() if isinstance(mark, PlausibleBy) else (mark,) if isinstance(mark, Plausible) else ()
        assert all(0 <= own.low < own.high for own in ranges)
        assert not isinstance(mark, Unbounded) or mark.reason


def test_every_default_is_plausible():
    for model, name, field, _ in every_number():
        mark, value = mark_of(field, Marker), field.get_default(call_default_factory=False)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(mark, Plausible) and isinstance(number, int | float) and number:
                assert mark.low <= abs(number) <= mark.high, (model.__name__, name)


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_configs_have_no_warnings(path):
    assert list(implausible(load_config(path).model)) == []


E_IN_GPA = "{property: youngs_modulus, region: 1, guess: 190.0, range: [160.0, 240.0]}"
ODD = [  # (config, key, value, what the warning says)
    (PLACEMENT, "damping.ratio", "0.5", "if 0.5 is a value in per cent, write 0.005"),
    (PLACEMENT, "tolerances.position", "2.0", "if 2 is a value in mm, write 0.002"),
    (PLACEMENT, "gauges.direction.angles", "[900]", "900 deg is outside the plausible range of up to 360 deg"),
    (PLACEMENT, "gauges.range", "1500", "if 1500 is a value in µm/m, write 0.0015"),
    (PLACEMENT, "loads.tip.signal.phase", "90", "if 90 is a value in degrees, write 1.571"),
    (PLACEMENT, "mesh.merge", "1", "if 1 is a value in mm, write 0.001"),
    (BEARING, "bearings.one.contact_angle", "0.785", "if 0.785 is a value in rad, write 44.98"),
    (BEARING, "bearings.one", "{balls: 147, ball_diameter: 60, pitch_diameter: 3000, contact_angle: 45, radius_inner_left: 31.8, "
     "radius_inner_right: 31.8, radius_outer_left: 31.8, radius_outer_right: 31.8}", "if 60 is a value in mm, write 0.06"),
    (BEARING, "cases.pull.force", "[1e+12, 0, 0]", "up to 1e+09 N"),
    (BENCH, "bodies.beam.damping.ratio", "0.4", "if 0.4 is a value in per cent, write 0.004"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "key", "value", "words"), ODD, ids=[key for _, key, *_ in ODD])
def test_implausible_value_gives_warning_with_key_and_unit(tmp_path, text, key, value, words):
    path = tmp_path / "own.yaml"
    path.write_text(text, encoding="utf-8")
    assert list(implausible(load_config(path).model)) == []
    found = list(implausible(load_config(path, [f"{key}={value}"]).model))
    assert any(own.key.startswith(key) and words in f"{own.what}; {own.remedy}" for own in found), found


def test_lengths_are_compared_with_the_structure(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(PLACEMENT, encoding="utf-8")
    model = load_config(path, ["tolerances.position=0.05", "gauges.grid_length=0.06"]).model
    assert list(implausible(model)) == list(implausible(model, extent=1.0)) == []
    position, grid = sorted(implausible(model, extent=0.05), key=lambda own: -len(own.key))
    assert "0.05 m is larger than 0.1 times the size of the structure, 0.05 m" in position.what
    assert (grid.key, position.key) == ("gauges.grid_length", "tolerances.position")


def test_parameter_range_follows_property(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(PLACEMENT, encoding="utf-8")
    found = list(implausible(load_config(path, [f"parameters.E={E_IN_GPA}", "validate.truth.parameters.E=210.0"]).model))
    assert [own.key for own in found] == ["parameters.E.guess", "parameters.E.range.0", "parameters.E.range.1"]
    assert found[0].remedy == "if 190 is a value in GPa, write 1.9e+11"
    factor = "{property: stiffness_factor, region: 1, guess: 1.0, range: [0.8, 1.3]}"
    assert list(implausible(load_config(path, [f"parameters.E={factor}", "validate.truth.parameters.E=1.1"]).model)) == []


# What pydantic finds is said of the keys as they stand in the file, with what the key is for or what was meant.
CONFIGS = Path(__file__).parents[2] / "configs"
FORMS = "'box', 'cylinder', 'normal_cone', 'near_edges', 'near_set', 'shell_face', 'on_elements'"
BOX = "box: Lower and upper corner of the box [[x, y, z], [x, y, z]] [m]."


def refused(name: str, override: str | Override) -> list[ConfigError]:
    with pytest.raises(ConfigError) as caught:
        load_config(CONFIGS / name, [override])
    return [caught.value, *caught.value.others]


@pytest.mark.parametrize(
    ("zone", "key", "what", "remedy"),
    [
        ("{box: {min: [0, 0, 0], max: [1, 1, 1]}}", ".box", "the value is a mapping, but has to be a list", BOX),
        ("{box: [[0, 0, 0], [1, 1, 1]], at: 1}", ".at", "unknown key", "known keys: box"),
        ("{cylinder: {point: [0, 0, 0], radius: 1}}", ".cylinder.axis", "missing",
         "axis: Direction of the axis of the cylinder [-]."),
        ("{near_edgs: 0.1}", "", f"set exactly one of {FORMS}", "did you mean near_edges?"),
    ],
)
def test_zone_is_identified_by_its_keys(zone, key, what, remedy):
    """A member of the union has the name of its key: it must not be named twice, nor in place of the key at fault."""
    (error,) = refused("cantilever-youngs-modulus.yaml", f"gauges.exclude=[{zone}]")
    assert (error.key, error.what, error.remedy) == (f"gauges.exclude[0]{key}", what, remedy)


@pytest.mark.parametrize(
    ("entry", "key", "what", "remedy"),
    [
        ("bearing: a, inner: c", "outer", "missing", "outer: Frame of the outer ring, at the centre of the bearing."),
        ("bearing: a, outer: a, inner: c, size: 2", "size", "unknown key", "known keys: type, bearing, outer, inner, drag"),
    ],
)
def test_type_may_be_named_like_one_of_its_keys(entry, key, what, remedy):
    (error,) = refused("bench-full.yaml", f"forces.b={{type: bearing, {entry}}}")
    assert (error.key, error.what, error.remedy) == (f"forces.b.{key}", what, remedy)


@pytest.mark.parametrize(
    ("text", "line", "remedy"),
    [
        ("a:\n  b: 1\n\tc: 2\n", 3, "use spaces, not tabs"),
        ("a:\n    b: 1\n  c: 2\n", 3, "use the same indentation as the neighbouring lines above"),
        ("a: b: c\n", 1, "contains ': '"),
        ("a: 1\nb 2\nc: 3\n", 3, "KEY: VALUE in the line above"),
        ("a: [1, 2\nb: 3\n", 2, "close the bracket"),
        ("a: 'x\nb: 1\n", 3, "close the quotes"),
        ("a: %b\n", 1, "put quotes around the value"),
        ('a: "C:\\data"\n', 1, "single quotes"),
    ],
)
def test_a_mistake_has_a_line_and_a_remedy(text, line, remedy):
    with expect_refusal(YamlProblem, "not valid YAML", remedy=remedy) as caught:
        parse(text)
    assert caught.value.line == line


def test_a_misspelt_name_is_placed_at_the_override_that_made_it():
    errors = refused("cantilever-youngs-modulus.yaml", "loads.tipp.signal.amplitude=3")
    assert {error.key for error in errors} == {"loads.tipp.known", "loads.tipp.signal"}
    for error in errors:
        assert error.where == "--set loads.tipp.signal.amplitude"
        assert error.remedy == "did you mean tip?"


def test_a_section_that_only_an_override_made_has_to_be_added():
    (error,) = refused("cantilever-youngs-modulus.yaml", Override("estimate.file", "a.csv", "--measurements"))
    assert (error.key, error.where) == ("estimate.channels", "--measurements")
    assert error.remedy.startswith("add the section `estimate` to the config; channels: Channels of the gauges")
    assert "docs/estimation.md" in error.remedy


LINE = {"slope": 3.0, "stress": 1e8}


@pytest.mark.parametrize(
    ("curve", "mean", "keys"),
    [
        ({}, {}, []),
        ({"knee": 5e6, "second_slope": 5.0, "cut_off": 1e8}, {}, []),
        ({}, {"rule": "fkm", "sensitivity": 0.0}, []),
        ({"second_slope": 5.0}, {}, ["curve.second_slope"]),
        ({"knee": 5e6, "second_slope": 5.0, "cut_off": 5e6}, {}, ["curve.cut_off"]),
        ({"knee": 5e6, "cut_off": 1e8}, {}, ["curve.cut_off"]),
        ({}, {"rule": "goodman"}, ["mean_stress"]),
        ({}, {"rule": "fkm", "tensile_strength": 5e8, "sensitivity": 0.1}, ["mean_stress.tensile_strength"]),
        ({}, {"sensitivity": 0.1}, ["mean_stress.sensitivity"]),
    ],
)
def test_inconsistent_keys_are_named(curve, mean, keys):
    settings = DamageSettings(curve=SNCurve(**(LINE | curve)), mean_stress=MeanStressSection(**mean))
    assert [problem.key for problem in settings.problems()] == [*keys]


def test_an_amplitude_is_half_a_range():
    one, other = (
        curve_of(DamageSettings(curve=SNCurve(slope=5.0, stress=stress, of=of, knee=1e7)))[0]
        for stress, of in ((1e8, "range"), (5e7, "amplitude"))
    )
    assert one == other


# What a config may say of bridges.
CANTILEVER = CONFIGS / "cantilever-youngs-modulus.yaml"
UP, DOWN = "{position: [0.5, 0.05, 0.095], direction: [1, 0, 0]", "{position: [0.5, 0.05, -0.095], direction: [1, 0, 0]"


def one(*arms: str) -> str:
    return f"gauges.fixed=[{{arms: [{', '.join(arms)}]}}]"


ARMS = "gauges.fixed[0].arms"


@pytest.mark.parametrize(
    ("overrides", "key", "what", "remedy"),
    [
        ([one()], ARMS, "the bridge has 0 arms", "use two to four arms"),
        ([one(UP + "}")], ARMS, "the bridge has 1 arm", "for a single gauge, set `position` and `direction`"),
        ([one(UP + "}", UP + "}", DOWN + "}")], ARMS, "3 arms of the bridge have the sign 1", "at most two arms of each sign"),
        ([one(UP + ", sign: -1}", DOWN + ", sign: -1}")], ARMS, "no arm of the bridge has the", "`sign: -1` for the channel"),
        ([one(UP + ", sign: 2}", DOWN + "}")], f"{ARMS}[0].sign", "2 is not one of 1, -1", "Sign of the arm"),
        (["gauges.bridge=half-bendng"], "gauges.bridge", "'half-bendng' is not one of half-bending, full-bending", ""),
        (["gauges.bridge=full-torsion", "gauges.rosette=true", "gauges.direction.angles=[0, 90]"],
         "gauges.rosette", "cannot be an arm of a bridge", ""),
        (["gauges.bridge=half-axial", "place.symmetry={point: [0, 0, 0], normal: [0, 1, 0]}"],
         "place.symmetry", "cannot be placed in mirrored pairs", ""),
    ],
)  # fmt: skip
def test_invalid_bridge_is_refused_with_key_and_remedy(overrides, key, what, remedy):
    with expect_refusal(ConfigError, what, remedy=remedy, key=key):
        load_config(CANTILEVER, overrides)


def test_a_bridge_counts_as_one_gauge_of_the_layout():
    bridge = one(UP + "}", DOWN + ", sign: -1}")
    loaded = load_config(CANTILEVER, [bridge, "place.keep=1"])
    assert len(loaded.model.gauges.fixed[0].arms) == 2
    with pytest.raises(ConfigError, match="fixed"):
        load_config(CANTILEVER, [bridge[:-1] + f", {UP}}}]", "place.keep=1"])
