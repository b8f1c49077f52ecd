"""Simulation and static equilibrium of a bench: sensors, bearings, coupled modes (thesis 1.5-1.7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strainsight.config.bench.bench import ReactionSensor, Simulate
from strainsight.errors import ConfigError, NumericalError, blame
from strainsight.experiment.bench.bearings import overloaded
from strainsight.experiment.bench.bench import Bench, explained, start_of
from strainsight.experiment.bench.loads import doubtful_drives, drives_of, loads_of, refuse_spun
from strainsight.experiment.bench.sensors import Sensors, dataset_units, frame_at, instants_of, read_in_time, sensors_of
from strainsight.experiment.system import Resources, of_steps
from strainsight.mesh.facets import exterior_facets
from strainsight.mesh.model import CellBlock
from strainsight.mesh.vtkhdf import VtkHdf, facet_cells, unstructured_grid
from strainsight.multibody.accelerations import Instant, measure, reaction
from strainsight.multibody.bearing.element import ball_loads, bearing_load
from strainsight.multibody.bodies import Frame, RigidBody
from strainsight.multibody.coupled import SHARE, CoupledModes, coupled_modes, growth, load_error, resolved_frequency
from strainsight.multibody.initial import constraints_at
from strainsight.multibody.sensors import RelationSensor, readings
from strainsight.multibody.simulate import Trajectory, simulate, simulate_controlled
from strainsight.multibody.step import GAIN, LAG
from strainsight.ordering import index_of_largest
from strainsight.records.bench import (
    AtRest,
    Coupled,
    DriveMotion,
    FrameAtRest,
    FrameInModes,
    RingAtRest,
    RingMotion,
    Simulated,
    StateSpace,
    Violation,
    WorstInstant,
)
from strainsight.records.record import record_from, written
from strainsight.runner.output import Output, Scalar, Table, warnings_table


def rings_in_time(bench: Bench, run: Trajectory) -> dict[str, RingMotion]:
    """Displacement and load of every bearing in time, and ball loads at the instant of the highest pressure."""
    rings = {}
    for name, (element, bearing) in bench.rings.items():
        displacements = readings(bench.system, [RelationSensor(name, element.force.relations[:5])])
        q = np.array([displacements.read(a, b)[0] for a, b in zip(run.q, run.v, strict=True)])
        balls = [ball_loads(bearing, each) for each in q]
        pressure = np.array([ball.pressure.max() for ball in balls])
        worst = index_of_largest(pressure)
        ellipse = max(float(ball.semi_axes.max()) for ball in balls)
        if ellipse > bearing.ball_diameter / 2:
            raise ConfigError(
                f"the contact ellipse is larger than the ball (semi-axis {1e3 * ellipse:.4g} mm at t = {run.time[worst]:g} s, "
                f"ball radius {500 * bearing.ball_diameter:.4g} mm)",
                key=f"forces.{name}",
                remedy="Check the size of the loads and the preload of the bearing.",
            )
        rings[name] = RingMotion(
            displacement=q,
            load=np.array([bearing_load(bearing, each, slopes=False).force for each in q]),
            pressure=pressure,
            worst=record_from(WorstInstant, balls[worst], time=float(run.time[worst])),
        )
    return rings


def reactions_in_time(bench: Bench, name: str, run: Trajectory, instants: Sequence[Instant]) -> np.ndarray:
    """Force and moment (T, 6) of a joint on its second frame, about its origin, in the axes of the first frame."""
    joint = next(joint for joint in bench.system.joints if joint.name == name)
    i, j = (bench.frames[frame] for frame in bench.config.joints[name].frames)
    states = zip(run.q, run.u, instants, strict=True)
    return np.array([reaction(bench.system, joint, i, j, q, now.lam, u) for q, u, now in states])


TILT = 0.1
"""Largest tilt [rad] for force laws that assume small angles."""


def _simulated(bench: Bench, using: Resources) -> tuple[Simulated, Sensors, int]:
    """Simulate the bench and read the sensors; also returns the largest number of parts of a step."""
    settings, system, theta = bench.config.simulate, bench.system, bench.theta
    h, steps = settings.time_step, round(settings.duration / settings.time_step)
    loads, progress = loads_of(bench, using.files), of_steps(using.progress, "simulation", steps)
    u = loads(h * np.arange(steps + 1))
    refuse_spun(bench, u, "simulate")
    with blame("simulate"):
        q0, v0 = start_of(bench, u[0])
        frequency = coupled_modes(system, q0, v0, u[0], theta).held_frequency
        try:
            if settings.tolerance is None:
                run, parts = simulate(system, q0, v0, u, h, theta, settings.method, progress), 1
            else:
                controlled = simulate_controlled(
                    system, q0, v0, loads, h, steps, theta, settings.method, settings.tolerance, progress
                )
                run, parts = controlled.run, int(controlled.parts.max())
        except NumericalError as error:
            raise explained(error, bench, q0, u, h) from error
    moved, sensors = drives_of(bench, using.files)(run.time), sensors_of(bench)
    reacting = {key: entry.joint for key, entry in bench.config.sensors.items() if isinstance(entry, ReactionSensor)}
    needed = reacting or len(moved) or sensors.readings.accelerometers
    instants = instants_of(bench, run.q, run.v, run.u, moved[:, 2].T) if needed else []
    measured = read_in_time(bench, sensors.readings, run.q, run.v, run.u, instants)
    measured = measured - np.where(sensors.zeroed, measured[0], 0.0)
    _refuse_tilted(bench, run)
    constraints = [constraints_at(system, q, u) for q, u in zip(run.q, run.u, strict=True)]
    rates = [B @ v + rate for (_, B, rate), v in zip(constraints, run.v, strict=True)]
    record = Simulated(
        time=run.time,
        q=run.q,
        v=run.v,
        violation=Violation(
            position=np.array([np.abs(phi).max(initial=0.0) for phi, *_ in constraints]),
            velocity=np.array([np.abs(rate).max(initial=0.0) for rate in rates]),
        ),
        frequency=frequency,
        coordinates=bench.coordinates,
        inputs=dict(zip(system.inputs, u.T[: len(system.inputs)], strict=True)),
        sensors={name: measured[:, part] for name, part in sensors.channels.items()}
        | {name: reactions_in_time(bench, joint, run, instants) for name, joint in reacting.items()},
        bearings=rings_in_time(bench, run),
        drives={
            name: DriveMotion(position=p, rate=rate, force=np.array([now.drive[i] for now in instants]))
            for i, (name, (p, rate, _)) in enumerate(zip(system.drives.names, moved, strict=True))
        },
    )
    return record, sensors, parts


TURN = {"second_order": 0.1, "thesis": 0.01}
"""Rotation per step [rad] with a visible effect on free rotation."""

MISSED = 0.05
"""Unresolved share of a load from which a warning is given."""


def simulate_output(bench: Bench, using: Resources) -> Output:
    """Output of a simulation, with the frequency band that the time step resolves."""
    config, settings, system = bench.config, bench.config.simulate, bench.system
    (record, sensors, most), h = _simulated(bench, using), settings.time_step
    turn = max(turns_in_a_step(bench, record.v, h).values(), default=0.0)
    steps, worst = len(record.time) - 1, float(record.violation.position.max())
    pressure = {name: float(ring.pressure.max()) for name, ring in record.bearings.items()}
    summary: dict[str, Scalar] = {
        "steps": steps,
        "coordinates": system.size,
        "constraints": system.constrained,
        "violation": worst,
        "violation_rate": float(record.violation.velocity.max()),
        "turn": turn,
        "parts": most,
        **{f"pressure.{name}": highest for name, highest in pressure.items()},
    }
    text = (
        f"{steps} steps of {h:g} s, {system.size} coordinates, {system.constrained} constraints with residuals up to "
        f"{worst:.1e} m or rad"
    )
    if settings.tolerance is not None:
        text += f"; each step is divided into up to {most} substeps with a relative tolerance of {settings.tolerance:g}"
    doubts = []
    if len(record.frequency) and record.frequency[0] > 0:
        summary["first_frequency"] = float(record.frequency[0])
        if settings.tolerance is None:
            band = summary["band"] = resolved_frequency(record.frequency, h, settings.method)
            text += f"; resolves loads up to {band:.3g} Hz with a displacement error of at most {100 * SHARE:g} %"
            for name, load in record.inputs.items():
                share = float(load_error(load[:, None], record.frequency, h, settings.method)[0])
                summary[f"missed.{name}"] = share
                if share > MISSED:
                    doubts.append(
                        f"the time step does not resolve {100 * share:.2g} % of the RMS of {name} (loads up to "
                        f"{band:.3g} Hz are resolved). Reduce simulate.time_step, or filter the load"
                    )
    doubts += [*doubtful_drives(config, using.files), *overloaded(config, pressure)]
    if system.size > system.constrained and settings.tolerance is None and turn > TURN[settings.method]:
        doubts.append(_turning(turn, settings))
    moved = tuple(
        (name, str(i), f"{1e3 * distance:.3g} mm")
        for name, on in sensors.bonded.items()
        for i, distance in enumerate(on.moved, start=1)
    )
    rings = []
    for name, ring in record.bearings.items():
        force = ring.worst.force
        balls = f"{np.count_nonzero((force > 0).any(axis=1))} of {len(force)}"
        rings.append((name, f"{pressure[name] / 1e6:.5g} MPa", f"{ring.worst.time:.4g} s", balls))
    tables = (
        Table("distance of the gauges to the surface", ("sensor", "gauge", "distance"), moved),
        Table(
            "highest contact pressure of every bearing",
            ("bearing", "pressure", "time", "loaded balls"),
            tuple(rings),
            answer=True,
        ),
        *warnings_table(doubts),
    )
    return Output(
        datasets=written(record, dataset_units(config, system.inputs)),
        summary=summary,
        message=text,
        tables=tuple(table for table in tables if table.rows),
    )


def _turning(turn: float, settings: Simulate) -> str:
    h = settings.time_step
    if settings.method == "thesis":
        loss = 1 - (1 + turn**2 / h) ** -0.5  # of dω/dt = −ω³h/2 over one second
        what = f"the implicit Euler method slows a freely rotating body by {100 * loss:.2g} % in the first second"
    else:
        lag, gain = 100 * LAG * turn**2, 100 * GAIN * turn**4 / h
        what = f"a freely rotating body lags by {lag:.2g} % of its angle and gains {gain:.2g} % of its speed per second"
    return f"a body rotates by {turn:.3g} rad per time step, and {what}. Reduce simulate.time_step"


def _refuse_tilted(bench: Bench, run: Trajectory) -> None:
    """Raises ConfigError if axes are not nearly parallel that a small-angle force law or a driven rotation requires parallel."""
    system = bench.system
    checked = [(f"forces.{part.name}", part.aligned) for part in (element.force for element in system.elements)]
    checked += [(f"joints.{part.name}", part.aligned) for part in system.joints if part.name in system.drives.names]
    for key, aligned in ((key, aligned) for key, aligned in checked if aligned):
        together = readings(system, [RelationSensor(key, aligned)])
        cosines = np.array([together.read(q, v)[0] for q, v in zip(run.q, run.v, strict=True)])
        for axes, cosine in zip((relation.name for relation in aligned), cosines.T, strict=True):
            worst = int(np.argmin(cosine))
            if cosine[worst] < np.cos(TILT):
                angle = float(np.arccos(np.clip(cosine[worst], -1, 1)))
                raise ConfigError(
                    f"{axes} differ in direction by {angle:.3g} rad at t = {run.time[worst]:g} s; the limit is {TILT:g} rad",
                    key=key,
                    remedy="Align the axes of the frames at rest, and keep them parallel by a joint: this "
                    f"{'force law' if key.startswith('forces') else 'drive'} is valid for small tilts.",
                )


def turns_in_a_step(bench: Bench, v: np.ndarray, h: float) -> dict[str, float]:
    """Body → largest rotation in a step h [s] of a run v (T + 1, n) [rad], with |ω| = ‖Ṙ‖/√2."""
    spins = {name: v[:, bench.system.of[name]][:, 3:12] for name in bench.poses}
    return {name: float(h * np.nanmax(np.linalg.norm(spin, axis=1)) / np.sqrt(2)) for name, spin in spins.items()}


MOST_MODES = 20
"""Most modes in the grid."""


@dataclass(frozen=True)
class BenchAtRest:
    """Bench in the state q, v (n,) at rest under u; growth: rate of an instability (0: stable), of this body."""

    bench: Bench
    q: np.ndarray
    v: np.ndarray
    u: np.ndarray
    modes: CoupledModes
    growth: float
    body: str


def rest_of(bench: Bench, using: Resources, balanced: bool) -> BenchAtRest:
    """Bring the bench to rest; balanced: in the equilibrium under the loads at t = 0 with fixed drives, regardless of
    `simulate.start`. Unstable equilibria are allowed."""
    u = loads_of(bench, using.files)(np.zeros(1))[0]
    changed: dict[str, object] = {"allow_unstable": True}
    if balanced:
        u[bench.system.drives.rates] = 0.0
        changed["start"] = "equilibrium"
    with blame("simulate"):
        q, v = start_of(bench.simulated(**changed), u)
    modes = coupled_modes(bench.system, q, v, u, bench.theta)
    return BenchAtRest(bench, q, v, u, modes, *growth(bench.system, modes))


def at_rest(rest: BenchAtRest) -> AtRest:
    """Frames, sensor readings, joint reactions, drives and bearings in the equilibrium."""
    bench, q, config = rest.bench, rest.q, rest.bench.config
    still = Trajectory(np.zeros(1), q[None], 0 * q[None], rest.u[None], np.zeros((0, bench.system.constrained)))
    instants = instants_of(bench, still.q, still.v, still.u, np.zeros((1, len(bench.system.drives.names))))
    reactions = {name: reactions_in_time(bench, name, still, instants)[0] for name in config.joints}
    sensors = sensors_of(bench)
    read = read_in_time(bench, sensors.readings, still.q, still.v, still.u, instants)[0]
    frames = {name: frame_at(bench, frame, q)[0] for name, frame in bench.frames.items()}
    return AtRest(
        q=q,
        growth=rest.growth,
        coordinates=bench.coordinates,
        inputs=dict(zip(bench.system.inputs, rest.u.tolist(), strict=False)),
        frames={name: FrameAtRest(position=y[:3], axes=y[3:].reshape(3, 3).T) for name, y in frames.items()},
        sensors={name: read[part] for name, part in sensors.channels.items()}
        | {name: reactions[entry.joint] for name, entry in config.sensors.items() if isinstance(entry, ReactionSensor)},
        reactions=reactions,
        drives=dict(zip(bench.system.drives.names, instants[0].drive.tolist(), strict=True)),
        bearings={
            name: RingAtRest(displacement=ring.displacement[0], load=ring.load[0], pressure=float(ring.pressure[0]))
            for name, ring in rings_in_time(bench, still).items()
        },
    )


def coupled(rest: BenchAtRest) -> Coupled:
    """Coupled modes with the motion of every frame, and the state space from loads to sensors (without reactions)."""
    bench, modes = rest.bench, rest.modes
    sensors = sensors_of(bench)
    none = np.zeros(len(bench.system.drives.names))
    read = measure(bench.system, sensors.readings, rest.q, rest.v, rest.u, bench.theta, none)
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
        coordinates=bench.coordinates,
        frames={
            name: _frame_in_modes(bench, frame, rest.q, Phi)
            for name, frame in bench.frames.items()
            if frame.body is not None
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


def _frame_in_modes(bench: Bench, frame: Frame, q: np.ndarray, Phi: np.ndarray) -> FrameInModes:
    """Displacement δp and rotation δθ = ½ Σ a_k × δa_k of a frame in every mode."""
    y, by_q = frame_at(bench, frame, q)
    moved = by_q @ Phi
    axes, turned = y[3:].reshape(3, 3), moved[3:].reshape(3, 3, -1)
    rotation = 0.5 * sum(np.cross(axes[k], turned[k].T) for k in range(3))
    return FrameInModes(displacement=moved[:3].T, rotation=np.asarray(rotation).reshape(-1, 3))


def modes_in_space(rest: BenchAtRest) -> VtkHdf:
    """Grid of flexible surfaces, and lines from rigid centres to frames, at rest, with mode shapes as steps."""
    bench, count = rest.bench, min(MOST_MODES, len(rest.modes.squares))
    points, shapes, blocks, total = [], [], [], 0
    for body in bench.system.bodies:
        if isinstance(body, RigidBody):
            at = [body.centre, *(f.origin for f in bench.frames.values() if f.body == body.name)]
            frames = [Frame(str(k), body.name, np.asarray(x, dtype=float)) for k, x in enumerate(at)]
            motions = [frame_at(bench, frame, rest.q) for frame in frames]
            points.append(np.array([y[:3] for y, _ in motions]))
            shapes.append(np.stack([by_q[:3] @ rest.modes.shapes[:, :count] for _, by_q in motions]))
            to = np.arange(1, len(at))
            blocks.append(CellBlock("line", to, total + np.column_stack([0 * to, to]), 0 * to))
        else:
            mesh = bench.meshes[body.name]
            used, cells, _ = facet_cells(exterior_facets(mesh))
            part, x = bench.system.of[body.name], mesh.position[used]
            basis = bench.reduced[body.name].basis.reshape(len(mesh.position), 3, -1)[used]
            eta = bench.system.modal(body.name)
            x = x + basis @ rest.q[eta]
            moved = basis @ rest.modes.shapes[eta, :count]
            if part.stop - part.start > eta.stop - eta.start:
                R = rest.q[part][3:12].reshape(3, 3).T
                turned = rest.modes.shapes[part][3:12, :count].reshape(3, 3, count)  # columns of δR
                moved = np.einsum("ij,njc->nic", R, moved) + np.einsum("jic,nj->nic", turned, x)
                moved += rest.modes.shapes[part][:3, :count]
                x = rest.q[part][:3] + x @ R.T
            points.append(x)
            shapes.append(moved)
            blocks += [replace(block, nodes=total + block.nodes) for block in cells]
        total += len(points[-1])
    data = {"mode": np.moveaxis(np.concatenate(shapes), 2, 0)}
    return unstructured_grid(np.concatenate(points), blocks, point_data=data, steps=rest.modes.frequency[:count])
