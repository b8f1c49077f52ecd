"""Faults of channels and of known loads: what they change, and which are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.estimation.conditional import none_considered
from strainsight.estimation.fault_evidence import explain_record
from strainsight.estimation.fault_search import examine_record
from strainsight.estimation.faults import (
    FITTED,
    FORESEEN,
    Explained,
    Fault,
    approximate_density,
    as_factor,
    at_limit,
    check_channels,
    choose_fault,
    dead_density,
    find_delay,
    find_factor,
    find_temporary_faults,
    shifted,
    undo_fault,
)
from strainsight.estimation.grid_filter import filter_records
from strainsight.estimation.load_faults import undo_load_fault
from strainsight.estimation.record import GridRecord, Settled

from ..shared import slowly
from .chain import driven_chain, driven_start
from .test_fault_search import LONG, four_gauges, suspect
from .truth import draw_truth

RNG = np.random.default_rng(1)
SAMPLES = RNG.standard_normal((60, 3))


@pytest.mark.parametrize(
    ("fault", "made"),
    [
        (Fault("sign", 1), lambda y: y * [1, -1, 1]),
        (Fault("scale", 2, 1e-3), lambda y: y * [1, 1, 1e-3]),
        (Fault("swapped", 0, 2), lambda y: y[:, [2, 1, 0]]),
    ],
)
def test_fault_is_undone(fault, made):
    np.testing.assert_allclose(undo_fault(fault, made(SAMPLES))[0], SAMPLES, rtol=1e-12)


def test_a_factor_changes_the_density_by_its_jacobian():
    """Of a density in y, p(y/s)/s for every sample that is there."""
    y = SAMPLES.copy()
    y[:7, 1] = np.nan
    assert undo_fault(Fault("scale", 1, 1e6), y)[1] == pytest.approx(-53 * np.log(1e6))


@pytest.mark.parametrize("n", [3, -3])
def test_delay_is_undone_except_at_end(n):
    late = shifted(SAMPLES[:, 0], -n)
    back = shifted(late, n)
    there = np.isfinite(back)
    assert there.sum() == 57
    np.testing.assert_array_equal(back[there], SAMPLES[there, 0])


def test_only_rows_of_equal_extreme_samples_are_clipped():
    wave = np.sin(0.1 * np.arange(400))
    assert not at_limit(wave).any()
    clipped = np.clip(wave, -0.7, 0.7)
    assert at_limit(clipped).sum() == np.count_nonzero(np.abs(wave) >= 0.7)
    one_side = np.minimum(wave, 0.7)
    np.testing.assert_array_equal(at_limit(one_side), wave >= 0.7)
    assert not at_limit(np.full(50, 2.0)).any()


def test_a_channel_against_its_prediction():
    y = np.column_stack([SAMPLES[:, 0], -2 * SAMPLES[:, 0], np.full(60, 3.0)])
    y[5, 0] = np.nan
    check = check_channels(y, np.column_stack([SAMPLES[:, 0], SAMPLES[:, 0], SAMPLES[:, 0]]), np.full((60, 3), 0.5))
    np.testing.assert_allclose(check.correlation[:2], [1, -1], atol=1e-12)
    assert np.isnan(check.correlation[2])
    rms = np.sqrt(np.mean(SAMPLES[:, 0] ** 2))
    np.testing.assert_allclose(check.residual[:2], [0, 6 * rms], atol=1e-12)
    np.testing.assert_allclose(check.measured[1:], [2 * rms, 3])


def test_a_channel_without_samples_has_no_numbers():
    check = check_channels(np.full((5, 1), np.nan), np.ones((5, 1)), np.ones((5, 1)))
    assert np.isnan([check.measured, check.residual, check.correlation]).all()


def test_best_delay_is_found():
    t = np.arange(500)
    foreseen = np.sin(2 * np.pi * t / 60) + 0.3 * np.sin(2 * np.pi * t / 23)
    found = find_delay(shifted(foreseen, -7), foreseen, np.full(500, 0.01), 0.01)
    assert found == Fault("late", 0, 7)
    turned = find_delay(-foreseen, foreseen, np.full(500, 0.01), 0.01)
    assert turned is not None
    assert approximate_density(turned, -foreseen, foreseen, np.full(500, 0.01), 0.01) < approximate_density(
        Fault("sign", 0), -foreseen, foreseen, np.full(500, 0.01), 0.01
    )


def test_dead_density_of_noise_is_normal():
    from scipy.stats import norm

    y = 4.0 + 0.3 * RNG.standard_normal(200)
    expected = norm.logpdf(y, y.mean(), y.std()).sum() + 200 * np.log(0.25)
    assert dead_density(y, 0.25) == pytest.approx(expected)
    assert np.isfinite(dead_density(np.zeros(10), 0.25))


def hypothesis(kind, evidence, ratio=1.0, channel=0, amount=0.0):
    return Explained(Fault(kind, channel, amount), evidence, ratio)


@pytest.mark.parametrize(
    ("found", "named"),
    [
        ([hypothesis("sign", 0), hypothesis("offset", -500)], "sign"),
        ([hypothesis("sign", 0), hypothesis("offset", -3)], None),
        ([hypothesis("sign", 0, ratio=4.0), hypothesis("offset", -500)], "offset"),
        ([hypothesis("sign", 0, ratio=1.3), hypothesis("offset", -5)], "offset"),
        ([hypothesis("sign", 0, ratio=1.3), hypothesis("offset", -5, ratio=1.25)], None),
        ([hypothesis("sign", 0, ratio=1.6)], None),
        ([hypothesis("sign", -995), hypothesis("offset", -999)], None),
        ([hypothesis("angle", 0, amount=45.0), hypothesis("angle", -1, amount=-45.0)], "angle"),
        ([hypothesis("late", 0, amount=3), hypothesis("late", -2, amount=4)], "late"),
        ([hypothesis("sign", 0), hypothesis("sign", -1, channel=1)], None),
        ([hypothesis("sign", -np.inf)], None),
        ([hypothesis("scale", 0, amount=1.26), hypothesis("scale", -3, amount=1.24)], "scale"),
        # a rotation with smaller innovations excludes neither polarity nor swap
        ([hypothesis("sign", 0, ratio=1.3), hypothesis("angle", -5, amount=90.0)], None),
        ([hypothesis("swapped", -5, ratio=1.3, amount=1), hypothesis("angle", 0, amount=75.0)], None),
        ([hypothesis("sign", -50), hypothesis("angle", 0, amount=90.0)], "angle"),
        ([], None),
    ],
)
def test_unique_fault_is_named(found, named):
    best, candidates = choose_fault(-1000, found)
    assert (best.fault.kind if best else None) == named
    assert best is None or best in candidates


def test_rotations_are_listed_after_other_faults():
    _, candidates = choose_fault(-1000, [hypothesis("angle", 0, amount=90.0), hypothesis("sign", -5, ratio=1.3)])
    assert [one.fault.kind for one in candidates] == ["sign", "angle"]


@pytest.mark.parametrize(
    ("before", "ratio", "named"), [(40.0, 3.5, "stuck"), (40.0, 4.5, None), (4.0, 1.6, None), (np.inf, 1.6, None)]
)
def test_fault_may_leave_one_per_cent_of_excess_innovations(before, ratio, named):
    best, _ = choose_fault(-1000, [hypothesis("stuck", 0, ratio)], before=before)
    assert (best.fault.kind if best else None) == named


@pytest.mark.parametrize(("factor", "noise"), [(1.25, 0.01), (0.7, 0.1), (3.0, 1.0)])
def test_fitted_factor_maximises_density(factor, noise):
    t = np.arange(400)
    foreseen, std = np.sin(2 * np.pi * t / 60), np.full(400, 0.05)
    y = factor * (foreseen + np.hypot(noise, 0.05) * np.random.default_rng(3).standard_normal(400))
    tried = np.exp(np.linspace(-2, 2, 8001))
    residual = y / tried[:, None] - foreseen
    density = -0.5 * np.sum(residual**2, axis=1) / (noise**2 + 0.05**2) - 400 * np.log(tried)
    assert find_factor(y, foreseen, std, noise).amount == pytest.approx(tried[np.argmax(density)], rel=1e-3)


@pytest.mark.parametrize("amount", [1.0, 1.09, 0.92, 2.05, 0.49, 980.0])
def test_no_factor_is_fitted_near_one_and_near_usual_factors(amount):
    assert as_factor(0, amount) is None


def test_fitted_factor_costs_its_freedom_once():
    fitted, usual = (undo_fault(Fault("scale", 1, amount), SAMPLES)[1] for amount in (1.25, 2.0))
    assert fitted == pytest.approx(-60 * np.log(1.25) - FITTED)
    assert usual == pytest.approx(-60 * np.log(2.0))


def test_spikes_stand_out_from_constant_misfit():
    t = np.arange(400)
    foreseen = np.sin(2 * np.pi * t / 50)
    y = 1.1 * foreseen
    y[[70, 71, 300]] += 9.0
    faults = {fault.kind: fault for fault in find_temporary_faults(y, foreseen, np.full(400, 0.004), 0.004)}
    marked = {k for _, first, behind in faults["spikes"].spans for k in range(first, behind)}
    assert marked == {70, 71, 300}


ANY = np.random.default_rng(2)


def held(values):
    """Straight between samples (T + 1, p)."""
    found = np.zeros((len(values) - 1, 3, values.shape[1]))
    found[:, 0], found[:, 1] = values[:-1], np.diff(values, axis=0)
    return found


WIDE = np.cumsum(ANY.standard_normal((LONG + 8, 1)), axis=0)
FORCE = WIDE[4:-3]


@pytest.fixture(scope="module")
def record():
    model, P = four_gauges(driven_chain(parameters=("k1",))), driven_start()[:5, :5]
    P = np.diag([*np.diag(P)[:4], 0.01])
    _, y = draw_truth(model, np.zeros(5), P, held(FORCE), [4])
    return suspect(model, P, held(FORCE), y[:, 0])


WRONG = {
    "sign": (-FORCE, Fault("sign", 0, of_load=True)),
    "kilonewtons": (1e-3 * FORCE, Fault("scale", 0, 1e-3, of_load=True)),
    "pounds": (FORCE / 4.4482216, Fault("scale", 0, 1 / 4.4482216, of_load=True)),
    "late": (WIDE[2:-5], Fault("late", 0, 2, of_load=True)),
    "early": (WIDE[5:-2], Fault("late", 0, -1, of_load=True)),
}


def test_a_sound_record_is_consistent(record):
    assert not examine_record(record).inconsistent


@pytest.mark.parametrize("name", ["sign", "kilonewtons", "pounds", "late", *slowly("early")])
def test_load_fault_is_named(record, name):
    wrong, fault = WRONG[name]
    found = examine_record(replace(record, known=held(wrong)))
    assert found.inconsistent
    named = found.named.fault
    assert (named.kind, named.channel, named.of_load) == (fault.kind, fault.channel, True)
    assert named.amount == pytest.approx(fault.amount)
    assert name == "early" or {own.fault.of_load for own in found.tried} == {True}
    assert found.best_of(0) is None


def test_reversed_channels_are_reversed_load(record):
    found = examine_record(replace(record, samples=-record.samples))
    assert found.named.fault == Fault("sign", 0, of_load=True)


def test_reversed_channel_is_not_load_fault(record):
    found = examine_record(replace(record, samples=record.samples * [1, -1, 1, 1]))
    assert found.named.fault == Fault("sign", 1)


def test_single_channel_and_load_are_ambiguous(record):
    model = record.model.of_channels(np.array([1]))
    found = examine_record(suspect(model, record.covariance, record.known, -record.samples[:, 1:2]))
    assert found.named is None
    assert {own.fault for own in found.candidates} == {Fault("sign", 0), Fault("sign", 0, of_load=True)}


def test_evidence_is_that_of_the_record_with_the_right_load(record):
    right = explain_record(record, None)[0].evidence
    wrong = replace(record, known=held(-FORCE))
    assert explain_record(wrong, Fault("sign", 0, of_load=True))[0].evidence == pytest.approx(right, abs=1e-6)
    late = replace(record, known=held(WIDE[2:-5]))
    cut = record.samples.copy()
    cut[-2:] = np.nan
    missing = FORESEEN * 2 * cut.shape[1]
    expected = explain_record(replace(record, samples=cut), None)[0].evidence + missing
    assert explain_record(late, Fault("late", 0, 2, of_load=True))[0].evidence == pytest.approx(expected, abs=1e-6)


def test_birge_ratio_bounds_number_of_grids(record):
    quiet = replace(record.model, r=1e-2 * record.model.r)
    late = replace(record, model=quiet, known=held(WIDE[:-7]))
    claimed, widened = (filter_records([late], birge_ratio=ratio)[0] for ratio in (1.0, 1.5))
    assert widened.grid_count < claimed.grid_count / 3
    (mean,), ((variance,),) = widened.posterior
    assert variance > 1.5**2 * claimed.posterior[1][0, 0]
    assert abs(mean - claimed.posterior[0][0]) < np.sqrt(variance)


def loaded(model, known, samples, tones):
    return GridRecord(
        model, np.zeros(model.size), np.eye(model.size), known, samples, none_considered(model), settled=tones
    )


def test_swapped_loads_are_exchanged_with_their_tones():
    known = ANY.standard_normal((20, 3, 4))
    tones = Settled(np.array([2.0]), ANY.standard_normal((1, 3, 4)) + 0j, np.zeros(2))
    given = loaded(driven_chain(), known, np.zeros((20, 1)), tones)
    found = undo_load_fault(given, np.array([0, 1, 0, 1]), Fault("swapped", 0, 1, of_load=True))
    np.testing.assert_array_equal(found.known, known[..., [1, 0, 3, 2]])
    np.testing.assert_array_equal(found.settled.hold, tones.hold[..., [1, 0, 3, 2]])


@pytest.mark.parametrize("n", [3, -3])
def test_delay_shifts_steps_and_tones(n):
    w, model = 2.0, driven_chain()
    t = model.h * np.arange(41)
    sine = held(np.cos(w * t)[:, None])
    W = np.zeros((1, 3, 1), dtype=complex)
    W[0, 0], W[0, 1] = 1.0, np.exp(1j * w * model.h) - 1
    given = loaded(model, sine, np.zeros((40, 2)), Settled(np.array([w]), W, np.zeros(2)))
    found = undo_load_fault(given, np.zeros(1, dtype=int), Fault("late", 0, n, of_load=True))
    inside = slice(0, 37) if n > 0 else slice(3, None)
    by_tones = np.real(found.settled.hold[0] * np.exp(1j * w * model.h * np.arange(40))[:, None, None])
    np.testing.assert_allclose(found.known[inside], by_tones[inside], atol=1e-12)
    missing = np.isnan(found.samples).all(axis=1)
    np.testing.assert_array_equal(np.flatnonzero(missing), [37, 38, 39] if n > 0 else [0, 1, 2])
