"""The batched filter against a plain loop, filterpy, Riccati equations, invariances and hard cases."""

from __future__ import annotations

from dataclasses import replace

import mpmath
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigh, solve_continuous_are, solve_discrete_are

from strainsight.errors import NumericalError
from strainsight.estimation.claim import covariance_recursion
from strainsight.estimation.filter import run_filter
from strainsight.estimation.model import step
from strainsight.estimation.reduced import DrivenModel
from strainsight.estimation.smoother import smooth
from strainsight.estimation.update import Transition, belief_of, covariance_factor, joseph, pivoted_factors, predict
from strainsight.loads.input_models import IntegratedRandomWalk, Matern, Oscillator
from strainsight.loads.linearisation import linearise

from .conftest import drawn, make_beam, make_filter, prior, sine
from .truth import draw_truth

CASES = [(("tip",), ()), ((), ("E",)), (("tip",), ("E",))]


def modal_scale(model):
    """Energy coordinates: q in 1/ω, the rest of order one."""
    n = model.model.size
    omega = np.sqrt(np.diag(model.model.stiffness.at(model.model.reference)))
    return np.concatenate([1 / omega, np.ones(model.size - n)])


@pytest.mark.parametrize("form", ["joseph", "square_root"])
@pytest.mark.parametrize(("inputs", "parameters"), CASES[1:])
def test_filter_matches_textbook_loop(inputs, parameters, form):
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(modes=4), sine, inputs, parameters)
    run = run_filter(model, mean, P0, u, y, keep="all", form=form)
    Q, R, H = model.process, np.diag(model.r / model.h), model.H
    for b in range(y.shape[1]):
        x, P = mean, P0
        for k in range(len(y)):
            after, A = step(model, x[None], u[k])
            x, A = after[0], A[0]
            P = A @ P @ A.T + Q
            S = H @ P @ H.T + R
            K = P @ H.T @ np.linalg.inv(S)
            nu = y[k, b] - H @ x
            x = x + K @ nu
            P = P - K @ S @ K.T
            assert run.nis[k, b] == pytest.approx(nu @ np.linalg.inv(S) @ nu, rel=1e-6)
        scale = np.sqrt(np.diag(P))
        np.testing.assert_allclose(run.mean[-1, b] / scale, x / scale, atol=1e-6)
        np.testing.assert_allclose(run.covariance[-1, b % run.covariance.shape[1]] / np.outer(scale, scale),
                                   P / np.outer(scale, scale), atol=1e-6)  # fmt: skip
        at = model.position
        own = run.unknown_covariance[-1, b % run.covariance.shape[1]]
        np.testing.assert_allclose(own, P[np.ix_(at, at)], rtol=1e-5, atol=1e-6 * scale[at].min() ** 2)
        np.testing.assert_allclose(run.gauge_mean[-1, b], H @ x, rtol=1e-6)
        np.testing.assert_allclose(run.gauge_std[-1, b], np.sqrt(np.diag(H @ P @ H.T)), rtol=1e-5)


def test_known_states_are_predicted():
    """Truth: M q̈ = S u − C q̇ − K q of the modes by a general solver of differential equations."""
    beam, h, steps = make_beam(modes=4, graded=True, ratio=0.02), 5e-4, 25
    model = make_filter(beam, parameters=("E",), known=("tip",), h=h, accelerometers=1)
    u = sine(h * np.arange(steps), h, 1e4, 200.0)
    rest, theta = beam.model, beam.model.reference
    M, K, C = rest.mass.at(theta), rest.stiffness.at(theta), np.zeros((4, 4))
    omega, V = eigh(K, M)
    C = M @ V @ np.diag(2 * 0.02 * np.sqrt(omega)) @ V.T @ M

    def load(t):
        k = min(int(t / h + 1e-9), steps - 1)
        s = t / h - k
        return rest.input_shape @ (u[k, 0] + s * u[k, 1] + s * s * u[k, 2])

    def acceleration(t, x):
        return np.linalg.solve(M, load(t) - C @ x[4:] - K @ x[:4])

    def rate(t, x):
        return np.concatenate([x[4:], acceleration(t, x)])

    y, x = [], np.zeros(8)
    for k in range(steps):  # a step at a time: the load has a kink between two
        x = solve_ivp(rate, (k * h, (k + 1) * h), x, rtol=1e-11, atol=1e-16).y[:, -1]
        strain = model.H[:4, :4] @ x[:4]
        end = rest.input_shape @ u[k].sum(axis=0)
        y.append([*strain, *(model.H[4:, :4] @ np.linalg.solve(M, end - C @ x[4:] - K @ x[:4]))])
    run = run_filter(model, np.zeros(model.size), prior(model), u, np.array(y))
    assert np.all(np.abs(run.innovation[:, 0]) < 1e-6 * np.abs(y).max(axis=0))


