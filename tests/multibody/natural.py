"""The step in natural coordinates with all its constraints, dense: what the compiled step is held against."""

import numpy as np

from strainsight.multibody.equations import balance


def jacobian(system, at, h):
    """The derivative of the four equations of `step` in (q, v, μ, λ), the metric in place of the mass in the first."""
    n, m, D = system.size, system.constrained, np.diag(system.metric**2)
    none, empty = np.zeros((n, m)), np.zeros((m, m))
    return np.block(
        [
            [D / h + at.constraint_stiffness, -D, at.B.T, none],
            [at.stiffness, at.mass / h + at.damping, none, -at.B.T],
            [at.B_rate, at.B, empty, empty],
            [at.B, none.T, empty, empty],
        ]
    )


def natural_step(system, q, v, u, h, theta, w=0.0, iterations=12):
    """q', v', μ, λ by plain Newton from q + hv, v, and the balance there."""
    n, m, d2 = system.size, system.constrained, system.metric**2
    z = np.concatenate([q + h * v, v, np.zeros(2 * m)])
    scale = np.concatenate([1 / system.metric, 1 / (h * system.metric), np.full(2 * m, 1.0)])
    for _ in range(iterations):
        new, speed, mu, lam = np.split(z, [n, 2 * n, 2 * n + m])
        at = balance(system, new, speed, (speed - v) / h, mu, lam, u, theta, system.at(theta))
        r1 = d2 * ((new - q) / h - speed) + at.B.T @ mu
        r3 = at.B @ speed + (0.0 if at.driven is None else at.driven.rate)
        r = np.concatenate([r1, at.load - at.B.T @ lam - w, r3, at.phi])
        z = z - scale * np.linalg.solve(jacobian(system, at, h) * scale, r)
    new, speed, mu, lam = np.split(z, [n, 2 * n, 2 * n + m])
    return new, speed, mu, lam, balance(system, new, speed, (speed - v) / h, mu, lam, u, theta, system.at(theta))


def natural_slopes(system, q, v, u, h, theta, w=0.0):
    """∂(q', v')/∂(q, v) (2n, 2n) and by w (2n, n) of `natural_step`."""
    n, m = system.size, system.constrained
    *_, at = natural_step(system, q, v, u, h, theta, w)
    right = np.zeros((2 * n + 2 * m, 3 * n))
    right[:n, :n] = np.diag(system.metric**2) / h
    right[n : 2 * n, n : 2 * n], right[n : 2 * n, 2 * n :] = at.mass / h, np.eye(n)
    found = np.linalg.solve(jacobian(system, at, h), right)[: 2 * n]
    return found[:, : 2 * n], found[:, 2 * n :]
