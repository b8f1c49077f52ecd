"""The interpolated step against the exact one, in cells and at their edges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.estimation import interpolated_step
from strainsight.estimation.interpolated_step import InterpolatedStep
from strainsight.estimation.model import step
from strainsight.estimation.reduced import DrivenModel

from .chain import driven_chain, forces


@pytest.mark.parametrize("parameters", [("k1",), ("k1", "k2")])
@pytest.mark.parametrize("longer", [1.0, 20.0])
def test_interpolated_step_matches_exact_step(parameters, longer):
    model = driven_chain(parameters=parameters)
    model = replace(model, h=longer * model.h)
    known, rng = forces()[..., : len(model.known_inputs)], np.random.default_rng(1)
    x, width = rng.standard_normal((40, model.size)), InterpolatedStep(model).width
    p = x[:, model.parameter_states]
    p[:20] = width * (np.rint(p[:20] / width) + 0.5 * rng.choice([-1, 1], p[:20].shape))
    p[30:] *= 3
    ahead, J = DrivenModel(model, known).step(x, 3)
    expected, slope = step(model, x, known[3])
    size = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(ahead / size, expected / size, rtol=0, atol=1e-13)
    size = np.abs(slope).max(axis=0)
    np.testing.assert_allclose(J, slope, rtol=0, atol=1e-11 * size.max())
    np.testing.assert_allclose(J, slope, rtol=0, atol=1e-9 * np.where(size > 0, size, 1.0).min(axis=1).max())


def test_cells_are_few_and_limited(monkeypatch):
    monkeypatch.setattr(interpolated_step, "KEPT", 3)
    interpolation = InterpolatedStep(driven_chain(parameters=("k1",)))
    for p in np.linspace(-2, 2, 41):
        interpolation.at(np.array([[p]]))
        assert len(interpolation.cells) <= 3
    expected = InterpolatedStep(interpolation.model).at(np.array([[0.1]]))
    np.testing.assert_array_equal(interpolation.at(np.array([[0.1]])), expected)
