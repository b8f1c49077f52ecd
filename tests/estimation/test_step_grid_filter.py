"""Filters side by side: the grid filter over constants of a step against Bayes by brute force, and compiled linear filters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from strainsight import compiled
from strainsight.errors import InfeasibleError, NumericalError
from strainsight.estimation import parallel_filters
from strainsight.estimation.compiled import vectors
from strainsight.estimation.compiled.filters import take_steps
from strainsight.estimation.conditional import known_ends, linear_models
from strainsight.estimation.filter import filter_runs
from strainsight.estimation.parallel_filters import Data, advance, build_filters
from strainsight.estimation.step_grid_filter import StepGridProblem, filter_constants
from strainsight.runner.sweep_location import Where, opened

from .chain import finer
from .conftest import StepToy, plain_models
from .truth import plain_motion
from .two_masses import REFERENCE, chain, constants
from .two_masses import forces as both_forces
from .two_masses import start as start_of

Q, V, W, U, XI = range(5)


@dataclass(frozen=True)
class Oscillator(StepToy):
    """x = (q, v, w, u, ξ):  v' = v + h (u + w + known − ω² e^ξ q' − 2ζω v'),  q' = q + h v',  w' = 0,  y = q'.

    As the bench's step does it, noise is added before it: w is white, u a random walk. known (T,) acts in every step.
    """

    known: np.ndarray
    h: float = 0.05
    omega: float = 6.0
    zeta: float = 0.05
    white: float = 0.0
    walk: float = 0.0
    sigma: float = 0.02

    size, channels, position = 5, 1, np.array([U, XI])

    def step(self, x, k):
        h, k2, rate = self.h, self.omega**2 * np.exp(x[:, XI]), 2 * self.zeta * self.omega
        S = 1 + h * rate + h**2 * k2
        v = (x[:, V] + h * (x[:, U] + x[:, W] + self.known[k] - k2 * x[:, Q])) / S
        q = x[:, Q] + h * v
        A = np.tile(np.eye(5), (len(x), 1, 1))
        A[:, W, W] = 0.0
        A[:, V, Q], A[:, V, V] = -h * k2 / S, 1 / S
        A[:, V, W] = A[:, V, U] = h / S
        A[:, V, XI] = -h * k2 * q / S
        A[:, Q] = h * A[:, V]
        A[:, Q, Q] += 1
        return np.stack([q, v, 0 * v, x[:, U], x[:, XI]], axis=1), A

    def measure(self, x, k):
        J = np.zeros((len(x), 1, 5))
        J[:, 0, Q] = 1
        return x[:, :1].copy(), J

    def process(self, k):
        return np.zeros((5, 5))

    def before(self, k):
        return np.diag([0, 0, self.white**2, self.walk**2, 0])

    def noise(self, k):
        return np.array([self.sigma**2])

    def drawn(self, mean, P, rng):
        """ξ (), and readings (T, 1), of a truth of the model itself."""
        x = mean + np.sqrt(np.diag(P)) * rng.normal(size=5)
        xi, y = x[XI], []
        for k in range(len(self.known)):
            noise = np.sqrt(np.diag(self.before(k))) * rng.normal(size=5)
            x = self.step((x + noise)[None], k)[0][0]
            y.append(x[Q] + self.sigma * rng.normal())
        return xi, np.array(y)[:, None]


def problem_of(mean, P, filters):
    """Constants known independently of the motion: given ξ, the rest is as before."""

    def begin(xi):
        x, own = np.tile(mean, (len(xi), 1)), P.copy()
        own[XI] = own[:, XI] = 0.0
        x[:, XI:] = xi
        return x, np.tile(own, (len(xi), 1, 1))

    return StepGridProblem(mean, P, slice(XI, XI + 1), np.array([U, XI]), begin, filters)


PRIOR = 0.3
WEAKLY_SEEN = Oscillator(known=0.5 * np.sin(0.075 * np.arange(1, 201)), white=0.5, walk=0.3, sigma=0.1)
"""Motion, noise and what the loads do are of one size."""


def start(walk=0.0):
    return np.zeros(5), np.diag([1e-4, 1e-4, 0.0, 1e-6 + walk**2, PRIOR**2])


def runs_of(model, **how):
    how = {"refuse": False, **how}
    return lambda x, P, y: filter_runs(model, x, P, np.repeat(y[:, None], len(x), axis=1), **how)


def joint_density(model, mean, P, xi, y):
    """ln p(y | ξ) of one Gaussian of all readings, from the noise that enters, step by step."""
    T, x = len(y), mean.copy()
    x[XI] = xi
    means, into = [], [np.diag(np.sqrt(np.diag(P)[:4]))]
    for k in range(T):
        ahead, A = model.step(x[None], k)
        A, x = A[0, :4, :4], ahead[0]
        into = [A @ own for own in [*into, np.diag(np.sqrt(np.diag(model.before(k))[:4]))]]
        means.append((x[0], [own[0] for own in into]))
    rows = np.zeros((T, 4 * (T + 1)))
    for k, (_, own) in enumerate(means):
        rows[k, : 4 * len(own)] = np.concatenate(own)
    S = rows @ rows.T + model.sigma**2 * np.eye(T)
    e = y[:, 0] - np.array([own for own, _ in means])
    return -0.5 * e @ np.linalg.solve(S, e) - 0.5 * np.linalg.slogdet(S)[1]


@pytest.mark.parametrize("how", [{}, {"form": "square_root", "iterations": 10, "through_step": True}])
def test_step_grid_filter_matches_brute_force_bayes(how):
    model = replace(WEAKLY_SEEN, known=WEAKLY_SEEN.known[:40], sigma=0.02)
    mean, P = start(model.walk)
    _, y = model.drawn(mean, P, np.random.default_rng(4))
    with finer(0.5, 20.0):
        found = filter_constants(problem_of(mean, P, runs_of(model, **how)), y)
    grid = found.mean[-1, XI] + found.std[-1, XI] * np.arange(-7, 7.01, 0.5)
    log = np.array([joint_density(model, mean, P, xi, y) for xi in grid]) - 0.5 * grid**2 / PRIOR**2
    w = np.exp(log - log.max())
    w /= w.sum()
    std = np.sqrt(w @ (grid - w @ grid) ** 2)
    assert abs(found.mean[-1, XI] - w @ grid) < 1e-6 * std
    assert found.std[-1, XI] == pytest.approx(std, rel=1e-6)
    assert std < 0.8 * PRIOR


@pytest.mark.slow
def test_grid_filter_is_calibrated_where_ekf_is_overconfident():
    """RMS of the error over RMS of σ, 100 truths of the model itself: 0.85 to 1.15; the extended filter's is 1.25."""
    model, (mean, P) = WEAKLY_SEEN, start(WEAKLY_SEEN.walk)
    draws = [model.drawn(mean, P, np.random.default_rng(7000 + seed)) for seed in range(100)]
    grid_runs = [filter_constants(problem_of(mean, P, runs_of(model)), y) for _, y in draws]
    error = np.array([grid_run.mean[-1, XI] - xi for grid_run, (xi, _) in zip(grid_runs, draws, strict=True)])
    std = np.array([grid_run.std[-1, XI] for grid_run in grid_runs])
    assert 0.85 < np.sqrt(np.mean(error**2) / np.mean(std**2)) < 1.15
    extended = filter_runs(model, mean, P, np.stack([y for _, y in draws], axis=1))
    off = extended.mean[-1, :, XI] - np.array([xi for xi, _ in draws])
    assert np.sqrt(np.mean(off**2) / np.mean(extended.std[-1, :, XI] ** 2)) > 1.2


