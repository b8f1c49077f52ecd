"""Forecasts of time and memory against what docs/scaling.md and docs/measured.md have as measured."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from strainsight.config.load import load_config
from strainsight.experiment.structure.cost import (
    BULK_AND_THIN,
    FORECAST,
    IMPORT_TIME,
    Size,
    cost_of,
    cost_of_place,
    cost_of_report,
    cost_of_solve,
    cost_of_validate,
    of_pool_in_words,
    runs_of,
    scenarios_of,
    size_of,
    states_of,
)
from strainsight.mesh.kinds import ELEMENTS

ROOT = Path(__file__).parents[2]
SCALING = (ROOT / "docs" / "scaling.md").read_text(encoding="utf-8")
SIDES = {11_100: 9, 31_164: 13, 107_163: 20}
"""Unknowns of the measured cubes → elements along a side."""
CONFIG = load_config(ROOT / "configs" / "cantilever-youngs-modulus.yaml", ["rom.modes=10", "validate.truth.modes=40"]).model


def number(text: str) -> float:
    return float(text.replace(" ", "").removesuffix("s"))


def rows() -> list[tuple[str, int, list[str]]]:
    found = re.findall(r"^\| (plate|block) \| ([\d ]+) \|(.*)\|$", SCALING, re.MULTILINE)
    return [(shape, int(number(size)), [cell.strip() for cell in rest.split("|")]) for shape, size, rest in found]


def measured_size(shape: str, unknowns: int):
    """Nodes and elements of bricks of twenty nodes: a wall of one layer, 7 nodes an element but for its rim, or a cube."""
    if shape == "plate":
        return size_of(unknowns // 3, {"hex20": unknowns // 3 // 7})
    k = SIDES[unknowns]
    nodes = (k + 1) ** 3 + 3 * k * (k + 1) ** 2
    assert 3 * nodes == unknowns
    return size_of(nodes, {"hex20": k**3})


@pytest.mark.parametrize(("shape", "unknowns", "cells"), rows())
def test_seconds_and_memory_of_the_measured_bodies_are_within_a_factor_of_two(shape, unknowns, cells):
    size = measured_size(shape, unknowns)
    _, modes, rom, _, peaks, _ = cells
    memory = [number(part) for part in peaks.split(",")]
    for stage, seconds, peak in zip(("modes", "rom"), (modes, rom), memory[1:], strict=False):
        said = cost_of_solve(stage, CONFIG, size)
        assert 0.5 <= (said.seconds + IMPORT_TIME) / number(seconds) <= 2, (stage, said.seconds)
        assert 0.5 <= said.memory / peak <= 2


def test_more_modes_take_longer_as_measured():
    at = {98_937: (14, 1.14), 300_141: (40, 3.35), 1_003_011: (172, 11.4)}
    for unknowns, (seconds, memory) in at.items():
        assert f"`spectrum` {seconds} s and {memory} GiB" in SCALING
        said = cost_of_solve("spectrum", CONFIG, measured_size("plate", unknowns))
        assert 0.5 <= (said.seconds + IMPORT_TIME) / seconds <= 2
        assert 0.5 <= said.memory / memory <= 2


def test_every_kind_of_element_has_its_share_of_nodes():
    """Euler's count on a torus of cells, where there is no rim: nodes = corners + edges with a node + centres."""
    assert set(BULK_AND_THIN) == {kind.name for kind in ELEMENTS}
    for kind, (bulk, thin) in BULK_AND_THIN.items():
        k = 60
        cells = {"tet": 6, "pyr": 6, "wed": 2, "hex": 1}[kind[:3]]
        assert size_of(round(thin * cells * k * k), {kind: cells * k * k}).elements == pytest.approx(1, abs=0.02)
        thick = size_of(round((bulk + (thin - bulk) / 5) * cells * k**3), {kind: cells * k**3})
        assert thick.elements == pytest.approx(5, rel=0.01)


def test_report_takes_as_long_as_measured():
    for unknowns, seconds in {98_937: 7, 300_141: 8, 1_003_011: 31}.items():
        assert f"`report` {seconds}" in SCALING
        assert 0.5 <= cost_of_report(measured_size("plate", unknowns)).seconds / seconds <= 2
    assert "`validate` 57 s and 5.0 GiB" in SCALING
    assert 0.5 <= cost_of_validate(CONFIG, measured_size("plate", 1_003_011)).memory / 5.0 <= 2


