"""Where the entries of sparse matrices stand: sums of matrices whose places are the same."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import sparse


def same_places(X: sparse.csr_array, Y: sparse.csr_array) -> bool:
    """Whether the entries of two CSR matrices stand in the same places."""
    alike = X.shape == Y.shape and X.nnz == Y.nnz
    return alike and np.array_equal(X.indptr, Y.indptr) and np.array_equal(X.indices, Y.indices)


def on_one(matrices: Sequence[sparse.csr_array]) -> list[sparse.csr_array]:
    """The same matrices, CSR with sorted columns, on the places of all of them, zeros included, which they share in memory."""
    whole = _ones(matrices[0])
    for own in matrices[1:]:
        if not same_places(whole, own):
            whole = whole + _ones(own)
    if max(whole.nnz, *whole.shape) < 2**31:  # half the memory, and quicker products
        places = whole.indices.astype(np.int32), whole.indptr.astype(np.int32)
        whole = sparse.csr_array((whole.data, *places), shape=whole.shape)

    def widened(own: sparse.csr_array) -> sparse.csr_array:
        data = own.data
        if not same_places(whole, own):
            # a sum of positive numbers drops nothing: what is above the ones of the whole is which entry stands there
            number = sparse.csr_array((np.arange(1.0, own.nnz + 1), own.indices, own.indptr), shape=own.shape)
            place = np.rint((number + whole).data).astype(np.int64) - 1
            data = np.append(0.0, data)[place]
        return sparse.csr_array((data, whole.indices, whole.indptr), shape=whole.shape)

    whole.data[:] = 1.0
    return [widened(own) for own in matrices]


def added(X: Any, Y: Any) -> Any:
    """X + Y, without a pass over one of two sparse matrices where the other is empty."""
    if isinstance(X, sparse.csr_array) and isinstance(Y, sparse.csr_array) and not (X.nnz and Y.nnz):
        return X if X.nnz else Y
    return X + Y


def _ones(X: sparse.csr_array) -> sparse.csr_array:
    return sparse.csr_array((np.ones(X.nnz), X.indices, X.indptr), shape=X.shape)
