"""Samples that are missing, that come every few steps only, and whose noise changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.estimation.draws import draw_truth
from strainsight.estimation.filter import predict, run_filter
from strainsight.estimation.smoother import smooth

from .drawn import drawn, prior


def test_a_missing_gauge_is_one_of_endless_noise(make_beam, make_filter, sine):
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(modes=4), sine, ("tip",), (), runs=2)
    broken = y.copy()
    broken[:, 1, 2] = np.nan
    broken[20:30, 0] = np.nan
    run = run_filter(model, mean, P0, u, broken)
    rest = replace(model, H=model.H[[0, 1, 3]], r=model.r[[0, 1, 3]])
    without = run_filter(rest, mean, P0, u, y[:, 1][:, [0, 1, 3]])
    np.testing.assert_allclose(run.mean[:, 1], without.mean[:, 0], rtol=1e-8, atol=1e-10 * np.abs(without.mean).max())
    np.testing.assert_allclose(run.nis[:, 1], without.nis[:, 0], rtol=1e-8)
    assert np.all(np.isnan(run.innovation[:, 1, 2]))
    assert np.all(run.nis[20:30, 0] == 0)
    assert np.all(np.diff(run.std[20:31, 0, 8]) > 0)


def test_samples_missing_in_all_runs_leave_one_covariance(make_beam, make_filter, sine):
    """And a step without any sample is a prediction, nothing else."""
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(modes=4), sine, ("tip",), (), runs=3)
    y[10:15], y[30, :, 2] = np.nan, np.nan
    run = run_filter(model, mean, P0, u, y, keep="all")
    assert run.covariance.shape[1] == 1
    apart = run_filter(replace(model, H=np.stack([model.H] * 3)), mean, P0, u, y, keep="all")
    np.testing.assert_allclose(run.mean, apart.mean, rtol=1e-8, atol=1e-9 * np.abs(apart.mean).max())
    np.testing.assert_allclose(run.log_likelihood, apart.log_likelihood, rtol=1e-9)
    assert np.isnan(run.whitened[10:15]).all()
    A = run.jacobian[0, 0]
    np.testing.assert_allclose(run.mean[12], run.mean[11] @ A.T, rtol=1e-12)
    np.testing.assert_array_equal(run.covariance[12, 0], predict(run.covariance[11], A, model.process)[0])
    together, single = smooth(model, run), smooth(model, apart)
    np.testing.assert_allclose(together.mean, single.mean, rtol=1e-7, atol=1e-8 * np.abs(single.mean).max())


@pytest.mark.parametrize("parameters", [(), ("E",)])
def test_sampling_every_fourth_step_is_missing_the_others(make_beam, make_filter, sine, parameters):
    """The same intensity r then means a fourth of the variance a sample."""
    inputs, known = ((), ("tip",)) if parameters else (("tip",), ())
    model = make_filter(make_beam(modes=4), inputs, parameters, known, every=4)
    u = sine(model.h * np.arange(80), model.h, 1e4, 20.0)[:, :, : len(known)]
    truth, y = draw_truth(model, np.zeros(9), prior(model), u, [0, 1])
    assert y.shape == (20, 2, 4)
    assert np.std((y - truth[4::4] @ model.H.T) / np.sqrt(model.r / (4 * model.h))) == pytest.approx(1, abs=0.15)
    run = run_filter(model, np.zeros(9), prior(model), u, y, keep="all")
    sparse = np.full((80, 2, 4), np.nan)
    sparse[3::4] = y
    full = run_filter(replace(model, every=1, r=model.r / 4), np.zeros(9), prior(model), u, sparse, keep="all")
    np.testing.assert_array_equal(run.mean, full.mean)
    np.testing.assert_array_equal(smooth(model, run).mean, smooth(replace(model, every=1, r=model.r / 4), full).mean)


def test_noise_by_a_schedule(make_beam, make_filter, sine):
    """Twice the noise from step 30 on, told step by step, is two filters one after the other."""
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(modes=4), sine, ("tip",), (), runs=2)
    schedule = np.where(np.arange(60)[:, None, None] < 30, 1.0, 2.0) * model.r
    run = run_filter(replace(model, r=schedule), mean, P0, u, y)
    first = run_filter(model, mean, P0, u[:30], y[:30])
    second = run_filter(replace(model, r=2 * model.r), first.mean[-1], first.last, u[30:], y[30:])
    np.testing.assert_allclose(run.mean[-1], second.mean[-1], rtol=1e-9, atol=1e-12 * np.abs(run.mean).max())
    np.testing.assert_allclose(run.std[-1], second.std[-1], rtol=1e-9)
    np.testing.assert_allclose(run.log_likelihood, first.log_likelihood + second.log_likelihood, rtol=1e-9)
