"""Every number of a config has a plausible range, beyond which a warning says where it stands and what was meant."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import Annotated, get_args

import pytest
from pydantic import BaseModel

from strainsight.config.bench.bearing import BearingConfig
from strainsight.config.bench.bench import BenchConfig
from strainsight.config.load import load_config
from strainsight.config.marks import mark_of
from strainsight.config.placement import PlacementConfig
from strainsight.config.plausible import Marker, Plausible, PlausibleBy, Unbounded, implausible
from strainsight.config.suite import SuiteConfig

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
    """Every type and every piece of metadata in annotations."""
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
    """Whether a number is bounded from both sides."""
    below = any(hasattr(part, "ge") or hasattr(part, "gt") for part in inside if not isinstance(part, type))
    above = any(hasattr(part, "le") or hasattr(part, "lt") for part in inside if not isinstance(part, type))
    return below and above


def test_every_number_of_every_config_has_a_plausible_range_or_a_reason_for_none():
    numbers = every_number()
    assert len(numbers) > 250
    lacking = [(model, name) for model, name, field, inside in numbers if not (mark_of(field, Marker) or bounded(inside))]
    assert lacking == []


def test_a_number_without_a_range_is_noticed():
    class Careless(BaseModel):
        good: Annotated[float, Plausible(0.0, 1.0)]
        bad: dict[str, tuple[float, ...]] | None

    found = {name: mark_of(field, Marker) or bounded(inside) for _, name, field, inside in fields_of(Careless, set())}
    assert found == {"good": Plausible(0.0, 1.0), "bad": False}


def test_ranges_are_in_order_and_reasons_are_given():
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
def test_no_config_that_is_shipped_is_warned_of(path):
    assert list(implausible(load_config(path).model)) == []


E_IN_GPA = "{property: youngs_modulus, region: 1, guess: 190.0, range: [160.0, 240.0]}"
ODD = [  # (config, key, value, what the warning says)
    (PLACEMENT, "damping.ratio", "0.5", "if 0.5 is in per cent, write 0.005"),
    (PLACEMENT, "tolerances.position", "2.0", "if 2 is in mm, write 0.002"),
    (PLACEMENT, "gauges.direction.angles", "[900]", "900 deg is outside the plausible range of up to 360 deg"),
    (PLACEMENT, "gauges.range", "1500", "if 1500 is in µm/m, write 0.0015"),
    (PLACEMENT, "loads.tip.signal.phase", "90", "if 90 is in degrees, write 1.571"),
    (PLACEMENT, "loads.tip.signal.amplitude", "1e-9", "check the value and its unit"),
    (PLACEMENT, "mesh.merge", "1", "if 1 is in mm, write 0.001"),
    (PLACEMENT, "report.gauge_factor", "2000", "1 to 200"),
    (BEARING, "bearings.one.contact_angle", "0.785", "if 0.785 is in rad, write 44.98"),
    (BEARING, "bearings.one.youngs_modulus", "208", "if 208 is in GPa, write 2.08e+11"),
    (BEARING, "bearings.one", "{balls: 147, ball_diameter: 60, pitch_diameter: 3000, contact_angle: 45, radius_inner_left: 31.8, "
     "radius_inner_right: 31.8, radius_outer_left: 31.8, radius_outer_right: 31.8}", "if 60 is in mm, write 0.06"),
    (BEARING, "cases.pull.force", "[1e+12, 0, 0]", "up to 1e+09 N"),
    (BENCH, "bodies.beam.damping.ratio", "0.4", "if 0.4 is in per cent, write 0.004"),
    (BENCH, "estimate.sensors.gauges.noise", "1e+5", "1e-12 to 1000"),
]  # fmt: skip


@pytest.mark.parametrize(("text", "key", "value", "words"), ODD, ids=[key for _, key, *_ in ODD])
def test_an_absurd_value_is_warned_of_with_its_key_and_what_was_meant(tmp_path, text, key, value, words):
    path = tmp_path / "own.yaml"
    path.write_text(text, encoding="utf-8")
    assert list(implausible(load_config(path).model)) == []
    found = list(implausible(load_config(path, [f"{key}={value}"]).model))
    assert any(own.key.startswith(key) and words in f"{own.what}; {own.remedy}" for own in found), found


@pytest.mark.parametrize("key", ["damping.ratio", "tolerances.position", "gauges.range", "mesh.merge", "loads.tip.signal.phase"])
def test_what_a_warning_proposes_is_without_one(tmp_path, key):
    path = tmp_path / "own.yaml"
    path.write_text(PLACEMENT, encoding="utf-8")
    (value,) = (value for _, name, value, _ in ODD if name == key)
    (found,) = implausible(load_config(path, [f"{key}={value}"]).model)
    assert list(implausible(load_config(path, [f"{key}={found.remedy.rpartition(' ')[2]}"]).model)) == []


def test_lengths_are_compared_with_the_structure(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(PLACEMENT, encoding="utf-8")
    model = load_config(path, ["tolerances.position=0.05", "gauges.grid_length=0.06"]).model
    assert list(implausible(model)) == list(implausible(model, extent=1.0)) == []
    position, grid = sorted(implausible(model, extent=0.05), key=lambda own: -len(own.key))
    assert "0.05 m is more than 0.1 times the size of the structure, 0.05 m" in position.what
    assert (grid.key, position.key) == ("gauges.grid_length", "tolerances.position")


def test_the_range_of_a_parameter_is_that_of_its_property(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text(PLACEMENT, encoding="utf-8")
    found = list(implausible(load_config(path, [f"parameters.E={E_IN_GPA}", "validate.truth.parameters.E=210.0"]).model))
    assert [own.key for own in found] == ["parameters.E.guess", "parameters.E.range.0", "parameters.E.range.1"]
    assert found[0].remedy == "if 190 is in GPa, write 1.9e+11"
    factor = "{property: stiffness_factor, region: 1, guess: 1.0, range: [0.8, 1.3]}"
    assert list(implausible(load_config(path, [f"parameters.E={factor}", "validate.truth.parameters.E=1.1"]).model)) == []
