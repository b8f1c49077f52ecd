"""Straight beams against the differential equation of the beam, statics and published frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate

from strainsight.errors import DeckError
from strainsight.fem.beam_matrices import (
    beam_masses,
    beam_stiffnesses,
    rod_masses,
    rod_stiffnesses,
)
from strainsight.fem.beam_properties import BeamProperties, properties_of
from strainsight.mesh.thin import BeamSection

from ..beams import Frame, axes_of, line, properties, rectangle
from .shell_models import rigid_motions

CLAMP = {0: range(6)}
NONE = np.zeros((1, 2, 6), bool)
SHEAR = (0.8, 0.6)


def one(own, position=((0.0, 0.0, 0.0), (2.0, 0.0, 0.0)), towards=(0.0, 1.0, 0.0), released=NONE, offset=None):
    position = np.array([position])
    offset = np.zeros((1, 2, 3)) if offset is None else offset
    axes = axes_of(position + offset, towards)
    return beam_stiffnesses(position, axes, own, offset, released, np.array([7]))[0]


@pytest.mark.parametrize("k", [(0.0, 0.0), SHEAR])
@pytest.mark.parametrize("ratio", ["constant", 1.0, 0.1, 1e-3, 1e5])
def test_tapered_beam_with_I12_is_the_integral_of_its_curvature(k, ratio):
    """Tip motions of a cantilever under six loads, by quadrature of u″ and of the shear (scipy)."""
    L, E, G = 2.0, 1.0, 1 / 2.6
    ends = np.array([[3e-5, 9e-6], [9e-6, 8e-6]]), np.array([[2e-5, -4e-6], [-4e-6, 9e-6]])
    times = 1.0 if ratio == "constant" else ratio
    A, J = np.array([0.02, 0.02 * times**0.5]), np.array([1e-5, 1e-5 * times])
    S = np.array([ends[0], ends[0] if ratio == "constant" else times * ends[1]])
    own = properties(1, A, S, J, k)
    K = one(own)
    loads = np.eye(6)
    tip = np.linalg.solve(K[6:, 6:], loads).T
    for load, found in zip(loads, tip, strict=True):

        def rates(x, load=load):
            """ε, γ_y, γ_z, θ' and the moving of the tip they cause."""
            mix = np.array([1 - x / L, x / L])
            (Iy, Iyz), (_, Iz) = np.tensordot(mix, S, 1)  # ∫y², ∫yz, ∫z²
            My, Mz = load[4] - (L - x) * load[2], load[5] + (L - x) * load[1]
            # M_y = E(∫z² θy' − ∫yz θz'), M_z = E(∫y² θz' − ∫yz θy')
            turn_y, turn_z = np.linalg.solve([[Iz, -Iyz], [-Iyz, Iy]], [My, Mz]) / E
            area = mix @ A
            gamma = [V / (G * f * area) if f else 0.0 for V, f in zip(load[1:3], k, strict=True)]
            return np.array(
                [
                    load[0] / (E * area),
                    gamma[0] + (L - x) * turn_z,
                    gamma[1] - (L - x) * turn_y,
                    load[3] / (G * (mix @ J)),
                    turn_y,
                    turn_z,
                ]
            )

        exact, _ = integrate.quad_vec(rates, 0, L, epsrel=1e-13, epsabs=1e-300)
        np.testing.assert_allclose(found, exact, rtol=1e-9, atol=1e-11 * np.abs(exact).max())


@pytest.mark.parametrize("own", [rectangle(1, 0.1, 0.2, SHEAR), rectangle(1, 0.1, 0.2, torsion=0.0)])
def test_beam_stiffness_vanishes_only_for_rigid_motions(own):
    rng = np.random.default_rng(1)
    position, offset = rng.normal(size=(2, 3)), 0.3 * rng.normal(size=(1, 2, 3))
    K = one(own, position, (0.1, 0.7, 0.4), offset=offset)
    assert np.array_equal(K, K.T)
    rigid = rigid_motions(position)
    assert np.abs(K @ rigid).max() < 1e-13 * np.abs(K).max()
    values = np.linalg.eigvalsh(K)
    assert (values > 1e-9 * values[-1]).sum() == (6 if own.torsion.any() else 5)
    assert values[0] > -1e-13 * values[-1]