@pytest.mark.parametrize(
    ("inputs", "parameters", "load_model"),
    [
        *[(*case, None) for case in CASES],
        *[(("tip",), (), own) for own in (IntegratedRandomWalk(20.0), Oscillator(20.0), Matern(20.0, 1.5))],
    ],
)
def test_steady_covariance_tends_to_the_continuous_one_at_first_order(inputs, parameters, load_model):
    """CARE (5.14), the placement's, is the limit of the discrete filter for h → 0: one frozen linearisation."""
    beam = make_beam(modes=3)
    n, load = 3, np.array([1e4])
    q = np.linalg.solve(beam.model.stiffness.at(beam.model.reference), beam.model.input_shape @ load)
    differences = []
    # at 2⁻²¹ s one unit in the last place of the process noise moves the rate by 0.2, in SciPy's discrete solver; at 2⁻²⁰ s
    # it differs by 0.006 between kernels of OpenBLAS
    for h in 2.0 ** np.array([-18, -19, -20]):
        model = make_filter(
            beam, inputs=inputs, parameters=parameters, known=() if inputs else ("tip",), h=h,
            models={"tip": load_model} if load_model else None, q_velocity=1e-2 if load_model else 0.0,
        )  # fmt: skip
        scale = modal_scale(model)
        x = np.zeros(model.size)
        x[:n], x[n : 2 * n], x[model.input_states] = 0.8 * q, 40.0 * q, 1.0
        known = np.zeros((3, len(model.known_inputs)))
        known[0] = load
        A = step(model, x[None], known)[1]
        F = linearise(beam.model, model.unknowns, model.fixed, x[None, : 2 * n], load[None])[0]
        whitened, Q = model.H * scale / np.sqrt(model.r)[:, None], model.Q / np.outer(scale, scale)
        limit = solve_continuous_are((F * scale / scale[:, None]).T, whitened.T, Q, np.eye(4))
        gathered = model.process / np.outer(scale, scale)
        ahead = solve_discrete_are((A[0] * scale / scale[:, None]).T, whitened.T, gathered, np.eye(4) / h)
        gain = ahead @ whitened.T @ np.linalg.inv(whitened @ ahead @ whitened.T + np.eye(4) / h)
        steady = (ahead - gain @ whitened @ ahead) * np.outer(scale, scale)
        again = predict(steady[None], A, model.process)
        again, _, _ = joseph(again, model.H, model.r[None] / h, np.nan)
        d = np.sqrt(np.diag(limit)) * scale
        np.testing.assert_allclose(again[0] / np.outer(d, d), steady / np.outer(d, d), atol=1e-7)
        differences.append(np.abs(steady / np.outer(d, d) - limit * np.outer(scale, scale) / np.outer(d, d)).max())
    rate = np.array(differences[:-1]) / differences[1:]
    assert differences[-1] < (1e-2 if load_model else 1.2e-3)
    np.testing.assert_allclose(rate[-1], 2.0, atol=0.1)
    assert abs(rate[-1] - 2) < max(abs(rate[-2] - 2), 0.02)


def test_batch_matches_single_runs():
    beam = make_beam(modes=4, graded=True)
    single, mean, P0, u, _, y = drawn(make_filter, beam, sine, (), ("E",))
    places = [(0.05, 0.3, 0.9, 1.5), (0.1, 0.2, 0.3, 0.4), (0.0, 0.7, 1.1, 1.9)]
    H = np.stack([np.hstack([beam.rows(*p), np.zeros((4, 5))]) for p in places])
    r = single.r * np.array([[1.0], [2.0], [0.5]])
    means = mean + np.array([[0.0], [0.05], [-0.05]]) * (np.arange(9) == 8)
    P = P0 * np.array([1.0, 2.0, 3.0])[:, None, None]
    batch = run_filter(replace(single, H=H, r=r), means, P, u, y, keep="all")
    for b in range(3):
        alone = run_filter(replace(single, H=H[b], r=r[b]), means[b], P[b], u, y[:, b], keep="all")
        for name in ("mean", "std", "gauge_mean", "gauge_std", "whitened", "covariance", "jacobian"):
            one = getattr(alone, name)[:, 0]
            scale = np.maximum(np.abs(one).max(axis=0), 1e-300)
            np.testing.assert_allclose(getattr(batch, name)[:, b] / scale, one / scale, atol=1e-8)


