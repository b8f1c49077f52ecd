"""Cost of a time step: `python -m benchmarks.multibody [--quick]`.

The same bodies here and in Exudyn, side by side in one process: a heavy top on a spherical joint, and a lattice mast of 15
lumped masses on a hinge, its floating frame reduced to some modes. This package takes steps of second order with exact
second derivatives, so that every step can be differentiated; Exudyn takes generalised-α steps in C++ with its default
settings, only its output to files turned off. Both take as many steps over the same half second; the error is the largest of
the body's rotation matrix at the end, beside Exudyn's trapezoidal rule with ten times the steps. Then the bench of
configs/bench-full.yaml through the stages `import` and `reduce` (31 coordinates, 7 constraints, a bearing of 112 balls),
which has no counterpart: time of a step, of its bearing, and of its derivatives for a filter. Then how a step grows with
bodies (a chain of hinges), modes and balls. Shortest of some runs, without the compiling of the first; one BLAS thread: the
matrices are small. Machines differ and are shared: read the load beside the times. Exudyn comes with the `dev` extra only.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from benchmarks.full_bench import full_bench as full_bench_of_config
from benchmarks.full_bench import loads_of_file
from scipy.linalg import eigh
from scipy.sparse import csr_matrix

from strainsight.multibody.bearing.element import BearingLaw
from strainsight.multibody.bearing.geometry import Bearing
from strainsight.multibody.bodies import FlexibleBody, Frame, RigidBody
from strainsight.multibody.forces import Gravity, RelativeElement
from strainsight.multibody.initial import Pose, state
from strainsight.multibody.joints import Joint, revolute, spherical
from strainsight.multibody.relations import bearing_displacements, dot
from strainsight.multibody.sensors import RelationSensor, readings
from strainsight.multibody.simulate import simulate
from strainsight.multibody.step import advance, slopes
from strainsight.multibody.system import System, assemble
from strainsight.rom.inertia import InertiaInvariants

DURATION, DAMPING = 0.5, 5e-3
GRAVITY = np.array([1.0, -9.0, -3.0])
CENTRE, PIVOT = np.array([0.3, -0.1, 0.2]), np.array([-0.2, 0.1, 0.05])
INERTIA = np.diag([0.2, 0.3, 0.4]) + 3.0 * (CENTRE @ CENTRE * np.eye(3) - np.outer(CENTRE, CENTRE))


class Case(NamedTuple):
    """A system with the state that it starts from, and what builds it in Exudyn and names the node of the body."""

    name: str
    system: System
    q: np.ndarray
    v: np.ndarray
    peer: Callable[[Any], Any]


class Mast(NamedTuple):
    """Masses m (P,) at x (P, 3), full stiffness K (3P, 3P), basis (3P, n) of the lowest modes of the clamped mast."""

    m: np.ndarray
    x: np.ndarray
    K: np.ndarray
    basis: np.ndarray


def lattice(modes: int) -> Mast:
    """Five triangles of unequal masses along x with longerons and diagonals."""
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
    basis = np.zeros((len(K), modes))
    basis[9:] = eigh(K[9:, 9:], np.diag(np.repeat(m[3:], 3)), subset_by_index=(0, modes - 1))[1]
    return Mast(m, x, K, basis)


def flexible(mast: Mast) -> FlexibleBody:
    """The mast as sums over its masses."""
    m, x, f = mast.m, mast.x, mast.basis.reshape(len(mast.m), 3, -1)
    both, mixed = np.einsum("p,pik,pjl->klij", m, f, f), np.einsum("p,pi,pjk->kij", m, x, f)
    inertia = InertiaInvariants(
        mass=float(m.sum()),
        first=m @ x,
        first_modal=np.einsum("p,pik->ik", m, f),
        second=np.einsum("p,pi,pj->ij", m, x, x),
        second_modal=mixed + mixed.transpose(0, 2, 1),
        second_modal2=both,
        coupling=np.einsum("p,pj,pik->jik", m, x, f),
        coupling_modal=np.einsum("p,pjk,pil->kjil", m, f, f),
        modal=np.einsum("klii->kl", both),
    )
    K = mast.basis.T @ mast.K @ mast.basis
    return FlexibleBody("mast", False, K, inertia.modal, DAMPING * K, inertia)


def heavy_top() -> Case:
    spin = np.array([3.0, 5.0, 2.0])
    pose = Pose(-PIVOT, velocity=-np.cross(spin, PIVOT), spin=spin)
    joint = spherical("pivot", Frame("wall"), Frame("eye", "top", PIVOT))
    system = assemble([RigidBody("top", 3.0, CENTRE, INERTIA)], [joint], [Gravity(GRAVITY)])

    def peer(mbs: Any) -> Any:
        from exudyn import itemInterface as items
        from exudyn.rigidBodyUtilities import RigidBodyInertia

        body = mbs.CreateRigidBody(
            referencePosition=pose.position,
            initialVelocity=pose.velocity,
            initialAngularVelocity=spin,
            inertia=RigidBodyInertia(3.0, INERTIA, CENTRE),
            gravity=GRAVITY,
            returnDict=True,
        )
        wall = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=mbs.AddObject(items.ObjectGround())))
        eye = mbs.AddMarker(items.MarkerBodyPosition(bodyNumber=body["bodyNumber"], localPosition=PIVOT))
        mbs.AddObject(items.ObjectJointSpherical(markerNumbers=[wall, eye]))
        return body["nodeNumber"]

    return Case("heavy top", system, *state(system, {"top": pose}), peer)


def rotor(modes: int) -> Case:
    """Without weight: Exudyn's load on the whole body sees the undeformed one."""
    mast, spin = lattice(modes), np.array([0.0, 0.0, 5.0])
    system = assemble([flexible(mast)], [revolute("hinge", Frame("wall"), Frame("root", "mast"))])

    def peer(mbs: Any) -> Any:
        from exudyn import itemInterface as items
        from exudyn.FEM import FEMinterface, ObjectFFRFreducedOrderInterface

        fem = FEMinterface()
        fem.nodes = {"Position": mast.x}
        fem.massMatrix, fem.stiffnessMatrix = csr_matrix(np.diag(np.repeat(mast.m, 3))), csr_matrix(mast.K)
        fem.modeBasis = {"matrix": mast.basis, "type": "NormalModes"}
        body = ObjectFFRFreducedOrderInterface(fem).AddObjectFFRFreducedOrder(
            mbs, initialAngularVelocity=spin, stiffnessProportionalDamping=DAMPING
        )
        wall = mbs.AddMarker(items.MarkerBodyRigid(bodyNumber=mbs.AddObject(items.ObjectGround())))
        root = mbs.AddMarker(items.MarkerNodeRigid(nodeNumber=body["nRigidBody"]))
        mbs.AddObject(items.ObjectJointRevoluteZ(markerNumbers=[wall, root]))
        return body["nRigidBody"]

    return Case(f"rotor, {modes} modes", system, *state(system, {"mast": Pose(spin=spin)}), peer)


