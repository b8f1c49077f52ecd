"""Units and sizes change no answer: what is dimensionless stays, what has a dimension scales by it."""

from __future__ import annotations

import numpy as np
import pytest

from ..shared import strains
from .beam import BENCH_CONFIG, RHO, E, apart, bricks, finished, of_material

COUNTS = (6, 2, 2)


@pytest.fixture(scope="module")
def usual(tmp_path_factory):
    """The beam of steel, one metre long, in m and kg."""
    return finished(tmp_path_factory.mktemp("usual"), "validate", bricks(COUNTS))


def same_answer(own, usual, tolerance):
    """The same gauges in the same order, the same relative σ, the same estimate relative to its guess."""
    assert np.array_equal(own["screen"]["/kept"], usual["screen"]["/kept"])
    assert np.array_equal(own["place"]["/elimination/removed"], usual["place"]["/elimination/removed"])
    assert np.array_equal(own["place"]["/selected/final/gauge"], usual["place"]["/selected/final/gauge"])
    for stage, path in (("screen", "/snr"), ("place", "/elimination/trace"), ("place", "/expected_std/E")):
        one, other = own[stage][path], usual[stage][path]
        if path == "/expected_std/E":
            one, other = one / own["rom"]["/reduced/reference"][0], other / usual["rom"]["/reduced/reference"][0]
        assert apart(one, other) < tolerance, path


@pytest.mark.parametrize(
    ("length_unit", "mass_unit", "length", "mass"),
    [("mm", "t", 1e-3, 1e3), ("km", "kg", 1e3, 1.0), ("in", "lbf*s2/in", 0.0254, 175.12683524647636)],
)
def test_the_same_beam_in_other_units_is_the_same_beam(tmp_path, usual, length_unit, mass_unit, length, mass):
    text = bricks(COUNTS, length=length, mass=mass)
    own = finished(tmp_path, "validate", text, {"mesh.length_unit": length_unit, "mesh.mass_unit": mass_unit})
    assert apart(own["rom"]["/frequency"], usual["rom"]["/frequency"]) < 1e-10
    assert apart(strains(own["train"]), strains(usual["train"])) < 1e-9
    assert apart(own["validate"]["/estimate/E"], usual["validate"]["/estimate/E"]) < 1e-9
    same_answer(own, usual, 1e-9)


@pytest.mark.parametrize("s", [1e-3, 1e3, 37.3])
def test_a_beam_of_another_size_is_the_same_beam_in_slower_time(tmp_path, usual, s):
    """x → s x, t → s t, F → s² F leave stress and strain: a millimetre is as good as a kilometre; δ [1/√s] → δ/√s."""
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
    own = finished(tmp_path, "validate", bricks(COUNTS, size=s), changes)
    assert apart(s * own["rom"]["/frequency"], usual["rom"]["/frequency"]) < 1e-10
    assert apart(strains(own["train"]), strains(usual["train"])) < 1e-9
    assert apart(own["validate"]["/estimate/E"], usual["validate"]["/estimate/E"]) < 1e-9
    same_answer(own, usual, 1e-9)


@pytest.mark.parametrize(("modulus", "force"), [(1e-3, 2.9e24), (1e15, 1e-9), (3.7e30, 1e12)])
def test_modulus_and_density_of_another_size_move_alike(tmp_path, usual, modulus, force):
    """E → s E, ρ → s ρ leave the frequencies, F → f F scales strain by f/s, and noise is a share of the strain."""
    s, f = modulus / E, force / 1000.0
    changes = of_material(modulus) | {"loads.tip.signal.amplitude": force}
    own = finished(tmp_path, "validate", bricks(COUNTS, modulus=modulus, density=s * RHO), changes)
    assert apart(own["rom"]["/frequency"], usual["rom"]["/frequency"]) < 1e-10
    assert apart(strains(own["train"]) * s / f, strains(usual["train"])) < 1e-9
    assert apart(own["validate"]["/estimate/E"] / s, usual["validate"]["/estimate/E"]) < 1e-9
    same_answer(own, usual, 1e-9)


def test_a_bench_of_a_microgram_and_one_of_a_kiloton_place_the_same_gauges(tmp_path):
    """E, ρ and all forces times s: the σ of every load is s times as large."""
    places = {}
    for s in (1.0, 1e-15, 3.3e4):
        changes = {f"forces.{name}.signal.amplitude": 100.0 * s for name in ("side", "down")}
        changes |= {f"estimate.inputs.{name}": {"std": 100.0 * s, "increment": 20.0 * s} for name in ("side", "down")}
        text = bricks(COUNTS, modulus=s * E, density=s * RHO)
        places[s] = finished(tmp_path / f"{s:g}", "simulate", text, changes, BENCH_CONFIG)
    for s, own in places.items():
        usual = places[1.0]
        assert np.array_equal(own["place"]["/layouts/place/candidate"], usual["place"]["/layouts/place/candidate"])
        assert apart(own["place"]["/layouts/place/std"] / s, usual["place"]["/layouts/place/std"]) < 1e-8
        assert apart(own["simulate"]["/sensors/gauges"], usual["simulate"]["/sensors/gauges"]) < 1e-8
