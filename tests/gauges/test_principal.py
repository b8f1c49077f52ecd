"""The direction in which the training run strains a place most."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.gauges.candidates import candidates
from strainsight.gauges.principal import principal_angles
from strainsight.gauges.rows import channel_rows


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


def test_a_static_load_gives_the_principal_axis_of_larger_strain():
    """Eigenvectors of the strain tensor of the plane."""
    rng = np.random.default_rng(0)
    for _ in range(50):
        xx, yy, xy = rng.standard_normal(3)
        values, vectors = np.linalg.eigh([[xx, xy], [xy, yy]])
        v = vectors[:, np.argmax(np.abs(values))]
        rows = np.array([xx, (xx + yy) / 2 + xy, yy])[None, :, None]
        found = np.deg2rad(principal_angles(rows, np.eye(1))[0])
        assert abs(np.cos(found) * v[1] - np.sin(found) * v[0]) < 1e-8


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e9])
def test_where_all_directions_are_alike_it_is_the_first(scale):
    rows = scale * np.array([[[1.0], [1.0], [1.0]], [[0.0], [0.0], [0.0]]])
    np.testing.assert_array_equal(principal_angles(rows, np.eye(1)), 0.0)


def test_rounding_chooses_no_other_direction():
    """Shear strains two directions alike, uniform strain all of them; ±90° is one direction, stated as −90°."""
    rng = np.random.default_rng(3)
    shear, uniform, across = [0.0, 1.0, 0.0], [1.0, 1.0, 1.0], [0.0, 0.5, 1.0]
    rows = np.tile(np.array([shear, uniform, across])[..., None], (200, 1, 1))
    shaken = rows + 1e-10 * rng.standard_normal(rows.shape)
    found = principal_angles(shaken, np.eye(1)).reshape(200, 3)
    np.testing.assert_allclose(found, np.tile([45.0, 0.0, -90.0], (200, 1)), atol=1e-7)
    assert found[:, 2].min() >= -90


def test_candidates_turned_by_it_read_the_most_on_every_facet(tube, bare):
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
