"""simulate: the bench in time by stabilised implicit Euler (thesis 1.5-1.7)."""

from __future__ import annotations

from strainsight.cases.bench.loads import load_units
from strainsight.cases.bench.sensors import dataset_units
from strainsight.cases.bench.simulation import Simulation, simulation
from strainsight.config.bench.bench import BenchConfig
from strainsight.records.record import written
from strainsight.stages.bench import inputs
from strainsight.workflow.output import Output, Scalar, Table
from strainsight.workflow.stage import Context, Stage

FEWEST_STEPS_A_PERIOD = 20
TURN = 0.01
"""[rad] a step above which implicit Euler visibly brakes what turns freely."""
BAND = 0.1
"""Share of the first coupled frequency up to which implicit Euler follows a load."""


def run(context: Context[BenchConfig]) -> Output:
    """The bench in time, and up to which frequency it may be believed."""
    config = context.config
    own = simulation(config, inputs.bodies(context), inputs.meshes(context), inputs.placed(context), context)
    found, system, h = own.found, own.bench.system, config.simulate.time_step
    steps, worst = len(found.time) - 1, float(found.violation.position.max())
    summary: dict[str, Scalar] = {
        "steps": steps,
        "coordinates": system.size,
        "constraints": system.constrained,
        "violation": worst,
        "violation_rate": float(found.violation.velocity.max()),
        "turn": own.turn,
    }
    text = f"{steps} steps of {h:g} s, {system.size} coordinates, {system.constrained} constraints held to {worst:.1e}"
    if len(found.frequency) and (first := float(found.frequency[0])) > 0:
        summary |= {"first_frequency": first, "band": min(BAND * first, 1 / (FEWEST_STEPS_A_PERIOD * h))}
        text += f"; good for loads up to {summary['band']:.3g} Hz"
    summary |= {f"pressure.{name}": float(ring.pressure.max()) for name, ring in found.bearings.items()}
    return Output(
        datasets=written(found, dataset_units(config, load_units(config, system.inputs))),
        summary=summary,
        message=text,
        tables=tuple(table for table in (_moved(own), _rings(own), _warnings(own, h)) if table.rows),
    )


def _moved(own: Simulation) -> Table:
    rows = tuple(
        (name, str(i), f"{1e3 * distance:.3g} mm")
        for name, moved in own.sensors.moved.items()
        for i, distance in enumerate(moved, start=1)
    )
    return Table("gauges, moved to the surface by", ("sensor", "gauge", "moved"), rows)


def _rings(own: Simulation) -> Table:
    rows = []
    for name, ring in own.found.bearings.items():
        force = ring.worst.force
        balls = f"{int((force > 0).any(axis=1).sum())} of {len(force)}"
        rows.append((name, f"{ring.pressure.max() / 1e6:.5g} MPa", f"{ring.worst.time:.4g} s", balls))
    return Table("bearings at their highest pressure", ("bearing", "pressure", "at", "balls loaded"), tuple(rows))


def _warnings(own: Simulation, h: float) -> Table:
    if own.turn <= TURN:
        return Table("warnings", ("",), ())
    loss = 1 - (1 + own.turn**2 / h) ** -0.5  # of dω/dt = −ω³h/2 over one second
    text = (
        f"a body turns by {own.turn:.3g} rad a step: implicit Euler brakes what turns freely, by {100 * loss:.2g} % in the first "
        "second; take a smaller simulate.time_step"
    )
    return Table("warnings", ("",), ((text,),))


SIMULATE = Stage(
    "simulate",
    version=2,
    reads=("bodies", "frames", "joints", "bearings", "forces", "sensors", "simulate"),
    upstream=("import", "reduce"),
    files=("forces.*.signal.file",),
    run=run,
)
