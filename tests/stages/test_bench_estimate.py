"""The estimate of a bench: what is refused, what it writes, the bench of the manual, and readings of another bench."""

from __future__ import annotations

import re

import numpy as np
import pytest

from strainsight.config.load import load_config
from strainsight.errors import ConfigError
from strainsight.experiment.bench.inverse.comparison import ratio_numbers
from strainsight.runner.stage import Context
from strainsight.stages.bench.report import run as report

from ..models import ended
from ..shared import slowly
from .conftest import DIAMETER, GRID_FILTER, LOADS, ROOT, SMALL, job_of
from .test_artefacts import assert_summary_is_listed

PRELOAD = "estimate.parameters.preload={bearing: pitch-bearing, property: preload, std: 1.0e-6}"
GROOVES = tuple(
    f"estimate.parameters.{name}={{bearing: pitch-bearing, property: radius_{name}, std: 1.0e-4}}"
    for name in ("inner_left", "inner_right", "outer_left")
)


def test_diameter_and_preload_or_a_grid_filter_of_three_are_accepted():
    job_of(DIAMETER, ROOT, PRELOAD)
    job_of(DIAMETER, ROOT, GRID_FILTER, *GROOVES[:2])


@pytest.mark.parametrize(
    ("config", "change", "key", "what"),
    [
        (LOADS, "sensors.gauges.gauges=[{position: [0.918, 0.94, -1.372], direction: [0, 0, 1]}]", "estimate.sensors",
         "the number of sensor components, 1, is smaller than the number of unknown loads, 3"),
        (LOADS, "estimate.inputs.weight={std: 1.0, increment: 1.0}", "estimate.inputs.weight", "no force or moment"),
        (LOADS, "estimate.sensors.gauges.noise=[1.0e-7, 1.0e-7]", "estimate.sensors.gauges.noise",
         "the list length is 2, but the number of sensor components is 4"),
        (LOADS, "estimate.time_step=0.07", "estimate.time_step", "does not divide"),
        (DIAMETER, "estimate.parameters.diameter.guess=0.066", "estimate.parameters.diameter.guess", "not larger than"),
        (LOADS, "estimate.parameters.Fx={bearing: pitch-bearing, property: preload, std: 1.0e-6}", "estimate.parameters.Fx",
         "a load in estimate.inputs has the same name"),
        (SMALL, "estimate.truth.model=filter_step", "estimate.truth.model", "'filter_step' has no effect with imported"),
        (LOADS, "estimate.truth={model: independent, duration: 1.0}", "estimate.truth.duration", "the simulation ends at 1 s"),
        (LOADS, "estimate.truth.histories=3", "estimate.truth.histories", "has no effect with truth.model: fine"),
        (DIAMETER, "estimate.parameters.diameter={guess: 0.0606, std: 1.0e-4}", "estimate.parameters.diameter", "no modulus"),
        (LOADS, GRID_FILTER, "estimate.method.parameters", "the grid filter needs an estimated parameter"),
        (DIAMETER, "estimate.method={parameters: grid, update: one_shot}", "estimate.method.update", "not support 'one_shot'"),
        (LOADS, "estimate.method={noise: as_printed, step_error: estimated}", "estimate.method.step_error", "after the step"),
        (DIAMETER, (PRELOAD, "bearings.pitch-bearing.groove_centres=fixed"), "estimate.parameters.preload", "same effect"),
        (DIAMETER, (GRID_FILTER, *GROOVES), "estimate.method.parameters",
         "the grid filter supports at most 3 estimated parameters, not 4"),
        (DIAMETER, (GRID_FILTER, "estimate.parameters.diameter.increment=1.0e-6"), "estimate.parameters.diameter.increment",
         "parameters are constant in the grid filter"),
    ],
)  # fmt: skip
def test_inconsistencies_are_refused_with_their_place(config, change, key, what):
    with pytest.raises(ConfigError) as refused:
        job_of(config, ROOT, *((change,) if isinstance(change, str) else change))
    assert refused.value.key == key
    assert what in str(refused.value)


