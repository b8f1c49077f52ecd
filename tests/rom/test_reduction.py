"""The reduced model is the full one at the reference, and close to it over the whole box of parameters."""

from __future__ import annotations

import weakref
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import cholesky, eigh, svdvals
from scipy.stats import qmc

from strainsight.errors import InfeasibleError
from strainsight.fem.affine import AffineOperator, Parameter
from strainsight.fem.loads import PointLoad, input_shape
from strainsight.fem.model import FiniteElementModel, build_model
from strainsight.mesh.model import Mesh
from strainsight.rom.model import Damping, modal_basis
from strainsight.rom.reduction import (
    energy_orthonormal,
    held_out_errors,
    held_out_samples,
    modal_model,
    parameter_samples,
    reduce_model,
    scaled,
    snapshots,
)

from ..fem.conftest import make_box

DAMPING = Damping("modal", ratio=0.01)
STEEL, ALLOY = (2.1e11, 0.3, 7850.0), (7.0e10, 0.33, 2700.0)
TWO = (
    Parameter("E1", "youngs_modulus", (1,), 2.1e11),
    Parameter("E2", "youngs_modulus", (2,), 7.0e10),
    Parameter("rho2", "density", (2,), 2700.0),
)
TWO_REFERENCE = {p.name: p.reference for p in TWO}
TWO_RANGES = {"E1": (1.4e11, 2.8e11), "E2": (4e10, 1.2e11), "rho2": (1800.0, 4000.0)}
ONE = (Parameter("E", "youngs_modulus", (1, 2), 2.1e11),)


def beam(materials=(STEEL, ALLOY)) -> Mesh:
    """A cantilever of 8 × 2 × 2 hexahedra, 10:1:0.8, region 1 the first half, clamped at x = 0."""
    own = dict(enumerate(materials, start=1))
    mesh = make_box("hex8", (8, 2, 2), (1.0, 0.1, 0.08), clamp_root=True, region=np.repeat([1, 2], 16), materials=own)
    return replace(mesh, node_sets={"tip": mesh.node_ids[mesh.position[:, 0] == 1.0]})


LOADS = (PointLoad("Fz", (0, 0, 1), node_set="tip"), PointLoad("Fy", (0, 1, 0), node_id=45))


@pytest.fixture(scope="module")
def two() -> tuple[FiniteElementModel, np.ndarray]:
    full = build_model(beam(), TWO)
    return full, input_shape(full, LOADS)


@pytest.fixture(scope="module")
def one() -> tuple[FiniteElementModel, np.ndarray]:
    full = build_model(beam(materials=(STEEL, STEEL)), ONE)
    return full, input_shape(full, LOADS)


def reduce_two(two, samples=4, tolerance=1e-8):
    full, S = two
    return reduce_model(full, S, ("Fz", "Fy"), TWO_REFERENCE, TWO_RANGES, 8, samples, tolerance, DAMPING)


@pytest.fixture(scope="module")
def reduced(two):
    """The same reduction serves several statements."""
    return reduce_two(two)


def frequencies(full: FiniteElementModel, theta, count: int) -> np.ndarray:
    """Dense LAPACK on the full matrices."""
    lam = eigh(full.stiffness.at(theta).toarray(), full.mass.at(theta).toarray(), eigvals_only=True)
    return np.sqrt(lam[:count]) / (2 * np.pi)


def test_the_coordinates_are_the_modes_of_the_full_model_at_the_reference(two, reduced):
    K, exact = reduced.model.stiffness.at(TWO_REFERENCE), frequencies(two[0], TWO_REFERENCE, 8)
    lam = np.diag(K)
    np.testing.assert_allclose(reduced.model.mass.at(TWO_REFERENCE), np.eye(len(lam)), atol=1e-11)
    np.testing.assert_allclose(K / np.sqrt(np.outer(lam, lam)), np.eye(len(lam)), atol=1e-9)
    assert np.all(np.diff(lam) > 0)
    np.testing.assert_allclose(np.sqrt(lam[:8]) / (2 * np.pi), exact, rtol=1e-9)
    np.testing.assert_allclose(reduced.frequency, exact, rtol=1e-9)


