"""Records that are longer than the stretch in which faults are looked for: where it lies, how it begins, what is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.estimation import fault_evidence, record_check
from strainsight.estimation.conditional import known_ends, none_considered
from strainsight.estimation.fault_evidence import (
    extract_moving_part,
    extract_part,
    is_at_rest,
    scale_intensity,
    select_stretches,
)
from strainsight.estimation.faults import find_misfits
from strainsight.estimation.load_faults import residual_pattern
from strainsight.estimation.record import Settled
from strainsight.estimation.record_check import SPIKE, check_record, find_spikes

from ..shared import slowly
from .chain import NOISE, H, forces, loaded_chain, start
from .test_fault_search import broken, four_gauges, suspect
from .truth import draw_truth

REST, MOVING, SHORT = 500, 150, 400


@pytest.fixture(scope="module")
def record():
    """Four gauges on two masses that rest, and then move under a known and an unknown force."""
    model, P = four_gauges(loaded_chain()), start()[:5, :5]
    y = draw_truth(model, np.zeros(5), P, forces(MOVING), [3])[1][:, 0]
    rest = NOISE * np.random.default_rng(1).standard_normal((REST, 4))
    known = np.concatenate([0 * forces(REST), forces(MOVING)])
    own = suspect(model, P, known, np.concatenate([rest, y]))
    return replace(own, moving=np.diag([0.01, 0.01, 1.0, 1.0, 0.5]))


@pytest.fixture(autouse=True)
def short_stretches(monkeypatch):
    monkeypatch.setattr(fault_evidence, "LONGEST", SHORT)
    monkeypatch.setattr(record_check, "LONGEST", SHORT)


def changed(record, change):
    samples = record.samples.copy()
    change(samples)
    return replace(record, samples=samples)


def named(record):
    found = check_record(record).finding
    assert found.inconsistent
    return found.named


def test_stretch_is_at_largest_readings(record):
    ((first, behind),) = select_stretches(record)
    assert behind - first == SHORT
    assert first <= REST
    assert behind == REST + MOVING
    part = extract_moving_part(extract_part(record, first, behind))
    assert part.begin == pytest.approx(REST - MOVING / 4, abs=20)
    assert part.begin + part.span[0] == pytest.approx(REST, abs=20)
    assert len(part.samples) == pytest.approx(1.25 * MOVING, abs=20)
    spike = changed(record, lambda y: y.__setitem__((100, 0), 1e3))
    assert select_stretches(spike) == ((first, behind),)


def test_each_active_period_has_a_stretch(record):
    def change(y):
        y[:] = 0.1 * y
        y[50:60, :2] += 0.1
        y[600:610, 2:] += 0.05

    two = select_stretches(changed(record, change))
    assert len(two) == 2
    assert any(first <= 50 and behind >= 60 for first, behind in two)
    assert any(first <= 600 and behind >= 610 for first, behind in two)


def test_drift_continues_in_stretch(record):
    none = none_considered(record.model)
    E = np.zeros((1, 4, 2))
    E[0, 1, -1] = 0.3
    drifting = replace(none, source=("drift",), D=np.zeros((1, 4, 5)), E=E, offset=np.zeros((1, 4)))
    part = extract_part(replace(record, considered=drifting), 100, 180)
    share = known_ends(part.known, part.considered)[:, -1]
    read = part.considered.offset[0, 1] + part.considered.E[0, 1, -1] * share
    np.testing.assert_allclose(read, 0.3 * np.arange(101, 181) / (REST + MOVING), rtol=1e-12)


def test_periodic_motion_continues_in_stretch(record):
    frequency = np.array([3.0, 7.0])
    held = np.array([1 + 2j, 0.5j])[:, None, None] * np.ones((2, 3, 1))
    part = extract_part(replace(record, settled=Settled(frequency, held, np.ones(4))), 100, 180)
    expected = np.exp(1j * frequency * 100 * H)[:, None, None] * held
    np.testing.assert_allclose(part.settled.hold, expected, rtol=1e-12)


def test_sound_record_after_rest_is_consistent(record):
    assert not check_record(record).finding.inconsistent


def scalable(record, std):
    model = record.model
    D, E = std * model.H[None], np.zeros((1, 4, record.known.shape[-1]))
    considered = replace(none_considered(model), source=("gain",), D=D, E=E, offset=np.zeros((1, 4)))
    return replace(record, considered=considered)


def test_sudden_load_does_not_trigger_fault_search(record):
    model = replace(record.model, r=0.01 * record.model.r)
    y = draw_truth(model, np.zeros(5), start()[:5, :5], forces(MOVING), [3])[1][:, 0]
    samples = np.concatenate([0.1 * record.samples[:REST], y])
    check = check_record(scalable(replace(record, model=model, samples=samples), 0.2))
    assert abs(check.worst[0] - REST) < 20
    assert check.worst[2] > SPIKE
    assert not check.finding.inconsistent


def test_load_intensity_at_rest_is_most_likely(record):
    rest, moving = extract_part(record, 100, 500), extract_part(record, REST, REST + MOVING)
    assert is_at_rest(rest)
    assert not is_at_rest(moving)
    assert record_check._intensity_at_rest(rest) == 0
    assert record_check._intensity_at_rest(moving) == 1
    shifted = rest.samples.copy()
    shifted[:, 2] += 30 * NOISE * (np.arange(400) >= 200)
    assert record_check._intensity_at_rest(replace(rest, samples=shifted)) == 0


@pytest.mark.parametrize("kind", ["swapped", "drift", *slowly("sign", 2.0, "offset")])
def test_fault_after_rest_is_identified(record, kind):
    """A drift is told from an offset by the rest before the motion; both are far larger than the motion."""
    samples, fault = broken(kind, record.samples)
    if kind in ("offset", "drift"):
        samples = record.samples + 10 * (samples - record.samples)
    found = named(replace(record, samples=samples))
    assert found.fault == fault
    if kind in ("offset", "drift"):
        expected = (samples - record.samples)[-1, fault.channel]
        assert abs(found.amount - expected) < 4 * found.std + 0.02 * expected


def test_spikes_are_identified(record):
    def change(y):
        y[40, 1] += 50 * NOISE
        y[300, 3] -= 500 * NOISE
        y[REST + 60, 0] += 200 * NOISE

    finding = check_record(changed(record, change)).finding
    fault = finding.named.fault
    assert fault.kind == "spikes"
    assert finding.check.by_others
    assert fault.spans == ((0, REST + 60, REST + 61), (1, 40, 41), (3, 300, 301))


def test_fault_at_rest_is_detected(record):
    check = check_record(changed(record, lambda y: y.__setitem__((slice(100, 200), 2), y[100:200, 2] + 15 * NOISE)))
    assert check.finding.inconsistent
    fault = check.finding.named.fault
    ((channel, first, behind),) = fault.spans
    assert (fault.kind, channel) == ("shift", 2)
    assert abs(first + check.stretch.begin - 100) <= 2
    assert abs(behind + check.stretch.begin - 200) <= 2


def test_innovations_are_checked_to_end_of_record(record):
    noise = 10 * NOISE * np.random.default_rng(2).standard_normal((100, 4))
    check = check_record(changed(record, lambda y: y.__setitem__(slice(50, 150), y[50:150] + noise)))
    assert check.finding.inconsistent
    assert check.finding.named is None
    assert 50 <= check.worst[0] <= 150


def test_misfit_ends_where_record_fits():
    z = np.random.default_rng(3).standard_normal(400)
    z[100] = 1e3
    z[200:260] += 8
    parts = find_misfits(z)
    assert parts[0] == (100, 101)
    assert parts[1] == (pytest.approx(200, abs=1), pytest.approx(260, abs=1))
    assert len(parts) == 2


def test_a_wrong_channel_is_not_explained_by_spikes(record):
    part = extract_part(changed(record, lambda y: y.__setitem__((slice(None), 2), -y[:, 2])), REST - 90, REST + MOVING)
    assert find_spikes(part) is None


SAMPLES = 200
SLOW = np.sin(2 * np.pi * np.arange(SAMPLES) / 100)


@pytest.fixture(scope="module")
def sound():
    model, P = four_gauges(loaded_chain()), start()[:5, :5]
    y = draw_truth(model, np.zeros(5), P, forces(SAMPLES), [3])[1][:, 0]
    return suspect(model, P, forces(SAMPLES), y)


@pytest.mark.parametrize("strain", [(1, 1, -1, 1), (1, 0.5, 1, -1)])
def test_unmodelled_load_is_identified(sound, strain):
    finding = check_record(replace(sound, samples=sound.samples + 2 * NOISE * np.outer(SLOW, strain))).finding
    assert finding.inconsistent
    assert finding.pattern is not None
    assert not finding.candidates
    assert finding.pattern.share.sum() == pytest.approx(1)
    assert np.count_nonzero(finding.pattern.share > 0.05) > 1


def test_fast_load_is_not_unmodelled_load(sound):
    finding = check_record(scale_intensity(sound, 0.01)).finding
    assert finding.inconsistent
    assert finding.pattern is None
    assert not finding.candidates


@pytest.mark.parametrize("change", [lambda y: 1.5 * y, lambda y: y + 10 * NOISE])
def test_channel_fault_is_not_unmodelled_load(sound, change):
    samples = sound.samples.copy()
    samples[:, 1] = change(samples[:, 1])
    finding = check_record(replace(sound, samples=samples)).finding
    assert finding.pattern is None
    assert finding.named.fault.channel == 1


def test_residual_pattern_recovers_dyad():
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


def test_two_patterns_are_not_one_load():
    slow = np.stack([np.sin(0.1 * np.arange(2000)), np.cos(0.07 * np.arange(2000))], axis=1)
    white = np.random.default_rng(0).standard_normal((2000, 4))
    white[:, :2] += 4 * slow
    assert residual_pattern(white, white, np.ones(4), 1.5) is None
