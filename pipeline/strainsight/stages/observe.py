"""observe: which unknowns the pool could tell, for all seven cases of tables 6.1 and 6.2."""

from __future__ import annotations

from strainsight.config.placement import PlacementConfig
from strainsight.experiment.structure.observation import observed_of
from strainsight.ordering import first_of_largest
from strainsight.records.placed import Observed
from strainsight.records.record import written
from strainsight.runner.output import Output, Table
from strainsight.runner.stage import Context, Stage
from strainsight.stages import inputs


def run(context: Context[PlacementConfig]) -> Output:
    """The cases, and which is the worst at the training motion, of load cases in the one where it is worst."""
    reduced, training, screened = inputs.reduced(context), inputs.training(context), inputs.screened(context)
    found = observed_of(context.config, reduced, training, screened, context)
    trained = found.condition[: len(training.motions)]
    condition = trained.max(axis=0)
    worst = first_of_largest(condition)
    where = f" in {found.excitation[first_of_largest(trained[:, worst])]}" * bool(training.cases)
    return Output(
        datasets=written(found),
        summary={f"condition.{case}": float(value) for case, value in zip(found.case, condition, strict=True)},
        message=f"{len(condition)} cases, the worst {_unknowns(found, worst)}{where}: {condition[worst]:.2g}",
        tables=(_table(found),),
    )


def _unknowns(found: Observed, case: int) -> str:
    return found.unknowns[case].replace(", ", " + ")


def _table(found: Observed) -> Table:
    rows = tuple(
        (
            _unknowns(found, j),
            *(f"{value:.3g}" for value in found.condition[:, j]),
            *(f"{value:.1e}" for value in found.condition_raw[:, j]),
            "; ".join(dict.fromkeys(filter(None, found.lost[:, j].tolist()))),
        )
        for j in range(len(found.case))
    )
    columns = (*(f"condition, {e}" for e in found.excitation), *(f"raw, {e}" for e in found.excitation))
    title = "observability: condition of the scaled PBH matrix, and the thesis's raw number"
    return Table(title, ("unknown", *columns, "weakly observable"), rows)


OBSERVE = Stage(
    "observe",
    version=2,
    reads=("seed", "loads", "parameters.*.property", "train", "observe", "place.instants"),
    upstream=("rom", "train", "screen"),
    files=("loads.*.signal.file",),
    run=run,
)
