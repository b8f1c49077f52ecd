"""simulate: the bench in time, by two implicit stages a step or the thesis's stabilised implicit Euler (1.5-1.7)."""

from __future__ import annotations

from strainsight.config.bench.bench import BenchConfig, Simulate
from strainsight.experiment.bench.bearings import overloaded
from strainsight.experiment.bench.loads import doubtful_drives, load_units
from strainsight.experiment.bench.sensors import dataset_units
from strainsight.experiment.bench.simulation import simulation
from strainsight.multibody.coupled import SHARE, followed, missed
from strainsight.multibody.step import GAIN, LAG
from strainsight.records.record import written
from strainsight.runner.output import Output, Scalar, Table, warnings_table
from strainsight.runner.stage import Context, Stage
from strainsight.stages.bench import inputs
from strainsight.stages.bench.inputs import HISTORIES

TURN = {"second_order": 0.1, "thesis": 0.01}
"""[rad] a step above which it shows in what turns freely."""

MISSED = 0.05
"""Share of a load that the step may get wrong before a warning says so."""


def run(context: Context[BenchConfig]) -> Output:
    """The bench in time, and up to which frequency it may be believed."""
    config, settings = context.config, context.config.simulate
    result = simulation(inputs.bench(context), context)
    record, system, h = result.record, result.bench.system, settings.time_step
    steps, worst = len(record.time) - 1, float(record.violation.position.max())
    pressure = {name: float(ring.pressure.max()) for name, ring in record.bearings.items()}
    summary: dict[str, Scalar] = {
        "steps": steps,
        "coordinates": system.size,
        "constraints": system.constrained,
        "violation": worst,
        "violation_rate": float(record.violation.velocity.max()),
        "turn": result.turn,
        "parts": result.parts,
        **{f"pressure.{name}": highest for name, highest in pressure.items()},
    }
    text = f"{steps} steps of {h:g} s, {system.size} coordinates, {system.constrained} constraints held to {worst:.1e}"
    if settings.tolerance is not None:
        text += (
            f", in up to {result.parts} parts each: the motion is right to {settings.tolerance:g} of the coordinates"
        )
    doubts = []
    if len(record.frequency) and record.frequency[0] > 0:
        summary["first_frequency"] = float(record.frequency[0])
        if settings.tolerance is None:
            band = summary["band"] = followed(record.frequency, h, settings.method)
            text += f"; follows loads up to {band:.3g} Hz to {100 * SHARE:g} %"
            for name, load in record.inputs.items():
                share = float(missed(load[:, None], record.frequency, h, settings.method)[0])
                summary[f"missed.{name}"] = share
                if share > MISSED:
                    doubts.append(
                        f"of {name} the step gets {100 * share:.2g} % wrong, what it has above {band:.3g} Hz; take a smaller "
                        "simulate.time_step, or leave out what is so quick"
                    )
    doubts += [*doubtful_drives(config, context.files), *overloaded(config, pressure)]
    if system.size > system.constrained and settings.tolerance is None and result.turn > TURN[settings.method]:
        doubts.append(f"a body turns by {result.turn:.3g} rad a step: {_turning(result.turn, settings)}")
    moved = tuple(
        (name, str(i), f"{1e3 * distance:.3g} mm")
        for name, on in result.sensors.bonded.items()
        for i, distance in enumerate(on.moved, start=1)
    )
    rings = []
    for name, ring in record.bearings.items():
        force = ring.worst.force
        balls = f"{int((force > 0).any(axis=1).sum())} of {len(force)}"
        rings.append((name, f"{pressure[name] / 1e6:.5g} MPa", f"{ring.worst.time:.4g} s", balls))
    tables = (
        Table("gauges, moved to the surface by", ("sensor", "gauge", "moved"), moved),
        Table("bearings at their highest pressure", ("bearing", "pressure", "at", "balls loaded"), tuple(rings)),
        *warnings_table(doubts),
    )
    return Output(
        datasets=written(record, dataset_units(config, load_units(config, system.inputs))),
        summary=summary,
        message=text,
        tables=tuple(table for table in tables if table.rows),
    )


def _turning(turn: float, settings: Simulate) -> str:
    h = settings.time_step
    if settings.method == "thesis":
        loss = 1 - (1 + turn**2 / h) ** -0.5  # of dω/dt = −ω³h/2 over one second
        what = f"implicit Euler brakes what turns freely, by {100 * loss:.2g} % in the first second"
    else:
        lag, gain = 100 * LAG * turn**2, 100 * GAIN * turn**4 / h
        what = f"what turns freely lags by {lag:.2g} % of its angle and gains {gain:.2g} % of its spin in a second"
    return f"{what}; take a smaller simulate.time_step"


SIMULATE = Stage(
    "simulate",
    version=5,
    reads=("bodies", "frames", "joints", "bearings", "forces", "sensors", "simulate"),
    upstream=("import", "reduce"),
    files=HISTORIES,
    run=run,
)
