"""What pydantic finds is said of the keys as they stand in the file, with what the key is for or what was meant."""

from __future__ import annotations

from pathlib import Path

import pytest

from strainsight.config.load import load_config
from strainsight.errors import ConfigError

CONFIGS = Path(__file__).parents[2] / "configs"
BOX = "box: [[x, y, z], [x, y, z]]: lower and upper corner [m]."


def refused(name: str, override: str) -> list[ConfigError]:
    with pytest.raises(ConfigError) as caught:
        load_config(CONFIGS / name, [override])
    return [caught.value, *caught.value.others]


@pytest.mark.parametrize(
    ("zone", "key", "what", "remedy"),
    [
        ("{box: {min: [0, 0, 0], max: [1, 1, 1]}}", ".box", "a mapping has to be a list", BOX),
        ("{box: [[0, 0, 0], [1, 1]]}", ".box[1]", "2 entries are too few", BOX),
        ("{box: [[0, 0, 0], [1, 1, 1]], at: 1}", ".at", "unknown key", "known here: box"),
        ("{cylinder: {point: [0, 0, 0], radius: 1}}", ".cylinder.axis", "missing", "axis: Direction of its axis [-]."),
        ("{normal_cone: 5}", ".normal_cone", "5 has to be a mapping", "normal_cone: The normals."),
        (
            "{near_edgs: 0.1}",
            "",
            "give exactly one of 'box', 'cylinder', 'normal_cone', 'near_edges', 'near_set', 'shell_face', 'on_elements'",
            "did you mean near_edges?",
        ),
    ],
)
def test_a_zone_is_named_by_its_keys_alone(zone, key, what, remedy):
    """A member of the union has the name of its key: it must not be named twice, nor in place of the key at fault."""
    (error,) = refused("cantilever-youngs-modulus.yaml", f"gauges.exclude=[{zone}]")
    assert (error.key, error.what, error.remedy) == (f"gauges.exclude[0]{key}", what, remedy)


@pytest.mark.parametrize(
    ("entry", "key", "what", "remedy"),
    [
        ("bearing: a, inner: c", "outer", "missing", "outer: Frame of the outer ring, at the centre of the bearing."),
        ("bearing: {a: 1}, outer: a, inner: c", "bearing", "a mapping has to be text", "bearing: Name of the bearing."),
        ("bearing: a, outer: a, inner: c, size: 2", "size", "unknown key", "known here: type, bearing, outer, inner, drag"),
    ],
)
def test_a_type_may_have_the_name_of_one_of_its_keys(entry, key, what, remedy):
    (error,) = refused("bench-full.yaml", f"forces.b={{type: bearing, {entry}}}")
    assert (error.key, error.what, error.remedy) == (f"forces.b.{key}", what, remedy)


def test_members_of_a_union_without_names_are_one_problem_of_their_key():
    (error,) = refused("cantilever-youngs-modulus.yaml", "parameters.E.region={id: 5}")
    assert error.key == "parameters.E.region"
    assert error.what == "a mapping has to be a whole number or text or a list"


def test_a_key_is_described_by_the_member_that_the_config_names():
    errors = refused("cantilever-youngs-modulus.yaml", "loads.tip.signal={type: sweep, end_frequency: 4, duration: 1}")
    said = {error.key: error.remedy for error in errors}
    # a sine's is "Amplitude a …"
    assert said["loads.tip.signal.amplitude"] == "amplitude: Amplitude [N, of a moment N m, of a pressure Pa, of gravity m/s²]."
