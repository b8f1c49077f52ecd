"""simulate: the bench in time, by two implicit stages a step or the thesis's stabilised implicit Euler (1.5-1.7)."""

from __future__ import annotations

from collections.abc import Mapping

from strainsight.config.bench.bench import BenchConfig, Simulate
from strainsight.experiment.bench.bearings import overloaded
from strainsight.experiment.bench.loads import doubtful_drives, load_units
from strainsight.experiment.bench.sensors import dataset_units
from strainsight.experiment.bench.simulation import Simulation, simulation
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
    config = context.config
    result = simulation(inputs.bench(context), context)
    record, system, h = result.record, result.bench.system, config.simulate.time_step
    steps, worst = len(record.time) - 1, float(record.violation.position.max())
    summary: dict[str, Scalar] = {
        "steps": steps,
        "coordinates": system.size,
        "constraints": system.constrained,
        "violation": worst,
        "violation_rate": float(record.violation.velocity.max()),
        "turn": result.turn,
        "parts": result.parts,
    }
    text = f"{steps} steps of {h:g} s, {system.size} coordinates, {system.constrained} constraints held to {worst:.1e}"
    if config.simulate.tolerance is not None:
        text += f", in up to {result.parts} parts each: the motion is right to {config.simulate.tolerance:g} of the coordinates"
    if len(record.frequency) and (first := float(record.frequency[0])) > 0:
        summary["first_frequency"] = first
    if "first_frequency" in summary and config.simulate.tolerance is None:
        summary["band"] = followed(record.frequency, h, config.simulate.method)
        text += f"; follows loads up to {summary['band']:.3g} Hz to {100 * SHARE:g} %"
        for name, load in record.inputs.items():
            summary[f"missed.{name}"] = float(missed(load[:, None], record.frequency, h, config.simulate.method)[0])
    summary |= {f"pressure.{name}": float(ring.pressure.max()) for name, ring in record.bearings.items()}
    doubts = _warnings(result, config, summary, doubtful_drives(config, context.files))
    return Output(
        datasets=written(record, dataset_units(config, load_units(config, system.inputs))),
        summary=summary,
        message=text,
        tables=(*(table for table in (_moved(result), _rings(result)) if table.rows), *warnings_table(doubts)),
    )


def _moved(result: Simulation) -> Table:
    rows = tuple(
        (name, str(i), f"{1e3 * distance:.3g} mm")
        for name, moved in result.sensors.moved.items()
        for i, distance in enumerate(moved, start=1)
    )
    return Table("gauges, moved to the surface by", ("sensor", "gauge", "moved"), rows)


def _rings(result: Simulation) -> Table:
    rows = []
    for name, ring in result.record.bearings.items():
        force = ring.worst.force
        balls = f"{int((force > 0).any(axis=1).sum())} of {len(force)}"
        rows.append((name, f"{ring.pressure.max() / 1e6:.5g} MPa", f"{ring.worst.time:.4g} s", balls))
    return Table("bearings at their highest pressure", ("bearing", "pressure", "at", "balls loaded"), tuple(rows))


def _warnings(result: Simulation, config: BenchConfig, summary: Mapping[str, Scalar], drives: list[str]) -> list[str]:
    doubts = [
        f"of {name} the step gets {100 * share:.2g} % wrong, what it has above {float(summary['band']):.3g} Hz; take a smaller "
        "simulate.time_step, or leave out what is so quick"
        for name in result.record.inputs
        if (share := float(summary.get(f"missed.{name}", 0.0))) > MISSED
    ]
    doubts += drives
    doubts += overloaded(config, {name: float(ring.pressure.max()) for name, ring in result.record.bearings.items()})
    settings = config.simulate
    free = result.bench.system.size > result.bench.system.constrained
    if free and settings.tolerance is None and result.turn > TURN[settings.method]:
        doubts.append(f"a body turns by {result.turn:.3g} rad a step: {_turning(result.turn, settings)}")
    return doubts


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