def test_a_beam_that_is_turned_has_its_matrix_turned():
    rng = np.random.default_rng(2)
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    Q *= np.linalg.det(Q)
    position, towards, offset = rng.normal(size=(2, 3)), rng.normal(size=3), 0.2 * rng.normal(size=(1, 2, 3))
    own = properties(1, [0.02, 0.01], [[[3e-4, 1e-4], [1e-4, 9e-5]], [[1e-4, 0], [0, 2e-4]]], [1e-4, 2e-4], SHEAR)
    released = rng.random((1, 2, 6)) < 0.2
    T = np.kron(np.eye(4), Q)
    K = one(own, position, towards, released, offset)
    turned = one(own, position @ Q.T, Q @ towards, released, offset @ Q.T)
    np.testing.assert_allclose(turned, T @ K @ T.T, atol=1e-12 * np.abs(K).max())


@pytest.mark.parametrize("k", [(0.0, 0.0), (0.0, 0.8)])
def test_a_plane_beam_bends_in_its_plane_alone(k):
    """I2 = 0: plane 1 is that of a beam that bends both ways, plane 2 has no stiffness; the same along any principal axes."""
    A, I1, J = 0.02, 3e-5, 1e-5
    plane, across = np.array([0, 1, 3, 5, 6, 7, 9, 11]), np.array([2, 4, 8, 10])
    K, whole = (one(properties(1, A, np.diag([I1, own]), J, k)) for own in (0.0, I1))
    np.testing.assert_allclose(K[np.ix_(plane, plane)], whole[np.ix_(plane, plane)], atol=1e-14 * whole.max())
    assert not K[across].any()
    c, s = np.cos(0.4), np.sin(0.4)
    values = np.linalg.eigvalsh(one(properties(1, A, I1 * np.outer([c, s], [c, s]), 0.0, (0.0, 0.0))))
    assert (values > 1e-10 * values[-1]).sum() == 3
    straight = np.linalg.eigvalsh(one(properties(1, A, np.diag([I1, 0.0]), 0.0)))
    np.testing.assert_allclose(values[-3:], straight[-3:], rtol=1e-9)


def test_a_beam_without_bending_is_a_rod():
    position = np.array([[[0, 0, 0], [1.0, 2.0, 0.5]]])
    K = one(properties(1, 0.02, np.zeros((2, 2)), 1e-5), position[0], (0, 0, 1))
    rod = rod_stiffnesses(position, np.array([0.02]), np.array([1e-5]), np.array([0.3]), np.array([1]))[0]
    np.testing.assert_allclose(K, rod, atol=1e-14 * rod.max())


@pytest.mark.parametrize("seed", range(6))
def test_released_motions_carry_no_force_and_store_the_least_energy(seed):
    rng = np.random.default_rng(seed)
    own = properties(1, 1.0, np.array([[3.0, 1.0], [1.0, 2.0]]), 1.5, SHEAR if seed % 2 else (0, 0))
    released = rng.random((1, 2, 6)) < 0.45
    full, found = one(own), one(own, released=released)
    r = np.flatnonzero(released.ravel())
    exact = full - full[:, r] @ np.linalg.pinv(full[np.ix_(r, r)], rcond=1e-10) @ full[r]
    np.testing.assert_allclose(found, exact, atol=1e-12 * full.max())
    assert not found[r].any()


