"""A bench at rest: what it looks like in its equilibrium, and its coupled modes and state space there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.bench.bench import ReactionSensor
from strainsight.errors import blame
from strainsight.experiment.bench.bench import Bench, start_of
from strainsight.experiment.bench.loads import drives_of, loads_of
from strainsight.experiment.bench.sensors import instants_of, read_in_time, sensors_of
from strainsight.experiment.bench.simulation import felt, rings_in_time
from strainsight.experiment.resources import Resources
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import CellBlock
from strainsight.mesh.vtkhdf import VtkHdf, facet_cells, unstructured_grid
from strainsight.multibody.accelerations import measured
from strainsight.multibody.bodies import Frame, RigidBody
from strainsight.multibody.coupled import CoupledModes, coupled_modes, growth
from strainsight.multibody.sensors import axis_sensor, position_sensor, readings
from strainsight.multibody.simulate import Trajectory
from strainsight.records.bench import AtRest, Coupled, FrameAtRest, FrameInModes, RingAtRest, StateSpace

DRAWN = 20
"""Most modes in the grid."""


@dataclass(frozen=True)
class Rest:
    """The bench with its state at rest q, v (n,) under u, and how fast it would be left (0: stable) by which body."""

    bench: Bench
    q: np.ndarray
    v: np.ndarray
    u: np.ndarray
    modes: CoupledModes
    growth: float
    body: str


def rest_of(bench: Bench, using: Resources, balanced: bool) -> Rest:
    """balanced: in the equilibrium under the loads at t = 0, its drives held, whatever `simulate.start` says; unstable ones,
    too."""
    u = loads_of(bench, using.files)(np.zeros(1))[0]
    changed: dict[str, object] = {"allow_unstable": True}
    if balanced:
        u[bench.system.drives.rates] = 0.0
        changed["start"] = "equilibrium"
    with blame("simulate"):
        q, v = start_of(bench.simulated(**changed), u)
    modes = coupled_modes(bench.system, q, v, u, bench.theta)
    return Rest(bench, q, v, u, modes, *growth(bench.system, modes))


def at_rest(rest: Rest, using: Resources) -> AtRest:
    """The equilibrium in numbers: frames, sensors, reactions of every joint, drives, bearings."""
    bench, q, config = rest.bench, rest.q, rest.bench.config
    every = {f"joint {name}": ReactionSensor(type="reaction", joint=name) for name in config.joints}
    with_reactions = replace(bench, config=config.model_copy(update={"sensors": {**config.sensors, **every}}))
    still = Trajectory(np.zeros(1), q[None], 0 * q[None], rest.u[None], np.zeros((0, bench.system.constrained)))
    moved = drives_of(bench, using.files)(still.time)
    moved[:, 1:] = 0.0
    instants = instants_of(bench, still.q, still.v, still.u, moved[:, 2].T)
    reactions, drives = felt(with_reactions, still, instants, moved)
    sensors = sensors_of(bench)
    read = read_in_time(bench, sensors.readings, still.q, still.v, still.u, instants)[0]
    return AtRest(
        q=q,
        growth=rest.growth,
        coordinates={name: np.array([part.start, part.stop]) for name, part in bench.system.of.items()},
        inputs=dict(zip(bench.system.inputs, rest.u.tolist(), strict=False)),
        frames={name: _placed(bench, frame, q) for name, frame in bench.frames.items()},
        sensors={name: read[part] for name, part in sensors.channels.items()}
        | {name: values[0] for name, values in reactions.items() if name in config.sensors},
        reactions={name: reactions[f"joint {name}"][0] for name in config.joints},
        drives={name: float(found.force[0]) for name, found in drives.items()},
        bearings={
            name: RingAtRest(displacement=ring.displacement[0], load=ring.load[0], pressure=float(ring.pressure[0]))
            for name, ring in rings_in_time(bench, still).items()
        },
    )


def coupled(rest: Rest) -> Coupled:
    """Modes with the motion of every frame in them, and the state space from the loads to the sensors, but for reactions."""
    bench, modes = rest.bench, rest.modes
    sensors = sensors_of(bench)
    none = np.zeros(len(bench.system.drives.names))
    read = measured(bench.system, sensors.readings, rest.q, rest.v, rest.u, bench.theta, none)
    nu, Phi = len(bench.system.inputs), modes.shapes
    B = np.vstack([np.zeros_like(modes.B), modes.B])[:, :nu]
    values = modes.eigenvalues
    outputs = [f"{name} {k + 1}" for name, part in sensors.channels.items() for k in range(part.stop - part.start)]
    return Coupled(
        frequency=modes.frequency,
        damping=modes.damping,
        stiffness=modes.squares,
        shape=Phi.T,
        q=rest.q,
        growth=rest.growth,
        coordinates={name: np.array([part.start, part.stop]) for name, part in bench.system.of.items()},
        frames={
            name: _moved(bench, frame, rest.q, Phi) for name, frame in bench.frames.items() if frame.body is not None
        },
        eigenvalue=np.column_stack([values.real, values.imag]),
        system=StateSpace(
            A=modes.A,
            B=B,
            C=np.hstack([read.by_q @ Phi, read.by_v @ Phi]),
            D=read.by_u,
            inputs=bench.system.inputs,
            outputs=tuple(outputs),
        ),
    )


def _placed(bench: Bench, frame: Frame, q: np.ndarray) -> FrameAtRest:
    y = _looked_at(bench, frame, q)[0]
    return FrameAtRest(position=y[:3], axes=y[3:].reshape(3, 3).T)


def _moved(bench: Bench, frame: Frame, q: np.ndarray, Phi: np.ndarray) -> FrameInModes:
    """δp, and δθ = ½ Σ a_k × δa_k."""
    y, by_q = _looked_at(bench, frame, q)
    moved = by_q @ Phi
    axes, turned = y[3:].reshape(3, 3), moved[3:].reshape(3, 3, -1)
    rotation = 0.5 * sum(np.cross(axes[k], turned[k].T) for k in range(3))
    return FrameInModes(displacement=moved[:3].T, rotation=np.asarray(rotation).reshape(-1, 3))


def _looked_at(bench: Bench, frame: Frame, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Place and axes of a frame (12,), and their slopes by q (12, n)."""
    own = [position_sensor(frame.name, frame), *(axis_sensor(frame.name, frame, k) for k in range(3))]
    y, by_q, _ = readings(bench.system, own).read(q, np.zeros_like(q))
    return y, by_q


