"""Over 200 seeds drawn from the filter's own model, the claimed σ is the real error (§4.6)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.augmentation.input_models import Matern, Oscillator
from strainsight.estimation.consistency import nees, nis, whiteness, whiteness_band
from strainsight.estimation.draws import draw_truth
from strainsight.estimation.filter import run_filter
from strainsight.estimation.metrics import after_start
from strainsight.estimation.smoother import smooth
from strainsight.estimation.verdict import chi_square_band
from strainsight.rom.modal_step import simulate
from strainsight.rom.steady import steady_start

SEEDS = range(200)


def honesty(error, std):
    """Real error over claimed one, √(mean e²) / √(mean σ²) over time and runs, after the first tenth; both (T + 1, B, k)."""
    return np.sqrt(np.mean(after_start(error) ** 2, axis=(0, 1)) / np.mean(after_start(std) ** 2, axis=(0, 1)))


@pytest.mark.parametrize(
    ("inputs", "parameters", "modes", "steps", "options"),
    [
        (("tip",), (), 4, 600, {}),
        ((), ("E",), 2, 300, {}),
        ((), ("rho",), 2, 300, {"accelerometers": 1, "q_velocity": 0.1}),
        (("tip",), (), 6, 600, {"models": {"tip": Oscillator(20.0)}, "accelerometers": 1, "q_velocity": 0.1}),
        (("tip",), (), 6, 600, {"models": {"tip": Matern(10.0, 2.5)}, "every": 2}),
    ],
)
def test_claimed_deviation_is_the_real_error(make_beam, make_filter, sine, inputs, parameters, modes, steps, options):
    beam = make_beam(modes=modes)
    known = () if inputs else ("tip",)
    model = make_filter(beam, inputs=inputs, parameters=parameters, known=known, **options)
    hertz = 35.0 if "rho" in parameters else 20.0
    u = sine(model.h * np.arange(steps), model.h, 1e4, hertz)[:, :, : len(known)]
    mean, P0 = np.zeros(model.size), np.zeros((model.size, model.size))
    P0[model.position, model.position] = 1.0 if inputs else 0.03**2
    truth, y = draw_truth(model, mean, P0, u, SEEDS)
    run = run_filter(model, mean, P0, u, y, keep="all" if inputs else "mean")
    assert np.all(run.lost < 0)
    unknown = model.position
    error = run.mean[..., unknown] - truth[..., unknown]
    assert honesty(error, run.std[..., unknown])[0] == pytest.approx(1.0, abs=0.05)

    over_runs = nees(error[1:], run.unknown_covariance[1:]).mean(axis=1)
    low, high = chi_square_band(1, len(SEEDS), 0.95)
    assert low < over_runs.mean() < high
    assert np.mean((over_runs > low) & (over_runs < high)) > 0.8

    assert 0.99 < np.nanmean(nis(run.whitened)) < 1.01
    seen = run.whitened[model.every - 1 :: model.every]
    assert np.mean(np.abs(whiteness(seen)) < whiteness_band(*seen.shape[::2], 0.95)) > 0.9
    if inputs:
        smoothed = smooth(model, run)
        late = smoothed.mean[..., unknown] - truth[..., unknown]
        assert honesty(late, smoothed.std[..., unknown])[0] == pytest.approx(1.0, abs=0.05)
        assert np.mean(late**2) < 0.3 * np.mean(error**2)


@pytest.mark.parametrize("accelerometers", [0, 1])
def test_a_load_that_drifts_within_the_step_leaves_the_claim_consistent(make_beam, make_filter, accelerometers):
    """The truth takes twenty steps where the filter takes one. An accelerometer reads the load at the end of a step, which has
    not moved the structure yet: with Q h for the noise of a step the real error is 16 times the claim, and 0.84 of it
    without one."""
    beam, fine, steps = make_beam(modes=4), 20, 300
    model = make_filter(beam, ("tip",), accelerometers=accelerometers, q_velocity=1e-3)
    finer = make_filter(beam, ("tip",), accelerometers=accelerometers, q_velocity=1e-3, h=model.h / fine)
    mean, P0 = np.zeros(model.size), np.zeros((model.size, model.size))
    P0[-1, -1] = 1.0
    truth, y = draw_truth(replace(finer, every=fine), mean, P0, np.zeros((steps * fine, 3, 0)), range(100))
    run = run_filter(model, mean, P0, np.zeros((steps, 3, 0)), y)
    error = run.mean[..., -1] - truth[::fine, :, -1]
    assert honesty(error[..., None], run.std[..., -1:])[0] == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("inputs", "parameters"), [(("tip",), ()), ((), ("E",))])
def test_a_structure_that_moves_at_first_leaves_the_claim_consistent(make_beam, make_filter, sine, inputs, parameters):
    """P₀ of every state the largest of a steady motion under 20 Hz, as a run that begins in it has it; the mean is at rest."""
    beam, steps = make_beam(modes=2), 300
    model = make_filter(beam, inputs=inputs, parameters=parameters, known=() if inputs else ("tip",))
    forced = sine(model.h * np.arange(steps), model.h, 1e4, 20.0)
    omega = 2 * np.pi * 20.0
    own = beam.model
    start = steady_start(own, own.reference, model.h, np.array([omega]), np.array([[-1e4j]]))
    motion = np.abs(simulate(own, own.reference, forced, model.h, start)).max(axis=0)
    mean, P0 = np.zeros(model.size), np.zeros((model.size, model.size))
    P0[model.position, model.position] = 1.0 if inputs else 0.03**2
    P0[: len(motion), : len(motion)] = np.diag(motion**2)
    u = forced[:, :, :0] if inputs else forced
    truth, y = draw_truth(model, mean, P0, u, SEEDS)
    run = run_filter(model, mean, P0, u, y)
    assert np.all(run.lost < 0)
    error = run.mean[..., model.position] - truth[..., model.position]
    assert honesty(error, run.std[..., model.position])[0] == pytest.approx(1.0, abs=0.05)
    over_runs = nees(error[1:], run.unknown_covariance[1:]).mean(axis=1)
    low, high = chi_square_band(1, len(SEEDS))
    assert low < over_runs.mean() < high
    assert 0.99 < np.nanmean(nis(run.whitened)) < 1.01
