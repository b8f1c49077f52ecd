"""field: displacement, strain and stress of a flexible body's surface during a bench run, as a grid that ParaView plays."""

from __future__ import annotations

from strainsight.config.bench.bench import BenchConfig, SurfaceField
from strainsight.experiment.bench.reduction import BodyMotion, field_output
from strainsight.records.bench import BenchEstimated, Simulated
from strainsight.records.record import read
from strainsight.runner.output import Output
from strainsight.runner.stage import Context, Stage
from strainsight.stages.bench import inputs


def run(context: Context[BenchConfig]) -> Output:
    """Pictures of the simulated motion or of the estimated one."""
    settings = context.config.field
    assert settings is not None  # a bench without it has no such stage
    mesh, body = inputs.meshes(context)[settings.body], inputs.bodies(context)[settings.body]
    return field_output(context.config, mesh, body, _motion(settings, context), context)


def _motion(settings: SurfaceField, context: Context[object]) -> BodyMotion:
    """The body's coordinates, and the moduli where they were estimated."""
    simulated = read(Simulated, context.upstream["simulate"])
    part = slice(*simulated.coordinates[settings.body])
    if settings.of == "simulate":
        return BodyMotion(simulated.time, simulated.q[:, part], {})
    estimated = read(BenchEstimated, context.upstream["estimate"])
    moduli = {name: history.estimate for name, history in estimated.parameters.items()}
    return BodyMotion(estimated.time, estimated.q[:, part], moduli)


FIELD = Stage(
    "field", version=3, reads=("field", "bodies.*.moduli"), upstream=("import", "reduce", "simulate"), files=(), run=run
)
