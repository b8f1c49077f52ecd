"""The filters of a structure beside the grid filter, and how the motion begins, `train.settle`."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from strainsight import api
from strainsight.errors import ConfigError, NumericalError
from strainsight.experiment.filters_compared import comparison_table, disagreements_in_words, ratios
from strainsight.experiment.structure import expectation as expecting
from strainsight.experiment.structure import filtering, validation
from strainsight.experiment.structure.filtering import excluded, excluded_in_words
from strainsight.experiment.structure.problem import (
    exactly_damped,
    filter_model,
    initial_covariance,
    placed_instants,
    problem_of,
)
from strainsight.experiment.structure.start import ringing_in_words
from strainsight.sensors.candidates import ACCELERATION

from ..edges.beam import PLACEMENT_CONFIG, E, apart, bricks, prepared
from ..shared import FEW, HUB
from .conftest import ROOT, made
from .drawn_truths import beam_in, trial

SHORT = ("validate.repeats=1", "validate.random_sets=0", "validate.noise_factors=[]")


@pytest.fixture(scope="module")
def validated(tmp_path_factory):
    """What validates three gauges of a small beam, with overrides."""
    folder = tmp_path_factory.mktemp("beam")

    def beam(*overrides):
        return prepared(folder, bricks((6, 2, 2)), {}, *SHORT, *overrides)

    plain = beam()

    @cache
    def run(*overrides):
        case = api.load(folder / "edge.yaml", [*SHORT, *overrides])
        return api.validate(case, plain.mesh, plain.reduced, plain.training, plain.screened, plain.screened.kept[:3])

    def problem(*overrides):
        own = beam(*overrides)
        return problem_of(own.structure, own.screened)

    run.problem = problem
    return run


ROM, EXACT = "validate.truth.model=rom", ("tolerances=none", "train.settle=none")
"""Without tolerances, so that the grid filter's σ is that of the samples alone, and from rest, where all filters begin alike."""


def test_the_density_of_a_parameter_has_the_mean_and_the_sigma_that_are_claimed(validated):
    found = validated(ROM, "filter.compare=false").validated
    assert set(found.posterior) == set(PLACEMENT_CONFIG["place"]["estimate"]) & set(PLACEMENT_CONFIG["parameters"])
    for name, posterior in found.posterior.items():
        log = np.log(posterior.value)
        step = log[1] - log[0]
        mean = step * posterior.density @ log
        assert step * posterior.density.sum() == pytest.approx(1.0, abs=1e-5)
        std = np.sqrt(step * posterior.density @ (log - mean) ** 2)
        assert std == pytest.approx(found.std[name][-1] / found.estimate[name][-1], rel=1e-3)
        assert mean == pytest.approx(np.log(found.estimate[name][-1]), abs=1e-3 * std)
        assert posterior.left == pytest.approx(std / PLACEMENT_CONFIG["validate"]["initial_std"][name], rel=1e-3)
        assert len(posterior.peak) == 1


def test_the_filters_by_themselves_are_what_the_comparison_says(validated):
    exact = validated(ROM, *EXACT).validated
    found = exact.compared
    assert found.filter == ("grid", "sigma-point", "extended")
    for i, method in enumerate(found.filter):
        settings = (*EXACT, f"filter.method={method}", "filter.compare=false", "filter.drift=false")
        alone = exact if method == "grid" else validated(ROM, *settings).validated
        for name, estimate in found.estimate.items():
            assert alone.estimate[name][-1] == pytest.approx(estimate[i], rel=1e-9)
            assert alone.std[name][-1] == pytest.approx(found.std[name][i], rel=1e-6)
    for name, estimate in found.estimate.items():
        # of the logarithm, in which the filters have their means
        off, std = np.log(estimate / estimate[0]), found.std[name] / estimate
        np.testing.assert_allclose(found.ratio[name], np.hypot(std[0], off) / std, rtol=1e-9)


def test_where_exact_readings_have_no_posterior_nothing_is_compared_which_is_reported(validated, monkeypatch):
    def refuses(*_, **__):
        raise NumericalError("no lattice")

    compared = filtering.compared

    def compare_without_grid_filter(*args, **options):
        with monkeypatch.context() as patch:
            patch.setattr(filtering, "filter_on_grid", refuses)
            return compared(*args, **options)

    monkeypatch.setattr(validation, "compared", compare_without_grid_filter)
    empty = validated(*EXACT, "validate.duration=0.02").validated.compared
    assert disagreements_in_words(empty) == [
        "filters are not compared: without tolerances no parameter values are consistent with the readings"
    ]
    assert ratios(empty) == {}
    for row in comparison_table(empty, dict.fromkeys(empty.estimate, "Pa")).rows:
        assert row[1] == "no posterior"


