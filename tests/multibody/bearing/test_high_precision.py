"""The element against the scalar equations of the thesis with 40 digits, and what it identifies."""

from __future__ import annotations

import mpmath as mp
import numpy as np
import pytest

from strainsight.multibody.bearing.element import ball_loads, bearing_load, displacement
from strainsight.multibody.bearing.geometry import Bearing

from .bearings import pitch_bearing

DIGITS = 40


def hertz_constant(D, r, d_m, cosine, inner, modulus):
    """Harris: K from F(ρ) = ((κ² + 1) E − 2 F)/((κ² − 1) E) and δ* = (2F/π) (π/(2 κ² E))^⅓."""
    gamma = D * cosine / d_m
    rolling = 2 * gamma / (D * (1 - gamma)) if inner else -2 * gamma / (D * (1 + gamma))
    total, difference = 4 / D - 1 / r + rolling, abs(1 / r + rolling)

    def residual(kappa):
        m = 1 - 1 / kappa**2
        E, F = mp.ellipe(m), mp.ellipk(m)
        return ((kappa**2 + 1) * E - 2 * F) / ((kappa**2 - 1) * E) - difference / total

    kappa = mp.findroot(residual, (2, 20), solver="anderson", tol=mp.mpf(10) ** (-2 * DIGITS + 8))
    m = 1 - 1 / kappa**2
    E, F = mp.ellipe(m), mp.ellipk(m)
    delta_star = 2 * F / mp.pi * (mp.pi / (2 * kappa**2 * E)) ** (mp.mpf(1) / 3)
    return (2 / (delta_star * total)) ** mp.mpf("1.5") * 2 * total * modulus / 3


def exact_load(bearing, theta, q, starts):
    """(1.18) with the erratum for V and W of every ball, then (1.21-1.25) with the lever arms of each groove centre."""
    D, preload = theta[0], theta[5]
    alpha, d_m = mp.mpf(bearing.contact_angle), mp.mpf(bearing.pitch_diameter)
    modulus = mp.mpf(bearing.youngs_modulus) / (2 * (1 - mp.mpf(bearing.poisson_ratio) ** 2))
    sides = ((1, 1), (-1, 1), (1, -1), (-1, -1))
    cut = theta if bearing.groove_centres == "follow" else [mp.mpf(value) for value in bearing.nominal]
    K = [hertz_constant(D, theta[1 + k], d_m, mp.cos(alpha), k < 2, modulus) for k in range(4)]
    free = [theta[1 + k] - D / 2 - preload for k in range(4)]
    centre = [
        (cut[1 + k] - cut[0] / 2) * mp.matrix([a * mp.sin(alpha), b * mp.cos(alpha)]) for k, (a, b) in enumerate(sides)
    ]
    orbit = mp.mpf(bearing.speed) / 2 * (1 - D * mp.cos(alpha) / d_m)
    F_c = mp.pi / 6 * D**3 * mp.mpf(bearing.density) * orbit**2 * d_m / 2
    load = [mp.mpf(0)] * 5
    for i in range(bearing.balls):
        phi = mp.mpf(bearing.first_ball) + 2 * mp.pi * i / bearing.balls
        s, c = mp.sin(phi), mp.cos(phi)
        moved = []
        for k in range(4):
            x, rho = centre[k]
            if k < 2:
                arm = d_m / 2 + rho
                x, rho = (
                    x + q[0] + arm * (q[3] * s - q[4] * c),
                    rho + q[1] * c + q[2] * s + x * (q[4] * c - q[3] * s),
                )
            moved.append((x, rho))

        def contacts(V, W, moved=moved):
            for k, (a, b) in enumerate(sides):
                x, rho = moved[k][0] - V, moved[k][1] - W
                delta = mp.sqrt(x * x + rho * rho) - free[k]
                beta = mp.atan2(a * x, b * rho)
                yield (K[k] * delta ** mp.mpf("1.5") if delta > 0 else mp.mpf(0)), beta

        def balance(V, W, contacts=contacts):
            (il, b_il), (ir, b_ir), (ol, b_ol), (o_r, b_or) = contacts(V, W)
            return (
                il * mp.sin(b_il) + ol * mp.sin(b_ol) - ir * mp.sin(b_ir) - o_r * mp.sin(b_or),
                il * mp.cos(b_il) + ir * mp.cos(b_ir) - ol * mp.cos(b_ol) - o_r * mp.cos(b_or) + F_c,
            )

        V, W = mp.findroot(balance, tuple(map(mp.mpf, starts[i].tolist())), tol=mp.mpf(10) ** (-50))
        for k, (Q, beta) in enumerate(list(contacts(V, W))[:2]):
            axial, radial = sides[k][0] * Q * mp.sin(beta), Q * mp.cos(beta)
            moment = (d_m / 2 + centre[k][1]) * axial - centre[k][0] * radial
            for n, part in enumerate((axial, radial * c, radial * s, moment * s, -moment * c)):
                load[n] += part
    return mp.matrix(load)


