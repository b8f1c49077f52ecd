"""modes: natural frequencies and shapes of the whole model at the reference, whatever loads it."""

from __future__ import annotations

from strainsight.config.placement import PlacementConfig
from strainsight.experiment.structure.reduction import FILES, READS, modes_of
from strainsight.experiment.structure.references import WHAT_IS_FREE, reference_value
from strainsight.experiment.structure.training import hertz
from strainsight.records.record import written
from strainsight.runner.output import Output, Table
from strainsight.runner.stage import Context, Stage
from strainsight.stages import inputs


def run(context: Context[PlacementConfig]) -> Output:
    """The lowest modes; runs that differ in their loads alone share the result."""
    config = context.config
    modes = modes_of(config, inputs.mesh(context), context)
    frequency, size = modes.frequency, len(modes.shape)
    guesses = {name: reference_value(name, entry.guess, context.files) for name, entry in config.parameters.items()}
    values = ", ".join(f"{name} = {value:.6g}" for name, value in guesses.items()) or "the deck"
    return Output(
        datasets=written(modes),
        summary={
            "unknowns": size,
            "modes": len(frequency),
            "first": float(frequency[0]),
            "last": float(frequency[-1]),
        },
        message=f"{len(frequency)} modes of {size} unknowns, {hertz(frequency[0], 2)} to {hertz(frequency[-1], 0)} Hz",
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
    version=6,
    reads=(*WHAT_IS_FREE, "parameters.*.guess", "rom.modes", *READS),
    upstream=("import",),
    files=("parameters.*.guess.from", *FILES),
    run=run,
)
