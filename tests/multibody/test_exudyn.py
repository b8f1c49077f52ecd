"""The same bodies and joints in Exudyn, which has Euler parameters, another mass matrix and an integrator of second order.

Exudyn's flexible body is the nodal floating frame of reference formulation with modal reduction: Zwölfer and Gerstmayr,
Acta Mechanica 232 (2021). With lumped masses its integrals are sums over nodes, as those of particles are here.
"""

from __future__ import annotations

import platform
import sys
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse import csr_matrix
from scipy.spatial.transform import Rotation

from strainsight.multibody.bodies import Frame, RigidBody
from strainsight.multibody.forces import Gravity
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.joints import spherical
from strainsight.multibody.simulate import simulate
from strainsight.multibody.system import assemble

from .mechanisms import extrapolated

if sys.platform == "win32" and platform.machine() == "ARM64":
    pytest.skip("Exudyn has no wheel for Windows on ARM", allow_module_level=True)

import exudyn as exu
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
from exudyn.itemInterface import (
    Force,
    MarkerBodyPosition,
    MarkerSuperElementPosition,
    ObjectGround,
    ObjectJointSpherical,
    SensorNode,
)
from exudyn.rigidBodyUtilities import RigidBodyInertia

GRAVITY = np.array([1.0, -9.0, -3.0])
POSE = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
DAMPING = 5e-3
"""[s] of the stiffness."""
STEPS = (100, 200, 400)
REFERENCE = (2000, 4000)
"""Steps here and of the trapezoidal rule there."""
INSTANTS = 10
"""At which the trajectories are compared."""


@dataclass(frozen=True)
class Mast:
    """A lattice mast along x, its first section held by the floating frame, reduced to its lowest modes.

    masses m (P,) [kg] at x (P, 3) [m], full stiffness K (3P, 3P) [N/m], basis Φ (3P, n), ΦᵀMΦ = 1.
    """

    m: np.ndarray
    x: np.ndarray
    K: np.ndarray
    basis: np.ndarray

    @property
    def shapes(self):
        return self.basis.reshape(len(self.m), 3, -1)

    @property
    def reduced(self):
        return self.basis.T @ self.K @ self.basis

    @property
    def end(self):
        return range(len(self.m) - 3, len(self.m))


@pytest.fixture(scope="module")
def mast():
    """Five triangles of unequal masses with longerons and diagonals; 1.3, 1.3, 1.9 and 6.1 Hz."""
    angle = 2 * np.pi * np.arange(3) / 3
    x = np.array([[s, 0.12 * np.cos(a), 0.12 * np.sin(a)] for s in np.linspace(0, 1, 5) for a in angle])
    m = 0.1 + 0.02 * np.arange(len(x))
    bars = [(3 * s + a, 3 * s + (a + 1) % 3) for s in range(5) for a in range(3)]
    bars += [(3 * s + a, 3 * s + 3 + (a + turn) % 3) for s in range(4) for a in range(3) for turn in (0, 2)]
    K = np.zeros((3 * len(x), 3 * len(x)))
    for i, j in bars:
        length = np.linalg.norm(x[j] - x[i])
        row = np.zeros((len(x), 3))
        row[j] = (x[j] - x[i]) / length
        row[i] = -row[j]
        K += 2e3 / length * np.outer(row, row)
    basis = np.zeros((len(K), 4))
    basis[9:] = eigh(K[9:, 9:], np.diag(np.repeat(m[3:], 3)), subset_by_index=(0, 3))[1]
    return Mast(m, x, K, basis)


def started(pivot, spin):
    """A body that spins (3,) [rad/s] about a point of it, pivot (3,) [m] in body axes, which is at the origin of space."""
    return Pose(-POSE @ pivot, POSE, -np.cross(spin, POSE @ pivot), spin)


def run_ours(body, joint, pose, duration, *forces):
    """Trajectories (instants, coordinates) with every number of steps."""
    system = assemble([body], [joint], [Gravity(GRAVITY), *forces])
    q, v = state(system, {body.name: pose})
    found = [
        simulate(system, q, v, np.zeros((steps + 1, 0)), duration / steps, np.zeros(0)).q[:: steps // INSTANTS]
        for steps in STEPS
    ]
    return np.array(found)


def run_theirs(build, duration):
    """Positions, rotations and modal coordinates as ours, extrapolated from two runs of second order, and their difference."""
    found = []
    for steps in REFERENCE:
        mbs = exu.SystemContainer().AddSystem()
        rigid, modal = build(mbs)
        kinds = [(rigid, exu.OutputVariableType.Position), (rigid, exu.OutputVariableType.RotationMatrix)]
        kinds += [(modal, exu.OutputVariableType.Coordinates)] if modal is not None else []
        sensors = [mbs.AddSensor(SensorNode(nodeNumber=n, storeInternal=True, outputVariableType=k)) for n, k in kinds]
        mbs.Assemble()
        settings = exu.SimulationSettings()
        settings.solution.file.write = False
        settings.solution.sensors.writePeriod = duration / INSTANTS
        settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = duration, steps
        settings.timeIntegration.newton.relativeTolerance = 1e-10
        settings.timeIntegration.newton.absoluteTolerance = 1e-12
        mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.TrapezoidalIndex2)
        r, R, *eta = (np.asarray(mbs.GetSensorStoredData(s))[:, 1:] for s in sensors)
        found.append(np.hstack([r, R.reshape(-1, 3, 3).swapaxes(1, 2).reshape(-1, 9), *eta]))
    return (4 * found[1] - found[0]) / 3, found[1] - found[0]


