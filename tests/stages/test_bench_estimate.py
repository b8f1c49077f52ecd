"""The estimate of a bench: loads, bearing and hub from their sensors, the thesis's conclusions, and what is refused."""

from __future__ import annotations

import csv
import io
import re
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from strainsight.errors import ConfigError
from strainsight.workflow.artefact import Artefact
from strainsight_cli.main import app

from .conftest import BENCHES, ROOT, job_of, made
from .test_artefacts import UNITS_OF

LOADS = ROOT / "configs" / "bench" / "loads.yaml"
DIAMETER = ROOT / "configs" / "bench" / "diameter.yaml"
MODULUS = ROOT / "configs" / "bench" / "modulus.yaml"
SMALL = ROOT / "configs" / "bench" / "small.yaml"
WEIGHT = 1.4e4 * 9.81
EXACT = ("estimate.sensors={gauges: {noise: 0.0}}", "estimate.truth={model: own, noise: false}")
ALL_OF_THE_BEARING = "estimate.parameters={" + ", ".join(
    f"{name}: {{bearing: pitch-bearing, property: {name}, guess: {1.1 * value:.6g}}}"
    for name, value in (
        ("ball_diameter", 0.06), ("radius_inner_left", 0.0318), ("radius_inner_right", 0.0318),
        ("radius_outer_left", 0.0318), ("radius_outer_right", 0.0318),
    )
) + "}"  # fmt: skip


BANK = "estimate.method.parameters=bank"


@pytest.fixture(scope="session")
def estimate():
    """overrides → the artefact of an estimate, its hub reduced once for all."""

    def of(config, *overrides, stage="estimate"):
        return made(config, "simulate.duration=1.0", *overrides, until=stage, beside=BENCHES)[stage]

    return of


@pytest.mark.parametrize("h", [pytest.param(0.02, marks=pytest.mark.slow), 0.1])
def test_without_noise_on_its_own_step_the_iterated_filter_has_the_loads_to_1e_7(estimate, h):
    when = (f"estimate.time_step={h}", "estimate.duration=1.0", *EXACT)
    iterated = estimate(LOADS, *when)
    one_shot = estimate(LOADS, *when, "estimate.method.update=one_shot")
    for name in ("Fx", "Fy", "Fz"):
        assert iterated.summary[f"error.{name}"] < 1e-7
        assert iterated.summary[f"error.{name}"] < one_shot.summary[f"error.{name}"] < 1e-4
    assert iterated.summary["violation"] < 1e-14
    assert one_shot.summary["violation"] < 1e-14


def test_against_a_finely_integrated_truth_the_loads_are_right_to_2e_3_at_a_step_of_300_ms(estimate):
    found = estimate(
        LOADS, "simulate.duration=9.0", "estimate.time_step=0.3", "estimate.truth.noise=false",
        "estimate.sensors.gauges.noise=1.0e-9", *(f"estimate.inputs.F{k}.increment=1.0e+4" for k in "xyz"),
    )  # fmt: skip
    assert max(found.summary[f"error.F{k}"] for k in "xyz") < 2e-3


def test_a_wrong_bearing_leaves_the_loads_right_and_its_own_displacements_wrong(estimate):
    """Strains only feel the load that passes through: thesis figure 2.7."""
    found = estimate(
        DIAMETER, "estimate.time_step=0.1", "estimate.duration=3.0", "estimate.truth.noise=false", ALL_OF_THE_BEARING,
        "estimate.sensors={gauges: {noise: 1.0e-9}}",
    )  # fmt: skip
    for name in ("Fx", "Fy", "Fz"):
        assert found.summary[f"slope.{name}"] == pytest.approx(1.0, abs=0.005)
    assert found.summary["mismatch.relative"] > 0.02
    assert not found["/sensors/relative/used"]


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
        "estimate.duration=2.0", "estimate.time_step=0.2",
    )  # fmt: skip
    undamped = estimate(DIAMETER, *wrong, "estimate.method.update=undamped")
    assert undamped.summary["lost"] == 1
    assert estimate(DIAMETER, *wrong).summary["error.diameter"] < 1e-6


