"""What a config may say of bridges, and what each mistake is answered with."""

from __future__ import annotations

import pytest

from strainsight.config.load import load_config
from strainsight.errors import ConfigError

from ..refusals import expect_refusal
from .test_plausible import CONFIGS

CONFIG = "cantilever-youngs-modulus.yaml"
UP, DOWN = "{position: [0.5, 0.05, 0.095], direction: [1, 0, 0]", "{position: [0.5, 0.05, -0.095], direction: [1, 0, 0]"


def one(*arms: str) -> str:
    return f"gauges.fixed=[{{arms: [{', '.join(arms)}]}}]"


ARMS = "gauges.fixed[0].arms"


@pytest.mark.parametrize(
    ("overrides", "key", "what", "remedy"),
    [
        ([one()], ARMS, "a bridge of 0 arms", "give two to four arms"),
        ([one(UP + "}")], ARMS, "a bridge of 1 arm", "one alone is a gauge: position, direction"),
        ([one(UP + "}", UP + "}", DOWN + "}")], ARMS, "a bridge of 3 arms of sign 1", "at most two of either sign"),
        ([one(UP + ", sign: -1}", DOWN + ", sign: -1}")], ARMS, "2 arms, none of sign 1", "sign: -1 of the channel"),
        ([one(UP + ", sign: 2}", DOWN + "}")], f"{ARMS}[0].sign", "2 is not one of 1, -1", "Of its strain"),
        (["gauges.bridge=half-bendng"], "gauges.bridge", "'half-bendng' is not one of half-bending, full-bending", ""),
        (["gauges.bridge=full-torsion", "gauges.rosette=true", "gauges.direction.angles=[0, 90]"],
         "gauges.rosette", "no arm of a bridge", ""),
        (["gauges.bridge=half-axial", "place.symmetry={point: [0, 0, 0], normal: [0, 1, 0]}"],
         "place.symmetry", "not placed in mirrored pairs", ""),
    ],
)  # fmt: skip
def test_a_bridge_that_cannot_be_is_refused_with_key_and_remedy(overrides, key, what, remedy):
    with expect_refusal(ConfigError, what, remedy=remedy, key=key):
        load_config(CONFIGS / CONFIG, overrides)


def test_a_bridge_counts_as_one_gauge_of_the_layout():
    bridge = one(UP + "}", DOWN + ", sign: -1}")
    loaded = load_config(CONFIGS / CONFIG, [bridge, "place.keep=1"])
    assert len(loaded.model.gauges.fixed[0].arms) == 2
    with pytest.raises(ConfigError, match="fixed"):
        load_config(CONFIGS / CONFIG, [bridge[:-1] + f", {UP}}}]", "place.keep=1"])
