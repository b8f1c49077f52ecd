"""modes: natural frequencies and shapes of the whole model at the reference, whatever loads it."""

from __future__ import annotations

from typing import Any

from strainsight.errors import blame
from strainsight.fem.model import FiniteElementModel
from strainsight.fem.modes import modes as lowest_modes
from strainsight.rom.snapshots import only_scales
from strainsight.stages.case.full_model import FILES, READS, full_model
from strainsight.stages.case.settings import parameters_of
from strainsight.stages.records.mesh import mesh_from
from strainsight.workflow.output import Dataset, Output, Table
from strainsight.workflow.stage import Context, Stage


def run(context: Context) -> Output:
    """Assemble, constrain, factorise, iterate: K φ = ω² M φ. Runs that differ in their loads alone share the result."""
    config = context.config
    mesh = mesh_from(context.upstream["import"])
    parameters = parameters_of(config.parameters, mesh, context.files, config.mesh.matrices)
    context.progress("assembly", 0.0)
    model = full_model(config, mesh, parameters, context.files).model
    reference = {p.name: p.reference for p in parameters}
    count, key = _wanted(config, model)
    context.progress(f"{count} modes of {model.size} unknowns", 0.2)
    with blame(key):
        frequency, shape = lowest_modes(model.stiffness.at(reference), model.mass.at(reference), count)
    values = ", ".join(f"{name} = {value:.6g}" for name, value in reference.items()) or "the deck"
    return Output(
        datasets={
            "/frequency": Dataset(frequency, "Hz", "natural frequencies of the full model at the reference"),
            "/shape": Dataset(
                shape, "kg^-1/2", "mass-normalised shapes on the free unknowns (unknown × mode)", ("", "/frequency")
            ),
        },
        summary={"unknowns": model.size, "modes": count, "first": float(frequency[0]), "last": float(frequency[-1])},
        message=f"{count} modes of {model.size} unknowns, {frequency[0]:.2f} to {frequency[-1]:.0f} Hz",
        tables=(
            Table(
                f"natural frequencies at {values}",
                ("mode", "Hz"),
                tuple((str(i), f"{f:.3f}") for i, f in enumerate(frequency[: config.rom.modes], start=1)),
            ),
        ),
    )


def _wanted(config: Any, model: FiniteElementModel) -> tuple[int, str]:
    """How many, and the key that asks for them: the truth's modes too where they have these shapes at any parameter."""
    own, truth = int(config.rom.modes), int(config.validate.truth.modes)
    if truth > own and only_scales(model):
        return truth, "validate.truth.modes"
    return own, "rom.modes"


MODES = Stage(
    "modes",
    version=1,
    reads=(
        "parameters.*.property",
        "parameters.*.region",
        "parameters.*.guess",
        "parameters.*.range",
        "rom.modes",
        "validate.truth.modes",
        *READS,
    ),
    upstream=("import",),
    files=("parameters.*.guess.from", *FILES),
    run=run,
)