@pytest.mark.slow
def test_a_small_bench_with_five_loads_moves_its_bearing_as_the_large_one_and_with_three_it_does_not(estimate, bench):
    large = ("estimate.duration=1.0", f"estimate.measured.from={bench['simulate'].path}")
    three = estimate(SMALL, *large)
    five = estimate(
        SMALL,
        *large,
        "estimate.sensors.relative.noise=1.0e-9",
        *(f"estimate.inputs.M{k}={{std: 1.0e+5, increment: 1.0e+4}}" for k in "yz"),
    )
    assert five.summary["mismatch.relative"] < 1e-4
    assert three.summary["mismatch.relative"] > 0.01
    assert {f"mismatch.relative.{i}" for i in range(1, 6)} <= three.summary.keys()
    assert three.summary["ratio_high.Fx"] > 1.5 * three.summary["ratio_low.Fx"] or three.summary["ratio_low.Fx"] < 0


@pytest.mark.slow
def test_a_bench_of_half_the_size_with_everything_scaled_needs_a_quarter_of_the_loads(estimate):
    """Displacements, preload × s, g/s, static loads: all strains are those of the large bench, forces go with s²."""
    static = tuple(
        f"forces.F{k}.signal={{type: constant, value: {v}}}" for k, v in zip("xyz", (3e4, 2e4, 4e4), strict=True)
    )
    large = estimate(ROOT / "configs" / "bench-full.yaml", *static, stage="simulate")
    found = estimate(
        SMALL, "estimate.duration=1.0", f"estimate.measured={{from: {large.path}, scale: 0.5}}",
        "estimate.sensors.relative.noise=1.0e-9",
        "bearings.pitch-bearing.preload=5.0e-6", "forces.weight.acceleration=[0.0, 0.0, -19.62]",
    )  # fmt: skip
    for name in ("Fx", "Fy", "Fz"):
        assert found.summary[f"ratio_slope.{name}"] == pytest.approx(0.25, abs=1e-5)
    assert found.summary["mismatch.relative"] < 1e-6


def test_loads_are_written_as_a_command_history(estimate):
    found = estimate(LOADS, "estimate.duration=0.2", *EXACT)
    rows = list(csv.reader(io.StringIO((found.path.parent / "loads.csv").read_text(encoding="utf-8"))))
    assert rows[0] == ["time", "Fx", "Fy", "Fz"]
    np.testing.assert_allclose(np.array(rows[1:], dtype=float)[:, 3], found["/inputs/Fz/estimate"], rtol=1e-8)


def test_noise_of_zero_is_raised_and_reported(estimate):
    found = estimate(LOADS, "estimate.duration=0.2", "estimate.sensors.gauges.noise=0.0")
    assert "the noise of gauges is raised from 0" in str(found.tables)


@pytest.mark.parametrize(
    ("config", "change", "key", "what"),
    [
        (LOADS, "sensors.gauges.gauges=[{position: [0.918, 0.94, -1.372], direction: [0, 0, 1]}]", "estimate.sensors",
         "1 channels for 3 unknown loads"),
        (LOADS, "estimate.sensors.gauge={noise: 1.0e-7}", "estimate.sensors.gauge", "did you mean gauges"),
        (LOADS, "estimate.inputs.weight={std: 1.0, increment: 1.0}", "estimate.inputs.weight", "no force or moment"),
        (LOADS, "estimate.sensors.gauges.noise=[1.0e-7, 1.0e-7]", "estimate.sensors.gauges.noise", "2 noises for 4"),
        (LOADS, "estimate.time_step=0.07", "estimate.time_step", "does not divide"),
        (DIAMETER, "estimate.parameters.diameter.guess=0.066", "estimate.parameters.diameter.guess", "would not pass a ball"),
        (LOADS, "estimate.parameters.Fx={bearing: pitch-bearing, property: preload, std: 1.0e-6}", "estimate.parameters.Fx",
         "a load of the estimate has the same name"),
        (SMALL, "estimate.truth.model=own", "estimate.truth.model", "beside measurements from another bench"),
        (DIAMETER, "estimate.parameters.diameter.starts=[0.066]", "estimate.parameters.diameter.starts", "would not pass"),
        (DIAMETER, "estimate.parameters.diameter={guess: 0.0606, std: 1.0e-4}", "estimate.parameters.diameter", "no modulus"),
        (LOADS, BANK, "estimate.method.parameters", "no parameter is estimated"),
        (DIAMETER, "estimate.method={parameters: bank, update: one_shot}", "estimate.method.update", "a form of the extended"),
    ],
)  # fmt: skip
def test_contradictions_are_refused_with_their_place(config, change, key, what):
    with pytest.raises(ConfigError) as refused:
        job_of(config, ROOT, change)
    assert refused.value.key == key
    assert what in str(refused.value)


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
def test_a_bench_without_weight_and_loads_stays_at_rest(estimate):
    """Nothing deforms the hub: its coordinates are rounding, which no iteration can settle to twelve digits."""
    found = estimate(
        SMALL,
        "forces.weight.acceleration=[0.0, 0.0, 0.0]",
        "simulate.duration=0.1",
        "estimate.measured=null",
        stage="simulate",
    )
    assert np.abs(found["/q"] - found["/q"][0]).max() < 1e-12


