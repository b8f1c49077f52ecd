"""What a test says, for people: numbers by name, one line, tables, all time signals as CSV."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strainsight.cases.filters_compared import comparison_table, disagreements_in_words, ratios
from strainsight.cases.hold_out import (
    Left,
    hold_out_numbers,
    hold_out_table,
    left_out,
    misfits_in_words,
    size_in_words,
)
from strainsight.cases.layout.budget import budget_tables
from strainsight.cases.structure.damage_text import damage_in_words, damage_numbers, damage_tables
from strainsight.cases.structure.estimation import Estimation
from strainsight.cases.structure.filtering import posterior_doubts, posterior_numbers
from strainsight.csv_cells import csv_bytes
from strainsight.records.estimated import Estimated
from strainsight.workflow.output import Scalar, Table


def estimation_numbers(found: Estimation) -> dict[str, Scalar]:
    """Every number by its name."""
    own, judged = found.estimated, found.verdict
    numbers: dict[str, Scalar] = {
        "samples": len(own.gauge.time),
        "channels": len(own.gauge.label),
        "verdict": judged.text,
        "innovation_ratio": judged.ratio,
        "consistent": judged.consistent,
        "trusted": found.judgement.trusted,
        "accepted": found.accepted and not found.judgement.trusted,
    }
    if found.judgement.named:
        numbers["fault"] = found.judgement.named
    for name, value in own.smoothed.items():
        load = name in found.unknowns.inputs
        numbers[f"estimate.{name}"] = rms(value) if load else float(np.mean(value))
        if not found.withheld:
            numbers[f"std.{name}"] = rms(own.smoothed_std[name])
    if found.tuning:
        numbers |= {f"factor.{part}": float(value) for part, value in found.tuning.factors.items()}
    numbers |= hold_out_numbers(without_each(own))
    if found.withheld:
        numbers["withheld"] = found.withheld
    if found.undetectable:
        numbers["unobservable"] = found.undetectable
    numbers |= damage_numbers(own.damage, found.labels)
    return numbers | posterior_numbers(own.posterior) | ratios(own.compared)


def estimation_message(found: Estimation) -> str:
    """One line."""
    numbers, units = estimation_numbers(found), found.units
    parts = [found.withheld] if found.withheld else []
    if found.accepted and not found.judgement.trusted:
        parts.append(f"accepted: {found.judgement.words}")
    parts.append(f"{numbers['samples']} samples of {numbers['channels']} channels in {found.estimated.source.file}")
    for name in found.unknowns.names:
        what = " RMS" if name in found.unknowns.inputs else ""
        sigma = "" if found.withheld else f" ± {numbers[f'std.{name}']:.2g}"
        parts.append(f"{name} {numbers[f'estimate.{name}']:.4g}{sigma} {units[name]}{what}")
    if "hold_out.inside" in numbers:
        parts.append(f"gauges by the others: {100 * numbers['hold_out.inside']:.3g} % within 2σ")
    parts += misfits_in_words(without_each(found.estimated), "gauges")
    if not found.verdict.consistent and found.judgement.trusted:
        parts.append("the noise does not fit the innovations")
    parts += damage_in_words(found.estimated.damage)
    parts += posterior_doubts(found.estimated.posterior, units)
    parts += disagreements_in_words(found.estimated.compared)
    return ", ".join(parts)


def estimation_tables(found: Estimation) -> tuple[Table, ...]:
    """Every unknown as smoothed; by other filters; what was done to the measurements, and the verdict on them."""
    rows = []
    for name, value in found.estimated.smoothed.items():
        std, unit = found.estimated.smoothed_std[name], found.units[name]
        if name in found.unknowns.inputs:
            span = f"{value.min():.5g} to {value.max():.5g} {unit}"
            estimate, sigma = f"RMS {rms(value):.5g}, {span}", f"± {rms(std):.3g} {unit}"
        else:
            # of a factor the unit is 1
            estimate = f"{value[-1]:.5g}" if unit == "1" else f"{value[-1]:.5g} {unit}"
            sigma = f"± {std[-1]:.3g} ({100 * std[-1] / value[-1]:.2g} %)"
        none = "withheld" if found.judgement.trusted else "not to be trusted"
        rows.append((name, estimate, none if found.withheld else sigma))
    # what is advised of the noise holds for a record that agrees with the model, or that nobody can explain
    notes = tuple((note,) for note in filter(None, (*found.estimated.notes, found.innovations_in_words)))
    beside, held = found.estimated.compared, without_each(found.estimated)
    return (
        Table("estimates, smoothed", ("unknown", "estimate", "claimed σ"), tuple(rows)),
        *damage_tables(found.estimated.damage, found.labels),
        *budget_tables(found.estimated.budget),
        *([] if beside is None else [comparison_table(beside, found.units)]),
        *([hold_out_table(held, found.channel_units, "gauge")] if held else []),
        channel_table(found.estimated, found.channel_units),
        Table("measurements", ("",), notes),
    )


def without_each(own: Estimated) -> tuple[Left, ...]:
    """Every gauge by the others, empty where that was not asked for."""
    if (held := own.hold_out) is None:
        return ()
    return left_out(held.predicted, held.std, held.left_in, own.gauge.label, own.gauge.measured)


def channel_table(own: Estimated, units: Sequence[str]) -> Table:
    """Every channel beside what the others, or the samples before, say of it; units of the channels."""
    check, rows = own.check, []
    for i, (name, unit) in enumerate(zip(own.gauge.label, units, strict=True)):
        sizes = (size_in_words(size, unit) for size in (check.measured[i], check.predicted[i]))
        rows.append((name, *sizes, f"{check.residual[i]:.3g}", f"{check.correlation[i]:.3g}"))
    columns: tuple[str, ...] = ("channel", "RMS measured", "RMS predicted", "residual / σ", "correlation")
    if check.by_others:
        columns = (*columns, "what explains the record best")
        rows = [(*row, text or "nothing") for row, text in zip(rows, check.fault, strict=True)]
    by = "by all other channels" if check.by_others else "one step ahead, by all channels"
    part = (
        ""
        if check.end - check.begin >= 0.99 * float(own.gauge.time[-1] - own.gauge.time[0])
        else (f", from {check.begin:.4g} to {check.end:.4g} s")
    )
    return Table(f"channels, predicted {by}{part}", columns, tuple(rows))


def estimation_csv(found: Estimation) -> bytes:
    """All time signals as a table, SI units in the header."""
    own = found.estimated
    columns = {"time [s]": own.time}
    for name in own.estimate:
        words = ("filtered", "filtered std", "smoothed", "smoothed std")
        values = (own.estimate[name], own.std[name], own.smoothed[name], own.smoothed_std[name])
        columns |= {f"{name} {word} [{found.units[name]}]": value for word, value in zip(words, values, strict=True)}
    for where, sum_there in zip(found.places, own.resultant.values(), strict=True):
        columns |= {f"{where} {axis} [N]": sum_there.force[:, i] for i, axis in enumerate("xyz")}
        columns |= {f"{where} size [N]": sum_there.magnitude, f"{where} size std [N]": sum_there.std}
    if own.virtual is not None:
        for i, label in enumerate(found.labels):
            columns |= {f"{label} [strain]": own.virtual.strain[:, i], f"{label} std [strain]": own.virtual.std[:, i]}
    rows = np.column_stack(list(columns.values()))
    return csv_bytes([list(columns), *([f"{x:.9g}" for x in row] for row in rows)])


def rms(history: np.ndarray) -> float:
    """Of values (T,)."""
    return float(np.sqrt(np.mean(history**2)))
