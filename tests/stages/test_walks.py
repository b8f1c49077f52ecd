"""Which walk the samples say an unknown load takes, and damage that is drawn by it."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight import api
from strainsight.cases.structure.walks import DECISIVE, may_walk_otherwise, walking, walks
from strainsight.workflow.artefact import Artefact

from .test_damage import SETTING
from .tested_beam import BLIND, CONFIG, ROOT, changed, estimated

pytestmark = pytest.mark.usefixtures("no_hot_spots")

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
def test_a_load_walks_otherwise_where_the_samples_say_so_by_far(loads, best, undecided):
    """Each after those before it; a walk by which no filter follows the samples is out."""

    def other(so_far, name):
        return None if name == "d" else so_far ^ {name}

    found = walks(frozenset(), list(loads), other, lambda own: LEVEL[own])
    assert found.best == frozenset(best)
    assert found.changed == tuple(best)
    assert found.undecided == tuple(undecided)


def config_with(tmp_path, noise, method="bank"):
    text = CONFIG.replace("MESH", str(ROOT / "meshes" / "cantilever.bdf"))
    (tmp_path / "one.yaml").write_text(text.replace("{model: integrated_random_walk}", noise))
    return api.load(tmp_path / "one.yaml", [f"filter.method={method}"]).config


def test_of_a_walk_the_other_one_with_the_kappa_that_is_stated(tmp_path):
    config = config_with(tmp_path, "{model: random_walk, kappa: 0.3, frequency: 4}")
    other = walking(config, "side")
    assert other.loads["side"].process_noise.model == "integrated_random_walk"
    assert (other.loads["side"].process_noise.kappa, other.loads["side"].process_noise.frequency) == (0.3, 4.0)
    assert other.loads["tip"] == config.loads["tip"]
    assert walking(other, "side") == config


def test_walks_are_compared_by_a_bank_alone(tmp_path):
    assert may_walk_otherwise(config_with(tmp_path, "{model: random_walk}"), ["side"])
    assert not may_walk_otherwise(config_with(tmp_path, "{model: matern}"), ["side"])
    assert not may_walk_otherwise(config_with(tmp_path, "{model: random_walk}", "extended"), ["side"])
    assert may_walk_otherwise(config_with(tmp_path, "{model: matern}"), [])


@pytest.mark.slow
def test_damage_of_a_sine_that_is_stated_as_a_random_walk_is_drawn_by_the_smooth_walk(tmp_path):
    """Told, with the key that has all by it; places down to a tenth of the largest range have an interval. The record of a load
    that walks as stated, and of a Matérn process, which is no walk: nothing is said, and of that the places below half have
    none."""
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
