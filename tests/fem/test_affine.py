"""Operators in functions of the parameters: against polynomials written out, complex steps, and one value at a time."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.fem.affine import AffineOperator, Coefficient, Polynomial, sum_of

rng = np.random.default_rng(0)
X0, X1, X3, XE = rng.standard_normal((4, 3, 3))
PLATE = AffineOperator(
    X0,
    {"E": XE, "E t": X1, "E t^3": X3},
    {
        "E t": Coefficient((Polynomial("E"), Polynomial("t", (0.0,), 2.0))),
        "E t^3": Coefficient((Polynomial("E"), Polynomial("t", (1.0, 0.0, -0.5), 2.0))),
    },
)


def written_out(E, t):
    return X0 + E * XE + E * t / 2 * X1 + E * (t - 1) * t * (t + 0.5) / 8 * X3


def test_value_is_the_polynomial():
    assert PLATE.parameters == ("E", "t")
    np.testing.assert_allclose(PLATE.at({"E": 3.0, "t": 0.7}), written_out(3.0, 0.7), rtol=1e-14)


@pytest.mark.parametrize("t", [0.7, 1.0, 0.0, -0.5])
def test_derivatives_are_those_of_a_complex_step(t):
    """At the roots of a factor, too."""
    np.testing.assert_allclose(
        PLATE.derivative("t", {"E": 3.0, "t": t}), written_out(3.0, t + 1e-30j).imag / 1e-30, rtol=1e-13, atol=1e-14
    )
    np.testing.assert_allclose(
        PLATE.derivative("E", {"E": 3.0, "t": t}), written_out(3.0 + 1e-30j, t).imag / 1e-30, rtol=1e-13, atol=1e-14
    )
    assert not PLATE.derivative("rho", {"E": 3.0, "t": t}).any()


def test_many_values_are_one_after_the_other():
    E, t = rng.uniform(1, 2, (2, 4)), rng.uniform(0.5, 1.5, (2, 4))
    X, slope = PLATE.at({"E": E, "t": t}), PLATE.derivative("t", {"E": E, "t": t})
    assert X.shape == slope.shape == (2, 4, 3, 3)
    for i in np.ndindex(2, 4):
        np.testing.assert_allclose(X[i], PLATE.at({"E": E[i], "t": t[i]}), rtol=1e-14)
        np.testing.assert_allclose(slope[i], PLATE.derivative("t", {"E": E[i], "t": t[i]}), rtol=1e-14)


def test_beyond_its_range_a_polynomial_goes_on_along_its_tangent():
    own = Polynomial("t", (0.0, 0.0, 0.0), 1.0, (0.5, 2.0))
    t = np.array([0.1, 0.5, 1.0, 2.0, 5.0])
    np.testing.assert_allclose(own.at({"t": t}), [0.125 - 0.75 * 0.4, 0.125, 1, 8, 8 + 12 * 3], rtol=1e-14)
    np.testing.assert_allclose(own.derivative({"t": t}), [0.75, 0.75, 3, 12, 12], rtol=1e-14)


def test_what_is_linear_has_its_term_for_slope_whatever_the_values():
    plain = AffineOperator(X0, {"E": XE})
    assert plain.derivative("E", {"E": np.ones(5)}) is XE


def test_sums_and_maps_go_term_by_term():
    theta = {"E": 3.0, "t": 0.7}
    both = sum_of(PLATE, AffineOperator(X1, {"E": X3, "E t": X0}, {"E t": PLATE.coefficients["E t"]}))
    np.testing.assert_allclose(both.at(theta), PLATE.at(theta) + X1 + 3 * X3 + 3 * 0.35 * X0, rtol=1e-13, atol=1e-14)
    Psi = rng.standard_normal((3, 2))
    symmetric = PLATE.of_all(lambda X: X + X.T)
    np.testing.assert_allclose(
        symmetric.project(Psi).at(theta), Psi.T @ symmetric.at(theta) @ Psi, rtol=1e-12, atol=1e-13
    )
