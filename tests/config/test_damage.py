"""What an S-N curve and a rule of the mean stress demand of each other."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from strainsight.cases.structure.damaged_places import curve_of
from strainsight.config.damage import DamageSettings, MeanStress, SNCurve, damage_problems

LINE = {"slope": 3.0, "stress": 1e8}


def problems(curve=(), mean=()):
    own = DamageSettings(curve=SNCurve(**(LINE | dict(curve))), mean_stress=MeanStress(**dict(mean)))
    return [problem.key for problem in damage_problems(own, "estimate.damage")]


@pytest.mark.parametrize(
    ("curve", "mean"),
    [
        ({}, {}),
        ({"knee": 5e6}, {}),
        ({"knee": 5e6, "second_slope": 5.0, "cut_off": 1e8}, {}),
        ({"cut_off": 1e7}, {"rule": "goodman", "tensile_strength": 5e8}),
        ({}, {"rule": "fkm", "sensitivity": 0.0}),
    ],
)
def test_what_fits_together_is_taken(curve, mean):
    assert problems(curve, mean) == []


@pytest.mark.parametrize(
    ("curve", "mean", "key"),
    [
        ({"second_slope": 5.0}, {}, "curve.second_slope"),
        ({"knee": 5e6, "second_slope": 5.0, "cut_off": 5e6}, {}, "curve.cut_off"),
        ({"knee": 5e6, "cut_off": 1e8}, {}, "curve.cut_off"),
        ({}, {"rule": "goodman"}, "mean_stress"),
        ({}, {"rule": "fkm", "tensile_strength": 5e8, "sensitivity": 0.1}, "mean_stress.tensile_strength"),
        ({}, {"sensitivity": 0.1}, "mean_stress.sensitivity"),
    ],
)
def test_what_does_not_is_named(curve, mean, key):
    assert problems(curve, mean) == [f"estimate.damage.{key}"]


def test_fewer_draws_than_an_interval_needs_are_refused():
    with pytest.raises(ValidationError, match="greater than or equal to 40"):
        DamageSettings(curve=SNCurve(**LINE), draws=39)


def test_an_amplitude_is_half_a_range():
    one, other = (
        curve_of(DamageSettings(curve=SNCurve(slope=5.0, stress=stress, of=of, knee=1e7)))[0]
        for stress, of in ((1e8, "range"), (5e7, "amplitude"))
    )
    assert one == other
