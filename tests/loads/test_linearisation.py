"""F* is the derivative of the augmented equation of motion, and what it lets be known: rank, conditioning."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import sqrtm

from strainsight.errors import ConfigError
from strainsight.fem.affine import Coefficient, Newton
from strainsight.loads.input_models import IntegratedRandomWalk, Matern, Oscillator, Unknowns, rate_matrix
from strainsight.loads.linearisation import linearisation_instants, linearise, measurement_rows
from strainsight.loads.observability import (
    balanced_units,
    least_gauges,
    marginal_modes,
    observability,
    undetectable_directions,
    undetectable_in_words,
    unseen_along,
)
from strainsight.rom.model import Damping, damping_matrix
from strainsight.sensors.candidates import ACCELERATION, DISPLACEMENT, STRAIN

from ..placement.whole_pools import augment_rows
from .conftest import chain_of, theta

AMPLITUDE = {"tip": 40.0, "side": 7.0}


def unknowns_of(theta, inputs=("tip",), parameters=("E", "rho")):
    return Unknowns(inputs, parameters, AMPLITUDE, theta)


def augmented_rate(model, unknowns, theta, x_star, known_u):
    """ẋ* written out, with the damping from a matrix square root."""
    n, at = model.size, unknowns.position(model)
    q, v = x_star[:n], x_star[n : 2 * n]
    u = known_u.copy()
    for i, name in enumerate(unknowns.inputs):
        u[model.inputs.index(name)] = unknowns.amplitude[name] * x_star[at[i]]
    value = dict(theta)
    for i, name in enumerate(unknowns.parameters):
        value[name] = unknowns.guess[name] * np.exp(x_star[at[len(unknowns.inputs) + i]])
    M = model.mass.constant + model.mass.terms["rho"] * value["rho"]
    ((label, slope),) = model.stiffness.terms.items()
    K = model.stiffness.constant + slope * (value["E"] if label == "E" else value["E"] ** 3 / theta["E"] ** 2)
    if model.damping.kind == "modal":
        C = 2 * model.damping.ratio * M @ sqrtm(np.linalg.solve(M, K)).real
    else:
        C = model.damping.alpha * M + model.damping.beta * K
    S = model.input_shape + model.input_slope.get("rho", 0.0) * (value["rho"] - model.reference["rho"])
    a = np.linalg.solve(M, S @ u - C @ v - K @ q)
    return np.concatenate([v, a, np.zeros(len(x_star) - 2 * n)])


@pytest.mark.parametrize(("on_mass", "cubic"), [(False, False), (True, True)])
@pytest.mark.parametrize("damping", [Damping("modal", ratio=0.02), Damping("rayleigh", alpha=3.0, beta=1e-4)])
@pytest.mark.parametrize(
    ("inputs", "parameters"),
    [(("tip",), ()), ((), ("E",)), ((), ("rho",)), (("side", "tip"), ("rho", "E")), (("tip",), ("E", "rho"))],
)
def test_F_is_the_jacobian_of_the_augmented_motion(damping, inputs, parameters, on_mass, cubic):
    model = chain_of(damping=damping)
    if cubic:  # as the stiffness of a plate in its thickness
        K = model.stiffness
        third = Newton("E", (0.0, 0.0, 0.0), theta["E"] ** (2 / 3))
        model = replace(
            model,
            stiffness=replace(
                K, terms={"E^3": K.terms["E"]}, coefficients={"E^3": Coefficient((third,), np.eye(4)[3])}
            ),
        )
    if on_mass:  # loads proportional to a density, in part
        model = replace(model, input_slope={"rho": 0.7 * model.input_shape[::-1] / model.reference["rho"]})
    unknowns = unknowns_of(theta, inputs, parameters)
    rng = np.random.default_rng(1)
    x = rng.normal(size=(3, 2 * model.size)) * np.repeat([1e-3, 1.0], model.size)
    u = rng.normal(size=(3, 2)) * 50
    F = linearise(model, unknowns, theta, x, u)
    for s in range(3):
        difference = slopes(lambda z, s=s: augmented_rate(model, unknowns, theta, z, u[s]), model, unknowns, x[s], u[s])
        assert np.all(np.abs(F[s] - difference) <= 2e-6 * np.abs(F[s]).max(axis=0))


def slopes(function, model, unknowns, x, u):
    """Central differences of function(x*) at x and the loads u, in every component of x*."""
    centre = np.zeros(unknowns.size(model))
    centre[: 2 * model.size] = x
    for name, at in zip(unknowns.inputs, unknowns.position(model), strict=False):
        centre[at] = u[model.inputs.index(name)] / unknowns.amplitude[name]
    size = np.where(np.arange(len(centre)) < 2 * model.size, 1e-4 * np.maximum(np.abs(centre), 1e-6), 1e-4)
    return np.transpose([(function(centre + e) - function(centre - e)) / (2 * e.sum()) for e in np.diag(size)])


@pytest.mark.parametrize("models", [{}, {"tip": IntegratedRandomWalk(20.0), "side": Matern(5.0, 2.5)}])
def test_rows_of_every_sensor_are_the_derivative_of_its_reading(models):
    model = chain_of()
    unknowns = Unknowns(("side", "tip"), ("E", "rho"), AMPLITUDE, theta, models)
    rng, n = np.random.default_rng(1), model.size
    x, u = rng.normal(size=(2, 2 * n)) * np.repeat([1e-3, 1.0], n), rng.normal(size=(2, 2)) * 50
    rows, quantity = rng.normal(size=(3, n)), np.array([STRAIN, ACCELERATION, DISPLACEMENT])
    H = measurement_rows(rows, quantity, linearise(model, unknowns, theta, x, u))
    assert H.shape == (2, 3, unknowns.size(model))

    def reading(z):
        q, a = z[:n], augmented_rate(model, unknowns, theta, z, np.zeros(2))[n : 2 * n]
        return np.array([rows[0] @ q, rows[1] @ a, rows[2] @ q])

    for s in range(2):
        largest = np.abs(H[s]).max(axis=1, keepdims=True)
        np.testing.assert_allclose(H[s] / largest, slopes(reading, model, unknowns, x[s], u[s]) / largest, atol=1e-6)


@pytest.mark.parametrize("damping", [Damping("modal", ratio=0.02), Damping("rayleigh", alpha=3.0, beta=1e-4)])
def test_without_the_slope_of_the_damping_the_columns_are_those_that_the_thesis_prints(damping):
    """(5.30) −M⁻¹ K^E q;  (5.32) with (5.34) (1/ρ²)(M^ρ)⁻¹(K q + C q̇ − S u), of a mass that is ρ M^ρ."""
    model = chain_of(damping=damping)
    model = replace(model, mass=replace(model.mass, constant=np.zeros_like(model.mass.constant)))
    unknowns, rng = unknowns_of(theta, ()), np.random.default_rng(1)
    x, u = rng.normal(size=(1, 2 * model.size)), rng.normal(size=(1, 2)) * 50
    q, v = x[0, : model.size], x[0, model.size :]
    M, K, C = model.mass.at(theta), model.stiffness.at(theta), damping_matrix(model, theta)
    printed_E = -np.linalg.solve(M, model.stiffness.terms["E"] @ q)
    inertia = np.linalg.inv(model.mass.terms["rho"]) @ (K @ q + C @ v - model.input_shape @ u[0])
    printed = np.stack([theta["E"] * printed_E, inertia / theta["rho"]], axis=1)
    F = linearise(model, unknowns, theta, x, u, damping_slope=False)[0, model.size : 2 * model.size, -2:]
    np.testing.assert_allclose(F, printed, rtol=1e-9, atol=1e-9 * np.abs(printed).max())


def test_a_factor_of_the_damping_keeps_its_column_without_the_slope_of_others():
    model = chain_of(damping=Damping("modal", ratio=0.02, parameter="d"))
    damped = {**theta, "d": 1.0}
    model = replace(model, reference={**model.reference, "d": 1.0})
    unknowns = Unknowns((), ("d",), AMPLITUDE, damped)
    rng = np.random.default_rng(1)
    x, u = rng.normal(size=(1, 2 * model.size)), np.zeros((1, 2))
    printed, whole = (linearise(model, unknowns, damped, x, u, slope)[0, :, -1] for slope in (False, True))
    np.testing.assert_array_equal(printed, whole)
    C = damping_matrix(model, damped)
    wanted = -np.linalg.solve(model.mass.at(damped), C @ x[0, model.size :])
    np.testing.assert_allclose(printed[model.size : 2 * model.size], wanted, rtol=1e-9)


def test_input_models_enter_F():
    model = chain_of()
    models = {"tip": IntegratedRandomWalk(20.0), "side": Matern(5.0, 2.5)}
    plain = unknowns_of(theta, ("side", "tip"), ("E",))
    smooth = Unknowns(("side", "tip"), ("E",), AMPLITUDE, theta, models)
    rng = np.random.default_rng(1)
    x, u = rng.normal(size=(2, 2 * model.size)), rng.normal(size=(2, 2)) * 50
    F, simple = linearise(model, smooth, theta, x, u), linearise(model, plain, theta, x, u)
    n = 2 * model.size
    kept = np.concatenate([np.arange(n), smooth.position(model)])
    np.testing.assert_array_equal(F[:, :n][:, :, kept], simple[:, :n])
    np.testing.assert_array_equal(F[0, n : n + 3, n : n + 3], rate_matrix(models["side"]))
    np.testing.assert_array_equal(F[0, n + 3 : n + 5, n + 3 : n + 5], rate_matrix(models["tip"]))
    moved = F.copy()
    moved[:, n : n + 3, n : n + 3] = moved[:, n + 3 : n + 5, n + 3 : n + 5] = 0
    assert not moved[:, n:].any()
    assert not F[:, :n, [n + 1, n + 2, n + 4]].any()


def test_without_unknown_parameters_every_instant_gives_the_same_matrix():
    model = chain_of()
    x, u = np.random.default_rng(3).normal(size=(5, 2 * model.size)), np.ones((5, 2))
    F = linearise(model, unknowns_of(theta, ("tip", "side"), ()), theta, x, u)
    assert np.ptp(F, axis=0).max() == 0
    assert linearisation_instants(model, unknowns_of(theta, ("tip",), ()), theta, x, u, 20, 0).tolist() == [0]


def test_instants_are_seeded_and_avoid_where_a_parameter_does_not_act():
    model = chain_of()
    t = np.linspace(0, 1, 1000, endpoint=False)
    x = np.zeros((1000, 2 * model.size))
    x[:, 0] = np.sin(2 * np.pi * t)
    unknowns, u = unknowns_of(theta, (), ("E",)), np.zeros((1000, 2))
    found = linearisation_instants(model, unknowns, theta, x, u, 20, 3)
    assert len(set(found)) == 20
    assert np.all(np.diff(found) > 0)
    assert np.abs(x[found, 0]).min() > 0.45
    assert found.tolist() == linearisation_instants(model, unknowns, theta, x, u, 20, 3).tolist()
    assert found.tolist() != linearisation_instants(model, unknowns, theta, x, u, 20, 4).tolist()
    anywhere = [int(linearisation_instants(model, unknowns, theta, x, u, 1, s, share=0.0)[0]) for s in range(200)]
    assert np.abs(x[anywhere, 0]).min() < 0.2


def test_unknowns_carry_positive_scales_in_the_order_of_the_state():
    unknowns = unknowns_of(theta, ("side", "tip"), ("rho",))
    assert unknowns.names == ("side", "tip", "rho")
    assert unknowns.scale.tolist() == [7.0, 40.0, 7800.0]
    with pytest.raises(ConfigError, match="guess of nu is None"):
        unknowns_of(theta, (), ("nu",))
    with pytest.raises(ConfigError, match=r"amplitude of tip is -1"):
        Unknowns(("tip",), (), {"tip": -1.0}, {})


def test_strain_rows_depend_on_coordinates_only():
    rows = np.arange(6.0).reshape(2, 3)
    H = augment_rows(rows, unknowns_of(theta))
    assert H.shape == (2, 9)
    assert np.array_equal(H[:, :3], rows)
    assert not H[:, 3:].any()


def system(model, theta, inputs, parameters, *, gauges=6, seed=0, side=0.0):
    unknowns = Unknowns(inputs, parameters, AMPLITUDE, theta)
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(1, 2 * model.size))
    F = linearise(model, unknowns, theta, x, np.array([[30.0, side]]))[0]
    return F, augment_rows(rng.normal(size=(gauges, model.size)), unknowns), unknowns.names


def test_load_modulus_and_density_together_are_undetectable_without_a_known_scale():
    F, H, names = system(chain_of(ground=0.0, extra=0.0), theta, ("tip",), ("E", "rho"))
    lost = undetectable_directions(F, H)
    assert lost.shape == (13, 1)
    np.testing.assert_allclose(lost[-3:, 0] / lost[-1, 0], [30.0 / 40.0, 1.0, 1.0], rtol=1e-8)
    assert np.abs(lost[:10]).max() < 1e-8 * np.abs(lost).max()
    assert undetectable_in_words(lost, names).startswith("tip, E and rho together: fix or measure one")


def test_balanced_units_do_not_depend_on_those_of_the_unknowns():
    F, _, _ = system(chain_of(), theta, ("tip", "side"), ("E", "rho"), side=9.0)
    here = balanced_units(F)
    d = np.ones(len(F))
    d[-4:] = 10.0 ** np.random.default_rng(2).uniform(-6, 6, 4)
    np.testing.assert_allclose(balanced_units(F / d[:, None] * d) * d, here, rtol=1e-12)
    balanced = F / here[:, None] * here
    norms = np.linalg.norm(balanced, axis=0)
    assert norms.max() < 30 * norms.min()


@pytest.mark.parametrize("known", ["ground", "extra", "load"])
def test_a_known_stiffness_mass_or_load_makes_them_detectable(known):
    model = chain_of(ground=3e6 if known == "ground" else 0.0, extra=0.7 if known == "extra" else 0.0)
    F, H, _ = system(model, theta, ("tip",), ("E", "rho"), side=20.0 if known == "load" else 0.0)
    assert undetectable_directions(F, H).shape[1] == 0


@pytest.mark.parametrize("gauges", [0, 1, 2, 3])
def test_fewer_gauges_than_unknowns_lose_as_many_directions(gauges):
    F, H, _ = system(chain_of(), theta, ("tip", "side"), ("E",), gauges=gauges)
    lost = undetectable_directions(F, H)
    assert lost.shape[1] == 3 - gauges
    assert least_gauges(marginal_modes(F)) == 3
    scale = np.abs(F) @ np.abs(lost)
    assert np.all(np.abs(F @ lost) <= 1e-9 * scale.max(initial=0.0))
    if gauges:
        assert np.all(np.abs(H @ lost) <= 1e-9 * (np.abs(H) @ np.abs(lost)).max(initial=0.0))


@pytest.mark.parametrize("power", [-12, 0, 12])
def test_detectability_does_not_depend_on_units(power):
    rng = np.random.default_rng(7)
    for ground, lost in ((0.0, 1), (3e6, 0)):
        F, H, _ = system(chain_of(ground=ground, extra=0.0), theta, ("tip",), ("E", "rho"))
        d = 10.0 ** rng.uniform(-6, 6, len(F))
        rows = 10.0**power * 10.0 ** rng.uniform(-3, 3, len(H))
        assert undetectable_directions(F / d[:, None] * d, rows[:, None] * H * d).shape[1] == lost


def test_an_integrated_unknown_needs_its_chain_and_only_one_gauge():
    # double integrator behind a stable state: two marginal states in one Jordan block
    F = np.array([[-3.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    modes = marginal_modes(F)
    assert modes.eigenvalue == (0,)
    assert least_gauges(modes) == 1
    assert undetectable_directions(F, np.array([[1.0, 0.0, 0.0]])).shape[1] == 0
    assert undetectable_directions(F, np.array([[0.0, 0.0, 1.0]])).shape[1] == 1


def test_only_unstable_states_must_be_detectable():
    F = np.diag([-1.0, 2.0])
    assert undetectable_directions(F, np.array([[0.0, 1.0]])).shape[1] == 0
    assert undetectable_directions(F, np.array([[1.0, 0.0]])).shape[1] == 1


def test_undamped_structure_needs_one_gauge_for_all_modes():
    omega = np.geomspace(1.0, 300.0, 12)
    F = np.block([[np.zeros((12, 12)), np.diag(omega)], [-np.diag(omega), np.zeros((12, 12))]])
    row = np.concatenate([np.ones(12), np.zeros(12)])[None]
    assert undetectable_directions(F, row).shape[1] == 0
    row[0, 5] = 0.0
    lost = undetectable_directions(F, row)
    assert lost.shape[1] == 2
    assert np.abs(np.delete(lost, [5, 17], axis=0)).max() < 1e-9
    twin = np.diag(np.r_[omega[:11], omega[10]])
    F = np.block([[np.zeros((12, 12)), twin], [-twin, np.zeros((12, 12))]])
    assert least_gauges(marginal_modes(F)) == 2
    assert undetectable_directions(F, np.ones((1, 24)) * np.r_[np.ones(12), np.zeros(12)]).shape[1] == 2


def test_raw_condition_is_of_the_thesis_and_depends_on_units():
    model = chain_of()
    F, H, names = system(model, theta, (), ("E",))
    x = np.random.default_rng(0).normal(size=2 * model.size)
    omega = np.sqrt(np.diag(model.stiffness.at(theta)))
    energy = np.linalg.norm(np.concatenate([omega, np.ones(model.size)]) * x)
    strain = np.abs(H[:, : model.size] @ x[: model.size]).max()
    found = observability(
        F,
        H / strain,
        names=names,
        frequency=omega,
        state_amplitude=energy,
        raw_scale=np.array([theta["E"]]),
        raw_rows=H,
    )
    F[:, -1] /= theta["E"]
    sigma = np.linalg.svd(np.vstack([F, H]), compute_uv=False)
    np.testing.assert_allclose(found.condition_raw, sigma[0] / sigma[-1], rtol=1e-6)
    assert found.condition_raw > 1e6 * found.condition


def test_scaled_condition_does_not_depend_on_the_units_of_mass_length_or_time():
    # coordinates are √kg·m: a change of units multiplies states, time and strain noise by common factors
    F, H, _ = system(chain_of(), theta, ("tip",), ("E",))
    omega = np.sqrt(np.diag(chain_of().stiffness.at(theta)))
    n = len(omega)
    common = {"names": ("tip", "E"), "raw_scale": np.ones(2)}
    here = observability(F, H / 2.0, frequency=omega, state_amplitude=3e3, **common)
    length, time = 1e3, 1e-2
    d = np.concatenate([np.full(n, length), np.full(n, length / time), np.ones(2)])
    there = observability(
        F * d[:, None] / d / time,
        H / d * 7.0 / 14.0,
        frequency=omega / time,
        state_amplitude=3e3 * length / time,
        **common,
    )
    np.testing.assert_allclose(there.condition, here.condition, rtol=1e-8)
    np.testing.assert_allclose(there.sigma_min, here.sigma_min, rtol=1e-8)


def test_detectability_with_smooth_load():
    model = chain_of()
    x, u = np.random.default_rng(3).normal(size=(1, 2 * model.size)), np.ones((1, 2))
    for inputs, parameters in ((("tip",), ()), (("tip", "side"), ("E",))):
        counts = []
        for smooth in ({}, {"tip": IntegratedRandomWalk(20.0)}, {"tip": Oscillator(20.0)}):
            unknowns = Unknowns(inputs, parameters, {"tip": 40.0, "side": 7.0}, theta, smooth)
            F = linearise(model, unknowns, theta, x, u)[0]
            modes = marginal_modes(F)
            assert set(modes.eigenvalue) <= {0}
            for V in modes.vectors:
                relative = np.abs(F @ V) / modes.scale[:, None] / np.linalg.norm(F / modes.scale[:, None] * modes.scale)
                assert relative.max() < 1e-12 * np.abs(V / modes.scale[:, None]).max()
            counts.append(least_gauges(modes))
        assert counts == [counts[0], counts[0], counts[0] - 1]


def along(chain_of, theta, quantity, inputs=(), parameters=("E",), still=False, channels=1):
    """Columns of a system along 400 instants of a motion under two tones, or of one at rest under a constant load."""
    model = chain_of()
    n, unknowns = model.size, Unknowns(inputs, parameters, AMPLITUDE, theta)
    t = 1e-3 * np.arange(400)
    tones = np.ones_like(t) if still else np.sin(2 * np.pi * 12.5 * t) + np.sin(2 * np.pi * 32.5 * t)
    rng = np.random.default_rng(0)
    x = np.outer(tones, rng.normal(size=2 * n)) * np.repeat([1.0, 0.0 if still else 1.0], n)
    u = np.outer(tones, [30.0, 9.0])
    F = linearise(model, unknowns, theta, x, u)
    H = measurement_rows(rng.normal(size=(channels, n)), np.full(channels, quantity), F)
    at, loads = F.shape[-1] - len(parameters), 2 * n + np.arange(len(inputs))
    motion = slice(2 * n)
    found = unseen_along(
        F[0, motion, motion],
        F[0, motion, loads].T,
        H[0, :, motion],
        H[0][:, loads],
        F[:, motion, at:],
        H[:, :, at:],
        1e-3,
    )
    frozen = undetectable_directions(F[7], H[7])
    return frozen, *found


def test_accelerometer_detects_modulus_along_a_motion():
    frozen, _, hidden = along(chain_of, theta, ACCELERATION)
    assert frozen.shape[1] == 1
    assert hidden.shape[1] == 0
    _, _, hidden = along(chain_of, theta, ACCELERATION, still=True)
    np.testing.assert_array_equal(hidden, [[1.0]])


@pytest.mark.parametrize("channels", [1, 2, 3])
def test_modulus_with_free_load_needs_one_more_channel(channels):
    _, loads, hidden = along(chain_of, theta, STRAIN, ("tip", "side"), channels=channels)
    assert hidden.shape[1] == (channels < 3)
    assert np.all(loads > 0)


def test_difference_of_equivalent_parameters_is_undetectable():
    model = chain_of()
    F = -np.eye(2 * model.size)
    driven = np.random.default_rng(1).normal(size=(64, len(F), 1)) * [1.0, -2.0]
    nothing = np.zeros((len(F), 0)), np.eye(len(F)), np.zeros((len(F), 0))
    _, hidden = unseen_along(F, *nothing, driven, np.zeros_like(driven), 0.1)
    np.testing.assert_allclose(hidden / hidden[1], [[2.0], [1.0]], rtol=1e-6)
