"""A load that the model does not have is told from faults of channels and from a process noise that is too small."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.estimation.draws import draw_truth
from strainsight.estimation.record_check import check_record
from strainsight.estimation.stretches import with_intensity
from strainsight.estimation.unmodelled_load import residual_pattern

from .chain import NOISE, forces, loaded_chain, start
from .test_fault_search import FOUR, suspect

SAMPLES = 200
SLOW = np.sin(2 * np.pi * np.arange(SAMPLES) / 100)


@pytest.fixture(scope="module")
def sound():
    """Four gauges on two masses under a known and an unknown force."""
    model, P = loaded_chain(), start()[:5, :5]
    model = replace(model, H=np.hstack([FOUR, np.zeros((4, 3))]), r=np.repeat(model.r[:1], 4))
    y = draw_truth(model, np.zeros(5), P, forces(SAMPLES), [3])[1][:, 0]
    return suspect(model, P, forces(SAMPLES), y)


@pytest.mark.parametrize("strain", [(1, 1, -1, 1), (1, 0.5, 1, -1)])
def test_additional_load_is_named_and_no_channel_accused(sound, strain):
    finding = check_record(replace(sound, samples=sound.samples + 2 * NOISE * np.outer(SLOW, strain))).finding
    assert finding.contradicts
    assert finding.pattern is not None
    assert not finding.diagnosis.candidates
    assert finding.pattern.share.sum() == pytest.approx(1)
    assert np.count_nonzero(finding.pattern.share > 0.05) > 1


def test_load_faster_than_its_process_noise_is_no_additional_load(sound):
    finding = check_record(with_intensity(sound, 0.01)).finding
    assert finding.contradicts
    assert finding.pattern is None


@pytest.mark.parametrize("change", [lambda y: 1.5 * y, lambda y: y + 10 * NOISE])
def test_fault_of_one_channel_is_no_additional_load(sound, change):
    samples = sound.samples.copy()
    samples[:, 1] = change(samples[:, 1])
    finding = check_record(replace(sound, samples=samples)).finding
    assert finding.pattern is None
    assert finding.diagnosis.named.fault.channel == 1


def test_pattern_is_that_of_the_dyad_in_white_innovations():
    """Of ν = L(ν̃ + s a v): size² is 1 + s², shares are the squares of L v."""
    rng = np.random.default_rng(0)
    direction, factor = np.array([0.6, 0.0, -0.8]), np.diag([1.0, 2.0, 0.5])
    slow = np.sqrt(2) * np.sin(0.1 * np.arange(20_000))
    white = rng.standard_normal((20_000, 3)) + 1.5 * np.outer(slow, direction)
    pattern = residual_pattern(white, white @ factor.T, np.ones(3), 1.5)
    assert pattern.size == pytest.approx(np.sqrt(1 + 1.5**2), rel=0.01)
    expected = (factor @ direction) ** 2
    np.testing.assert_allclose(pattern.share, expected / expected.sum(), atol=0.01)


def test_white_innovations_have_no_pattern():
    for seed in range(50):
        white = np.random.default_rng(seed).standard_normal((300, 5))
        assert residual_pattern(white, white, np.ones(5), 1.0) is None


def test_two_patterns_are_no_single_load():
    slow = np.stack([np.sin(0.1 * np.arange(2000)), np.cos(0.07 * np.arange(2000))], axis=1)
    white = np.random.default_rng(0).standard_normal((2000, 4))
    white[:, :2] += 4 * slow
    assert residual_pattern(white, white, np.ones(4), 1.5) is None
