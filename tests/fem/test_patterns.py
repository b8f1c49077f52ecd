"""Sums of sparse matrices on one pattern: the sums of their dense ones."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from strainsight.fem.affine import AffineOperator, sum_of

N = 12


def some(seed: int, density: float) -> sparse.csr_array:
    own = sparse.random_array((N, N), density=density, rng=np.random.default_rng(seed), format="csr")
    own.sort_indices()
    return sparse.csr_array(own)


def test_an_operator_on_one_pattern_has_the_values_it_had():
    """Terms that fill as many places, other places and next to none; a difference that is zero everywhere keeps its places."""
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
