"""The iterated update is the most probable state, keeps to constraints, and survives a step that fails."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import least_squares

from strainsight.estimation.filter import filter_runs, refine, run_filter
from strainsight.estimation.smoother import smooth

from .conftest import StepToy, make_beam, make_filter, sine
from .truth import draw_truth


@dataclass(frozen=True)
class Toy(StepToy):
    """A `StepModel` of f and g of a subclass, by differences."""

    Q: np.ndarray
    R: np.ndarray
    start: np.ndarray | None = None
    h: float = 0.1
    position = np.array([0])

    @property
    def size(self):
        return len(self.Q)

    @property
    def channels(self):
        return len(self.R)

    def differentiated(self, function, x):
        """function and its Jacobian by differences, for every run."""
        d = 1e-6 * np.maximum(np.abs(x), 1e-2)
        shift = d[:, None] * np.eye(self.size)
        J = np.stack([(function(x + shift[:, i]) - function(x - shift[:, i])) for i in range(self.size)], axis=-1)
        return function(x), J / (2 * d[:, None])

    def step(self, x, k):
        return self.differentiated(self.f, x)

    def measure(self, x, k):
        return self.differentiated(self.g, x)

    def process(self, k):
        return self.Q

    def before(self, k):
        return self.start

    def noise(self, k):
        return self.R


class Bent(Toy):
    def f(self, x):
        return np.stack([x[:, 0] + 0.1 * x[:, 1], x[:, 1] - 0.4 * np.sin(2 * x[:, 0]), 0.9 * x[:, 2] ** 2], axis=-1)

    def g(self, x):
        return np.stack([np.exp(0.5 * x[:, 0]) + x[:, 2], x[:, 1] * x[:, 0]], axis=-1)


class Pendulum(Toy):
    """A point mass on a rod: x = [position, velocity, w, torque], implicit Euler along the circle; w is drawn by `before`."""

    def f(self, x):
        angle = np.arctan2(x[:, 0], -x[:, 1])
        rate = x[:, 2] * np.cos(angle) + x[:, 3] * np.sin(angle)
        ahead = angle + self.h * rate
        for _ in range(30):
            residual = ahead - angle - self.h * rate - self.h**2 * (x[:, 4] + x[:, 5] - 9.81 * np.sin(ahead))
            ahead = ahead - residual / (1 + self.h**2 * 9.81 * np.cos(ahead))
        turned = (ahead - angle) / self.h
        along = np.stack([np.cos(ahead), np.sin(ahead)], axis=-1)
        outside = np.stack([np.sin(ahead), -np.cos(ahead)], axis=-1)
        return np.concatenate([outside, turned[:, None] * along, 0 * x[:, 4:5], x[:, 5:]], axis=-1)

    def g(self, x):
        return x[:, :1] * 1.0


def most_probable(model, x, prior, process, y):
    """(ξ, w) by a general least-squares solver, in whitened unknowns."""
    P, Q = np.linalg.cholesky(prior), np.linalg.cholesky(process)

    def residual(z):
        after = model.f((x + P @ z[:3])[None]) + Q @ z[3:]
        return np.concatenate([z, ((y - model.g(after)) / np.sqrt(model.R))[0]])

    found = least_squares(residual, np.zeros(6), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return (model.f((x + P @ found.x[:3])[None]) + Q @ found.x[3:])[0]


@pytest.mark.parametrize("seed", range(2))
def test_iteration_converges_to_most_probable_state(seed):
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(2, 3, 3))
    prior, process = 0.05 * X[0] @ X[0].T, 0.01 * X[1] @ X[1].T
    model = Bent(process, np.array([1e-3, 2e-2]))
    x = rng.normal(size=(2, 3)) * 0.5
    y = model.g(model.f(x)) + 0.1 * rng.normal(size=(2, 2))
    R = np.broadcast_to(model.R, (2, 2))
    found = refine(model, 0, x, np.stack([prior, prior]), process, R, y, 200)
    for b in range(2):
        expected = most_probable(model, x[b], prior, process, y[b])
        np.testing.assert_allclose(found.x[b], expected, atol=1e-5 * np.sqrt(np.trace(prior)))
    assert np.all(found.iterations > 1)


def test_iterated_update_matches_textbook():
    """The iterated Kalman filter (Bell and Cathey), a channel missing once; one update is not enough here."""
    model = Bent(1e-3 * np.eye(3), np.array([1e-3, 2e-3]))
    rng = np.random.default_rng(3)
    start, P0 = np.array([0.4, -0.2, 0.5]), 0.05 * np.eye(3)
    truth, y = start[None] + 0.2, np.empty((6, 2))
    for k in range(len(y)):
        truth = model.f(truth) + np.sqrt(1e-3) * rng.normal(size=(1, 3))
        y[k] = model.g(truth)[0] + np.sqrt(model.R) * rng.normal(size=2)
    y[2, 1] = np.nan
    run = filter_runs(model, start, P0, y, iterations=100)
    once = filter_runs(model, start, P0, y)
    x, P, R = start, P0, np.diag(model.R)
    for k in range(len(y)):
        ahead, A = (part[0] for part in model.step(x[None], k))
        prior = A @ P @ A.T + model.Q
        point, there = ahead, np.isfinite(y[k])
        for _ in range(500):
            read, H = (part[0][there] for part in model.measure(point[None], k))
            K = prior @ H.T @ np.linalg.inv(H @ prior @ H.T + R[np.ix_(there, there)])
            point = ahead + K @ (y[k, there] - read - H @ (ahead - point))
        x, P = point, prior - K @ H @ prior
        np.testing.assert_allclose(run.mean[k + 1, 0], x, atol=1e-5)
        np.testing.assert_allclose(run.std[k + 1, 0], np.sqrt(np.diag(P)), rtol=1e-4)
    assert np.abs(once.mean[-1] - run.mean[-1]).max() > 1e-3


def test_where_the_start_is_known_the_disturbance_is_iterated():
    direction = np.array([0.5, -0.3, 0.4])
    model = Bent(np.outer(direction, direction), np.array([1e-4, 1e-2]))
    x = np.array([[0.4, -0.2, 0.5]])
    y = model.g(model.f(x) + 0.8 * direction) + 0.01
    found = refine(model, 0, x, np.zeros((1, 3, 3)), model.Q, model.R[None], y, 100)

    def residual(z):
        return np.concatenate([z, ((y - model.g(model.f(x) + z[0] * direction)) / np.sqrt(model.R))[0]])

    best = least_squares(residual, [0.0], xtol=1e-15, ftol=1e-15, gtol=1e-15)
    np.testing.assert_allclose(found.x, model.f(x) + best.x * direction, atol=1e-6)
    assert found.iterations[0] > 1


def test_corrected_state_satisfies_constraint():
    start = np.diag([0, 0, 0, 0, 1e-2, 0.05])
    model = Pendulum(np.zeros((6, 6)), np.array([1e-4]), start, h=0.05)
    steps, rng = 50, np.random.default_rng(1)
    truth = np.zeros((steps + 1, 6))
    truth[0] = [np.sin(0.5), -np.cos(0.5), 0, 0, 0, 0]
    for k in range(steps):
        truth[k, 5] = 3 * np.sin(0.1 * k)
        truth[k + 1] = model.f(truth[k][None])[0]
    y = truth[1:, :1] + 1e-2 * rng.normal(size=(steps, 1))
    # uncertain along the circle alone: the covariance of redundant coordinates is singular
    tangent = np.array([np.cos(0.8), np.sin(0.8), 0, 0, 0, 0])
    across = np.array([0, 0, np.cos(0.8), np.sin(0.8), 0, 0])
    P0 = 0.1 * np.outer(tangent, tangent) + 0.1 * np.outer(across, across) + np.diag([0, 0, 0, 0, 0, 1.0])
    mean = np.array([np.sin(0.8), -np.cos(0.8), 0, 0, 0, 0])
    away = {}
    for inside in (True, False):
        run = filter_runs(model, mean, P0, y, keep="all", iterations=5 if inside else 1, through_step=inside)
        x = run.mean[1:, 0]
        away[inside] = max(
            np.abs(np.hypot(x[:, 0], x[:, 1]) - 1).max(), np.abs(np.sum(x[:, :2] * x[:, 2:4], axis=1)).max()
        )
        if inside:
            smoothed = smooth(model, run)
            late = slice(15, -10)
            error = [np.sqrt(np.mean((z[:-1, 0, 5] - truth[:-1, 5])[late] ** 2)) for z in (run.mean, smoothed.mean)]
            assert error[1] < 0.6 * error[0]
            assert error[1] < 0.5
            scaled = run.covariance[-1, 0] / np.abs(run.covariance[-1, 0]).max()
            assert np.linalg.eigvalsh(scaled).min() > -1e-12
    assert away[True] < 1e-12
    assert away[False] > 1e-3


def test_last_increment_with_constraint_needs_no_step():
    taken, ends = {}, {}
    for restored in (False, True):
        model, steps, found = Pendulum(np.zeros((6, 6)), np.array([1e-4]), np.eye(6), h=0.05), [], []
        plain = model.f
        object.__setattr__(model, "f", lambda x, plain=plain, steps=steps: steps.append(1) or plain(x))
        for angle in np.linspace(0.3, 0.9, 10):
            x = np.array([[np.sin(angle), -np.cos(angle), 0, 0, 0, 0]])
            along = np.array([np.cos(angle), np.sin(angle), 0, 0, 0, 0])
            P = (1e-2**2 * np.outer(along, along) + np.diag([0, 0, 0, 0, 1e-2, 1.0]))[None]
            y = model.f(x)[:, :1] + 0.01
            found.append(refine(model, 0, x, P, np.zeros((6, 6)), model.R[None], y, 20, restored=restored).x[0])
        taken[restored], ends[restored] = len(steps), np.array(found)
    assert taken[True] < taken[False]
    off = np.abs(ends[True] - ends[False])
    assert off[:, :2].max() < 3e-6 * 1e-2
    assert off.max() > 0


class Brittle(Toy):
    """x⁺ = √x: no outcome for a negative start, to which a full increment leads."""

    def f(self, x):
        with np.errstate(invalid="ignore"):
            return np.sqrt(x)

    def g(self, x):
        return x * 1.0


def test_failed_step_is_halved_per_run():
    model = Brittle(np.zeros((1, 1)), np.array([1e-4]))
    x, P = np.array([[1.0], [1.0]]), np.array([[[4.0]], [[4.0]]])
    y = np.array([[0.05], [0.9]])  # the first run's increment would go to 1 − 1.9 < 0
    found = refine(model, 0, x, P, model.Q, np.full((2, 1), 1e-4), y, 50)
    for b in range(2):
        best = least_squares(lambda z, b=b: [(z[0] - 1) / 2, (y[b, 0] - np.sqrt(z[0])) / 1e-2], [0.5], bounds=(1e-9, 9))
        assert found.x[b, 0] == pytest.approx(np.sqrt(best.x[0]), abs=1e-4)
    undamped = refine(model, 0, x, P, model.Q, np.full((2, 1), 1e-4), y, 50, damped=False)
    assert np.isnan(undamped.x[0, 0])
    assert undamped.x[1, 0] == pytest.approx(np.sqrt(best.x[0]), abs=1e-6)


@pytest.mark.parametrize("form", ["joseph", "square_root"])
@pytest.mark.parametrize(
    "how", [{}, {"iterations": 5, "through_step": True, "damped": False}], ids=["one shot", "undamped"]
)
def test_failed_run_does_not_affect_others(form, how):
    model = Brittle(np.array([[1e-4]]), np.array([1e-4]))
    y = np.sqrt(0.9) * np.ones((4, 2, 1))
    mean, P = np.array([[-1.0], [0.9]]), 1e-3 * np.ones((2, 1, 1))
    both = filter_runs(model, mean, P, y, form=form, **how)
    alone = filter_runs(model, mean[1:], P[1:], y[:, 1:], form=form, **how)
    np.testing.assert_array_equal(both.lost, [1, -1])
    assert np.isnan(both.mean[1:, 0]).all()
    np.testing.assert_allclose(both.mean[:, 1], alone.mean[:, 0], rtol=1e-14)


def test_a_projection_keeps_the_update_in_one_shot_on_the_constraint():
    start = np.diag([0, 0, 0, 0, 1e-2, 0.05])
    model = Pendulum(np.zeros((6, 6)), np.array([1e-4]), start, h=0.05)
    y = np.sin(0.5 * np.cos(4 * model.h * np.arange(1, 41)))[:, None]

    def project(x, k):
        x = x.copy()
        x[:, :2] /= np.linalg.norm(x[:, :2], axis=1)[:, None]
        x[:, 2:4] -= np.sum(x[:, :2] * x[:, 2:4], axis=1)[:, None] * x[:, :2]
        return x

    mean = np.array([np.sin(0.4), -np.cos(0.4), 0, 0, 0, 0])
    away = []
    for how in ({}, {"project": project}):
        x = filter_runs(model, mean, np.diag([0, 0, 0, 0, 0, 1.0]), y, **how).mean[1:, 0]
        away.append(
            max(np.abs(np.hypot(x[:, 0], x[:, 1]) - 1).max(), np.abs(np.sum(x[:, :2] * x[:, 2:4], axis=1)).max())
        )
    assert away[0] > 1e-4
    assert away[1] < 1e-14


@pytest.mark.parametrize(("form", "through_step"), [("joseph", True), ("square_root", False)])
def test_iterating_a_parameter_ends_where_one_shot_ends(through_step, form):
    model = make_filter(
        make_beam(modes=4), parameters=("E",), known=("tip",), accelerometers=1, q_velocity=0.1, q_parameter=0.0
    )
    u = sine(model.h * np.arange(40), model.h, 1e4, 20.0)
    P0 = np.diag([0.0] * 8 + [1e-8])
    _, y = draw_truth(model, np.zeros(9), P0, u, [0, 1])
    once = run_filter(model, np.zeros(9), P0, u, y, keep="all", form=form)
    more = run_filter(model, np.zeros(9), P0, u, y, keep="all", form=form, iterations=4, through_step=through_step)
    for a, b in ((once, more), (smooth(model, once), smooth(model, more))):
        assert np.abs((b.mean - a.mean)[..., 8] / a.std[..., 8]).max() < 0.03
        np.testing.assert_allclose(b.std[..., 8], a.std[..., 8], rtol=0.01)


@dataclass(frozen=True)
class Changing(StepToy):
    """A, H and all noise are others in every step: a, c factor it before and after (T, 3, 1); r (T, 2) variances."""

    A: np.ndarray
    H: np.ndarray
    a: np.ndarray
    c: np.ndarray
    r: np.ndarray
    size, channels, position = 3, 2, np.array([1])

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
def test_time_varying_model_uses_current_step(way):
    """Every xₖ is a linear map of unit normals z (start and noise): posteriors of z given y up to k, and given all."""
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
