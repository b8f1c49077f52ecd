"""Units, sizes and numbers of loads change no answer; the smallest and the fullest models."""

from __future__ import annotations

import numpy as np
import pytest

from .beam import RHO, TIP, E, apart, bricks, finished, of_material, placed, prepared, validated

COUNTS = (4, 1, 1)
QUICK = {"filter.compare": False, "place.certificate": False}


def answer(folder, text, changes):
    own = prepared(folder, text, QUICK | changes)
    placement = placed(own)
    return own, placement, validated(own, placement.gauges).validated.estimate["E"]


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    """The beam of steel, one metre long, in m and kg."""
    return answer(tmp_path_factory.mktemp("usual"), bricks(COUNTS), {})


def same_answer(own, usual, size=1.0, strain=1.0, modulus=1.0):
    """Frequencies, strains and the estimate over these factors, the same gauges in the same order, the same relative σ."""
    (one, layout, estimate), (other, usual_layout, usual_estimate) = own, usual
    assert apart(size * one.reduced.frequency, other.reduced.frequency) < 1e-10
    assert apart(one.training.reading() / strain, other.training.reading()) < 1e-9
    assert apart(estimate / modulus, usual_estimate) < 1e-9
    assert np.array_equal(one.screened.kept, other.screened.kept)
    assert np.array_equal(layout.elimination.removed, usual_layout.elimination.removed)
    assert np.array_equal(layout.final, usual_layout.final)
    assert apart(one.screened.snr, other.screened.snr) < 1e-9
    assert apart(layout.elimination.cost, usual_layout.elimination.cost) < 1e-9
    assert layout.expected.std["E"] == pytest.approx(usual_layout.expected.std["E"], rel=1e-9)


def test_the_same_beam_in_other_units_is_the_same_beam(tmp_path, usual):
    text = bricks(COUNTS, length=0.0254, mass=175.12683524647636)
    units = {"mesh.length_unit": "in", "mesh.mass_unit": "lbf*s2/in"}
    same_answer(answer(tmp_path, text, units), usual)


def test_a_beam_of_another_size_is_the_same_beam_in_slower_time(tmp_path, usual):
    """x → s x, t → s t, F → s² F leave stress and strain: a millimetre is as good as a metre; δ [1/√s] → δ/√s."""
    s = 1e-3
    changes = {
        "loads.tip.signal.amplitude": 1000.0 * s**2,
        "loads.tip.signal.frequency": 20.0 / s,
        "parameters.E.process_noise_scale": 0.05 / s**0.5,
        "screen.minimum_spacing": 0.02 * s,
        "tolerances.position": 0.002 * s,
        "tolerances.load_position": 0.002 * s,
    }
    for run in ("train", "validate"):
        changes |= {f"{run}.duration": 0.1 * s, f"{run}.time_step": 1e-3 * s}
    same_answer(answer(tmp_path, bricks(COUNTS, size=s), changes), usual, size=s)


@pytest.mark.parametrize(("modulus", "force"), [(1e-3, 2.9e24), (3.7e30, 1e12)])
def test_modulus_and_density_of_another_size_move_alike(tmp_path, usual, modulus, force):
    """E → s E, ρ → s ρ leave the frequencies, F → f F scales strain by f/s, and noise is a share of the strain."""
    s, f = modulus / E, force / 1000.0
    changes = of_material(modulus) | {"loads.tip.signal.amplitude": force}
    own = answer(tmp_path, bricks(COUNTS, modulus=modulus, density=s * RHO), changes)
    same_answer(own, usual, strain=f / s, modulus=s)


SIZE = {"side": 1000.0, "down": 5.0, "along": 0.0}
"""Amplitude of the true load [N]; the filter takes 20 N for the last one."""


