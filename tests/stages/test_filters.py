"""The filters of a structure beside the bank: each by itself ends where the comparison has it, and the verdicts follow."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from strainsight import api
from strainsight.cases.filters_compared import comparison_table, disagreements_in_words, ratios
from strainsight.cases.structure import compared
from strainsight.cases.structure.excluded import excluded, excluded_in_words
from strainsight.cases.structure.problem import exactly_damped, filter_model, problem_of
from strainsight.errors import NumericalError
from strainsight.gauges.candidates import ACCELERATION
from strainsight.records.estimated import Compared

from ..edges.beam import PLACEMENT_CONFIG, bricks

SHORT = ("validate.repeats=1", "validate.random_sets=0", "validate.noise_factors=[]")


@pytest.fixture(scope="module")
def validated(tmp_path_factory):
    """What validates three gauges of a small beam, with overrides."""
    folder = tmp_path_factory.mktemp("beam")
    (folder / "beam.bdf").write_text(bricks((6, 2, 2)), encoding="ascii")
    (folder / "edge.yaml").write_text(yaml.safe_dump(PLACEMENT_CONFIG), encoding="utf-8")

    def case(*overrides):
        return api.load(folder / "edge.yaml", [*SHORT, *overrides])

    plain = case()
    mesh = api.mesh(plain)
    reduced = api.reduce(plain, mesh)
    training = api.train(plain, mesh, reduced)
    screened = api.screen(plain, mesh, reduced, training)

    def run(*overrides):
        return api.validate(case(*overrides), mesh, reduced, training, screened, screened.kept[:3])

    def problem(*overrides):
        own = case(*overrides)
        trained = api.train(own, mesh, reduced)
        return problem_of(own.config, own.files, reduced, trained, api.screen(own, mesh, reduced, trained))

    run.problem = problem
    return run


def test_the_density_of_a_parameter_has_the_mean_and_the_sigma_that_are_claimed(validated):
    found = validated("filter.compare=false").validated
    assert set(found.posterior) == set(PLACEMENT_CONFIG["place"]["estimate"]) & set(PLACEMENT_CONFIG["parameters"])
    for name, own in found.posterior.items():
        log = np.log(own.value)
        step = log[1] - log[0]
        mean = step * own.density @ log
        assert step * own.density.sum() == pytest.approx(1.0, abs=1e-5)
        std = np.sqrt(step * own.density @ (log - mean) ** 2)
        assert std == pytest.approx(found.std[name][-1] / found.estimate[name][-1], rel=1e-3)
        assert mean == pytest.approx(np.log(found.estimate[name][-1]), abs=1e-3 * std)
        assert own.left == pytest.approx(std / PLACEMENT_CONFIG["validate"]["initial_std"][name], rel=1e-3)
        assert len(own.peak) == 1


def test_the_filters_by_themselves_are_what_the_comparison_says(validated):
    """Without tolerances, so that the bank's σ is that of the samples alone, and from rest, where all begin alike; parameters are
    constants in all three."""
    plain = "tolerances=none", "train.settle=none"
    found = validated(*plain).validated.compared
    assert found.filter == ("bank", "sigma-point", "extended")
    for i, method in enumerate(found.filter):
        drift = [] if method == "bank" else ["filter.drift=false"]
        alone = validated(*plain, f"filter.method={method}", "filter.compare=false", *drift).validated
        assert alone.compared is None
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

    monkeypatch.setattr(compared, "filter_bank", refuses)
    own = validated().validated.compared
    assert disagreements_in_words(own) == [
        "filters are not compared: without tolerances the readings leave no posterior of the parameters"
    ]
    assert ratios(own) == {}
    for row in comparison_table(own, dict.fromkeys(own.estimate, "Pa")).rows:
        assert row[1] == "no posterior"
        assert not any(word in cell for cell in row for word in ("consistent", "overconfident", "cautious"))


def test_filters_that_take_damping_for_exact_have_the_noise_of_the_motion_on_accelerometers_too(validated):
    """What a bank leaves out is added again: the model is that of a config which states the noise."""
    models = []
    for stated in ("null", "0.01"):
        sensors = "motion_sensors={acc: {quantity: acceleration, noise_std: {value: 0.5}}}"
        problem = validated.problem(f"process_noise.model_error={stated}", sensors)
        moving = np.flatnonzero(problem.channels.quantity == ACCELERATION)[:2]
        models.append((problem, filter_model(problem, np.concatenate([[0], moving]), problem.h)))
    (left_out, bank), (_, stated) = models
    damped = exactly_damped(left_out, bank)
    assert (bank.r < stated.r)[1:].all()
    np.testing.assert_allclose(damped.r, stated.r, rtol=1e-12)
    np.testing.assert_allclose(damped.Q, stated.Q, rtol=1e-12)


def test_a_stated_sigma_is_that_of_the_sensor_and_leaves_the_noise_of_the_motion(validated):
    """An accelerometer said to be as good as the pool has it is none the better for being said so; a better one gains that."""
    sensors = "motion_sensors={acc: {quantity: acceleration, noise_std: {value: 0.5}}}"
    problem = validated.problem("process_noise.model_error=0.01", sensors)
    moving = np.flatnonzero(problem.channels.quantity == ACCELERATION)[:2]
    plain, same, better = (
        filter_model(problem, moving, problem.h, stated=own).r
        for own in (None, np.array([np.nan, 0.5]), np.array([0.1, 0.1]))
    )
    np.testing.assert_allclose(same, plain, rtol=1e-12)
    np.testing.assert_allclose(plain - better, (0.5**2 - 0.1**2) * problem.h, rtol=1e-9)
    assert np.all(better > 0.1**2 * problem.h)


def test_the_comparison_is_of_the_samples_alone_whatever_the_tolerances(validated):
    """None of its filters knows of any: the same samples have the same comparison."""
    settings = ("validate.truth.model=rom", "filter.compare=true")
    wide, exact = (
        validated(*settings, f"tolerances={own}").validated for own in ("{gain: 0.05}", "none")
    )
    np.testing.assert_array_equal(wide.gauge.measured, exact.gauge.measured)
    for name in exact.compared.std:
        np.testing.assert_allclose(wide.compared.std[name], exact.compared.std[name], rtol=1e-9)
        assert wide.std[name][-1] > exact.std[name][-1]


def test_sigma_points_let_a_parameter_drift_only_if_asked(validated):
    """A constant is never known less well from one sample to the next; one that drifts is in the end known worse than that."""
    constant, drifting = (
        validated("filter.method=sigma-point", *own).validated.std["E"] for own in ((), ("filter.drift=true",))
    )
    assert np.all(np.diff(constant) <= 1e-9 * constant[0])
    assert drifting[-1] > constant[-1]


def test_what_disagrees_is_reported_in_words_and_stands_in_the_table():
    own = Compared(
        filter=("bank", "sigma-point", "extended"),
        estimate={"rho": np.array([7800.0, 7790.0, 8100.0]), "E": np.array([2e11, 2e11, np.nan])},
        std={"rho": np.array([300.0, 310.0, 90.0]), "E": np.array([1e9, 2.4e9, np.nan])},
        ratio={"rho": np.array([1.0, 0.97, 4.7]), "E": np.array([1.0, 0.42, np.nan])},
    )
    said = disagreements_in_words(own)
    assert said == [
        "the extended filter is overconfident of rho: the bank expects an error of 4.7 times its σ",
        "the extended filter diverges, of E it says nothing",
    ]
    assert disagreements_in_words(None) == []
    rows = {row[0]: row[1:] for row in comparison_table(own, {"rho": "kg/m³", "E": "Pa"}).rows}
    assert "consistent" in rows["rho"][1]
    assert "overconfident (4.7)" in rows["rho"][2]
    assert "too cautious (0.42)" in rows["E"][1]
    assert rows["E"][2] == "diverged"


def test_two_estimates_that_exclude_each_other_are_named():
    """13 % apart at 0.2 % each; 5σ of both together is what they may differ by."""

    def words(value):
        return excluded({"E": (value, 0.002 * value)}, {"E": (1.8e11, 3.6e8)})

    assert words(2.04e11) == "E is 2.04e+11 ± 0.2 % or 1.8e+11 ± 0.2 %"
    apart = 5 * np.hypot(0.002, 0.002)
    assert words(1.8e11 * np.exp(1.01 * apart))
    assert not words(1.8e11 * np.exp(0.99 * apart))
    assert not words(np.nan)
    assert excluded_in_words(words(2.04e11), True, "estimate.start").endswith("check estimate.start")
    assert not excluded_in_words("", True, "estimate.start")
