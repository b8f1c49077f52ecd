"""Bridges of gauges at several places, and the export of positions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import pyuff

from strainsight.config.layout import BoxZone, LayoutSettings, ZoneLimit
from strainsight.errors import UserError
from strainsight.experiment.layout.task import PoolRows, layout_limits
from strainsight.mesh.facets import exterior_facets
from strainsight.sensors.bonded import BondedEntry, bonded
from strainsight.sensors.candidates import candidates, concatenate
from strainsight.sensors.export import uff_text
from strainsight.sensors.installation import (
    InstallationStd,
    installation_variance,
    installed_rows,
    sample_installation,
    sensitivity_rows,
)
from strainsight.sensors.screening import screen
from strainsight.sensors.strain_operator import channel_matrix, channel_rows

from ..bodies import NU, E, body, held, moved

LENGTH, WIDTH, HEIGHT = 1.0, 0.1, 0.08
TOP, BELOW = (0.5, WIDTH / 2, HEIGHT), (0.5, WIDTH / 2, 0.0)
ALONG = (1.0, 0.0, 0.0)


def diagonal(sign: int, n_z: int) -> tuple[float, float, float]:
    """±45° from x, right-handed about the normal (0, 0, n_z)."""
    return (1.0, sign * n_z, 0.0)


BENDING = [(TOP, ALONG, 1), (BELOW, ALONG, -1), (TOP, ALONG, 1), (BELOW, ALONG, -1)]
TORSION = [(x, diagonal(sign, n), sign) for x, n in ((TOP, 1), (BELOW, -1)) for sign in (1, -1)]


@pytest.fixture(scope="module")
def beam():
    mesh = body("hex20", (9, 7, 6), lambda u, v, w: (LENGTH * u / 9, WIDTH * v / 7, HEIGHT * w / 6))
    mesh = held(mesh, mesh.position[:, 0] == 0)
    return mesh, exterior_facets(mesh)


def bridge(beam, arms, name="B", length=0.0, tolerance=1e-6):
    (x, d, first), *others = sorted(arms, key=lambda arm: -arm[2])
    assert first == 1
    more = [(BondedEntry(at, along, length), sign) for at, along, sign in others]
    return bonded(*beam, [BondedEntry(x, d, length, name=name, arms=more)], tolerance)[0]


def single(beam, at, along, length=0.0):
    return bonded(*beam, [BondedEntry(at, along, length)], 1e-6)[0]


def loaded(mesh, at, force):
    """Displacements under a force at the node nearest to a place."""
    f = np.zeros((len(mesh.position), 3))
    f[np.argmin(np.linalg.norm(mesh.position - at, axis=1))] = force
    return moved(mesh, f)


@pytest.fixture(scope="module")
def motions(beam):
    """Displacements under a force at the middle of the tip, and under one of 1 kN at its edge."""
    mesh, _ = beam
    return (
        loaded(mesh, (LENGTH, WIDTH / 2, HEIGHT / 2), (0, 0, 1000.0)),
        loaded(mesh, (LENGTH, WIDTH, HEIGHT / 2), (0, 0, 1000.0)),
    )


def bending_strain(force):
    """−M z/(E I) on top, M = −F (L − x) where the beam is bent upwards."""
    return -force * (LENGTH - 0.5) * (HEIGHT / 2) / (E * WIDTH * HEIGHT**3 / 12)


def shear_strain(torque):
    """γ at the middle of the wide side under Saint-Venant's torsion, by the series of Timoshenko and Goodier, art. 109."""
    a, b, n = HEIGHT / 2, WIDTH / 2, np.arange(1, 60, 2)
    series = np.sum(np.tanh(n * np.pi * b / (2 * a)) / n**5)
    Gtheta = torque / ((2 * a) ** 3 * 2 * b / 3 * (1 - 192 / np.pi**5 * a / b * series))
    tau = 2 * Gtheta * a * (1 - 8 / np.pi**2 * np.sum(1 / (n**2 * np.cosh(n * np.pi * b / (2 * a)))))
    return tau / (E / (2 * (1 + NU)))


