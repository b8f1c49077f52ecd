"""Units, sizes and numbers of loads change no answer; the smallest and the fullest models."""

from __future__ import annotations

import numpy as np
import pytest
import skfem
from scipy.linalg import eigh
from skfem.models.elasticity import lame_parameters, linear_elasticity

from .beam import BENCH_CONFIG, NU, RHO, TIP, E, apart, bricks, finished, of_material, placed, prepared, validated
from .beam import SIZE as models_SIZE

COUNTS = (4, 1, 1)
QUICK = {"filter.compare": False, "place.certificate": False}


def answer(folder, text, changes):
    """What is prepared, its placement, and the estimate of E in its validation."""
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


ONE_PLACE = {"screen.keep": "all", "screen.minimum_spacing": 0.0, "place.keep": 1, "gauges.direction.angles": [0.0]}


def elasticity(mesh, element, modulus):
    """Basis, K and M of scikit-fem on a mesh."""
    basis = skfem.Basis(mesh, skfem.ElementVector(element), intorder=6)

    @skfem.BilinearForm
    def inertia(u, v, _):
        return RHO * (u[0] * v[0] + u[1] * v[1] + u[2] * v[2])

    return basis, linear_elasticity(*lame_parameters(modulus, NU)).assemble(basis), inertia.assemble(basis)


def beam_of(counts, modulus):
    """The free part of K and M of a beam of hex20, held at x = 0; its basis, and the free dofs."""
    mesh = skfem.MeshHex.init_tensor(*(np.linspace(0, length, n + 1) for length, n in zip(models_SIZE, counts, strict=True)))
    basis, K, M = elasticity(mesh, skfem.ElementHexS2(), modulus)
    free = basis.complement_dofs(basis.get_dofs(lambda x: np.isclose(x[0], 0.0)))
    return basis, K.toarray()[np.ix_(free, free)], M.toarray()[np.ix_(free, free)], free


@pytest.mark.parametrize(
    ("counts", "modes", "until"),
    [((1, 1, 1), 36, "observe"), ((4, 2, 1), 200, "modes")],
    ids=["as many as unknowns", "200"],
)
def test_frequencies_are_those_of_scikit_fem_whatever_their_number(tmp_path, counts, modes, until):
    """One brick with all its 36 modes; 200 of 264. The guess is 0.9 E."""
    changes = {"rom.modes": modes, "loads.tip.node": last_corner(counts), "gauges.direction.axis": [0, 1, 0]}
    changes["gauges.exclude"] = [{"normal_cone": {"axis": [0, side, 0], "angle": 20}} for side in (1, -1)]
    own = finished(tmp_path, until, bricks(counts, "hex20", tip=False), changes | ONE_PLACE)
    _, K, M, _ = beam_of(counts, 0.9 * E)
    expected = np.sqrt(eigh(K, M, eigvals_only=True)[:modes]) / (2 * np.pi)
    assert np.allclose(own["modes"]["/frequency"], expected, rtol=1e-8)


def test_a_gauge_on_one_stiff_brick_reads_the_static_strain_of_scikit_fem(tmp_path):
    """One hex20 of 1e15 Pa, first mode 5.3 kHz, under 20 Hz: the strain across the end is that of K⁻¹f, ε = S(x) u."""
    modulus = 1e15
    changes = of_material(modulus) | ONE_PLACE
    changes |= {
        "rom.modes": 2,
        "damping.ratio": 0.9,
        "loads.tip.node": last_corner((1, 1, 1)),
        "gauges.direction.axis": [0, 1, 0],
    }
    own = prepared(tmp_path, bricks((1, 1, 1), "hex20", modulus=modulus, tip=False), changes)
    basis, K, _, free = beam_of((1, 1, 1), 0.9 * modulus)
    loaded = basis.nodal_dofs[:, np.argmin(np.linalg.norm(basis.mesh.p.T - models_SIZE, axis=1))]
    force, u = np.zeros(basis.N), np.zeros(basis.N)
    force[loaded] = np.array([0.2, 0.5, 1.0]) / np.linalg.norm([0.2, 0.5, 1.0])
    u[free] = np.linalg.solve(K, force[free])
    end = basis.mesh.facets_satisfying(lambda x: np.isclose(x[0], models_SIZE[0]))
    middle = skfem.FacetBasis(
        basis.mesh, basis.elem, facets=end, quadrature=(np.array([[0.5], [0.5]]), np.array([1.0]))
    )
    expected = float(middle.interpolate(u).grad[1, 1, 0, 0])
    load, strain = own.training.load[:, 0], own.training.reading()[:, 0]
    assert own.training.candidates.position[0] == pytest.approx([models_SIZE[0], models_SIZE[1] / 2, models_SIZE[2] / 2])
    assert load @ strain / (load @ load) == pytest.approx(expected, rel=1e-4)


def last_corner(counts):
    """Number of the node at the far corner, which `bricks` numbers last."""
    half = np.stack(np.meshgrid(*(np.arange(2 * c + 1) for c in counts), indexing="ij"), axis=-1).reshape(-1, 3)
    return int(((half % 2).sum(axis=1) <= 1).sum())


def test_a_heavy_mass_that_hardly_moves_hides_no_modulus(tmp_path):
    """A million tonnes at the end swing once in two minutes; the beam between them and its root, 300 times a second."""
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
