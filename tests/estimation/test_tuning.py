"""Maximum likelihood finds by what factors the stated noise is wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from strainsight.errors import ConfigError, NumericalError
from strainsight.estimation import tuning
from strainsight.estimation.draws import draw_truth
from strainsight.estimation.filter import run_filter
from strainsight.estimation.tuning import scale_noise, tune

STEPS = 200


def drawn(make_beam, make_filter, **options):
    model = make_filter(make_beam(modes=3), ("tip",), h=1e-3, noise_step=1e-3, **options)
    nothing, P0 = np.zeros((STEPS, 3, 0)), np.diag([0.0] * 6 + [1.0])
    _, y = draw_truth(model, np.zeros(7), P0, nothing, [0])
    return model, np.zeros(7), P0, nothing, y


@pytest.fixture(scope="module")
def best(make_beam, make_filter):
    model, *rest = drawn(make_beam, make_filter)
    return tune(model, *rest, parts=("noise",)).factors["noise"]


def test_no_other_factors_are_more_likely(make_beam, make_filter):
    model, mean, P0, known, y = drawn(make_beam, make_filter)
    _, other = draw_truth(model, mean, P0, known, [7])
    both = np.concatenate([y, other], axis=1)
    found = tune(model, mean, P0, known, both)

    def likelihood(a, b):
        factors = {"process": a * found.factors["process"], "noise": b * found.factors["noise"]}
        return run_filter(scale_noise(model, factors), mean, P0, known, both).log_likelihood.sum()

    best = likelihood(1, 1)
    assert best - run_filter(model, mean, P0, known, both).log_likelihood.sum() == pytest.approx(found.gained, abs=1e-6)
    for a, b in ((0.9, 1), (1.1, 1), (1, 0.9), (1, 1.1), (0.9, 1.1), (1.1, 0.9)):
        assert likelihood(a, b) < best


def test_parts_of_the_process_noise_are_distinguished(make_beam, make_filter):
    model, *rest = drawn(make_beam, make_filter, q_velocity=3.0)
    off = scale_noise(model, {"inputs": 10.0, "model_error": 0.1})
    assert np.allclose(np.diag(off.Q)[3:], np.diag(model.Q)[3:] * np.array([0.1, 0.1, 0.1, 10.0]))
    found = tune(off, *rest, parts=("inputs", "model_error"))
    assert np.log(10 * found.factors["inputs"]) == pytest.approx(0, abs=0.5)
    assert np.log(0.1 * found.factors["model_error"]) == pytest.approx(0, abs=0.5)


def test_a_schedule_of_noise_is_scaled_as_a_whole(make_beam, make_filter, best):
    model, *rest = drawn(make_beam, make_filter)
    schedule = np.broadcast_to(4 * model.r, (STEPS, 1, 4))
    found = tune(replace(model, r=schedule), *rest, parts=("noise",))
    assert found.factors["noise"] == pytest.approx(0.25 * best, rel=1e-3)
    assert best == pytest.approx(1.0, rel=0.15)


def test_a_part_without_noise_cannot_be_tuned(make_beam, make_filter):
    model, *rest = drawn(make_beam, make_filter)
    with pytest.raises(ConfigError, match="no process noise of model_error"):
        tune(model, *rest, parts=("model_error",))


def test_noise_that_is_not_there_runs_to_its_limit(make_beam, make_filter):
    model, mean, P0, known, _ = drawn(make_beam, make_filter)
    _, y = draw_truth(replace(model, Q=0 * model.Q), mean, P0, known, [0])
    found = tune(model, mean, P0, known, y, limit=1e3)
    assert found.undecided == ("process",)
    assert found.factors["process"] == pytest.approx(1e-3)


def test_where_every_run_diverges_the_search_turns_back(make_beam, make_filter, best, monkeypatch):
    model, *rest = drawn(make_beam, make_filter)
    stated, lost = replace(model, r=100 * model.r), []

    def fragile(filtering, *arguments):
        if filtering.r.min() < 0.5 * model.r.min():
            lost.append(filtering.r.min())
            raise NumericalError("lost")
        return run_filter(filtering, *arguments)

    monkeypatch.setattr(tuning, "run_filter", fragile)
    assert tune(stated, *rest, parts=("noise",)).factors["noise"] == pytest.approx(best / 100, rel=0.02)
    assert lost


def test_a_record_that_loses_the_filter_from_the_start_is_refused(make_beam, make_filter, sine):
    model = make_filter(make_beam(modes=3), parameters=("E",), known=("tip",))
    u = sine(model.h * np.arange(60), model.h, 1e4, 20.0)
    mean, P0 = np.zeros(7), np.diag([0.0] * 6 + [0.01])
    _, y = draw_truth(model, mean, P0, u, [0, 1])
    y[30:, 1] = 1e3
    with pytest.raises(NumericalError, match="diverges with the noise as stated"):
        tune(model, mean, P0, u, y, parts=("noise",))
    assert run_filter(model, mean, P0, u, y).lost.tolist()[0] == -1


def test_where_runs_of_one_side_are_lost_the_slope_is_that_of_the_other(make_beam, make_filter, best, monkeypatch):
    model, *rest = drawn(make_beam, make_filter)
    stated = replace(model, r=model.r / 4)

    def fragile(filtering, *arguments):
        run = run_filter(filtering, *arguments)
        lost = np.broadcast_to(filtering.r, (len(run.log_likelihood), 4)).min(axis=1) < 0.999 * stated.r.min()
        return replace(run, log_likelihood=np.where(lost, -np.inf, run.log_likelihood))

    monkeypatch.setattr(tuning, "run_filter", fragile)
    found = tune(stated, *rest, parts=("noise",))
    assert found.factors["noise"] == pytest.approx(4 * best, rel=0.02)
    assert found.gained > 0
