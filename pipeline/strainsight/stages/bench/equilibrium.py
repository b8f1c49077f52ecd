"""statics and modes: a bench in its equilibrium, its coupled modes and its state space; on demand, no stage of a run."""

from __future__ import annotations

import io

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.errors import InfeasibleError
from strainsight.experiment.bench.bearings import overloaded
from strainsight.experiment.bench.bench import unstable_in_words
from strainsight.experiment.bench.sensors import dataset_units
from strainsight.experiment.bench.simulation import BenchAtRest, at_rest, coupled, modes_in_space, rest_of
from strainsight.records.bench import Coupled
from strainsight.records.mesh import vtkhdf_datasets
from strainsight.records.record import written
from strainsight.runner.output import Output, Table, warnings_table
from strainsight.runner.stage import Context, Stage
from strainsight.stages.bench import inputs
from strainsight.stages.bench.inputs import HISTORIES

LISTED = 20
"""Most modes that are listed."""
ROUNDING = 1e-12
"""Share of the largest number of its kind, below which one in a table is none."""


def statics(context: Context[BenchConfig]) -> Output:
    """Equilibrium of the bench under the loads at t = 0, with fixed drives, and its joint, drive and bearing loads."""
    config, rest = context.config, rest_of(inputs.bench(context), context, balanced=True)
    unstable = [unstable_in_words(rest.growth, rest.body)] if rest.growth > 0 else []
    if unstable and not config.simulate.allow_unstable:
        remedy = "set the initial poses (`pose` of each body) close to a stable equilibrium, or set simulate.allow_unstable: true"
        raise InfeasibleError(unstable[0], key="simulate", remedy=remedy)
    record = at_rest(rest)
    carried = max((float(np.abs(six).max()) for six in record.reactions.values()), default=0.0)
    far = max(float(np.abs(frame.position).max()) for frame in record.frames.values())
    pressed = {name: ring.pressure for name, ring in record.bearings.items()}
    loads = [
        (name, *(_digits(value, 5, carried) for value in values), unit)
        for name, six in record.reactions.items()
        for values, unit in ((six[:3], "N"), (six[3:], "N m"))
    ]
    where = [(name, *(_digits(value, 6, far) for value in frame.position)) for name, frame in record.frames.items()]
    drives = [(name, _digits(force, 6, carried)) for name, force in record.drives.items()]
    rings = [(name, f"{pressure / 1e6:.5g} MPa") for name, pressure in pressed.items()]
    tables = (
        Table("positions of the frame origins in equilibrium, global axes [m]", ("frame", "x", "y", "z"), tuple(where)),
        Table(
            "joint loads on the second frame of each joint, in the axes of its first frame",
            ("joint", "x", "y", "z", "unit"),
            tuple(loads),
        ),
        Table("drives [N or N m]", ("drive", "force"), tuple(drives)),
        Table("bearings", ("bearing", "highest contact pressure"), tuple(rings), answer=True),
        *warnings_table([*overloaded(config, pressed), *unstable]),
    )
    state = f"unstable, growth rate {rest.growth:.3g} 1/s" if unstable else "stable"
    first = next((float(f) for f in rest.modes.frequency if f > 0), 0.0)
    lowest = f", lowest natural frequency {first:.4g} Hz" if first else ""
    return Output(
        datasets=written(record, dataset_units(config, record.inputs)),
        summary={"coordinates": len(record.q), "growth": rest.growth, "first_frequency": first}
        | {f"pressure.{name}": pressure for name, pressure in pressed.items()}
        | {f"force.{name}": force for name, force in record.drives.items()},
        message=f"equilibrium of {len(record.q)} generalised coordinates, {state}{lowest}",
        tables=tuple(table for table in tables if table.rows),
    )


def _digits(value: float, count: int, largest: float) -> str:
    """A table entry, with 0 for numbers at rounding level of the largest."""
    return f"{value if abs(value) > ROUNDING * largest else 0.0:.{count}g}"


def modes(context: Context[BenchConfig]) -> Output:
    """The bench in small motion about its start: frequencies, damping, shapes in space, and the state space."""
    rest = rest_of(inputs.bench(context), context, balanced=False)
    record = coupled(rest)
    grid, attributes = vtkhdf_datasets(modes_in_space(rest)) if len(record.frequency) else ({}, {})
    rows = [_row(rest, record, k) for k in range(min(LISTED, len(record.frequency)))]
    oscillating = record.frequency[record.frequency > 0]
    text = f"{len(record.frequency)} coupled mode{'s' * (len(record.frequency) != 1)}"
    text += f", {oscillating[0]:.4g} to {oscillating[-1]:.4g} Hz" if len(oscillating) else ""
    free, topples = int(np.sum(record.stiffness == 0)), int(np.sum(record.stiffness < 0))
    text += f"; {free} mode{'s' * (free != 1)} without stiffness (0 Hz)" * (free > 0)
    text += f"; unstable, growth rate {rest.growth:.3g} 1/s" * (rest.growth > 0)
    return Output(
        datasets=written(record) | grid,
        attributes=attributes,
        summary={
            "modes": len(record.frequency),
            "free": free,
            "toppling": topples,
            "growth": rest.growth,
            **({"first": float(oscillating[0]), "last": float(oscillating[-1])} if len(oscillating) else {}),
        },
        message=text,
        tables=(Table("coupled modes", ("mode", "Hz", "damping", "largest motion"), tuple(rows)),) if rows else (),
        files={"modes.npz": _arrays(record)},
    )


def _row(rest: BenchAtRest, record: Coupled, k: int) -> tuple[str, str, str, str]:
    frequency = f"{record.frequency[k]:.5g}" if record.stiffness[k] >= 0 else "topples"
    motion = rest.bench.system.metric * record.shape[k]
    body = max(record.coordinates, key=lambda name: float(np.linalg.norm(motion[slice(*record.coordinates[name])])))
    return str(k + 1), frequency, f"{100 * record.damping[k]:.3g} %", body


def _arrays(record: Coupled) -> bytes:
    """modes.npz: A, B, C, D with the names of inputs and outputs, frequencies and shapes, for NumPy alone."""
    system, file = record.system, io.BytesIO()
    arrays = {key: getattr(system, key) for key in "ABCD"}
    arrays |= {key: np.array(getattr(system, key), dtype=str) for key in ("inputs", "outputs")}
    arrays |= {key: getattr(record, key) for key in ("frequency", "damping", "shape", "q")}
    np.savez(file, **arrays)
    return file.getvalue()


READS = ("bodies", "frames", "joints", "bearings", "forces", "sensors", "simulate")
STATICS = Stage("statics", version=4, reads=READS, upstream=("import", "reduce"), files=HISTORIES, run=statics)
MODES = Stage("modes", version=3, reads=READS, upstream=("import", "reduce"), files=HISTORIES, run=modes)
