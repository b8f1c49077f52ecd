"""validate: the chosen gauges put to the test on a truth that is not the filter's model (thesis 6.1)."""

from __future__ import annotations

import numpy as np

from strainsight.cases.filters_compared import comparison_table
from strainsight.cases.layout.budget import budget_tables
from strainsight.cases.layout.names import layout_labels
from strainsight.cases.structure.excluded import by_bank, excluded, excluded_in_words
from strainsight.cases.structure.full_model import FILES, READS
from strainsight.cases.structure.out_of_range import validated_out_of_range, without_sigma
from strainsight.cases.structure.sweeps import sweep_table
from strainsight.cases.structure.validation import measured_csv, validation_of
from strainsight.cases.structure.validation_text import validation_message, validation_numbers, validation_table
from strainsight.config.placement import PlacementConfig
from strainsight.config.tolerances import NONE, tolerances_of
from strainsight.estimation.verdict import OVERCONFIDENT
from strainsight.gauges.candidates import STRAIN
from strainsight.records.grids import STRAIN as STRAIN_UNIT
from strainsight.records.grids import gauge_grid
from strainsight.records.record import written
from strainsight.report.placement.verdicts import WITHHELD, claims_of, in_words
from strainsight.stages import inputs
from strainsight.workflow.output import Output
from strainsight.workflow.stage import Context, Stage

OF_SIGMA = ("std", "smoothed_std", "ratio", "rank_claimed", "rank_correlation")
"""Numbers of the summary that σ is in."""


def run(context: Context[PlacementConfig]) -> Output:
    """The validation, with the strain of every candidate as points of a grid."""
    config, training = context.config, inputs.training(context)
    found = validation_of(
        config,
        inputs.mesh(context),
        inputs.spectrum(context),
        inputs.reduced(context),
        training,
        inputs.screened(context),
        inputs.layout(context),
        context,
    )
    labels = layout_labels(training.name, found.trial.gauges)
    own, repeats = found.validated, found.validated.repeats
    numbers = validation_numbers(found, config.validation.truth.model)
    values = {name: own.estimate for name, own in found.accuracy.items()}
    ends = {name: (own.smoothed[name][-1], own.smoothed_std[name][-1]) for name in own.smoothed}
    apart = excluded(ends, by_bank(own.compared)) if tolerances_of(config.tolerances) == NONE else ""
    beyond = validated_out_of_range(config, found.trial.problem, values)
    beyond = beyond or excluded_in_words(apart, found.trial.settled is not None, "train.settle")
    claims = {name: claims_of(name, numbers, (repeats.error[name], repeats.std[name])) for name in found.accuracy}
    numbers |= {f"claim.{name}": own[0].verdict for name, own in claims.items() if own and not beyond}
    doubts = {
        name: in_words(own[0]) for name, own in claims.items() if own and own[0].verdict == OVERCONFIDENT and not beyond
    }
    if beyond:
        numbers = {key: value for key, value in numbers.items() if key.split(".")[0] not in OF_SIGMA}
        numbers |= {"out_of_range": beyond, "verdict": WITHHELD}
        own = without_sigma(own)
    units = {name: load.unit for name, load in config.loads.items()}
    field = {"true": own.field.true, "strain": own.field.strain, "std": own.field.std}
    # Where not all read strain, an array has several units.
    strains = np.all(training.candidates.quantity == STRAIN)
    grid, attributes = gauge_grid(
        training.candidates.position, field, dict.fromkeys(field, STRAIN_UNIT) if strains else {}
    )
    return Output(
        datasets=grid | written(own, found.units),
        attributes=attributes,
        summary=numbers,
        message=validation_message(found, doubts, beyond),
        tables=(
            validation_table(found, bool(beyond)),
            *budget_tables(own.budget, found.without),
            *([] if own.compared is None else [comparison_table(own.compared, found.units)]),
            *([] if own.sweep is None else [sweep_table(own.sweep)]),
        ),
        files={"measured.csv": measured_csv(found.trial, labels, own.gauge.measured, units)},
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
