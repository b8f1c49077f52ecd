"""F* is the derivative of the augmented equation of motion, and nothing but that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import sqrtm

from strainsight.augmentation.input_models import IntegratedRandomWalk, Matern, rate_matrix
from strainsight.augmentation.linearisation import Unknowns, augment_rows, linearisation_instants, linearise
from strainsight.errors import ConfigError
from strainsight.fem.affine import Coefficient, Newton
from strainsight.rom.model import Damping, damping_matrix

AMPLITUDE = {"tip": 40.0, "side": 7.0}


def unknowns_of(theta, inputs=("tip",), parameters=("E", "rho")):
    return Unknowns(inputs, parameters, AMPLITUDE, theta)


def augmented_rate(model, unknowns, theta, x_star, known_u):
    """ẋ* written out, with the damping from a matrix square root."""
    n = model.size
    q, v, rest = x_star[:n], x_star[n : 2 * n], x_star[2 * n :]
    u = known_u.copy()
    for i, name in enumerate(unknowns.inputs):
        u[model.inputs.index(name)] = unknowns.amplitude[name] * rest[i]
    value = dict(theta)
    for i, name in enumerate(unknowns.parameters):
        value[name] = unknowns.guess[name] * np.exp(rest[len(unknowns.inputs) + i])
    M = model.mass.constant + model.mass.terms["rho"] * value["rho"]
    ((label, slope),) = model.stiffness.terms.items()
    K = model.stiffness.constant + slope * (value["E"] if label == "E" else value["E"] ** 3 / theta["E"] ** 2)
    if model.damping.kind == "modal":
        C = 2 * model.damping.ratio * M @ sqrtm(np.linalg.solve(M, K)).real
    else:
        C = model.damping.alpha * M + model.damping.beta * K
    S = model.input_shape + model.input_slope.get("rho", 0.0) * (value["rho"] - model.reference["rho"])
    a = np.linalg.solve(M, S @ u - C @ v - K @ q)
    return np.concatenate([v, a, np.zeros(len(rest))])


@pytest.mark.parametrize(("on_mass", "cubic"), [(False, False), (True, True)])
@pytest.mark.parametrize("damping", [Damping("modal", ratio=0.02), Damping("rayleigh", alpha=3.0, beta=1e-4)])
@pytest.mark.parametrize(
    ("inputs", "parameters"),
    [(("tip",), ()), ((), ("E",)), ((), ("rho",)), (("side", "tip"), ("rho", "E")), (("tip",), ("E", "rho"))],
)
def test_F_is_the_jacobian_of_the_augmented_motion(chain_of, theta, damping, inputs, parameters, on_mass, cubic):
    model = chain_of(damping=damping)
    if cubic:  # as the stiffness of a plate in its thickness
        K = model.stiffness
        third = Newton("E", (0.0, 0.0, 0.0), theta["E"] ** (2 / 3))
        model = replace(
            model, stiffness=replace(K, terms={"E^3": K.terms["E"]}, coefficients={"E^3": Coefficient((third,), np.eye(4)[3])})
        )
    if on_mass:  # loads proportional to a density, in part
        model = replace(model, input_slope={"rho": 0.7 * model.input_shape[::-1] / model.reference["rho"]})
    unknowns = unknowns_of(theta, inputs, parameters)
    rng = np.random.default_rng(1)
    x = rng.normal(size=(3, 2 * model.size)) * np.repeat([1e-3, 1.0], model.size)
    u = rng.normal(size=(3, 2)) * 50
    F = linearise(model, unknowns, theta, x, u)
    for s in range(3):
        hidden = [u[s, model.inputs.index(i)] / AMPLITUDE[i] for i in inputs]
        centre = np.concatenate([x[s], hidden, np.zeros(len(parameters))])
        difference = np.empty_like(F[s])
        for j in range(len(centre)):
            step = np.zeros_like(centre)
            step[j] = 1e-4 if j >= 2 * model.size else 1e-4 * max(abs(centre[j]), 1e-6)
            plus, minus = (augmented_rate(model, unknowns, theta, centre + sign * step, u[s]) for sign in (1, -1))
            difference[:, j] = (plus - minus) / (2 * step[j])
        assert np.all(np.abs(F[s] - difference) <= 2e-6 * np.abs(F[s]).max(axis=0))


@pytest.mark.parametrize("damping", [Damping("modal", ratio=0.02), Damping("rayleigh", alpha=3.0, beta=1e-4)])
def test_without_the_slope_of_the_damping_the_columns_are_those_that_the_thesis_prints(chain_of, theta, damping):
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


def test_a_factor_of_the_damping_keeps_its_column_without_the_slope_of_others(chain_of, theta):
    """Its slope is the damping itself, which the thesis does not estimate: −M⁻¹ C q̇ in either case."""
    model = chain_of(damping=Damping("modal", ratio=0.02, parameter="d"))
    theta = {**theta, "d": 1.0}
    model = replace(model, reference={**model.reference, "d": 1.0})
    unknowns = Unknowns((), ("d",), AMPLITUDE, theta)
    rng = np.random.default_rng(1)
    x, u = rng.normal(size=(1, 2 * model.size)), np.zeros((1, 2))
    printed, whole = (linearise(model, unknowns, theta, x, u, slope)[0, :, -1] for slope in (False, True))
    np.testing.assert_array_equal(printed, whole)
    C = damping_matrix(model, theta)
    wanted = -np.linalg.solve(model.mass.at(theta), C @ x[0, model.size :])
    np.testing.assert_allclose(printed[model.size : 2 * model.size], wanted, rtol=1e-9)


def test_input_models_stand_in_F_as_they_move(chain_of, theta):
    """The rows of ζ are A_u, the motion feels ũ alone, and nothing else changes."""
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


def test_without_unknown_parameters_every_instant_gives_the_same_matrix(chain_of, theta):
    model = chain_of()
    x, u = np.random.default_rng(3).normal(size=(5, 2 * model.size)), np.ones((5, 2))
    F = linearise(model, unknowns_of(theta, ("tip", "side"), ()), theta, x, u)
    assert np.ptp(F, axis=0).max() == 0
    assert linearisation_instants(model, unknowns_of(theta, ("tip",), ()), theta, x, u, 20, 0).tolist() == [0]


def test_instants_are_seeded_and_avoid_where_a_parameter_does_not_act(chain_of, theta):
    model = chain_of()
    t = np.linspace(0, 1, 1000, endpoint=False)
    x = np.zeros((1000, 2 * model.size))
    x[:, 0] = np.sin(2 * np.pi * t)
    unknowns, u = unknowns_of(theta, (), ("E",)), np.zeros((1000, 2))
    found = linearisation_instants(model, unknowns, theta, x, u, 20, 3)
    assert len(set(found)) == 20
    assert np.all(np.diff(found) > 0)
    # the damping force moves the threshold by 2ζ at most
    assert np.abs(x[found, 0]).min() > 0.45
    assert found.tolist() == linearisation_instants(model, unknowns, theta, x, u, 20, 3).tolist()
    assert found.tolist() != linearisation_instants(model, unknowns, theta, x, u, 20, 4).tolist()
    anywhere = [int(linearisation_instants(model, unknowns, theta, x, u, 1, s, share=0.0)[0]) for s in range(200)]
    assert np.abs(x[anywhere, 0]).min() < 0.2


def test_a_structure_at_rest_tells_nothing_of_its_modulus(chain_of, theta):
    model = chain_of()
    with pytest.raises(ConfigError, match="never depends on E"):
        linearisation_instants(
            model, unknowns_of(theta, (), ("E",)), theta, np.zeros((5, 2 * model.size)), np.zeros((5, 2)), 2, 0
        )


def test_unknowns_carry_positive_scales_in_the_order_of_the_state(theta):
    unknowns = unknowns_of(theta, ("side", "tip"), ("rho",))
    assert unknowns.names == ("side", "tip", "rho")
    assert unknowns.scale.tolist() == [7.0, 40.0, 7800.0]
    with pytest.raises(ConfigError, match="guess of nu is None"):
        unknowns_of(theta, (), ("nu",))
    with pytest.raises(ConfigError, match=r"amplitude of tip is -1"):
        Unknowns(("tip",), (), {"tip": -1.0}, {})


def test_strain_rows_see_only_the_coordinates(theta):
    rows = np.arange(6.0).reshape(2, 3)
    H = augment_rows(rows, unknowns_of(theta))
    assert H.shape == (2, 9)
    assert np.array_equal(H[:, :3], rows)
    assert not H[:, 3:].any()