ACCELEROMETERS = "motion_sensors={acc: {quantity: acceleration, noise_std: {value: 0.5}}}"


def test_filters_that_take_damping_for_exact_have_the_noise_of_the_motion_on_accelerometers_too(validated):
    """What a grid filter leaves out is added again: the model is that of a config which states the noise."""
    models = []
    for stated in ("null", "0.01"):
        problem = validated.problem(f"process_noise.model_error={stated}", ACCELEROMETERS)
        moving = np.flatnonzero(problem.channels.quantity == ACCELERATION)[:2]
        models.append((problem, filter_model(problem, np.concatenate([[0], moving]), problem.h)))
    (left_out, grid_run), (_, stated) = models
    damped = exactly_damped(left_out, grid_run)
    assert (grid_run.r < stated.r)[1:].all()
    np.testing.assert_allclose(damped.r, stated.r, rtol=1e-12)
    np.testing.assert_allclose(damped.Q, stated.Q, rtol=1e-12)


def test_a_stated_sigma_is_that_of_the_sensor_and_leaves_the_noise_of_the_motion(validated):
    """An accelerometer said to be as good as the pool has it is none the better for being said so; a better one gains that."""
    problem = validated.problem("process_noise.model_error=0.01", ACCELEROMETERS)
    moving = np.flatnonzero(problem.channels.quantity == ACCELERATION)[:2]
    plain, same, better = (
        filter_model(problem, moving, problem.h, sigma=own).r
        for own in (None, np.array([np.nan, 0.5]), np.array([0.1, 0.1]))
    )
    np.testing.assert_allclose(same, plain, rtol=1e-12)
    np.testing.assert_allclose(plain - better, (0.5**2 - 0.1**2) * problem.h, rtol=1e-9)
    assert np.all(better > 0.1**2 * problem.h)


def test_the_comparison_is_of_the_samples_alone_whatever_the_tolerances(validated):
    wide, exact = validated(ROM, "tolerances={gain: 0.05}", EXACT[1]).validated, validated(ROM, *EXACT).validated
    np.testing.assert_array_equal(wide.gauge.measured, exact.gauge.measured)
    for name in exact.compared.std:
        np.testing.assert_allclose(wide.compared.std[name], exact.compared.std[name], rtol=1e-9)
        assert wide.std[name][-1] > exact.std[name][-1]


def test_sigma_points_let_a_parameter_drift_only_if_asked(validated):
    """A constant is never known less well from one sample to the next; one that drifts is in the end known worse than that."""
    constant, drifting = (
        validated("filter.method=sigma-point", *more).validated.std["E"] for more in ((), ("filter.drift=true",))
    )
    assert np.all(np.diff(constant) <= 1e-9 * constant[0])
    assert drifting[-1] > constant[-1]


def test_two_estimates_that_exclude_each_other_are_named():
    """13 % apart at 0.2 % each; 5σ of both together is what they may differ by."""

    def words(value):
        return excluded({"E": (value, 0.002 * value)}, {"E": (1.8e11, 3.6e8)})

    assert words(2.04e11) == "E = 2.04e+11 ± 0.2 % or 1.8e+11 ± 0.2 %"
    apart = 5 * np.hypot(0.002, 0.002)
    assert words(1.8e11 * np.exp(1.01 * apart))
    assert not words(1.8e11 * np.exp(0.99 * apart))
    assert not words(np.nan)
    assert excluded_in_words(words(2.04e11), True, "estimate.start").endswith("check estimate.start)")
    assert not excluded_in_words("", True, "estimate.start")


PERIOD = 50
"""Steps of a period of 20 Hz."""
RAMP = {"type": "csv", "file": "ramp.csv", "time_column": "t", "value_column": "F"}
SWEEP = {"type": "sweep", "start_frequency": 5.0, "end_frequency": 30.0, "duration": 0.1, "amplitude": 100.0}
REST = {"train.settle": "none"}