def test_operators_and_loads_are_galerkin_projections_at_any_parameter(two, reduced):
    full, S = two
    theta = {"E1": 1.7e11, "E2": 1.0e11, "rho2": 3500.0}
    Psi = reduced.basis
    for small, large in ((reduced.model.stiffness, full.stiffness), (reduced.model.mass, full.mass)):
        exact = Psi.T @ (large.at(theta) @ Psi)
        scale = np.sqrt(np.outer(np.diag(exact), np.diag(exact)))
        np.testing.assert_allclose(small.at(theta) / scale, exact / scale, atol=1e-9)
    np.testing.assert_array_equal(reduced.model.input_shape, Psi.T @ S)


def test_the_static_response_at_the_reference_is_exact_and_so_is_its_strain(two, reduced):
    full, S = two
    z = np.linalg.solve(full.stiffness.at(TWO_REFERENCE).toarray(), S)
    for one_of in (reduced, reduce_two(two, samples=2, tolerance=10.0)):
        q = np.linalg.solve(one_of.model.stiffness.at(TWO_REFERENCE), one_of.model.input_shape)
        np.testing.assert_allclose(one_of.basis @ q, z, atol=1e-9 * np.abs(z).max())


def test_held_out_errors_are_small_and_shrink_with_samples_of_the_box(two):
    full, S = two
    points = held_out_samples(TWO_REFERENCE, TWO_RANGES, 3)
    errors = {k: held_out_errors(full, S, reduce_two(two, samples=k), points) for k in (1, 3, 6)}
    assert min(e.frequency.min() for e in errors.values()) > -1e-9  # Rayleigh-Ritz: a subspace can only stiffen
    worst = {k: (np.abs(e.frequency).max(), e.static.max()) for k, e in errors.items()}
    assert worst[6][0] < 1e-7
    assert worst[6][1] < 1e-7
    for i in range(2):
        assert worst[1][i] > worst[3][i] > worst[6][i]


def test_held_out_errors_agree_with_dense_algebra(two):
    full, S = two
    reduced = reduce_two(two, samples=1)
    theta = {"E1": 1.5e11, "E2": 1.1e11, "rho2": 2000.0}
    errors = held_out_errors(full, S, reduced, [theta])
    lam = eigh(reduced.model.stiffness.at(theta), reduced.model.mass.at(theta), eigvals_only=True)
    expected = np.sqrt(lam[:8]) / (2 * np.pi) / frequencies(full, theta, 8) - 1
    np.testing.assert_allclose(errors.frequency[0], expected, atol=1e-9)
    # Galerkin: the energy of the error is the difference of the compliances.
    compliance = np.diag(S.T @ np.linalg.solve(full.stiffness.at(theta).toarray(), S))
    S_r = reduced.model.input_shape
    missed = 1 - np.diag(S_r.T @ np.linalg.solve(reduced.model.stiffness.at(theta), S_r)) / compliance
    np.testing.assert_allclose(errors.static[0] ** 2, missed, rtol=1e-5)


def test_a_looser_tolerance_gives_a_smaller_basis_and_never_less_than_the_reference(two):
    sizes = [reduce_two(two, 3, t).model.size for t in (1e-12, 1e-4, 1e-2, 10.0)]
    assert sizes[0] >= sizes[1] > sizes[2] > sizes[3] == 8 + 2


def test_at_a_sampled_point_the_static_response_is_held_to_the_tolerance(two):
    full, S = two
    for tolerance in (1e-3, 1e-6):
        reduced = reduce_two(two, 4, tolerance)
        dropped = len(reduced.samples) * (8 + 2) - reduced.model.size
        errors = held_out_errors(full, S, reduced, reduced.samples[1:])
        # The energy norms of K(θ) and K(θ₀) differ by at most the spread of the moduli in the box.
        assert errors.static.max() <= 2 * tolerance * np.sqrt(dropped)


