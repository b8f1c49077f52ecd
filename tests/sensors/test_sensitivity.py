"""How readings change with place, turn and strain; the principal direction; gauges on shells."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.errors import UserError
from strainsight.mesh.facets import LOWER, UPPER, exterior_facets
from strainsight.sensors.bonded import BondedEntry, bonded, bridges
from strainsight.sensors.candidates import ACCELERATION, DISPLACEMENT, candidates, motion_candidates, principal_angles
from strainsight.sensors.installation import InstallationStd, sensitivity_rows
from strainsight.sensors.strain_operator import channel_rows, installation_axes, misplaced
from strainsight.sensors.surface_paths import skin_of

from ..fem.test_thin import B, L, T, strip
from .conftest import KINDS, bare, misplaced_rows, plate, tube

NU = 0.3


def surface_tensor(G, n):
    """sym(G) on the tangent plane of n (3, 3)."""
    P = np.eye(3) - np.outer(n, n)
    return P @ (G + G.T) @ P / 2


@pytest.mark.parametrize("kind", KINDS)
def test_in_homogeneous_strain_angle_and_transverse_strain_are_those_of_mohrs_circle(kind):
    position, facets = plate(kind, 5, 4, 0.2)
    position = position @ Rotation.from_rotvec([0.3, -0.2, 0.9]).as_matrix().T
    gauges = candidates(bare(position), facets, (1.0, 0.2, 0.1), (0.0, 35.0, 90.0))
    rng = np.random.default_rng(1)
    G = rng.standard_normal((3, 3))
    found = sensitivity_rows(position, gauges, (position @ G.T).reshape(-1, 1), 0.3, facets=facets)
    # Principal strains and the angle φ from the first of them to the gauge: ε = c + R cos 2φ.
    n = gauges.normal[0]
    values, axes = np.linalg.eigh(surface_tensor(G, n))
    plane = np.abs(n @ axes) < 0.5
    (second, first), axis = values[plane], axes[:, plane][:, 1]
    phi = np.arctan2(np.cross(axis, gauges.direction) @ n, gauges.direction @ axis)
    centre, radius = (first + second) / 2, (first - second) / 2
    along, across = centre + radius * np.cos(2 * phi), centre - radius * np.cos(2 * phi)
    np.testing.assert_allclose(found.gain[:, 0], along, atol=1e-12)
    np.testing.assert_allclose(found.angle[:, 0], -2 * radius * np.sin(2 * phi), atol=1e-12)
    np.testing.assert_allclose(found.transverse[:, 0], across + 0.285 * along, atol=1e-12)
    for nothing in (found.along, found.across, found.tilt_along, found.tilt_across):
        np.testing.assert_allclose(nothing, 0.0, atol=1e-11)


@pytest.mark.parametrize("length", [0.0, 0.4])
def test_the_turn_is_the_finite_difference_of_turned_gauges_also_with_grids(length):
    position, facets = plate("quad8", 5, 4)
    gauges = candidates(bare(position), facets, (1.0, 0.3, 0.0), (0.0, 50.0), length=length)
    field = quadratic(position, 3)
    found = sensitivity_rows(position, gauges, field, 0.0, facets=facets)
    h = 0.01
    ways = [misplaced_rows(position, gauges, field, facets, rotation=np.full(gauges.gauges, way)) for way in (h, -h)]
    slope = (ways[0] - ways[1]) / np.deg2rad(2 * h)
    np.testing.assert_allclose(found.angle, slope, atol=1e-6 * np.abs(slope).max())
    np.testing.assert_array_equal(found.along, np.zeros_like(slope))


def quadratic(position, count):
    """Displacement fields z_c = xᵀQ_c x (3n, count)."""
    Q = np.random.default_rng(5).standard_normal((count, 3, 3, 3))
    return np.einsum("ki,rcij,kj->kcr", position, Q, position).reshape(-1, count)


def slopes_of_quadratic(direction, ahead, count):
    """d/ds of dᵀ sym(∇z) d along `ahead` (m, 3): dᵀ (Q + Qᵀ) a in direction d, the same everywhere."""
    Q = np.random.default_rng(5).standard_normal((count, 3, 3, 3))
    return np.einsum("mc,mi,rcij,mj->mr", direction, direction, Q + np.swapaxes(Q, 2, 3), ahead)


@pytest.mark.parametrize("kind", ["quad8", pytest.param("tri6", marks=pytest.mark.slow)])
@pytest.mark.parametrize(("std", "length"), [(0.01, 0.0), (0.6, 0.2)])
def test_where_strain_varies_linearly_the_slopes_are_exact_over_facets_and_up_to_the_edge(kind, std, length):
    position, facets = plate(kind, 5, 4)
    gauges = candidates(bare(position), facets, (1.0, 0.3, 0.0), (10.0, 70.0), rosette=True, length=length)
    found = sensitivity_rows(position, gauges, quadratic(position, 2), std, facets=facets)
    if std > 0.5:
        _, held = misplaced(position, gauges, facets, np.tile([0.0, 3**0.5 * std], (gauges.gauges, 1)))
        assert held.any()
        assert not held.all()
    for slope, axis in zip((found.along, found.across), installation_axes(gauges), strict=True):
        expected = slopes_of_quadratic(gauges.direction, axis[gauges.gauge], 2)
        np.testing.assert_allclose(slope, expected, rtol=1e-3, atol=1e-3)


def test_the_slope_of_a_cubic_strain_is_its_mean_over_the_normal_distribution_of_the_place():
    """ε = (x − x₀)³ with x₀ = 8 m: E[3 (x − x₀ + s)²] = 3 (x − x₀)² + 3σ², far from the slope at the gauge itself."""
    position, facets = plate("quad8", 16, 3)
    z = np.column_stack([(position[:, 0] - 8) ** 4 / 4, 0 * position[:, 1:]])
    gauges = candidates(bare(position), facets, (1, 0, 0))
    x = gauges.position[:, 0] - 8
    gauges = gauges.take(np.flatnonzero(np.abs(x) < 3))
    x = gauges.position[:, 0] - 8
    for std in (1.0, 2.0):
        found = sensitivity_rows(position, gauges, z.reshape(-1, 1), std, facets=facets)
        np.testing.assert_allclose(found.along[:, 0], 3 * x**2 + 3 * std**2, rtol=0.1)
        np.testing.assert_allclose(found.across, 0.0, atol=1e-9)


def test_second_differences_of_a_quadratic_strain_are_its_second_derivatives():
    """ε = xy, exact here, and (x − x₀)³ nearly; E[(x − x₀)²] is σ² more than at the gauge."""
    position, facets = plate("quad8", 16, 6)
    x, y = position[:, 0], position[:, 1]
    fields = [x**2 * y / 2, (x - 8) ** 4 / 4, (x - 8) ** 3 / 3]
    z = np.stack([np.column_stack([field, 0 * position[:, 1:]]).ravel() for field in fields], axis=1)
    gauges = candidates(bare(position), facets, (1, 0, 0))
    inner = np.all(np.abs(gauges.position[:, :2] - [8, 3]) < [4, 1], axis=1)
    gauges, std = gauges.take(np.flatnonzero(inner)), 1.0
    found = sensitivity_rows(position, gauges, z, std, facets=facets)
    off = gauges.position[:, 0] - 8
    np.testing.assert_allclose(found.along_across[:, 0], 1.0, rtol=1e-9)
    np.testing.assert_allclose(found.along_twice[:, 0], 0.0, atol=1e-9)
    np.testing.assert_allclose(found.along_twice[:, 1], 6 * off, atol=0.05 * np.abs(6 * off).max())
    np.testing.assert_allclose(InstallationStd(position=std).mean(found)[:, 2], std**2, rtol=0.1)


def test_a_gauge_that_an_edge_holds_back_on_one_side_has_no_second_difference_across_it():
    position, facets = plate("quad8", 4, 3)
    gauges = candidates(bare(position), facets, (0, 1, 0))
    z = np.column_stack([0 * position[:, 0], position[:, 1] ** 4 / 4, 0 * position[:, 0]])
    found = sensitivity_rows(position, gauges, z.reshape(-1, 1), 2.0, facets=facets)
    np.testing.assert_allclose(found.across_twice, 0.0, atol=1e-13)
    np.testing.assert_allclose(found.along_across, 0.0, atol=1e-13)


def test_the_mean_of_turned_gauges_is_that_of_mohrs_circle():
    """E[ε(α)] = c + R cos 2φ exp(−2σ²) over normal α: less than the strain along the gauge by 2σ²R cos 2φ to second order."""
    position, facets = plate("quad8", 5, 4)
    gauges = candidates(bare(position), facets, (1.0, 0.2, 0.0), (0.0, 30.0))
    G = np.random.default_rng(3).standard_normal((3, 3))
    field, sigma = (position @ G.T).reshape(-1, 1), np.deg2rad(2.0)
    node, weight = np.polynomial.hermite_e.hermegauss(9)
    turned = [misplaced_rows(position, gauges, field, facets, rotation=np.full(gauges.gauges, 2.0 * x)) for x in node]
    exact = np.einsum("k,kmr->mr", weight / weight.sum(), turned) - channel_rows(position, gauges, field, facets=facets)
    mean = InstallationStd(angle=sigma).mean(sensitivity_rows(position, gauges, field, 0.0, facets=facets))
    np.testing.assert_allclose(mean, exact, rtol=2 * sigma**2)


def test_motion_sensors_tilt_about_every_axis_and_have_no_transverse_strain():
    position, facets = plate("quad8", 6, 5, 0.2)
    position = position @ Rotation.from_rotvec([0.4, 0.1, -0.3]).as_matrix().T
    for quantity in (DISPLACEMENT, ACCELERATION):
        sensors = motion_candidates(bare(position), facets, quantity, ((1, 0.3, 0), "normal"))
        rng = np.random.default_rng(2)
        G, shift = rng.standard_normal((3, 3)), rng.standard_normal(3)
        found = sensitivity_rows(position, sensors, (position @ G.T + shift).reshape(-1, 1), 0.2, facets=facets)
        e1, e2 = (axis[sensors.gauge] for axis in installation_axes(sensors))
        motion = sensors.position @ G.T + shift
        np.testing.assert_allclose(found.gain[:, 0], np.sum(sensors.direction * motion, axis=1), atol=1e-12)
        np.testing.assert_allclose(found.along[:, 0], np.sum(sensors.direction * (e1 @ G.T), axis=1), atol=1e-9)
        np.testing.assert_allclose(found.across[:, 0], np.sum(sensors.direction * (e2 @ G.T), axis=1), atol=1e-9)
        np.testing.assert_array_equal(found.transverse, 0.0)
        h = 1e-5
        for axis, rows in ((sensors.normal, found.angle), (e1, found.tilt_along), (e2, found.tilt_across)):
            ends = [Rotation.from_rotvec(way * axis).apply(sensors.direction) for way in (h, -h)]
            slope = np.sum((ends[0] - ends[1]) * motion, axis=1) / (2 * h)
            np.testing.assert_allclose(rows[:, 0], slope, atol=1e-8)


def rms(rows: np.ndarray, q: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """RMS (len(angle),) over the run of what a gauge at φ reads, from its strain tensor: d·ε·d in every instant."""
    e = q @ rows.T
    gamma = 2 * e[:, 1] - e[:, 0] - e[:, 2]
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    return np.sqrt(np.mean((np.outer(e[:, 0], c**2) + np.outer(e[:, 2], s**2) + np.outer(gamma, s * c)) ** 2, axis=0))


@pytest.mark.parametrize("modes", [1, 2, 5])
def test_no_direction_of_a_fine_sweep_reads_more(modes):
    rng = np.random.default_rng(modes)
    rows = rng.standard_normal((60, 3, modes))
    q = rng.standard_normal((40, modes)) * rng.uniform(0.1, 2, modes)
    found = principal_angles(rows, q.T @ q / 40)
    assert np.all((found >= -90) & (found < 90))
    sweep = np.linspace(-90, 90, 7201)
    for f in range(60):
        values = rms(rows[f], q, sweep)
        own = rms(rows[f], q, found[f : f + 1])[0]
        assert own >= values.max() * (1 - 1e-12)
        near = sweep[np.argmax(values)]
        if np.sort(values[np.abs((sweep - near + 90) % 180 - 90) > 5]).max() < values.max() * (1 - 1e-4):
            assert abs((found[f] - near + 90) % 180 - 90) < 0.1


def test_rounding_chooses_no_other_direction():
    rng = np.random.default_rng(3)
    shear, uniform, across = [0.0, 1.0, 0.0], [1.0, 1.0, 1.0], [0.0, 0.5, 1.0]
    rows = np.tile(np.array([shear, uniform, across])[..., None], (200, 1, 1))
    shaken = rows + 1e-10 * rng.standard_normal(rows.shape)
    found = principal_angles(shaken, np.eye(1)).reshape(200, 3)
    np.testing.assert_allclose(found, np.tile([45.0, 0.0, -90.0], (200, 1)), atol=1e-7)
    assert found[:, 2].min() >= -90


def test_candidates_turned_by_it_read_the_most_on_every_facet():
    position, facets = tube("quad8", 12, 4, 1.0, 0.1)
    mesh, rng = bare(position), np.random.default_rng(5)
    field = rng.standard_normal((3 * len(position), 3))
    q = rng.standard_normal((30, 3))
    three = candidates(mesh, facets, None, (0.0, 45.0, 90.0))
    turn = principal_angles(channel_rows(position, three, field).reshape(-1, 3, 3), q.T @ q / 30)
    best = candidates(mesh, facets, None, (0.0, 90.0), turn=turn, rosette=True)
    np.testing.assert_array_equal(best.angle[:2], [0.0, 90.0])
    np.testing.assert_allclose(np.sum(best.direction[::2] * best.direction[1::2], axis=1), 0, atol=1e-12)
    read = np.sqrt(np.mean((q @ channel_rows(position, best, field).T) ** 2, axis=0))[::2]
    for angle in range(0, 180, 10):
        other = candidates(mesh, facets, None, (float(angle),))
        assert np.all(np.sqrt(np.mean((q @ channel_rows(position, other, field).T) ** 2, axis=0)) <= read * (1 + 1e-12))


STRETCH, CURVATURE = 2e-4, 0.03


@pytest.mark.parametrize(("pattern", "reads"), [("half-bending", T * CURVATURE), ("half-axial", 2 * STRETCH)])
def test_a_half_bridge_through_the_thickness_reads_bending_or_tension_alone(pattern, reads):
    """u = ε x − κ x z, w = κ x²/2: ε on the faces is ε ∓ κ T/2."""
    mesh = strip()
    facets = exterior_facets(mesh)
    skin = skin_of(mesh.position, facets)
    pool = candidates(mesh, facets, axis=(-1.0, 0.0, 0.0), on_constraints=True)
    found = bridges(skin, pool, pattern, np.arange(len(facets.kind))).candidates
    x, _, z = mesh.position.T
    u = np.column_stack([STRETCH * x - CURVATURE * x * z, np.zeros(len(x)), CURVATURE * x**2 / 2])
    assert found.gauges == len(mesh.shells[0].ids)
    np.testing.assert_allclose(found.arms.grid.position[:, 2], -found.position[:, 2])
    np.testing.assert_allclose(abs(found.position[:, 2]), T / 2)
    read = channel_rows(mesh.position, found, u.reshape(-1, 1))[:, 0]
    np.testing.assert_allclose(read, np.sign(-found.position[:, 2]) * reads if pattern == "half-bending" else reads)


def test_a_bonded_gauge_is_on_the_face_that_it_is_nearer_to_and_in_the_middle_it_is_refused():
    mesh = strip()
    facets = exterior_facets(mesh)

    def at(z):
        entry = BondedEntry(position=(0.31 * L, 0.3 * B, z), direction=(1, 0, 0), name="A")
        return bonded(mesh, facets, [entry], tolerance=T)[0]

    for z, face in ((0.6 * T, UPPER), (0.4 * T, UPPER), (0.01 * T, UPPER), (-0.01 * T, LOWER), (-0.9 * T, LOWER)):
        assert at(z).facet == face
    with pytest.raises(UserError, match="bonded gauge A: the position is equally near to the upper and lower face of shell 7"):
        at(0.0)