def test_strain_unit_does_not_change_result():
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(modes=4), sine, ("tip",), ("E",))
    unit = 2.0**40
    other = run_filter(replace(model, H=model.H * unit, r=model.r * unit**2), mean, P0, u, y * unit)
    run = run_filter(model, mean, P0, u, y)
    np.testing.assert_array_equal(other.mean, run.mean)
    np.testing.assert_array_equal(other.std, run.std)


def test_steady_covariance_matches_recursion(monkeypatch):
    model = make_filter(make_beam(modes=4, ratio=0.05), ("tip",), q_velocity=1.0)
    P0, nothing = prior(model), np.zeros((1500, 3, 0))
    _, y = draw_truth(model, np.zeros(9), P0, nothing, [0, 1])
    y[1200, :, 1] = np.nan
    rested = run_filter(model, np.zeros(9), P0, nothing, y, keep="all")
    steps = np.abs(np.diff(rested.covariance[:, 0], axis=0)).max(axis=(1, 2))
    assert not steps[800:1199].any()
    assert steps[1200] > 0
    monkeypatch.setattr("strainsight.estimation.filter.CALM", 10**9)
    restless = run_filter(model, np.zeros(9), P0, nothing, y, keep="all")
    d = restless.std[-1, 0]
    np.testing.assert_allclose(rested.covariance / np.outer(d, d), restless.covariance / np.outer(d, d), atol=1e-11)
    np.testing.assert_allclose(rested.mean / d, restless.mean / d, atol=1e-9)


def test_a_diverged_run_is_reported_and_leaves_the_others_alone():
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(modes=4), sine, (), ("E",), runs=2)
    wild = y.copy()
    wild[30:, 1] = 1e3
    run = run_filter(model, mean, P0, u, wild)
    assert run.lost[0] == -1
    assert run.lost[1] > 30
    assert np.all(np.isnan(run.mean[run.lost[1] :, 1]))
    assert np.all(np.isfinite(run.mean[: run.lost[1], 1]))
    alone = run_filter(model, mean, P0, u, y[:, 0])
    np.testing.assert_allclose(run.mean[:, 0], alone.mean[:, 0], rtol=1e-8, atol=1e-10 * np.abs(alone.mean).max())
    with pytest.raises(NumericalError, match="E deviated from the guess"):
        run_filter(model, mean, P0, u, wild[:, 1])


@pytest.mark.parametrize("form", ["joseph", "square_root"])
def test_a_gauge_that_reads_nothing_without_noise_is_refused(form):
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(modes=4), sine, ("tip",), ())
    H, r = model.H.copy(), model.r.copy()
    H[2], r[2] = 0.0, 0.0
    with pytest.raises(NumericalError, match="not positive definite"):
        run_filter(replace(model, H=H, r=r), mean, P0, u, y, form=form)


def test_refusal_names_first_sample():
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(modes=4), sine, ("tip",), ())
    sure = replace(model, r=0 * model.r, Q=0 * model.Q)
    for form in ("joseph", "square_root"):
        with pytest.raises(NumericalError, match=r"not positive definite at t = 0\.0005 s"):
            run_filter(sure, mean, 0 * P0, u, y, form=form)
    with pytest.raises(NumericalError, match=r"not positive definite at t = 0\.001 s"):
        covariance_recursion(replace(sure, every=2), np.zeros((61, 8)), np.zeros((60, 3, 1)), 0 * P0)


kalman = pytest.importorskip("filterpy.kalman")


@pytest.mark.parametrize(
    ("models", "form"),
    [({}, "joseph"), ({"tip": IntegratedRandomWalk(20.0)}, "square_root"), ({"tip": Matern(10.0, 2.5)}, "joseph")],
)
def test_filter_and_smoother_agree(models, form):
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
    driven, rest = DrivenModel(model, u), np.zeros((1, n))
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


def test_a_constant_parameter_has_one_value_at_all_times():
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


