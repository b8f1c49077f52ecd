"""field: displacement, strain and stress of a flexible body's surface during a bench run, as a grid that ParaView plays."""

from __future__ import annotations

from strainsight.config.bench.bench import BenchConfig, SurfaceField
from strainsight.experiment.bench.reduction import BodyMotion, pictures
from strainsight.records.bench import BenchEstimated, Simulated
from strainsight.records.mesh import vtkhdf_datasets
from strainsight.records.record import read, written
from strainsight.runner.output import Output
from strainsight.runner.stage import Context, Stage
from strainsight.stages.bench import inputs


def run(context: Context[BenchConfig]) -> Output:
    """Pictures of the simulated motion or of the estimated one."""
    config, settings = context.config, context.config.field
    assert settings is not None  # a bench without it has no such stage
    name, motion = settings.body, _motion(settings, context)
    own = pictures(config, inputs.meshes(context)[name], inputs.bodies(context)[name], motion, context)
    grid, attributes = vtkhdf_datasets(own.grid)
    count, largest, instant = len(own.record.time), float(own.record.von_mises.max()), float(own.record.time[own.worst])
    return Output(
        datasets=grid | written(own.record),
        attributes=attributes,
        summary={
            "pictures": count,
            "facets": own.facets,
            "von_mises": largest,
            "time": instant,
            "element": own.element,
        },
        message=f"{name}: {count} pictures of {own.facets} facets, at most {largest / 1e6:.4g} MPa von Mises at "
        f"t = {instant:.4g} s in element {own.element}",
    )


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
