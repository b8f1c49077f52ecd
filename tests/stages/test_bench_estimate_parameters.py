"""Parameters of a bench from its sensors: modulus and ball diameter, by the extended filter and by a bank."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.errors import ConfigError

from .conftest import BANK, DIAMETER, MODULUS, ROOT, job_of

WEIGHT = 1.4e4 * 9.81


@pytest.mark.slow
@pytest.mark.parametrize("zeroed", [False, True])
def test_a_hub_ten_per_cent_too_stiff_scales_loads_and_adds_a_tenth_of_the_weight_unless_gauges_are_zeroed(
    estimate, zeroed
):
    """û = 1.1 u + 0.1 G for loads at the blade's centre on a hub that weighs nothing itself; thesis figure 2.8."""
    found = estimate(
        MODULUS, "estimate.duration=4.0", "estimate.truth.noise=false",
        "estimate.parameters={E: {guess: 1.87e+11}}", "estimate.sensors={gauges: {noise: 1.0e-7}}",
        "bodies.hub.mesh.materials={iron: {regions: all, youngs_modulus: 1.7e+11, poisson_ratio: 0.275, density: 7.1}}",
        "frames.station.pose.origin=[17.0, 0.0, 0.0]", f"sensors.gauges.zeroed={str(zeroed).lower()}",
        *(f"estimate.inputs.F{k}={{std: 1.0e+5, increment: 3.0e+4}}" for k in "xyz"),
    )  # fmt: skip
    assert found.summary["slope.Fz"] == pytest.approx(1.10, abs=0.01)
    if zeroed:
        assert abs(found.summary["offset.Fz"]) < 0.002 * WEIGHT
    else:
        assert found.summary["offset.Fz"] == pytest.approx(-0.1 * WEIGHT, rel=0.02)


@pytest.mark.slow
def test_strains_and_displacements_identify_the_modulus_and_zeroed_strains_alone_do_not(estimate):
    common = ("estimate.duration=4.0", "sensors.gauges.zeroed=true")
    both = estimate(MODULUS, *common)
    alone = estimate(MODULUS, *common, "estimate.sensors={gauges: {noise: 1.0e-7}}")
    assert both.summary["identified.E"] is True
    assert both.summary["error.E"] < 4 * both.summary["std.E"] < 0.04
    assert alone.summary["identified.E"] is False
    assert alone.summary["std.E"] > 10 * both.summary["std.E"]


@pytest.mark.parametrize("convention", ["follow", "fixed"])
@pytest.mark.parametrize("guess", [0.0606, 0.0594])
def test_ball_diameter_is_found_from_one_per_cent_off(estimate, convention, guess):
    found = estimate(
        DIAMETER, f"bearings.pitch-bearing.groove_centres={convention}", "estimate.truth={model: own, noise: false}",
        f"estimate.parameters.diameter.guess={guess}", "estimate.duration=2.0", "estimate.time_step=0.2",
        "estimate.sensors={gauges: {noise: 1.0e-9}, relative: {noise: 1.0e-9}}",
    )  # fmt: skip
    assert found.summary["error.diameter"] < 1e-6
    assert found["/parameters/diameter/true"] == 0.06


def test_undamped_updates_lose_a_diameter_that_damped_ones_find(estimate):
    wrong = (
        "bearings.pitch-bearing.groove_centres=fixed", "estimate.truth={model: own, noise: false}",
        "estimate.duration=2.0", "estimate.time_step=0.2", "estimate.parameters.diameter.guess=0.0612",
        "estimate.parameters.diameter.std=1.2e-3",
    )  # fmt: skip
    undamped = estimate(DIAMETER, *wrong, "estimate.method.update=undamped")
    assert undamped.summary["lost"] == 1
    assert estimate(DIAMETER, *wrong).summary["error.diameter"] < 1e-6


def test_diameter_and_preload_are_one_unknown_where_groove_centres_stay():
    both = "estimate.parameters.preload={bearing: pitch-bearing, property: preload, std: 1.0e-6}"
    job_of(DIAMETER, ROOT, both)
    with pytest.raises(ConfigError, match="the same unknown") as refused:
        job_of(DIAMETER, ROOT, both, "bearings.pitch-bearing.groove_centres=fixed")
    assert refused.value.key == "estimate.parameters.preload"


def test_a_bank_is_of_three_constants_at_most():
    groove = "estimate.parameters.{0}={{bearing: pitch-bearing, property: radius_{0}, std: 1.0e-4}}"
    four = [groove.format(name) for name in ("inner_left", "inner_right", "outer_left")]
    job_of(DIAMETER, ROOT, BANK, *four[:2])
    with pytest.raises(ConfigError, match="4 parameters, a bank is of 3 at most") as refused:
        job_of(DIAMETER, ROOT, BANK, *four)
    assert refused.value.key == "estimate.method.parameters"
    with pytest.raises(ConfigError, match="in a bank parameters are constants") as refused:
        job_of(DIAMETER, ROOT, BANK, "estimate.parameters.diameter.increment=1.0e-6")
    assert refused.value.key == "estimate.parameters.diameter.increment"


def test_where_a_parameter_is_well_seen_bank_and_extended_filter_agree(estimate):
    """Two draws of noise: every history to a tenth of σ at the end, and the joints kept to rounding."""
    when = ("estimate.duration=0.9", "estimate.runs=2", "estimate.truth.model=own")
    bank, extended = estimate(DIAMETER, *when, BANK), estimate(DIAMETER, *when)
    for of in ("/parameters/diameter", "/inputs/Fy", "/inputs/Fz"):
        std = extended[f"{of}/std"][-1]
        assert abs(bank[f"{of}/estimate"][-1] - extended[f"{of}/estimate"][-1]) < 0.1 * std
        assert bank[f"{of}/std"][-1] == pytest.approx(std, rel=0.05)
    np.testing.assert_allclose(
        bank["/runs/parameters/diameter/std"], extended["/runs/parameters/diameter/std"], rtol=0.05
    )
    assert bank.summary["violation"] < 1e-14
    assert bank.summary["ratio.extended.diameter"] == pytest.approx(1.0, abs=0.05)
    assert "ratio.extended.diameter" not in extended.summary
    assert "filters compared" in str(bank.tables)


@pytest.mark.slow
def test_an_unknown_that_no_sensor_feels_is_refused_by_name(estimate):
    """The modulus of the hub moves no ring against the other."""
    with pytest.raises(ConfigError, match="no sensor feels it") as refused:
        estimate(MODULUS, "estimate.sensors={relative: {noise: 1.0e-6}}", "estimate.duration=0.2")
    assert refused.value.key == "estimate.parameters.E"


@pytest.mark.slow
def test_zeroed_gauges_are_expected_to_read_what_they_read_whatever_the_modulus(estimate):
    found = estimate(MODULUS, "estimate.duration=2.0", "sensors.gauges.zeroed=true", "estimate.truth.model=own")
    late = slice(len(found["/nis"]) // 2, None)
    off = found["/sensors/gauges/measured"][late] - found["/sensors/gauges/expected"][late]
    assert np.sqrt(np.mean(off**2)) < 2e-7


@pytest.mark.slow
def test_an_unknown_under_a_load_that_begins_at_zero_is_felt_all_the_same(estimate):
    """Nothing loads the hub at the start but what its unknown loads may be."""
    found = estimate(MODULUS, "forces.weight.acceleration=[0.0, 0.0, 0.0]", "estimate.duration=1.0")
    assert "E" in str(found.tables)