def differences(function, at, steps):
    columns = []
    for j, h in enumerate(steps):
        up, down = list(at), list(at)
        up[j] += h
        down[j] -= h
        columns.append((function(up) - function(down)) / (2 * h))
    return np.array([[float(column[n]) for column in columns] for n in range(5)])


def unequal(convention, **more):
    """Three balls, four different grooves, so that nothing cancels by symmetry."""
    D = 0.06
    return Bearing(
        3, 0.4, 0.8, D, 0.521 * D, 0.525 * D, 0.53 * D, 0.528 * D, groove_centres=convention, first_ball=0.3, **more
    )


STATES = {
    "preloaded, all contacts touch": ({"preload": 4e-5}, (8e-6, -6e-6, 4e-6, 2e-5, 3e-5)),
    "two-point contact": ({"preload": 0.0}, (6e-5, 1e-6, -2e-6, 3e-5, -2e-5)),
    "clearance, loaded on one side": ({"preload": -1e-5}, (-2e-6, 5e-5, 3e-5, 1e-5, 2e-5)),
    "fast, inner and outer contact angles apart": ({"preload": 1e-5, "speed": 400.0}, (1.2e-4, 3e-6, 1e-6, 1e-5, 1e-5)),
}


@pytest.mark.parametrize(("state", "convention"), [*zip(STATES, ("follow", "fixed", "follow", "fixed"), strict=True)])
def test_load_tangent_and_slopes_are_those_of_the_scalar_equations(state, convention):
    more, q = STATES[state]
    bearing = unequal(convention, **more)
    if convention == "fixed":
        # away from the cut, so that the two conventions do not share the state
        bearing = bearing.with_parameters(bearing.parameters + 1e-6 * np.array([3.0, 1.0, -1.0, 2.0, 0.5, 0.0]))
    q, theta = np.array(q), bearing.parameters
    load, starts = bearing_load(bearing, q), ball_loads(bearing, q).centre
    with mp.workdps(DIGITS):
        at_q, at_theta = [mp.mpf(value) for value in q], [mp.mpf(value) for value in theta]
        h = mp.mpf(10) ** -18
        force = exact_load(bearing, at_theta, at_q, starts)
        tangent = differences(lambda x: exact_load(bearing, at_theta, x, starts), at_q, [h] * 5)
        slopes = differences(lambda x: exact_load(bearing, x, at_q, starts), at_theta, [h] * 6)
    force = np.array([float(value) for value in force])
    scale = np.array([1, 1, 1, 0.2, 0.2])
    assert np.abs(force).max() > 1e3
    assert np.abs((load.force - force) / scale).max() <= 1e-10 * np.abs(force / scale).max()
    assert np.abs((load.tangent - tangent) / np.outer(scale, scale)).max() <= 1e-10 * np.abs(tangent[:3, :3]).max()
    for j in range(6):
        assert np.abs((load.slopes - slopes)[:, j] / scale).max() <= 1e-10 * np.abs(slopes[:, j] / scale).max()


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
