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
    observed = observed_of(context.config, reduced, training, screened, context)
    trained = observed.condition[: len(training.motions)]
    condition = trained.max(axis=0)
    worst = first_of_largest(condition)
    where = f" in {observed.excitation[first_of_largest(trained[:, worst])]}" * bool(training.cases)
    return Output(
        datasets=written(observed),
        summary={f"condition.{case}": float(value) for case, value in zip(observed.case, condition, strict=True)},
        message=f"{len(condition)} cases, the worst {_unknowns(observed, worst)}{where}: {condition[worst]:.2g}",
        tables=(_table(observed),),
    )


def _unknowns(observed: Observed, case: int) -> str:
    return observed.unknowns[case].replace(", ", " + ")


def _table(observed: Observed) -> Table:
    rows = tuple(
        (
            _unknowns(observed, j),
            *(f"{value:.3g}" for value in observed.condition[:, j]),
            *(f"{value:.1e}" for value in observed.condition_raw[:, j]),
            "; ".join(dict.fromkeys(filter(None, observed.lost[:, j].tolist()))),
        )
        for j in range(len(observed.case))
    )
    columns = (*(f"condition, {e}" for e in observed.excitation), *(f"raw, {e}" for e in observed.excitation))
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
