"""Damage of several records: Miner's sum over them, draw by draw, counted by another library."""

from __future__ import annotations

import numpy as np
import pytest
import rainflow

from strainsight.cases.structure.damage import Asked, Places, Recorded, damage_in_test
from strainsight.config.damage import DamageSettings, SNCurve
from strainsight.estimation.bank_paths import Paths
from strainsight.estimation.smoother import Smoothed
from strainsight.fem.affine import AffineOperator

from ..estimation.chain import loaded_chain

SLOPE, STRESS, CYCLES, MODULUS, DRAWS = 4.0, 1e6, 1e5, 2e9, 41
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
        drawn = mean[None, :, 0, :2] + 2e-4 * rng.standard_normal((DRAWS, steps + 1, 2))
        parts = [Paths(np.zeros((DRAWS, 0))[part], drawn[part]) for part in (slice(0, 3), slice(3, None))]
        # parts of another size in the longer record
        parts = parts if steps == 60 else [Paths(np.zeros((DRAWS, 0)), drawn)]
        smoothed = Smoothed(np.arange(steps + 1.0), mean, np.zeros_like(mean), None)
        found.append((smoothed, parts, drawn))
    return found


def found_of(records, withheld=False):
    settings = DamageSettings(curve=SNCurve(slope=SLOPE, stress=STRESS, cycles=CYCLES), draws=DRAWS, repetitions=3.0)
    place = Places(np.zeros((1, 3)), np.array([1]), AffineOperator(ROWS[None, None], {}), AffineOperator(np.array([MODULUS]), {}))
    each = [
        Recorded(loaded_chain(), smoothed, np.arange(2), None if withheld else parts) for smoothed, parts, _ in records
    ]
    return damage_in_test(settings, Asked(None, place), each, lambda share: None)


def test_damage_is_the_sum_over_the_records(records):
    found = found_of(records)
    assert found.virtual.of_mean[0] == pytest.approx(3 * sum(damage_of(own.mean[:, 0, :2]) for own, _, _ in records))
    draws = [sum(damage_of(drawn[i]) for _, _, drawn in records) for i in range(DRAWS)]
    assert found.virtual.damage[0] == pytest.approx(3 * np.median(draws))
    assert found.hours == pytest.approx(3 * (60 + 90) / 3600)


def test_without_sigma_there_is_no_interval(records):
    found = found_of(records, withheld=True)
    assert np.isnan(found.virtual.damage).all()
    assert found.virtual.of_mean[0] == pytest.approx(found_of(records).virtual.of_mean[0])
