"""One factor, many right-hand sides, real and complex, and clear words where there is no factor."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import sparse

from strainsight import memory
from strainsight.errors import NumericalError, UserError
from strainsight.fem import factorisation
from strainsight.fem.factorisation import factorise, factorise_complex


def spd(n=400, seed=0, units=0.0):
    """A sparse matrix XᵀX + I whose rows carry units that differ by 10^±units."""
    X = sparse.random_array((n, n), density=0.01, rng=np.random.default_rng(seed))
    scale = sparse.diags_array(10.0 ** np.random.default_rng(1).uniform(-units, units, n))
    return sparse.csr_array(scale @ (X.T @ X + sparse.eye_array(n)) @ scale)


def laplacian(n):
    """The seven-point stencil on n³ points: a factor of far more entries than the matrix has."""
    line = sparse.diags_array([np.full(n, 2.0), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1])
    square = sparse.kron(line, sparse.eye_array(n)) + sparse.kron(sparse.eye_array(n), line)
    return sparse.csr_array(sparse.kron(square, sparse.eye_array(n)) + sparse.kron(sparse.eye_array(n * n), line))


@pytest.fixture(params=["PARDISO", "SuperLU"])
def solver(request, monkeypatch):
    if request.param == "SuperLU":
        monkeypatch.setitem(sys.modules, "pypardiso", None)
    return request.param


@pytest.mark.filterwarnings("ignore:the equation solver PARDISO is not available")
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


@pytest.mark.filterwarnings("ignore:the equation solver PARDISO is not available")
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
    assert np.array_equal(first.solve(b), x)
    assert np.allclose(B @ y, b, atol=1e-9)


def test_without_pardiso_a_warning_and_beyond_the_limit_an_error(monkeypatch):
    monkeypatch.setitem(sys.modules, "pypardiso", None)
    with pytest.warns(UserWarning, match="SuperLU replaces it"):
        factorise(spd())
    monkeypatch.setattr(factorisation, "SUPERLU_LIMIT", 100)
    with pytest.raises(UserError, match="400 degrees of freedom"):
        factorise(spd())


def test_memory_is_freed_with_the_factor(monkeypatch):
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
    assert np.all(np.isfinite(other.solve(np.ones(400))))
    assert released == []
    del other
    assert released == [True]


def test_every_solution_is_as_good_as_the_arithmetic_without_refinement():
    """Backward error ‖b − Ax‖ / ‖A‖‖x‖ of a few roundings."""
    A = laplacian(20)
    B = np.random.default_rng(0).normal(size=(A.shape[0], 3))
    X = factorise(A).solve(B)
    assert np.all(np.linalg.norm(B - A @ X, axis=0) < 1e-15 * 12 * np.linalg.norm(X, axis=0))


@pytest.mark.parametrize("available", [1e6, 2e7])
def test_too_little_memory_is_refused_before_it_is_taken(monkeypatch, available):
    """1 MB is less than the matrix itself needs; with 20 MB PARDISO's analysis can say that its factor needs more."""
    phases = []
    interface = factorisation.interface

    def watched(solver, upper):
        call = interface(solver, upper)
        return lambda phase, B, X: phases.append(phase) or call(phase, B, X)

    monkeypatch.setattr(factorisation, "interface", watched)
    monkeypatch.setattr(memory, "available_memory", lambda: available)
    with pytest.raises(UserError, match=r"27000 degrees of freedom.*: .* GiB of memory are needed, but .* GiB are available"):
        factorise(laplacian(30))
    assert phases == ([] if available < 2e6 else [factorisation.ANALYSE])


GROWTH = """
import os, sys
sys.path.insert(0, sys.argv[1])
from test_factorisation import factorisation, factorise, laplacian, memory

def resident():
    return int((memory.PROC / "self" / "statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

noted = []
factorisation.require_memory = lambda needed, what: noted.append((needed, resident()))
factor = factorise(laplacian(40))
announced, before = noted[-1]
print(factor.size, announced, resident() - before)
"""


@pytest.mark.slow
def test_the_estimate_is_what_the_factor_takes():
    """Growth of the resident memory in PARDISO's factorisation against what its analysis announced.

    In a process of its own: one that has factorised before has memory to use again, and need not grow.
    """
    if not (memory.PROC / "self" / "statm").exists():
        pytest.skip("the system does not say how much memory a process has")
    words = [sys.executable, "-c", GROWTH, str(Path(__file__).parent)]
    size, announced, growth = map(
        float, subprocess.run(words, capture_output=True, check=True, text=True).stdout.split()
    )
    assert size == 64000
    assert announced > 1e8
    assert 0.7 * announced < growth < 1.3 * announced


@pytest.mark.slow
def test_solutions_do_not_depend_on_the_number_of_threads():
    """Four columns with one thread of MKL and with two, in a process that may have two."""
    code = """
import numpy as np
from tests.fem.test_factorisation import laplacian
from strainsight.fem.factorisation import factorise
from strainsight.fem import factorisation
A, B = laplacian(28), np.random.default_rng(0).standard_normal((28**3, 4))
library = factorisation.solver_of(factorisation.POSITIVE_DEFINITE).libmkl
found = []
for threads in (1, 2):
    library.MKL_Set_Num_Threads(threads)
    found.append(factorise(A).solve(B))
assert np.array_equal(*found), np.abs(found[0] - found[1]).max()
"""
    subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parents[2], check=True, timeout=100)


def test_complex_factor_solves_and_refuses_singular_matrices(monkeypatch):
    rng = np.random.default_rng(0)
    R = rng.standard_normal((30, 30))
    A = R @ R.T + np.eye(30) + 1j * np.diag(rng.uniform(0, 50, 30))
    b = rng.standard_normal(30) + 1j * rng.standard_normal(30)
    np.testing.assert_allclose(factorise_complex(sparse.csr_array(A))(b), np.linalg.solve(A, b), rtol=1e-11)
    with pytest.raises(NumericalError):
        factorise_complex(sparse.csr_array(np.diag([1.0 + 0j, 0.0])))
    with pytest.raises(NumericalError):
        factorise_complex(sparse.csr_array(np.ones((2, 2), dtype=complex)))
    monkeypatch.setattr(factorisation, "SUPERLU_LIMIT", 10)
    monkeypatch.setattr(factorisation, "_pardiso", lambda upper: (_ for _ in ()).throw(ImportError()))
    with pytest.raises(UserError, match="PARDISO"):
        factorise_complex(sparse.csr_array(A))