def test_offset_beam_by_statics():
    """Both ends raised by h: pulled at its nodes the beam bends with M = N h, u = N L/(E A) + N h² L/(E I)."""
    E, L, A, I1, h, N = 70e9, 2.0, 1e-3, 3e-8, 0.05, 1000.0
    offset = np.tile([0.0, h, 0.0], (4, 2, 1))
    frame = Frame(*line(4, L), (0, 1, 0), properties(4, A, np.diag([I1, I1]), 1e-8), E, offset=offset)
    tip = frame.solve(CLAMP, {(4, 0): N})[4]
    assert tip[0] == pytest.approx(N * L / (E * A) + N * h**2 * L / (E * I1))
    # N acts h below the beam: M_z = +N h, the tip turns by N h L/(E I)
    assert tip[5] == pytest.approx(N * h * L / (E * I1))
    assert tip[1] == pytest.approx(N * h * L**2 / (2 * E * I1))


def test_macneal_harder_curved_beam():
    """Quarter circle of radii 4.12 and 4.32, thickness 0.1, ν 0.25: 0.08734 along its tip's radius, 0.5022 out of its plane.

    In its plane a bar on the line R = 4.22 gives π P R³/(4 E I) + π P R/(4 E A) + π P R/(4 k G A), 1.4 % more: the target is of a
    thick ring.
    """
    t = np.linspace(0, np.pi / 2, 25)
    nodes = 4.22 * np.stack([np.sin(t), np.cos(t), 0 * t], axis=1)
    pairs = np.stack([np.arange(24), np.arange(1, 25)], axis=1)
    out = np.tile([0.0, 0.0, 1.0], (24, 1))
    own = rectangle(24, 0.1, 0.2, (5 / 6, 5 / 6), nu=0.25)  # y out of the plane
    frame = Frame(nodes, pairs, out, own, 1e7)
    radial = frame.solve(CLAMP, {(24, 0): 1.0})[24, 0]
    R, E, I, A = 4.22, 1e7, 0.1 * 0.2**3 / 12, 0.02
    assert radial == pytest.approx(0.08734, rel=0.02)
    assert radial == pytest.approx(np.pi / 4 * R / E * (R**2 / I + 1 / A + 2.5 / (5 / 6 * A)), rel=1e-3)
    assert frame.solve(CLAMP, {(24, 2): 1.0})[24, 2] == pytest.approx(0.5022, rel=0.02)


def test_macneal_harder_twisted_beam():
    """12 × 1.1 × 0.32, twisted by 90°, E 29e6, ν 0.22: 0.005424 and 0.001754 at the tip."""
    count = 24
    middle = (np.arange(count) + 0.5) / count * np.pi / 2
    towards = np.stack([0 * middle, np.cos(middle), np.sin(middle)], axis=1)
    frame = Frame(*line(count, 12.0), towards, rectangle(count, 1.1, 0.32, (5 / 6, 5 / 6), nu=0.22), 29e6)
    found = [frame.solve(CLAMP, {(count, c): 1.0})[count, c] for c in (1, 2)]
    np.testing.assert_allclose(sorted(found), [0.001754, 0.005424], rtol=0.01)


def test_rods_pull_and_twist():
    position = np.array([[[0, 0, 0], [0.0, 3.0, 4.0]]])
    K = rod_stiffnesses(position, np.array([2e-3]), np.array([5e-6]), np.array([0.25]), np.array([1]))[0]
    x = np.array([0.0, 0.6, 0.8])
    np.testing.assert_allclose(K[:3, :3], 2e-3 / 5 * np.outer(x, x))
    np.testing.assert_allclose(K[3:6, 9:], -5e-6 / 2.5 / 5 * np.outer(x, x))
    assert np.count_nonzero(K[:3, 3:6]) == 0


def test_properties_of_sections():
    b = BeamSection(2.0, np.diag([5.0, 6.0]), 7.0)
    own = properties_of([BeamSection(1.0, np.eye(2), 3.0, (0.5, 0.6), at_b=b), BeamSection(4.0)], np.array([0.3, 0.2]))
    np.testing.assert_array_equal(own.area, [[1, 2], [4, 4]])
    np.testing.assert_array_equal(own.second[0, 1], np.diag([5.0, 6.0]))
    np.testing.assert_array_equal(own.torsion, [[3, 7], [0, 0]])
    np.testing.assert_array_equal(own.shear, [[0.5, 0.6], [0, 0]])


