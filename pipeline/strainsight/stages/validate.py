"""validate: the chosen gauges put to the test on a truth that is not the filter's model (thesis 6.1)."""

from __future__ import annotations

from strainsight.config.placement import PlacementConfig
from strainsight.experiment.structure.validation import validation_of, validation_output
from strainsight.runner.output import Output
from strainsight.runner.stage import Context
from strainsight.stages import inputs


def run(context: Context[PlacementConfig]) -> Output:
    """The validation, with the strain of every candidate as points of a grid."""
    structure, spectrum, screened = inputs.structure(context), inputs.spectrum(context), inputs.screened(context)
    validation = validation_of(structure, spectrum, screened, inputs.layout(context), context)
    return validation_output(structure, validation)
