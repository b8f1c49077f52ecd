"""rom, modes and spectrum: reduced-order model, affine in the parameters (5.1-5.10); modes of the full model at the reference and
at the centre of the parameter ranges."""

from __future__ import annotations

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.experiment.structure.reduction import modes_of, reduced_of, spectrum_of
from strainsight.experiment.structure.references import reference_value
from strainsight.experiment.structure.training import hertz
from strainsight.mesh.vtkhdf import unstructured_grid
from strainsight.records.mesh import vtkhdf_datasets
from strainsight.records.record import read, written
from strainsight.records.reduced import Modes
from strainsight.runner.output import Output, Table, warnings_table
from strainsight.runner.stage import Context
from strainsight.stages import inputs


def run_rom(context: Context[PlacementConfig]) -> Output:
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
    source = "imported results" if reduced.results else "imported matrices"
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
        message=f"{size} degrees of freedom reduced to {reduced.model.size}, first mode {hertz(first, 2)} Hz, "
        f"largest relative error of the reduced model (frequencies, static responses) {worst:.1e}",
        tables=warnings_table([f"{source}: {text}" for text in other.notes] if other else ()),
    )


def run_modes(context: Context[PlacementConfig]) -> Output:
    """The lowest modes; runs that differ in their loads alone share the result."""
    config = context.config
    modes = modes_of(config, inputs.mesh(context), context)
    frequency, size = modes.frequency, len(modes.shape)
    guesses = {name: reference_value(name, entry.guess, context.files) for name, entry in config.parameters.items()}
    values = ", ".join(f"{name} = {value:.6g}" for name, value in guesses.items())
    return Output(
        datasets=written(modes),
        summary={"unknowns": size, "modes": len(frequency), "first": float(frequency[0]), "last": float(frequency[-1])},
        message=f"{len(frequency)} modes of {size} degrees of freedom, {hertz(frequency[0], 2)} to {hertz(frequency[-1], 0)} Hz",
        tables=(
            Table(
                f"natural frequencies with {values}"
                if guesses
                else "natural frequencies with the material data of the deck",
                ("mode", "Hz"),
                tuple((str(i), hertz(f, 3)) for i, f in enumerate(frequency, start=1)),
            ),
        ),
    )


def run_spectrum(context: Context[PlacementConfig]) -> Output:
    """The modes in the middle of the parameters' ranges, shared by all runs on one mesh."""
    spectrum = spectrum_of(context.config, inputs.mesh(context), context)
    frequency, size = spectrum.frequency, len(spectrum.shape)
    message = "no modes stored, because they depend on the parameters; the stage validate computes those of the simulated test"
    if len(frequency):
        band = f"{hertz(frequency[0], 2)} to {hertz(frequency[-1], 0)} Hz"
        message = f"{len(frequency)} modes of {size} degrees of freedom, {band} at the centre of the parameter ranges"
    return Output(written(spectrum), {"unknowns": size, "modes": len(frequency)}, message)