def test_bending_and_torsion_are_distinguished_as_by_the_closed_forms(beam, motions):
    """Four arms along the beam read 4 ε of bending, four at ±45° 2 γ of torsion, either nothing of the other."""
    mesh, facets = beam
    both = concatenate([bridge(beam, BENDING), bridge(beam, TORSION)])
    pure, eccentric = (channel_rows(mesh.position, both, z, facets=facets)[:, 0] for z in motions)
    bending, torsion = 4 * bending_strain(1000.0), 2 * shear_strain(1000.0 * WIDTH / 2)
    assert pure[0] == pytest.approx(bending, rel=1e-4)
    assert eccentric[0] == pytest.approx(bending, rel=1e-4)
    assert abs(pure[1]) < 1e-9 * abs(bending)
    assert abs(eccentric[1]) == pytest.approx(torsion, rel=0.006)


@pytest.mark.parametrize("length", [0.0, 0.03])
def test_a_bridge_reads_the_signed_sum_of_single_gauges_at_its_arms(beam, motions, length):
    mesh, facets = beam
    arms = [
        (TOP, ALONG, -1),
        ((0.4, 0.07, HEIGHT), (1, 0.5, 0), 1),
        (BELOW, (0, 1, 0), 1),
        ((0.3, 0, 0.05), (1, 0, 1), -1),
    ]
    own = bridge(beam, arms, length=length)
    z = np.hstack(motions)
    parts = [s * channel_rows(mesh.position, single(beam, x, d, length), z, facets=facets)[0] for x, d, s in arms]
    read = channel_rows(mesh.position, own, z, facets=facets)[0]
    np.testing.assert_allclose(read, sum(parts), rtol=0, atol=1e-13 * np.abs(parts).max())
    np.testing.assert_allclose((channel_matrix(mesh.position, own, facets) @ z)[0], read, atol=1e-18)


def test_bridges_stay_whole_among_other_gauges_in_any_order(beam, motions):
    mesh, facets = beam
    free = candidates(mesh, facets, (1, 0.2, 0.3), (0.0, 45.0, 90.0), rosette=True).take(np.arange(6))
    pool = concatenate([bridge(beam, BENDING), free, bridge(beam, TORSION[:2]), single(beam, TOP, (0, 1, 0))])
    rows = channel_rows(mesh.position, pool, motions[1], facets=facets)
    assert pool.gauges == 1 + 2 + 1 + 1
    assert len(pool.grids) == 4 + 6 + 2 + 1
    order = np.array([8, 1, 2, 3, 7, 0])
    np.testing.assert_array_equal(channel_rows(mesh.position, pool.take(order), motions[1], facets=facets), rows[order])
    grids, each = pool.grids_of(np.array([3, 0]))
    part = pool.take(pool.channels(np.array([3, 0])))
    np.testing.assert_array_equal(pool.grids.position[grids], part.grids.position)
    np.testing.assert_array_equal(pool.grids.gauge[grids], each)


def to_bond(pool):
    """The same gauges as candidates, which no tolerance spares."""
    if pool.arms is not None:
        grid = pool.arms.grid
        pool = replace(pool, arms=replace(pool.arms, grid=replace(grid, bonded=np.zeros(len(grid), dtype=bool))))
    return replace(pool, bonded=np.zeros(len(pool), dtype=bool))


STD = InstallationStd(position=0.001, angle=0.03, gain=0.01, transverse=0.01)


def test_the_variance_by_tolerances_is_the_sum_of_those_of_single_gauges(beam, motions):
    """3000 draws know a variance to 1/√1500, 2.6 %; three of that are asked."""
    mesh, facets = beam
    z, one = motions[1], np.ones((1, 1))

    def variance(pool):
        slopes = sensitivity_rows(mesh.position, pool, z, STD.position, facets=facets)
        return installation_variance(slopes, STD, pool, one, one)[0]

    whole = to_bond(bridge(beam, TORSION))
    parts = [variance(to_bond(single(beam, x, d))) for x, d, _ in TORSION]
    assert variance(whole) == pytest.approx(sum(parts), rel=1e-9)
    many = concatenate([whole] * 3000)
    installation = sample_installation(many, STD, np.random.default_rng(2))
    drawn = installed_rows(mesh.position, many, z, installation, facets=facets)[0]
    assert np.var(drawn) == pytest.approx(variance(whole), rel=0.08)


def test_zeros_belong_to_the_channel_and_temperature_to_the_arms(beam):
    std = InstallationStd(offset=2e-6, temperature=10.0, thermal_output=1e-6, thermal_spread=1e-7)
    half, two = bridge(beam, BENDING[:2]), bridge(beam, [BENDING[0], (TOP, ALONG, 1)])
    both, rng = concatenate([half, two]), np.random.default_rng(1)
    drawn = [sample_installation(both, std, rng) for _ in range(1500)]
    offset, drift = (np.array([getattr(d, name) for d in drawn]) for name in ("offset", "drift"))
    np.testing.assert_allclose(offset.std(axis=0), 2e-6, rtol=0.05)
    np.testing.assert_allclose(drift[:, 0].std(), 10 * np.sqrt(2) * 1e-7, rtol=0.06)
    np.testing.assert_allclose(drift[:, 1].std(), 10 * 2e-6, rtol=0.06)


