"""validate: the chosen gauges put to the test on a truth that is not the filter's model (thesis 6.1)."""

from __future__ import annotations

import numpy as np

from strainsight.config.placement import PlacementConfig
from strainsight.estimation.decision import WITHHELD, claims_of
from strainsight.experiment.filters_compared import comparison_table
from strainsight.experiment.layout.advice import budget_tables
from strainsight.experiment.layout.gauge_list import layout_labels
from strainsight.experiment.structure.reduction import FILES, READS
from strainsight.experiment.structure.studies import sweep_table
from strainsight.experiment.structure.validation import (
    measured_csv,
    validated_without_sigma,
    validation_decision,
    validation_message,
    validation_numbers,
    validation_of,
    validation_table,
)
from strainsight.records.mesh import STRAIN as STRAIN_UNIT
from strainsight.records.mesh import gauge_grid
from strainsight.records.record import written
from strainsight.runner.output import Output
from strainsight.runner.stage import Context, Stage
from strainsight.sensors.candidates import STRAIN
from strainsight.stages import inputs

OF_SIGMA = ("std", "smoothed_std", "ratio", "rank_claimed", "rank_correlation")
"""Numbers of the summary that σ is in."""


def run(context: Context[PlacementConfig]) -> Output:
    """The validation, with the strain of every candidate as points of a grid."""
    config, structure = context.config, inputs.structure(context)
    training, spectrum, screened = structure.training, inputs.spectrum(context), inputs.screened(context)
    validation = validation_of(structure, spectrum, screened, inputs.layout(context), context)
    labels = layout_labels(training.name, validation.trial.gauges)
    shown, repeats = validation.validated, validation.validated.repeats
    numbers, decision = (
        validation_numbers(validation, config.validation.truth.model),
        validation_decision(config, validation),
    )
    claims = {}
    if decision.withheld:
        numbers = {key: value for key, value in numbers.items() if key.split(".")[0] not in OF_SIGMA}
        numbers |= {"out_of_range": decision.withheld, "verdict": WITHHELD}
        shown = validated_without_sigma(shown)
    else:
        claims = {
            name: claims_of(name, numbers, (repeats.error[name], repeats.std[name])) for name in validation.accuracy
        }
        numbers |= {f"claim.{name}": every[0].verdict for name, every in claims.items() if every}
    units = {name: load.unit for name, load in config.loads.items()}
    field = {"true": shown.field.true, "strain": shown.field.strain, "std": shown.field.std}
    # Where not all read strain, an array has several units.
    strains = np.all(training.candidates.quantity == STRAIN)
    grid, attributes = gauge_grid(
        training.candidates.position, field, dict.fromkeys(field, STRAIN_UNIT) if strains else {}
    )
    return Output(
        datasets=grid | written(shown, validation.units),
        attributes=attributes,
        summary=numbers,
        message=validation_message(validation, claims, decision.withheld),
        tables=(
            validation_table(validation, bool(decision.withheld)),
            *budget_tables(shown.budget, validation.without),
            *([] if shown.compared is None else [comparison_table(shown.compared, validation.units)]),
            *([] if shown.sweep is None else [sweep_table(shown.sweep)]),
        ),
        files={"measured.csv": measured_csv(validation.trial, labels, shown.gauge.measured, units)},
    )


VALIDATE = Stage(
    "validate",
    version=33,
    reads=(
        "damping",
        *(
            "seed",
            "parameters",
            "loads",
            "process_noise",
            "train",
            "tolerances",
            "place.estimate",
            "filter",
            "validate",
        ),
        *READS,
    ),
    upstream=("import", "rom", "train", "screen", "place", "spectrum"),
    files=("parameters.*.guess.from", "loads.*.signal.file", *FILES),
    run=run,
)
