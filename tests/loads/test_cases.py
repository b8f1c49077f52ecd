"""The seven cases: an exact null vector by its name, orders of magnitude by the excitation, none by the units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import ConfigError
from strainsight.fem.affine import AffineOperator
from strainsight.loads.input_models import Unknowns
from strainsight.loads.linearisation import Sensed, linearisation_instants, linearise
from strainsight.loads.observability import cases
from strainsight.rom.model import damping_matrix

from .conftest import chain_of

SEVEN = ("input", "E", "rho", "input+E", "input+rho", "E+rho", "input+E+rho")
STRAIN, ACCELERATION, DISPLACEMENT = 0, 1, 2


def matrices(model):
    at = model.reference
    return model.mass.at(at), model.stiffness.at(at), damping_matrix(model, at)


def motion(model, ratio, *, steps=400):
    """Steady response to 1 kN at the tip with `ratio` times the first frequency: x (steps, 2n), u (steps, 2)."""
    M, K, C = matrices(model)
    omega = ratio * np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real.min())
    t = np.arange(steps) / steps * 2 * np.pi / omega
    gain = np.linalg.solve(K - omega**2 * M + 1j * omega * C, model.input_shape[:, 0] * 1e3)
    q = gain * np.exp(1j * omega * t)[:, None]
    u = np.zeros((steps, 2))
    u[:, 0] = 1e3 * np.sin(omega * t)
    return np.hstack([q.imag, (1j * omega * q).imag]), u


def sensors(model, x, u, *, seed=0, accelerometers=0):
    """Eight strain gauges and some accelerometers: rows, quantity and the largest reading of each quantity."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(8 + accelerometers, model.size))
    quantity = np.repeat([STRAIN, ACCELERATION], [8, accelerometers])
    n = model.size
    M, K, C = matrices(model)
    a = np.linalg.solve(M, (u @ model.input_shape.T - x[:, n:] @ C - x[:, :n] @ K).T).T
    reading = np.where(quantity == STRAIN, np.abs(x[:, :n] @ rows.T).max(axis=0), np.abs(a @ rows.T).max(axis=0))
    largest = np.array([reading[quantity == kind].max() for kind in quantity])
    return {"sensed": Sensed(rows, quantity), "largest": largest}


def ask(model, x, u, given, **changes):
    settings = (
        {
            "inputs": ("tip",),
            "moduli": ("E",),
            "densities": ("rho",),
            "amplitude": {"tip": 1e3},
            "guess": model.reference,
            "instants": 15,
            "seed": 0,
        }
        | given
        | changes
    )
    return {case.label: case for case in cases(model, model.reference, x, u, **settings)}


def at(model, ratio, **changes):
    x, u = motion(model, ratio)
    return ask(model, x, u, sensors(model, x, u), **changes)


def test_cases_follow_the_order_of_the_tables():
    model = chain_of()
    found = at(model, 0.5)
    assert tuple(found) == SEVEN
    assert found["input+E+rho"].unknowns == ("tip", "E", "rho")
    assert all(case.result.condition < 1e9 and case.instants == 15 for label, case in found.items() if label != "input")
    assert found["input"].instants == 1
    assert tuple(at(model, 0.5, densities=())) == ("input", "E", "input+E")
    assert tuple(at(model, 0.5, inputs=(), moduli=())) == ("rho",)
    assert at(model, 0.5, inputs=(), moduli=(), densities=()) == {}
    both = at(model, 0.5, inputs=("tip", "side"), amplitude={"tip": 1e3, "side": 5.0})
    assert both["input+rho"].unknowns == ("tip", "side", "rho")


@pytest.mark.parametrize("ratio", [0.02, 0.9])
def test_load_modulus_and_density_of_one_material_are_an_exact_null_vector_and_named(ratio):
    found = at(chain_of(ground=0.0, extra=0.0), ratio)
    assert found["input+E+rho"].result.condition > 1e12
    assert found["input+E+rho"].result.sigma_min < 1e-12
    expected = "tip, E and rho together: fix or measure one of these unknowns"
    assert found["input+E+rho"].result.null_direction == expected
    assert all(case.result.condition < 1e8 for label, case in found.items() if label != "input+E+rho")
    assert at(chain_of(), ratio)["input+E+rho"].result.condition < 1e6


@pytest.mark.parametrize("ratio", [1 / 20, 1 / 50])
def test_slow_load_leaves_modulus_and_density_unobservable(ratio):
    slow, near = (at(chain_of(ground=0.0, extra=0.0), r) for r in (ratio, 0.9))
    condition = {label: (slow[label].result.condition, near[label].result.condition) for label in SEVEN}

    def worse(label, which):
        one, other = label.split("+")
        return condition[label][which] / max(condition[one][which], condition[other][which])

    assert worse("input+E", 0) > 1000 > 100 > worse("input+E", 1)
    assert slow["input+E"].result.null_direction.startswith("tip and E together")
    # the density acts by (ω/ω₁)² of the load: it is badly known by itself, and not much worse with another
    assert condition["rho"][0] > 100 * condition["rho"][1]
    for label in ("input+rho", "E+rho"):
        assert 1 < worse(label, 0) < 20
        assert worse(label, 1) < 100
        assert condition[label][0] > 40 * condition[label][1]


