"""Readings and noise below what an amplifier tells: named with number and remedy, and nothing else is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.experiment.structure.candidates import listed_gauges
from strainsight.experiment.structure.expectation import (
    loud_noise,
    quiet_noise,
    unresolved_candidates,
    unresolved_gauges,
)

from ..edges.beam import bricks, prepared


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A beam of 16 bricks with two directions a place, in training and screened."""
    own = prepared(tmp_path_factory.mktemp("beam"), bricks((4, 2, 2)))
    return own.training, own.screened


def scaled(training, largest):
    """The same run under so small a load that the largest reading of all is this: readings are linear in it."""
    factor = largest / training.peak.max()
    return replace(training, rms_as_stated=factor * training.rms, peak_as_stated=factor * training.peak)


def noisy(screened, noise):
    return replace(screened, noise_std=np.full(len(screened.noise_std), noise))


def test_a_run_in_which_nothing_can_be_read_is_named(run):
    assert unresolved_candidates(scaled(run[0], 1.01e-7)) == ""
    said = unresolved_candidates(scaled(run[0], 0.99e-7))
    assert "0.099 µm/m" in said
    assert "the amplifier resolution of 0.1 µm/m. Increase the loads" in said


def test_noise_that_no_channel_has_is_named_with_its_key(run):
    training, screened = run
    assert quiet_noise(training, noisy(screened, 5.1e-8)) == ""
    said = quiet_noise(training, noisy(screened, 4.9e-8))
    assert "0.049 µm/m per sample" in said
    assert "Set gauges.noise_std.value" in said


def test_noise_above_every_reading_is_named_with_both(run):
    training, screened = run
    largest = float(training.peak.max())
    assert loud_noise(training, noisy(screened, 0.99 * largest)) == ""
    noise = 1.01 * largest
    assert f"noise {noise:.3g} strain, largest reading {largest:.3g}" in loud_noise(training, noisy(screened, noise))
    moving = replace(training, candidates=replace(training.candidates, quantity=np.ones_like(training.candidates.quantity)))
    assert "m/s^2" in loud_noise(moving, noisy(screened, 1.0))


def test_gauges_of_a_layout_that_read_too_little_are_named_and_the_others_not(run):
    """Of the strongest and the weakest gauge, at a load under which the first reads 1 µm/m and then under a hundredth of it."""
    training, screened = run
    size = np.abs(training.reading()).max(axis=0)
    pair = np.array([int(np.argmax(size)), int(np.argmin(size))])
    assert size.min() < 0.05 * size.max()
    said = list(unresolved_gauges(listed_gauges(pair, scaled(training, 1e-6), screened)))
    assert len(said) == 1
    assert f"G2 ({1e6 * size.min() / size.max() * 1e-6:.2g} µm/m)" in said[0]
    assert "G1" not in said[0]
    assert "move these gauges" in said[0]
    both = list(unresolved_gauges(listed_gauges(pair, scaled(training, 1e-8), screened)))
    assert "G1 (0.01 µm/m), G2 (" in both[0]
    assert "move these gauges" not in both[0]
    assert list(unresolved_gauges(listed_gauges(pair[:1], scaled(training, 1.01e-7), screened))) == []


def test_of_a_rosette_the_largest_channel_counts_and_motion_sensors_do_not(run):
    training, screened = run
    quiet, pool = scaled(training, 1e-9), training.candidates
    moving = replace(quiet, candidates=replace(pool, quantity=np.ones_like(pool.quantity)))
    assert unresolved_candidates(moving) == quiet_noise(moving, screened) == ""
    assert list(unresolved_gauges(listed_gauges(np.array([0]), moving, screened))) == []
    pairs, peak = replace(pool, gauge=pool.gauge // 2), np.full(len(pool), 1e-6)
    for second, named in ((2e-7, False), (5e-8, True)):
        peak[:2] = 5e-8, second
        one = replace(quiet, candidates=pairs, peak_as_stated=peak, name=training.name[: pairs.gauges])
        assert bool(list(unresolved_gauges(listed_gauges(np.array([0]), one, screened)))) == named
