"""Damage of one and several records against cycles counted by another program; which walk an unknown load takes."""

from __future__ import annotations

import numpy as np
import pytest
import rainflow

from strainsight import api
from strainsight.config.damage import DamageSettings, SNCurve
from strainsight.estimation.grid_filter_smoother import Paths
from strainsight.estimation.smoother import Smoothed
from strainsight.experiment.structure.damage import DECISIVE, Places, Recorded, damage_in_test, walking, walks
from strainsight.fem.affine import AffineOperator
from strainsight.runner.artefact import Artefact

from ..estimation.chain import loaded_chain
from .tested_beam import ALONE, BLIND, CONFIG, ROOT, changed, estimated

pytestmark = pytest.mark.usefixtures("no_hot_spots")

SLOPE, STRESS, POINTS, DRAWS, TIMES = 5.0, 1e7, 30, 40, 1000.0
SETTING = (
    f"estimate.damage={{curve: {{slope: {SLOPE}, stress: {STRESS}}}, draws: {DRAWS}, points: {POINTS}, "
    f"repetitions: {TIMES}, hot_spots: 4}}"
)
E = 1.89e11
"""Of the config, which is not estimated there."""


@pytest.fixture(scope="module")
def blind(tmp_path_factory):
    folder = tmp_path_factory.mktemp("damage")
    results = changed(folder, "blind", BLIND)
    code, said = estimated(folder, results / "measured.csv", SETTING, config="blind.yaml")
    assert code == 0, said
    return Artefact(results / "estimate.h5"), said


def test_damage_of_the_smoothed_strain_is_that_of_its_cycles(blind):
    """At the virtual gauge, whose smoothed strain is in the file: E ε, and the record a thousand times."""
    found, _ = blind
    cycles = rainflow.extract_cycles(E * found["/virtual/strain"][:, 0])
    moment = sum(count * (size / STRESS) ** SLOPE for size, _, count, _, _ in cycles)
    assert found["/damage/virtual/of_mean"][0] == pytest.approx(TIMES * moment / 2e6, rel=1e-6)
    expected = STRESS * (TIMES * moment / 1e6) ** (1 / SLOPE)
    assert found["/damage/virtual/range_of_mean"][0] == pytest.approx(expected, rel=1e-6)


def test_intervals_are_about_the_median_where_they_were_drawn_and_nowhere_else(blind):
    found, _ = blind
    low, middle, high, of_mean = (found[f"/damage/surface/{name}"] for name in ("low", "damage", "high", "of_mean"))
    drawn = np.isfinite(middle)
    assert drawn.sum() == POINTS
    assert (low[drawn] < middle[drawn]).all()
    assert (middle[drawn] < high[drawn]).all()
    assert of_mean[drawn].min() >= of_mean[~drawn].max() * (1 - 1e-6)
    ranges = found["/damage/surface/range"][drawn]
    np.testing.assert_allclose(ranges, STRESS * (middle[drawn] * 2e6 / 1e6) ** (1 / SLOPE), rtol=1e-2)


def test_hot_spots_are_the_most_damaged_and_apart(blind):
    found, said = blind
    spots, position = found["/damage/hot_spot"], found["/damage/surface/position"]
    level = found["/damage/surface/damage"]
    assert level[spots[0]] >= np.nanmax(level) * (1 - 1e-5)
    assert (np.diff(level[spots]) <= 1e-5 * level[spots[0]]).all()
    apart = np.linalg.norm(position[spots][:, None] - position[spots], axis=2)
    assert apart[~np.eye(len(spots), dtype=bool)].min() > 0.05 * np.ptp(position, axis=0).max()
    # the root of the cantilever, at x = 0
    assert position[spots[0], 0] < 0.1 * np.ptp(position[:, 0])
    assert "hot spots" in said


def test_a_place_of_next_to_no_stress_has_no_interval(blind):
    """Below a tenth of the largest equivalent range, where it was not looked at: damage of the smoothed history."""
    found, said = blind
    largest = found["/damage/surface/range_of_mean"].max()
    assert found["/damage/virtual/range_of_mean"][0] < 0.1 * largest
    assert np.isnan(found["/damage/virtual/low"][0])
    assert "damage.low.V1" not in found.summary
    assert found.summary["life.V1"] == pytest.approx(found["/damage/hours"][()] / found.summary["damage.of_mean.V1"])
    said = " ".join(said.split())
    assert "Where the damage-equivalent stress range is below 0.1 of the largest one, the interval is not validated" in said
    assert "only the damage of the smoothed strain history" in said


@pytest.mark.slow
def test_where_sigma_is_withheld_the_interval_is_too(tmp_path):
    results = changed(tmp_path, "alone", ALONE)
    code, said = estimated(tmp_path, results / "measured.csv", SETTING, config="alone.yaml")
    assert code == 0, said
    found = Artefact(results / "estimate.h5")
    for place in ("surface", "virtual"):
        for name in ("damage", "low", "high", "range", "range_low", "range_high"):
            assert np.isnan(found[f"/damage/{place}/{name}"]).all()
        assert (found[f"/damage/{place}/of_mean"] > 0).all()
    words = " ".join(said.split())
    assert "damage of the smoothed strain history (without 95 % interval)" in words
    assert "σ at positions without gauges is withheld, so damage has no interval" in words
    assert not any(name.startswith(("damage.low", "damage.high", "damage.V1")) for name in found.summary)


