"""What a step does and channels read, also by rows that depend on an estimated parameter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from strainsight.estimation.conditional import none_considered
from strainsight.estimation.filter import run_filter
from strainsight.estimation.grid_filter import filter_on_grid
from strainsight.estimation.grid_filter_smoother import smooth_on_grid
from strainsight.estimation.model import measure, step, surface_reading
from strainsight.estimation.record import GridRecord
from strainsight.estimation.reduced import DrivenModel
from strainsight.fem.affine import NO_CHANGE, AffineOperator, Coefficient, Newton
from strainsight.loads.input_models import IntegratedRandomWalk, Matern, Oscillator
from strainsight.rom.modal_step import simulate
from strainsight.rom.model import damping_matrix
from strainsight.sensors.candidates import ACCELERATION, STRAIN

from .chain import REFERENCE, ROWS, H, driven_chain, forces
from .conftest import make_beam, make_filter, sine

MODELS = {
    "walk": {},
    "integrated": {"tip": IntegratedRandomWalk(20.0)},
    "matern": {"tip": Matern(20.0, 2.5), "middle": Matern(4.0, 0.5)},
    "oscillator": {"tip": Oscillator(20.0), "middle": Matern(8.0, 1.5)},
}
KNOWN = 1e4 * np.array([[0.7], [0.4], [-0.3]])


def state(model, rng):
    """A state of the size a 1e4 N load causes, with unknowns of order one."""
    n = model.model.size
    omega = np.sqrt(np.diag(model.model.stiffness.at(model.model.reference)))
    q = 1e4 * model.model.input_shape[:, 0] / omega**2
    scale = np.abs(np.concatenate([q, q * omega, np.full(model.size - 2 * n, 0.3)]))
    return scale * rng.normal(size=model.size), scale


def test_without_noise_the_step_is_the_simulation_of_the_reduced_model():
    beam, h = make_beam(), 5e-4
    model = make_filter(beam, inputs=(), parameters=("E", "rho"), known=("tip",), h=h)
    u = sine(h * np.arange(50), h, 1e4, 20.0)
    p = np.array([0.05, -0.08])
    x = np.concatenate([np.zeros(20), p])[None]
    expected = simulate(beam.model, {"E": 2.1e11 * np.exp(p[0]), "rho": 7850.0 * np.exp(p[1])}, u, h)
    for k in range(50):
        x, _ = step(model, x, u[k])
    np.testing.assert_allclose(x[0, :20], expected[-1], rtol=1e-10, atol=1e-12 * np.abs(expected[-1]).max())
    np.testing.assert_array_equal(x[0, 20:], p)


def test_matrices_computed_once_make_the_same_step_and_readings():
    model = make_filter(make_beam(modes=4), ("tip",), models={"tip": Oscillator(9.0)}, accelerometers=1)
    x, nothing, at_end = np.random.default_rng(0).normal(size=(3, model.size)), np.zeros((3, 0)), np.zeros(0)
    core = DrivenModel(model, nothing[None])
    for one, again in zip(core.step(x, 0), step(model, x, nothing), strict=True):
        np.testing.assert_allclose(one, again, rtol=1e-12, atol=1e-12 * np.abs(again).max())
    for one, again in zip(core.measure(x, 0), measure(model, x, at_end), strict=True):
        np.testing.assert_allclose(one, again, rtol=1e-12, atol=1e-12 * np.abs(again).max())


def differences(function, x, scale):
    """Fourth-order central differences of function (points, n) → (points, m) at x, in units of `scale`: (m, n)."""
    d, directions = 2e-3, np.diag(scale)
    return (
        8 * (function(x + d * directions) - function(x - d * directions))
        - (function(x + 2 * d * directions) - function(x - 2 * d * directions))
    ).T / (12 * d)


@pytest.mark.parametrize("scheme", ["exact", "trapezoidal", "implicit_euler"])
@pytest.mark.parametrize("models", [*MODELS, "known"])
@pytest.mark.parametrize("parameters", [(), ("E", "rho")])
def test_both_jacobians_for_every_input_model_scheme_and_sensor(models, scheme, parameters):
    beam = make_beam(modes=6, graded=True, load_nodes=(16, 8))
    inputs, known = (("tip",), ("middle",)) if models == "known" else (("tip", "middle"), ())
    model = make_filter(beam, inputs, parameters, known, models=MODELS.get(models), accelerometers=2, scheme=scheme)
    x, scale = state(model, np.random.default_rng(3))
    held = KNOWN[:, : len(known)]
    for function in (lambda z: step(model, z, held), lambda z: measure(model, z, held.sum(axis=0))):
        J = function(x[None])[1][0] * scale
        largest = np.abs(J).max(axis=1, keepdims=True)
        found = differences(lambda z, function=function: function(z)[0], x, scale)
        np.testing.assert_allclose(J / largest, found / largest, atol=1e-7)


@pytest.mark.parametrize("models", MODELS)
def test_the_step_follows_the_load_of_its_input_model(models):
    """By an ODE solver: exact for walks; the quadratic hold of the others errs by less than (sh)³, s their fastest rate."""
    beam, h = make_beam(modes=4, load_nodes=(16, 8)), 5e-4
    model = make_filter(beam, ("tip", "middle"), models=MODELS[models], h=h)
    x, scale = state(model, np.random.default_rng(5))
    n, theta = 4, model.fixed
    M, K, C = model.model.mass.at(theta), model.model.stiffness.at(theta), damping_matrix(model.model, theta)
    A_u = model.unknowns.rate_matrix()

    def rate(t, z):
        load = 1e4 * z[model.position]
        q, v, zeta = z[:n], z[n : 2 * n], z[2 * n :]
        return np.concatenate([v, np.linalg.solve(M, model.model.input_shape @ load - C @ v - K @ q), A_u @ zeta])

    exact = solve_ivp(rate, (0, h), x, method="DOP853", rtol=1e-12, atol=1e-14 * scale).y[:, -1]
    found = step(model, x[None], np.zeros((3, 0)))[0][0]
    fastest = np.abs(np.linalg.eigvals(A_u)).max()
    tolerance = 1e-9 if models in ("walk", "integrated") else (fastest * h) ** 3
    np.testing.assert_allclose(found / scale, exact / scale, atol=tolerance)
    assert np.abs((found - exact) / scale)[2 * n :].max() < 1e-10


MORE = np.array([[2.4, 0.4], [-3.6, 2.0]])
"""What twice the stiffness k1 adds to the rows, and a quarter of it the square of that change."""


def of_k1(rows):
    """ΔX(k1) = X (s + s²/4), s = k1/k1₀ − 1."""
    base = Newton("k1", (REFERENCE["k1"], REFERENCE["k1"]), REFERENCE["k1"])
    return AffineOperator(0.0, {"k1 (1)": rows}, {"k1 (1)": Coefficient((base,), np.array([0.0, 1.0, 0.25]))})


def rows_at(k1):
    s = k1 / REFERENCE["k1"] - 1
    return ROWS + (s + 0.25 * s**2) * MORE


def unknown(noise=2e-3):
    return replace(driven_chain(noise, ("k1",)), change=of_k1(MORE))


@pytest.mark.parametrize("sets", [1, 3])
def test_reading_and_jacobian_are_those_of_the_rows_at_the_parameter(sets):
    """Of strain, and of an accelerometer whose direction changes; of every run by its own rows where it has some."""
    model = driven_chain(parameters=("k1", "k2"))
    phi, more = np.vstack([ROWS, [0.3, 1.0]]), np.vstack([MORE, [0.4, -0.2]])
    wide = np.hstack([phi, np.zeros((3, 4))])
    if sets > 1:
        factor = np.arange(1, sets + 1)[:, None, None]
        wide, more = factor * wide, factor * more
    quantity = np.array([STRAIN, STRAIN, ACCELERATION])
    model = replace(model, H=wide, change=of_k1(more), quantity=quantity, r=np.ones(3))
    x, known = np.random.default_rng(0).standard_normal((3, 6)) * [1, 1, 1, 1, 0.2, 0.2], np.array([0.7])
    y, J = measure(model, x, known)
    for b in range(3):
        s, own = np.expm1(x[b, 4]), b if sets > 1 else 0
        rows = (np.reshape(wide, (-1, 3, 6))[own, :, :2]) + (s + 0.25 * s**2) * np.reshape(more, (-1, 3, 2))[own]
        np.testing.assert_allclose(y[b, :2], (rows @ x[b, :2])[:2], rtol=1e-12)
    step = 1e-5
    for i in range(6):
        e = step * np.eye(6)[i]
        slope = (measure(model, x + e, known)[0] - measure(model, x - e, known)[0]) / (2 * step)
        np.testing.assert_allclose(np.broadcast_to(J, (3, 3, 6))[..., i], slope, atol=1e-6 * np.abs(slope).max())


def test_virtual_gauge_matches_channel():
    model = unknown()
    x = np.random.default_rng(1).standard_normal((4, 5)) * 0.1
    y, J = measure(model, x, np.zeros(1))
    found, slope = surface_reading(model, ROWS, of_k1(MORE), x)
    np.testing.assert_allclose(found, y)
    np.testing.assert_allclose(slope, J)


PRIOR, START = 0.1, np.diag([1e-8, 1e-8, 1e-6, 1e-6, 0.1**2])


def known_at(model, p):
    """The model that knows k1 = guess exp(p), with rows of that value."""
    k1 = REFERENCE["k1"] * np.exp(p)
    H_at = np.hstack([rows_at(k1), np.zeros((2, 2))])
    unknowns = replace(model.unknowns, parameters=())
    return replace(model, unknowns=unknowns, fixed={**REFERENCE, "k1": k1}, H=H_at, change=NO_CHANGE, Q=model.Q[:4, :4])


def samples(model, p, seed):
    """(T, 2) at k1 = guess exp(p), without process noise."""
    driven, x, y = DrivenModel(known_at(model, p), forces()), np.zeros((1, 4)), []
    for k in range(len(forces())):
        x = driven.step(x, k)[0]
        y.append(driven.measure(x, k)[0][0])
    noise = np.random.default_rng(seed).standard_normal((len(y), 2)) * np.sqrt(model.r / H)
    return np.array(y) + noise


def by_brute_force(model, y):
    """Mean and σ of p: Kalman filters with rows of their own at every p of a grid, weighed by likelihood and prior."""
    grid = np.linspace(0.0, 0.25, 51)
    score = []
    for p in grid:
        own = known_at(model, p)
        score.append(
            run_filter(own, np.zeros(4), START[:4, :4], forces(), y).log_likelihood[0] - 0.5 * (p / PRIOR) ** 2
        )
    w = np.exp(np.array(score) - np.max(score))
    w /= w.sum()
    mean = w @ grid
    return mean, np.sqrt(w @ (grid - mean) ** 2)


def test_grid_filter_matches_brute_force_bayes():
    model = unknown()
    y = samples(model, 0.12, 7)
    mean, std = by_brute_force(model, y)
    assert abs(mean - 0.12) < 3 * std
    grid_run = filter_on_grid(GridRecord(model, np.zeros(5), START, forces(), y, none_considered(model)))
    assert grid_run.run.mean[-1, 0, 4] == pytest.approx(mean, abs=0.01 * std)
    assert grid_run.run.std[-1, 0, 4] == pytest.approx(std, rel=0.01)
    later = smooth_on_grid(GridRecord(model, np.zeros(5), START, forces(), y, none_considered(model)), grid_run)
    assert later.mean[0, 0, 4] == pytest.approx(mean, abs=0.01 * std)
    for by_points in (False, True):
        other = run_filter(model, np.zeros(5), START, forces(), y, by_points=by_points)
        assert other.mean[-1, 0, 4] == pytest.approx(mean, abs=0.3 * std)
        assert other.std[-1, 0, 4] == pytest.approx(std, rel=0.1)
    blind = filter_on_grid(
        GridRecord(replace(model, change=NO_CHANGE), np.zeros(5), START, forces(), y, none_considered(model))
    )
    assert abs(blind.run.mean[-1, 0, 4] - mean) > 2 * std