@pytest.fixture
def measured():
    model = replace(WEAKLY_SEEN, known=WEAKLY_SEEN.known[:20])
    mean, P = start(model.walk)
    return model, mean, P, model.drawn(mean, P, np.random.default_rng(2))[1]


class Breaking(Oscillator):
    least = -0.5

    def step(self, x, k):
        ahead, A = super().step(x, k)
        return np.where(x[:, XI:] < self.least, np.nan, ahead), A


def test_diverged_points_have_zero_weight(measured):
    model, mean, P, y = measured
    breaking = Breaking(**{name: getattr(model, name) for name in ("known", "white", "walk", "sigma")})
    grid_run = problem_of(mean, P, runs_of(breaking))

    def begin(xi):
        x, own = grid_run.begin(xi)
        return np.where(xi > 0.7, np.nan, x), own

    found = filter_constants(replace(grid_run, begin=begin), y)
    assert found.without > 0
    assert np.isfinite(found.mean).all()
    assert np.isfinite(found.std).all()
    outside = (found.point[:, 0] < -0.5) | (found.point[:, 0] > 0.7)
    assert outside.sum() == found.without
    assert not found.weight[outside].any()


def test_divergence_at_all_points_is_refused(measured):
    model, mean, P, y = measured
    breaking = Breaking(known=model.known)
    object.__setattr__(breaking, "least", np.inf)
    with pytest.raises(NumericalError, match="at all points of the parameter grid diverged") as error:
        filter_constants(problem_of(mean, P, runs_of(breaking)), y)
    assert "guess" in error.value.remedy


def test_a_constant_without_prior_width_is_refused(measured):
    model, mean, P, y = measured
    P[XI, XI] = 0.0
    with pytest.raises(InfeasibleError, match="an initial σ of the parameters is zero"):
        filter_constants(problem_of(mean, P, runs_of(model)), y)


A = np.array([[0.8, 0.1], [-0.1, 0.7]])
PROCESS, H, R = np.diag([0.5, 0.2]), np.array([[1.0, 0.0], [0.5, 1.0]]), np.array([0.3, 0.4])


def passed(filters, samples, keep):
    L = len(samples)
    known = np.zeros((L, 0))
    data = Data(known, known, samples, np.tile(R, (L, 1)), np.zeros(2))
    return advance(plain_models(A, PROCESS, H), filters, data, keep)


