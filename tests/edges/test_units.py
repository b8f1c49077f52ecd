"""Units, sizes and numbers of loads change no answer; the smallest models; damping and noise at their limits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
import skfem
from skfem.models.elasticity import lame_parameters, linear_elasticity

from strainsight.errors import InfeasibleError

from ..stages.conftest import no_hot_spots  # noqa: F401  for all tests here
from .beam import BENCH_CONFIG, NU, RHO, TIP, E, apart, bricks, finished, of_material, placed, prepared, validated
from .beam import SIZE as BEAM

pytestmark = pytest.mark.usefixtures("no_hot_spots")

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
def test_modulus_and_density_of_another_size_move_equally(tmp_path, usual, modulus, force):
    """E → s E, ρ → s ρ leave the frequencies, F → f F scales strain by f/s, and noise is a share of the strain."""
    s, f = modulus / E, force / 1000.0
    changes = of_material(modulus) | {"loads.tip.signal.amplitude": force}
    own = answer(tmp_path, bricks(COUNTS, modulus=modulus, density=s * RHO), changes)
    same_answer(own, usual, strain=f / s, modulus=s)


@pytest.mark.slow
def test_a_bench_of_a_microgram_places_the_same_gauges(tmp_path):
    """E, ρ and all forces times s: the σ of every load is s times as large."""
    places = {}
    for s in (1.0, 1e-15):
        changes = {f"forces.{name}.signal.amplitude": 100.0 * s for name in ("side", "down")}
        changes |= {f"estimate.inputs.{name}": {"std": 100.0 * s, "increment": 20.0 * s} for name in ("side", "down")}
        text = bricks((4, 2, 2), modulus=s * E, density=s * RHO)
        places[s] = finished(tmp_path / f"{s:g}", "simulate", text, changes, BENCH_CONFIG)
    usual, own = places.values()
    assert np.array_equal(own["place"]["/layouts/place/candidate"], usual["place"]["/layouts/place/candidate"])
    assert apart(own["place"]["/layouts/place/std"] / s, usual["place"]["/layouts/place/std"]) < 1e-8
    assert apart(own["simulate"]["/sensors/gauges"], usual["simulate"]["/sensors/gauges"]) < 1e-8


SIZE = {"side": 1000.0, "down": 5.0, "along": 0.0}
"""Amplitude of the true load [N]; the filter takes 20 N for the last one."""


def test_each_load_is_evaluated_by_its_own_size_and_one_that_is_zero_by_its_amplitude(tmp_path):
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
    assert "of its amplitude 20 N" in validate.message


ONE_PLACE = {"screen.keep": "all", "screen.minimum_spacing": 0.0, "place.keep": 1, "gauges.direction.angles": [0.0]}
ONE_PLACE |= {"loads.tip.node": 20, "gauges.direction.axis": [0, 1, 0]}


def test_one_brick_goes_through_with_all_its_modes(tmp_path):
    changes = ONE_PLACE | {"rom.modes": 36}
    changes["gauges.exclude"] = [{"normal_cone": {"axis": [0, side, 0], "angle": 20}} for side in (1, -1)]
    own = finished(tmp_path, "observe", bricks((1, 1, 1), "hex20", tip=False), changes)
    assert len(own["modes"]["/frequency"]) == 36


def test_a_gauge_on_one_stiff_brick_reads_the_static_strain_of_scikit_fem(tmp_path):
    """One hex20 of 1e15 Pa, first mode 5.3 kHz, under 20 Hz: the strain across the end is that of K⁻¹f, ε = S(x) u."""
    modulus = 1e15
    changes = of_material(modulus) | ONE_PLACE | {"rom.modes": 2, "damping.ratio": 0.9}
    own = prepared(tmp_path, bricks((1, 1, 1), "hex20", modulus=modulus, tip=False), changes)
    mesh = skfem.MeshHex.init_tensor(*([0.0, length] for length in BEAM))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHexS2()), intorder=6)
    K = linear_elasticity(*lame_parameters(0.9 * modulus, NU)).assemble(basis)
    force = np.zeros(basis.N)
    loaded = basis.nodal_dofs[:, np.argmin(np.linalg.norm(mesh.p.T - BEAM, axis=1))]
    force[loaded] = np.array([0.2, 0.5, 1.0]) / np.linalg.norm([0.2, 0.5, 1.0])
    u = skfem.solve(*skfem.condense(K, force, D=basis.get_dofs(lambda x: np.isclose(x[0], 0.0))))
    end = mesh.facets_satisfying(lambda x: np.isclose(x[0], BEAM[0]))
    middle = skfem.FacetBasis(mesh, basis.elem, facets=end, quadrature=(np.array([[0.5], [0.5]]), np.array([1.0])))
    load, strain = own.training.load[:, 0], own.training.reading()[:, 0]
    assert own.training.candidates.position[0] == pytest.approx([BEAM[0], BEAM[1] / 2, BEAM[2] / 2])
    assert load @ strain / (load @ load) == pytest.approx(float(middle.interpolate(u).grad[1, 1, 0, 0]), rel=1e-4)


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


EVERY = {"screen.keep": "all"}


def steady(F, Q, G):
    """P of F P + P Fᵀ + Q − P G P = 0 to fifty digits: the stable half of the Hamiltonian's eigenvectors, P = U₂U₁⁻¹."""
    n = len(F)
    with mpmath.workdps(50):
        values, vectors = mpmath.eig(mpmath.matrix(np.block([[F.T, -G], [-Q, -F]]).tolist()))
        stable = [i for i in range(2 * n) if values[i].real < 0]
        assert len(stable) == n
        U = mpmath.matrix([[vectors[row, i] for i in stable] for row in range(2 * n)])
        P = U[n:, :] * mpmath.inverse(U[:n, :])
        return np.array([[float(P[i, j].real) for j in range(n)] for i in range(n)])