LEVEL = {
    frozenset(): 100.0,
    frozenset("a"): 100.0 + 2 * DECISIVE,
    frozenset("b"): 100.0 + 5 * DECISIVE,
    frozenset("ab"): 100.0 + 2.5 * DECISIVE,
    frozenset("ac"): 0.0,
}
"""ln evidence by the loads that walk otherwise."""


@pytest.mark.parametrize(
    ("loads", "best", "undecided"), [("", "", ""), ("a", "a", ""), ("ab", "a", "b"), ("ac", "a", ""), ("ad", "a", "")]
)
def test_a_load_walks_otherwise_where_the_samples_report_it_by_far(loads, best, undecided):

    def other(so_far, name):
        return None if name == "d" else so_far ^ {name}

    found = walks(frozenset(), list(loads), other, lambda own: LEVEL[own])
    assert found == (frozenset(best), list(best), list(undecided))


def test_of_a_walk_the_other_one_with_the_kappa_that_is_stated(tmp_path):
    text = CONFIG.replace("MESH", str(ROOT / "meshes" / "cantilever.bdf"))
    noise = "{model: random_walk, kappa: 0.3, frequency: 4}"
    (tmp_path / "one.yaml").write_text(text.replace("{model: integrated_random_walk}", noise))
    config = api.load(tmp_path / "one.yaml", []).config
    other = walking(config, "side")
    assert other.loads["side"].process_noise.model == "integrated_random_walk"
    assert (other.loads["side"].process_noise.kappa, other.loads["side"].process_noise.frequency) == (0.3, 4.0)
    assert other.loads["tip"] == config.loads["tip"]
    assert walking(other, "side") == config


@pytest.mark.slow
def test_damage_of_a_sine_that_is_stated_as_a_random_walk_is_drawn_by_the_smooth_walk(tmp_path):
    """Places down to a tenth of the largest range have an interval; with a Matérn process, no walk, those down to half."""
    found = {}
    for name, noise in (("walk", "random_walk"), ("smooth", "integrated_random_walk"), ("matern", "matern")):
        changes = {**BLIND, "name: test\n": f"name: {name}\n", "{model: integrated_random_walk}": f"{{model: {noise}}}"}
        results = changed(tmp_path, name, changes)
        setting = SETTING.replace("points: 30", "points: 2000")
        code, said = estimated(tmp_path, results / "measured.csv", setting, config=f"{name}.yaml")
        assert code == 0, said
        found[name] = Artefact(results / "estimate.h5"), " ".join(said.split())
    words = "loads.side.process_noise.model: integrated_random_walk"
    assert words in found["walk"][1]
    assert words not in found["smooth"][1] + found["matern"][1]
    for name, share in (("walk", 0.1), ("smooth", 0.1), ("matern", 0.5)):
        ranges, low = (found[name][0][f"/damage/surface/{key}"] for key in ("range_of_mean", "low"))
        np.testing.assert_array_equal(np.isfinite(low), ranges >= share * ranges.max() * (1 - 1e-9))


CYCLES, MODULUS, COUNT = 1e5, 2e9, 41
ROWS = np.array([0.3, -0.2])


def damage_of(q):
    """Of one motion (T + 1, 2) at the one place."""
    cycles = rainflow.count_cycles(MODULUS * q @ ROWS)
    return sum(count * (size / STRESS) ** SLOPE for size, count in cycles) / CYCLES


@pytest.fixture(scope="module")
def records():
    rng = np.random.default_rng(1)
    found = []
    for steps in (60, 90):
        mean = 1e-3 * rng.standard_normal((steps + 1, 1, 5))
        drawn = mean[None, :, 0, :2] + 2e-4 * rng.standard_normal((COUNT, steps + 1, 2))
        parts = [Paths(np.zeros((COUNT, 0))[part], drawn[part]) for part in (slice(0, 3), slice(3, None))]
        # parts of another size in the longer record
        parts = parts if steps == 60 else [Paths(np.zeros((COUNT, 0)), drawn)]
        smoothed = Smoothed(np.arange(steps + 1.0), mean, np.zeros_like(mean), None)
        found.append((smoothed, parts, drawn))
    return found


def found_of(records):
    settings = DamageSettings(curve=SNCurve(slope=SLOPE, stress=STRESS, cycles=CYCLES), draws=COUNT, repetitions=3.0)
    place = Places(np.zeros((1, 3)), np.array([1]), AffineOperator(ROWS[None, None], {}), AffineOperator(np.array([MODULUS]), {}))
    each = [Recorded(loaded_chain(), smoothed, np.arange(2), parts) for smoothed, parts, _ in records]
    return damage_in_test(settings, {"virtual": place}, each, lambda share: None)


def test_damage_is_the_sum_over_the_records(records):
    found = found_of(records)
    assert found.virtual.of_mean[0] == pytest.approx(3 * sum(damage_of(own.mean[:, 0, :2]) for own, _, _ in records))
    draws = [sum(damage_of(drawn[i]) for _, _, drawn in records) for i in range(COUNT)]
    assert found.virtual.damage[0] == pytest.approx(3 * np.median(draws))
    assert found.hours == pytest.approx(3 * (60 + 90) / 3600)