@pytest.mark.parametrize("before", [0, 30, 200])
def test_innovation_covariance_matches_riccati(before):
    """S = H P⁻Hᵀ + R, P⁻ by SciPy; a filter that had become steady in a part that was not kept had S = 0."""
    samples = np.random.default_rng(3).standard_normal((before + 300, 2))
    filters = build_filters(plain_models(A, PROCESS, H), np.zeros((1, 2)), np.eye(2), np.zeros((1, 0, 2)))
    passed(filters, samples[:before], keep=False)
    found = passed(filters, samples[before:], keep=True)
    P = solve_discrete_are(A.T, H.T, PROCESS, np.diag(R))
    np.testing.assert_allclose(found.S[0, -1], H @ P @ H.T + np.diag(R), rtol=1e-11)
    if before > 100:
        np.testing.assert_allclose(found.S[0, 0], H @ P @ H.T + np.diag(R), rtol=1e-11)


def test_decaying_states_are_flushed_to_zero():
    never = np.zeros((2, 2))
    models = plain_models(A, never, H)
    filters = build_filters(models, np.ones((1, 2)), np.eye(2), np.zeros((1, 0, 2)))
    known = np.zeros((3000, 0))
    data = Data(known, known, np.full((3000, 2), np.nan), np.tile(R, (3000, 1)), np.zeros(2))
    found = advance(models, filters, data, True)
    for of in (found.states.x, found.states.P):
        assert np.all(of[0, -1] == 0)
        assert np.abs(of[of != 0]).min() > np.finfo(float).tiny


def test_threads_change_no_bit(monkeypatch):
    monkeypatch.setattr(parallel_filters, "APART", 1)
    model = chain(tuple(REFERENCE)[:1])
    own, rng = constants(model), np.random.default_rng(6)
    at = linear_models(model, np.linspace(-0.2, 0.2, 5)[:, None], own)
    (B, m, n), d, known = at.H.shape, at.considered_count, both_forces()[:40, :, :1]
    samples, found = rng.standard_normal((40, m)), []
    for jobs in (1, 2, 3):
        filters = build_filters(at, np.zeros((B, n)), np.eye(n), np.zeros((B, d, n)))
        with opened(Where(jobs=jobs)):
            data = Data(known.reshape(40, -1), known_ends(known, own), samples, np.ones((40, m)), np.zeros(m))
            found.append(advance(at, filters, data, True))
    for other in found[1:]:
        np.testing.assert_array_equal(other.fit, found[0].fit)
        np.testing.assert_array_equal(other.states.P, found[0].states.P)


def test_loops_are_compiled_once_for_arrays_of_any_kind():
    samples = np.asfortranarray(np.random.default_rng(1).standard_normal((5, 2)))
    filters = build_filters(plain_models(A, PROCESS, H), np.zeros((1, 2)), np.eye(2), np.zeros((1, 0, 2)))
    known, noise = np.zeros((5, 0)), np.broadcast_to(R, (5, 2))
    data = Data(known, known, samples, noise, np.zeros(2))
    advance(plain_models(A, PROCESS, H), filters, data, True)
    advance(plain_models(A, PROCESS, H), filters, replace(data, samples=samples[::-1], noise=np.tile(R, (5, 1))), False)
    assert len(take_steps.signatures) == 1


def test_compiled_loops_detect_file_changes():
    stamp = take_steps._cache._cache_file._source_stamp
    for module in (compiled, vectors):
        file = Path(module.__file__).stat()
        assert (file.st_mtime, file.st_size) in stamp, module.__name__


def test_modal_step_matches_full_matrices():
    model = chain(tuple(REFERENCE)[:1])
    own = replace(constants(model), stiffness=0.01)
    apart = linear_models(model, np.array([[-0.2], [0.0], [0.1]]), own)
    assert apart.motion.pairs.shape[-1] == model.model.size
    full = replace(apart, motion=plain_motion(apart.A, apart.G, apart.A_nu, apart.G_nu))
    n, m = apart.H.shape[2], apart.H.shape[1]
    known, samples = both_forces()[:50, :, :1], 1e-6 * np.random.default_rng(4).standard_normal((50, m))
    samples[5, 0], samples[9] = np.nan, np.nan
    R = np.tile(1e-13 * np.arange(1.0, m + 1), (50, 1))
    found = []
    for each in (apart, full):
        filters = build_filters(
            each, np.zeros((3, n)), start_of()[:n, :n], np.zeros((3, each.considered_count, n)), consider=True
        )
        data = Data(known.reshape(50, -1), known_ends(known, own), samples, R, np.zeros(m))
        found.append(advance(each, filters, data, True))
    for name in ("fit", "expected", "S", "slope"):
        one, other = (getattr(own, name) for own in found)
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-10 * np.abs(other).max())
    for name in ("x", "P", "V", "nu", "left"):
        one, other = (getattr(own.states, name) for own in found)
        np.testing.assert_allclose(one, other, rtol=1e-8, atol=1e-10 * np.abs(other).max())