def test_one_material_scaled_as_a_whole_needs_only_the_reference(one):
    full, S = one
    reduced = reduce_model(full, S, ("Fz", "Fy"), {"E": 2.1e11}, {"E": (1e11, 4e11)}, 8, 5, 1e-8, DAMPING)
    assert reduced.model.size == 8 + 2
    assert len(reduced.samples) == 1
    errors = held_out_errors(full, S, reduced, [{"E": 1e11}, {"E": 2.9e11}])
    assert np.abs(errors.frequency).max() < 1e-9
    assert errors.static.max() < 1e-9


def test_a_load_given_twice_adds_nothing(one):
    full, S = one
    twice = np.hstack([S, S[:, :1]])
    reduced = reduce_model(full, twice, ("Fz", "Fy", "again"), {"E": 2.1e11}, {"E": (1e11, 4e11)}, 8, 1, 1e-8, DAMPING)
    assert reduced.model.size == 8 + 2
    np.testing.assert_array_equal(reduced.model.input_shape[:, 0], reduced.model.input_shape[:, 2])


def checked_modal_model(full, S, theta, count, *more):
    """A modal model that has the frequencies and static responses of the full one."""
    model, basis = modal_model(full, S, ("Fz", "Fy"), theta, count, *more)
    assert (model.size, model.parameters) == (count + 2, ())
    lam, _ = modal_basis(model, {})
    np.testing.assert_allclose(np.sqrt(lam[:count]) / (2 * np.pi), frequencies(full, theta, count), rtol=1e-8)
    z = np.linalg.solve(full.stiffness.at(theta).toarray(), S)
    q = np.linalg.solve(model.stiffness.at({}), model.input_shape)
    np.testing.assert_allclose(basis @ q, z, atol=1e-9 * np.abs(z).max())
    return model


def test_a_modal_model_holds_the_modes_and_static_responses_of_one_point(two):
    """Also where modes of another point are known, which do not serve two materials."""
    theta = {"E1": 2.6e11, "E2": 5e10, "rho2": 2000.0}
    assert checked_modal_model(*two, theta, 30, DAMPING.scaled(1.5)).damping.ratio == pytest.approx(0.015)
    checked_modal_model(*two, theta, 10, DAMPING, snapshots(*two, TWO_REFERENCE, 12))


def test_modes_of_the_reference_serve_any_value_of_one_material(one):
    (full, S), at, theta = one, {"E": 2.1e11}, {"E": 2.6e11}
    known = snapshots(full, S, at, 12)
    checked_modal_model(full, S, theta, 10, DAMPING, known)
    there, z = scaled(full, known, at, theta), np.linalg.solve(full.stiffness.at(theta).toarray(), S)
    np.testing.assert_allclose(there.frequency, frequencies(full, theta, 12), rtol=1e-8)
    np.testing.assert_allclose(there.static, z, rtol=0, atol=1e-9 * np.abs(z).max())


def test_known_modes_save_the_iterations_and_change_nothing(two, reduced):
    full, S = two
    known = snapshots(full, S, TWO_REFERENCE, 20)
    again = reduce_model(
        full, S, ("Fz", "Fy"), TWO_REFERENCE, TWO_RANGES, 8, 4, 1e-8, DAMPING, (known.frequency, known.shapes)
    )
    assert again.model.size == reduced.model.size
    np.testing.assert_allclose(again.frequency, reduced.frequency, rtol=1e-10)
    np.testing.assert_allclose(again.basis, reduced.basis, atol=1e-6 * np.abs(reduced.basis).max())


def test_energy_singular_values_are_those_of_the_cholesky_factor_times_the_snapshots():
    """Oracle: K = LLᵀ, so the energy SVD of X is the plain SVD of LᵀX; values far below √eps keep their digits."""
    rng = np.random.default_rng(0)
    G = rng.standard_normal((40, 40))
    K = G @ G.T + np.eye(40)
    mixing = np.diag(10.0 ** -np.arange(0.0, 12, 2)) @ np.linalg.qr(rng.standard_normal((6, 6)))[0]
    X = rng.standard_normal((40, 6)) @ mixing
    Q, R = energy_orthonormal(K, X)
    np.testing.assert_allclose(Q.T @ K @ Q, np.eye(Q.shape[1]), atol=1e-12)
    L = cholesky(K, lower=True)
    unit = L.T @ X / np.linalg.norm(L.T @ X, axis=0)
    np.testing.assert_allclose(svdvals(R)[:5], svdvals(unit)[:5], rtol=1e-5)


