"""The lazy order is the whole stable order, whatever ties and infinities there are."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.placement.ordering import HEAD, lowest_first


@pytest.mark.parametrize("count", [1, HEAD, 4 * HEAD, 4 * HEAD + 1, 5000])
def test_order_is_that_of_a_stable_sort(count):
    rng = np.random.default_rng(count)
    for values in (
        rng.standard_normal(count),
        rng.integers(0, 5, count).astype(float),
        np.where(rng.random(count) < 0.5, np.inf, rng.random(count)),
        np.zeros(count),
        np.full(count, np.inf),
    ):
        assert list(lowest_first(values)) == np.argsort(values, kind="stable").tolist()
