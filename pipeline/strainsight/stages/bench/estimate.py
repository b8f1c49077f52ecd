"""estimate: loads and parameters of a bench from its sensors, by Kalman filters on the implicit step (thesis 2-4)."""

from __future__ import annotations

from dataclasses import replace

from strainsight.config.bench.bench import BenchConfig
from strainsight.errors import ArtefactError
from strainsight.experiment.bench.inverse.comparison import compared
from strainsight.experiment.bench.inverse.estimation import estimated
from strainsight.experiment.bench.inverse.problem import free_properties, parameter_units
from strainsight.experiment.bench.inverse.verdicts import (
    Evidence,
    bench_disagreements,
    bench_numbers,
    bench_out_of_range,
    command_history,
    estimated_without_sigma,
    loud_sensors,
    offsets_table,
    unknowns_table,
)
from strainsight.experiment.bench.loads import load_units
from strainsight.experiment.bench.sensors import channel_units, dataset_units
from strainsight.experiment.filters_compared import COMPARED, comparison_table
from strainsight.experiment.hold_out import hold_out_table, misfits_in_words
from strainsight.records.bench import Simulated
from strainsight.records.record import read, written
from strainsight.runner.artefact import Artefact
from strainsight.runner.output import Output, Table, warnings_table
from strainsight.runner.stage import Context, Stage
from strainsight.stages.bench import inputs
from strainsight.stages.bench.inputs import HISTORIES


def run(context: Context[BenchConfig]) -> Output:
    """Simulate or fetch the measurements, run the filter on them, compare."""
    config, estimate = context.config, context.config.estimate
    assert estimate is not None  # a bench without it has no such stage
    bench = inputs.bench(context, free_properties(estimate))
    estimation = estimated(bench, _other_bench(context), inputs.truths(context), context)
    problem, without, beyond = estimation.problem, estimation.without, bench_out_of_range(estimation)
    shown = estimated_without_sigma(estimation) if beyond else estimation
    result = compared(shown)
    summary = bench_numbers(shown, result)
    evidence = Evidence(estimation, summary, result.claims, beyond)
    decision, rows = evidence.decision, shown.held_out
    warnings = [
        *filter(None, (decision.message,)),
        *misfits_in_words(rows, "channels"),
        *estimation.notes,
        *evidence.warnings(),
        *bench_disagreements(estimate, shown),
        *loud_sensors(estimate, result.record),
    ]
    verdicts = {name: evidence.verdict(name) for name in evidence.names}
    if decision.withheld and not beyond:
        # what the others say of a channel keeps its σ: that claim is what is tested
        shown = replace(estimated_without_sigma(estimation), without=without)
        result = compared(shown)
        summary = bench_numbers(shown, result)
    decided = decision.numbers if evidence.in_test else {"withheld": decision.withheld} if beyond else {}
    summary |= decided | {f"verdict.{name}": word for name, word in verdicts.items()}
    record, of_loads = result.record, load_units(config, result.record.inputs)
    of_parameters = parameter_units(config, evidence.free)
    units = dataset_units(config, of_loads)
    tables = [unknowns_table(shown, result, verdicts, evidence.in_test)]
    if rows:
        tables.append(hold_out_table(rows, channel_units(config, problem.used), "channel"))
    if offsets := offsets_table(record, units):
        tables.append(offsets)
    if estimation.reality.done:
        tables.append(Table("measurements", ("",), tuple((text,) for text in estimation.reality.done)))
    tables += warnings_table(warnings)
    units |= {f"parameter {name}": unit for name, unit in of_parameters.items()} | of_parameters
    if shown.filtered.compared is not None:
        tables.insert(1, comparison_table(shown.filtered.compared, of_parameters, COMPARED))
    return Output(
        datasets=written(record, units),
        summary=summary,
        message=replace(evidence, numbers=summary).message(of_loads | of_parameters, decision),
        tables=tuple(tables),
        files={"loads.csv": command_history(record)} if record.inputs and estimation.filtered.lost[0] < 0 else {},
    )


def _other_bench(context: Context[object]) -> Simulated | None:
    """The run of `estimate.measured`."""
    key = "estimate.measured.from"
    if key not in context.files:
        return None
    artefact = Artefact(context.files[key])
    if artefact.header.stage != "simulate":
        raise ArtefactError(f"{artefact.path.name} is of stage '{artefact.header.stage}', not of a simulation", key=key)
    return read(Simulated, artefact)


ESTIMATE = Stage(
    "estimate",
    version=16,
    reads=("seed", "bodies", "frames", "joints", "bearings", "forces", "sensors", "simulate", "estimate"),
    upstream=("import", "reduce"),
    files=(*HISTORIES, "estimate.measured.from", "estimate.measured.file"),
    run=run,
)
