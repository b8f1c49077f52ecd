"""Filter and smoother against filterpy, an independent library, on linear models with every kind of sensor."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.augmentation.input_models import IntegratedRandomWalk, Matern
from strainsight.estimation.draws import draw_truth
from strainsight.estimation.filter import run_filter
from strainsight.estimation.reduced import Driven
from strainsight.estimation.smoother import smooth

kalman = pytest.importorskip("filterpy.kalman")


@pytest.mark.parametrize("form", ["joseph", "square_root"])
@pytest.mark.parametrize("models", [{}, {"tip": IntegratedRandomWalk(20.0)}, {"tip": Matern(10.0, 2.5)}])
def test_filter_and_smoother_agree(make_beam, make_filter, sine, models, form):
    """In coordinates where the steady deviations are 1, so that filterpy's inverses lose no digits; to 1e-10."""
    beam = make_beam(modes=4, ratio=0.05, load_nodes=(16, 8))
    model = make_filter(
        beam, ("tip",), known=("middle",), models=models, accelerometers=1, q_velocity=1.0, strain_noise=1e-5, h=1e-3
    )
    n, steps = model.size, 200
    P0 = np.diag(np.concatenate([np.full(4, 1e-10), np.full(4, 1e-4), np.ones(n - 8)]))
    u = sine(model.h * np.arange(steps), model.h, 1e4, 13.0)
    _, y = draw_truth(model, np.zeros(n), P0, u, [0, 1])
    run = run_filter(model, np.zeros(n), P0, u, y, keep="all", form=form)
    smoothed = smooth(model, run, covariance=True)
    scale = run.std[-1, 0]
    driven, rest = Driven(model, u), np.zeros((1, n))
    A = driven.step(rest, 0)[1][0] * scale / scale[:, None]
    H = driven.measure(rest, 0)[1][0] * scale / np.sqrt(model.noise)[:, None]
    Q = model.process / np.outer(scale, scale)
    for b in range(2):
        other = kalman.KalmanFilter(n, 5)
        other.F, other.H, other.Q, other.R, other.P = A, H, Q, np.eye(5), P0 / np.outer(scale, scale)
        means, covariances, likelihood = [], [], 0.0
        for k in range(steps):
            other.predict()
            other.x = other.x + (driven.step(rest, k)[0][0] / scale)[:, None]
            other.update((y[k, b] - driven.measure(rest, k)[0][0]) / np.sqrt(model.noise))
            likelihood += other.log_likelihood - 0.5 * np.sum(np.log(model.noise))
            means.append(other.x.copy())
            covariances.append(other.P.copy())
        found = run.mean[1:, b] / scale
        np.testing.assert_allclose(found, np.array(means)[..., 0], atol=1e-10 * np.abs(found).max())
        np.testing.assert_allclose(run.covariance[1:, 0] / np.outer(scale, scale), covariances, atol=1e-10)
        assert run.log_likelihood[b] == pytest.approx(likelihood, rel=1e-10)
        # filterpy's smoother knows no inputs: smooth the part that the known load does not cause
        forced = np.zeros((steps + 1, n))
        for k in range(steps):
            forced[k + 1] = forced[k] @ (A * scale[:, None] / scale).T + driven.step(rest, k)[0][0]
        own = np.array(means)[..., 0] - forced[1:] / scale
        later, wider, _, _ = other.rts_smoother(own[..., None], np.array(covariances))
        np.testing.assert_allclose(
            (smoothed.mean[1:, b] - forced[1:]) / scale, later[..., 0], atol=1e-10 * np.abs(later).max()
        )
        np.testing.assert_allclose(smoothed.covariance[1:, 0] / np.outer(scale, scale), wider, atol=1e-10)
