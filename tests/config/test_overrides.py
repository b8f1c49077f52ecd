"""What an override makes wrong is placed at the override, and a misspelt section is recognised."""

from __future__ import annotations

from pathlib import Path

import pytest

from strainsight.config.load import load_config
from strainsight.config.overrides import Override
from strainsight.errors import ConfigError

CONFIG = Path(__file__).parents[2] / "configs" / "cantilever-youngs-modulus.yaml"


def refused(override: str | Override) -> list[ConfigError]:
    with pytest.raises(ConfigError) as caught:
        load_config(CONFIG, [override])
    return [caught.value, *caught.value.others]


def test_a_misspelt_name_is_placed_at_the_override_that_made_it():
    errors = refused("loads.tipp.signal.amplitude=3")
    assert {error.key for error in errors} == {"loads.tipp.known", "loads.tipp.signal"}
    for error in errors:
        assert error.where == "--set loads.tipp.signal.amplitude"
        assert error.remedy == "did you mean tip?"


def test_a_section_that_only_an_override_made_has_to_be_added():
    (error,) = refused(Override("estimate.file", "a.csv", "--measurements"))
    assert (error.key, error.where) == ("estimate.channels", "--measurements")
    assert error.remedy.startswith("the config has no section `estimate` yet: add it; channels: Channels of gauges")
    assert "docs/estimation.md" in error.remedy


def test_a_section_that_is_there_stays_where_it_is():
    config = load_config(CONFIG, ["place.keep=6"])
    assert config.locate("place").startswith(f"{CONFIG}:")
    assert config.locate("place.keep") == "--set place.keep"