def test_every_number_of_a_summary_is_listed(estimate, bench):
    measured = f"estimate.measured.from={bench['simulate'].path}"
    for config, *changes in (
        (DIAMETER, "estimate.duration=0.3", "estimate.runs=2", "estimate.sensors.gauges.bias=1.0e-8"),
        (DIAMETER, "estimate.duration=0.3", GRID_FILTER),
        (SMALL, "estimate.duration=0.1", measured, "estimate.hold_out=each", *(f"estimate.inputs.F{k}.guess=0" for k in "xyz")),
    ):
        assert_summary_is_listed(estimate(config, *changes), "estimate.h5 of a bench")


@pytest.mark.slow
def test_the_page_of_a_bench_shows_its_estimate_and_its_balls(estimate):
    changes = ("estimate.duration=0.3", "estimate.runs=2", "estimate.sensors.gauges.bias=1.0e-8")
    upstream = {stage: estimate(DIAMETER, *changes, stage=stage) for stage in ("simulate", "estimate")}
    found = upstream["estimate"]
    output = report(Context(load_config(DIAMETER, changes).model, upstream, {}, lambda *_: None))
    page = output.files["report.html"].decode()
    words = " ".join(re.sub(r"<[^>]*>", " ", page).split())
    assert f"{found.summary['channels']} channels estimate Fx" in words
    assert "stimated force on each of the 112 balls of " in words
    assert "with a band of ±2σ (σ claimed by the filter), and smoothed estimate (green)" in words
    assert page.count("<figure") == output.summary["figures"] > 10


PLACED = ("sensors.gauges={type: strain, body: beam, layout: place}",)


def from_scratch() -> str:
    """The config of the manual."""
    text = (ROOT / "docs" / "bench.md").read_text(encoding="utf-8").split("## A bench from scratch\n```yaml\n")[1]
    return text.split("```")[0]


@pytest.mark.parametrize(
    ("more", "last"),
    [
        (("simulate.duration=1.0",), "estimate"),
        *slowly(
            ((), "estimate"),
            (("estimate.parameters={E: {guess: 2.3e+11, std: 2.0e+10}}",), "estimate"),
            ((*PLACED, "place={body: beam, noise: 1.0e-7, keep: 2}"), "estimate"),
            ((*PLACED, "place={body: beam, noise: 1.0e-7, keep: 3}"), "place"),
        ),
    ],
)
def test_the_bench_of_the_manual_runs_as_it_says(more, last):
    mesh = (ROOT / "meshes" / "cantilever-coarse.bdf").read_text(encoding="utf-8")
    end = ended(last, from_scratch(), *more, files={"cantilever.bdf": mesh})
    found = end.artefact(last).summary
    assert found["error.F"] < 0.1 if last == "estimate" else found["selected"] == 3


