"""Channels that a filter was not given, beside what the others say of them: how far they are off, and the verdict on that."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.estimation.decision import Claim, claim_in_time
from strainsight.experiment.system import TestedSystem
from strainsight.records.estimated import HoldOut
from strainsight.runner.output import Scalar, Table
from strainsight.sensors.candidates import STRAIN, UNITS

NOT_GIVEN = "the filter is not given it"


def held_out(system: TestedSystem, progress: Callable[[str, float], None]) -> tuple[HoldOut, ...]:
    """Predict the channels of every part in every record by all other channels; NaN of channels that stay in, and why they do."""
    every = [np.full((2, *values.shape), np.nan) for values in system.measured]
    left_in = np.where(system.available, "", NOT_GIVEN).astype(object)
    parts = [part for part in system.parts if system.available[part].any()]
    for i, part in enumerate(parts):
        progress(f"without {system.labels[part[0]]}", i / len(parts))
        predictions, why = system.by_others(part)
        left_in[part[system.available[part]]] = why
        for values, prediction in zip(every, predictions, strict=False):
            values[..., part] = prediction
    for values in every:
        values[..., left_in != ""] = np.nan
    return tuple(HoldOut(predicted=mean, std=std, left_in=tuple(left_in)) for mean, std in every)


@dataclass(frozen=True)
class LeftOut:
    """Of a channel that was left out: RMS of its readings, and of what the others say less these [unit of the channel]; share of
    the samples within 2σ; the verdict on error over σ, None where there is no σ or the others cannot tell; left_in: why it was
    not left out, empty where it was."""

    label: str
    reading: float
    error: float
    inside: float
    claim: Claim | None
    left_in: str = ""


def left_out(held: HoldOut | None, labels: Sequence[str], measured: np.ndarray) -> tuple[LeftOut, ...]:
    """Every channel by its label, none where no channel was left out; measured (T, ..., m), NaN where nothing was. Neighbouring
    samples are off alike: as many draws as the samples are worth (`autocorrelation_time`)."""
    rows: list[LeftOut] = []
    if held is None:
        return ()
    for i, (label, why) in enumerate(zip(labels, held.left_in, strict=True)):
        read, std = measured[..., i], held.std[..., i]
        error = held.predicted[..., i] - read
        scaled = error / std
        claim = claim_in_time(error, std)
        inside = float(np.mean(np.abs(scaled[np.isfinite(scaled)]) < 2)) if claim is not None else np.nan
        known = np.isfinite(error)
        rows.append(LeftOut(label, rms(read[known]), rms(error[known]), inside, claim, why))
    return tuple(rows)


def hold_out_numbers(rows: Sequence[LeftOut]) -> dict[str, Scalar]:
    """Share of all samples within 2σ; error over σ of every channel."""
    inside = [row.inside for row in rows if row.claim is not None]
    numbers: dict[str, Scalar] = {"hold_out.inside": float(np.mean(inside))} if inside else {}
    return numbers | {f"hold_out.ratio.{row.label}": row.claim.ratio for row in rows if row.claim is not None}


def misfits_in_words(rows: Sequence[LeftOut], others: str) -> list[str]:
    """The channels that the others contradict, the worst first: a wrong one misleads what is predicted of others, too."""
    off = [(row.claim.ratio, row.label) for row in rows if row.claim and row.claim.overconfident]
    channels = [f"{label} (error {ratio:.2g} σ)" for ratio, label in sorted(off, key=lambda one: -one[0])]
    return [f"the other {others} contradict {', '.join(channels)}"] if channels else []


def hold_out_table(rows: Sequence[LeftOut], units: Sequence[str], each: str) -> Table:
    """What every channel read and what the others say of it."""
    lines = []
    for unit, row in zip(units, rows, strict=True):
        if row.left_in:
            lines.append((row.label, "–", "–", "–", "–", row.left_in))
            continue
        share = f"{100 * row.error / row.reading:.3g} %" if row.reading > 0 else "–"
        claim = ("–", "–", "σ is withheld")
        if row.claim is not None:
            claim = f"{row.claim.ratio:.2g}", f"{100 * row.inside:.3g} %", row.claim.result
        lines.append((row.label, size_in_words(row.reading, unit), share, *claim))
    return Table(
        f"every {each} by the others",
        ("channel", "RMS reading", "RMS error", "error over σ", "within 2σ", "verdict"),
        tuple(lines),
    )


def size_in_words(size: float, unit: str) -> str:
    """Of a reading; of strain in µm/m."""
    factor, shown = (1e6, "µm/m") if unit == UNITS[STRAIN] else (1.0, unit)
    return f"{factor * size:.4g} {shown}"


def rms(values: np.ndarray) -> float:
    """Of values (T,), NaN of none."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan
