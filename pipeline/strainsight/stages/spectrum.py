"""spectrum: the modes of a validation's truth, where one material is scaled as a whole and their shapes hold at any value."""

from __future__ import annotations

import numpy as np

from strainsight.cases.structure.full_model import FILES, READS, full_model
from strainsight.cases.structure.scales import hertz
from strainsight.cases.structure.settings import named_regions
from strainsight.config.placement import PlacementConfig
from strainsight.errors import blame
from strainsight.fem.affine import Parameter
from strainsight.fem.modes import modes as lowest_modes
from strainsight.mesh.additions import region_ids
from strainsight.mesh.model import Mesh
from strainsight.records.mesh import mesh_from
from strainsight.records.record import written
from strainsight.records.reduced import Modes
from strainsight.rom.snapshots import only_scales
from strainsight.workflow.output import Output
from strainsight.workflow.stage import Context, Stage


def run(context: Context) -> Output:
    """K φ = ω² M φ in the middle of the parameters' ranges, whatever is guessed or true: runs on one mesh share the result.

    Where two materials vary apart there is nothing to share: the truth is then solved for at its own values, by `validate`.
    """
    config = context.config
    mesh = mesh_from(context.upstream["import"])
    parameters = _in_the_middle(config, mesh)
    context.progress("assembly", 0.0)
    model = full_model(config.mesh, mesh, parameters, context.files).model
    frequency, shape = np.zeros(0), np.zeros((model.size, 0))
    said = "two materials vary apart: the modes of the truth are found with it"
    if only_scales(model):
        theta = {p.name: p.reference for p in parameters}
        count = config.validation.truth.modes
        context.progress(f"{count} modes of {model.size} unknowns", 0.2)
        with blame("validate.truth.modes"):
            frequency, shape = lowest_modes(model.stiffness.at(theta), model.mass.at(theta), count)
        lowest, highest = hertz(frequency[0], 2), hertz(frequency[-1], 0)
        said = f"{count} modes of {model.size} unknowns, {lowest} to {highest} Hz amid the ranges"
    return Output(
        datasets=written(Modes(frequency=frequency, shape=shape)),
        summary={"unknowns": model.size, "modes": len(frequency)},
        message=said,
    )


def _in_the_middle(config: PlacementConfig, mesh: Mesh) -> tuple[Parameter, ...]:
    """The free material properties at the geometric mean of their ranges."""
    found = []
    for name, entry in config.parameters.items():
        regions: tuple[int, ...] = ()
        if config.mesh.matrices is None:
            with blame(f"parameters.{name}.region"):
                regions = region_ids(mesh, named_regions(entry.region))
        found.append(Parameter(name, entry.property, regions, float(np.sqrt(entry.range[0] * entry.range[1]))))
    return tuple(found)


SPECTRUM = Stage(
    "spectrum",
    version=2,
    reads=(
        "parameters.*.property",
        "parameters.*.region",
        "parameters.*.range",
        "validate.truth.modes",
        *READS,
    ),
    upstream=("import",),
    files=FILES,
    run=run,
)
