"""No damping and nearly as much as stops all motion, next to no noise and ten thousand times the signal."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from strainsight.errors import InfeasibleError

from .beam import BENCH_CONFIG, E, bricks, finished, placed, prepared, validated

COUNTS = (4, 1, 1)
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
        InfeasibleError, match="an undamped motion of the structure is reached by no process noise"
    ) as found:
        finished(tmp_path, "place", bricks(COUNTS), EVERY | {"damping.ratio": 0.0, "loads.tip.direction": [0, 0, 1]})
    assert "a ratio of 1e-4 will do" in found.value.remedy


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
    with pytest.raises(InfeasibleError, match="no steady filter exists") as refused:
        finished(tmp_path, "place", bricks((4, 2, 2)), {"bodies.beam.damping.ratio": 0.0}, BENCH_CONFIG)
    assert "damping or a disturbance" in str(refused.value)


@pytest.mark.slow
def test_a_bench_without_noise_says_what_it_takes_instead(tmp_path):
    quick = {"estimate.sensors.gauges.noise": 0.0, "simulate.time_step": 2e-3}
    estimate = finished(tmp_path, "estimate", bricks((4, 2, 2)), quick, BENCH_CONFIG)["estimate"]
    for name in ("side", "down"):
        assert estimate.summary[f"error.{name}"] < 1e-2
    assert "the noise of gauges is raised from 0 to" in str(estimate.tables)