@pytest.mark.slow
def test_a_small_bench_with_five_loads_moves_its_bearing_as_the_large_one_and_with_three_it_does_not(hub_estimate):
    measured = hub_estimate(ROOT / "configs" / "bench-full.yaml", stage="simulate")
    large = ("estimate.duration=1.0", f"estimate.measured.from={measured.path}")
    three = hub_estimate(SMALL, *large)
    five = hub_estimate(
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
def test_a_bench_of_half_the_size_with_everything_scaled_needs_a_quarter_of_the_loads(hub_estimate):
    """Displacements, preload × s, g/s, static loads: all strains are those of the large bench, forces go with s²."""
    static = tuple(
        f"forces.F{k}.signal={{type: constant, value: {v}}}" for k, v in zip("xyz", (3e4, 2e4, 4e4), strict=True)
    )
    large = hub_estimate(ROOT / "configs" / "bench-full.yaml", *static, stage="simulate")
    found = hub_estimate(
        SMALL, "estimate.duration=1.0", f"estimate.measured={{from: {large.path}, scale: 0.5}}",
        "estimate.sensors.relative.noise=1.0e-9",
        "bearings.pitch-bearing.preload=5.0e-6", "forces.weight.acceleration=[0.0, 0.0, -19.62]",
    )  # fmt: skip
    for name in ("Fx", "Fy", "Fz"):
        assert found.summary[f"ratio_slope.{name}"] == pytest.approx(0.25, abs=1e-5)
        assert found.summary[f"ratio_rms.{name}"] == pytest.approx(0.25, abs=1e-5)
    assert found.summary["mismatch.relative"] < 1e-6
    # gauges are not given to the filter: they are compared, and read the same
    assert found.summary["mismatch.gauges"] < 1e-5
    assert [found.summary[f"size.gauges.{i}"] for i in range(1, 5)] == pytest.approx([1.0] * 4, abs=1e-5)


def test_rms_over_rms_is_that_of_the_second_half():
    """Whatever the first guess was: √(3² + 4²) over √(6² + 8²)."""
    there, here = np.array([2.0, 2.0, 6.0, 8.0]), np.array([1e3, 1e3, 3.0, -4.0])
    assert ratio_numbers("F", there, here)["ratio_rms.F"] == pytest.approx(0.5, rel=1e-12)
    assert np.isnan(ratio_numbers("F", 0 * there, here)["ratio_rms.F"])


@pytest.mark.slow
def test_three_forces_give_three_displacements_and_the_strain_of_a_load_over_its_area(hub_estimate):
    """Figures 4.2 and 4.4 without weight: lateral loads of 0.7 on a hub of half the size strain it by 0.7/0.5² as much."""
    weightless = "forces.weight.acceleration=[0.0, 0.0, 0.0]"
    large = hub_estimate(ROOT / "configs" / "bench-full.yaml", weightless, "simulate.duration=1.0", stage="simulate")
    found = hub_estimate(
        SMALL, weightless, "estimate.duration=1.0", f"estimate.measured.from={large.path}",
        "estimate.sensors.relative.noise=[1.0e-9, 1.0e-9, 1.0e-9, 1.0, 1.0]",
    )  # fmt: skip
    assert max(found.summary[f"mismatch.relative.{i}"] for i in (1, 2, 3)) < 1e-6
    lateral = [found.summary[f"ratio_mean.F{k}"] for k in "yz"]
    assert max(lateral) < 1
    sizes = [found.summary[f"size.gauges.{i}"] for i in range(1, 5)]
    assert min(lateral) / 0.25 * 0.8 < min(sizes)
    assert max(sizes) < max(lateral) / 0.25 * 1.2


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (
            "estimate.measured.sensors={relative: tip}",
            "the sensor 'relative' has components in m or rad (5 in total), "
            "but the sensor 'tip' of the measured run has components in m (3 in total)",
        ),
        ("estimate.measured.inputs={Fx: My}", "no load 'My'"),
        ("estimate.time_step=0.025", "does not divide the time step of the filter"),
    ],
)
def test_another_bench_that_cannot_be_imported_is_refused(estimate, bench, change, what):
    with pytest.raises(ConfigError, match=re.escape(what)) as refused:
        estimate(
            LOADS, "estimate.sensors={relative: {noise: 1.0e-6}}", "estimate.duration=0.3",
            f"estimate.measured.from={bench['simulate'].path}", change,
        )  # fmt: skip
    assert refused.value.key.startswith("estimate.measured")


@pytest.mark.slow
def test_a_bench_without_weight_and_loads_stays_at_rest(hub_estimate):
    """Nothing deforms the hub: its coordinates are rounding, which no iteration can settle to twelve digits."""
    found = hub_estimate(
        SMALL,
        "forces.weight.acceleration=[0.0, 0.0, 0.0]",
        "simulate.duration=0.1",
        "estimate.measured=null",
        stage="simulate",
    )
    assert np.abs(found["/q"] - found["/q"][0]).max() < 1e-12