def differences(ours, theirs):
    """Largest ones of r, R and η, each beside its largest value."""
    parts = [part for part in (slice(0, 3), slice(3, 12), slice(12, None)) if theirs[:, part].size]
    return np.array([np.abs(ours[:, p] - theirs[:, p]).max() / np.abs(theirs[:, p]).max() for p in parts])


def agree(ours, theirs, uncertain):
    """Of second order in the step, and the same to 1e-6 once the second and the third order are taken out."""
    assert np.all(differences(theirs + uncertain, theirs) < 1e-5)
    coarse, fine = differences(ours[1], theirs), differences(ours[2], theirs)
    moves = fine > 1e-12
    np.testing.assert_allclose(np.log2(coarse[moves] / fine[moves]), 2, atol=0.1)
    assert np.all(differences(extrapolated(ours, 2), theirs) < 1e-6)


def test_heavy_top():
    centre, pivot = np.array([0.3, -0.1, 0.2]), np.array([-0.2, 0.1, 0.05])
    inertia = np.diag([0.2, 0.3, 0.4]) + 3.0 * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    pose = started(pivot, np.array([3.0, 5.0, 2.0]))
    joint = spherical("pivot", Frame("wall"), Frame("eye", "top", pivot))

    def build(mbs):
        body = mbs.CreateRigidBody(
            referencePosition=pose.position,
            referenceRotationMatrix=POSE,
            initialVelocity=pose.velocity,
            initialAngularVelocity=pose.spin,
            inertia=RigidBodyInertia(3.0, inertia, centre),
            gravity=GRAVITY,
            returnDict=True,
        )
        wall = mbs.AddMarker(MarkerBodyPosition(bodyNumber=mbs.AddObject(ObjectGround())))
        eye = mbs.AddMarker(MarkerBodyPosition(bodyNumber=body["bodyNumber"], localPosition=pivot))
        mbs.AddObject(ObjectJointSpherical(markerNumbers=[wall, eye]))
        return body["nodeNumber"], None

    agree(run_ours(RigidBody("top", 3.0, centre, inertia), joint, pose, 0.5), *run_theirs(build, 0.5))


def flexible(mbs, mast, pose):
    """The mast in Exudyn, its weight on its nodes: the load on the whole body sees the undeformed one."""
    fem = FEMinterface()
    fem.nodes = {"Position": mast.x}
    fem.massMatrix, fem.stiffnessMatrix = csr_matrix(np.diag(np.repeat(mast.m, 3))), csr_matrix(mast.K)
    fem.modeBasis = {"matrix": mast.basis, "type": "NormalModes"}
    body = ObjectFFRFreducedOrderInterface(fem, roundMassMatrix=0, roundStiffnessMatrix=0).AddObjectFFRFreducedOrder(
        mbs, pose.position, pose.velocity, POSE, pose.spin, stiffnessProportionalDamping=DAMPING
    )
    for node, mass in enumerate(mast.m):
        mbs.AddLoad(Force(markerNumber=on_nodes(mbs, body, [node]), loadVector=mass * GRAVITY))
    return body


def on_nodes(mbs, body, nodes):
    """The mean place of nodes as Exudyn's marker."""
    share = [1 / len(nodes)] * len(nodes)
    number = body["oFFRFreducedOrder"]
    return mbs.AddMarker(
        MarkerSuperElementPosition(bodyNumber=number, meshNodeNumbers=list(nodes), weightingFactors=share)
    )


def as_particles(mast, particles):
    return particles(mast.m, mast.x, mast.shapes).flexible("mast", mast.reduced, DAMPING * mast.reduced)


def test_flexible_rotor_that_hangs_by_its_far_end(mast, particles):
    pivot, shapes = mast.x[mast.end].mean(0), mast.shapes[mast.end].mean(0)
    pose = started(pivot, np.array([3.0, 2.0, 5.0]))
    joint = spherical("eye", Frame("wall"), Frame("end", "mast", pivot, np.eye(3), shapes, np.zeros_like(shapes)))

    def build(mbs):
        body = flexible(mbs, mast, pose)
        wall = mbs.AddMarker(MarkerBodyPosition(bodyNumber=mbs.AddObject(ObjectGround())))
        end = on_nodes(mbs, body, mast.end)
        mbs.AddObject(ObjectJointSpherical(markerNumbers=[wall, end]))
        return body["nRigidBody"], body["nGenericODE2"]

    agree(run_ours(as_particles(mast, particles), joint, pose, 0.5), *run_theirs(build, 0.5))
