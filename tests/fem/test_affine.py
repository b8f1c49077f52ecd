"""Affine operators in parameters, and their sums on one pattern."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from strainsight.fem.affine import AffineOperator, Coefficient, Newton, sum_of

rng = np.random.default_rng(0)
X0, X1, X3, XE = rng.standard_normal((4, 3, 3))
PLATE = AffineOperator(
    X0,
    {"E": XE, "E t": X1, "E t^3": X3},
    {
        "E t": Coefficient((Newton("t", (0.0,), 2.0),), np.array([0.0, 1.0])).times("E"),
        "E t^3": Coefficient(
            (Newton("E"), Newton("t", (1.0, 0.0, -0.5), 2.0)), np.array([[0.0, 0, 0, 0], [0, 3.0, 0, 8.0]])
        ),
    },
)


def written_out(E, t):
    return X0 + E * XE + E * t / 2 * X1 + E * (3 * (t - 1) / 2 + (t - 1) * t * (t + 0.5)) * X3


def test_value_is_the_polynomial():
    assert PLATE.parameters == ("E", "t")
    np.testing.assert_allclose(PLATE.at({"E": 3.0, "t": 0.7}), written_out(3.0, 0.7), rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize("t", [0.7, 1.0, 0.0, -0.5])
def test_derivatives_are_those_of_a_complex_step(t):
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
    for some in (2.0, E[0]):  # one for all, and one for all of an axis
        values = {"E": np.broadcast_to(some, (2, 4)), "t": t}
        np.testing.assert_allclose(PLATE.at({"E": some, "t": t}), PLATE.at(values), rtol=1e-14)


@pytest.mark.parametrize("logarithm", [False, True])
def test_beyond_its_range_a_polynomial_levels_off(logarithm):
    own = Newton("t", (0.0, 0.0, 0.0), 1.0, (0.5, 2.0), 0.1, logarithm)
    t = np.array([1e-5, 0.45, 0.5, 1.0, 2.0, 2.1, 90.0])
    seen = np.array([0.45, 0.5 - 0.05 * np.tanh(1), 0.5, 1.0, 2.0, 2 + 0.2 * np.tanh(0.5), 2.2])
    x, by_x = (np.log(seen), 1 / t) if logarithm else (seen, np.ones(7))
    N, slope = own.at({"t": t})
    np.testing.assert_allclose(N, [x**k for k in range(4)], rtol=1e-7, atol=1e-12)
    d = 1e-6
    differences = (own.at({"t": t + d})[0] - own.at({"t": t - d})[0]) / (2 * d)
    np.testing.assert_allclose(slope, differences, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(slope[3, 2:5], (3 * x**2 * by_x)[2:5], rtol=1e-14)


def test_sums_and_maps_go_term_by_term():
    theta = {"E": 3.0, "t": 0.7}
    both = sum_of(PLATE, AffineOperator(X1, {"E": X3, "t": X0}))
    np.testing.assert_allclose(both.at(theta), PLATE.at(theta) + X1 + 3 * X3 + 0.7 * X0, rtol=1e-13, atol=1e-14)
    Psi = rng.standard_normal((3, 2))
    symmetric = PLATE.of_all(lambda X: X + X.T)
    np.testing.assert_allclose(
        symmetric.project(Psi).at(theta), Psi.T @ symmetric.at(theta) @ Psi, rtol=1e-12, atol=1e-13
    )


def test_a_constant_of_zero_stands_beside_sparse_terms():
    term = sparse.csr_array(np.diag([1.0, 2.0]))
    np.testing.assert_array_equal(AffineOperator(0.0, {"a": term}).at({"a": 2.0}).toarray(), np.diag([2.0, 4.0]))


N = 12


def some(seed: int, density: float) -> sparse.csr_array:
    own = sparse.random_array((N, N), density=density, rng=np.random.default_rng(seed), format="csr")
    own.sort_indices()
    return sparse.csr_array(own)


def test_an_operator_on_one_pattern_has_the_values_it_had():
    first = some(0, 0.4)
    X = AffineOperator(first, {"a": some(1, 0.5), "b": -1.0 * first, "c": some(2, 0.02)})
    wide = X.on_one_pattern()
    assert np.shares_memory(wide.terms["a"].indices, wide.constant.indices)
    assert wide.terms["c"].nnz == X.terms["c"].nnz
    for theta in ({"a": 0.0, "b": 1.0, "c": 0.0}, {"a": 2.5, "b": -0.3, "c": 7.0}):
        dense = X.constant.toarray() + sum(value * X.terms[name].toarray() for name, value in theta.items())
        for own in (X, wide):
            assert np.allclose(own.at(theta).toarray(), dense, rtol=1e-13, atol=1e-15)
    assert np.array_equal(wide.constant.toarray(), first.toarray())


def test_a_value_is_no_part_of_the_operator():
    X = AffineOperator(some(0, 0.4), {"a": some(1, 0.5)}).on_one_pattern()
    before = X.constant.toarray()
    X.at({"a": 2.0}).data[:] = 0.0
    assert np.array_equal(X.constant.toarray(), before)


@pytest.mark.parametrize("empty", [0, 1])
def test_a_sum_with_an_empty_operator_is_the_other_one(empty):
    nothing, own = AffineOperator(sparse.csr_array((N, N)), {}), AffineOperator(some(0, 0.4), {"a": some(1, 0.5)})
    both = sum_of(own, nothing) if empty else sum_of(nothing, own)
    assert np.array_equal(both.at({"a": 2.0}).toarray(), own.at({"a": 2.0}).toarray())
