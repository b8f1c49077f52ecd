"""rom: the finite-element model reduced to a few coordinates, affine in the parameters (5.1-5.10)."""

from __future__ import annotations

import numpy as np

from strainsight.cases.structure.full_model import FILES, READS, full_model
from strainsight.cases.structure.scales import hertz, refuse_damping
from strainsight.cases.structure.settings import damping_of, load_shapes, parameters_of
from strainsight.errors import blame
from strainsight.fem.model import nodal
from strainsight.mesh.vtkhdf import unstructured_grid
from strainsight.records.grids import vtkhdf_datasets
from strainsight.records.mesh import mesh_from
from strainsight.records.record import read, written
from strainsight.records.reduced import HeldOut, Modes, ReadyBasis, Reduced
from strainsight.rom.reduction import held_out_errors, reduce_model
from strainsight.rom.samples import held_out_samples
from strainsight.sweep.sweep import watched
from strainsight.workflow.output import Output, Table
from strainsight.workflow.stage import Context, Stage

HELD_OUT = 3
"""Parameter values, between those the basis was built from, at which the reduced model is checked."""


def run(context: Context) -> Output:
    """Assemble, constrain, find the static responses (and the modes off the reference), project, check at held-out values."""
    config = context.config
    mesh = mesh_from(context.upstream["import"])
    parameters = parameters_of(config.parameters, mesh, context.files, config.mesh.matrices)
    context.progress("assembly", 0.0)
    built = full_model(config.mesh, mesh, parameters, context.files)
    model = built.model
    S = load_shapes(model, config.loads)
    reference = {p.name: p.reference for p in parameters}
    ranges = {name: entry.range for name, entry in config.parameters.items()}
    context.progress("static responses", 0.2)
    modes = read(Modes, context.upstream["modes"])
    with blame("rom.modes"):
        reduction = reduce_model(
            model,
            S,
            tuple(config.loads),
            reference,
            ranges,
            config.rom.modes,
            config.rom.parameter_samples,
            config.rom.tolerance,
            damping_of(config.damping),
            (modes.frequency, modes.shape),
            watched(context.sweep, lambda share: context.progress("parameter samples", 0.2 + 0.5 * share)),
        )
    refuse_damping(reduction.model.damping, reduction.frequency)
    context.progress("held-out errors", 0.7)
    watch = watched(context.sweep, lambda share: context.progress("held-out errors", 0.7 + 0.3 * share))
    held_out = held_out_errors(model, S, reduction, held_out_samples(reference, ranges, HELD_OUT), watch)
    basis = nodal(model, reduction.basis)
    shapes = basis[:, : config.rom.modes].reshape(len(mesh.node_ids), 3, -1)
    grid, grid_attributes = vtkhdf_datasets(
        unstructured_grid(
            mesh.position, mesh.blocks, point_data={"mode": np.moveaxis(shapes, 2, 0)}, steps=reduction.frequency
        )
    )
    matrices = (
        None if built.motion is None else ReadyBasis(basis=built.motion @ reduction.basis, notes=tuple(built.notes))
    )
    tried = np.array([[point[name] for name in reference] for point in held_out.theta])
    reduced = Reduced(
        model=reduction.model,
        frequency=reduction.frequency,
        basis=basis,
        static=reduction.static,
        error=HeldOut(
            parameters=tried.reshape(len(held_out.theta), -1), frequency=held_out.frequency, static=held_out.static
        ),
        matrices=matrices,
    )
    worst = float(max(np.max(np.abs(held_out.frequency)), np.max(held_out.static)))
    return Output(
        datasets=written(reduced) | grid,
        attributes=grid_attributes,
        summary={
            "unknowns": model.size,
            "modes": config.rom.modes,
            "first_frequency": float(reduction.frequency[0]),
            "basis_size": reduction.model.size,
            "projection_error": worst,
        },
        message=f"{model.size} unknowns → {reduction.model.size}, first mode {hertz(reduction.frequency[0], 2)} Hz, "
        f"held-out error {worst:.1e}",
        tables=(Table("the ready matrices", ("warning",), tuple((text,) for text in built.notes)),) * bool(built.notes),
    )


ROM = Stage(
    "rom",
    version=4,
    reads=(
        "parameters.*.property",
        "parameters.*.region",
        "parameters.*.guess",
        "parameters.*.range",
        "loads.*.node",
        "loads.*.set",
        "loads.*.deck_load",
        "loads.*.direction",
        "damping",
        "rom",
        *READS,
    ),
    upstream=("import", "modes"),
    files=("parameters.*.guess.from", *FILES),
    run=run,
)
