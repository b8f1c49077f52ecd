"""The beam and the arm of test_bench_records.py in Exudyn: its bodies, joints, spring, loads and trapezoidal steps.

Only the modes of the beam, its reduced matrices and the rows of its gauges are ours.
"""

from __future__ import annotations

import exudyn as exu
import numpy as np
from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface
from exudyn.itemInterface import (
    Force,
    GenericJoint,
    MarkerBodyPosition,
    MarkerBodyRigid,
    MarkerNodeRigid,
    MarkerSuperElementPosition,
    MarkerSuperElementRigid,
    ObjectGround,
    ObjectJointRevoluteZ,
    SensorBody,
    SensorNode,
    TorsionalSpringDamper,
)
from exudyn.rigidBodyUtilities import RigidBodyInertia
from scipy.sparse import csr_matrix

from ..robustness.small import COUNTS, SIZE

GRAVITY = np.array([0.0, 0.0, -9.80665])
DENSITY = 7850.0
STEP = 2e-4
"""[s]; half of it changes the strains by 0.02 µm/m, a fifth of their noise."""


def motion(body, position, loads, time):
    """Modal coordinates (k, n) of the beam and place (k, 3) [m] of the arm's end at time (k,), from rest under weight.

    body: the reduced beam; position (N, 3) [m] of its nodes; loads(t) (2,) [N] at the end of the arm along y and z.
    """
    mbs, moves = exu.SystemContainer().AddSystem(), []
    beam = _beam(mbs, body, position)
    axis_y = np.eye(4)
    axis_y[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    end = [int(node) for node in np.flatnonzero(np.isclose(position[:, 0], SIZE[0])) if node < len(position) - 1]
    marker = MarkerSuperElementRigid(
        bodyNumber=beam["oFFRFreducedOrder"],
        localHT=axis_y,
        meshNodeNumbers=end,
        weightingFactors=[1 / len(end)] * len(end),
    )
    centre = np.array([0.4, 0.0, 0.0])
    about_origin = np.diag([0.5, 5.0, 5.0]) + 20.0 * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    arm = mbs.CreateRigidBody(
        referencePosition=[SIZE[0], SIZE[1] / 2, SIZE[2] / 2],
        inertia=RigidBodyInertia(20.0, about_origin, centre),
        gravity=GRAVITY,
        returnDict=True,
    )["bodyNumber"]
    hinge = [mbs.AddMarker(marker), mbs.AddMarker(MarkerBodyRigid(bodyNumber=arm, localHT=axis_y))]
    mbs.AddObject(ObjectJointRevoluteZ(markerNumbers=hinge))
    mbs.AddObject(TorsionalSpringDamper(markerNumbers=hinge, stiffness=8e3, damping=20.0))
    far = mbs.AddMarker(MarkerBodyPosition(bodyNumber=arm, localPosition=[0.8, 0.0, 0.0]))

    def force(mbs, t, vector):
        return [0.0, *loads(t)] if moves else [0.0, 0.0, 0.0]

    mbs.AddLoad(Force(markerNumber=far, loadVector=[0.0, 0.0, 0.0], loadVectorUserFunction=force))
    kinds = exu.OutputVariableType
    sensors = [
        SensorNode(nodeNumber=beam["nGenericODE2"], storeInternal=True, outputVariableType=kinds.Coordinates),
        SensorBody(
            bodyNumber=arm, localPosition=[0.8, 0.0, 0.0], storeInternal=True, outputVariableType=kinds.Position
        ),
    ]
    sensors = [mbs.AddSensor(sensor) for sensor in sensors]
    mbs.Assemble()
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    mbs.SolveStatic(settings, updateInitialValues=True)
    moves.append(True)  # its static solver asks for loads at the time 1 s
    settings.solution.sensors.writePeriod = time[1] - time[0]
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = time[-1], round(time[-1] / STEP)
    settings.timeIntegration.newton.relativeTolerance = 1e-9
    mbs.SolveDynamic(settings, solverType=exu.DynamicSolverType.TrapezoidalIndex2)
    return [np.asarray(mbs.GetSensorStoredData(sensor))[:, 1:] for sensor in sensors]


def _beam(mbs, body, position):
    """The beam, its floating frame held on the ground, its weight on its nodes: a brick's eighth on each of its corners."""
    lift = np.linalg.pinv(body.basis)
    fem = FEMinterface()
    fem.nodes = {"Position": position}
    fem.massMatrix = csr_matrix(lift.T @ body.mass @ lift)
    fem.stiffnessMatrix = csr_matrix(lift.T @ body.stiffness.at({}) @ lift)
    fem.modeBasis = {"matrix": body.basis, "type": "NormalModes"}
    beam = ObjectFFRFreducedOrderInterface(fem, roundMassMatrix=0, roundStiffnessMatrix=0).AddObjectFFRFreducedOrder(
        mbs
    )
    number = beam["oFFRFreducedOrder"]
    mbs.SetObjectParameter(number, "dampingMatrixReduced", exu.MatrixContainer(body.damping.at({})))
    wall = mbs.AddMarker(MarkerBodyRigid(bodyNumber=mbs.AddObject(ObjectGround())))
    root = mbs.AddMarker(MarkerNodeRigid(nodeNumber=beam["nRigidBody"]))
    mbs.AddObject(GenericJoint(markerNumbers=[wall, root]))
    inside = [(x > 1e-9) & (x < size - 1e-9) for x, size in zip(position.T, SIZE, strict=True)]
    shared = np.prod([1.0 + own for own in inside], axis=0)
    shared[-1] = 0.0  # the reference node of the rigid end
    for node in np.flatnonzero(shared):
        place = MarkerSuperElementPosition(bodyNumber=number, meshNodeNumbers=[int(node)], weightingFactors=[1.0])
        weight = DENSITY * np.prod(SIZE) / np.prod(COUNTS) / 8 * shared[node] * GRAVITY
        mbs.AddLoad(Force(markerNumber=mbs.AddMarker(place), loadVector=weight))
    return beam
