"""rom: the finite-element model reduced to a few coordinates, affine in the parameters (5.1-5.10)."""

from __future__ import annotations

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.experiment.structure.reduction import FILES, READS, reduced_of
from strainsight.experiment.structure.references import WHAT_IS_FREE, WHERE_LOADS_ACT
from strainsight.experiment.structure.training import hertz
from strainsight.mesh.vtkhdf import unstructured_grid
from strainsight.records.mesh import vtkhdf_datasets
from strainsight.records.record import read, written
from strainsight.records.reduced import Modes
from strainsight.runner.output import Output, warnings_table
from strainsight.runner.stage import Context, Stage
from strainsight.stages import inputs


def run(context: Context[PlacementConfig]) -> Output:
    """The reduced model, with the modes of the full one as steps of a grid."""
    mesh, modes = inputs.mesh(context), context.config.rom.modes
    reduced = reduced_of(context.config, mesh, read(Modes, context.upstream["modes"]), context)
    shapes = reduced.basis[:, :modes].reshape(len(mesh.node_ids), 3, -1)
    points = {"mode": np.moveaxis(shapes, 2, 0)}
    grid, attributes = vtkhdf_datasets(
        unstructured_grid(mesh.position, mesh.elements, point_data=points, steps=reduced.frequency)
    )
    worst = float(max(np.max(np.abs(reduced.error.frequency)), np.max(reduced.error.static)))
    size, first = len(reduced.static), float(reduced.frequency[0])
    other = reduced.results or reduced.matrices
    source = "the results of the other program" if reduced.results else "the ready matrices"
    return Output(
        datasets=written(reduced) | grid,
        attributes=attributes,
        summary={
            "unknowns": size,
            "modes": modes,
            "first_frequency": first,
            "basis_size": reduced.model.size,
            "projection_error": worst,
        },
        message=f"{size} unknowns → {reduced.model.size}, first mode {hertz(first, 2)} Hz, held-out error {worst:.1e}",
        tables=warnings_table([f"{source}: {text}" for text in other.notes] if other else ()),
    )


ROM = Stage(
    "rom",
    version=10,
    reads=(*WHAT_IS_FREE, "parameters.*.guess", *WHERE_LOADS_ACT, "damping", "rom", "train.model", *READS),
    upstream=("import", "modes"),
    files=("parameters.*.guess.from", *FILES),
    run=run,
)