def test_vectors_are_orthogonal_to_previous_basis():
    rng = np.random.default_rng(1)
    G = rng.standard_normal((20, 20))
    K = G @ G.T + np.eye(20)
    held, _ = energy_orthonormal(K, rng.standard_normal((20, 4)))
    X = np.hstack([held @ rng.standard_normal((4, 2)), rng.standard_normal((20, 2)), np.zeros((20, 1))])
    Q, R = energy_orthonormal(K, X, against=held)
    assert Q.shape == (20, 2)
    assert R.shape == (2, 5)
    np.testing.assert_allclose(held.T @ K @ Q, 0.0, atol=1e-13)


def test_samples_start_at_the_reference_and_reach_both_ends_of_every_range_once():
    points = parameter_samples(TWO_REFERENCE, TWO_RANGES, 6)
    assert points[0] == TWO_REFERENCE
    assert len(points) == 6
    for name, (low, high) in TWO_RANGES.items():
        values = np.sort([p[name] for p in points[1:]])
        np.testing.assert_allclose(values, np.geomspace(low, high, 5), rtol=1e-12)
    assert points == parameter_samples(TWO_REFERENCE, TWO_RANGES, 6)


def test_held_out_points_differ_from_samples():
    seen = parameter_samples(TWO_REFERENCE, TWO_RANGES, 6)
    for point in held_out_samples(TWO_REFERENCE, TWO_RANGES, 4):
        for name in TWO_RANGES:
            assert min(abs(point[name] / other[name] - 1) for other in seen[1:]) > 1e-3
            assert TWO_RANGES[name][0] < point[name] < TWO_RANGES[name][1]


@pytest.mark.parametrize("ranges", [{}, {"E": (0.0, 1.0)}, {"E": (2.0, 1.0)}, {"E": (1.0, np.inf)}])
def test_a_missing_or_impossible_range_is_refused(ranges):
    with pytest.raises(InfeasibleError, match="parameter E"):
        parameter_samples({"E": 1.0}, ranges, 3)


def test_zero_samples_are_refused(one):
    full, S = one
    with pytest.raises(InfeasibleError, match="number of parameter samples is 0"):
        reduce_model(full, S, ("Fz", "Fy"), {"E": 2.1e11}, {"E": (1e11, 4e11)}, 8, 0, 1e-8, DAMPING)


def test_only_one_stiffness_is_in_memory_during_factorisation(one, monkeypatch):
    """That of its own θ: at a million unknowns each is as large as half the factor."""
    full, S = one
    made: list[weakref.ref] = []
    beside = []
    at = AffineOperator.at

    def watched(self, theta):
        X = at(self, theta)
        made.append(weakref.ref(X))
        return X

    def counted(K):
        beside.append(sum(reference() is not None for reference in made))
        return full.factorise(K)

    monkeypatch.setattr(AffineOperator, "at", watched)
    by = replace(full, factorise=counted)
    reduce_model(by, S, ("Fz", "Fy"), {"E": 2.1e11}, {"E": (1.6e11, 2.4e11)}, 4, 1, 1e-8, DAMPING)
    assert beside == [1]


def test_held_out_samples_are_in_the_order_of_halton():
    """Of seven parameters, as scipy numbers the sequence; each level once for every one of them."""
    names = [f"p{i}" for i in range(7)]
    found = held_out_samples(dict.fromkeys(names, 1.0), dict.fromkeys(names, (1.0, np.e)), 12)
    order = np.log([[own[name] for name in names] for own in found]).argsort(axis=0).argsort(axis=0)
    exact = qmc.Halton(7, scramble=False).random(13)[1:]
    assert np.array_equal(order, exact.argsort(axis=0).argsort(axis=0))