def test_units_of_force_and_modulus_change_the_raw_number_only():
    model = chain_of()
    kilo, mega = 1e3, 1e6
    stiffness = AffineOperator(model.stiffness.constant, {"E": model.stiffness.terms["E"] * mega})
    reference = dict(model.reference) | {"E": model.reference["E"] / mega}
    other = replace(model, stiffness=stiffness, input_shape=model.input_shape * kilo, reference=reference)
    x, u = motion(model, 0.5)
    given = sensors(model, x, u, accelerometers=2)
    here = ask(model, x, u, given)
    there = ask(other, x, u / kilo, given, amplitude={"tip": 1.0})
    for label in SEVEN:
        a, b = here[label], there[label]
        np.testing.assert_allclose(b.result.condition, a.result.condition, rtol=1e-6)
        np.testing.assert_allclose(b.result.sigma_min, a.result.sigma_min, rtol=1e-6)
        if label not in ("rho", "input+rho"):  # ruled by the density, whose unit stays
            assert not 0.5 < b.result.condition_raw / a.result.condition_raw < 2


def test_a_gauge_that_reads_in_other_units_changes_the_raw_number_only():
    model = chain_of()
    x, u = motion(model, 0.5)
    given = sensors(model, x, u, accelerometers=3)
    rows, quantity = given["sensed"].rows, given["sensed"].quantity
    units = np.where(quantity == STRAIN, 1e6, 1 / 9.81)  # µm/m and g
    other = given | {"sensed": Sensed(rows * units[:, None], quantity), "largest": given["largest"] * units}
    here, there = ask(model, x, u, given), ask(model, x, u, other)
    for label in SEVEN:
        np.testing.assert_allclose(there[label].result.condition, here[label].result.condition, rtol=1e-6)
        assert there[label].result.condition_raw != pytest.approx(here[label].result.condition_raw, rel=0.1)


def test_an_accelerometer_leaves_the_null_space():
    model = chain_of(ground=0.0, extra=0.0)
    x, u = motion(model, 0.9)
    bare, with_them = (ask(model, x, u, sensors(model, x, u, accelerometers=count)) for count in (0, 5))
    assert with_them["input+E+rho"].result.sigma_min < 1e-12
    assert with_them["input+E+rho"].result.null_direction == bare["input+E+rho"].result.null_direction
    # at λ = 0 nothing accelerates: they add to what F* says already, and next to nothing to what is nearly lost
    x, u = motion(model, 0.01)
    bare, with_them = (ask(model, x, u, sensors(model, x, u, accelerometers=count)) for count in (0, 5))
    np.testing.assert_allclose(with_them["input+E"].result.sigma_min, bare["input+E"].result.sigma_min, rtol=0.2)


def test_case_uses_the_median_instant():
    """One instant after another by the definition: all rows, no compression, singular values of [F*/ω₁; H*/ε]."""
    model = chain_of()
    n = model.size
    x, u = motion(model, 0.5)
    given = sensors(model, x, u, accelerometers=30)
    case = ask(model, x, u, given)["input+E"]
    unknowns = Unknowns(("tip",), ("E",), {"tip": 1e3}, model.reference)
    chosen = linearisation_instants(model, unknowns, model.reference, x, u, 15, 0)
    omega = np.sqrt(np.diag(model.stiffness.at(model.reference)))
    a = np.sqrt(((omega * x[:, :n]) ** 2 + x[:, n:] ** 2).sum(axis=1).max())
    D = np.diag(np.concatenate([a / omega, np.full(n, a), [1.0, 1.0]]))
    condition = []
    for F in linearise(model, unknowns, model.reference, x[chosen], u[chosen]):
        strain, force = given["sensed"].rows[:8], given["sensed"].rows[8:]
        H = np.vstack([np.hstack([strain, np.zeros((8, n + 2))]), force @ F[n : 2 * n]])
        pbh = np.vstack([np.linalg.inv(D) @ F @ D / omega.min(), H @ D / given["largest"][:, None]])
        condition.append(np.linalg.cond(pbh))
    np.testing.assert_allclose(case.result.condition, np.median(condition), rtol=1e-8)
    np.testing.assert_allclose(condition[chosen.tolist().index(case.instant)], np.median(condition), rtol=1e-8)


def test_a_parameter_that_never_acts_is_unobservable_with_its_reason():
    model = chain_of()
    idle = replace(model, reference=dict(model.reference) | {"E_blade": 7e10})
    found = at(idle, 0.5, moduli=("E", "E_blade"))
    assert found["E"].result.condition == np.inf
    assert found["E"].result.sigma_min == 0.0
    assert found["input+E+rho"].reason == "the motion in the training simulation (stage `train`) does not depend on E_blade"
    assert found["input+rho"].reason == ""
    assert np.isfinite(found["input+rho"].result.condition)


def test_a_quantity_that_reads_nothing_is_refused():
    model = chain_of()
    x, u = motion(model, 0.5)
    given = sensors(model, x, u, accelerometers=2)
    given["largest"][8:] = 0.0
    with pytest.raises(ConfigError, match="2 of 10 channels have zero readings"):
        ask(model, x, u, given)