GOOD = properties(1, 1.0, np.eye(2), 1.0)
WRONG = {
    "area 0": replace(GOOD, area=np.array([[1.0, 0.0]])),
    "I1 -1": replace(GOOD, second=-GOOD.second),
    "J -1": replace(GOOD, torsion=-GOOD.torsion),
    "shear factor -0.5": replace(GOOD, shear=np.array([[0.0, -0.5]])),
    "I12²": properties(1, 1.0, [[1.0, 1.1], [1.1, 1.0]], 1.0),
    "at one end only": properties(1, 1.0, np.eye(2), [1.0, 0.0]),
    "has .* one end only": properties(1, 1.0, [[[1.0, 0], [0, 1.0]], [[1.0, 0], [0, 0.0]]], 1.0),
}


@pytest.mark.parametrize("what", WRONG)
def test_impossible_sections_are_refused(what):
    words = "resists" if "ends" in what else what
    with pytest.raises(DeckError, match=f"element 7 .*{words}") as error:
        one(WRONG[what])
    assert error.value.entity == ("element", 7)
    assert error.value.remedy


def test_beams_without_length_or_orientation_are_refused():
    zero, ids, none = np.zeros((2, 2, 3)), np.array([4, 9]), np.zeros((2, 2, 6), bool)
    position = np.array([[[0, 0, 0], [1, 0, 0]], [[5, 5, 5], [5, 5, 5]]], float)
    axes, own = np.tile(np.eye(3), (2, 1, 1)), properties(2, 1.0, np.eye(2), 1.0)
    ones = np.ones(2)
    for call in (
        lambda: beam_stiffnesses(position, axes, own, zero, none, ids),
        lambda: beam_masses(position, axes, np.ones((2, 2)), zero, ids),
        lambda: rod_stiffnesses(position, ones, ones, 0.3 * ones, ids),
        lambda: rod_masses(position, ones, ids),
    ):
        with pytest.raises(DeckError, match="element 9 has the length 0 m") as error:
            call()
        assert error.value.entity == ("element", 9)
    axes[0] = np.nan
    position[1, 1, 0] = 6
    with pytest.raises(DeckError, match=r"element 4 .* orientation"):
        beam_stiffnesses(position, axes, own, zero, none, ids)
    with pytest.raises(DeckError, match="element 4 has the area 0"):
        rod_stiffnesses(position, 0 * ones, ones, 0.3 * ones, ids)
    with pytest.raises(DeckError, match="element 4 has the torsion constant J -1"):
        rod_stiffnesses(position, ones, -ones, 0.3 * ones, ids)


def test_many_beams_are_each_one_of_them():
    rng = np.random.default_rng(3)
    e = 20
    position, towards = rng.normal(size=(e, 2, 3)), rng.normal(size=(e, 3))
    half = rng.normal(size=(e, 2, 2, 2))
    half[3], half[4, :, :, 1] = 0.0, 0.0
    own = BeamProperties(
        rng.uniform(1, 2, (e, 2)),
        half @ half.swapaxes(2, 3),
        rng.uniform(1, 2, (e, 2)),
        rng.uniform(0.5, 1, (e, 2)),
        np.full(e, 0.3),
    )
    own.second[4, 1] = own.second[4, 0]
    released, offset = rng.random((e, 2, 6)) < 0.1, 0.1 * rng.normal(size=(e, 2, 3))
    axes = axes_of(position + offset, towards)
    K = beam_stiffnesses(position, axes, own, offset, released, np.arange(e))
    for i in range(e):
        cut = slice(i, i + 1)
        alone = BeamProperties(own.area[cut], own.second[cut], own.torsion[cut], own.shear[cut], own.poisson_ratio[cut])
        single = beam_stiffnesses(position[cut], axes[cut], alone, offset[cut], released[cut], np.arange(1))
        np.testing.assert_allclose(K[i], single[0], atol=1e-13 * np.abs(K[i]).max())
