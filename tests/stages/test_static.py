"""train.model: static: a structure that follows its loads without inertia, by closed forms and beside the one with inertia."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import StrainsightError
from strainsight.records.record import read
from strainsight.records.reduced import Reduced

from ..edges.beam import bricks, finished
from ..shared import strains

COUNTS = (6, 2, 2)
SLOW, STEP, DURATION, AMPLITUDE, NOISE = 0.2, 0.05, 5.0, 1000.0, 1e-6
STATIC = {
    "filter.compare": False,
    "train": {"model": "static", "duration": DURATION, "time_step": STEP},
    "validate.time_step": STEP,
    "validate.duration": DURATION,
    "loads.tip.signal.frequency": SLOW,
    "gauges.noise_std": {"value": NOISE},
    "tolerances": "none",
}
LOAD = {
    "parameters": {},
    "loads.tip.known": False,
    "place.estimate": ["tip"],
    "validate.truth.parameters": {},
    "validate.initial_std": {"tip": 1.0},
}


def run(folder, until, *changes):
    every = dict(STATIC)
    for own in changes:
        every |= own
    return finished(folder, until, bricks(COUNTS), every)


def per_newton(found) -> np.ndarray:
    """Static strain of every candidate under a newton (m,): the rows on K⁻¹ S."""
    model = read(Reduced, found["rom"]).model
    return (found["train"]["/gauges/row"] @ np.linalg.solve(model.stiffness.at(model.reference), model.input_shape))[:, 0]


def test_readings_follow_the_load_and_lag_by_what_is_stated(tmp_path):
    """1.4 ω/ω_s of the amplitude, ω_s a hundred times the first mode; statics are those of the model with inertia."""
    found = run(tmp_path / "static", "train")
    d, train = per_newton(found), found["train"]
    off = strains(train) - np.outer(train["/input"][:, 0], d)
    lag = 1.4 * SLOW / (100 * found["rom"]["/frequency"][0])
    largest = np.abs(off).max(axis=0) / (AMPLITUDE * np.abs(d))
    np.testing.assert_allclose(largest, lag, rtol=0.01)
    dynamic = run(tmp_path / "dynamic", "train", {"train": {"duration": DURATION, "time_step": STEP}})
    np.testing.assert_allclose(d, per_newton(dynamic), rtol=1e-9, atol=1e-12 * np.abs(d).max())
    assert train["/rms"].max() == pytest.approx(AMPLITUDE * np.abs(d).max() / np.sqrt(2), rel=0.01)


def test_an_unknown_load_has_the_variance_of_a_random_walk_that_is_read(tmp_path):
    """P = 1/(1/(P + qh) + Σ d²/σ²), whose root is closed, q = f a² of a walk with the frequency f and the amplitude a of the
    load; in continuous time √(q σ²h / Σ d²). Beside it is what the load walks while the coordinates lag behind, q times 1.4/ω_s,
    at samples less. The metric counts in that of the pool."""
    found = run(tmp_path, "validate", LOAD)
    d, place = per_newton(found), found["place"]
    sensed = np.sum(d[place["/selected/final/channel"][:, 0]] ** 2)
    q, lag = SLOW * AMPLITUDE**2, 1.4 / (100 * 2 * np.pi * found["rom"]["/frequency"][0])
    of_pool, of_set = (np.sqrt(q * NOISE**2 * STEP / own) for own in (np.sum(d[place["/pool/channel"].ravel()] ** 2), sensed))
    assert place.summary["trace_final"] == pytest.approx((of_set + q * lag) / (of_pool + q * lag), rel=1e-4)
    P = (-q * STEP + np.sqrt((q * STEP) ** 2 + 4 * q * STEP * NOISE**2 / sensed)) / 2
    assert P < found["validate"]["/std/tip"][-1] ** 2 < P + q * lag


def test_it_is_the_limit_of_a_structure_with_inertia_for_slow_loads(tmp_path):
    """Without noise on the model. A walk that is slow against the first mode is known alike, by the same gauges."""
    slow = LOAD | {"loads.tip.process_noise": {"frequency": 1e-5}, "process_noise.model_error": 0.0}
    static = run(tmp_path / "static", "place", slow)["place"]
    short = {"train": {"duration": DURATION, "time_step": 1e-3}}
    dynamic = run(tmp_path / "dynamic", "place", slow, short)["place"]
    np.testing.assert_array_equal(static["/selected/final/channel"], dynamic["/selected/final/channel"])
    assert static.summary["trace_final"] == pytest.approx(dynamic.summary["trace_final"], rel=1e-3)


def test_a_modulus_under_a_known_load_has_the_variance_of_a_regression(tmp_path):
    """ε = d F/E: σ(ln E) = σ/√Σ ε² over all samples, beside a prior of a tenth."""
    found = run(tmp_path, "validate")
    train, channels = found["train"], found["place"]["/selected/final/channel"][:, 0]
    squares = np.sum((strains(train)[1:, channels] * 0.9) ** 2)
    expected = 1 / np.sqrt(squares / NOISE**2 + 1 / 0.1**2)
    own = found["validate"]["/std/E"][-1] / found["validate"]["/estimate/E"][-1]
    assert own == pytest.approx(expected, rel=0.02)


def test_errors_against_a_truth_with_inertia_are_what_is_claimed(tmp_path):
    """Gauges, loads and damping drawn from their tolerances, forty times."""
    changes = LOAD | {"tolerances": {}, "validate.repeats": 40, "place.installation": "ignore"}
    found = run(tmp_path, "validate", changes)["validate"]
    error, std = found["/repeats/error/tip"], found["/repeats/std/tip"]
    ratio = np.sqrt(np.mean((error / std) ** 2))
    assert 0.75 < ratio < 1.25


def test_inertia_that_is_left_out_is_named_and_refused_where_it_is_much(tmp_path):
    for frequency, said in ((1.0, ""), (10.0, "adds up to 2."), (40.0, None)):
        quick = {"loads.tip.signal.frequency": frequency, "train": {"model": "static", "duration": 1.0, "time_step": 1e-3}}
        quick["validate.time_step"] = 1e-3
        folder = tmp_path / str(frequency)
        if said is None:
            with pytest.raises(StrainsightError, match=r"inertia, which train\.model: static leaves out") as caught:
                run(folder, "train", quick)
            assert caught.value.key == "train.model"
        elif said:
            with pytest.warns(UserWarning, match=said):
                run(folder, "train", quick)
        else:
            run(folder, "train", quick)


def test_steps_that_do_not_show_the_swinging_are_named(tmp_path):
    with pytest.warns(UserWarning, match=r"do not show how the structure swings.*train\.model: static"):
        run(tmp_path, "train", {"train": {"duration": DURATION, "time_step": STEP}})


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"motion_sensors": {"a": {"quantity": "acceleration", "noise_std": {"value": 0.01}}}}, "motion_sensors.a.quantity"),
        (
            {
                "parameters": {"E": {"property": "density", "region": 1, "guess": 7e3, "range": [6e3, 9e3]}},
                "validate.truth.parameters": {"E": 7850.0},
            },
            "parameters.E.property",
        ),
    ],
)
def test_what_needs_inertia_is_refused(tmp_path, changes, key):
    with pytest.raises(StrainsightError, match=r"train\.model: static") as caught:
        run(tmp_path, "import", changes)
    assert key in str(caught.value) or caught.value.key == key