@pytest.mark.parametrize(
    "changes",
    [
        {"damping.ratio": 0.0},
        {"damping.ratio": 0.999},
        {"gauges.noise_std": {"relative_to_strongest": 2e-9}},
        {"gauges.noise_std": {"relative_to_strongest": 9e3}},
        {"process_noise.model_error": 0.0},
        {"process_noise.model_error": 1e6},
    ],
    ids=lambda changes: "-".join(f"{key}={value}" for key, value in changes.items()),
)
def test_what_a_layout_is_worth_is_what_fifty_digits_give(tmp_path, changes):
    small = EVERY | {"rom.modes": 1, "place.instants": 1, "place.certificate": False, "tolerances": "none"}
    found = placed(prepared(tmp_path, bricks(COUNTS), small | changes))
    (pool,) = found.elimination.pools
    own, gauges = pool.scenario.scaled(1 / pool.scale), found.final
    P = steady(own.F, own.Q, (own.H[gauges].T / own.r[gauges]) @ own.H[gauges])
    assert found.layout.cost == pytest.approx(own.weight @ np.diag(P), rel=1e-7)


@pytest.mark.parametrize("settle", ["none", "auto"])
def test_an_undamped_training_run_is_the_closed_form(tmp_path, settle):
    """q̈ + λq = s a sin Ωt:  q = s a (sin Ωt − (Ω/√λ) sin √λt)/(λ − Ω²) from rest, without the second sine settled, to 1e-4,
    the hold of the load."""
    own = finished(tmp_path, "train", bricks(COUNTS), {"damping.ratio": 0.0, "train.settle": settle})
    t, omega = own["train"]["/time"], 2 * np.pi * 20.0
    for q, s, stiffness in zip(
        own["train"]["/coordinate"].T,
        own["rom"]["/reduced/input_shape"][:, 0],
        np.diag(own["rom"]["/reduced/stiffness/constant"] + 0.9 * E * own["rom"]["/reduced/stiffness/E"]),
        strict=True,
    ):
        root = np.sqrt(stiffness)
        free = omega / root * np.sin(root * t) if settle == "none" else 0.0
        expected = s * 1000.0 * (np.sin(omega * t) - free) / (stiffness - omega**2)
        assert np.abs(q - expected).max() <= 1e-4 * np.abs(own["train"]["/coordinate"]).max()


def test_an_undamped_motion_that_nothing_excites_has_no_steady_filter(tmp_path):
    with pytest.raises(
        InfeasibleError, match="an undamped motion of the structure has no process noise"
    ) as found:
        finished(tmp_path, "place", bricks(COUNTS), EVERY | {"damping.ratio": 0.0, "loads.tip.direction": [0, 0, 1]})
    assert "a ratio of 1e-4 is enough" in found.value.remedy


def test_next_to_no_noise_finds_the_modulus_of_the_filter_s_own_model(tmp_path):
    """σ 1e-7 of the signal, no model error, a truth that the filter can be: E to 1e-5, from a guess 10 % off."""
    changes = {
        "gauges.noise_std": {"relative_to_strongest": 1e-7},
        "process_noise.model_error": 0.0,
        "tolerances": "none",
        "parameters.E.process_noise_scale": 1e-6,
        "validate.truth.model": "rom",
        "filter.form": "square_root",
    }
    own = prepared(tmp_path, bricks(COUNTS), EVERY | changes | {"filter.compare": False})
    assert validated(own, placed(own).gauges).validated.estimate["E"][-1] == pytest.approx(E, rel=1e-5)


def test_sigma_of_a_bench_grows_with_the_root_of_a_large_noise(tmp_path):
    """A load that wanders by i a step in a static reading of noise r is known to √(i r/h). Noise of 1e-4 and 0.01 strain, a
    hundred and ten thousand times what an increment does: a mode that no load excites may not pass for one that has settled."""
    std = {
        noise: finished(
            tmp_path / f"{noise:g}", "place", bricks(COUNTS), {"place.noise": noise, "place.keep": 4}, BENCH_CONFIG
        )["place"]["/layouts/place/std"]
        for noise in (1e-4, 1e-2)
    }
    assert np.allclose(std[1e-2] / std[1e-4], 10.0, rtol=0.02)


def test_an_undamped_bench_has_no_steady_filter(tmp_path):
    with pytest.raises(InfeasibleError, match="no steady-state filter exists") as refused:
        finished(tmp_path, "place", bricks((4, 2, 2)), {"bodies.beam.damping.ratio": 0.0}, BENCH_CONFIG)
    assert "add damping, or process noise" in str(refused.value)


@pytest.mark.slow
def test_a_bench_without_noise_reports_what_it_takes_instead(tmp_path):
    quick = {"estimate.sensors.gauges.noise": 0.0, "simulate.time_step": 2e-3}
    estimate = finished(tmp_path, "estimate", bricks((4, 2, 2)), quick, BENCH_CONFIG)["estimate"]
    for name in ("side", "down"):
        assert estimate.summary[f"error.{name}"] < 1e-2
    assert "the noise of gauges was increased from 0 to" in str(estimate.tables)
