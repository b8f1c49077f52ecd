"""Andrews' squeezing mechanism: seven bodies, published at 0.03 s (test set for initial value problem solvers)."""

import numpy as np

from strainsight.multibody.forces import PointMoment
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.joints import pin, revolute
from strainsight.multibody.laws.spring import spring
from strainsight.multibody.simulate import simulate
from strainsight.multibody.system import assemble

from .mechanisms import at, extrapolated, planar, turned

MASS = np.array([0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498])
INERTIA = np.array([2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5])
START = np.array([
    -0.0617138900142764496358948458001, 0.0, 0.455279819163070380255912382449, 0.222668390165885884674473185609,
    0.487364979543842550225598953530, -0.222668390165885884674473185609, 1.23054744454982119249735015568,
])  # fmt: skip
"""β, Θ, γ, Φ, δ, Ω, ε [rad] at rest."""
END = np.array([
    15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948,
    0.5244099658805304, 0.5347301163226948, 1.048080741042263,
])  # fmt: skip
"""The same after 0.03 s."""
A, B, C = np.array([-0.06934, -0.00227]), np.array([-0.03635, 0.03273]), np.array([0.014, 0.072])


def squeezer():
    """Andrews' squeezer: K1 turns on O and drives K2; K2 meets K3 (on B), K4 (on K5 on A) and K6 (on K7 on A) in F.

    The data and angles are those of the IVP test set: K1 β, K2 β + Θ, K3 γ, K4 Φ + δ, K5 δ, K6 Ω + ε, K7 ε.
    """
    beta, theta, gamma, phi, delta, omega, epsilon = START
    d, e, rr, ss, sc, sd, u, zf, zt = 0.028, 0.02, 0.007, 0.035, 0.018, 0.02, 0.04, 0.02, 0.04
    centres = [
        [0.00092, 0],
        [-0.0115, 0],
        [0.01043, -0.01874],
        [0, 0.01421 - e],
        [0.00916, 0.02308],
        [zf - 0.01421, 0],
        [0.01228, 0.00449],
    ]
    bodies = [planar(f"K{k + 1}", MASS[k], centres[k], INERTIA[k]) for k in range(7)]
    angles = [beta, beta + theta, gamma, phi + delta, delta, omega + epsilon, epsilon]
    R = [turned(angle) for angle in angles]
    G, H = A + zt * R[4][:2, 0], A - u * R[6][:2, 1]
    origins = [np.zeros(2), rr * R[0][:2, 0], B, G, A, H, A]
    meeting = at("F2", "K2", -d)
    joints = [
        revolute("O", at("O0", None), at("O1", "K1")),
        revolute("E", at("E1", "K1", rr), at("E2", "K2")),
        revolute("B", at("B0", None, *B), at("B3", "K3")),
        revolute("A5", at("A0", None, *A), at("A5", "K5")),
        revolute("G", at("G5", "K5", zt), at("G4", "K4")),
        revolute("A7", at("A0", None, *A), at("A7", "K7")),
        revolute("H", at("H7", "K7", 0, -u), at("H6", "K6")),
        pin("F3", meeting, at("F3", "K3", 0, -ss)),
        pin("F4", meeting, at("F4", "K4", 0, -e)),
        pin("F6", meeting, at("F6", "K6", zf)),
    ]
    drive = PointMoment("drive", at("shaft", "K1"), np.array([0.0, 0.0, 1.0]), ["torque"])
    pull = spring("spring", at("D", "K3", sd, -sc), at("C", None, *C), 4530.0, length=0.07785)
    system = assemble(bodies, joints, [drive, pull])
    poses = {
        body.name: Pose(np.array([*origin, 0.0]), turn) for body, origin, turn in zip(bodies, origins, R, strict=True)
    }
    return system, *state(system, poses)


def first_axes(system, q):
    """cos and sin of every body's angle (7, 2)."""
    return np.array([q[own.start + 3 : own.start + 5] for own in system.of.values()])


def cosines_and_sines(angles):
    beta, theta, gamma, phi, delta, omega, epsilon = angles
    turned = np.array([beta, beta + theta, gamma, phi + delta, delta, omega + epsilon, epsilon])
    return np.stack([np.cos(turned), np.sin(turned)], axis=1)


def ends_of(time, numbers):
    system, q, v = squeezer()
    runs = [simulate(system, q, v, np.full((n + 1, 1), 0.033), time / n, np.zeros(0)) for n in numbers]
    return [first_axes(system, run.q[-1]) for run in runs]


def test_squeezer_reaches_its_published_end_at_second_order():
    ends, exact = ends_of(0.03, (250, 500, 1000)), cosines_and_sines(END)
    errors = [np.linalg.norm(end - exact) for end in ends]
    np.testing.assert_allclose(np.log2([errors[0] / errors[1], errors[1] / errors[2]]), 2, atol=0.05)
    np.testing.assert_allclose(extrapolated(ends, 2), exact, rtol=0, atol=2e-5)