def shortest(work: Callable[[], object], repeat: int = 3) -> float:
    """Shortest of some times of the processor [s]."""
    times = []
    for _ in range(repeat):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def run_ours(case: Case, steps: int) -> tuple[float, np.ndarray]:
    """Seconds a step, and the rotation matrix (3, 3) at the end."""

    def work(count: int = steps) -> np.ndarray:
        return simulate(case.system, case.q, case.v, np.zeros((count + 1, 0)), DURATION / steps, np.zeros(0)).q[-1]

    end = work(2)
    seconds = shortest(lambda: end.__setitem__(slice(None), work())) / steps
    return seconds, end[3:12].reshape(3, 3).T


def run_theirs(case: Case, steps: int, fine: bool = False) -> tuple[float, np.ndarray]:
    """The same of Exudyn."""
    import exudyn as exu

    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.timeIntegration.endTime, settings.timeIntegration.numberOfSteps = DURATION, steps
    integrator = exu.DynamicSolverType.TrapezoidalIndex2 if fine else exu.DynamicSolverType.GeneralizedAlpha
    systems = []
    for _ in range(1 if fine else 3):
        mbs = exu.SystemContainer().AddSystem()
        node = case.peer(mbs)
        mbs.Assemble()
        systems.append(mbs)
    left = iter(systems)
    seconds = shortest(lambda: next(left).SolveDynamic(settings, solverType=integrator), len(systems)) / steps
    return seconds, np.reshape(systems[-1].GetNodeOutput(node, exu.OutputVariableType.RotationMatrix), (3, 3))


def side_by_side(steps: int) -> None:
    try:
        import exudyn  # noqa: F401
    except ImportError:
        print("Exudyn is not installed: nothing to compare with")
        peer = False
    else:
        peer = True
    print(
        f"\n{'':18s} {'coordinates':>11s} {'µs a step':>11s} {'Exudyn':>11s} {'ratio':>7s} {'error':>9s} {'Exudyn':>9s}"
    )
    for case in (heavy_top(), rotor(4), rotor(16)):
        ours, end = run_ours(case, steps)
        told = f"{case.name:18s} {case.system.size:11d} {1e6 * ours:11.0f}"
        if peer:
            theirs, their_end = run_theirs(case, steps)
            _, exact = run_theirs(case, 10 * steps, fine=True)
            errors = [np.abs(R - exact).max() for R in (end, their_end)]
            told += f" {1e6 * theirs:11.0f} {ours / theirs:7.1f} {errors[0]:9.1e} {errors[1]:9.1e}"
        print(told, flush=True)


