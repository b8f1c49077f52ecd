"""Consistency check of a bench estimate: result for every unknown, warnings, and whether σ is withheld."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from strainsight.config.bench.bench import BenchConfig
from strainsight.config.bench.estimate import BenchEstimateSection, FromFile
from strainsight.estimation.decision import (
    CONFIRMED,
    DIVERGED,
    INCONSISTENT,
    LOST,
    NOT_TESTED,
    OUT_OF_RANGE,
    OVERCONFIDENT,
    SENSORS_DISAGREE,
    TOO_CAUTIOUS,
    WEAK,
    WITHHELD,
    Claim,
    Decision,
    check_ratio,
)
from strainsight.experiment.bench.inverse.comparison import BenchComparison, compare, smoothed_name
from strainsight.experiment.bench.inverse.estimation import BenchEstimation
from strainsight.experiment.bench.inverse.problem import parameter_units
from strainsight.experiment.bench.loads import load_units
from strainsight.experiment.bench.sensors import channel_units, dataset_units
from strainsight.experiment.filters_compared import COMPARED, comparison_table, disagreements_in_words, ratios
from strainsight.experiment.hold_out import hold_out_numbers, hold_out_table, misfits_in_words
from strainsight.records.bench import BenchEstimated
from strainsight.records.record import written
from strainsight.runner.output import Output, Scalar, Table, warnings_table
from strainsight.text import csv_bytes, listed, number

HARDLY = 0.5
"""σ of a load relative to its largest value above which it is weakly observable."""
MATCHES = 0.01
"""Largest mismatch of a sensor for benches with the same motion."""
REMEDY = (
    "set bodies.*.moduli.*.value closer to the estimate, keep more modes (bodies.*.modes), or check loads, units, supports and "
    "sensors"
)
"""Remedy for a modulus outside its `reach`."""


@dataclass(frozen=True)
class Evidence:
    """Input of the consistency check.

    estimation: with σ, even if withheld; numbers: of the summary; claims: by unknown with known truth; outside_range: parameters
    outside their ranges, which invalidates all σ."""

    estimation: BenchEstimation
    numbers: Mapping[str, Scalar]
    claims: Mapping[str, Claim]
    outside_range: Mapping[str, str]

    @property
    def estimate(self) -> BenchEstimateSection:
        return self.estimation.problem.estimate

    @property
    def names(self) -> tuple[str, ...]:
        return self.estimation.problem.names

    @property
    def in_test(self) -> bool:
        return isinstance(self.estimate.measured, FromFile)

    @cached_property
    def left_out(self) -> tuple[Claim, ...]:
        """Claims on hold-out predictions."""
        return tuple(row.claim for row in self.estimation.held_out if row.claim is not None)

    @property
    def size(self) -> str:
        """Result of the innovation check, empty without innovations."""
        nis, late = self._number("nis"), self.estimation.filtered.nis
        innovations = int(np.isfinite(late[len(late) // 2 :, 0]).sum()) * int(self._number("channels"))
        return check_ratio(np.sqrt(nis), innovations).result if nis >= 0 else ""

    @property
    def against(self) -> tuple[str, ...]:
        """Unknowns without known truth if sensors are inconsistent with the model."""
        # innovations do not include gauge errors
        against = self.size == OVERCONFIDENT and self.estimate.tolerances is None
        against |= any(claim.overconfident for claim in self.left_out)
        return tuple(name for name in self.names if against and name not in self.claims)

    @property
    def decision(self) -> Decision:
        """Decision on σ: consistency with the model in a test, and parameters outside their ranges."""
        estimate, words = self.estimate, ""
        if self.in_test and self.against:
            more = "" if estimate.hold_out is not None else ", or find the faulty channel by estimate.hold_out: each"
            check = f"Check channels, units and noise of estimate.measured{more}"
            words = f"{INCONSISTENT}: {self._disagreement}. {check}"
        return Decision(words, accept=estimate.accept_inconsistent, out_of_range=self.outside_range, remedy=REMEDY)

    @property
    def _disagreement(self) -> str:
        subject = "the estimate of" if len(self.against) == 1 else "the estimates of"
        return f"{subject} {listed(self.against)} {'is' if len(self.against) == 1 else 'are'} {SENSORS_DISAGREE}"

    def result_of(self, name: str) -> str:
        """Most serious problem of an unknown; else the calibration of σ if the truth is known, or the result of the hold-out
        test."""
        claim = self.claims.get(name)
        applies = {
            DIVERGED: self._number("lost") > 0,
            OUT_OF_RANGE: name in self.outside_range,
            WITHHELD: bool(self.outside_range),
            LOST: self.numbers.get(f"identified.{name}") is False,
            OVERCONFIDENT: claim is not None and claim.overconfident,
            SENSORS_DISAGREE: name in self.against,
            WEAK: self._share(name) > HARDLY,
        }
        sound = claim.result if claim is not None else CONFIRMED if self.left_out else NOT_TESTED
        return next((word for word, holds in applies.items() if holds), sound)

    def overconfident(self) -> list[str]:
        """Sentence for every overconfident claim."""
        kinds = {name: ("", name) for name in self.names} | {
            smoothed_name(name): ("smoothed ", name) for name in self.names
        }
        wrong = ((*kinds[key], claim.words(number)) for key, claim in self.claims.items() if claim.overconfident)
        return [f"the {smoothed}estimate of {name} is {words}" for smoothed, name, words in wrong]

    def warnings(self) -> Iterator[str]:
        """Warnings about overconfident, unobservable or inconsistent estimates."""
        estimate, lost = self.estimate, self.estimation.filtered.lost
        if (diverged := lost[lost >= 0]).size:
            yield f"{len(diverged)} of {len(lost)} filter runs diverged, the first at step {diverged.min()}"
        if not self.outside_range:
            yield from self.overconfident()
            yield from (
                f"{name} is weakly observable: σ is {100 * self._share(name):.3g} % of the largest value of {name}. Add sensors, "
                f"or remove {name} from estimate.inputs if this load is known"
                for name in self.names
                if self._share(name) > HARDLY
            )
            yield from (
                f"{name} is not identified: estimates from different initial values differ by more than 3.2 σ, or σ exceeds half "
                "of the initial σ, or the estimation error exceeds σ"
                for name in self.names
                if self.numbers.get(f"identified.{name}") is False
            )
        # slow loads reduce innovations, down to (m − n)/m, so warn only for a truth of the filter's own model
        if self.size == OVERCONFIDENT or (estimate.truth.model == "sampled" and self.size == TOO_CAUTIOUS):
            nis = self._number("nis")
            noises = "small" if nis > 1 else "large"
            tolerances = ". Gauge errors (estimate.tolerances) are included in σ, but not in this check"
            yield (
                f"the RMS innovation is {np.sqrt(nis):.3g} times the predicted value: the model of the filter differs from "
                f"the measured bench, or estimate.inputs.*.increment, estimate.disturbance or estimate.sensors.*.noise "
                f"is too {noises}{tolerances * bool(estimate.tolerances)}"
            )
        for name in estimate.sensors if estimate.measured is not None else ():
            if (mismatch := self._number(f"mismatch.{name}")) > MATCHES:
                where = "in the test" if self.in_test else f"in the run {getattr(estimate.measured, 'run', '')}"
                yield f"the reading of {name} {where} differs by {100 * mismatch:.3g} % RMS from the predicted reading"

    def message(self, numbers: Mapping[str, Scalar], units: Mapping[str, str], decision: Decision) -> str:
        """Message of one line: problems, then the accuracy of every unknown (loads relative to the largest true value), with σ
        unless withheld; numbers: shown ones; units: of the unknowns."""
        estimates, estimate, with_sigma = [], self.estimate, not decision.withheld
        of = defaultdict(lambda: np.nan, {key: float(n) for key, n in numbers.items() if not isinstance(n, str)})
        for name in self.names:
            if f"error.{name}" in of:
                sigma = f" (σ {100 * of[f'std.{name}']:.2g} %)" if with_sigma else ""
                estimates.append(f"{name} error {100 * of[f'error.{name}']:.2g} %{sigma}")
            elif f"ratio_slope.{name}" in of:
                slope, offset = of[f"ratio_slope.{name}"], of[f"ratio_offset.{name}"]
                estimates.append(
                    f"estimate of {name} = {slope:.3g} × load of the measured run "
                    f"{'+-'[offset < 0]} {abs(offset):.3g} {units[name]}"
                )
            elif f"rms_std.{name}" in of or not with_sigma:
                kind, value = ("RMS ", "rms") if name in estimate.inputs else ("", "estimate")
                sigma = f" ± {of[f'rms_std.{name}']:.2g}" if with_sigma else ""
                estimates.append(f"{name} {kind}{of[f'{value}.{name}']:.4g}{sigma} {units[name]}")
        if estimate.measured is not None:
            worst = max((of[f"mismatch.{name}"] for name in estimate.sensors), default=np.nan)
            estimates.insert(0, f"sensor mismatch {100 * worst:.2g} %")
        if "hold_out.inside" in of:
            estimates.append(
                f"sensors predicted from the other sensors: {100 * of['hold_out.inside']:.3g} % of samples within 2σ"
            )
        parts = [decision.message] if decision.message else []
        parts += [] if self.outside_range else self.overconfident()
        parts += [f"{name} is not identified" for name in self.names if of[f"identified.{name}"] == 0]
        parts += [self._disagreement] * bool(self.against and decision.trusted)
        parts.append(", ".join(estimates) or "no true values or measurements for comparison")
        return f"{'; '.join(parts)}; {numbers['method']}, {numbers['truth']}"

    def _share(self, name: str) -> float:
        """σ of a load relative to its largest value, NaN for a zero load and for parameters."""
        if name not in self.estimate.inputs:
            return np.nan
        if f"std.{name}" in self.numbers:
            return self._number(f"std.{name}")
        largest = self._number(f"largest.{name}")
        return self._number(f"rms_std.{name}") / largest if largest else np.nan

    def _number(self, key: str) -> float:
        return float(self.numbers.get(key, np.nan))


def estimate_output(config: BenchConfig, estimation: BenchEstimation) -> Output:
    """Output of an estimate, with σ withheld if it is not reliable."""
    estimate, problem, outside_range = estimation.problem.estimate, estimation.problem, estimation.outside_range
    result = compare(estimation)
    evidence = Evidence(estimation, bench_numbers(estimation, result), result.claims, outside_range)
    decision, shown = evidence.decision, estimation
    if decision.withheld:
        shown = estimation.without_sigma
        result = compare(shown)
    record, rows = result.record, shown.held_out
    warnings = [
        *filter(None, (decision.message,)),
        *misfits_in_words(rows, "channels"),
        *estimation.notes,
        *evidence.warnings(),
        *([] if outside_range else bench_disagreements(estimation)),
        *loud_sensors(estimate, record),
    ]
    results = {name: evidence.result_of(name) for name in problem.names}
    summary = bench_numbers(shown, result) | {f"verdict.{name}": word for name, word in results.items()}
    if evidence.in_test or outside_range:
        summary |= decision.numbers if evidence.in_test else {"withheld": decision.withheld}
    of_loads, of_parameters = load_units(config, record.inputs), parameter_units(config, record.parameters)
    units = dataset_units(config, record.inputs)
    tables = [unknowns_table(shown, result, results, evidence.in_test)]
    if shown.filtered.compared is not None:
        tables.append(comparison_table(shown.filtered.compared, of_parameters, COMPARED))
    if rows:
        tables.append(hold_out_table(rows, channel_units(config, problem.used), "channel"))
    tables += offsets_table(record, units)
    if estimation.reality.done:
        tables.append(Table("measurements", ("",), tuple((text,) for text in estimation.reality.done)))
    return Output(
        datasets=written(
            record, units | {f"parameter {key}": unit for key, unit in of_parameters.items()} | of_parameters
        ),
        summary=summary,
        message=evidence.message(summary, of_loads | of_parameters, decision),
        tables=(*tables, *warnings_table(warnings)),
        files={"loads.csv": command_history(record)} if record.inputs and estimation.filtered.lost[0] < 0 else {},
    )


METHODS = {
    "iterated": "iterated measurement update with damping",
    "one_shot": "single measurement update, projected onto the constraints",
    "undamped": "iterated measurement update without damping",
    "as_printed": "single measurement update as printed in the thesis of Cottone (2022), without projection",
}
TRUTHS = {
    "fine": "measurements simulated with the time step of the filter divided by {substeps}",
    "independent": "measurements simulated by the Radau method",
    "filter_step": "measurements simulated with the time step of the filter",
    "sampled": "measurements sampled from the model of the filter",
}
COLUMNS = {
    "inputs": ("slope", "offset", "error", "std", "smoothed_error", "smoothed_std"),
    "elsewhere": ("ratio_slope", "ratio_offset", "ratio_low", "ratio_high"),
    "parameters": ("error", "std", "ratio"),
    "measured": ("rms", "estimate", "largest", "rms_std"),
}
"""Summary numbers in the table of the unknowns."""


def loud_sensors(estimate: BenchEstimateSection, record: BenchEstimated) -> Iterator[str]:
    """Warnings about sensors whose noise exceeds all predicted readings."""
    for name, settings in estimate.sensors.items():
        noise, expected = float(np.min(settings.noise)), record.sensors[name].expected
        largest = float(np.max(np.abs(expected), initial=0.0))
        if noise > largest:
            key = f"estimate.sensors.{name}.noise"
            yield f"the noise of {name} ({noise:.3g}) exceeds the largest predicted reading ({largest:.3g}): check {key}"


def bench_disagreements(estimation: BenchEstimation) -> list[str]:
    """Warnings about an overconfident extended filter, and about the limits of the parameter grid filter."""
    words = disagreements_in_words(estimation.filtered.compared)
    if words and estimation.problem.estimate.inputs:
        words.append(
            "the estimates of the parameter grid filter also depend on estimate.inputs.*.increment and are biased if an "
            "increment is too large. Remove known loads from estimate.inputs, or correct the increments"
        )
    return words


def bench_numbers(estimation: BenchEstimation, result: BenchComparison) -> dict[str, Scalar]:
    estimate, filtered, nis = estimation.problem.estimate, estimation.filtered, estimation.filtered.nis[:, 0]
    late = filtered.nis[len(nis) // 2 :]
    measured, nu = np.isfinite(estimation.measured).any(axis=(0, 1)), len(estimation.problem.unknowns.inputs)
    m = max(int(measured.sum()), 1)
    return {
        "steps": len(nis),
        "step": float(estimation.problem.h),
        "channels": m,
        "unknowns": nu + len(estimation.problem.unknowns.free),
        "runs": estimation.measured.shape[1],
        "lost": int(np.sum(filtered.lost >= 0)),
        "nis": float(np.nanmean(late)) if np.isfinite(late).any() else -1.0,
        "expected_nis": (m - nu) / m if estimate.truth.model != "sampled" else 1.0,
        "violation": float(np.nanmax(result.record.violation)),
        "method": METHODS[estimate.method.update]
        + (
            ", process noise Q* as printed in the thesis of Cottone (2022)"
            if estimate.method.noise == "as_printed"
            else ""
        )
        + ("" if filtered.compared is None else ", parameter grid filter"),
        "truth": _truth(estimate),
        **result.numbers,
        **{
            f"{key}.{name}": value
            for name, claim in result.claims.items()
            for key, value in (
                ("claim", claim.result),
                ("claim_ratio", claim.ratio),
                ("claim_draws", float(claim.draws)),
                ("claim_most", claim.band[1]),
            )
        },
        **hold_out_numbers(estimation.held_out),
        **ratios(filtered.compared),
    }


def _truth(estimate: BenchEstimateSection) -> str:
    if isinstance(estimate.measured, FromFile):
        return f"measurements of the file {estimate.measured.file}"
    if estimate.measured is not None:
        return f"measurements of the run {estimate.measured.run}"
    text = TRUTHS[estimate.truth.model].format(substeps=estimate.truth.substeps)
    return text + ("" if estimate.truth.noise else ", without noise")


def unknowns_table(
    estimation: BenchEstimation, result: BenchComparison, results: Mapping[str, str], in_test: bool
) -> Table:
    shown = dict.fromkeys(result.record.inputs, COLUMNS["inputs"])
    shown |= dict.fromkeys(estimation.reality.elsewhere, COLUMNS["elsewhere"])
    shown |= dict.fromkeys(estimation.problem.unknowns.free, COLUMNS["parameters"])
    if in_test:
        shown = dict.fromkeys(shown, COLUMNS["measured"])
    rows = []
    for name, keys in shown.items():
        numbers = [(key, result.numbers.get(f"{key}.{name}")) for key in keys]
        cells = [f"{key.replace('_', ' ')} {value:.4g}" for key, value in numbers if value is not None]
        load = result.record.inputs.get(name)
        if load is not None and load.smoothed is not None and load.smoothed_std is None:
            cells.append("smoothed σ withheld")
        rows.append((name, results.get(name, ""), *cells))
    title = "unknowns: errors and σ relative to the largest true value"
    if in_test or estimation.reality.elsewhere:
        title = "estimates of the unknowns after settling" if in_test else "estimates of the unknowns"
    width = max((len(row) for row in rows), default=2)
    filled = tuple((*row, *[""] * (width - len(row))) for row in rows)
    return Table(title, ("unknown", "consistency", *[""] * (width - 2)), filled, answer=True)


def offsets_table(record: BenchEstimated, units: Mapping[str, str]) -> tuple[Table, ...]:
    """Table of final offsets of every component with an offset."""
    rows = [
        (name, str(k), f"{bias:.4g}", "withheld" if np.isnan(std) else f"{std:.3g}", units[f"sensor {name}"])
        for name, match in record.sensors.items()
        if match.bias is not None and match.bias_std is not None
        for k, (bias, std) in enumerate(zip(match.bias, match.bias_std, strict=True), start=1)
        if std != 0 and np.isfinite(bias)
    ]
    return (Table("final offsets", ("sensor", "component", "offset", "σ", "unit"), tuple(rows)),) if rows else ()


def command_history(record: BenchEstimated) -> bytes:
    """loads.csv: command history for a test rig, time [s] and every load [N, N m], smoothed if available."""
    loads = [history.estimate if history.smoothed is None else history.smoothed for history in record.inputs.values()]
    rows = ([f"{x:.9g}" for x in (instant, *(load[k] for load in loads))] for k, instant in enumerate(record.time))
    return csv_bytes([["time", *record.inputs], *rows])
