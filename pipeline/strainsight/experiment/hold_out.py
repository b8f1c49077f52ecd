"""Hold-out test: compare each channel with its prediction from the other channels."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from strainsight.estimation.decision import Claim, check_ratio, claim_in_time
from strainsight.experiment.system import TestedSystem
from strainsight.records.estimated import HoldOut
from strainsight.runner.output import Scalar, Table
from strainsight.sensors.candidates import STRAIN, UNITS

NOT_GIVEN = "the filter does not use this channel"
MOST_SCALED = 3.0
"""Largest factor on σ at positions without gauges; above it this σ is withheld."""


def held_out(system: TestedSystem, progress: Callable[[str, float], None]) -> tuple[HoldOut, ...]:
    """Predict the channels of every part from all other channels, in every record; NaN, and the reason, for the rest."""
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
    """Hold-out result of one channel.

    reading, error: RMS of readings and of prediction − reading [unit of the channel]; inside: share of samples within 2σ; claim:
    check of error/σ, None without σ; left_in: why it was not left out, else empty."""

    label: str
    reading: float
    error: float
    inside: float
    claim: Claim | None
    left_in: str = ""


def left_out(hold_out: HoldOut | None, labels: Sequence[str], measured: np.ndarray) -> tuple[LeftOut, ...]:
    """Evaluate the hold-out test of every channel; measured (T, ..., m), NaN if missing. Correlated errors count as fewer samples
    (`autocorrelation_time`)."""
    rows: list[LeftOut] = []
    if hold_out is None:
        return ()
    for i, (label, why) in enumerate(zip(labels, hold_out.left_in, strict=True)):
        read, std = measured[..., i], hold_out.std[..., i]
        error = hold_out.predicted[..., i] - read
        scaled = error / std
        claim = claim_in_time(error, std)
        inside = float(np.mean(np.abs(scaled[np.isfinite(scaled)]) < 2)) if claim is not None else np.nan
        known = np.isfinite(error)
        rows.append(LeftOut(label, rms(read[known]), rms(error[known]), inside, claim, why))
    return tuple(rows)


def field_factor(rows: Sequence[LeftOut]) -> float:
    """Factor on σ of strain and stress at positions without gauges; 1 unless a held-out channel and s are overconfident.

        s = √(mean over m channels of (error/σ)²),     draws: sum over the channels

    s is the ratio of Birge, Phys. Rev. 40 (1932)."""
    claims = [row.claim for row in rows if row.claim is not None]
    if not any(claim.overconfident for claim in claims):
        return 1.0
    ratio = float(np.sqrt(np.mean([claim.ratio**2 for claim in claims])))
    return ratio if check_ratio(ratio, sum(claim.draws for claim in claims)).overconfident else 1.0


def applied_factor(hold_outs: Iterable[HoldOut | None]) -> float:
    """Largest factor on σ at positions without gauges, from the hold-out tests of some records; NaN if this σ is withheld."""
    factor = max(
        (one.field_factor for one in hold_outs if one is not None and one.field_factor is not None), default=1.0
    )
    return factor if factor <= MOST_SCALED else np.nan


def field_in_words(hold_out: HoldOut | None) -> list[str]:
    """State that σ at positions without gauges is scaled or withheld; empty if it is neither."""
    if hold_out is None or hold_out.field_factor in (None, 1.0):
        return []
    withheld = bool(np.isnan(applied_factor([hold_out])))
    action = "withheld" if withheld else f"multiplied by {hold_out.field_factor:.3g}"
    limit = f", more than {MOST_SCALED:g} σ" * withheld
    return [
        f"σ of strain, stress and damage at positions without gauges is {action}, because errors of the held-out channels are "
        f"{hold_out.field_factor:.3g} σ (RMS){limit}"
    ]


def hold_out_numbers(rows: Sequence[LeftOut]) -> dict[str, Scalar]:
    """Summary numbers: share of samples within 2σ, and error/σ of every channel."""
    inside = [row.inside for row in rows if row.claim is not None]
    numbers: dict[str, Scalar] = {"hold_out.inside": float(np.mean(inside))} if inside else {}
    return numbers | {f"hold_out.ratio.{row.label}": row.claim.ratio for row in rows if row.claim is not None}


def misfits_in_words(rows: Sequence[LeftOut], others: str) -> list[str]:
    """Name the channels that disagree with the others, the worst first, as it also distorts the predictions of others."""
    off = [(row.claim.ratio, row.label) for row in rows if row.claim and row.claim.overconfident]
    channels = [f"{label} (error {ratio:.2g} σ)" for ratio, label in sorted(off, key=lambda one: -one[0])]
    return [f"the prediction from the other {others} disagrees with {', '.join(channels)}"] if channels else []


def hold_out_table(rows: Sequence[LeftOut], units: Sequence[str], each: str) -> Table:
    """Table of readings and hold-out errors of every channel."""
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
        f"each {each} predicted from the other {each}s",
        ("channel", "RMS reading", "RMS error", "error / σ", "within 2σ", "consistency"),
        tuple(lines),
    )


def size_in_words(size: float, unit: str) -> str:
    """Size of a reading with unit; strain in µm/m."""
    factor, shown = (1e6, "µm/m") if unit == UNITS[STRAIN] else (1.0, unit)
    return f"{factor * size:.4g} {shown}"


def rms(values: np.ndarray) -> float:
    """RMS of values (T,), NaN for none."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan
