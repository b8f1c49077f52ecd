"""simulate: the bench in time by stabilised implicit Euler (thesis 1.5-1.7)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from strainsight.errors import blame
from strainsight.multibody.initial import constraints_at
from strainsight.multibody.sensors import Readings, StrainSensor, readings
from strainsight.multibody.simulate import Trajectory, simulate
from strainsight.multibody.spectrum import coupled_frequencies
from strainsight.signals.histories import evaluate
from strainsight.stages.bench.case import Bench, bench_of, motion_sensor, strain_sensor
from strainsight.stages.bench.rings import rings_in_time
from strainsight.stages.bench.start import start_of
from strainsight.stages.case.settings import signal_of
from strainsight.stages.records.below import Below
from strainsight.stages.records.bodies import ReducedBody, body_from
from strainsight.stages.records.mesh import mesh_from
from strainsight.workflow.output import Dataset, Output, Scalar, Table
from strainsight.workflow.stage import Context, Stage

FEWEST_STEPS_A_PERIOD = 20
TURN = 0.01
"""[rad] a step above which implicit Euler visibly brakes what turns freely."""
MOTION_UNITS = {"position": "m", "velocity": "m/s"}
BAND = 0.1
"""Share of the first coupled frequency up to which implicit Euler follows a load."""


def run(context: Context) -> Output:
    """Assemble the bench, bring it to its start, step through the loads, read the sensors."""
    config = context.config
    flexible = [name for name, body in config.bodies.items() if body.type == "flexible"]
    reduced = {name: body_from(context.upstream["reduce"], name) for name in flexible}
    meshes = {name: mesh_from(Below(context.upstream["import"], f"/bodies/{name}")) for name in flexible}
    bench = bench_of(config, reduced, meshes)
    h, steps = float(config.simulate.time_step), round(config.simulate.duration / config.simulate.time_step)
    time = h * np.arange(steps + 1)
    u = _loads(context, bench, time)
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
    sensors, zeroed, tables = _sensors(config, bench, reduced, meshes)
    measured = np.array([sensors.read(q, v)[0] for q, v in zip(found.q, found.v, strict=True)])
    measured = measured - np.where(zeroed, measured[0], 0.0)
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
    datasets |= _readings(config, sensors, measured)
    summary: dict[str, Scalar] = {
        "steps": steps,
        "coordinates": bench.system.size,
        "constraints": bench.system.constrained,
        "violation": float(position.max()),
        "violation_rate": float(velocity.max()),
    }
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
        tables=(*tables, *more_tables),
    )


def _loads(context: Context, bench: Bench, time: np.ndarray) -> np.ndarray:
    """Inputs (T + 1, nu) in the order of the system."""
    columns = []
    for name in bench.system.inputs:
        with blame(f"forces.{name}.signal"):
            signal = signal_of(name, context.config.forces[name].signal, context.files, "forces")
            columns.append(evaluate(signal, time))
    return np.column_stack(columns) if columns else np.zeros((len(time), 0))


def _sensors(
    config: Any, bench: Bench, reduced: Mapping[str, ReducedBody], meshes: Mapping[str, Any]
) -> tuple[Readings, np.ndarray, tuple[Table, ...]]:
    """The sensors compiled, which channels are zeroed at the start (k,), and where gauges went."""
    strains, others, zeroed, rows = [], [], [], []
    for name, entry in config.sensors.items():
        if entry.type != "strain":
            others.append(motion_sensor(name, entry, bench.frames))
            continue
        sensor, moved = strain_sensor(name, entry, reduced[entry.body], meshes[entry.body])
        strains.append(sensor)
        zeroed += [bool(entry.zeroed)] * len(sensor.rows)
        rows += [(name, str(i), f"{1e3 * distance:.3g} mm") for i, distance in enumerate(moved, start=1)]
    compiled = readings(bench.system, [*strains, *others])
    still = np.zeros(len(compiled.channels), dtype=bool)
    still[: len(zeroed)] = zeroed
    return (
        compiled,
        still,
        (Table("gauges, moved to the surface by", ("sensor", "gauge", "moved"), tuple(rows)),) * bool(rows),
    )


def _readings(config: Any, sensors: Readings, measured: np.ndarray) -> dict[str, Dataset]:
    datasets, at = {}, 0
    for sensor in sensors.sensors:
        count = len(sensor.rows) if isinstance(sensor, StrainSensor) else len(sensor.relations)
        part = measured[:, at : at + count]
        at += count
        entry = config.sensors[sensor.name]
        unit, what = {
            "strain": ("strain", "strain of every gauge (time × gauge)"),
            "relative": ("m or rad", "displacements x, y, z and tilts about y, z (time × component)"),
            "motion": (
                MOTION_UNITS.get(entry.get("quantity"), "1"),
                f"{entry.get('quantity')} in global axes (time × xyz)",
            ),
        }[entry.type]
        datasets[f"/sensors/{sensor.name}"] = Dataset(part, unit, what, ("/time", ""))
    return datasets


def _violation(bench: Bench, found: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Largest |φ| and |Bv| of every instant."""
    if not bench.system.constrained:
        return np.zeros(len(found.time)), np.zeros(len(found.time))
    pairs = [constraints_at(bench.system, q) for q in found.q]
    position = np.array([np.abs(phi).max() for phi, _ in pairs])
    return position, np.array([np.abs(B @ v).max() for (_, B), v in zip(pairs, found.v, strict=True)])


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