def test_every_dataset_and_number_is_listed_in_the_docs(estimate, bench):
    text = (ROOT / "docs" / "artefacts.md").read_text(encoding="utf-8")
    text = text.split("## estimate.h5 of a bench\n")[1].split("\n## ")[0]
    rows = {}
    for path, shape, unit in re.findall(r"^\| `([^`]+)` \| ([^|]+) \| ([^|]+) \|", text, flags=re.MULTILINE):
        pattern = re.escape(path).replace("<name>", r"[\w-]+")
        rows[pattern] = 0 if shape.strip() == "scalar" else shape.count("×") + 1, unit.strip()
    scalars = [
        re.escape(name).replace("<name>", r"[\w-]+").replace("<i>", r"\d+")
        for name in re.findall(r"`([^`]+)`", text.split("Summary:")[1])
    ]
    found = [
        estimate(DIAMETER, "estimate.duration=0.9", "estimate.runs=2"),
        estimate(DIAMETER, "estimate.duration=0.3", BANK),
        estimate(SMALL, "estimate.duration=0.5", f"estimate.measured.from={bench['simulate'].path}"),
    ]
    seen = set()
    for artefact in found:
        for path in artefact.paths():
            (pattern,) = [pattern for pattern in rows if re.fullmatch(pattern, path)]
            seen.add(pattern)
            rank, unit = rows[pattern]
            assert artefact[path].ndim == rank, path
            assert artefact.attributes(path)["units"] in UNITS_OF.get(unit, (unit,)), path
        for name in artefact.summary:
            assert any(re.fullmatch(scalar, name) for scalar in scalars), name
    assert seen == set(rows)


def test_a_drawn_truth_is_estimated_as_well_as_claimed(estimate):
    """Six seeds of loads, start and disturbance from the filter's own model: innovations and errors of their claimed size."""
    found = estimate(
        LOADS, "estimate.truth.model=walk", "estimate.runs=6", "estimate.duration=2.0", "estimate.disturbance=1.0e-3"
    )
    assert found.summary["nis"] == pytest.approx(1.0, abs=0.2)
    for name in ("Fx", "Fy", "Fz"):
        assert 0.6 < found.summary[f"ratio.{name}"] < 1.5


def test_an_increment_in_a_second_is_one_in_a_step_over_its_length(estimate):
    step = estimate(LOADS, "estimate.duration=0.5", "estimate.truth.model=own")
    inputs = ", ".join(f"F{k}: {{std: 1.0e+4, increment: 4.0e+4}}" for k in "xyz")
    second = estimate(
        LOADS, "estimate.duration=0.5", "estimate.truth.model=own", "estimate.increments=second",
        f"estimate.inputs={{{inputs}}}",
    )  # fmt: skip
    np.testing.assert_allclose(second["/inputs/Fz/estimate"], step["/inputs/Fz/estimate"], rtol=1e-9)


def test_gauges_zeroed_under_known_loads_serve_whatever_is_guessed_of_the_test(estimate):
    """The zero is of the history's first loads; a guess of zero beside it spoils nothing."""
    found = estimate(
        LOADS, "estimate.truth={model: own, noise: false}", "estimate.sensors.gauges.noise=1.0e-9", "estimate.duration=1.0",
        "sensors.gauges.zeroed=true", *(f"estimate.inputs.F{k}={{guess: 0.0, std: 3.0e+4, increment: 2.0e+3}}" for k in "xyz"),
    )  # fmt: skip
    assert max(found.summary[f"error.F{k}"] for k in "xyz") < 1e-3
    assert found.summary["mismatch.gauges"] < 1e-3


