"""A complex symmetric factor solves, and refuses what it cannot."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import sparse

from strainsight.errors import NumericalError, UserError
from strainsight.fem import complex_factor
from strainsight.fem.complex_factor import factorise_complex


def test_a_complex_factor_solves_and_refuses_what_it_cannot(monkeypatch):
    rng = np.random.default_rng(0)
    R = rng.standard_normal((30, 30))
    A = R @ R.T + np.eye(30) + 1j * np.diag(rng.uniform(0, 50, 30))
    b = rng.standard_normal(30) + 1j * rng.standard_normal(30)
    np.testing.assert_allclose(factorise_complex(sparse.csr_array(A))(b), np.linalg.solve(A, b), rtol=1e-11)
    with pytest.raises(NumericalError):
        factorise_complex(sparse.csr_array(np.diag([1.0 + 0j, 0.0])))
    with pytest.raises(NumericalError):
        factorise_complex(sparse.csr_array(np.ones((2, 2), dtype=complex)))
    monkeypatch.setattr(complex_factor, "SUPERLU_LIMIT", 10)
    monkeypatch.setattr(complex_factor, "_pardiso", lambda upper: (_ for _ in ()).throw(ImportError()))
    with pytest.raises(UserError, match="PARDISO"):
        factorise_complex(sparse.csr_array(A))
