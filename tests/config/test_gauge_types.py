"""What a config says by the type of its gauges: defaults, which every key of its own overrides."""

from __future__ import annotations

import copy
import math
import re

import pytest
import yaml

from strainsight.config.gauge_types import CATALOGUE, fitting_type, gauge_type, type_gain
from strainsight.config.load import load_config
from strainsight.errors import ConfigError

from ..edges.beam import PLACEMENT_CONFIG

OWN = {"grid_length": 0.002, "grid_width": 0.002, "carrier_length": 0.006, "carrier_width": 0.004, "resistance": 1000.0}


@pytest.fixture
def loaded(tmp_path):
    """loaded(*overrides): a config of a placement that states no spacing."""
    data = copy.deepcopy(PLACEMENT_CONFIG)
    data["screen"] = {"keep": 8}
    (tmp_path / "edge.yaml").write_text(yaml.safe_dump(data), encoding="utf-8")
    return lambda *overrides: load_config(tmp_path / "edge.yaml", overrides).model


def test_a_config_without_a_type_is_what_it_was(loaded):
    config = loaded()
    assert (config.gauges.type, config.gauges.grid_length, config.gauges.range) == (None, 0.0, None)
    assert (config.screen.minimum_spacing, config.place.minimum_spacing, config.tolerances.gain) == (0.0, 0.0, 0.01)
    assert gauge_type(config.gauges) is None


def test_a_type_gives_grid_spacing_range_and_gain(loaded):
    """3/350 by its data sheet: a grid of 1/8 inch, a carrier of 0.42 × 0.27 inch, 5 %, 350 Ω, a gauge factor to 0.5 %."""
    config = loaded("gauges.type=3/350")
    assert config.gauges.grid_length == pytest.approx(0.0254 / 8, rel=0.002)
    assert (config.report.gauge_factor, config.report.resistance) == (2.1, 350.0)
    assert config.screen.minimum_spacing == config.place.minimum_spacing == pytest.approx(0.42 * 0.0254, rel=0.005)
    assert config.gauges.range == 0.05
    assert config.tolerances.gain == pytest.approx(math.hypot(0.005, 1 / 350), abs=1e-6)
    assert (config.tolerances.angle, config.gauges.clearance) == (2.0, None)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("gauges.grid_length", 0.0),
        ("gauges.range", 1e-3),
        ("gauges.range", None),
        ("screen.minimum_spacing", 0.0),
        ("place.minimum_spacing", 0.05),
        ("tolerances.gain", 0.02),
    ],
)
def test_a_key_that_is_stated_wins(loaded, key, value):
    config = loaded("gauges.type=3/350", f"{key}={'null' if value is None else value}")
    section, name = key.split(".")
    assert getattr(getattr(config, section), name) == value
    others = {"gauges.grid_length", "screen.minimum_spacing", "tolerances.gain"} - {key}
    typed = loaded("gauges.type=3/350")
    for other in others:
        section, name = other.split(".")
        assert getattr(getattr(config, section), name) == getattr(getattr(typed, section), name)


def test_tolerances_of_none_stay_none_and_accelerometers_keep_their_gain(loaded):
    assert loaded("gauges.type=3/120", "tolerances=none").tolerances == "none"
    sensor = "{quantity: acceleration, noise_std: {value: 0.01}}"
    assert loaded("gauges.type=3/120", f"motion_sensors={{a: {sensor}}}").tolerances.gain == 0.01
    assert loaded("gauges.type=3/120").tolerances.gain == pytest.approx(math.hypot(0.005, 1 / 120), abs=1e-6)


def test_a_type_of_ones_own_is_taken_and_may_replace_one_of_the_catalogue(loaded):
    for name in ("mine", "3/350"):
        config = loaded(f"gauges.type={name}", f"gauges.types={{{name}: {OWN}}}".replace("'", ""))
        assert (config.gauges.grid_length, config.screen.minimum_spacing) == (0.002, 0.006)
        assert config.tolerances.gain == pytest.approx(math.hypot(0.01, 1 / 1000), abs=1e-6)
        assert gauge_type(config.gauges).bend_radius == 0


@pytest.mark.parametrize(
    ("overrides", "said"),
    [
        (["gauges.type=3/530"], r"gauges\.type: no type of gauge is called '3/530' +did you mean 3/350"),
        (["gauges.type=3/350-rosette"], r"gauges\.type: 3/350-rosette has 3 grids, and a gauge here has 1"),
        (
            ["gauges.type=3/350", "gauges.rosette=true", "gauges.direction={type: axis, axis: [1, 0, 0], angles: [0, 45, 90]}"],
            r"3/350 has 1 grid, and a gauge here has 3 +take 3/350-rosette",
        ),
        (["gauges.type=mine", "gauges.types={mine: {grid_length: 0.002}}"], r"gauges\.types\.mine\.grid_width"),
        (["gauges.types={a.b: {}}"], r"gauges\.types"),
    ],
)
def test_a_type_that_is_not_there_or_does_not_fit_is_named_with_its_remedy(loaded, overrides, said):
    with pytest.raises(ConfigError) as caught:
        loaded(*overrides)
    text = "\n".join(str(problem) for problem in (caught.value, *caught.value.others))
    assert re.search(said, text.replace("\n", " ")), text


def test_the_catalogue_is_sound_by_its_own_names():
    """A name says grid in mm and resistance; a carrier holds its grids; a range, a factor and a gain are those of foil gauges."""
    for name, own in CATALOGUE.items():
        grid, resistance = name.removesuffix("-rosette").split("/")
        assert own.grid_length == pytest.approx(1e-3 * float(grid), rel=0.07)
        assert own.resistance == float(resistance)
        assert own.grid_length < own.carrier_length
        assert own.grid_width < own.carrier_width
        assert own.grids == (3 if name.endswith("rosette") else 1)
        assert 0.02 < own.range < 0.06
        assert 1.9 < own.gauge_factor < 2.2
        assert 0.005 < type_gain(own) < 0.015
        assert own.source


def test_a_part_gets_the_type_whose_carrier_is_no_third_of_its_largest_face():
    assert [fitting_type(side) for side in (1.0, 0.0322, 0.032, 0.0238, 0.0236)] == ["3/350"] * 2 + ["1.5/350"] * 2 + [None]