@pytest.fixture(scope="module")
def beam(tmp_path_factory):
    """Changes of the config → the small beam with its training simulation."""
    folder = tmp_path_factory.mktemp("settle")
    (folder / "ramp.csv").write_text("t,F\n-0.05,0\n1,1000\n", encoding="utf-8")
    return beam_in(folder)


def true_reading(beam, changes):
    """Readings of the gauges in the simulated test without noise (T + 1, k)."""
    simulated = trial(beam(changes))
    return simulated.reading(simulated.chosen)


def test_the_training_run_repeats_itself_by_itself_and_not_from_rest(beam):
    settled, rest, default = (beam(changes).training for changes in ({"train.settle": "auto"}, REST, {}))
    for part in ("coordinate", "velocity", "acceleration"):
        periodic, free = getattr(settled, part), getattr(rest, part)
        assert apart(periodic[PERIOD:], periodic[:-PERIOD]) < 1e-9
        assert apart(free[PERIOD:], free[:-PERIOD]) > 0.05
        np.testing.assert_array_equal(getattr(default, part), periodic)
    assert not rest.coordinate[0].any()
    assert not rest.velocity[0].any()


def test_seconds_before_the_start_tend_to_the_steady_state_with_the_decay_of_the_first_mode(beam):
    """ζ = 0.05: the free vibration that is left, e^(−ζω₁t) of the one from rest."""
    settled = beam({"damping.ratio": 0.05})
    left = {
        t: apart(beam({"damping.ratio": 0.05, "train.settle": t}).training.reading(), settled.training.reading())
        for t in (0.25, 0.5, 1.0)
    }
    rate = 0.05 * 2 * np.pi * settled.reduced.frequency[0]
    assert np.log(left[0.25] / left[0.5]) == pytest.approx(0.25 * rate, rel=0.2)
    assert np.log(left[0.5] / left[1.0]) == pytest.approx(0.5 * rate, rel=0.2)


def test_a_history_is_taken_from_before_the_start_where_the_record_has_it(beam):
    """In 0.04 s from −0.04 s on; a record from −0.05 s has no 0.06 s, and a sweep has nothing."""
    ramp = {"loads.tip.signal": RAMP, "damping.ratio": 0.05}
    assert np.abs(beam({**ramp, "train.settle": 0.04}).training.coordinate[0]).max() > 0
    with pytest.raises(ConfigError, match=r"settle: .* covers -0\.05 to 1 s, but the run requires -0\.06 to 0 s") as caught:
        beam({**ramp, "train.settle": 0.06})
    assert "auto or none" in caught.value.remedy
    with pytest.raises(ConfigError, match=r"train\.settle: a sweep begins at t = 0"):
        beam({"loads.tip.signal": SWEEP, "train.settle": 0.05})


@pytest.mark.parametrize("signal", [RAMP, SWEEP], ids=["csv", "sweep"])
def test_what_is_not_periodic_starts_from_rest(beam, signal):
    default, rest = (beam({"loads.tip.signal": signal, **more}).training for more in ({}, REST))
    np.testing.assert_array_equal(default.reading(), rest.reading())
    assert not default.coordinate[0].any()


@pytest.mark.parametrize(("model", "tolerance"), [("rom", 1e-9), ("modes", 1e-9), ("perturbed", 1e-9), ("full", 1e-5)])
def test_the_truth_begins_as_the_training_run_does(beam, model, tolerance):
    """Periodic in what the gauges read; the whole model's step and hold leave 2e-6 of free vibration."""
    reading = true_reading(beam, {"validate.truth.model": model})
    assert apart(reading[PERIOD:], reading[:-PERIOD]) < tolerance


def test_the_whole_model_moves_as_its_modes_do(beam):
    full, modes = (
        true_reading(beam, {"validate.truth.modes": 12, "validate.truth.model": model}) for model in ("full", "modes")
    )
    assert apart(full, modes) < 1e-5


