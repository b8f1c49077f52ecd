"""Which bearing parameters the displacements of the rings can tell, under the two conventions of the groove centres."""

from __future__ import annotations

import numpy as np
import pytest

from strainsight.multibody.bearing.element import bearing_load
from strainsight.multibody.bearing.equilibrium import displacement

from .bearings import pitch_bearing

ARM = np.array([1, 1, 1, 1.15, 1.15])


def sensitivity(convention, loads, preload=0.0):
    """∂q/∂ ln θ at constant load, tilts as motions of the pitch circle, stacked over the loads: (5 n, 6) [m]."""
    bearing = pitch_bearing(groove_centres=convention, preload=preload)
    rows = []
    for F in loads:
        load = bearing_load(bearing, displacement(bearing, F))
        rows.append(ARM[:, None] * np.linalg.solve(load.tangent, load.slopes))
    return np.vstack(rows) * np.where(bearing.parameters == 0, 1.0, bearing.parameters)


def blade_loads(count):
    """A blade of 14 t, its centre of mass 11 m from the bearing, in all directions, with up to its weight along the axis."""
    rng = np.random.default_rng(0)
    for _ in range(count):
        phi, share, axial, radial = rng.uniform([0, 0.3, -1, -1], [2 * np.pi, 1, 1, 1])
        c, s = np.cos(phi), np.sin(phi)
        yield 1.4e5 * np.array([axial, radial * c, radial * s, -11 * share * s, 11 * share * c])


def test_ball_and_grooves_show_about_130_times_more_where_the_centres_are_fixed():
    load = [1.4e5 * np.array([0.0, 1.0, 0.0, 0.0, 11.0])]
    ratio = np.linalg.norm(sensitivity("fixed", load), axis=0) / np.linalg.norm(sensitivity("follow", load), axis=0)
    assert np.all((ratio[:5] > 100) & (ratio[:5] < 150))
    # clearance and oversize change nothing of where the centres stand
    assert ratio[5] == pytest.approx(1.0, rel=1e-9)


@pytest.mark.parametrize("preload", [0.0, 3e-5])
def test_ball_diameter_and_preload_are_one_unknown_where_the_centres_are_fixed(preload):
    for convention, low, high in (("fixed", 0.0, 0.2), ("follow", 5.0, 90.0)):
        J = sensitivity(convention, blade_loads(40), preload)
        between = abs(J[:, 0] @ J[:, 5]) / np.linalg.norm(J[:, 0]) / np.linalg.norm(J[:, 5])
        assert low <= np.degrees(np.arccos(between)) < high


@pytest.mark.parametrize("preload", [0.0, 1e-5, 3e-5])
def test_four_groove_radii_together_are_distinguished_thousands_of_times_worse_than_two(preload):
    J = sensitivity("fixed", blade_loads(40), preload)
    four, two = np.linalg.cond(J[:, 1:5]), np.linalg.cond(J[:, 1:3])
    assert 3e3 < four < 1e5
    assert two < 5
