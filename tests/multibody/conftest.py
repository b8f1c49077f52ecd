"""Bodies made of particles: their inertia is a sum anyone can check."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strainsight.fem.affine import AffineOperator
from strainsight.multibody.bodies import FlexibleBody, Frame, RigidBody
from strainsight.multibody.forces import Gravity, Load, PointForce, PointMoment, RelativeElement
from strainsight.multibody.initial import Pose, project_position, project_velocity, state
from strainsight.multibody.joints import spherical
from strainsight.multibody.laws import LinearLaw, bushing, spring, torsion
from strainsight.multibody.relations import bearing_displacements
from strainsight.multibody.system import assemble
from strainsight.rom.inertia import InertiaInvariants


@dataclass(frozen=True)
class Particles:
    """Particles of mass m (P,) at x (P, 3) with shapes (P, 3, n)."""

    m: np.ndarray
    x: np.ndarray
    shapes: np.ndarray

    def places(self, q):
        """p = r + R(x + Φη) of every particle (P, 3); q may be complex."""
        R = q[3:12].reshape(3, 3).T
        return q[:3] + (self.x + self.shapes @ q[12:]) @ R.T

    def invariants(self):
        m, x, f = self.m, self.x, self.shapes
        coupled = np.einsum("p,pik,pjl->klij", m, f, f)
        mixed = np.einsum("p,pi,pjk->kij", m, x, f)
        return InertiaInvariants(
            mass=float(m.sum()),
            first=m @ x,
            first_modal=np.einsum("p,pik->ik", m, f),
            second=np.einsum("p,pi,pj->ij", m, x, x),
            second_modal=mixed + mixed.transpose(0, 2, 1),
            second_modal2=coupled,
            coupling=np.einsum("p,pj,pik->jik", m, x, f),
            coupling_modal=np.einsum("p,pjk,pil->kjil", m, f, f),
            modal=np.einsum("p,pik,pil->kl", m, f, f),
        )

    def inertia(self):
        return np.einsum(
            "p,pij->ij",
            self.m,
            np.einsum("pk,pk,ij->pij", self.x, self.x, np.eye(3)) - self.x[:, :, None] * self.x[:, None],
        )

    def rigid(self, name):
        return RigidBody(name, float(self.m.sum()), self.m @ self.x / self.m.sum(), self.inertia())

    def flexible(self, name, stiffness, damping=None, clamped=False):
        inv = self.invariants()
        return FlexibleBody(
            name, clamped, stiffness, inv.modal, np.zeros_like(inv.modal) if damping is None else damping, inv
        )


@dataclass(frozen=True)
class Drag:
    """F = θ (1 + |ρ|²) C w,  w_k = ρ̇_k |ρ̇_k|: nothing of it is linear, and C (k, k) is not symmetric."""

    C: np.ndarray

    def load(self, rho, rho_dot, theta):
        near = 1 + rho @ rho
        push = self.C @ (rho_dot * np.abs(rho_dot))
        by_rate = theta[0] * near * self.C * (2 * np.abs(rho_dot))
        return Load(theta[0] * near * push, theta[0] * np.outer(push, 2 * rho), by_rate, near * push[:, None])


@pytest.fixture
def particles():
    return Particles


@pytest.fixture
def random_particles():
    def make(rng, count=6, modes=3):
        return Particles(
            rng.uniform(0.5, 2.0, count), rng.normal(size=(count, 3)), 0.3 * rng.normal(size=(count, 3, modes))
        )

    return make


@pytest.fixture
def everything(random_particles):
    """A clamped and a free flexible body and a rigid one, every kind of joint relation and of force, off balance."""
    rng = np.random.default_rng(7)
    hub, arm, rock = random_particles(rng, modes=4), random_particles(rng), random_particles(rng)
    K = np.diag([300.0, 500.0, 900.0, 1500.0])
    bodies = [
        hub.flexible(
            "hub", AffineOperator(0.2 * K, {"E": 0.8 * K}), AffineOperator(0.02 * K, {"E": 0.01 * K}), clamped=True
        ),
        arm.flexible(
            "arm", AffineOperator(np.zeros((3, 3)), {"E": np.diag([200.0, 300.0, 400.0]) + 5.0}), 0.1 * np.eye(3)
        ),
        rock.rigid("rock"),
    ]

    def frame(name, body, modes):
        axes = Rotation.from_rotvec(0.3 * rng.normal(size=3)).as_matrix()
        shapes = [0.2 * rng.normal(size=(3, modes)) for _ in range(2)] if modes else [None, None]
        return Frame(name, body, 0.5 * rng.normal(size=3), axes, *shapes)

    outer, root, tip = frame("outer", "hub", 4), frame("root", "arm", 3), frame("tip", "arm", 3)
    low, high = frame("low", "rock", 0), frame("high", "rock", 0)
    stiff = np.diag([400.0, 500.0, 600.0, 300.0, 200.0]) + 20.0
    forces = [
        Gravity(np.array([0.3, -0.4, -9.81])),
        RelativeElement(
            "ring",
            bearing_displacements(outer, root),
            LinearLaw(0.5 * stiff, np.full(5, 0.01), (0.5 * stiff,), 0.02 * stiff),
            ("s",),
        ),
        spring("strut", Frame("wall", None, np.array([3.0, 1.0, 0.0])), high, 150.0, 4.0, 1.2),
        RelativeElement("drag", bearing_displacements(root, high)[:2], Drag(np.array([[2.0, 0.5], [-0.4, 1.0]])), ("d",)),
        torsion("twisted", outer, root, 20.0, 3.0, 0.4, "x"),
        bushing("mount", outer, low, [30.0, 40.0, 50.0, 6.0, 7.0, 8.0], [1.0, 2.0, 3.0, 0.4, 0.5, 0.6]),
        PointForce("push", tip, np.array([[1.0, 0.2], [0.0, 1.0], [0.3, 0.0]]), ["Fx", "Fy"]),
        PointForce("shake", frame("flange", "hub", 4), np.array([0.0, 0.5, 1.0]), ["Fh"]),
        PointMoment("twist", tip, np.eye(3), ["Mx", "My", "Mz"]),
        PointMoment("wind", outer, np.array([0.0, 1.0, 0.2]), ["Mh"]),
    ]
    system = assemble(bodies, [spherical("elbow", tip, low)], forces)
    poses = {
        name: Pose(rng.normal(size=3) * 0.3, Rotation.from_rotvec(0.4 * rng.normal(size=3)).as_matrix())
        for name in ("arm", "rock")
    }
    q, _ = state(system, poses)
    q = project_position(system, q + 0.02 * rng.normal(size=system.size))
    v = project_velocity(system, q, rng.normal(size=system.size))
    return SimpleNamespace(system=system, q=q, v=v, u=rng.normal(size=7) * 5, theta=np.array([1.1, 0.9, 0.7]), rng=rng)