def modes_in_space(rest: Rest) -> VtkHdf:
    """Surfaces of flexible bodies and lines from the centre of a rigid body to its frames, where they rest; `mode` in steps."""
    bench, count = rest.bench, min(DRAWN, len(rest.modes.squares))
    points, shapes, blocks, total = [], [], [], 0
    for body in bench.system.bodies:
        if isinstance(body, RigidBody):
            at = [body.centre, *(f.origin for f in bench.frames.values() if f.body == body.name)]
            frames = [Frame(str(k), body.name, np.asarray(x, dtype=float)) for k, x in enumerate(at)]
            seen = [_looked_at(bench, frame, rest.q) for frame in frames]
            points.append(np.array([y[:3] for y, _ in seen]))
            shapes.append(np.stack([by_q[:3] @ rest.modes.shapes[:, :count] for _, by_q in seen]))
            to = np.arange(1, len(at))
            blocks.append(CellBlock("line", to, total + np.column_stack([0 * to, to]), 0 * to))
        else:
            mesh = bench.meshes[body.name]
            used, cells, _ = facet_cells(exterior_facets(mesh))
            own, x = bench.system.of[body.name], mesh.position[used]
            basis = bench.reduced[body.name].basis.reshape(len(mesh.position), 3, -1)[used]
            eta = bench.system.modal(body.name)
            x = x + basis @ rest.q[eta]
            phi = rest.modes.shapes[eta, :count]
            moved = basis @ phi
            if own.stop - own.start > eta.stop - eta.start:
                R = rest.q[own][3:12].reshape(3, 3).T
                turned = rest.modes.shapes[own][3:12, :count].reshape(3, 3, count)  # δR by columns
                moved = np.einsum("ij,njc->nic", R, moved) + np.einsum("jic,nj->nic", turned, x)
                moved += rest.modes.shapes[own][:3, :count]
                x = rest.q[own][:3] + x @ R.T
            points.append(x)
            shapes.append(moved)
            blocks += [replace(block, nodes=total + block.nodes) for block in cells]
        total += len(points[-1])
    data = {"mode": np.moveaxis(np.concatenate(shapes), 2, 0)}
    return unstructured_grid(np.concatenate(points), blocks, point_data=data, steps=rest.modes.frequency[:count])
