"""The compiled step in minimal coordinates is the step in natural ones; compiled laws are their Python."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from strainsight.multibody.accelerations import balance
from strainsight.multibody.bearing.element import BearingLaw
from strainsight.multibody.bearing.geometry import Bearing
from strainsight.multibody.bodies import Frame, RigidBody
from strainsight.multibody.compiled import arrays, blocks, equations, matrix, newton, stages
from strainsight.multibody.compiled.arrays import compile_system
from strainsight.multibody.forces import CompiledLaw, Gravity, RelativeElement
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.joints import coincidence, revolute
from strainsight.multibody.laws import LAWS, LinearLaw
from strainsight.multibody.relations import bearing_displacements
from strainsight.multibody.step import _joined, slopes, step
from strainsight.multibody.system import assemble

from .mechanisms import turned
from .test_laws import KEYS

SMALL = Bearing(24, 0.4, np.pi / 4, 0.02, 0.0106, 0.0105, 0.0107, 0.0106, 1e-5)


@pytest.mark.parametrize("h", [1e-3, 0.05])
def test_the_step_is_that_of_natural_coordinates_to_rounding(everything, h):
    e = everything
    w = np.random.default_rng(3).normal(size=e.system.size)
    new = step(e.system, e.q, e.v, e.u, h, e.theta, w=w)
    q, v, mu, lam, _ = natural_step(e.system, e.q, e.v, e.u, h, e.theta, w)
    np.testing.assert_allclose(new.q, q, rtol=0, atol=1e-13 * np.abs(q).max())
    np.testing.assert_allclose(new.v, v, rtol=0, atol=1e-12 * np.abs(v).max())
    joints = slice(e.system.rigid, None)
    np.testing.assert_allclose(new.mu[joints], mu[joints], rtol=0, atol=1e-9 * np.abs(mu).max())
    np.testing.assert_allclose(new.lam[joints], lam[joints], rtol=0, atol=1e-10 * np.abs(lam).max())
    found, (A, B_w) = slopes(e.system, _joined([new])), natural_slopes(e.system, e.q, e.v, e.u, h, e.theta, w)
    n = e.system.size
    for exact, own in ((A, found.A), (B_w, found.B_w)):
        for half in (slice(0, n), slice(n, None)):
            np.testing.assert_allclose(own[half], exact[half], rtol=0, atol=1e-10 * np.abs(exact[half]).max())


def chain(count, closed=False):
    """Links on revolute joints, zigzag from a wall, in any order; closed: the end of the last one is held, too."""
    rng = np.random.default_rng(4)
    bodies = [
        RigidBody(f"link {k}", 1.0 + 0.1 * k, np.array([0.5, 0.1, 0.0]), np.diag([0.1, 0.5, 0.6])) for k in range(count)
    ]
    poses, at = {}, np.zeros(3)
    for k in range(count):
        poses[f"link {k}"] = Pose(at, turned(0.5 * (-1) ** k))
        at = at + turned(0.5 * (-1) ** k)[:, 0]
    joints = [
        revolute(
            f"hinge {k}",
            Frame(f"tip {k}", f"link {k - 1}", np.array([1.0, 0, 0])) if k else Frame("wall"),
            Frame(f"root {k}", f"link {k}"),
        )
        for k in range(count)
    ]
    if closed:
        end = Frame("end", f"link {count - 1}", np.array([1.0, 0, 0]))
        joints.append(coincidence("far", Frame("other wall", None, at), end, "xy"))
    rng.shuffle(bodies)
    rng.shuffle(joints)
    system = assemble(bodies, joints, [Gravity(np.array([1.0, -9.0, 0.0]))])
    return system, *state(system, poses)


@pytest.mark.parametrize("closed", [False, True])
def test_a_chain_in_any_order_is_eliminated_along_itself(closed):
    system, q, v = chain(7, closed)
    new = step(system, q, v, np.zeros(0), 0.01, np.zeros(0))
    dense = natural_step(system, q, v, np.zeros(0), 0.01, np.zeros(0))
    np.testing.assert_allclose(new.q, dense[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(new.v, dense[1], rtol=0, atol=1e-11)
    low = compile_system(system).pattern.low
    assert np.all(low - np.arange(len(low)) < 3 * (6 + 10))


def in_python(law):
    return SimpleNamespace(load=law.load)


LINEAR = LinearLaw(np.diag([3.0, 4.0]) + 1.0, np.array([0.1, 0.2]), (np.eye(2),), np.ones((2, 2)))


@pytest.mark.parametrize("kind", ["spring", "torsion", "bushing", "linear", "bearing"])
def test_a_compiled_law_steps_as_one_that_is_called_back(kind):
    wall, held = Frame("wall", None, np.array([0.3, 0.2, -0.1])), Frame("held", "stone", np.array([0.1, 0.0, 0.05]))
    theta, parameters = np.zeros(0), ()
    if kind == "bearing":
        theta, parameters = np.array([0.02, 1e-5]), ("D", "p")
        law, relations = BearingLaw(SMALL, ("ball_diameter", "preload")), bearing_displacements(wall, held)
    elif kind == "linear":
        theta, parameters, law, relations = np.array([2.0]), ("k",), LINEAR, bearing_displacements(wall, held)[:2]
    else:
        made = LAWS[kind]("law", wall, held, **KEYS[kind])
        law, relations = made.law, made.relations
    assert isinstance(law, CompiledLaw)
    stone = RigidBody("stone", 2.0, np.zeros(3), np.eye(3))
    found = []
    for own in (law, in_python(law)):
        system = assemble([stone], [], [RelativeElement("law", relations, own, parameters), Gravity()])
        place = np.array([0.2, 0.2, -0.15]) + (5e-6 if kind == "bearing" else 0.2)
        q, v = state(
            system, {"stone": Pose(place, velocity=np.array([1e-3, 2e-3, 0]), spin=np.array([0.01, 0.0, 0.02]))}
        )
        new = step(system, q, v, np.zeros(0), 1e-4, theta)
        again = step(system, new.q, new.v, np.zeros(0), 1e-4, theta, guess=new)
        s = slopes(system, _joined([again]))
        found.append((again.q, again.v, s.A, s.B_theta))
    for fast, plain in zip(*found, strict=True):
        np.testing.assert_allclose(fast, plain, rtol=0, atol=1e-9 * max(np.abs(plain).max(initial=0.0), 1e-300))


@pytest.mark.parametrize("entry", [stages.solve_stages, stages.step_slopes])
def test_compiled_code_notices_a_change_of_all_that_it_is_made_of(entry):
    """Also of the arrays that it takes: numba knows a tuple by its name and the types in it, and with two of its fields
    exchanged, code that was kept would read one for the other."""
    stamp = entry._cache._cache_file._source_stamp
    solver = [newton] if entry is stages.solve_stages else []
    for module in (arrays, blocks, equations, matrix, *solver):
        file = Path(module.__file__).stat()
        assert (file.st_mtime, file.st_size) in stamp, module.__name__


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
        at = balance(system, new, speed, u, theta, a=(speed - v) / h, lam=lam, mu=mu)
        r1 = d2 * ((new - q) / h - speed) + at.B.T @ mu
        r3 = at.B @ speed + (0.0 if at.driven is None else at.driven.rate)
        r = np.concatenate([r1, at.load - at.B.T @ lam - w, r3, at.phi])
        z = z - scale * np.linalg.solve(jacobian(system, at, h) * scale, r)
    new, speed, mu, lam = np.split(z, [n, 2 * n, 2 * n + m])
    return new, speed, mu, lam, balance(system, new, speed, u, theta, a=(speed - v) / h, lam=lam, mu=mu)


def natural_slopes(system, q, v, u, h, theta, w=0.0):
    """∂(q', v')/∂(q, v) (2n, 2n) and by w (2n, n) of `natural_step`."""
    n, m = system.size, system.constrained
    *_, at = natural_step(system, q, v, u, h, theta, w)
    right = np.zeros((2 * n + 2 * m, 3 * n))
    right[:n, :n] = np.diag(system.metric**2) / h
    right[n : 2 * n, n : 2 * n], right[n : 2 * n, 2 * n :] = at.mass / h, np.eye(n)
    found = np.linalg.solve(jacobian(system, at, h), right)[: 2 * n]
    return found[:, : 2 * n], found[:, 2 * n :]