def test_each_load_is_judged_by_its_own_size_and_one_that_is_zero_by_its_amplitude(tmp_path):
    """RMS of error and σ after the first tenth, read off the histories."""
    (tmp_path / "zero.csv").write_text("time [s],force [N]\n0,0\n0.05,0\n0.1,0\n", encoding="ascii")
    loads = {
        name: {
            "node": TIP,
            "direction": np.roll([1.0, 0.0, 0.0], i).tolist(),
            "known": False,
            "signal": {"type": "sine", "frequency": 20.0 + 5.0 * i, "amplitude": size}
            if size
            else {"type": "csv", "file": "zero.csv", "time_column": "time", "value_column": "force"},
            "process_noise": {"model": "integrated_random_walk"}
            | ({} if size else {"frequency": 20.0, "amplitude": 20.0}),
        }
        for i, (name, size) in enumerate(SIZE.items(), start=1)
    }
    names = list(loads)
    changes = {
        "parameters": {},
        "loads": loads,
        "screen.keep": 12,
        "place.estimate": names,
        "place.keep": 4,
        "validate.truth.parameters": {},
        "validate.initial_std": dict.fromkeys(names, 0.1),
        "validate.repeats": 2,
        "tolerances": "none",
    }
    validate = finished(tmp_path, "validate", bricks(COUNTS), changes)["validate"]
    for name, size in SIZE.items():
        truth, late = validate[f"/truth/{name}"], slice(11, None)  # of 101 instants
        own = np.sqrt(np.mean(truth[late] ** 2)) if size else 20.0
        assert validate.summary[f"scale.{name}"] == pytest.approx(own)
        assert validate.summary[f"zero.{name}"] == (size == 0)
        for key, history in (
            ("error", validate[f"/estimate/{name}"] - truth),
            ("std", validate[f"/std/{name}"]),
            ("smoothed", validate[f"/smoothed/{name}"] - truth),
            ("smoothed_std", validate[f"/smoothed_std/{name}"]),
        ):
            assert validate.summary[f"{key}.{name}"] == pytest.approx(np.sqrt(np.mean(history[late] ** 2)) / own)
        # Nothing here is nonlinear: with everything exact σ is the same whatever the noise and the start.
        np.testing.assert_allclose(validate[f"/repeats/std/{name}"], validate.summary[f"std.{name}"], rtol=1e-6)
    assert "of its amplitude, 20 N," in validate.message


def test_one_brick_goes_through_with_all_its_modes(tmp_path):
    changes = {"screen.keep": "all", "screen.minimum_spacing": 0.0, "place.keep": 1, "gauges.direction.angles": [0.0]}
    changes |= {"rom.modes": 36, "loads.tip.node": 20, "gauges.direction.axis": [0, 1, 0]}
    changes["gauges.exclude"] = [{"normal_cone": {"axis": [0, side, 0], "angle": 20}} for side in (1, -1)]
    own = finished(tmp_path, "observe", bricks((1, 1, 1), "hex20", tip=False), changes)
    assert len(own["modes"]["/frequency"]) == 36


def test_a_heavy_mass_that_hardly_moves_hides_no_modulus(tmp_path):
    text = bricks((4, 1, 1)).replace("ENDDATA", f"CONM2,1,{TIP},,1.+9\nENDDATA")
    load = {"node": 9, "direction": [0.2, 0.5, 1.0], "known": True}
    load["signal"] = {"type": "sine", "frequency": 100.0, "amplitude": 1000.0}
    times = {"train.duration": 0.05, "validate.duration": 0.05, "train.time_step": 2e-4, "validate.time_step": 2e-4}
    # the modulus hangs on small differences of readings here: 2 mm are 15 % of it
    changes = QUICK | {"loads.tip": load, "rom.modes": 6, "tolerances": "none", **times}
    own = prepared(tmp_path, text, changes)
    found = validated(own, placed(own).gauges).accuracy["E"]
    assert own.reduced.frequency[0] * 0.05 < 1e-3
    assert own.reduced.frequency[5] * 0.05 > 10
    assert found.estimate == pytest.approx(E, rel=3 * found.std)