def test_an_arm_off_the_surface_is_named_with_its_key(beam):
    arm = BondedEntry((0.5, 0.05, 0.2), ALONG, name="B, arm 2", key="gauges.fixed.0.arms.1")
    with pytest.raises(UserError) as caught:
        bonded(*beam, [BondedEntry(TOP, ALONG, name="B", arms=[(arm, -1)])], 0.005)
    assert caught.value.key == "gauges.fixed.0.arms.1"
    assert "B, arm 2: the position is 0.12 m from the surface" in caught.value.what


def test_coincident_arms_of_opposite_sign_are_refused(beam):
    with pytest.raises(UserError, match="position and direction"):
        bridge(beam, [(TOP, ALONG, 1), (TOP, (-1, 0, 0), -1)])
    assert len(bridge(beam, [(TOP, ALONG, 1), (TOP, ALONG, 1)]).grids) == 2


def test_every_arm_counts_for_spacing_and_zones(beam):
    mesh, _ = beam
    pool = to_bond(
        concatenate(
            [bridge(beam, BENDING), single(beam, (0.5, 0.06, 0.0), ALONG), single(beam, (0.2, 0.05, HEIGHT), ALONG)]
        )
    )
    rows = PoolRows(np.arange(3)[:, None], np.arange(3)[:, None])
    below = BoxZone(box=((0.4, 0.0, -0.01), (0.6, 0.1, 0.01)))
    place = LayoutSettings(keep=2, minimum_spacing=0.03, at_most=(ZoneLimit(zone=below, count=1),))
    limits = layout_limits(place, rows, mesh, pool, np.ones(3), key="gauges.none")
    free = LayoutSettings(keep=2)
    assert layout_limits(free, rows, mesh, pool, np.ones(3)).allows(np.array([0, 1]))
    assert not limits.allows(np.array([0, 1]))
    assert limits.allows(np.array([0, 2]))

    further = (pool.arms.grid.position, pool.arms.channel)
    kept = screen(np.array([3.0, 2.0, 1.0]), 1.0, pool.position, None, 0.03, also_at=further)
    np.testing.assert_array_equal(kept.kept, [0, 2])
    kept = screen(np.array([2.0, 3.0, 1.0]), 1.0, pool.position, None, 0.03, also_at=further)
    np.testing.assert_array_equal(kept.kept, [1, 2])


def test_another_reader_finds_the_layout_with_x_along_the_gauges_and_z_outward(tmp_path):
    """pyuff (MIT). Gauge 4 lies along its normal, gauge 5 has none."""
    rng = np.random.default_rng(0)
    position, n = rng.uniform(-1, 1, (5, 3)), rng.standard_normal((5, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    d = np.cross(n, rng.standard_normal((5, 3)))
    d /= np.linalg.norm(d, axis=1)[:, None]
    d[3], n[4] = n[3], 0.0
    path = tmp_path / "layout.uff"
    path.write_text(uff_text(position, d, n, ["G1", "G2", "rosette é", "", "-1"]))
    sets = {s["type"]: s for s in pyuff.UFF(str(path)).read_sets()}
    np.testing.assert_array_equal(np.column_stack([sets[2411][axis] for axis in "xyz"]), position)
    np.testing.assert_array_equal(sets[2411]["disp_cs"], np.arange(1, 6))
    assert sets[2420]["CS_sys_labels"] == [1, 2, 3, 4, 5]
    assert sets[2420]["CS_names"] == ["G1", "G2", "rosette ?", "NONE", "NONE -1"]
    matrices = np.array(sets[2420]["CS_matrices"])
    np.testing.assert_array_equal(matrices[:, 3], position)
    np.testing.assert_allclose(matrices[[0, 1, 2, 4], 0], d[[0, 1, 2, 4]], atol=1e-14)
    np.testing.assert_allclose(matrices[:4, 2], n[:4], atol=1e-14)
    for own in matrices[:, :3]:
        np.testing.assert_allclose(own @ own.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(own) > 0
    assert sets[164]["length"] == 1.0
    assert sets[164]["units_code"] == 1
