"""The claimed σ without a filter: it is that of the filter on the same motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.augmentation.input_models import Oscillator
from strainsight.estimation.claim import covariance_recursion
from strainsight.estimation.filter import run_filter
from strainsight.estimation.motion import measure
from strainsight.rom.modal_step import simulate

from .drawn import drawn, prior


def test_the_claim_along_a_motion_is_what_a_filter_on_that_motion_claims(make_beam, make_filter, sine):
    """Fed with strains free of noise and started at the truth, the filter stays on the motion: the two σ are one."""
    beam, h, steps = make_beam(graded=True), 5e-4, 300
    u = sine(h * np.arange(steps), h, 1e4, 20.0)
    x = simulate(beam.model, beam.model.reference, u, h)
    places = [(0.05, 0.3, 0.9, 1.5), (0.1, 0.2, 0.3, 0.4)]
    for parameters in (("E",), ("rho", "E")):
        model = make_filter(beam, parameters=parameters, known=("tip",), h=h)
        H = np.stack([np.hstack([beam.rows(*p), np.zeros((4, model.size - 10))]) for p in places])
        model = replace(model, H=H)
        y = np.einsum("bmi,ki->kbm", H[..., :10], x[1:, :10])
        run = run_filter(model, np.zeros(model.size), prior(model), u, y)
        std = covariance_recursion(model, x, u, prior(model)).std
        np.testing.assert_allclose(std[..., 20:], run.std[..., 20:], rtol=1e-5)


def test_the_claim_for_inputs_needs_no_motion(make_beam, make_filter, sine):
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(), sine, ("tip",), ())
    std = covariance_recursion(model, np.zeros((61, 20)), np.zeros((60, 3, 1)), P0).std
    np.testing.assert_allclose(std, run_filter(model, mean, P0, u, y).std[:, :1], rtol=1e-9, atol=1e-30)


def test_the_claim_of_many_gauges_is_that_of_the_filter_with_all_of_them(make_beam, make_filter, sine):
    """Sixty gauges and nine states: what they say together is said by nine rows."""
    gauges = tuple(np.linspace(0.02, 1.9, 60))
    model, mean, P0, u, _, y = drawn(make_filter, make_beam(modes=4), sine, ("tip",), (), gauges=gauges)
    std = covariance_recursion(model, np.zeros((61, 8)), np.zeros((60, 3, 1)), P0).std
    np.testing.assert_allclose(std[:, :, -1], run_filter(model, mean, P0, u, y).std[:, :1, -1], rtol=1e-7)


@pytest.mark.parametrize("parameters", [(), ("E",)])
def test_the_claim_along_a_motion_holds_for_accelerometers_and_input_models(make_beam, make_filter, sine, parameters):
    """As above, with an accelerometer whose rows vary along the motion, an oscillator load and samples every third step."""
    beam, h, steps = make_beam(modes=5, graded=True, load_nodes=(16, 8)), 5e-4, 240
    known = ("middle",)
    model = make_filter(
        beam,
        ("tip",),
        parameters,
        known,
        h,
        models={"tip": Oscillator(20.0)},
        accelerometers=2,
        every=3,
        q_velocity=0.1,
    )
    u = np.zeros((steps, 3, 2))
    u[:, :, 1:] = sine(h * np.arange(steps), h, 1e4, 20.0)
    x = simulate(beam.model, beam.model.reference, u, h)
    full = np.hstack([x[1:], np.zeros((steps, model.size - 10))])
    y = measure(model, full, u[:, :, 1].sum(axis=1)[:, None])[0][2::3]
    P0 = np.diag([0.0] * 10 + [1e-4] * (model.size - 10))
    run = run_filter(model, np.zeros(model.size), P0, u[:, :, 1:], y)
    std = covariance_recursion(model, x, u, P0).std
    np.testing.assert_allclose(std[:, 0, 10:], run.std[:, 0, 10:], rtol=1e-4)
