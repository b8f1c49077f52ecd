"""spectrum: the modes of a validation's truth, where one material is scaled as a whole, so that shapes hold at any value."""

from __future__ import annotations

from strainsight.config.placement import PlacementConfig
from strainsight.experiment.structure.reduction import FILES, READS, spectrum_of
from strainsight.experiment.structure.references import WHAT_IS_FREE
from strainsight.experiment.structure.training import hertz
from strainsight.records.record import written
from strainsight.runner.output import Output
from strainsight.runner.stage import Context, Stage
from strainsight.stages import inputs


def run(context: Context[PlacementConfig]) -> Output:
    """The modes in the middle of the parameters' ranges, shared by all runs on one mesh."""
    found = spectrum_of(context.config, inputs.mesh(context), context)
    frequency, size = found.frequency, len(found.shape)
    message = "shapes change with the parameters: the modes of the truth are found with it"
    if len(frequency):
        band = f"{hertz(frequency[0], 2)} to {hertz(frequency[-1], 0)} Hz"
        message = f"{len(frequency)} modes of {size} unknowns, {band} in the middle of the ranges"
    return Output(written(found), {"unknowns": size, "modes": len(frequency)}, message)


SPECTRUM = Stage(
    "spectrum",
    version=6,
    reads=(*WHAT_IS_FREE, "validate.truth.modes", *READS),
    upstream=("import",),
    files=FILES,
    run=run,
)
