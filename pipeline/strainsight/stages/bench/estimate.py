"""estimate: loads and parameters of a bench from its sensors, by Kalman filters on the implicit step (thesis 2-4)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.estimate import Estimate, FromFile
from strainsight.csv_cells import csv_bytes
from strainsight.errors import ArtefactError
from strainsight.experiment.bench.inverse.comparison import Compared, compared
from strainsight.experiment.bench.inverse.estimation import Estimated, estimated
from strainsight.experiment.bench.inverse.problem import free_properties, parameter_units
from strainsight.experiment.bench.inverse.verdicts import (
    Evidence,
    bench_out_of_range,
    claim_numbers,
    estimated_without_sigma,
)
from strainsight.experiment.bench.loads import load_units
from strainsight.experiment.bench.sensors import channel_units, dataset_units
from strainsight.experiment.filters_compared import COMPARED, comparison_table, disagreements_in_words, ratios
from strainsight.experiment.hold_out import hold_out_numbers, hold_out_table, misfits_in_words
from strainsight.records.bench import Simulated
from strainsight.records.bench_estimated import BenchEstimated
from strainsight.records.record import read, written
from strainsight.runner.artefact import Artefact
from strainsight.runner.output import Output, Scalar, Table, warnings_table
from strainsight.runner.stage import Context, Stage
from strainsight.stages.bench import inputs
from strainsight.stages.bench.inputs import HISTORIES

METHODS = {
    "iterated": "iterated with the step inside",
    "one_shot": "one-shot, put back onto the constraints",
    "undamped": "iterated without damping",
    "as_printed": "one-shot as printed, on no constraints",
}
TRUTHS = {
    "fine": "the bench with h/{substeps}",
    "other": "the bench by Radau's method",
    "own": "the filter's own step",
    "walk": "drawn from the filter's own model",
}
COLUMNS = {
    "inputs": ("slope", "offset", "error", "std", "smoothed_error", "smoothed_std"),
    "elsewhere": ("ratio_slope", "ratio_offset", "ratio_low", "ratio_high"),
    "parameters": ("error", "std", "ratio"),
    "measured": ("rms", "estimate", "largest", "rms_std"),
}
"""Numbers in the table of the unknowns."""


def run(context: Context[BenchConfig]) -> Output:
    """Simulate or fetch the measurements, run the filter on them, compare."""
    config, estimate = context.config, context.config.estimate
    assert estimate is not None  # a bench without it has no such stage
    bench = inputs.bench(context, free_properties(estimate))
    own = estimated(bench, _other_bench(context), inputs.truths(context), context)
    problem, without = own.problem, own.without
    beyond = bench_out_of_range(own)
    held = [row.claim for row in own.held_out if row.claim is not None]
    own = estimated_without_sigma(own) if beyond else own
    result = compared(own)
    summary = _summary(own, result)
    nis = own.filtered.nis
    late = int(np.isfinite(nis[len(nis) // 2 :, 0]).sum()) * int(str(summary["channels"]))
    free, lost = problem.unknowns.free, own.filtered.lost
    evidence = Evidence(config, free, summary, result.claims, late, lost, held, beyond)
    decision, rows = evidence.decision, own.held_out
    warnings = [
        *filter(None, (decision.message,)),
        *misfits_in_words(rows, "channels"),
        *own.notes,
        *evidence.warnings(),
        *_disagreements(estimate, own),
        *_loud(estimate, result.found),
    ]
    verdicts = {name: evidence.verdict(name) for name in evidence.names}
    if decision.withheld and not beyond:
        # what the others say of a channel keeps its σ: that claim is what is tested
        own = replace(estimated_without_sigma(own), without=without)
        result = compared(own)
        summary = _summary(own, result)
    shown = decision.numbers if evidence.in_test else {"withheld": decision.withheld} if beyond else {}
    summary |= shown | {f"verdict.{name}": word for name, word in verdicts.items()}
    found, of_loads = result.found, load_units(config, result.found.inputs)
    of_parameters = parameter_units(config, free)
    units = dataset_units(config, of_loads)
    tables = [_table(own, result, verdicts, evidence.in_test)]
    if rows:
        tables.append(hold_out_table(rows, channel_units(config, problem.used), "channel"))
    if offsets := _offsets(found, units):
        tables.append(offsets)
    if own.reality.done:
        tables.append(Table("measurements", ("",), tuple((text,) for text in own.reality.done)))
    tables += warnings_table(warnings)
    units |= {f"parameter {name}": unit for name, unit in of_parameters.items()} | of_parameters
    if own.filtered.compared is not None:
        tables.insert(1, comparison_table(own.filtered.compared, of_parameters, COMPARED))
    return Output(
        datasets=written(found, units),
        summary=summary,
        message=replace(evidence, numbers=summary).message(of_loads | of_parameters, decision),
        tables=tuple(tables),
        files={"loads.csv": _command_history(found)} if found.inputs and lost[0] < 0 else {},
    )


def _loud(estimate: Estimate, found: BenchEstimated) -> Iterator[str]:
    """Of the sensors whose noise exceeds everything that they read by the estimate."""
    for name, settings in estimate.sensors.items():
        noise, largest = float(np.min(settings.noise)), float(np.max(np.abs(found.sensors[name].expected), initial=0.0))
        if noise > largest:
            key = f"estimate.sensors.{name}.noise"
            yield f"the noise of {name}, {noise:.3g}, exceeds its largest reading, {largest:.3g}: check {key}"


def _disagreements(estimate: Estimate, own: Estimated) -> list[str]:
    """Where the extended filter does not allow for what the bank finds, and when it is the bank that is wrong."""
    words = disagreements_in_words(own.filtered.compared)
    if words and estimate.inputs:
        words.append(
            "a bank judges parameters by how much the unknown loads move, too: where they move less than their increments say, "
            "it is the bank that is wrong; make a load known, or correct the increments"
        )
    return words


def _other_bench(context: Context[object]) -> Simulated | None:
    """The run of `estimate.measured`."""
    key = "estimate.measured.from"
    if key not in context.files:
        return None
    artefact = Artefact(context.files[key])
    if artefact.header.stage != "simulate":
        raise ArtefactError(f"{artefact.path.name} is of stage '{artefact.header.stage}', not of a simulation", key=key)
    return read(Simulated, artefact)


def _summary(own: Estimated, result: Compared) -> dict[str, Scalar]:
    estimate, filtered, nis = own.problem.estimate, own.filtered, own.filtered.nis[:, 0]
    late = filtered.nis[len(nis) // 2 :]
    given, nu = np.isfinite(own.measured).any(axis=(0, 1)), len(own.problem.unknowns.inputs)
    m = max(int(given.sum()), 1)
    return {
        "steps": len(nis),
        "step": float(own.problem.h),
        "channels": m,
        "unknowns": nu + len(own.problem.unknowns.free),
        "runs": own.measured.shape[1],
        "lost": int(np.sum(filtered.lost >= 0)),
        "nis": float(np.nanmean(late)) if np.isfinite(late).any() else -1.0,
        "expected_nis": (m - nu) / m if estimate.truth.model != "walk" else 1.0,
        "violation": float(np.nanmax(result.found.violation)),
        "method": METHODS[estimate.method.update]
        + (", Q* as printed" if estimate.method.noise == "as_printed" else "")
        + ("" if filtered.compared is None else ", a bank over parameters"),
        "truth": _truth(estimate),
        **result.numbers,
        **claim_numbers(result.claims),
        **hold_out_numbers(own.held_out),
        **ratios(filtered.compared),
    }


def _truth(estimate: Estimate) -> str:
    if isinstance(estimate.measured, FromFile):
        return f"measured in {estimate.measured.file}"
    if estimate.measured is not None:
        return f"measured on {estimate.measured.run}"
    text = TRUTHS[estimate.truth.model].format(substeps=estimate.truth.substeps)
    return text + ("" if estimate.truth.noise else ", without noise")


def _table(own: Estimated, result: Compared, verdicts: Mapping[str, str], in_test: bool) -> Table:
    shown = dict.fromkeys(result.found.inputs, COLUMNS["inputs"])
    shown |= dict.fromkeys(own.reality.elsewhere, COLUMNS["elsewhere"])
    shown |= dict.fromkeys(own.problem.unknowns.free, COLUMNS["parameters"])
    if in_test:
        shown = dict.fromkeys(shown, COLUMNS["measured"])
    rows = []
    for name, keys in shown.items():
        numbers = [(key, result.numbers.get(f"{key}.{name}")) for key in keys]
        cells = [f"{key.replace('_', ' ')} {value:.4g}" for key, value in numbers if value is not None]
        load = result.found.inputs.get(name)
        if load is not None and load.smoothed is not None and load.smoothed_std is None:
            cells.append("smoothed σ withheld")
        rows.append((name, verdicts.get(name, ""), *cells))
    title = "unknowns, errors and σ over the largest true value"
    if in_test or own.reality.elsewhere:
        title = "unknowns, settled" if in_test else "unknowns"
    width = max((len(row) for row in rows), default=2)
    filled = tuple((*row, *[""] * (width - len(row))) for row in rows)
    return Table(title, ("unknown", "verdict", *[""] * (width - 2)), filled)


def _offsets(found: BenchEstimated, units: Mapping[str, str]) -> Table | None:
    """Of every component that has an offset: what it reads too much at the end."""
    rows = [
        (name, str(k + 1), f"{own.bias[k]:.4g}", "withheld" if np.isnan(std) else f"{std:.3g}", units[f"sensor {name}"])
        for name, own in found.sensors.items()
        if own.bias is not None and own.bias_std is not None
        for k, std in enumerate(own.bias_std)
        if std != 0 and np.isfinite(own.bias[k])
    ]
    return Table("offsets at the end", ("sensor", "component", "offset", "σ", "unit"), tuple(rows)) if rows else None


def _command_history(found: BenchEstimated) -> bytes:
    """loads.csv: what a test rig has to do to the bench, time [s] and every load [N, N m], smoothed where it was.

    A rig moves the bench after the record, so that what later samples say of a load is known by then.
    """
    loads = [own.estimate if own.smoothed is None else own.smoothed for own in found.inputs.values()]
    rows = ([f"{x:.9g}" for x in (instant, *(load[k] for load in loads))] for k, instant in enumerate(found.time))
    return csv_bytes([["time", *found.inputs], *rows])


ESTIMATE = Stage(
    "estimate",
    version=16,
    reads=("seed", "bodies", "frames", "joints", "bearings", "forces", "sensors", "simulate", "estimate"),
    upstream=("import", "reduce"),
    files=(*HISTORIES, "estimate.measured.from", "estimate.measured.file"),
    run=run,
)
