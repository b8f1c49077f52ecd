"""modes: natural frequencies and shapes of the whole model at the reference, whatever loads it."""

from __future__ import annotations

from strainsight.cases.structure.full_model import FILES, READS, full_model
from strainsight.cases.structure.scales import hertz
from strainsight.cases.structure.settings import parameters_of
from strainsight.errors import blame
from strainsight.fem.modes import modes as lowest_modes
from strainsight.records.mesh import mesh_from
from strainsight.records.record import written
from strainsight.records.reduced import Modes
from strainsight.workflow.output import Output, Table
from strainsight.workflow.stage import Context, Stage


def run(context: Context) -> Output:
    """Assemble, constrain, factorise, iterate: K φ = ω² M φ. Runs that differ in their loads alone share the result."""
    config = context.config
    mesh = mesh_from(context.upstream["import"])
    parameters = parameters_of(config.parameters, mesh, context.files, config.mesh.matrices)
    context.progress("assembly", 0.0)
    model = full_model(config.mesh, mesh, parameters, context.files).model
    reference = {p.name: p.reference for p in parameters}
    count = config.rom.modes
    context.progress(f"{count} modes of {model.size} unknowns", 0.2)
    with blame("rom.modes"):
        frequency, shape = lowest_modes(model.stiffness.at(reference), model.mass.at(reference), count)
    values = ", ".join(f"{name} = {value:.6g}" for name, value in reference.items()) or "the deck"
    return Output(
        datasets=written(Modes(frequency=frequency, shape=shape)),
        summary={"unknowns": model.size, "modes": count, "first": float(frequency[0]), "last": float(frequency[-1])},
        message=f"{count} modes of {model.size} unknowns, {hertz(frequency[0], 2)} to {hertz(frequency[-1], 0)} Hz",
        tables=(
            Table(
                f"natural frequencies at {values}",
                ("mode", "Hz"),
                tuple((str(i), hertz(f, 3)) for i, f in enumerate(frequency, start=1)),
            ),
        ),
    )


MODES = Stage(
    "modes",
    version=2,
    reads=(
        "parameters.*.property",
        "parameters.*.region",
        "parameters.*.guess",
        "parameters.*.range",
        "rom.modes",
        *READS,
    ),
    upstream=("import",),
    files=("parameters.*.guess.from", *FILES),
    run=run,
)
