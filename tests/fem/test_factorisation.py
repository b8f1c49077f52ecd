"""One factor, many right-hand sides, and clear words where there is no factor."""

from __future__ import annotations

import gc
import sys

import numpy as np
import pytest
from scipy import sparse

from strainsight.errors import NumericalError, UserError
from strainsight.fem import factorisation
from strainsight.fem.factorisation import factorise


def spd(n=400, seed=0, units=0.0):
    """A sparse matrix XᵀX + I whose rows carry units that differ by 10^±units."""
    X = sparse.random_array((n, n), density=0.01, rng=np.random.default_rng(seed))
    scale = sparse.diags_array(10.0 ** np.random.default_rng(1).uniform(-units, units, n))
    return sparse.csr_array(scale @ (X.T @ X + sparse.eye_array(n)) @ scale)


@pytest.fixture(params=["PARDISO", "SuperLU"])
def solver(request, monkeypatch):
    if request.param == "SuperLU":
        monkeypatch.setitem(sys.modules, "pypardiso", None)
    return request.param


@pytest.mark.filterwarnings("ignore:PARDISO is not available")
@pytest.mark.parametrize("units", [0, 8])
def test_solution_satisfies_the_equations(solver, units):
    A = spd(units=units)
    X = np.random.default_rng(2).normal(size=(400, 70))
    factor = factorise(A)
    assert factor.solver == solver
    found = factor.solve(A @ X)
    weight = np.sqrt(A.diagonal())[:, None]
    assert np.abs(weight * (found - X)).max() < 1e-11 * np.abs(weight * X).max()
    assert np.array_equal(factor.solve(A @ X[:, 0]).shape, (400,))
    assert factor.solve(np.zeros((400, 0))).shape == (400, 0)


@pytest.mark.filterwarnings("ignore:PARDISO is not available")
def test_indefinite_and_singular_matrices_are_refused(solver):
    A = spd()
    with pytest.raises(NumericalError, match="not positive definite"):
        factorise(sparse.csr_array(A - 5 * sparse.eye_array(400)))
    coupled = sparse.csr_array(np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]))
    with pytest.raises(NumericalError, match="not positive definite"):
        factorise(coupled)
    with pytest.raises(NumericalError, match="diagonal entry 3 is 0"):
        factorise(sparse.csr_array(np.diag([1.0, 1.0, 1.0, 0.0])))


def test_factors_do_not_disturb_each_other():
    A, B = spd(seed=0), spd(seed=3)
    first, second = factorise(A), factorise(B)
    b = np.arange(400.0)
    x, y = first.solve(b), second.solve(b)
    del second
    gc.collect()
    assert np.array_equal(first.solve(b), x)
    assert np.allclose(B @ y, b, atol=1e-9)


def test_without_pardiso_a_warning_and_beyond_the_limit_an_error(monkeypatch):
    monkeypatch.setitem(sys.modules, "pypardiso", None)
    with pytest.warns(UserWarning, match="SuperLU is used"):
        factorise(spd())
    monkeypatch.setattr(factorisation, "SUPERLU_LIMIT", 100)
    with pytest.raises(UserError, match="400 unknowns"):
        factorise(spd())


def test_memory_goes_with_the_factor(monkeypatch):
    """PARDISO's memory is released when the last reference to a factor goes, and not before."""
    from pypardiso import PyPardisoSolver

    released = []
    free = PyPardisoSolver.free_memory

    def counted(solver, everything=False):
        released.append(everything)
        free(solver, everything)

    monkeypatch.setattr(PyPardisoSolver, "free_memory", counted)
    factor = factorise(spd())
    other = factor
    del factor
    gc.collect()
    assert np.all(np.isfinite(other.solve(np.ones(400))))
    assert released == []
    del other
    gc.collect()
    assert released == [True]