@pytest.mark.slow
def test_zeroed_gauges_are_expected_to_read_what_they_read_whatever_the_modulus(estimate):
    found = estimate(MODULUS, "estimate.duration=2.0", "sensors.gauges.zeroed=true", "estimate.truth.model=own")
    late = slice(len(found["/nis"]) // 2, None)
    off = found["/sensors/gauges/measured"][late] - found["/sensors/gauges/expected"][late]
    assert np.sqrt(np.mean(off**2)) < 2e-7


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (
            "estimate.measured.sensors={relative: tip}",
            "'relative' has 5 channels in m or rad, sensors/tip there 3 in m",
        ),
        ("estimate.measured.sensors={relative: relativ}", "did you mean relative"),
        ("estimate.measured.inputs={Fx: My}", "no input 'My'"),
        ("estimate.time_step=0.025", "does not divide the filter's step"),
    ],
)
def test_another_bench_that_cannot_be_imported_is_refused(estimate, bench, change, what):
    with pytest.raises(ConfigError, match=re.escape(what)) as refused:
        estimate(SMALL, f"estimate.measured.from={bench['simulate'].path}", "estimate.duration=1.0", change)
    assert refused.value.key.startswith("estimate.measured")


def test_a_diverged_estimate_writes_no_command_history_and_says_so(estimate):
    found = estimate(
        DIAMETER, "bearings.pitch-bearing.groove_centres=fixed", "estimate.truth={model: own, noise: false}",
        "estimate.duration=2.0", "estimate.time_step=0.2", "estimate.method.update=undamped",
    )  # fmt: skip
    assert not (found.path.parent / "loads.csv").exists()
    assert np.isnan(found["/inputs/Fx/std"][-1])
    assert "diverged" in str(found.tables)


@pytest.mark.parametrize("increment", [1.0e-3, 300.0])
def test_an_estimate_beyond_its_claim_is_called_overconfident(estimate, increment):
    """Fz off by 4000 times its σ, and by 2.7 times, which no record of half as many independent errors explains."""
    found = estimate(LOADS, "estimate.duration=2.0", *(f"estimate.inputs.F{k}.increment={increment}" for k in "xyz"))
    text = str(found.tables)
    assert "Fz is overconfident" in text
    assert "innovations are" in text
    assert increment < 1 or found.summary["error.Fz"] < 3 * found.summary["std.Fz"]


def test_an_unknown_under_a_load_that_begins_at_zero_is_felt_all_the_same(estimate):
    """Nothing loads the hub at the start but what its unknown loads may be."""
    found = estimate(MODULUS, "forces.weight.acceleration=[0.0, 0.0, 0.0]", "estimate.duration=1.0")
    assert "E" in str(found.tables)


PLACED = ("sensors.gauges={type: strain, body: beam, layout: place}",)


@pytest.fixture(scope="module")
def from_scratch(tmp_path_factory):
    """The config of the manual beside its mesh: its runs take the beam over from each other."""
    folder = tmp_path_factory.mktemp("scratch")
    text = (ROOT / "docs" / "bench.md").read_text(encoding="utf-8").split("## A bench from scratch\n```yaml\n")[1]
    (folder / "beam.yaml").write_text(text.split("```")[0], encoding="utf-8")
    shutil.copy(ROOT / "meshes" / "cantilever.bdf", folder)
    return folder


@pytest.mark.parametrize(
    ("more", "last"),
    [
        ((), "estimate"),
        (("estimate.parameters={E: {guess: 2.3e+11, std: 2.0e+10}}",), "estimate"),
        ((*PLACED, "place={body: beam, noise: 1.0e-7, keep: 2}"), "estimate"),
        ((*PLACED, "place={body: beam, noise: 1.0e-7, keep: 3}"), "place"),
    ],
)
def test_the_bench_of_the_manual_runs_as_it_says(from_scratch, tmp_path, more, last):
    name, results = f"beam-{tmp_path.name}", from_scratch / "r"
    options = [part for change in (f"name={name}", *more) for part in ("--set", change)]
    done = CliRunner().invoke(app, [last, str(from_scratch / "beam.yaml"), "--results", str(results), *options])
    assert done.exit_code == 0, done.output
    found = Artefact(results / name / f"{last}.h5").summary
    assert found["error.F"] < 0.1 if last == "estimate" else found["selected"] == 3
