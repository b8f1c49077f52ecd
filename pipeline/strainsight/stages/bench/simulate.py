"""simulate: the bench in time by stabilised implicit Euler (thesis 1.5-1.7)."""

from __future__ import annotations

import numpy as np

from strainsight.cases.bench.bench import Bench, bench_of
from strainsight.cases.bench.loads import loads_of
from strainsight.cases.bench.rings import rings_in_time
from strainsight.cases.bench.sensors import reading_datasets, sensors_of
from strainsight.cases.bench.start import start_of
from strainsight.errors import ConfigError, blame
from strainsight.multibody.initial import constraints_at
from strainsight.multibody.sensors import RelationSensor, readings
from strainsight.multibody.simulate import Trajectory, simulate
from strainsight.multibody.spectrum import coupled_frequencies
from strainsight.stages.bench import inputs
from strainsight.workflow.output import Dataset, Output, Scalar, Table
from strainsight.workflow.stage import Context, Stage

FEWEST_STEPS_A_PERIOD = 20
TURN = 0.01
"""[rad] a step above which implicit Euler visibly brakes what turns freely."""
BAND = 0.1
"""Share of the first coupled frequency up to which implicit Euler follows a load."""

TILT = 0.1
"""[rad] up to which the displacements of a force law that takes angles to be small are what they are called."""


def run(context: Context) -> Output:
    """Assemble the bench, bring it to its start, step through the loads, read the sensors."""
    config = context.config
    reduced, meshes = inputs.bodies(context), inputs.meshes(context)
    bench = bench_of(config, reduced, meshes)
    h, steps = float(config.simulate.time_step), round(config.simulate.duration / config.simulate.time_step)
    time = h * np.arange(steps + 1)
    u = loads_of(context, bench)(time)
    with blame("simulate"):
        q0, v0 = start_of(bench, config.simulate, u[0])
        frequency = coupled_frequencies(bench.system, q0, v0, u[0], bench.theta)
        found = simulate(
            bench.system,
            q0,
            v0,
            u[1:],
            h,
            bench.theta,
            lambda k: context.progress("simulation", k / steps) if k % 50 == 0 else None,
        )
    sensors = sensors_of(config, bench, reduced, meshes, context.upstream.get("place"))
    measured = np.array([sensors.readings.read(q, v)[0] for q, v in zip(found.q, found.v, strict=True)])
    measured = measured - np.where(sensors.zeroed, measured[0], 0.0)
    position, velocity = _violation(bench, found)
    datasets = {
        "/time": Dataset(found.time, "s", "time, the start first"),
        "/q": Dataset(found.q, "SI", "coordinates (time × coordinate)", ("/time", "")),
        "/v": Dataset(found.v, "SI", "their rates (time × coordinate)", ("/time", "")),
        "/violation/position": Dataset(position, "SI", "largest constraint violation at every instant", ("/time",)),
        "/violation/velocity": Dataset(velocity, "SI", "largest rate of one", ("/time",)),
        "/frequency": Dataset(frequency, "Hz", "undamped frequencies of the coupled bench at the start"),
    }
    for name, own in bench.system.of.items():
        datasets[f"/coordinates/{name}"] = Dataset(
            np.array([own.start, own.stop]), "1", "first coordinate of the body and the one after its last"
        )
    for k, name in enumerate(bench.system.inputs):
        unit = "N" if config.forces[name].type == "force" else "N m"
        datasets[f"/inputs/{name}"] = Dataset(u[:, k], unit, f"load {name}", ("/time",))
    datasets |= reading_datasets(config, sensors, measured)
    summary: dict[str, Scalar] = {
        "steps": steps,
        "coordinates": bench.system.size,
        "constraints": bench.system.constrained,
        "violation": float(position.max()),
        "violation_rate": float(velocity.max()),
    }
    _refuse_tilted(bench, found)
    more, said, more_tables = rings_in_time(config, bench, found)
    datasets |= more
    first, turn = (float(frequency[0]) if len(frequency) else 0.0), _turn(bench, found, h)
    band = min(BAND * first, 1 / (FEWEST_STEPS_A_PERIOD * h))
    summary["turn"] = turn
    if first > 0:
        summary |= {"first_frequency": first, "band": band}
    if turn > TURN:
        loss = 1 - (1 + turn**2 / h) ** -0.5  # of dω/dt = −ω³h/2 over one second
        text = (
            f"a body turns by {turn:.3g} rad a step: implicit Euler brakes what turns freely, by {100 * loss:.2g} % in the first "
            "second; take a smaller simulate.time_step"
        )
        more_tables = (*more_tables, Table("warnings", ("",), ((text,),)))
    return Output(
        datasets=datasets,
        summary=summary | said,
        message=f"{steps} steps of {h:g} s, {bench.system.size} coordinates, {bench.system.constrained} constraints held to "
        f"{position.max():.1e}" + (f"; good for loads up to {band:.3g} Hz" if first > 0 else ""),
        tables=(*sensors.table, *more_tables),
    )


def _violation(bench: Bench, found: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Largest |φ| and |Bv| of every instant."""
    if not bench.system.constrained:
        return np.zeros(len(found.time)), np.zeros(len(found.time))
    pairs = [constraints_at(bench.system, q) for q in found.q]
    position = np.array([np.abs(phi).max() for phi, _ in pairs])
    return position, np.array([np.abs(B @ v).max() for (_, B), v in zip(pairs, found.v, strict=True)])


def _refuse_tilted(bench: Bench, found: Trajectory) -> None:
    """Where a law takes the angle between axes to be small, they must stay nearly parallel, and not opposite."""
    for force in (element.force for element in bench.system.elements if element.force.aligned):
        together = readings(bench.system, [RelationSensor(force.name, force.aligned)])
        cosines = np.array([together.read(q, v)[0] for q, v in zip(found.q, found.v, strict=True)])
        for relation, cosine in zip(force.aligned, cosines.T, strict=True):
            worst = int(np.argmin(cosine))
            if cosine[worst] < np.cos(TILT):
                angle = float(np.arccos(np.clip(cosine[worst], -1, 1)))
                raise ConfigError(
                    f"{relation.name} are {angle:.3g} rad apart at t = {found.time[worst]:g} s, beyond {TILT:g} rad",
                    key=f"forces.{force.name}",
                    remedy="turn the frames so that their axes are parallel at rest; this force holds for small tilts",
                )


def _turn(bench: Bench, found: Trajectory, h: float) -> float:
    """Largest angle that any body turns in a step [rad]: ‖Ṙ‖/√2 is |ω|."""
    starts = [bench.system.of[name].start for name in bench.poses]
    spins = [np.linalg.norm(found.v[:, at + 3 : at + 12], axis=1).max() / np.sqrt(2) for at in starts]
    return float(h * max(spins, default=0.0))


SIMULATE = Stage(
    "simulate",
    version=1,
    reads=("bodies", "frames", "joints", "bearings", "forces", "sensors", "simulate"),
    upstream=("import", "reduce"),
    files=("forces.*.signal.file",),
    run=run,
)
