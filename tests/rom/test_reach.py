"""How far a modulus of a reduced body may be moved, beside statics of the full model."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.fem.affine import Parameter
from strainsight.fem.model import build_model
from strainsight.rom.craig_bampton import craig_bampton
from strainsight.rom.reach import OFF, excess, reach
from strainsight.rom.residual_vectors import inertia_loads

from .bars import TIP, bar, dense, pick

MODULI = (Parameter("E1", "youngs_modulus", (1,), 2.1e11), Parameter("E2", "youngs_modulus", (2,), 7.0e10))
REFERENCE = {p.name: p.reference for p in MODULI}


def reduced(moduli, modes=0):
    model = build_model(bar(clamped=True), moduli)
    return model, craig_bampton(model, [TIP], modes=modes, reference={p.name: p.reference for p in moduli})


@pytest.mark.parametrize("theta", [{"E1": 4.2e11}, {"E2": 3.5e10}, {"E1": 1.0e11, "E2": 9e10}])
def test_the_excess_is_that_of_the_flexibility_at_the_interface(theta):
    """max vᵀ(S* − S)v/vᵀS*v = 1 − 1/max eig(S⁻¹S*), or that of the body's own inertia with it held."""
    model, body = reduced(MODULI)
    theta = REFERENCE | theta
    B = pick(model, TIP)
    exact = B @ np.linalg.solve(dense(model.stiffness.at(theta)), B.T)
    found = np.linalg.inv(body.stiffness.at(theta))[:6, :6]
    interfaces = 1 - 1 / np.linalg.eigvals(exact @ np.linalg.inv(found)).real.max()
    held = B.any(axis=0)
    K, H = dense(model.stiffness.at(theta))[np.ix_(~held, ~held)], body.basis[~held, 6:]
    F = inertia_loads(model)[~held, :3]
    r = H.T @ K @ H
    ratio = np.linalg.solve(F.T @ np.linalg.solve(K, F), F.T @ H @ np.linalg.solve(r, H.T @ F))
    inertia = 1 - np.linalg.eigvals(ratio).real.min()
    assert excess(model, body, [TIP], theta) == pytest.approx(max(interfaces, inertia), rel=1e-6)


@pytest.mark.parametrize("modes", [0, 3])
def test_within_its_reach_statics_are_right_to_one_per_cent(modes):
    model, body = reduced(MODULI, modes)
    for name, (low, high) in reach(model, body, [TIP], REFERENCE).items():
        own = REFERENCE[name]
        assert own / 2 <= low < own < high <= 2 * own
        for value in (low, high):
            off = excess(model, body, [TIP], {**REFERENCE, name: value})
            assert off <= 1.1 * OFF
            if 0.51 * own < value < 1.99 * own:
                assert off > 0.5 * OFF


def test_rigid_motions_of_a_free_body_take_no_work():
    """With one interface nothing but its own inertia bends it; at the reference nothing is off."""
    model = build_model(bar(), MODULI, supported=False)
    body = craig_bampton(model, [TIP], modes=2, reference=REFERENCE)
    assert excess(model, body, [TIP], REFERENCE) < 1e-9
    assert 1e-4 < excess(model, body, [TIP], {"E1": 4.2e11, "E2": 7e10}) < 0.5


def test_one_modulus_of_the_whole_may_have_any_value():
    model, body = reduced((Parameter("E", "youngs_modulus", (1, 2), 2.1e11),))
    assert reach(model, body, [TIP], {"E": 2.1e11}) == {"E": (0.0, np.inf)}
    assert excess(model, body, [TIP], {"E": 9e11}) < 1e-9