@pytest.mark.parametrize(
    ("changes", "warned"),
    [
        ({}, False),
        ({"loads.tip.signal": RAMP}, True),
        ({"loads.tip.signal": RAMP, **REST}, False),
        (REST, False),
        ({"train.settle": 0.01}, True),
        ({"train.settle": 3.0}, False),
    ],
)
def test_instants_in_what_a_start_from_rest_has_set_off_are_reported(beam, changes, warned):
    """3/(ζω₁) is some 0.7 s here, and the run 0.1 s."""
    small = beam(changes)
    problem = small.problem
    at = placed_instants(problem, problem.model.reference, problem.x, small.case.config)
    message = ringing_in_words(problem.run.settle, problem.loading, problem.model, at)
    assert message.startswith("2 of 2 linearisation instants") is warned
    if changes.get("train.settle") == 0.01:
        assert message in api.place(small.case, small.mesh, small.reduced, small.training, small.screened).advice
    assert bool(message) is warned


@pytest.mark.parametrize("settle", ["auto", "none", 0.2])
def test_place_and_validate_tell_the_filter_the_same_of_the_start(beam, monkeypatch, settle):
    """P₀ of the motion: its largest training amplitude where it moves, a thousandth of it at rest; it covers x(0)."""
    small, seen = beam({"train.settle": settle, "train.duration": 0.03, "validate.duration": 0.03}), []
    recursion = expecting.predict_grid_std
    noted = lambda m, x, u, P, *rest: seen.append(P) or recursion(m, x, u, P, *rest)  # noqa: E731
    monkeypatch.setattr(expecting, "predict_grid_std", noted)
    training = small.training
    api.expect(small.case, small.mesh, small.reduced, training, small.screened, small.gauges)
    covariance, n = trial(small).covariance, 2 * small.reduced.model.size
    np.testing.assert_array_equal(seen[0][:n, :n], covariance[:n, :n])
    largest = np.abs(np.hstack([training.coordinate, training.velocity])).max(axis=0)
    std = np.sqrt(np.diag(covariance)[:n])
    np.testing.assert_allclose(std, (1e-3 if settle == "none" else 1.0) * largest, rtol=1e-12)
    assert np.all(np.abs(np.hstack([training.coordinate[0], training.velocity[0]])) <= std * (1 + 1e-12))
    moving = initial_covariance(small.problem, dict.fromkeys(small.problem.unknowns.names, 1.0), moving=True)
    assert (np.diag(moving)[:n] >= std**2 * (1 - 1e-12)).all()


def test_an_estimate_is_found_from_the_first_period_of_a_motion_under_way(validated):
    """Of the filter's own model without noise to speak of: E to 1 %, with the guess 10 % off and the mean at rest."""
    assert PLACEMENT_CONFIG["parameters"]["E"]["guess"] == 0.9 * E
    estimate = validated("validate.truth.model=rom", "filter.compare=false").validated.estimate["E"]
    assert estimate[-1] == pytest.approx(E, rel=0.01)


@pytest.fixture(scope="module")
def hub():
    """settle → artefacts of E and ρ of the hub under 20 Hz, up to place, with gauges installed exactly."""
    config = ROOT / "configs" / "hub" / "hub-youngs-modulus-density.yaml"
    return {
        s: made(config, f"train.settle={s}", "tolerances=none", *FEW, until="place", beside=HUB) for s in ("auto", "none")
    }


@pytest.mark.slow
def test_a_slow_load_tells_no_density_of_the_hub_but_by_the_vibration_of_its_start(hub):
    """The first mode, f₁ = 485 Hz, rings for 3/(ζω₁) = 0.1 s of 0.5 s. Without it the readings of a load of 20 Hz hold ρ by its
    share (20 Hz/f₁)² alone, which E has to be known without."""
    settled, rest = (hub[s]["place"].summary for s in ("auto", "none"))
    share = (20 / hub["auto"]["rom"]["/frequency"][0]) ** 2
    assert settled["std.rho"] > 0.15
    assert rest["std.rho"] < 0.05
    assert np.sqrt(settled["std.E"] ** 2 - rest["std.E"] ** 2) == pytest.approx(share * settled["std.rho"], rel=0.3)


@pytest.mark.slow
def test_the_joint_cases_of_the_hub_are_beyond_their_best_single_ones_as_in_figure_6_9(hub):
    condition = {
        s: {k.removeprefix("condition."): v for k, v in hub[s]["observe"].summary.items() if k.startswith("condition.")}
        for s in hub
    }
    for joint in ("input+E", "input+rho", "E+rho", "input+E+rho"):
        own = condition["auto"]
        assert own[joint] > 700 * min(own[single] for single in joint.split("+"))
    assert condition["none"]["E+rho"] < 100 * condition["none"]["E"]