FACTOR = 3


def config(*changes):
    return load_config(ROOT / "configs" / "cantilever-youngs-modulus.yaml", changes).model


def of(*changes, regions=1):
    return cost_of_place(config(*changes), Size(1950, 1.0, regions))


def measured(first):
    """Changes of the config, the first of a section, and seconds of the tables of whole runs of `place` and `validate`."""
    rows = re.findall(rf"^\| `({first}[^`]*)` \| [^|]* \| ([\d.]+) s \|", SCALING, re.MULTILINE)
    return [(changes.split(), float(seconds)) for changes, seconds in rows]


def test_seconds_as_measured_are_within_a_factor_of_three():
    assert len(measured("screen")) >= 6
    for changes, seconds in measured("screen"):
        assert 1 / FACTOR <= of(*changes).seconds / seconds <= FACTOR, changes


def test_validation_takes_as_long_as_measured_within_a_factor_of_three():
    assert len(measured("validate")) >= 3
    for changes, seconds in measured("validate"):
        assert 1 / FACTOR <= cost_of_validate(config(*changes), Size(10_998, 1.0)).seconds / seconds <= FACTOR, changes


def test_every_filter_run_of_a_validation_is_counted():
    """The layout, 20 repeats, ten random layouts of both pools and two noise levels; then points of sweeps."""
    assert runs_of(config()) == 42
    swept = config("validate.sweeps={time_steps: [1.0e-3], process_noise: [0.5, 2.0]}")
    assert runs_of(swept) == 45


def test_without_a_known_load_a_single_run_is_the_default():
    """σ of the modulus depends on the noise model of the load in all of them; what is stated is done nevertheless."""
    path = ROOT / "configs" / "cantilever-input-youngs-modulus.yaml"
    usual = [f"validate.{key}=null" for key in ("random_sets", "noise_factors", "repeats")]
    alone = load_config(path, usual).model
    assert alone.lacks_known_load
    assert runs_of(alone) == 1
    assert runs_of(load_config(path, [*usual, "validate.repeats=7"]).model) == 7
    shaken = load_config(ROOT / "configs" / "hub" / "hub-input-youngs-modulus-better.yaml", usual).model
    assert not shaken.lacks_known_load
    assert runs_of(shaken) == 42


def test_a_forecast_for_every_long_stage():
    known = {stage: cost_of(stage, config(), Size(10_998, 1.0)) for stage in FORECAST}
    assert list(known) == ["modes", "rom", "spectrum", "place", "validate", "report"]
    assert all(cost is not None and cost.seconds > 0 for cost in known.values())
    assert cost_of("place", config("screen.keep=all"), Size(10_998, 1.0)) is None


def test_what_is_counted():
    """Two states for each of ten modes and of the load's static response, and the modulus."""
    own = config("place.parameter_samples=2")
    assert (states_of(own), scenarios_of(own)) == (23, 20 * 2)


def test_a_panel_whose_skin_alone_has_a_free_modulus_is_forecast_with_the_shapes_of_all_samples():
    """Skin and stringers of two regions, ten modes, one load: 34 coordinates and 129 s of processor for 100 candidates at 20
    instants (docs/measured.md), where one region has 11."""
    assert states_of(config(), varying=True) == 2 * 33 + 1
    assert 1 / FACTOR <= of("screen.keep=100", regions=2).seconds / 129 <= FACTOR
    assert of("screen.keep=100").seconds < of("screen.keep=100", regions=2).seconds / FACTOR


def test_what_is_long_is_forecast_again_as_place_begins_and_its_pool_is_known():
    """2.2 GiB were measured of 20 000 gauges with 125 states in nine scenarios."""
    every = config("screen.keep=all", "place.instants=3", "place.parameter_samples=3")
    said = of_pool_in_words(every, 20_000, 125)
    assert said.startswith(
        "the stage `place` with 20000 candidates, 125 states and 9 combinations of instant, parameter sample and load case "
        "takes about 6.6 h of processor time and 1.5 GiB"
    )
    assert of_pool_in_words(every, 100, 23) == ""
