"""The adjoint smoother against the textbook recursion and against one large least-squares problem."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.linalg import cho_factor, cho_solve

from strainsight.estimation.draws import covariance_factor, draw_truth
from strainsight.estimation.filter import filter_runs, run_filter
from strainsight.estimation.smoother import smooth


def test_equals_the_least_squares_estimate_of_the_whole_record(make_beam, make_filter):
    """States without process noise make P⁻ singular. Oracle: every xₖ is a linear map of unit normals z (initial error
    and walk), so the posterior of z given all y is one least-squares problem."""
    model = make_filter(make_beam(modes=3), inputs=("tip",))
    n, steps = model.size, 50
    P0 = np.zeros((n, n))
    P0[-1, -1], P0[4, 4] = 0.25, 1e-4
    nothing = np.zeros((steps, 3, 0))
    _, y = draw_truth(model, np.zeros(n), P0, nothing, [3])
    y[7, 0, 2] = np.nan
    run = run_filter(model, np.zeros(n), P0, nothing, y, keep="all")
    smoothed = smooth(model, run)

    A, start, walk = run.jacobian[0, 0], covariance_factor(P0), covariance_factor(model.process)
    maps = [np.hstack([start, np.zeros((n, steps * walk.shape[1]))])]
    for k in range(steps):
        following = A @ maps[-1]
        first = start.shape[1] + k * walk.shape[1]
        following[:, first : first + walk.shape[1]] += walk
        maps.append(following)
    whitened = np.concatenate([model.H @ m for m in maps[1:]]) / np.sqrt(model.r[0] / model.h)
    data = y[:, 0].ravel() / np.sqrt(model.r[0] / model.h)
    there = np.isfinite(data)
    whitened, data = whitened[there], data[there]
    normal = cho_factor(np.eye(whitened.shape[1]) + whitened.T @ whitened)
    z = cho_solve(normal, whitened.T @ data)
    for k, m in enumerate(maps):
        std = np.sqrt(np.sum(m.T * cho_solve(normal, m.T), axis=0))
        unit = np.where(std > 0, std, 1.0)
        np.testing.assert_allclose(smoothed.mean[k, 0] / unit, m @ z / unit, atol=1e-6)
        np.testing.assert_allclose(smoothed.std[k, 0] / unit, std / unit, atol=1e-6)


def test_a_constant_parameter_has_one_value_at_all_times(make_beam, make_filter, sine):
    """Without process noise on E its smoothed value is the last filtered one, everywhere."""
    beam = make_beam(modes=4)
    model = make_filter(beam, parameters=("E",), known=("tip",), q_parameter=0.0)
    u = sine(model.h * np.arange(200), model.h, 1e4, 20.0)
    P0 = np.diag([0.0] * 8 + [1e-4])
    _, y = draw_truth(model, np.zeros(9), P0, u, [0, 1, 2])
    run = run_filter(model, np.zeros(9), P0, u, y, keep="all")
    smoothed = smooth(model, run)
    last, std = run.mean[-1, :, 8], run.std[-1, :, 8]
    np.testing.assert_allclose((smoothed.mean[..., 8] - last) / std, 0.0, atol=1e-5)
    np.testing.assert_allclose(smoothed.std[..., 8] / std, 1.0, rtol=1e-5)


def test_a_run_that_was_not_kept_is_refused(make_beam, make_filter):
    model = make_filter(make_beam(modes=3), inputs=("tip",))
    run = run_filter(model, np.zeros(7), np.eye(7), np.zeros((5, 3, 0)), np.zeros((5, 4)))
    with pytest.raises(ValueError, match="keep='all'"):
        smooth(model, run)


@dataclass(frozen=True)
class Changing:
    """A `StepModel` without memory of its last step: A, H and all noise are others in every one. a, c factor the noise
    before and after the step (T, 3, 1); r (T, 2) variances."""

    A: np.ndarray
    H: np.ndarray
    a: np.ndarray
    c: np.ndarray
    r: np.ndarray
    size: int = 3
    channels: int = 2
    h: float = 0.5
    sets: int = 1
    linear: bool = False  # the filter may keep nothing from one step for the next
    loss: str = "it broke"

    @property
    def position(self):
        return np.array([1])

    def begin(self, x, k):
        pass

    def step(self, x, k):
        return x @ self.A[k].T, self.A[k][None]

    def measure(self, x, k):
        return x @ self.H[k].T, self.H[k][None]

    def process(self, k):
        return self.c[k] @ self.c[k].T

    def before(self, k):
        return self.a[k] @ self.a[k].T

    def noise(self, k):
        return self.r[k]

    def lost(self, x):
        return ~np.isfinite(x).all(axis=1)


@pytest.mark.parametrize(
    "way",
    [
        {},
        {"form": "square_root"},
        {"iterations": 3},
        {"iterations": 2, "through_step": True},
        {"iterations": 2, "through_step": True, "form": "square_root"},
    ],
)
def test_what_changes_from_step_to_step_is_taken_from_its_own_step(way):
    """Oracle: every xₖ is a linear map of unit normals z (start, noise before and after every step). What the filter says
    is the posterior of z given y up to k, what the smoother says that given all. Two runs, each with its own gaps."""
    rng, steps, n = np.random.default_rng(11), 12, 3
    A = 0.9 * np.linalg.qr(rng.normal(size=(steps, n, n)))[0]
    model = Changing(
        A,
        rng.normal(size=(steps, 2, n)),
        0.3 * rng.normal(size=(steps, n, 1)),
        0.2 * rng.normal(size=(steps, n, 1)),
        0.01 + rng.random((steps, 2)),
    )
    mean, P0 = rng.normal(size=n), np.diag([1.0, 0.25, 0.0])
    y = rng.normal(size=(steps, 2, 2))
    y[3, 0, 1] = y[5, 1, 0] = y[8, 0] = np.nan

    maps, drift = [np.hstack([np.sqrt(P0), np.zeros((n, 2 * steps))])], [mean]
    for k in range(steps):
        shaken = maps[-1].copy()
        shaken[:, n + 2 * k] += model.a[k, :, 0]
        maps.append(A[k] @ shaken)
        maps[-1][:, n + 2 * k + 1] += model.c[k, :, 0]
        drift.append(A[k] @ drift[-1])

    def posterior(of, until, run):
        """Mean and covariance of x at `of` given the readings of the first `until` steps."""
        seen = [(k, i) for k in range(until) for i in range(2) if np.isfinite(y[k, run, i])]
        rows = np.array([model.H[k, i] @ maps[k + 1] / np.sqrt(model.r[k, i]) for k, i in seen]).reshape(
            -1, n + 2 * steps
        )
        data = np.array([(y[k, run, i] - model.H[k, i] @ drift[k + 1]) / np.sqrt(model.r[k, i]) for k, i in seen])
        normal = np.eye(n + 2 * steps) + rows.T @ rows
        z = np.linalg.solve(normal, rows.T @ data)
        return drift[of] + maps[of] @ z, maps[of] @ np.linalg.solve(normal, maps[of].T)

    found = filter_runs(model, mean, P0, y, keep="all", **way)
    later = smooth(model, found, covariance=True)
    for run in range(2):
        for k in range(steps + 1):
            for given, until in ((found, k), (later, steps)):
                x, P = posterior(k, until, run)
                np.testing.assert_allclose(given.mean[k, run], x, atol=1e-9)
                np.testing.assert_allclose(given.covariance[k, run], P, atol=1e-9)
                np.testing.assert_allclose(given.std[k, run] ** 2, np.diag(P), atol=1e-9)