@pytest.mark.parametrize(("noise", "joseph", "square_root"), [(1e-9, 1e-9, 1e-12), (1e-12, 1e-3, 1e-9)])
def test_square_root_form_keeps_digits_at_small_noise(noise, joseph, square_root):
    """Oracle: the textbook recursion with 60 digits, in units of its own deviations. The load is known at first to 1e4 N."""
    model = make_filter(make_beam(modes=3), ("tip",), strain_noise=noise, gauges=(0.05, 0.3, 0.9))
    n, steps, P0 = model.size, 30, np.diag([0.0] * 6 + [1.0])
    with mpmath.workdps(60):
        A = mpmath.matrix(DrivenModel(model, np.zeros((1, 3, 0))).step(np.zeros((1, n)), 0)[1][0].tolist())
        H, W, R, P = (
            mpmath.matrix(X.tolist()) for X in (model.H, covariance_factor(model.process), np.diag(model.noise), P0)
        )
        # Of the noise of a step the factor is what counts: rounded to a matrix it has lost the digits in question.
        Q = W * W.T
        for _ in range(steps):
            P = A * P * A.T + Q
            S = H * P * H.T + R
            P = P - P * H.T * S**-1 * H * P
        exact = np.array(P.tolist(), dtype=float)
    d = np.sqrt(np.diag(exact))
    error = {}
    for form in ("joseph", "square_root"):
        run = run_filter(model, np.zeros(n), P0, np.zeros((steps, 3, 0)), np.zeros((steps, 3)), form=form)
        error[form] = np.abs((run.last[0] - exact) / np.outer(d, d)).max()
    assert error["joseph"] < joseph
    assert error["square_root"] < square_root
    assert error["square_root"] < 0.01 * error["joseph"]


@pytest.mark.parametrize("form", ["joseph", "square_root"])
def test_a_long_run_stays_symmetric_and_positive(form):
    model = make_filter(make_beam(modes=8), ("tip",), q_velocity=0.1)
    mean, P = np.zeros(17), np.diag([0.0] * 16 + [1.0])
    rng = np.random.default_rng(0)
    for _ in range(2):
        y = 1e-6 * rng.standard_normal((500, 4))
        y[rng.random(y.shape) < 0.01] = np.nan
        run = run_filter(model, mean, P, np.zeros((500, 3, 0)), y, form=form)
        mean, P = run.mean[-1], run.last
        assert np.array_equal(P, np.swapaxes(P, 1, 2))
        d = np.sqrt(np.diagonal(P[0]))
        assert np.linalg.eigvalsh(P[0] / np.outer(d, d)).min() > 0


def test_pivoted_factor_is_independent_of_batch():
    near = np.array([[1.0, 1 - 1e-13], [1 - 1e-13, 1.0]])
    alone = pivoted_factors(near[None])[0]
    among = pivoted_factors(np.concatenate([np.tile(np.eye(2), (2000, 1, 1)), near[None]]))[-1]
    np.testing.assert_array_equal(alone, among)
    G = np.random.default_rng(0).normal(size=(40, 6))
    F = pivoted_factors((G @ G.T)[None])[0]
    np.testing.assert_allclose(F @ F.T, G @ G.T, atol=1e-12 * np.abs(G @ G.T).max())
    assert np.count_nonzero(np.abs(F).max(axis=0)) == 6
    with pytest.raises(np.linalg.LinAlgError):
        pivoted_factors(np.full((1, 2, 2), np.nan))


@pytest.mark.parametrize("form", ["joseph", "square_root"])
def test_expected_innovation_covariance(form):
    """L Lᵀ = H (A (P + before) Aᵀ + process) Hᵀ + R, multiplied out, L lower with a positive diagonal."""
    rng = np.random.default_rng(3)
    n, m = 6, 2
    P, before, process = (X @ X.T for X in rng.normal(size=(3, n, 3)))
    A, H, R = rng.normal(size=(1, n, n)), rng.normal(size=(1, m, n)), np.array([[0.3, 0.02]])
    L = belief_of(form, P[None]).expected(Transition(A, process, before), H, R, 0.1)[0]
    S = H[0] @ (A[0] @ (P + before) @ A[0].T + process) @ H[0].T + np.diag(R[0])
    np.testing.assert_allclose(L @ L.T, S, rtol=1e-12)
    assert np.all(np.diag(L) > 0)
    assert L[0, 1] == 0
    with pytest.raises(NumericalError, match=r"not positive definite at t = 0\.1 s"):
        belief_of(form, P[None]).expected(Transition(A, process, before), np.zeros((1, m, n)), 0 * R, 0.1)
