"""A bench small enough for tests: an elastic hub on the ground, a pitch bearing, a rigid blade, three loads far out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from strainsight.fem.affine import AffineOperator
from strainsight.multibody.bearing.element import BearingLaw
from strainsight.multibody.bearing.geometry import PARAMETERS, Bearing
from strainsight.multibody.bodies import FlexibleBody, Frame, RigidBody
from strainsight.multibody.forces import Gravity, PointForce, RelativeElement
from strainsight.multibody.initial import Pose, project_position, state, static_equilibrium
from strainsight.multibody.inverse.loads import walks
from strainsight.multibody.inverse.model import AugmentedStep
from strainsight.multibody.inverse.parameters import parameter_coordinates, start_covariance, white_force
from strainsight.multibody.joints import Joint
from strainsight.multibody.laws import bushing
from strainsight.multibody.relations import bearing_displacements, dot
from strainsight.multibody.sensors import CompiledSensors, RelationSensor, StrainSensor, readings
from strainsight.multibody.simulate import simulate
from strainsight.multibody.system import System, assemble
from strainsight.rom.inertia import InertiaInvariants

FLANGE = np.array([1.4, 0.0, 0.0])
MODULUS = 1.7e11


@dataclass(frozen=True)
class Bench:
    """system and sensors (4 gauges, then 5 displacements of the bearing), equilibrium q under no load, θ."""

    system: System
    sensors: CompiledSensors
    bearing: Bearing
    q: np.ndarray
    theta: np.ndarray

    def truth(self, u, h, theta=None, method="second_order"):
        """States and readings (T, m) of a run from the equilibrium, no load, to u (T, nu) at h, 2h, …"""
        theta = self.theta if theta is None else theta
        q, _ = static_equilibrium(self.system, self.q, np.zeros(u.shape[1]), theta)
        run = simulate(self.system, q, np.zeros_like(q), from_none(u), h, theta, method)
        return run, np.array([self.sensors.read(q, v)[0] for q, v in zip(run.q[1:], run.v[1:], strict=True)])

    def model(self, h, steps, known=None, free=(), noise=(1e-9, 1e-9), load=0.0, **more):
        """The step as the filter wants it, and where it starts: all three loads unknown (increment `load` [N] a step) unless
        they are known (T, 3) at h, 2h, …; free parameters of the bearing; noise of strain and displacement."""
        inputs = np.arange(3) if known is None else np.array([], dtype=int)
        coordinates = parameter_coordinates(
            self.system.parameters, free, more.pop("theta", self.theta), {"b": self.bearing.parameters}
        )
        R = np.concatenate([np.full(4, noise[0] ** 2), np.full(5, noise[1] ** 2)])
        return AugmentedStep(
            self.system,
            self.sensors,
            more.pop("offset", np.zeros(9)),
            more.pop("method", "second_order"),
            from_none(np.zeros((steps, 3)) if known is None else known),
            inputs,
            more.pop("loads", None) or walks(np.broadcast_to(load, len(inputs)), h),
            coordinates,
            more.pop("Q_w", white_force(self.system, more.pop("white", 1e-8))),
            np.zeros(len(free)),
            R,
            rest=more.pop("rest", True),
            corrected=more.pop("corrected", False),
        )

    def start(self, model, std_u=0.0, std_xi=0.0, spread=0.0, theta=None):
        """x (size,) in equilibrium without loads under θ, and its covariance."""
        theta = self.theta if theta is None else theta
        nu, p = len(model.inputs), model.coordinates.size
        q, _ = static_equilibrium(self.system, self.q, np.zeros(3), theta)
        P = start_covariance(
            self.system,
            q,
            np.zeros(3),
            theta,
            model.coordinates,
            model.inputs,
            np.full(nu, std_u),
            np.full(p, std_xi),
            spread,
        )
        return model.pack(q, np.zeros_like(q), np.zeros(nu), theta), model.spread(P)


def from_none(u):
    """Loads u (T, nu) at h, 2h, … after none at the start (T + 1, nu)."""
    return np.concatenate([0 * u[:1], u])


def inertia_of(modal, mass):
    """Of a body on the ground whose weight does no work: modal (n, n), mass [kg]."""
    n = len(modal)
    return InertiaInvariants(
        mass=mass, first=np.zeros(3), first_modal=np.zeros((3, n)), second=mass * np.eye(3), second_modal=np.zeros((n, 3, 3)),
        second_modal2=np.zeros((n, n, 3, 3)), coupling=np.zeros((3, 3, n)), coupling_modal=np.zeros((n, 3, 3, n)), modal=modal,
    )  # fmt: skip


def bench(free=(), convention="follow", balls=30, preload=1e-5, modulus=False, damped=False) -> Bench:
    """free: names of bearing parameters that are parameters of the system; modulus: whether the hub's modulus is one, "E";
    damped: whether the bearing stands in a damper."""
    rng = np.random.default_rng(5)
    n = 9
    mass = np.diag([3e3, 3e3, 3e3, 2e3, 2e3, 2e3, 1.0, 1.0, 1.0])
    K = np.diag([2e9, 1.5e9, 1.2e9, 3e9, 2e9, 1.6e9, *(2 * np.pi * np.array([55.0, 70.0, 90.0])) ** 2])
    C = 2e-5 * K
    stiffness = AffineOperator(np.zeros((n, n)), {"E": K / MODULUS}) if modulus else K
    hub = FlexibleBody("hub", True, stiffness, mass, C, inertia_of(mass, 9e3))
    blade = RigidBody(
        "blade", 1.4e4, np.array([17.0, 0, 0]), np.diag([1.5e4, 2.8e6 + 1.4e4 * 17**2, 2.8e6 + 1.4e4 * 17**2])
    )
    shape, turn = np.zeros((3, n)), np.zeros((3, n))
    shape[:, :3], turn[:, 3:6] = np.eye(3), np.eye(3)
    flange = Frame("flange", "hub", FLANGE, displacement=shape, rotation=turn)
    root = Frame("root", "blade")
    station = Frame("station", "blade", np.array([15.0, 0, 0]))
    r = 0.0318
    ring = Bearing(balls, 2.3, np.pi / 4, 0.06, r, r, r, r, preload, convention)
    relations = bearing_displacements(flange, root)
    element = RelativeElement("b", relations, BearingLaw(ring, free), tuple(f"b.{name}" for name in free))
    dampers = [bushing("dampers", flange, root, [0.0] * 6, [2e6, 3e6, 4e6, 0.0, 2e6, 3e6])] if damped else []
    pull = PointForce("pull", station, np.eye(3), ["Fx", "Fy", "Fz"])
    system = assemble([hub, blade], [Joint("pitch", (dot(flange, 1, root, 2),))], [Gravity(), element, *dampers, pull])
    rows = np.concatenate([0.05 * rng.normal(size=(4, 6)), 1e-4 * rng.normal(size=(4, 3))], axis=1)
    sensors = readings(system, [StrainSensor("gauges", "hub", rows), RelationSensor("relative", relations)])
    values = {f"b.{name}": value for name, value in zip(PARAMETERS, ring.parameters, strict=True)} | {"E": MODULUS}
    theta = np.array([values[name] for name in system.parameters])
    q = project_position(system, state(system, {"blade": Pose(FLANGE)})[0])
    q, _ = static_equilibrium(system, q, np.zeros(3), theta)
    return Bench(system, sensors, ring, q, theta)


def springs(seed=8):
    """M, C, K of three masses, how a force of three components and two sensors see them."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(3, 3))
    M, K = np.diag([2.0, 1.0, 0.5]), 4e3 * (X @ X.T + np.eye(3))
    return M, 1e-3 * K, K, rng.normal(size=(3, 3)), rng.normal(size=(2, 3))


def spring_step(matrices, known, moving, Q_w, R, method="second_order", corrected=False):
    """The step of `springs` under a force whose second component is unknown; known (T + 1, 3)."""
    M, C, K, shape, rows = matrices
    body = FlexibleBody("body", True, K, M, C, inertia_of(M, 3.0))
    force = PointForce("F", Frame("end", "body", displacement=shape, rotation=0 * shape), np.eye(3), ["x", "y", "z"])
    system = assemble([body], [], [force])
    return AugmentedStep(
        system, readings(system, [StrainSensor("s", "body", rows)]), np.zeros(2), method, known, np.array([1]), moving,
        parameter_coordinates([], [], np.zeros(0), {}), Q_w, np.zeros(0), R, corrected=corrected,
    )  # fmt: skip


def loads(h, steps, frequency=0.5):
    t = h * np.arange(1, steps + 1)
    turn = 2 * np.pi * frequency * t
    return np.stack(
        [4e4 * np.sin(turn), 2e4 * np.sin(1.3 * turn + 0.5) - 1e4, 1.5e4 * (1 - np.cos(0.8 * turn))], axis=1
    )
