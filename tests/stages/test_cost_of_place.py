"""The forecast of place against what docs/scaling.md has as measured; it grows with all that is more."""

from __future__ import annotations

import itertools
import re
from pathlib import Path

import pytest

from strainsight.cases.structure.cost import Size
from strainsight.cases.structure.cost_of_place import (
    cost_of_place,
    cost_of_pool,
    of_pool_in_words,
    scenarios_of,
    states_of,
)
from strainsight.config.load import load_config

ROOT = Path(__file__).parents[2]
SCALING = (ROOT / "docs" / "scaling.md").read_text(encoding="utf-8")
FACTOR = 3


def config(*changes):
    return load_config(ROOT / "configs" / "cantilever-youngs-modulus.yaml", changes).model


def of(*changes, regions=1):
    return cost_of_place(config(*changes), Size(1950, 1.0, regions))


def measured():
    """Changes of the config and seconds of the table of whole runs of `place`."""
    rows = re.findall(r"^\| `(screen\.keep=[^`]*)` \| [^|]* \| ([\d.]+) s \|", SCALING, re.MULTILINE)
    return [(changes.split(), float(seconds)) for changes, seconds in rows]


def test_seconds_as_measured_are_within_a_factor_of_three():
    assert len(measured()) >= 6
    for changes, seconds in measured():
        assert 1 / FACTOR <= of(*changes).seconds / seconds <= FACTOR, changes


def test_the_constants_are_those_of_the_document():
    formula = re.search(
        r"`place` takes ([\d.]+) \+ s·m·\(([\d.e-]+) \+ ([\d.e-]+) n² \+ ([\d.e-]+) n³\) seconds "
        r"and ([\d.]+) \+ ([\d.e-]+) s·m·n GiB",
        SCALING,
    )
    c0, c1, c2, c3, g0, g1 = map(float, formula.groups())
    for m, n, s in ((100, 23, 1), (5000, 83, 20)):
        own = cost_of_pool(m, n, s)
        assert own.seconds == pytest.approx(c0 + s * m * (c1 + c2 * n**2 + c3 * n**3), rel=1e-12)
        assert own.memory == pytest.approx(g0 + g1 * s * m * n, rel=1e-12)


def test_the_forecast_of_fifty_thousand_gauges_is_that_of_the_document():
    said = re.search(r"50 000 gauges .* 124 states, would take ([\d.]+) h and ([\d.]+) GiB", SCALING)
    hours, memory = map(float, said.groups())
    own = cost_of_pool(50_000, 124, 1)
    assert own.seconds / 3600 == pytest.approx(hours, abs=0.05)
    assert own.memory == pytest.approx(memory, abs=0.005)


@pytest.mark.parametrize(
    ("what", "values"),
    [
        ("screen.keep", (4, 10, 100, 20_000)),
        ("place.instants", (1, 2, 20, 200)),
        ("place.parameter_samples", (1, 3, 9)),
        ("rom.modes", (1, 4, 40, 400)),
    ],
)
def test_more_of_anything_costs_more_and_nothing_costs_nothing(what, values):
    found = [of(f"{what}={value}") for value in values]
    assert found[0].seconds > 0
    assert found[0].memory > 0
    assert all(a.seconds < b.seconds and a.memory <= b.memory for a, b in itertools.pairwise(found))


def test_what_is_counted():
    """Two states for each of ten modes and of the load's static response, and the modulus."""
    own = config("place.parameter_samples=2")
    assert (states_of(own), scenarios_of(own)) == (23, 20 * 2)


def test_a_panel_whose_skin_alone_has_a_free_modulus_is_forecast_with_the_shapes_of_all_samples():
    """Skin and stringers of two regions, ten modes, one load: 34 coordinates and 129 s of processor for 100 candidates at 20
    instants (docs/measured.md), where one region has 11."""
    assert states_of(config(), apart=True) == 2 * 33 + 1
    assert 1 / FACTOR <= of("screen.keep=100", regions=2).seconds / 129 <= FACTOR
    assert of("screen.keep=100").seconds < of("screen.keep=100", regions=2).seconds / FACTOR


def test_all_candidates_have_no_number_beforehand():
    assert of("screen.keep=all") is None


def test_what_is_long_is_forecast_again_as_place_begins_and_its_pool_is_known():
    """2.2 GiB were measured of 20 000 gauges with 125 states in nine scenarios."""
    every = config("screen.keep=all", "place.instants=3", "place.parameter_samples=3")
    said = of_pool_in_words(every, 20_000, 125)
    assert said.startswith("place of 20000 candidates, 125 states and 9 scenarios takes about 12 h of processor time and 1.5 GiB")
    assert of_pool_in_words(every, 100, 23) == ""