def full_bench(steps: int) -> None:
    """The bench under its loads, from its equilibrium."""
    full = full_bench_of_config()
    system, theta, h = full.bench.system, full.bench.theta, float(full.config.simulate.time_step)
    u = loads_of_file(system.inputs)[1][: steps + 1]
    q = full.at_rest(u[0])
    v = np.zeros_like(q)
    whole = shortest(lambda: simulate(system, q, v, u, h, theta)) / steps
    last, iterations = None, 0
    for k in range(steps):
        at = (q, v) if last is None else (last.q, last.v)
        last = advance(system, *at, (u[k], u[k + 1]), h, theta, "second_order", last=last)
        iterations += sum(stage.iterations for stage in last.stages)
    assert last is not None
    end = last
    derivatives = shortest(lambda: [slopes(system, end) for _ in range(50)]) / 50
    rho = readings(system, [RelationSensor("bearing", full.bearing.relations)]).read(end.q, end.v)[0]
    law = full.bearing.law
    bearing = shortest(lambda: [law.load(rho, np.zeros(5), np.zeros(0)) for _ in range(50)]) / 50
    each = iterations / steps
    print(
        f"\n{full.config.name}: {system.size} coordinates, {system.constrained} constraints, {steps} steps of {1e3 * h:g} ms\n"
        f"  a step            {1e6 * whole:6.0f} µs, {each:.2f} Newton iterations; {h / whole:.0f} times real time\n"
        f"  of it, bearing    {1e6 * bearing * each:6.0f} µs, {1e6 * bearing:.0f} µs a call\n"
        f"  its derivatives   {1e6 * derivatives:6.0f} µs, {derivatives / whole:.1f} times the step itself"
    )


def chain(count: int) -> Case:
    """Bars of 1 m on hinges about z, y, z, … from a wall."""
    bars = [RigidBody(f"bar {k}", 1.0, np.array([0.5, 0.0, 0.0]), np.diag([0.01, 0.34, 0.34])) for k in range(count)]
    tips = [Frame("wall"), *(Frame(f"tip {k}", f"bar {k}", np.array([1.0, 0.0, 0.0])) for k in range(count))]
    hinges = [revolute(f"hinge {k}", tips[k], Frame(f"root {k}", f"bar {k}"), "zy"[k % 2]) for k in range(count)]
    system = assemble(bars, hinges, [Gravity(GRAVITY)])
    poses = {f"bar {k}": Pose(np.array([float(k), 0.0, 0.0])) for k in range(count)}
    return Case(f"{count} bodies", system, *state(system, poses), lambda mbs: None)


def ring(balls: int) -> Case:
    """A mass on a bearing, pushed to and fro by its weight."""
    bearing = Bearing(balls, 1.15, np.pi / 4, 0.03, 0.0159, 0.0159, 0.0159, 0.0159, 1e-5)
    relations = bearing_displacements(Frame("wall"), Frame("root", "mass"))
    held = Joint("spin", (dot(Frame("wall"), 1, Frame("root", "mass"), 2),))
    mass = RigidBody("mass", 1750.0, np.array([1.0, 0.0, 0.0]), np.diag([500.0, 2500.0, 2500.0]))
    system = assemble([mass], [held], [RelativeElement("bearing", relations, BearingLaw(bearing)), Gravity()])
    return Case(f"{balls} balls", system, *state(system, {}), lambda mbs: None)


def _twenty_times(work: Callable[[], object]) -> None:
    for _ in range(20):
        work()


def growth(steps: int) -> None:
    h, none = DURATION / 500, np.zeros(0)
    print(f"\n{'':18s} {'µs a step':>11s} {'iterations':>11s} {'derivatives':>12s}")
    for case in (*map(chain, (1, 2, 5, 10, 20)), *map(rotor, (4, 8, 16, 32)), *map(ring, (28, 56, 112, 224))):
        last, iterations = None, 0
        seconds = shortest(partial(simulate, case.system, case.q, case.v, np.zeros((steps + 1, 0)), h, none)) / steps
        for _ in range(20):
            at = (case.q, case.v) if last is None else (last.q, last.v)
            last = advance(case.system, *at, (none, none), h, none, "second_order", last=last)
            iterations += sum(stage.iterations for stage in last.stages)
        assert last is not None
        by = shortest(partial(_twenty_times, partial(slopes, case.system, last))) / 20
        print(f"{case.name:18s} {1e6 * seconds:11.0f} {iterations / 20:11.2f} {1e6 * by:12.0f}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a fifth of the steps")
    quick = parser.parse_args().quick
    print(f"load average {os.getloadavg()[0]:.1f}, {os.cpu_count()} processors")
    side_by_side(100 if quick else 500)
    growth(50 if quick else 200)
    full_bench(200 if quick else 1000)


if __name__ == "__main__":
    main()
