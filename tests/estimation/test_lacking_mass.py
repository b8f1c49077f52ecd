"""Masses that the model lacks at unknown loads, and parameters that a known load determines."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.estimation.claim import predict_grid_std
from strainsight.estimation.conditional import none_considered
from strainsight.estimation.grid_filter import filter_on_grid
from strainsight.estimation.grid_filter_smoother import smooth_on_grid
from strainsight.estimation.record import GridRecord
from strainsight.loads.input_models import IntegratedRandomWalk
from strainsight.rom.modal_step import simulate

from .conftest import HEIGHT, LENGTH, RHO, WIDTH, make_beam, make_filter, prior, sine
from .truth import draw_truth

MASS = 0.01 * RHO * LENGTH * WIDTH * HEIGHT
STEPS, HERTZ = 400, 30.0
"""Length of the record, and frequency of the known load: 0.7 of the first mode."""


@pytest.fixture(scope="module")
def record():
    """A slow load at the tip is unknown, a sine in the middle known; the model may lack 1 % of the mass at the tip."""
    beam = make_beam(modes=3, load_nodes=(16, 8))
    model = make_filter(
        beam, ("tip",), ("E",), known=("middle",), q_parameter=0.0, q_input=1.0, models={"tip": IntegratedRandomWalk(5.0)}
    )
    s = beam.model.input_shape[:, :1]
    u = sine(model.h * np.arange(STEPS), model.h, 1e4, HERTZ)
    considered = replace(none_considered(model), lacking=MASS * s @ s.T)
    _, y = draw_truth(model, np.zeros(model.size), prior(model), u, [1])
    return GridRecord(model, np.zeros(model.size), prior(model), u, y[:, 0], considered)


def test_modulus_is_off_by_the_mass_that_its_sigma_contains(record):
    """Truths with exactly one σ of the mass: the RMS error is 0.85 to 1.15 of σ, and without the tolerance more than 5."""
    heavy = record.with_lacking_mass()
    truth, y = draw_truth(heavy.model, record.mean, record.covariance, record.known, range(6))

    def ratio(considered):
        records = (replace(record, samples=each, considered=considered) for each in np.moveaxis(y, 1, 0))
        runs = [filter_on_grid(each, "parameters").run for each in records]
        error = np.array([run.mean[-1, 0, -1] for run in runs]) - truth[-1, :, -1]
        return np.sqrt(np.mean(error**2) / np.mean([run.std[-1, 0, -1] ** 2 for run in runs]))

    assert ratio(record.considered) == pytest.approx(1.0, abs=0.15)
    assert ratio(none_considered(record.model)) > 5


def test_change_by_masses_widens_the_modulus_and_moves_loads_by_their_regression(record):
    """Of filter and smoother the mean stays, σ² of E grows by c², Σ_fp P⁻¹ stays, and so does Σ_f − Σ_fp P⁻¹ Σ_pf, of a
    load under a known modulus."""
    own, plain = (filter_on_grid(replace(record, considered=each)) for each in (record.considered, none_considered(record.model)))
    (c,) = own.by_mass
    assert abs(c) > 5 * plain.run.std[-1, 0, -1]
    np.testing.assert_array_equal(own.run.mean, plain.run.mean)
    (mean, variance), (before, least) = own.posterior, plain.posterior
    np.testing.assert_allclose(mean, before, atol=1e-9 * c)
    np.testing.assert_allclose(variance - least, c**2, rtol=1e-9)
    np.testing.assert_allclose(own.run.std[-1, 0, -1] ** 2, variance[0, 0], rtol=1e-9)
    late = slice(STEPS // 2, None)
    slopes, left = zip(*(_on_modulus(run.run.unknown_covariance[late, 0]) for run in (own, plain)), strict=True)
    np.testing.assert_allclose(*slopes, rtol=1e-9)
    np.testing.assert_allclose(*left, rtol=1e-6)
    later, narrower = (smooth_on_grid(record, run) for run in (own, plain))
    assert later.std[-1, 0, -1] == pytest.approx(np.sqrt(variance[0, 0]), rel=1e-9)
    assert np.all(later.std[late, 0, 6] > narrower.std[late, 0, 6])


def test_expected_change_is_that_of_estimates_of_readings_with_and_without_the_mass(record):
    """A twentieth of the mass, where its effect is linear to 1 %, and readings without noise."""
    share, theta = 0.05, record.model.model.reference
    light = replace(record, considered=replace(record.considered, lacking=share * record.considered.lacking))
    models, considered = (record.model, light.with_lacking_mass().model), none_considered(record.model)
    u = np.concatenate([np.zeros_like(record.known), record.known], axis=2)
    motions = [simulate(model.model, theta, u, model.h) for model in models]
    readings = [x[1:, :3] @ record.model.H[:, :3].T for x in motions]
    claims = [
        predict_grid_std(record.model, motions[0], u, record.covariance, considered, by_mass=by_mass)
        for by_mass in ((readings[1] - readings[0]) / share, None)
    ]
    expected = np.sqrt(claims[0].std[-1, 0, -1] ** 2 - claims[1].std[-1, 0, -1] ** 2)
    assert claims[0].budget["mass"][-1, -1] == pytest.approx(expected**2, rel=1e-9)
    off, plain = (
        filter_on_grid(replace(record, samples=each, considered=considered), "parameters").posterior[0]
        for each in readings[::-1]
    )
    assert abs(off[0] - plain[0]) == pytest.approx(share * expected, rel=0.01)


def test_masses_do_not_widen_a_modulus_without_a_known_load(record):
    """Its σ is not valid anyway."""
    silent = make_filter(make_beam(modes=3), ("tip",), ("E",), q_parameter=0.0, models={"tip": IntegratedRandomWalk(5.0)})
    alone = replace(record, model=silent, known=record.known[..., :0], considered=none_considered(silent))
    lacking = replace(alone, considered=replace(alone.considered, lacking=record.considered.lacking))
    own, plain = (filter_on_grid(each, "parameters") for each in (lacking, alone))
    assert not len(own.by_mass)
    np.testing.assert_array_equal(own.run.std[:, 0, -1], plain.run.std[:, 0, -1])


def _on_modulus(covariance):
    """Slope of the load on the modulus, and its variance under a known modulus, of covariances (T, 2, 2)."""
    slope = covariance[:, 0, 1] / covariance[:, 1, 1]
    return slope, covariance[:, 0, 0] - slope * covariance[:, 0, 1]
