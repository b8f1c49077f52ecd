"""What can be known: rank by exact constructions, conditioning by invariance."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.augmentation.input_models import IntegratedRandomWalk, Oscillator
from strainsight.augmentation.linearisation import Unknowns, augment_rows, linearise
from strainsight.augmentation.measurement import measurement_rows
from strainsight.augmentation.observability import (
    balanced_units,
    least_gauges,
    marginal_modes,
    observability,
    undetectable_directions,
    undetectable_in_words,
    unseen_along,
)
from strainsight.gauges.candidates import ACCELERATION, STRAIN

AMPLITUDE = {"tip": 40.0, "side": 7.0}


def system(model, theta, inputs, parameters, *, gauges=6, seed=0, side=0.0):
    unknowns = Unknowns(inputs, parameters, AMPLITUDE, theta)
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(1, 2 * model.size))
    F = linearise(model, unknowns, theta, x, np.array([[30.0, side]]))[0]
    return F, augment_rows(rng.normal(size=(gauges, model.size)), unknowns), unknowns.names


def test_load_modulus_and_density_together_are_undetectable_without_a_known_scale(chain_of, theta):
    F, H, names = system(chain_of(ground=0.0, extra=0.0), theta, ("tip",), ("E", "rho"))
    lost = undetectable_directions(F, H)
    assert lost.shape == (13, 1)
    np.testing.assert_allclose(lost[-3:, 0] / lost[-1, 0], [30.0 / 40.0, 1.0, 1.0], rtol=1e-8)
    assert np.abs(lost[:10]).max() < 1e-8 * np.abs(lost).max()
    assert undetectable_in_words(lost, names).startswith("tip, E and rho together: fix one")


def test_balanced_units_do_not_depend_on_those_of_the_unknowns(chain_of, theta):
    F, _, _ = system(chain_of(), theta, ("tip", "side"), ("E", "rho"), side=9.0)
    here = balanced_units(F)
    d = np.ones(len(F))
    d[-4:] = 10.0 ** np.random.default_rng(2).uniform(-6, 6, 4)
    np.testing.assert_allclose(balanced_units(F / d[:, None] * d) * d, here, rtol=1e-12)
    balanced = F / here[:, None] * here
    norms = np.linalg.norm(balanced, axis=0)
    assert norms.max() < 30 * norms.min()


@pytest.mark.parametrize("known", ["ground", "extra", "load"])
def test_a_known_stiffness_mass_or_load_makes_them_detectable(chain_of, theta, known):
    model = chain_of(ground=3e6 if known == "ground" else 0.0, extra=0.7 if known == "extra" else 0.0)
    F, H, _ = system(model, theta, ("tip",), ("E", "rho"), side=20.0 if known == "load" else 0.0)
    assert undetectable_directions(F, H).shape[1] == 0


@pytest.mark.parametrize("gauges", [0, 1, 2, 3])
def test_fewer_gauges_than_unknowns_lose_as_many_directions(chain_of, theta, gauges):
    F, H, _ = system(chain_of(), theta, ("tip", "side"), ("E",), gauges=gauges)
    lost = undetectable_directions(F, H)
    assert lost.shape[1] == 3 - gauges
    assert least_gauges(marginal_modes(F)) == 3
    scale = np.abs(F) @ np.abs(lost)
    assert np.all(np.abs(F @ lost) <= 1e-9 * scale.max(initial=0.0))
    if gauges:
        assert np.all(np.abs(H @ lost) <= 1e-9 * (np.abs(H) @ np.abs(lost)).max(initial=0.0))


@pytest.mark.parametrize("power", [-12, 0, 12])
def test_detectability_does_not_depend_on_units(chain_of, theta, power):
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


def test_an_unstable_state_must_be_seen_and_a_stable_one_need_not():
    F = np.diag([-1.0, 2.0])
    assert undetectable_directions(F, np.array([[0.0, 1.0]])).shape[1] == 0
    assert undetectable_directions(F, np.array([[1.0, 0.0]])).shape[1] == 1


def test_an_undamped_structure_of_wide_band_needs_one_gauge_that_sees_all_modes():
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


def pbh(model, theta, inputs, parameters, scale):
    F, H, names = system(model, theta, inputs, parameters)
    x = np.random.default_rng(0).normal(size=2 * model.size)
    omega = np.sqrt(np.diag(model.stiffness.at(theta)))
    energy = np.linalg.norm(np.concatenate([omega, np.ones(model.size)]) * x)
    strain = np.abs(H[:, : model.size] @ x[: model.size]).max()
    found = observability(
        F, H, names=names, frequency=omega, state_amplitude=energy, largest_strain=strain, raw_scale=np.array(scale)
    )
    return F, H, found


def test_condition_of_an_exact_null_vector_is_rounding_and_is_named(chain_of, theta):
    scale = (40.0, theta["E"], theta["rho"])
    _, _, lost = pbh(chain_of(ground=0.0, extra=0.0), theta, ("tip",), ("E", "rho"), scale)
    assert lost.condition > 1e12
    assert lost.null_direction.startswith("tip, E and rho together: fix one")
    _, _, told = pbh(chain_of(ground=1e8, extra=30.0), theta, (), ("E", "rho"), scale[1:])
    assert told.condition < 1e3
    assert told.null_direction == ""


def test_raw_condition_is_of_the_thesis_and_depends_on_units(chain_of, theta):
    F, H, found = pbh(chain_of(), theta, (), ("E",), (theta["E"],))
    F[:, -1] /= theta["E"]
    sigma = np.linalg.svd(np.vstack([F, H]), compute_uv=False)
    np.testing.assert_allclose(found.condition_raw, sigma[0] / sigma[-1], rtol=1e-6)
    assert found.condition_raw > 1e6 * found.condition


def test_scaled_condition_does_not_depend_on_the_units_of_mass_length_or_time(chain_of, theta):
    # coordinates are √kg·m: a change of units multiplies states, time and strain noise by common factors
    F, H, _ = system(chain_of(), theta, ("tip",), ("E",))
    omega = np.sqrt(np.diag(chain_of().stiffness.at(theta)))
    n = len(omega)
    common = {"names": ("tip", "E"), "raw_scale": np.ones(2)}
    here = observability(F, H, frequency=omega, state_amplitude=3e3, largest_strain=2.0, **common)
    length, time = 1e3, 1e-2
    d = np.concatenate([np.full(n, length), np.full(n, length / time), np.ones(2)])
    there = observability(
        F * d[:, None] / d / time,
        H / d * 7.0,
        frequency=omega / time,
        state_amplitude=3e3 * length / time,
        largest_strain=14.0,
        **common,
    )
    np.testing.assert_allclose(there.condition, here.condition, rtol=1e-8)
    np.testing.assert_allclose(there.sigma_min, here.sigma_min, rtol=1e-8)


def test_what_a_smooth_load_leaves_to_be_detected(chain_of, theta):
    """An integrated walk has a Jordan block at zero with the one eigenvector of a walk; a stationary load decays by itself."""
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
        F[0, motion, motion], F[0, motion, loads].T, H[0, :, motion], H[0][:, loads], F[:, motion, at:], H[:, :, at:], 1e-3
    )
    frozen = undetectable_directions(F[7], H[7])
    return frozen, *found


def test_an_accelerometer_tells_a_modulus_along_a_motion_and_at_no_instant(chain_of, theta):
    frozen, _, hidden = along(chain_of, theta, ACCELERATION)
    assert frozen.shape[1] == 1
    assert hidden.shape[1] == 0
    _, _, hidden = along(chain_of, theta, ACCELERATION, still=True)
    np.testing.assert_array_equal(hidden, [[1.0]])


@pytest.mark.parametrize("channels", [1, 2, 3])
def test_a_modulus_beside_a_free_load_takes_a_channel_more_than_loads(chain_of, theta, channels):
    _, loads, hidden = along(chain_of, theta, STRAIN, ("tip", "side"), channels=channels)
    assert hidden.shape[1] == (channels < 3)
    assert np.all(loads > 0)


def test_of_parameters_that_act_alike_their_difference_is_hidden(chain_of, theta):
    model = chain_of()
    F = -np.eye(2 * model.size)
    driven = np.random.default_rng(1).normal(size=(64, len(F), 1)) * [1.0, -2.0]
    nothing = np.zeros((len(F), 0)), np.eye(len(F)), np.zeros((len(F), 0))
    _, hidden = unseen_along(F, *nothing, driven, np.zeros_like(driven), 0.1)
    np.testing.assert_allclose(hidden / hidden[1], [[2.0], [1.0]], rtol=1e-6)
